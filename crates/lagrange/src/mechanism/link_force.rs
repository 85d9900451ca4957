//! Forces and torques that turn with a link.

use super::Tree;
use super::node::{Freedom, Node, Turn, add, cross, pose_at};
use super::poses::rotate;
use crate::lanes::Lanes;
use crate::{LANES, Scalar};

/// A force and a torque that are fixed in a link, as those of a propeller on it: their generalized force
///
/// b(q) = Jᵀ (R f, R n)
///
/// with the Jacobian J of the point where f acts and the rotation R of the link, [`link_jacobian`](Tree::link_jacobian) and
/// [`link_pose`](Tree::link_pose). It has no potential.
///
/// From the link inward, force and moment about a frame's origin give a joint that turns n_z, one that slides f_z, one that floats all six, and go
/// into the next frame as R f and R n + p × R f. What moves along entry k of v turns and shifts them for the joints further in, by
/// S_k ×* (f, n): (e × f, e × n) about an axis e, (0, e × f) along it. The joints further out are carried along and feel nothing: ∂b_i/∂q_k = 0 for k
/// nearer to the root than i.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use lagrange::urdf;
///
/// let text = r#"<robot name="r"><link name="floor"/>
///   <link name="boat"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
///   <joint name="sea" type="planar"><parent link="floor"/><child link="boat"/><axis xyz="0 0 1"/></joint>
/// </robot>"#;
/// let tree = urdf::read(text, &urdf::Options::default())?.tree;
/// // A screw half a metre to starboard that pushes ahead; the boat has turned by a quarter.
/// let screw = tree.link_force(1, [0.0, -0.5, 0.0], [1.0, 0.0, 0.0], [0.0; 3]).ok_or("the boat moves")?;
/// let b = screw.generalized(&[3.0, 4.0, std::f64::consts::FRAC_PI_2]);
/// assert!(b[0].abs() < 1e-15 && (b[1] - 1.0).abs() < 1e-15 && (b[2] - 0.5).abs() < 1e-15);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct LinkForce {
    /// From the link inward.
    nodes: Vec<Node>,
    /// In the axes of the first of them and about its origin.
    wrench: Wrench<f64>,
    /// Length of v.
    nv: usize,
}

/// A force, N, and a moment, N·m, about a frame's origin in its axes.
#[derive(Debug, Clone, Copy)]
struct Wrench<D> {
    force: [D; 3],
    moment: [D; 3],
}

/// Scratch memory for the derivatives of a [`LinkForce`].
#[derive(Debug, Clone, Default)]
pub struct LinkForceMemory {
    one: Vec<(usize, Wrench<f64>)>,
    eight: Vec<(usize, Wrench<Lanes<false>>)>,
}

/// An entry of b, or of its derivative in the displacement along an entry of v.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkForceEntry {
    /// b_i.
    Value(usize),
    /// ∂b_i/∂q_k, i first.
    ByPosition(usize, usize),
}

impl Tree {
    /// The force `force`, N, on the point that stands at `point`, m, in the frame of a link (its index among [`links`](Self::links)), and the torque
    /// `torque`, N·m, on the link, both in its axes. `None` where the link is welded to the world, or there is none.
    pub fn link_force(
        &self,
        link: usize,
        point: [f64; 3],
        force: [f64; 3],
        torque: [f64; 3],
    ) -> Option<LinkForce> {
        let link = self.links.get(link)?;
        let mut next = Some(self.bodies.get(link.body?)?.node);
        let mut nodes = Vec::new();
        while let Some(i) = next {
            let node = self.nodes.get(i)?;
            next = node.parent;
            nodes.push(node.clone());
        }
        let at = (link.pose * nalgebra::Point3::from(point)).coords.into();
        let force: [f64; 3] = (link.pose.rotation * nalgebra::Vector3::from(force)).into();
        let torque: [f64; 3] = (link.pose.rotation * nalgebra::Vector3::from(torque)).into();
        let moment = add(&torque, &cross(&at, &force));
        Some(LinkForce {
            nodes,
            wrench: Wrench { force, moment },
            nv: self.nv(),
        })
    }
}

