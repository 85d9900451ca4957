//! What can go wrong in this crate.

use std::path::{Path, PathBuf};

use lagrange::Problems;

/// An error of models, logs and what is done with them.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A model, log or list of states has faults: all of them, with their places.
    #[error("{0}")]
    Problems(Problems),
    /// The equations of motion failed.
    #[error("{0}")]
    Mechanics(lagrange::Error),
    /// A model would replace the file it was read from.
    #[error("{} is the model that was read: write the revised one to another folder or under another name", path.display())]
    OverwritesInput {
        /// The file.
        path: PathBuf,
    },
    /// A revision does not fit the model it revises.
    #[error("the revision gives {found} {what}, the model has {expected}")]
    Revision {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
}

impl Error {
    /// An I/O error at `path`.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Error::Io {
            path: path.to_owned(),
            source,
        }
    }
}

impl From<Problems> for Error {
    fn from(problems: Problems) -> Self {
        Error::Problems(problems)
    }
}

impl From<lagrange::Error> for Error {
    fn from(error: lagrange::Error) -> Self {
        Error::Mechanics(error)
    }
}
