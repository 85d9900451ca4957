//! What can go wrong in this crate.

use std::fmt;
use std::path::{Path, PathBuf};

#[cfg(feature = "adaptive")]
use integrators::adaptive::AdaptiveError;
use lagrange::Problems;

use crate::contact_run::ContactRunError;
use crate::digits::number;
use crate::motion::NotFree;
use crate::naming::quoted;
#[cfg(feature = "adaptive")]
use crate::shooting::Diverged;

/// A coordinate that is read as the same number throughout a log.
#[derive(Debug, Clone, PartialEq)]
pub struct Unmoved {
    /// Its column.
    pub column: String,
    /// What is read.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// How often it is read.
    pub samples: usize,
    /// Root mean square of what would have to hold it there.
    pub force: f64,
    /// The unit of that.
    pub force_unit: &'static str,
}

impl fmt::Display for Unmoved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Unmoved {
            column,
            value,
            unit,
            samples,
            force,
            force_unit,
        } = self;
        write!(
            f,
            "{} is {} {unit} in all {samples} samples, and under the logged inputs {} {force_unit} (root mean square) would have to hold it there: is its \
             sensor dead? Where something does hold the joint, make it `fixed` in the model",
            quoted(column),
            number(*value),
            number(*force),
        )
    }
}

/// One a line.
fn list(columns: &[Unmoved]) -> String {
    let lines: Vec<String> = columns.iter().map(Unmoved::to_string).collect();
    lines.join("\n")
}