impl LinkForce {
    /// Whether force and moment about the link's origin are numbers: a far point makes of a large force a moment that is none.
    pub fn is_finite(&self) -> bool {
        let Wrench { force, moment } = &self.wrench;
        force.iter().chain(moment).all(|x| x.is_finite())
    }

    /// Whether it moves an entry of v in some position.
    pub fn moves(&self, v: usize) -> bool {
        let own = |node: &Node| (node.v..node.v + node.freedom.dof()).contains(&v);
        self.nodes.iter().any(own)
    }

    /// b(q), nv entries.
    ///
    /// # Panics
    /// When `q` is too short.
    pub fn generalized(&self, q: &[f64]) -> Vec<f64> {
        let mut b = vec![0.0; self.nv];
        self.each(q, |i, part| b[i] += part);
        b
    }

    /// Gives `add` the parts of b(q), with the entry that each belongs to, to be summed.
    ///
    /// # Panics
    /// When `q` is too short.
    pub fn each<D: Scalar>(&self, q: &[D], add: impl FnMut(usize, D)) {
        self.pass(|node| Passage::of(node, &q[node.q..]), add);
    }

    /// [`each`](Self::each) in eight positions: lane k of every entry is position k.
    ///
    /// # Panics
    /// When `q` is too short.
    pub fn each_of_eight(&self, q: &[[f64; LANES]], mut add: impl FnMut(usize, &[f64; LANES])) {
        let passage = |node: &Node| Passage::of_eight(node, q);
        self.pass(passage, |i, part| add(i, &part.0));
    }

    fn pass<D: Scalar>(
        &self,
        passage: impl Fn(&Node) -> Passage<D>,
        mut add: impl FnMut(usize, D),
    ) {
        let mut wrench = self.wrench.on::<D>();
        for node in &self.nodes {
            wrench.along(node, &mut add);
            wrench = passage(node).inward(node, &wrench);
        }
    }

    /// Gives `add` the parts of b(q) and of its derivatives.
    ///
    /// # Panics
    /// When `q` is too short.
    pub fn each_derivative(
        &self,
        q: &[f64],
        memory: &mut LinkForceMemory,
        add: impl FnMut(LinkForceEntry, f64),
    ) {
        self.walk(|node| Passage::of(node, &q[node.q..]), &mut memory.one, add);
    }

    /// [`each_derivative`](Self::each_derivative) in eight positions.
    ///
    /// # Panics
    /// When `q` is too short.
    pub fn each_derivative_of_eight(
        &self,
        q: &[[f64; LANES]],
        memory: &mut LinkForceMemory,
        mut add: impl FnMut(LinkForceEntry, &[f64; LANES]),
    ) {
        let passage = |node: &Node| Passage::of_eight(node, q);
        self.walk(passage, &mut memory.eight, |entry, part| {
            add(entry, &part.0);
        });
    }

    fn walk<D: Scalar>(
        &self,
        passage: impl Fn(&Node) -> Passage<D>,
        by: &mut Vec<(usize, Wrench<D>)>,
        mut add: impl FnMut(LinkForceEntry, D),
    ) {
        let mut wrench = self.wrench.on::<D>();
        // ∂(f, n)/∂q_k of the joints that were passed.
        by.clear();
        for node in &self.nodes {
            wrench.along(node, &mut |i, part| add(LinkForceEntry::Value(i), part));
            for (k, derivative) in &*by {
                derivative.along(node, &mut |i, part| {
                    add(LinkForceEntry::ByPosition(i, *k), part);
                });
            }
            for (k, moved) in wrench.moved_by(node) {
                by.push((k, moved));
            }
            let passage = passage(node);
            for (_, derivative) in by.iter_mut() {
                *derivative = passage.inward(node, derivative);
            }
            wrench = passage.inward(node, &wrench);
        }
    }
}

impl Wrench<f64> {
    fn on<D: Scalar>(&self) -> Wrench<D> {
        Wrench {
            force: self.force.map(D::constant),
            moment: self.moment.map(D::constant),
        }
    }
}

