//! From energies to equations of motion, M(q) v̇ + C(q, v) v + G(q) = Q, by two routes.
//!
//! [`reference`](mod@reference) takes the Hessian of L over (q, v) by second-order dual numbers and is right for any L; G, the
//! bias force and the inverse dynamics of the fast route are Euler–Lagrange with fewer evaluations, and right for any L as well.
//! Its M is polarised and its C is Christoffel's, which both need that T is quadratic in v. The derivatives of the inverse
//! dynamics come from third-order dual numbers. Tests hold the two routes together.
//!
//! [`Mechanics`](crate::Mechanics) is the way in; it takes the fast route where T is quadratic.

pub mod adjoint;
pub(crate) mod cholesky;
pub(crate) mod coriolis;
pub(crate) mod derivatives;
pub(crate) mod eight;
pub(crate) mod fast;
pub(crate) mod gradient;
pub(crate) mod linear;
pub(crate) mod one_by_one;
pub(crate) mod power;
pub mod reference;
mod workspace;

pub use linear::Linear;
pub use power::PowerBalance;
pub use workspace::Workspace;
