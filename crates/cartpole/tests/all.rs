//! The tests of the rig, of its program and of the whole workflow in one program, which is built faster than one each.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // helpers of tests

mod environment;
mod joints;
#[path = "../../../tests/missing_physics.rs"]
mod missing_physics;
mod paper;
mod program;
mod rig;
mod rig_effects;
mod rig_sampling;
mod rig_scene;
mod score;
