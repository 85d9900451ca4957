//! Methods of fixed step; `docs/fixed.md` compares them.

mod broyden;
mod chart;
mod heun;
mod method;
mod rk4;
mod roll_out;
mod separable;
mod variational;

pub use heun::Heun;
pub use method::{Method, StepError};
pub use rk4::Rk4;
pub(crate) use roll_out::{OFF_SPACE, check_arguments, check_finite, check_initial};
pub use roll_out::{RollOutError, roll_out};
pub use separable::{NotSeparable, StormerVerlet, SymplecticEuler};
pub use variational::{Order, Variational};
