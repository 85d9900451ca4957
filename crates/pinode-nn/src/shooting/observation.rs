//! What was measured, as the fit sees it.

use std::f64::consts::PI;

use crate::effect::Grid;
use crate::hybrid::{DrivenInputs, Hybrid, Predicted, Reading};
use crate::log::typical;

/// A measured quantity: a position, or a velocity measured on its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// The coordinate.
    pub coordinate: usize,
    /// Whether it is the coordinate's velocity rather than its position.
    pub velocity: bool,
    /// Whether differences are taken on the circle.
    pub wraps: bool,
    /// Standard deviation of the sensor's noise, from the log alone; m, rad, m/s or rad/s.
    pub noise: f64,
}

impl Channel {
    /// What the sensor reads of a roll-out at sample `k`: `states` of `nx` numbers each, of a mechanism with `nv` coordinates, at the
    /// times `t`.
    pub fn predict(
        &self,
        reading: &Reading,
        (nv, nx): (usize, usize),
        states: &[f64],
        t: &[f64],
        k: usize,
    ) -> Predicted {
        let places = (self.coordinate, nv + self.coordinate);
        match self.velocity {
            false => reading.position(places, nx, states, t, k),
            true => reading.velocity(places, nx, states, t, k),
        }
    }

    /// Measured less simulated, on the circle for an angle.
    pub fn difference(&self, measured: f64, simulated: f64) -> f64 {
        let d = measured - simulated;
        if self.wraps { wrap_angle(d) } else { d }
    }
}

/// The angle in [−π, π) that differs from `x` by whole turns.
pub fn wrap_angle(x: f64) -> f64 {
    (x + PI).rem_euclid(2.0 * PI) - PI
}

/// One recording.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedRun {
    /// Sample times, s.
    pub t: Vec<f64>,
    /// Inputs, one column each.
    pub u: Vec<Vec<f64>>,
    /// Measurements, one column a channel.
    pub y: Vec<Vec<f64>>,
    /// Whether each measurement counts; false: masked as an outlier or a fault.
    pub valid: Vec<Vec<bool>>,
    /// From which samples integration steps are shorter.
    pub finer: Finer,
}

/// How many times as many integration steps are taken from each sample to the next as from others; from all as many where it is empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Finer {
    /// Of models without stops.
    pub usual: Vec<usize>,
    /// Of those with stops.
    pub of_stops: Vec<usize>,
}

/// All that was measured: the same channels in every recording. The first channels are the positions, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Observations {
    /// What was measured.
    pub channels: Vec<Channel>,
    /// The recordings.
    pub runs: Vec<ObservedRun>,
}

impl Observations {
    /// Standard deviation of each channel's noise.
    pub fn noise(&self) -> Vec<f64> {
        self.channels.iter().map(|c| c.noise).collect()
    }

    /// The median time between two samples, s; 0 without two.
    pub fn typical_interval(&self) -> f64 {
        let runs = self.runs.iter();
        let intervals = runs.flat_map(|run| run.t.windows(2).map(|p| p[1] - p[0]));
        typical(intervals.collect()).unwrap_or(0.0)
    }

    /// Every so many samples of each recording that they are about `interval` s apart, never closer than they were; the input between
    /// two of them is the mean of what was held.
    pub fn thinned(&self, interval: f64) -> Self {
        Observations {
            channels: self.channels.clone(),
            runs: self.runs.iter().map(|run| run.thinned(interval)).collect(),
        }
    }
}

impl ObservedRun {
    /// The inputs, as a model at θ [drives](Hybrid::drive) with them.
    pub fn drive(
        &self,
        hybrid: &Hybrid,
        substeps: usize,
        theta: &[f64],
        free: &[usize],
    ) -> DrivenInputs {
        let finer = match hybrid.has_stops() {
            true => &self.finer.of_stops,
            false => &self.finer.usual,
        };
        let grid = Grid::finer(&self.t, substeps, finer);
        hybrid.drive_on(grid, &self.u, theta, free)
    }

    fn thinned(&self, interval: f64) -> Self {
        let mut intervals: Vec<f64> = self.t.windows(2).map(|p| p[1] - p[0]).collect();
        intervals.sort_by(f64::total_cmp);
        let typical = intervals.get(intervals.len() / 2).copied().unwrap_or(1.0);
        // Half a percent of tolerance: clocks jitter.
        let factor = (1.005 * interval / typical).floor() as usize;
        if factor < 2 {
            return self.clone();
        }
        let kept: Vec<usize> = (0..self.t.len()).step_by(factor).collect();
        let mean = |u: &[f64], from: usize, to: usize| {
            let time = self.t[to] - self.t[from];
            (from..to)
                .map(|k| u[k] * (self.t[k + 1] - self.t[k]))
                .sum::<f64>()
                / time
        };
        let pick = |y: &[f64]| kept.iter().map(|&k| y[k]).collect();
        ObservedRun {
            finer: Finer::default(),
            t: pick(&self.t),
            u: self
                .u
                .iter()
                .map(|u| {
                    let mut means: Vec<f64> =
                        kept.windows(2).map(|p| mean(u, p[0], p[1])).collect();
                    means.extend(kept.last().map(|&k| u[k]));
                    means
                })
                .collect(),
            y: self.y.iter().map(|y| pick(y)).collect(),
            valid: self
                .valid
                .iter()
                .map(|valid| kept.iter().map(|&k| valid[k]).collect())
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_measurements_and_the_impulse_of_the_input() {
        let t: Vec<f64> = (0..101).map(|k| k as f64 * 1e-3).collect();
        let u: Vec<f64> = (0..101).map(|k| (k * k) as f64).collect();
        let run = ObservedRun {
            finer: Finer::default(),
            y: vec![u.clone()],
            valid: vec![vec![true; 101]],
            u: vec![u.clone()],
            t,
        };
        let thin = run.thinned(5e-3);
        assert_eq!(thin.t.len(), 21);
        assert_eq!(thin.y[0][4], 400.0);
        let impulse: f64 = u[..100].iter().map(|u| u * 1e-3).sum();
        let thin_impulse: f64 = thin.u[0][..20].iter().map(|u| u * 5e-3).sum();
        assert!((impulse - thin_impulse).abs() < 1e-9);
        assert_eq!(run.thinned(1.5e-3), run);
    }

    #[test]
    fn angles_differ_on_the_circle() {
        assert!((wrap_angle(2.0 * PI + 0.1) - 0.1).abs() < 1e-12);
        assert!((wrap_angle(-2.0 * PI - 0.1) + 0.1).abs() < 1e-12);
        assert_eq!(wrap_angle(PI), -PI);
    }
}
