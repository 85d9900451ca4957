//! The tests of this crate in one program, which is built faster than one each; those that count memory are programs of their own.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // helpers of tests

mod counted;
mod systems;

#[cfg(feature = "adaptive")]
mod adaptive;
mod energy;
mod ensemble;
mod events;
mod gradients;
mod orders;
mod problems;
mod rk4;
mod structure;
