//! Roll-outs of ordinary differential equations ẋ = f(t, x, u), from mechanisms above all.
//!
//! A [`System`] says where its states live (a [`Space`]: numbers that add, or poses that turn) and what its rate is; [`Ode`] makes one of
//! a closure. A [`Method`] steps it: [`Rk4`], [`Heun`], and for [`Mechanical`] systems the symplectic [`SymplecticEuler`],
//! [`StormerVerlet`] and [`Variational`]. [`roll_out`] runs a method over a table of sample times with an input that is held between
//! samples. [`Rk4`] alone is also generic over the scalar ([`Real`]): on dual numbers it carries exact derivatives of the discrete
//! map along. [`problems`] holds test problems with known solutions.
//!
#![doc = include_str!("../docs/fixed.md")]
//!
//! Largest relative error of the energy between one point and the next (`examples/energy.rs`):
//!
#![doc = include_str!("../docs/energy.svg")]
//!
//! Error at the end against evaluations of the rate, the acceleration or the variational iteration (`examples/work_precision.rs`):
//!
#![doc = include_str!("../docs/work_precision_fixed.svg")]

mod differentiable;
mod fixed;
mod mechanical;
pub mod problems;
mod real;
mod space;
mod system;

pub use differentiable::{Differentiable, Gradient, Jacobian};
pub use fixed::{
    Heun, Method, NotSeparable, Order, Rk4, RollOutError, StepError, StormerVerlet,
    SymplecticEuler, Variational, roll_out,
};
pub use mechanical::Mechanical;
pub use real::Real;
pub use space::{Flat, PhaseSpace, Rotation, Space};
pub use system::{Ode, System};
