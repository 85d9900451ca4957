//! Roll-outs of ordinary differential equations ẋ = f(t, x).
//!
//! [`Rk4`] is the classical Runge-Kutta method, generic over the scalar ([`Real`]): on `f64` it simulates, on dual numbers it
//! carries exact derivatives of the discrete map along. [`roll_out`] runs it over a table of sample times with an input that is
//! held between samples. [`problems`] holds test problems with known solutions.
mod fixed;
pub mod problems;
mod real;

pub use fixed::{Rk4, RollOutError, roll_out};
pub use real::Real;
