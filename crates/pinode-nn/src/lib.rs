//! Missing physics.
pub mod diagnose;
pub mod effect;
pub mod hybrid;
pub mod log;
pub mod model;
pub mod shooting;

mod disk;
mod error;
mod naming;

pub use error::Error;
