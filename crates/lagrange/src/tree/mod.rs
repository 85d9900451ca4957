//! Equations of motion of trees of rigid bodies in O(n) and O(n · depth).
//!
//! All of it is Lagrange's equations, Q_i = ∫ ∂r/∂q_i · (r̈ − g) dm, with the integrals over the mass points taken once: of a rigid body
//! nothing is left of its points but ∫ dm, ∫ r dm and ∫ r rᵀ dm, and of the joint i nothing but the motion S_i that it makes.
//!
//! | file | gives |
//! |---|---|
//! | `inverse_dynamics` | Q and the bias force, body by body in its own axes |
//! | `common` | all bodies in one frame: motions, and sums over all that a joint carries |
//! | `matrices` | M, C, G |
//! | `momentum` | M v in O(n) |
//! | `derivatives` | ∂Q/∂q, ∂Q/∂v |
//! | `gradient` | λᵀ ∂Q/∂x in O(n) |
//! | `regressor` | Y of Q = Y π, and derivatives in mass, centre and inertia |
//! | `factor` | M = Lᵀ D L and M⁻¹ X |
//! | `articulated` | v̇ without M |
//!
//! They are written over [`Scalar`](crate::Scalar); `dispatch` compiles them for the processor at hand, for one state and for eight.

mod articulated;
mod common;
mod derivatives;
mod dispatch;
mod engine;
mod factor;
mod general;
mod gradient;
mod inverse_dynamics;
mod kernels;
mod matrices;
mod momentum;
mod plan;
mod regressor;
mod sink;
mod state;
pub mod vector;

pub use dispatch::Machine;
pub use engine::{Algorithms, Engine};
pub use factor::LEAST_PIVOT;
pub use general::equations;
pub use kernels::At;
pub(crate) use plan::Freedom;
pub use plan::Plan;
pub use regressor::INERTIAL_PARAMETERS;
pub use state::{State, quaternion};
