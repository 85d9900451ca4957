//! Where links and points of them are.

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::Tree;
use super::node::{Freedom, Node, Rotation, add};
use crate::{Error, Scalar};

impl Tree {
    /// The pose of every link in the world at `q`, in the order of [`links`](Self::links).
    ///
    /// # Errors
    /// When `q` has the wrong length or an entry that is not finite.
    pub fn link_poses(&self, q: &[f64]) -> Result<Vec<Isometry3<f64>>, Error> {
        let poses = self.poses(q)?;
        let links = 0..self.links.len();
        Ok(links.map(|link| self.link_pose_in(&poses, link)).collect())
    }

    /// The position in the world, m, of the point that stands at `point` in the frame of a link (its index among
    /// [`links`](Self::links)), on any scalar.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use lagrange::urdf;
    ///
    /// let text = r#"<robot name="r"><link name="base"/>
    ///   <link name="arm"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
    ///   <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/></joint>
    /// </robot>"#;
    /// let tree = urdf::read(text, &urdf::Options::default())?.tree;
    /// // A quarter turn: x goes to y.
    /// let [x, y, z] = tree.point_position(&[std::f64::consts::FRAC_PI_2], 1, [0.2, 0.0, 0.0]);
    /// assert!(x.abs() < 1e-15 && (y - 0.2).abs() < 1e-15 && z == 0.5);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Panics
    /// When `q` is too short, or there is no such link.
    pub fn point_position<D: Scalar>(&self, q: &[D], link: usize, point: [f64; 3]) -> [D; 3] {
        let link = &self.links[link];
        let at = link.pose * nalgebra::Point3::from(point);
        let mut x = [at.x, at.y, at.z].map(D::constant);
        let mut next = link.body.map(|b| self.bodies[b].node);
        while let Some(i) = next {
            let node = &self.nodes[i];
            x = node.outward(q, x);
            next = node.parent;
        }
        x
    }

    /// The nodes from the root to a link; none where a joint among them floats.
    pub(crate) fn path(&self, link: usize) -> Option<Vec<usize>> {
        let mut path = Vec::new();
        let mut next = self.links.get(link)?.body.map(|b| self.bodies[b].node);
        while let Some(i) = next {
            let node = &self.nodes[i];
            if node.freedom == Freedom::Free {
                return None;
            }
            path.push(i);
            next = node.parent;
        }
        path.reverse();
        Some(path)
    }

    /// Adds the generalized force of a force, N in the world's axes, on the point that stands at `point` in the frame of a link with
    /// this [`path`](Self::path): force · ∂x/∂q.
    ///
    /// From the root outward, force f and moment n about a frame's origin are taken into the next frame, Rᵀ f and Rᵀ (n − p × f). A
    /// joint that turns takes n_z, one that slides f_z.
    pub(crate) fn add_point_force<D: Scalar>(
        &self,
        q: &[D],
        (link, path): (usize, &[usize]),
        point: [f64; 3],
        force: [f64; 3],
        out: &mut [D],
    ) {
        if path.is_empty() || force == [0.0; 3] {
            return;
        }
        let [x, y, z] = self.point_position(q, link, point);
        let [a, b, c] = force;
        let mut moment = [y * c - z * b, z * a - x * c, x * b - y * a];
        let mut force = force.map(D::constant);
        for (k, &i) in path.iter().enumerate() {
            let node = &self.nodes[i];
            if let Some([a, b, c]) = node.translation {
                let [x, y, z] = force;
                let shift = [z * b - y * c, x * c - z * a, y * a - x * b];
                moment = [0, 1, 2].map(|k| moment[k] - shift[k]);
            }
            force = rotate_back(&node.rotation, &force);
            moment = rotate_back(&node.rotation, &moment);
            let along = match node.freedom {
                Freedom::Turn => moment[2],
                _ => force[2],
            };
            out[node.q] = out[node.q]
                + match node.follow {
                    None => along,
                    Some((ratio, _)) => along * ratio,
                };
            if k + 1 == path.len() {
                return;
            }
            let position = node.position(q);
            match node.freedom {
                Freedom::Turn => {
                    let (sin, cos) = position.sin_cos();
                    for [x, y, _] in [&mut force, &mut moment] {
                        (*x, *y) = (cos * *x + sin * *y, cos * *y - sin * *x);
                    }
                }
                _ => {
                    moment[0] = moment[0] + position * force[1];
                    moment[1] = moment[1] - position * force[0];
                }
            }
        }
    }

