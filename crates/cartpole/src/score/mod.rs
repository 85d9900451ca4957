//! How well the diagnosis does on logs of which the truth is known: the bench of the missing-physics workflow.
//!
//! A [`Case`] is a log that can be made again from its rig, its [`Set`], its noise and its seed. [`run`] makes the log, shows it and the
//! user's model to the diagnosis, and writes down truth and answer as one [`Line`] of JSON. [`tables`] makes the tables of many lines.
//! The truth reaches the diagnosis in no other way than through the log.
mod case;
mod judge;
mod line;
mod run;
mod statistics;
mod table;

pub use case::{Case, Kinds, NOISES, Rig, Set};
pub use line::{FreeRun, Line, Name, Named, Truth};
pub use run::{Error, run};
pub use table::tables;