impl<D: Scalar> Wrench<D> {
    /// What the joint of `node` feels of it, in the moved frame.
    fn along(&self, node: &Node, add: &mut impl FnMut(usize, D)) {
        let one = |x: D| match node.follow {
            None => x,
            Some((ratio, _)) => x * ratio,
        };
        match node.freedom {
            Freedom::Turn => add(node.v, one(self.moment[2])),
            Freedom::Slide => add(node.v, one(self.force[2])),
            Freedom::Free => {
                let all = self.force.iter().chain(&self.moment);
                all.enumerate().for_each(|(k, &x)| add(node.v + k, x));
            }
        }
    }

    /// S_k ×* of it for the entries k of v of `node`, in the moved frame.
    fn moved_by(&self, node: &Node) -> impl Iterator<Item = (usize, Self)> + use<D> {
        let (Wrench { force, moment }, first) = (*self, node.v);
        let ratio = node.follow.map_or(1.0, |(ratio, _)| ratio);
        let directions = match node.freedom {
            Freedom::Slide => 2..3,
            Freedom::Turn => 5..6,
            Freedom::Free => 0..6,
        };
        let about = move |k: usize, x: &[D; 3]| {
            let mut axis = [0.0; 3];
            axis[k % 3] = -ratio;
            cross(x, &axis)
        };
        directions.enumerate().map(move |(i, k)| {
            let moved = match k {
                0..3 => Wrench {
                    force: [D::zero(); 3],
                    moment: about(k, &force),
                },
                _ => Wrench {
                    force: about(k, &force),
                    moment: about(k, &moment),
                },
            };
            (first + i, moved)
        })
    }

    /// From the frame of `node` at joint position 0 into that of its parent.
    fn in_parent(&self, node: &Node) -> Self {
        let force = rotate(&node.rotation, &self.force);
        let mut moment = rotate(&node.rotation, &self.moment);
        if let Some(p) = node.translation {
            let [x, y, z] = force;
            let arm = [
                z * p[1] - y * p[2],
                x * p[2] - z * p[0],
                y * p[0] - x * p[1],
            ];
            moment = add(&moment, &arm);
        }
        Wrench { force, moment }
    }
}

/// Where a joint stands.
#[derive(Clone, Copy)]
enum Passage<D> {
    /// Sine and cosine.
    Turn(D, D),
    /// Position.
    Slide(D),
    /// Position and rotation.
    Free([D; 3], Turn<D>),
}

impl<D: Scalar> Passage<D> {
    /// From the entries of q that are its own, and what follows them.
    fn of(node: &Node, own: &[D]) -> Self {
        match node.freedom {
            Freedom::Turn => {
                let (sin, cos) = node.position_at(own[0]).sin_cos();
                Passage::Turn(sin, cos)
            }
            Freedom::Slide => Passage::Slide(node.position_at(own[0])),
            Freedom::Free => {
                let (p, turn) = pose_at(own);
                Passage::Free(p, turn)
            }
        }
    }

    /// From the moved frame of `node` into that of its parent.
    fn inward(&self, node: &Node, wrench: &Wrench<D>) -> Wrench<D> {
        let Wrench { force, moment } = *wrench;
        let at_zero = match self {
            Passage::Turn(sin, cos) => {
                let turn = |[x, y, z]: [D; 3]| [*cos * x - *sin * y, *sin * x + *cos * y, z];
                Wrench {
                    force: turn(force),
                    moment: turn(moment),
                }
            }
            Passage::Slide(d) => Wrench {
                force,
                moment: [
                    moment[0] - *d * force[1],
                    moment[1] + *d * force[0],
                    moment[2],
                ],
            },
            Passage::Free(p, turn) => {
                let force = turn.turn(&force);
                let moment = add(&turn.turn(&moment), &cross(p, &force));
                Wrench { force, moment }
            }
        };
        at_zero.in_parent(node)
    }
}

impl Passage<Lanes<false>> {
    fn of_eight(node: &Node, q: &[[f64; LANES]]) -> Self {
        let mut own = [Lanes([0.0; LANES]); 7];
        for (own, q) in own.iter_mut().zip(&q[node.q..]) {
            *own = Lanes(*q);
        }
        Passage::of(node, &own)
    }
}