    /// The pose of every node's frame in the world.
    pub(super) fn node_poses_into(&self, q: &[f64], out: &mut Vec<Isometry3<f64>>) {
        out.clear();
        for node in &self.nodes {
            let parent = node.parent.map_or(Isometry3::identity(), |p| out[p]);
            out.push(parent * node.pose_at_zero() * node.joint_pose(q));
        }
    }

    /// That `q` is as long as it has to be, and finite.
    pub(super) fn check(&self, q: &[f64]) -> Result<(), Error> {
        if q.len() != self.nq() {
            return Err(Error::Dimension {
                what: "q",
                found: q.len(),
                expected: self.nq(),
            });
        }
        match q.iter().position(|x| !x.is_finite()) {
            Some(index) => Err(Error::NotFinite {
                what: "q",
                index,
                value: q[index],
            }),
            None => crate::state::check_unit(self.coordinates(), q),
        }
    }
}

impl Node {
    /// The frame at joint position 0, in the parent's.
    fn pose_at_zero(&self) -> Isometry3<f64> {
        let rotation = self.rotation.map_or(Rotation3::identity(), |columns| {
            Rotation3::from_matrix_unchecked(Matrix3::from(columns))
        });
        Isometry3::from_parts(
            Translation3::from(Vector3::from(self.translation.unwrap_or_default())),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }

    /// The frame, in that at joint position 0.
    fn joint_pose(&self, q: &[f64]) -> Isometry3<f64> {
        match self.freedom {
            Freedom::Turn => Isometry3::rotation(Vector3::z() * self.position(q)),
            Freedom::Slide => Isometry3::translation(0.0, 0.0, self.position(q)),
            Freedom::Free => {
                let (p, turn) = self.pose(q);
                let [x, y, z] = turn.u;
                Isometry3::from_parts(
                    Translation3::from(Vector3::from(p)),
                    UnitQuaternion::from_quaternion(Quaternion::new(turn.w, x, y, z)),
                )
            }
        }
    }

    /// A point of this frame, in the parent's.
    fn outward<D: Scalar>(&self, q: &[D], x: [D; 3]) -> [D; 3] {
        let x = match self.freedom {
            Freedom::Turn => {
                let (sin, cos) = self.position(q).sin_cos();
                [cos * x[0] - sin * x[1], sin * x[0] + cos * x[1], x[2]]
            }
            Freedom::Slide => [x[0], x[1], x[2] + self.position(q)],
            Freedom::Free => {
                let (p, turn) = self.pose(q);
                add(&turn.turn(&x), &p)
            }
        };
        let x = rotate(&self.rotation, &x);
        match self.translation {
            Some(p) => [x[0] + p[0], x[1] + p[1], x[2] + p[2]],
            None => x,
        }
    }
}

/// R x for a constant rotation R.
pub(super) fn rotate<D: Scalar>(rotation: &Rotation, x: &[D; 3]) -> [D; 3] {
    match rotation {
        None => *x,
        Some([a, b, c]) => [0, 1, 2].map(|k| x[0] * a[k] + x[1] * b[k] + x[2] * c[k]),
    }
}

/// Rᵀ x for a constant rotation R.
fn rotate_back<D: Scalar>(rotation: &Rotation, x: &[D; 3]) -> [D; 3] {
    match rotation {
        None => *x,
        Some(columns) => columns.map(|[a, b, c]| x[0] * a + x[1] * b + x[2] * c),
    }
}
