//! Missing physics.
#[cfg(feature = "cli")]
pub mod cli;
pub mod diagnose;
pub mod effect;
pub mod evaluate;
pub mod free_run;
pub mod hybrid;
pub mod log;
pub mod model;
#[cfg(feature = "cli")]
pub mod report;
pub mod shooting;

mod disk;
mod error;
mod naming;

pub use error::Error;

/// The code in the front page runs.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct FrontPage;
