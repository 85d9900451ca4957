//! What the report draws: the mechanism, measured and simulated curves, and where the model disagrees.

use super::sketch::Sketch;

/// Everything that is drawn.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curves {
    /// The mechanism; none where the model has no geometry.
    pub sketch: Option<Sketch>,
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
    /// By how much a right model errs because of its start, in units of the noise; empty where that is not known.
    pub of_start: Vec<f64>,
    /// Whether the sample counts in errors: it is in the free part, and it was measured well.
    pub counts: Vec<bool>,
}

impl FreeRunCoordinate {
    /// Whether neither model diverges.
    pub fn is_finite(&self) -> bool {
        !self.before.is_empty() && !self.after.is_empty()
    }
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
    /// The mean force along each signal, those first that explain most.
    pub profiles: Vec<Profile>,
}

/// The mean force in bins of a signal that hold as many samples each.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// The signal.
    pub signal: String,
    /// Its unit.
    pub unit: String,
    /// Range of the signal in each bin, from low to high.
    pub ranges: Vec<[f64; 2]>,
    /// Mean force in each bin.
    pub force: Vec<f64>,
}
