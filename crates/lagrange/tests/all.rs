//! All tests of this crate's public face in one program, which is built faster than one each; `no_allocation` counts for itself.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // helpers of tests

#[path = "../../../tests/common/mod.rs"]
mod common;
mod rows;

#[path = "../../../tests/bad_urdf.rs"]
mod bad_urdf;
#[path = "../../../tests/closed_forms_and_oracles.rs"]
mod closed_forms_and_oracles;
mod constraints;
#[path = "../../../tests/eight_states.rs"]
mod eight_states;
#[path = "../../../tests/energy_conservation.rs"]
mod energy_conservation;
mod equations;
mod expression;
mod formulas;
mod linkages;
#[path = "../../../tests/random_mechanisms.rs"]
mod random_mechanisms;
mod several_coordinates;
mod text_lagrangian;
#[path = "../../../tests/tree_algorithms.rs"]
mod tree_algorithms;
mod written_urdf;
