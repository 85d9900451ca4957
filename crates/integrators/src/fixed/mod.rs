//! Methods of fixed step.

mod rk4;
mod roll_out;

pub use rk4::Rk4;
pub use roll_out::{RollOutError, roll_out};
