//! The data under study, and models fitted to it.

use super::score::{Paired, paired, samples_per_window, window_scores};
use crate::effect::Scales;
use crate::hybrid::Hybrid;
use crate::shooting::{Fit, FitOptions, Observations, Windows, fit};

/// The data under study.
#[derive(Debug, Clone)]
pub struct Study {
    /// What was measured.
    pub observations: Observations,
    /// The windows, seen and held out.
    pub windows: Windows,
    /// The scales of the motion, one a coordinate.
    pub scales: Vec<Scales>,
    /// Integration steps per log sample.
    pub substeps: usize,
}

/// A model fitted to the seen windows, and its initial states (only those) to the windows held out.
#[derive(Clone)]
pub struct Fitted {
    /// The model.
    pub hybrid: Hybrid,
    /// The fit to the seen windows.
    pub inside: Fit,
    /// The fit of initial states to the windows held out.
    pub outside: Fit,
    /// Score of each seen window.
    pub inside_scores: Vec<f64>,
    /// Score of each window held out.
    pub outside_scores: Vec<f64>,
}

/// From where a fit starts.
#[derive(Debug, Clone)]
pub struct Start {
    /// θ.
    pub theta: Vec<f64>,
    /// Initial states of the seen windows.
    pub inside: Vec<Vec<f64>>,
    /// Initial states of the windows held out.
    pub outside: Vec<Vec<f64>>,
    /// Standard deviations of the residuals, one a channel.
    pub sigma: Vec<f64>,
}

impl Fitted {
    /// A start from this fit with another θ.
    pub fn start(&self, theta: Vec<f64>) -> Start {
        Start {
            theta,
            inside: self.inside.states.clone(),
            outside: self.outside.states.clone(),
            sigma: self.inside.sigma.clone(),
        }
    }

    /// Σ l_w over the seen windows less what the fit stretches the tolerances, less 4 k ln n for `k` more constants than the model
    /// compared with.
    pub fn score(&self, more: usize) -> f64 {
        let sum: f64 = self.inside_scores.iter().sum();
        let penalty = 4.0 * more as f64 * (self.inside_scores.len() as f64).ln();
        sum - self.inside.stretch - penalty
    }

    /// Residual over sensor noise, one a channel: 1 where the model explains all.
    pub fn excess(&self, observations: &Observations) -> Vec<f64> {
        self.inside
            .sigma
            .iter()
            .zip(&observations.channels)
            .map(|(sigma, channel)| sigma / channel.noise)
            .collect()
    }
}

/// How much better one fitted model explains the windows than another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Over the seen windows.
    pub inside: Paired,
    /// Over the windows held out.
    pub outside: Paired,
    /// Gain per sample over the seen windows, nats.
    pub inside_gain: f64,
    /// Gain per sample over the windows held out, nats.
    pub outside_gain: f64,
    /// By how much less the tolerances are stretched, nats.
    pub relief: f64,
}

/// A relief of the tolerances by so many nats, four standard deviations, speaks for an effect by itself.
pub const RELIEF: f64 = 8.0;

impl Comparison {
    /// Of `new` over `old`.
    pub fn of(new: &Fitted, old: &Fitted) -> Self {
        let inside = paired(&new.inside_scores, &old.inside_scores);
        let outside = paired(&new.outside_scores, &old.outside_scores);
        let per_sample =
            |p: Paired, fit: &Fit| p.gain / (p.windows.max(1) as f64 * samples_per_window(fit));
        Comparison {
            inside,
            outside,
            inside_gain: per_sample(inside, &new.inside),
            outside_gain: per_sample(outside, &new.outside),
            relief: old.inside.stretch - new.inside.stretch,
        }
    }

    /// Whether the gain is significant and large enough on both sides.
    pub fn explains(&self) -> bool {
        self.inside.z > 4.0
            && self.outside.z > 2.0
            && self.inside_gain > 0.05
            && self.outside_gain > 0.025
    }

    /// Whether the old model explains the windows as well only by stretching what is known of masses and gains beyond belief.
    pub fn relieves(&self) -> bool {
        self.relief > RELIEF && self.inside.z > -2.0 && self.outside.z > -2.0
    }
}

impl Study {
    /// Fits a model.
    pub fn fit(
        &self,
        hybrid: Hybrid,
        start: Start,
        state_iterations: usize,
        iterations: usize,
    ) -> Fitted {
        let free = hybrid.free();
        let options = FitOptions {
            substeps: self.substeps,
            iterations,
            state_iterations,
        };
        let inside = fit(
            &hybrid,
            &self.observations,
            &self.windows.fit,
            &free,
            start.theta,
            start.inside,
            start.sigma,
            &options,
        );
        let outside = fit(
            &hybrid,
            &self.observations,
            &self.windows.held_out,
            &[],
            inside.theta.clone(),
            start.outside,
            inside.sigma.clone(),
            &FitOptions {
                iterations: iterations.min(10),
                ..options
            },
        );
        let channels = &self.observations.channels;
        Fitted {
            inside_scores: window_scores(&inside, channels),
            outside_scores: window_scores(&outside, channels),
            hybrid,
            inside,
            outside,
        }
    }
}
