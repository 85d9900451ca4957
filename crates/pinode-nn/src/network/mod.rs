//! A small multi-layer perceptron: many states at once, forward and in reverse, in f32 or f64.
//!
//! Layer l maps y_{l−1} to y_l = φ_l(W_l y_{l−1} + b_l); y_0 is the input. A [`Mlp`] holds the numbers, a [`Tape`] the values of every
//! layer for some evaluations ("slots", such as the stages of a Runge-Kutta step) of many states ("columns") each:
//!
//! 1. [`Mlp::forward`] evaluates one slot: [`Tape::input_mut`] to [`Tape::output`].
//! 2. [`Mlp::backward`] takes adjoints of the outputs, [`Tape::seed_mut`], to those of the inputs, [`Tape::input_gradient`].
//! 3. [`Mlp::add_gradient`] adds the gradient in the parameters, over columns and slots.
//!
//! The lanes of a vector register are states. A *row* is one number of [`PANEL`] states, a *panel* the rows of a layer for those states,
//! one after another; a slot of a layer is its panels. So the same source is compiled for every instruction set, and that of the
//! processor at hand is chosen when a tape is made. On one processor the same numbers give the same bits.

mod adjoint;
mod gradient;
mod kernel;
mod mlp;
mod real;
mod shape;
mod single;
mod tanh;
mod tape;
#[cfg(test)]
mod tests;

pub use mlp::Mlp;
pub use real::Real;
pub use shape::{Activation, Layer, Shape, ShapeError};
pub use single::Single;
pub use tanh::tanh;
pub use tape::{GROUP, PANEL, Tape};
