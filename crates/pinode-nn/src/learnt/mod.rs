//! Learnt forces: networks as a part of Q, what they see of a state, and their files.

mod described;
mod dictionary;
mod feature;
mod force;
mod guard;
mod interval;
pub mod law;
pub mod onnx;
mod region;
mod usual;
pub mod weights;

pub use described::Described;
pub use feature::{Feature, MOST_BACK, Quantity};
pub(crate) use feature::{Seen, Sight, SinCos, chain, see};
pub(crate) use force::{In, Room};
pub use force::{LearntForce, Misfit, Output};
pub(crate) use guard::Tally;
pub use guard::{Departure, Guard, Saw};
pub(crate) use interval::other_intervals;
pub use region::{MARGIN, Outside, Region};
pub(crate) use usual::usual_quantities;
pub use weights::{Card, Names, Stored};
