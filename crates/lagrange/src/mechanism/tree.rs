//! A kinematic tree and its energies.

use std::ops::Range;

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::node::Node;
use super::{Inertial, Joint};
use crate::{Coordinate, Parameter};

/// A tree of rigid bodies on a fixed base, or on one that floats; immutable.
///
/// Links that fixed joints weld together are one body; what is welded to the world counts for nothing in T and V. The coordinates
/// stand in the order of the joints in the source, whatever the tree's topology.
///
/// The energies are sums over the bodies, with everything in the frame of the body i itself (angular velocity ω, velocity v of
/// the frame's origin, gravity g):
///
/// - T = Σ ½ m v·v + v·(ω × h) + ½ ω·I ω, with h = m c and I about the origin, from the base outward:
///   ω = Rᵀ ω_parent + z q̇ and v = Rᵀ (v_parent + ω_parent × p) for a rotation about z by q,
///   ω = Rᵀ ω_parent and v = Rᵀ (v_parent + ω_parent × p) + z q̇ for a translation along z,
///   ω = Rᵀ ω_parent + ω_joint and v = Rᵀ (v_parent + ω_parent × p) + v_joint for a floating joint;
/// - V = −Σ m g·p_com, zero at the origin of the world.
///
/// Every body's frame is turned once, at construction, so that its joint's axis is z. A planar joint is two translations and a
/// rotation, with nothing between them.
///
/// Where a joint floats, q is longer than v, and v is not q̇: q holds a quaternion, which is taken as it stands and has to be of
/// length 1, and v the velocities in the moved body's axes (see [`Coordinate::floating`]). Derivatives of the energies in q and v
/// do then not make the equations of motion in the way of Lagrange.
///
/// ```
/// # fn main() -> Result<(), lagrange::Problems> {
/// use lagrange::{Lagrangian, urdf};
///
/// let text = r#"<robot name="pendulum">
///   <link name="base"/>
///   <link name="bob"><inertial><origin xyz="0 0 -2"/><mass value="3"/>
///     <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
///   <joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/></joint>
/// </robot>"#;
/// let tree = urdf::read(text, &urdf::Options::default())?.tree;
/// assert_eq!(tree.coordinates()[0].name, "hinge");
/// assert_eq!(tree.kinetic(&[0.3], &[2.0]), 0.5 * 3.0 * (2.0_f64 * 2.0).powi(2));
/// assert!((tree.potential(&[0.3]) + 3.0 * 9.81 * 2.0 * 0.3_f64.cos()).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Tree {
    pub(super) coordinates: Vec<Coordinate>,
    pub(super) bodies: Vec<Body>,
    pub(super) joints: Vec<Joint>,
    pub(super) links: Vec<Link>,
    pub(crate) parameters: Vec<Parameter>,
    pub(super) gravity: [f64; 3],
    /// Parents before children.
    pub(crate) nodes: Vec<Node>,
    /// Children of all nodes, one stretch after the other; those of the world first.
    pub(super) children: Vec<usize>,
    pub(super) base_children: Range<usize>,
}

/// A moving body: one or several links, welded together.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Body {
    /// The link that the body's joint moves; the others are welded to it.
    pub name: String,
    /// All its links, `name` first.
    pub links: Vec<String>,
    /// Index of the body that carries it; none when that is the world.
    pub parent: Option<usize>,
    /// Index of its joint; none for a base that floats.
    pub joint: Option<usize>,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the frame of the link `name`, m.
    pub centre: Vector3<f64>,
    /// Rotational inertia about the centre of mass in the axes of the link `name`, kg·m².
    pub inertia: Matrix3<f64>,
    /// Index of its node; planar joints have two more.
    pub(crate) node: usize,
}

/// A link, and the body that it belongs to.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Link {
    /// Name.
    pub name: String,
    /// Its inertia as the source has it, where it has one.
    pub inertial: Option<Inertial>,
    /// Index of the body; none when it is welded to the world.
    pub body: Option<usize>,
    /// Pose of the link in the body's frame (the world's, where there is no body).
    pub(crate) pose: Isometry3<f64>,
}

impl Tree {
    /// The coordinates, in the order of q and v.
    pub fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }
    /// The moving bodies, parents before children.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }
    /// All joints, fixed ones too, in the order of the source.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }
    /// All links, those welded to the world too, in the order of the source.
    pub fn links(&self) -> &[Link] {
        &self.links
    }
    /// Whether a joint, or the base, floats: q is then longer than v.
    pub fn is_floating(&self) -> bool {
        self.coordinates.iter().any(|c| c.floating)
    }
    /// Length of q.
    pub fn nq(&self) -> usize {
        self.coordinates.iter().map(Coordinate::nq).sum()
    }
    /// Length of v: the degrees of freedom.
    pub fn nv(&self) -> usize {
        self.coordinates.iter().map(Coordinate::nv).sum()
    }
    /// Acceleration of free fall in the world's frame, m/s².
    pub fn gravity(&self) -> [f64; 3] {
        self.gravity
    }
}
