//! The truth behind a log, for the scorer alone.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::recording::write_whole;
use super::{Error, Hidden};
use crate::config::{Config, Known, NoiseLevel};

/// What a log was made of. Never given to the diagnosis.
///
/// `known` friction is what the rig has unless the hidden effect takes its place: a hidden `viscous_friction` or
/// `coulomb_friction` that of its joint, `asymmetric_viscous_friction` the viscous friction of its joint, `asymmetric_coulomb_friction`,
/// `stribeck_friction`, `position_dependent_friction`, `dahl_friction` and `lugre_friction` the Coulomb friction of theirs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// Seed of the operator and the noise.
    pub seed: u64,
    /// Sensors and disturbances.
    pub noise: NoiseLevel,
    /// The known friction.
    pub known: Known,
    /// The hidden effect.
    pub hidden: Hidden,
}

impl Key {
    /// The key of [`super::run`] with these arguments.
    pub fn new(config: &Config, hidden: &Hidden, seed: u64) -> Self {
        Key {
            seed,
            noise: config.noise,
            known: config.known,
            hidden: *hidden,
        }
    }

    /// Writes it as JSON; whole or not at all.
    pub fn write_json(&self, path: &Path) -> Result<(), Error> {
        let bytes = serde_json::to_vec_pretty(self)
            .map_err(|e| Error::io(path)(std::io::Error::other(e)))?;
        write_whole(path, &bytes)
    }

    /// Reads it back.
    pub fn read_json(path: &Path) -> Result<Self, Error> {
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        serde_json::from_slice(&bytes).map_err(|e| Error::io(path)(std::io::Error::other(e)))
    }
}
