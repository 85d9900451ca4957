//! Why an environment does not do what it is asked for.

/// What an environment refuses, or cannot do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// No episode has begun.
    #[error("a step is asked for before an episode has begun: call `reset` first")]
    NotReset,
    /// The episode is over.
    #[error(
        "a step is asked for after the episode ended with step {steps}: call `reset` to begin another"
    )]
    Over {
        /// The steps that it had.
        steps: usize,
    },
    /// An action of another length.
    #[error("the action has {found} numbers, and the environment takes {}: {}", channels.len(), channels.join(", "))]
    ActionLength {
        /// Its length.
        found: usize,
        /// The names of what is taken.
        channels: Vec<String>,
    },
    /// A number of an action that is none, or beyond its bounds.
    #[error(
        "{channel} = {value} is not a number from {lower} to {upper}: clip the action to the bounds of the action space"
    )]
    Action {
        /// Its name.
        channel: String,
        /// What it is.
        value: f64,
        /// The least that it may be.
        lower: f64,
        /// The most that it may be.
        upper: f64,
    },
    /// Bounds that hold no number.
    #[error(
        "{channel} has the bounds {lower} and {upper}, between which there is no number: give the smaller first"
    )]
    Bounds {
        /// Its name.
        channel: String,
        /// The lower bound.
        lower: f64,
        /// The upper bound.
        upper: f64,
    },
    /// A setting that makes no sense.
    #[error("{name} = {value}: give {condition}")]
    Setting {
        /// Which.
        name: &'static str,
        /// What it is.
        value: f64,
        /// What it has to be.
        condition: &'static str,
    },
    /// A list of another length than the model has signals.
    #[error("{what} has {found} numbers, and `{model}` has {expected}")]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The model.
        model: String,
        /// The length that it should have.
        expected: usize,
    },
    /// A state in which no episode can begin.
    #[error("an episode begins with {name} = {value}: let it begin with {condition}")]
    Begin {
        /// `q.<coordinate>` or `v.<coordinate>`.
        name: String,
        /// What it is.
        value: f64,
        /// What it has to be.
        condition: String,
    },
    /// A reward that is not a number.
    #[error(
        "the reward of step {step} is {reward}: the task has to give a finite one at every state that the model comes to"
    )]
    Reward {
        /// Which step of the episode, from 1.
        step: usize,
        /// What it is.
        reward: f64,
    },
    /// A law of the drive does not tell how much of the past it needs.
    #[error(
        "`{model}` has a drive that remembers its input for nobody knows how long: implement `DriveLaw::past` for it, or take it out of the model"
    )]
    Memory {
        /// The model.
        model: String,
    },
    /// More of the past matters than is kept.
    #[error(
        "{samples} inputs before the present one matter to `{model}`, and no more than {most} are kept: take a longer interval"
    )]
    Past {
        /// The model.
        model: String,
        /// How many.
        samples: f64,
        /// How many at most.
        most: usize,
    },
    /// There is no motion from here on: the episode is over.
    #[error("the motion ends in step {step} of the episode (t = {time} s): {cause}")]
    Stopped {
        /// Which step of the episode, from 1.
        step: usize,
        /// When it began, s.
        time: f64,
        /// Why.
        #[source]
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
}
