//! What the report draws: measured and simulated curves, and where the model disagrees.

/// Everything that is drawn.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curves {
    /// Free runs over held-out windows, in time order.
    pub free_runs: Vec<FreeRun>,
    /// The missing force, one a coordinate.
    pub residuals: Vec<ResidualForce>,
}

/// One free run: initial state fitted before `start`, simulated from there.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeRun {
    /// Index of the recording.
    pub run: usize,
    /// Where the free run starts, s.
    pub start: f64,
    /// Sample times, s; the fitted part first.
    pub t: Vec<f64>,
    /// One a coordinate.
    pub coordinates: Vec<FreeRunCoordinate>,
}

/// One coordinate of a free run, m or rad.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeRunCoordinate {
    /// Measured.
    pub measured: Vec<f64>,
    /// By the model as given; empty where it diverges.
    pub before: Vec<f64>,
    /// By the new model; empty where it diverges.
    pub after: Vec<f64>,
}

/// The force that the model as given lacks on one coordinate, N or N·m, at samples spread over the log.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualForce {
    /// Name of the coordinate.
    pub coordinate: String,
    /// Its unit.
    pub unit: String,
    /// Index of the recording of each.
    pub run: Vec<usize>,
    /// Times, s.
    pub t: Vec<f64>,
    /// The force that is needed and not modelled.
    pub force: Vec<f64>,
    /// Shares of the variance that each signal explains (adjusted correlation ratio), largest first.
    pub explained_by: Vec<(String, f64)>,
    /// The best signal's values at the same times, with its name and unit.
    pub best_signal: (String, String, Vec<f64>),
}
