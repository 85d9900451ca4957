//! Missing physics.
