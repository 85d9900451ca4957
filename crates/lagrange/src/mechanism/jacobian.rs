//! Jacobians of links and of the centre of mass.

use nalgebra::{DMatrix, Isometry3, Vector3};

use super::Tree;
use super::node::{Freedom, Node};
use crate::Error;

/// The poses of all bodies of a [`Tree`] at one configuration: what link poses and Jacobians are made of, and the memory for them.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use lagrange::urdf;
///
/// let text = r#"<robot name="r"><link name="base"/>
///   <link name="arm"><inertial><origin xyz="0.4 0 0"/><mass value="1"/>
///     <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
///   <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
/// </robot>"#;
/// let tree = urdf::read(text, &urdf::Options::default())?.tree;
/// let mut poses = tree.poses(&[0.0])?;
/// let mut jacobian = nalgebra::DMatrix::zeros(6, 1);
/// for q in [0.0, 0.1, 0.2_f64] {
///     tree.poses_into(&[q], &mut poses);
///     tree.link_jacobian_into(&poses, 1, [2.0, 0.0, 0.0], &mut jacobian);
///     assert!((jacobian[(0, 0)] + 2.0 * q.sin()).abs() < 1e-15 && (jacobian[(5, 0)] - 1.0).abs() < 1e-15);
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Poses {
    /// Of every node's frame in the world.
    nodes: Vec<Isometry3<f64>>,
    /// Mass and first moment (in the world, about its origin) of every node with all that it carries.
    carried: Vec<(f64, Vector3<f64>)>,
}

impl Tree {
    /// The poses of all bodies at `q`.
    ///
    /// # Errors
    /// When `q` has the wrong length or an entry that is not finite.
    pub fn poses(&self, q: &[f64]) -> Result<Poses, Error> {
        self.check(q)?;
        let count = self.nodes.len();
        let mut poses = Poses {
            nodes: Vec::with_capacity(count),
            carried: Vec::with_capacity(count),
        };
        self.poses_into(q, &mut poses);
        Ok(poses)
    }

    /// [`poses`](Self::poses) without checks, and without taking memory for `out` from the same tree.
    ///
    /// # Panics
    /// When `q` is too short.
    pub fn poses_into(&self, q: &[f64], out: &mut Poses) {
        self.node_poses_into(q, &mut out.nodes);
        out.carried.clear();
        let moments = self.nodes.iter().zip(&out.nodes).map(|(node, pose)| {
            let own = pose.rotation * Vector3::from(node.moment);
            (node.mass, own + pose.translation.vector * node.mass)
        });
        out.carried.extend(moments);
        for (i, node) in self.nodes.iter().enumerate().rev() {
            let (mass, moment) = out.carried[i];
            if let Some(parent) = node.parent.and_then(|p| out.carried.get_mut(p)) {
                parent.0 += mass;
                parent.1 += moment;
            }
        }
    }

    /// The pose of a link (its index among [`links`](Self::links)) in the world.
    ///
    /// # Panics
    /// When there is no such link, or `poses` are those of another tree.
    pub fn link_pose_in(&self, poses: &Poses, link: usize) -> Isometry3<f64> {
        let link = &self.links[link];
        match link.body {
            Some(body) => poses.nodes[self.bodies[body].node] * link.pose,
            None => link.pose,
        }
    }

    /// The pose of a link (its index among [`links`](Self::links)) in the world at `q`.
    ///
    /// # Errors
    /// When `q` has the wrong length or an entry that is not finite.
    ///
    /// # Panics
    /// When there is no such link.
    pub fn link_pose(&self, q: &[f64], link: usize) -> Result<Isometry3<f64>, Error> {
        Ok(self.link_pose_in(&self.poses(q)?, link))
    }

    /// J(q), 6 × nv, of the point that stands at `point` in the frame of a link (its index among [`links`](Self::links)): J v is
    /// the velocity of the point (rows 0 to 2, m/s) and the angular velocity of the link (rows 3 to 5, rad/s), both in the world's
    /// axes. A force f and a torque n there make the generalized force Jᵀ (f, n).
    ///
    /// # Errors
    /// When `q` has the wrong length or an entry that is not finite.
    ///
    /// # Panics
    /// When there is no such link.
    pub fn link_jacobian(
        &self,
        q: &[f64],
        link: usize,
        point: [f64; 3],
    ) -> Result<DMatrix<f64>, Error> {
        let mut out = DMatrix::zeros(6, self.nv());
        self.link_jacobian_into(&self.poses(q)?, link, point, &mut out);
        Ok(out)
    }

