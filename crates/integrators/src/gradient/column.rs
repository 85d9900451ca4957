//! What a sensitivity is a derivative in.

use crate::{Differentiable, Space};

/// One number that states are derived in.
///
/// ```
/// use integrators::gradient::Column;
///
/// // Two entries of a state, then the first number of the inputs 3 and 4.
/// let mut columns: Vec<Column> = (0..2).map(Column::Initial).collect();
/// columns.extend((3..5).map(|interval| Column::Input { interval, entry: 0 }));
/// assert_eq!(columns[2], Column::Input { interval: 3, entry: 0 });
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Column {
    /// A direction of motion of the initial state.
    Initial(usize),
    /// A constant.
    Parameter(usize),
    /// A number of the input that is held over an interval.
    Input {
        /// From sample `interval` to the next one.
        interval: usize,
        /// Which number of it.
        entry: usize,
    },
}

impl Column {
    /// All directions of the initial state, then all constants.
    pub fn initial_and_parameters<S: Differentiable>(system: &S) -> Vec<Column> {
        let initial = (0..system.space().tangent_dim()).map(Column::Initial);
        initial
            .chain((0..system.parameter_count()).map(Column::Parameter))
            .collect()
    }

    /// All numbers of the inputs of some intervals, one interval after the other.
    pub fn inputs<S: Differentiable>(
        system: &S,
        intervals: std::ops::Range<usize>,
    ) -> impl Iterator<Item = Column> {
        let count = system.input_count();
        intervals.flat_map(move |interval| {
            (0..count).map(move |entry| Column::Input { interval, entry })
        })
    }
}
