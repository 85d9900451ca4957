//! What can go wrong on the rig.

use std::convert::Infallible;
use std::path::{Path, PathBuf};

use integrators::event::ContactError;

/// An error of the rig.
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
    /// The mechanism is not a cart with a pole.
    #[error("{}: the coordinates are {found:?}; the rig needs `slider` then `pole`", path.display())]
    NotACartPole {
        /// The URDF.
        path: PathBuf,
        /// Its coordinates.
        found: Vec<String>,
    },
    /// The mechanism has other joints than the rig drives.
    #[error("{}: the coordinates are {found:?}; the rig needs {expected:?}", path.display())]
    OtherJoints {
        /// The URDF.
        path: PathBuf,
        /// Its coordinates.
        found: Vec<String>,
        /// Those of the rig.
        expected: Vec<String>,
    },
    /// The URDF has faults.
    #[error("{0}")]
    Urdf(lagrange::Problems),
    /// Factors on the masses that no mechanism has.
    #[error(
        "{scales:?} are no factors on the masses: give {expected} of them, each finite and above 0"
    )]
    Masses {
        /// The factors.
        scales: Vec<f64>,
        /// How many bodies the mechanism has.
        expected: usize,
    },
    /// Two effects that cannot be on the rig at once.
    #[error("{first} and {second} are the same thing of the rig: hide one of them")]
    SamePlace {
        /// One effect.
        first: String,
        /// The other.
        second: String,
    },
    /// The equations of motion have no solution.
    #[error("at t = {time} s: {source}")]
    Mechanics {
        /// When, s.
        time: f64,
        /// Why.
        source: lagrange::Error,
    },
    /// A joint sticks and slides by turns so often within one step that the motion is not that of the rig any more.
    #[error(
        "at t = {time} s a joint changes between rest and sliding again and again within one step: a force beside its friction is too stiff for the step; take a smaller truth_step"
    )]
    Chatter {
        /// s.
        time: f64,
    },
    /// The motion has no solution.
    #[error("{0}")]
    Motion(ContactError<Infallible>),
    /// An effect that the rig cannot have.
    #[error("{kind} on {target}: {reason}")]
    Effect {
        /// Its kind.
        kind: &'static str,
        /// What it sits on.
        target: &'static str,
        /// Why not, and what to do.
        reason: String,
    },
    /// The user's model cannot be written for this draw.
    #[error("{}: {reason}", path.display())]
    Model {
        /// The model file.
        path: PathBuf,
        /// Why, and what to do.
        reason: String,
    },
}

impl Error {
    /// An I/O error at `path`.
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Error::Io { path, source }
    }
}
