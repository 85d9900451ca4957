//! From energies to equations of motion, M(q) v̇ + C(q, v) v + G(q) = Q, by two routes.
//!
//! [`reference`](mod@reference) takes the Hessian of L over (q, v) by second-order dual numbers and is right for any L. The fast
//! route, in [`fast`] and [`coriolis`], uses that T is quadratic in v. Tests hold the two together. [`derivatives`] gives the
//! derivatives of the inverse dynamics, by third-order dual numbers.

pub(crate) mod coriolis;
pub(crate) mod derivatives;
pub(crate) mod fast;
pub mod reference;
mod workspace;

pub use workspace::Workspace;
