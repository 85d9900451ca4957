//! Why an adaptive roll-out stopped.

use std::fmt;

use super::settings::{LARGEST, SMALLEST};

/// Something wrong with the arguments of a roll-out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ArgumentError {
    /// rtol.
    #[error("the relative tolerance is {value}: it must be at least 0 and less than 1")]
    Relative {
        /// What was given.
        value: f64,
    },
    /// An absolute tolerance.
    #[error(
        "absolute tolerance {index} is {value}: it must be between {SMALLEST:e} and {LARGEST:e}, in the unit of the state"
    )]
    Absolute {
        /// Which one.
        index: usize,
        /// What was given.
        value: f64,
    },
    /// The number of absolute tolerances.
    #[error(
        "{found} absolute tolerances for {directions} directions of motion: give one for all, or one for each"
    )]
    AbsoluteCount {
        /// Given.
        found: usize,
        /// Directions of motion of the system.
        directions: usize,
    },
    /// No steps are allowed.
    #[error("max_steps is 0: at least one step is needed")]
    MaxSteps,
    /// A sample time is not finite, or not later than the one before it.
    #[error(
        "times[{index}] is {time} s after {previous} s: sample times must be finite and increase by more than their rounding"
    )]
    Times {
        /// Which sample.
        index: usize,
        /// Its time, s.
        time: f64,
        /// The time of the sample before it, s.
        previous: f64,
    },
    /// There are more intervals than inputs.
    #[error(
        "{found} inputs for {needed} intervals between samples: give one input for every sample but the last"
    )]
    Inputs {
        /// Number of inputs given.
        found: usize,
        /// Number of intervals.
        needed: usize,
    },
    /// The initial state has the wrong length.
    #[error("the initial state has {found} entries where the system has {expected}")]
    InitialLength {
        /// Its length.
        found: usize,
        /// The entries of a state.
        expected: usize,
    },
    /// The initial state is no number.
    #[error("entry {component} of the initial state is {value}: it must be finite")]
    Initial {
        /// Which entry.
        component: usize,
        /// What was given.
        value: f64,
    },
}

/// Why the right-hand side has no value to use. `E` is the error of the system.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal<E> {
    /// The system refused.
    #[error("the equations of motion failed")]
    System(#[source] E),
    /// A rate is NaN, infinite, or beyond 1e80.
    #[error("entry {component} of the rate is {value}")]
    Rate {
        /// The first such entry.
        component: usize,
        /// What it is.
        value: f64,
    },
    /// A derivative of the rate is NaN, infinite, or beyond 1e80.
    #[error("the derivative of entry {row} of the rate along direction {column} is {value}")]
    Jacobian {
        /// Of which entry of the rate.
        row: usize,
        /// Along which direction of motion.
        column: usize,
        /// What it is.
        value: f64,
    },
}

/// Why an adaptive roll-out stopped. `E` is the error of the system.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AdaptiveError<E> {
    /// The arguments cannot be used; all that is wrong with them.
    #[error("the roll-out cannot start: {}", List(.0))]
    Arguments(Vec<ArgumentError>),
    /// The right-hand side, or its Jacobian, has no value at a state that was reached, or nowhere near it.
    #[error(
        "at t = {time} s the right-hand side has no value to go on with: look for a state outside of what the forces are defined for"
    )]
    RightHandSide {
        /// s.
        time: f64,
        /// What was wrong.
        source: Refusal<E>,
    },
    /// Steps became too small to advance time.
    #[error(
        "at t = {time} s no step longer than {step:e} s meets the tolerance: look for a force that jumps or grows without bound, ask for less accuracy, or, where an explicit method meets stiff forces, take an implicit one"
    )]
    StepSize {
        /// s.
        time: f64,
        /// The last step tried, s.
        step: f64,
    },
    /// The state grew beyond all bounds.
    #[error(
        "x[{component}] is {value} at t = {time} s: the roll-out diverged; look for a force that grows without bound"
    )]
    NotFinite {
        /// s.
        time: f64,
        /// The first such entry.
        component: usize,
        /// What it is.
        value: f64,
    },
    /// The steps allowed did not reach the end.
    #[error(
        "{steps} steps reached t = {time} s only, the last one of {step:e} s: allow more steps, ask for less accuracy, or take Method::Automatic if an explicit method was chosen"
    )]
    Steps {
        /// Steps made.
        steps: usize,
        /// Reached, s.
        time: f64,
        /// The last step, s.
        step: f64,
    },
    /// The solver gave up for a reason of its own.
    #[error("the solver gave up at t = {time} s: {message}")]
    Solver {
        /// s.
        time: f64,
        /// What it said.
        message: String,
    },
}

impl<E> AdaptiveError<E> {
    /// When it stopped, s; none where it could not start.
    pub fn time(&self) -> Option<f64> {
        match self {
            AdaptiveError::Arguments(_) => None,
            AdaptiveError::RightHandSide { time, .. }
            | AdaptiveError::StepSize { time, .. }
            | AdaptiveError::NotFinite { time, .. }
            | AdaptiveError::Steps { time, .. }
            | AdaptiveError::Solver { time, .. } => Some(*time),
        }
    }
}

/// Items with semicolons between them.
struct List<'a, T>(&'a [T]);

impl<T: fmt::Display> fmt::Display for List<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, item) in self.0.iter().enumerate() {
            if i > 0 {
                f.write_str("; ")?;
            }
            write!(f, "{item}")?;
        }
        Ok(())
    }
}
