#![doc = "Equations of motion from energies, by dual numbers."]
mod error;
mod lagrangian;
mod scalar;

pub use error::{Error, Position, Problem, Problems};
pub use lagrangian::{Coordinate, Lagrangian, Parameter, Role};
pub use scalar::Scalar;
