//! What an integrator asks of a number.

use std::ops::{Add, Mul};

/// A number that states are made of: it adds, and a plain factor scales it.
///
/// Every type with these operations has it, among them `f64` and all of `num-dual`'s numbers of fixed size, also nested.
pub trait Real: Copy + Add<Output = Self> + Mul<f64, Output = Self> + From<f64> + 'static {
    /// Zero, with no derivative.
    fn zero() -> Self {
        Self::from(0.0)
    }
}

impl<T: Copy + Add<Output = T> + Mul<f64, Output = T> + From<f64> + 'static> Real for T {}
