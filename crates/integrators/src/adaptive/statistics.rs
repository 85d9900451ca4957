//! What a roll-out took.

use super::Method;

/// Counts over a roll-out.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct Statistics {
    /// Accepted steps.
    pub steps: usize,
    /// Those of them made by the explicit method.
    pub explicit_steps: usize,
    /// Steps tried again because their error was too large or their equations were not solved.
    pub rejected: usize,
    /// Evaluations of the right-hand side.
    pub evaluations: usize,
    /// Evaluations of its Jacobian.
    pub jacobians: usize,
    /// Factorisations of the matrix of an implicit step.
    pub factorizations: usize,
    /// Starts without a past: at the beginning, at changes of the input, of the method and of the chart.
    pub starts: usize,
    /// Which method when: the first entry is the start, the others are changes.
    pub switches: Vec<Switch>,
}

/// From when on a method steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Switch {
    /// s.
    pub time: f64,
    /// What steps from then on; never [`Method::Automatic`].
    pub to: Method,
}
