//! What a roll-out of adaptive steps is asked for.

use super::ArgumentError;

/// Which solver steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Method {
    /// The explicit pair of orders 5 and 4 of Tsitouras ("Runge-Kutta pairs of order 5(4) satisfying only the first column
    /// simplifying assumption", 2011).
    Tsit5,
    /// The trapezoidal rule and BDF2 in one step, order 2, L-stable (Hosea and Shampine 1996).
    TrBdf2,
    /// A singly diagonally implicit method of order 3, L-stable (Jørgensen, Kristensen, Thomsen 2018).
    Esdirk34,
    /// Backward differences of orders 1 to 5 with the modification of Klopfenstein and Shampine (Shampine and Reichelt 1997).
    Bdf,
    /// [`Tsit5`](Method::Tsit5) where steps are bounded by accuracy, an implicit method where they are bounded by stability, both
    /// ways: [`Bdf`](Method::Bdf) where one input is held all the time, else [`Esdirk34`](Method::Esdirk34).
    ///
    /// The implicit one steps at a tenth of the tolerances: at the same ones its errors at the end are some ten times those of Tsit5.
    Automatic,
}

impl Method {
    /// A name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Method::Tsit5 => "Tsit5",
            Method::TrBdf2 => "TR-BDF2",
            Method::Esdirk34 => "ESDIRK34",
            Method::Bdf => "BDF",
            Method::Automatic => "Automatic",
        }
    }
}

/// Method, tolerances and limits of a roll-out.
///
/// A step is accepted where the root of the mean square of eᵢ/(atolᵢ + rtol |xᵢ|) is below 1; e is the error of this one step.
/// Where positions turn there is one tolerance for every direction of motion, and a turn counts relative to 1 rad. The error at the
/// end of a roll-out is a sum of those of many steps, and usually larger than the tolerance.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Settings {
    /// Which solver steps.
    pub method: Method,
    /// rtol, in [0, 1).
    pub relative: f64,
    /// atol in the units of the state: one number for all directions of motion, or one for each.
    pub absolute: Vec<f64>,
    /// Accepted steps at most, over the whole roll-out.
    pub max_steps: usize,
}

impl Settings {
    /// Both tolerances for all directions, and 10⁶ steps at most.
    pub fn new(method: Method, relative: f64, absolute: f64) -> Self {
        Settings {
            method,
            relative,
            absolute: vec![absolute],
            max_steps: 1_000_000,
        }
    }

    /// atol for each direction of motion.
    #[must_use]
    pub fn with_absolute(mut self, absolute: &[f64]) -> Self {
        self.absolute = absolute.to_vec();
        self
    }

    /// Accepted steps at most.
    #[must_use]
    pub fn with_max_steps(mut self, max_steps: usize) -> Self {
        self.max_steps = max_steps;
        self
    }

    /// Everything that is wrong with the tolerances of a system with `directions` directions of motion.
    pub(super) fn problems(&self, directions: usize) -> Vec<ArgumentError> {
        let mut problems = Vec::new();
        if !(0.0..1.0).contains(&self.relative) {
            problems.push(ArgumentError::Relative {
                value: self.relative,
            });
        }
        let found = self.absolute.len();
        if found != 1 && found != directions {
            problems.push(ArgumentError::AbsoluteCount { found, directions });
        }
        for (index, &value) in self.absolute.iter().enumerate() {
            if !(SMALLEST..=LARGEST).contains(&value) {
                problems.push(ArgumentError::Absolute { index, value });
            }
        }
        if self.max_steps == 0 {
            problems.push(ArgumentError::MaxSteps);
        }
        problems
    }
}

/// Absolute tolerances within which squares of errors stay in the numbers.
pub(super) const SMALLEST: f64 = 1e-60;
/// See [`SMALLEST`].
pub(super) const LARGEST: f64 = 1e60;
