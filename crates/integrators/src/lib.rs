//! Roll-outs of ordinary differential equations ẋ = f(t, x, u), from mechanisms above all.
//!
//! A [`System`] says where its states live (a [`Space`]: numbers that add, or poses that turn) and what its rate is; [`Ode`] makes one of
//! a closure. A [`Method`] steps it: [`Rk4`], [`Heun`], and for [`Mechanical`] systems the symplectic [`SymplecticEuler`],
//! [`StormerVerlet`] and [`Variational`]. [`roll_out`] runs a method over a table of sample times with an input that is held between
//! samples. [`Rk4`] alone is also generic over the scalar ([`Real`]): on dual numbers it carries exact derivatives of the discrete
//! map along.
//!
//! [`gradient`] derives whole roll-outs of [`Differentiable`] systems by [`Rk4`] and [`Heun`], in any space: backwards by
//! [`gradient::Adjoint`], in a fixed budget of memory for any number of steps, and forwards by [`gradient::Sensitivity`].
//! [`gradient::DualOde`] makes a differentiable system of a right-hand side that is written once for plain and dual numbers.
//! [`ensemble`] takes many roll-outs at once, in threads and in lanes of eight, and gradients of many, with the same bits for any number
//! of threads.
//!
//! [`event`] steps mechanisms under dry friction that sticks, stops, backlash and impacts, from one located event to the next.
//!
//! With the feature `adaptive`, the module of that name rolls out by steps that adapt, also where motions are stiff.
//!
//! [`problems`] holds test problems with known solutions.
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
//!
//! The largest error at fifty times for the adaptive methods (feature `adaptive`), where a Jacobian of n directions counts 1 + n/2 evaluations
//! and a factorisation n/3; the work of all problems, and time, are in BENCHMARKS.md:
//!
#![doc = include_str!("../docs/work_precision_adaptive.svg")]

#[cfg(feature = "adaptive")]
pub mod adaptive;
mod differentiable;
pub mod ensemble;
pub mod event;
mod fixed;
pub mod gradient;
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
pub use space::{Flat, PhaseSpace, Product, Rotation, Space};
pub use system::{Ode, System};
