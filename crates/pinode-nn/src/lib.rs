//! Missing physics.
pub mod effect;