/// An error of models, logs and what is done with them.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}{}", path.display(), cure(source))]
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
    /// The equations cannot be written as formulas.
    #[error("{0}")]
    Formulas(#[from] lagrange::FormulasError),
    /// Too little data to name anything.
    #[error(
        "the logs hold {fit} windows of {window:.3} s to fit and {held_out} to hold out; {} and {} are needed: give a longer log",
        needed.0, needed.1
    )]
    TooShort {
        /// Length of a window, s.
        window: f64,
        /// Windows that a fit may see.
        fit: usize,
        /// Windows held out.
        held_out: usize,
        /// How many of each are needed.
        needed: (usize, usize),
    },
    /// Samples are too far apart for the windows of a fit.
    #[error(
        "the log has a sample every {interval:.3} s, and the motion needs windows of {window:.3} s with three intervals at least: is `t` in \
         seconds? Else sample faster, or give longer recordings"
    )]
    TooCoarse {
        /// Between samples, s.
        interval: f64,
        /// Length of a window, s.
        window: f64,
    },
    /// Coordinates are read as the same number throughout, though the equations ask them to move.
    #[error("{}", list(columns))]
    Unmoved {
        /// All of them.
        columns: Vec<Unmoved>,
    },
    /// The model as given cannot be simulated over the log.
    #[error(
        "the model as given diverges in {diverged} of {windows} windows of the log: check units (those of `t` are seconds), signs and the order of \
         columns (`pinode check` prints what the model expects); where the command has `--step`, take a shorter one: stiff forces need it"
    )]
    Unfittable {
        /// Windows in which it diverges.
        diverged: usize,
        /// All windows.
        windows: usize,
    },
    /// A free run left the finite numbers.
    #[error(
        "the simulation diverges after t = {time} s of run `{run}`: take a shorter step, or look for a force that grows without bound"
    )]
    Diverged {
        /// The recording.
        run: String,
        /// The last good sample, s.
        time: f64,
    },
    /// The dynamics have no acceleration at a state that a free run comes to.
    #[error("the simulation stops after t = {time} s of run `{run}`: {cause}")]
    Stopped {
        /// The recording.
        run: String,
        /// The last good sample, s.
        time: f64,
        /// What the dynamics refuse.
        #[source]
        cause: lagrange::Error,
    },
    /// A simulation comes to where the angles fail that a pose is written by.
    #[error(
        "run `{run}`: `{coordinate}` is {pitch:.3} rad at t = {time} s, and the simulation stops: the {roll_axis} axis of the body, which roll is about, is \
         within 9° of the vertical, where the angles of `pose = \"angles\"` fail ({cause}); take a `roll_axis` that stays away from there, or \
         `pose = \"quaternion\"`, which fails nowhere"
    )]
    Upright {
        /// The recording.
        run: String,
        /// The angle.
        coordinate: String,
        /// Its value, rad.
        pitch: f64,
        /// The sample that is nearest to where they fail, s.
        time: f64,
        /// The axis of the body that roll is about.
        roll_axis: &'static str,
        /// What stopped it.
        #[source]
        cause: Box<Error>,
    },
    /// The equations of an implicit step have not been solved in a simulation.
    #[error(
        "the simulation stops after t = {time} s of run `{run}`: the equations of the next step were not solved in {iterations} \
         iterations (last change of the velocity: {change:e} of its size); take a shorter step, or an explicit method"
    )]
    NoStep {
        /// The recording.
        run: String,
        /// The last good sample, s.
        time: f64,
        /// Iterations made.
        iterations: usize,
        /// The last change, relative to the velocity.
        change: f64,
    },
    /// Contacts with set-valued friction have no motion.
    #[error("run `{run}`: {cause}")]
    Contacts {
        /// The recording.
        run: String,
        /// When, and why.
        #[source]
        cause: Box<ContactRunError>,
    },
    /// Steps that adapt do not reach the end.
    #[cfg(feature = "adaptive")]
    #[error("run `{run}`: {cause}")]
    Adaptive {
        /// The recording.
        run: String,
        /// When, and why.
        #[source]
        cause: Box<AdaptiveError<Diverged>>,
    },
    /// What is asked for was left out when the program was built.
    #[error(
        "{what} needs the feature `{feature}`, and this program was built without it: build it with its default features, or {instead}"
    )]
    NotBuilt {
        /// What is asked for.
        what: String,
        /// The feature of `pinode-nn`.
        feature: &'static str,
        /// What does without.
        instead: &'static str,
    },
    /// The method of a simulation is not for this mechanism.
    #[error("{0}")]
    NotFree(#[from] NotFree),
    /// No stretch of a log is long enough.
    #[error(
        "no window of {} s fits into the logs: take a shorter horizon or longer recordings",
        (horizon * 1e6).round() / 1e6
    )]
    NoWindow {
        /// Length asked for, s.
        horizon: f64,
    },
    /// What tells a training when to stop is too short.
    #[error(
        "no window of {horizon:.4} s fits into {part}: take a shorter horizon or longer recordings, or hold out other logs (--holdout)"
    )]
    NoWindowHeldOut {
        /// Length asked for, s.
        horizon: f64,
        /// What is held out.
        part: &'static str,
    },
    /// A coordinate has a name that no formula can have.
    #[error(
        "a model without mechanics is written in formulas of its coordinates: {what}; rename the joint `{joint}`, and put single joints in \
         place of a planar one"
    )]
    NoFormula {
        /// The joint.
        joint: String,
        /// What is wrong with the name.
        what: String,
    },
    /// What training is asked for makes no sense.
    #[error("{0}")]
    Training(String),
    /// A model has no network, and the work asked for is on networks.
    #[error("{} has no network to {work}: learn one by `pinode train`, and give the model that it writes", path.display())]
    NoNetwork {
        /// The model.
        path: PathBuf,
        /// What was to be done with it.
        work: &'static str,
    },
    /// A band is asked for, and there is one network or none.
    #[error("{} has no ensemble, and a band needs one: train it by `pinode train --members 5`, or leave out --band", path.display())]
    NoEnsemble {
        /// The model.
        path: PathBuf,
    },
    /// Errors of a signal are so large that no band holds them.
    #[error(
        "the errors of {signal} are too large to be squared, so that no band holds them: `pinode evaluate` tells which sample of the log it is"
    )]
    NoBand {
        /// `q.<joint>` or `v.<joint>`.
        signal: String,
    },
    /// A number that scales a network is beyond the range of 32 bits.
    #[error(
        "the {what} of {name} is {value:e}, which 32 bits do not hold: export it by `--precision f64`"
    )]
    NotSingle {
        /// `offset`, `width` or `scale`.
        what: &'static str,
        /// Of what.
        name: String,
        /// The number.
        value: f64,
    },
    /// A training cannot go on from a checkpoint: it is damaged, or of another training.
    #[error("{} {what}; train without --resume, or in another folder", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A coordinate is a pose, and the work asked for takes one number a coordinate.
    #[error(
        "{work} takes coordinates of one measured number each, and `{coordinate}` is the pose of a body that floats: seven numbers \
         in q and six in v; write it by angles (pose = \"angles\" in the model file, or `poses::by_angles` for model and logs), or hold \
         the body still (base = \"fixed\", or a fixed joint)"
    )]
    Floating {
        /// The coordinate.
        coordinate: String,
        /// What cannot be done with it.
        work: &'static str,
    },
    /// A log was read for another model.
    #[error(
        "run `{run}` of {} has {found} {what}, and the model has {expected}: read the log with this model", log.display()
    )]
    OtherModel {
        /// The log.
        log: PathBuf,
        /// The recording.
        run: String,
        /// Which columns.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many the model has.
        expected: usize,
    },
    /// Errors of a signal cannot be summed up: they are beyond the range of numbers.
    #[error(
        "the errors of {signal} are too large to be squared: sample {sample} of run `{run}` (t = {time} s) reads {value:e}; cut the \
         faulty samples out of the log, or correct its scale by [log.columns]"
    )]
    Overflow {
        /// `q.<joint>` or `v.<joint>`.
        signal: String,
        /// The recording.
        run: String,
        /// Index of the sample with the largest reading, from 0.
        sample: usize,
        /// Its time, s.
        time: f64,
        /// What it reads.
        value: f64,
    },
    /// A log is given twice.
    #[error("{} is given twice (the same content as {}): a window that a fit has seen cannot be held out", second.display(), first.display())]
    SameLog {
        /// The first of the two.
        first: PathBuf,
        /// The second.
        second: PathBuf,
    },
    /// An output would replace a file that was read.
    #[error("{} is an input that was read: write to another folder or under another name", path.display())]
    OverwritesInput {
        /// The file.
        path: PathBuf,
    },
    /// Two outputs would be one file.
    #[error("{} is to hold two results: give each a name of its own", path.display())]
    SameOutput {
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

/// What to do about what the system said.
fn cure(source: &std::io::Error) -> &'static str {
    use std::io::ErrorKind;
    match source.kind() {
        ErrorKind::NotFound => ": check the path; folders are made in folders that are there",
        ErrorKind::AlreadyExists | ErrorKind::NotADirectory => {
            ": a file stands where a folder is to be: give another path"
        }
        ErrorKind::IsADirectory => ": give a file in that folder",
        ErrorKind::PermissionDenied => ": take a path that you may read or write",
        ErrorKind::StorageFull => ": make room, or give a path on another disk",
        _ => "",
    }
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
