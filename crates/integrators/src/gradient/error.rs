use crate::RollOutError;

/// Why there is no gradient. `E` is the error of the right-hand side.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GradientError<E> {
    /// The roll-out stopped, or a derivative along it.
    #[error(transparent)]
    RollOut(#[from] RollOutError<E>),
    /// A derivative left the numbers where the states did not.
    #[error(
        "entry {entry} of the derivative in {part} is {value}: the loss or a derivative of the system is not finite on this roll-out, or errors grow beyond all numbers along it; look at the system's derivatives at its states, or take a shorter roll-out"
    )]
    NotFinite {
        /// In what.
        part: &'static str,
        /// The first entry that is not finite.
        entry: usize,
        /// NaN or an infinity.
        value: f64,
    },
    /// A column is asked for that is not there.
    #[error("column {column} is for {what} number {found} where there are {count}")]
    Column {
        /// Which of the columns.
        column: usize,
        /// What it is a derivative in.
        what: &'static str,
        /// The number that was asked for.
        found: usize,
        /// How many there are.
        count: usize,
    },
}
