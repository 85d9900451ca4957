//! What a mechanism is to this crate: its energies.

use crate::Scalar;
use crate::mechanism::Tree;

/// A mechanism, given by its energies T(q, v) and V(q).
///
/// L = T − V, and its equations of motion are d/dt(∂L/∂v) − ∂L/∂q = Q, that is M(q) v̇ + C(q, v) v + G(q) = Q.
///
/// T and V are functions of q and v alone, and give the same for the same: they are recorded once, when the mechanism is made, and what else they read, as a time or a state of
/// their own, stays as it was then. What changes meanwhile is a force in Q. They read as many entries of q and v as [`dof`](Self::dof) says.
///
/// ```
/// use lagrange::{Lagrangian, Scalar};
///
/// /// A point mass on a massless rod; q = angle from hanging, rad.
/// struct Pendulum { mass: f64, length: f64 }
///
/// impl Lagrangian for Pendulum {
///     fn dof(&self) -> usize { 1 }
///     fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D {
///         v[0] * v[0] * (0.5 * self.mass * self.length * self.length)
///     }
///     fn potential<D: Scalar>(&self, q: &[D]) -> D {
///         q[0].cos() * (-9.81 * self.mass * self.length)
///     }
/// }
/// ```
pub trait Lagrangian: Send + Sync {
    /// Number of coordinates: the length of q and of v.
    fn dof(&self) -> usize;

    /// Kinetic energy T(q, v), J.
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D;

    /// Potential energy V(q), J.
    fn potential<D: Scalar>(&self, q: &[D]) -> D;

    /// The physical constants that a fit may move; none unless the mechanism says so.
    fn parameters(&self) -> &[Parameter] {
        &[]
    }

    /// The mechanism as a tree of rigid bodies, where it is one: its equations are then found joint by joint instead of from T and V
    /// as a whole.
    fn rigid_bodies(&self) -> Option<&Tree> {
        None
    }

    /// T with the constants `p` in place of the nominal ones; `p` is as long as [`parameters`](Self::parameters).
    fn kinetic_with<D: Scalar>(&self, q: &[D], v: &[D], _p: &[D]) -> D {
        self.kinetic(q, v)
    }

    /// V with the constants `p` in place of the nominal ones.
    fn potential_with<D: Scalar>(&self, q: &[D], _p: &[D]) -> D {
        self.potential(q)
    }
}

/// A physical constant of a mechanism.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// What the constant is.
    pub role: Role,
    /// Its name: the link for a mass scale, else the constant's own name.
    pub name: String,
    /// The value it has in the model.
    pub nominal: f64,
}

/// What a [`Parameter`] stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Role {
    /// A factor on the mass and the inertia of one body (nominal 1); its centre of mass stays.
    MassScale,
    /// A constant named in the energies.
    Constant,
}

/// One coordinate of a mechanism, or the pose of one floating joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Coordinate {
    /// Name in outputs and logs.
    pub name: String,
    /// The joint it belongs to; the coordinate itself where there are no joints.
    pub joint: String,
    /// Whether it is an angle (rad) rather than a displacement (m).
    pub angular: bool,
    /// Whether it wraps: errors are taken on the circle.
    pub wraps: bool,
    /// Whether it is the pose of a floating joint: in q seven numbers, position (m) and unit quaternion w x y z; in v six, linear
    /// (m/s) and angular (rad/s) velocity in the axes of the moved body.
    pub floating: bool,
}

impl Coordinate {
    /// Entries in q: 1, or 7 for a pose.
    pub fn nq(&self) -> usize {
        if self.floating { 7 } else { 1 }
    }
    /// Entries in v: 1, or 6 for a pose.
    pub fn nv(&self) -> usize {
        if self.floating { 6 } else { 1 }
    }
    /// SI unit of the coordinate: `rad` or `m`; `m, 1` for a pose.
    pub fn unit(&self) -> &'static str {
        match (self.floating, self.angular) {
            (true, _) => "m, 1",
            (_, true) => "rad",
            (_, false) => "m",
        }
    }
    /// SI unit of the generalized force along it: `N·m` or `N`; `N, N·m` for a pose.
    pub fn force_unit(&self) -> &'static str {
        match (self.floating, self.angular) {
            (true, _) => "N, N·m",
            (_, true) => "N·m",
            (_, false) => "N",
        }
    }
}