    /// [`link_jacobian`](Self::link_jacobian) at given poses, without taking memory.
    ///
    /// # Panics
    /// When there is no such link, `poses` are those of another tree, or `out` is not 6 × nv.
    pub fn link_jacobian_into(
        &self,
        poses: &Poses,
        link: usize,
        point: [f64; 3],
        out: &mut DMatrix<f64>,
    ) {
        let at = self.link_pose_in(poses, link) * nalgebra::Point3::from(point);
        out.fill(0.0);
        let mut next = self.links[link].body.map(|b| self.bodies[b].node);
        while let Some(i) = next {
            let (node, pose) = (&self.nodes[i], &poses.nodes[i]);
            let arm = at.coords - pose.translation.vector;
            for (column, motion) in node.unit_motions(pose) {
                let linear = motion.linear + motion.angular.cross(&arm);
                for k in 0..3 {
                    out[(k, column)] += linear[k];
                    out[(k + 3, column)] += motion.angular[k];
                }
            }
            next = node.parent;
        }
    }

    /// Mass of all that moves, kg.
    pub fn mass(&self) -> f64 {
        self.nodes.iter().map(|node| node.mass).sum()
    }

    /// The centre of mass of all that moves, in the world at `q`, m; the origin where nothing has mass.
    ///
    /// # Errors
    /// When `q` has the wrong length or an entry that is not finite.
    pub fn centre_of_mass(&self, q: &[f64]) -> Result<Vector3<f64>, Error> {
        Ok(self.centre_of_mass_in(&self.poses(q)?))
    }

    /// [`centre_of_mass`](Self::centre_of_mass) at given poses.
    pub fn centre_of_mass_in(&self, poses: &Poses) -> Vector3<f64> {
        let on_base = self.nodes.iter().zip(&poses.carried);
        let moment: Vector3<f64> = on_base
            .filter(|(node, _)| node.parent.is_none())
            .map(|(_, (_, moment))| moment)
            .sum();
        moment * self.per_mass()
    }

    /// J(q), 3 × nv: J v is the velocity of the centre of mass in the world, m/s.
    ///
    /// # Errors
    /// When `q` has the wrong length or an entry that is not finite.
    pub fn centre_of_mass_jacobian(&self, q: &[f64]) -> Result<DMatrix<f64>, Error> {
        let mut out = DMatrix::zeros(3, self.nv());
        self.centre_of_mass_jacobian_into(&self.poses(q)?, &mut out);
        Ok(out)
    }

    /// [`centre_of_mass_jacobian`](Self::centre_of_mass_jacobian) at given poses, without taking memory.
    ///
    /// # Panics
    /// When `poses` are those of another tree, or `out` is not 3 × nv.
    pub fn centre_of_mass_jacobian_into(&self, poses: &Poses, out: &mut DMatrix<f64>) {
        out.fill(0.0);
        let share = self.per_mass();
        for ((node, pose), (mass, moment)) in
            self.nodes.iter().zip(&poses.nodes).zip(&poses.carried)
        {
            // Σ m (linear + angular × arm) over all that the joint moves.
            let arms = moment - pose.translation.vector * *mass;
            for (column, motion) in node.unit_motions(pose) {
                let along = (motion.linear * *mass + motion.angular.cross(&arms)) * share;
                for k in 0..3 {
                    out[(k, column)] += along[k];
                }
            }
        }
    }

    /// 1/mass, or 0 where there is none.
    fn per_mass(&self) -> f64 {
        let mass = self.mass();
        if mass > 0.0 { 1.0 / mass } else { 0.0 }
    }
}

/// A motion in the world's axes, linear at the origin of the moved frame.
struct UnitMotion {
    linear: Vector3<f64>,
    angular: Vector3<f64>,
}

impl Node {
    /// The motions that unit velocities make of this frame, which stands at `pose`, with their indices in v.
    fn unit_motions(&self, pose: &Isometry3<f64>) -> impl Iterator<Item = (usize, UnitMotion)> {
        let (turn, freedom, first) = (pose.rotation, self.freedom, self.v);
        let ratio = self.follow.map_or(1.0, |(ratio, _)| ratio);
        (0..freedom.dof()).map(move |k| {
            let axis = match freedom {
                Freedom::Free => Vector3::ith(k % 3, 1.0),
                Freedom::Turn | Freedom::Slide => Vector3::z() * ratio,
            };
            let turns = match freedom {
                Freedom::Turn => true,
                Freedom::Slide => false,
                Freedom::Free => k >= 3,
            };
            let (axis, none) = (turn * axis, Vector3::zeros());
            let (linear, angular) = if turns { (none, axis) } else { (axis, none) };
            (first + k, UnitMotion { linear, angular })
        })
    }
}
