#![doc = "Equations of motion from energies, by dual numbers."]
mod dynamics;
pub mod equations;
mod error;
mod expression;
mod lagrangian;
pub mod mechanism;
mod scalar;
pub mod urdf;
mod text;

pub use dynamics::{Dynamics, Mechanics};
pub use equations::Workspace;
pub use equations::derivatives::InverseDynamicsDerivatives;
pub use error::{Error, Position, Problem, Problems};
pub use expression::{Expression, ExpressionError, caret};
pub use lagrangian::{Coordinate, Lagrangian, Parameter, Role};
pub use scalar::Scalar;
pub use text::{Field, TextLagrangian, TextProblem, TextSource};
