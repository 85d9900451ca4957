//! What can go wrong in the program.

use pinode_nn::cli::Output;

use crate::config::ConfigError;
use crate::rig;

/// An error of the program `cartpole`.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// `--effect` names nothing that the rig can hide.
    #[error("{0}")]
    NoSuchEffect(String),
    /// The settings of the rig.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The rig.
    #[error(transparent)]
    Rig(#[from] rig::Error),
    /// The paper's experiment.
    #[error(transparent)]
    Paper(#[from] crate::paper::Error),
    /// The diagnosis, or a file of it.
    #[error(transparent)]
    Diagnosis(#[from] pinode_nn::Error),
}

impl Error {
    /// Writes it to stderr; of a faulty text all faults.
    pub(super) fn tell(&self, output: &Output) {
        match self {
            Error::Diagnosis(error) | Error::Paper(crate::paper::Error::Model(error)) => {
                output.error(error);
            }
            Error::Config(ConfigError::Problems(problems))
            | Error::Rig(rig::Error::Urdf(problems)) => output.problems(problems),
            other => output.failure(other),
        }
    }
}
