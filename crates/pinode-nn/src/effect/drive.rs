//! Input signals, and what a drive does to them.

/// The times between which the input of one recording is constant: the bounds of the integration steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Bounds of the steps, s, increasing; one more than there are steps.
    pub bounds: Vec<f64>,
    /// Steps per log sample.
    pub substeps: usize,
}

impl Grid {
    /// Every interval between two samples of `t` is cut into `substeps` equal steps.
    pub fn new(t: &[f64], substeps: usize) -> Self {
        let mut bounds = Vec::with_capacity(t.len().saturating_sub(1) * substeps + 1);
        for pair in t.windows(2) {
            for i in 0..substeps {
                bounds.push(pair[0] + (pair[1] - pair[0]) * i as f64 / substeps as f64);
            }
        }
        bounds.extend(t.last());
        Grid { bounds, substeps }
    }

    /// Number of log samples.
    pub fn samples(&self) -> usize {
        match self.bounds.len() {
            0 => 0,
            n => (n - 1) / self.substeps + 1,
        }
    }

    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.bounds.len().saturating_sub(1)
    }
}

/// An input on a [`Grid`], constant over each step, with its derivatives in the parameters of the laws it went through.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// Value over each step.
    pub value: Vec<f64>,
    /// For each parameter: its index in the fit, and ∂value/∂parameter over each step.
    pub by_parameter: Vec<(usize, Vec<f64>)>,
}

/// A law that changes an input before it acts.
pub trait DriveLaw: Send + Sync {
    /// Passes the signal through: the value, the derivatives it already carries (chain rule), and new ones in `p`, whose
    /// indices in the fit are `first`, `first + 1`, …; `None`: no new ones are wanted.
    fn pass(&self, grid: &Grid, p: &[f64], first: Option<usize>, signal: &mut Signal);

    /// The time T ≥ 0, s, of a law that does nothing but u(t) → u(t − T): steps that adapt then end where the late input jumps, and no
    /// mean is taken. `None` (the default): the law changes values, at the instants at which they change anyway.
    fn delay(&self, _p: &[f64]) -> Option<f64> {
        None
    }

    /// Whether what passes depends on the input of before, other than by a delay: between jumps of the input it is then not constant.
    fn remembers(&self) -> bool {
        false
    }

    /// How long ago, s, an input may have been that still matters: a delay's T, 0 of a law that changes each instant by itself, and of a law
    /// that remembers the time in which all but 10⁻¹⁶ is lost of what was. `None` (the default of laws that remember): it is not known.
    fn past(&self, p: &[f64]) -> Option<f64> {
        match self.remembers() {
            true => None,
            false => Some(self.delay(p).unwrap_or(0.0)),
        }
    }
}
