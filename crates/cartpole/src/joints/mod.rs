//! Virtual rigs of other mechanisms than the cart-pole: any tree of joints that are single numbers, some of them driven.
//!
//! A [`Bench`] is one of them: a Furuta pendulum and an arm with seven joints. As on the rig of the cart-pole, the truth shares with the
//! fitting side only M, C and G: the effects are those of [`crate::rig::effects`], dry friction really sticks, and the steps
//! end where a joint starts or stops sliding. A controller drives the joints along sums of sines, and what it asks for is in the log.
//!
//! ```no_run
//! use cartpole::config::NoiseLevel;
//! use cartpole::joints::{Bench, Fault};
//!
//! let bench = Bench::furuta("models".as_ref())?;
//! let faults = [bench.draw(0, 7)?];
//! bench.run(&faults, NoiseLevel::Low, 20.0, 7)?.write_csv("log.csv".as_ref())?;
//! bench.known_model(&faults, "user".as_ref())?;
//! # Ok::<(), cartpole::rig::Error>(())
//! ```
mod bench;
mod fault;
mod model;
mod motion;
mod recording;

pub use bench::Bench;
pub(crate) use bench::INTERVAL;
pub use fault::{Fault, KINDS};
pub use recording::Recording;
