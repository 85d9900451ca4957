//! Energies, and functions of other kinds, recorded as an expression graph, differentiated there, and run as a short program.
//!
//! Energies are generic over the scalar; run once on [`Traced`](traced::Traced) they write down what they compute. The graph
//! folds constants and shares common subexpressions, so that what a general kinematic recursion multiplies by zero or one is gone,
//! and symbolic differentiation gives M, the bias force and the derivatives of the inverse dynamics as straight-line programs. For
//! small mechanisms these are many times faster than dual numbers; for large ones, and for energies that branch on their
//! arguments, there is no program and the dual numbers do the work. Tests hold both routes together.

mod compiled;
mod derivative;
mod formulas;
mod graph;
mod program;
mod recorded;
mod traced;

pub(crate) use compiled::{
    Arguments, Compiled, LaneRegisters, Quantity, Registers, mass_depends_on_velocity,
};
pub use formulas::{Formulas, FormulasError, Style, Written};
pub(crate) use graph::{Graph, Id, Node};
pub(crate) use program::Program;
pub use recorded::{Recorded, RecordedMemory};
pub use traced::Traced;
