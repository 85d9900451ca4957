//! The rig of the paper's experiment (Roehrl et al. 2020, arXiv 2005.14617, section 4), as a virtual one.
//!
//! The paper records 24,271 samples of a cart-pole in eight minutes, of which it tells the statistics (Table 1) and what its authors
//! suspect in it: friction that depends on the direction, an elastic string between motor and cart, a late input. [`PaperRig`] is a rig
//! with all of these, each of which can be changed or taken away, and makes recordings with those statistics; [`table`] has
//! the paper's numbers and takes those of a recording.
//!
//! It is the rig of [`crate::rig`] with other settings ([`crate::config::PaperConfig`]) and another hand: plant, contacts, string, delay, sensors
//! and recording are those. So [`PaperRig::true_run`] is a model of the rig that lacks nothing: what it misses in a recording, no
//! model can be blamed for. [`RigEnvironment`] is the rig at work, for controllers to run on.
//!
//! ```no_run
//! use cartpole::paper::{Friction, StartsAt, PaperRig, table, true_errors};
//!
//! let rig = PaperRig::read("models/cartpole/paper.toml".as_ref())?;
//! let training = rig.record(table::SAMPLES, 1)?;
//! for (ours, theirs) in table::statistics(&training.log).iter().zip(&table::TABLE_1) {
//!     println!("{}: {:.3} ({:.3} in the paper) {}", ours.name, ours.std, theirs.std, ours.unit);
//! }
//! let strong = rig.with_friction(Friction::Strong);
//! let test = strong.record(table::TEST_SAMPLES, 2)?;
//! let errors = true_errors(&strong, &test, (1000, 30), StartsAt::Measured)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
mod contestants;
mod environment;
mod experiment;
pub mod operator;
mod recording;
mod report;
mod rig;
mod rotary;
mod stand;
pub mod table;
mod windows;

pub use contestants::Contestant;
pub use environment::RigEnvironment;
pub use experiment::{Errors, Experiment, Lesson, Outcome, Row, Table};
pub use recording::{Recording, Truth};
pub use report::report;
pub use rig::{Friction, PaperRig, Start};
pub use stand::Known;
pub use windows::{StartsAt, true_errors};

use crate::config::ConfigError;

/// What can go wrong at the paper's rig.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Its settings.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Its motion.
    #[error(transparent)]
    Rig(#[from] crate::rig::Error),
    /// A model, its training or its evaluation.
    #[error(transparent)]
    Model(#[from] pinode_nn::Error),
    /// The rig as an environment.
    #[error(transparent)]
    Environment(#[from] pinode_nn::environment::EnvironmentError),
    /// Settings that have been changed to what no rig has.
    #[error("{key} {message}")]
    Setting {
        /// The dotted key.
        key: String,
        /// What is wrong with it.
        message: String,
    },
    /// A recording that is too short for what is asked of it.
    #[error("the recording has {rows} rows: {needed} are needed at least")]
    Short {
        /// Its length.
        rows: usize,
        /// The least length.
        needed: usize,
    },
}
