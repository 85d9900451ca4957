//! Faults of the data that only a fitted model shows: a band in which a sensor is blind, a hand that pushes and is not logged.
//!
//! Physics that is missing looks similar, and must not be masked. Two questions tell them apart. A sensor that reads wrongly does not
//! disturb the motion: without its readings in the band, the windows that pass through it fit on both sides; a force in the band would
//! have changed the velocity. And what belongs to the mechanism returns with the state: a force that shows in one stretch of time, while
//! the same positions, velocities and inputs at other times do without it, comes from outside.

use super::super::curves::ResidualForce;
use super::super::study::{Fitted, Study};
use super::super::verdict::DataFault;
use super::blind_band::blind_bands;
use super::masked::Masked;
use super::unlogged_force::unlogged_forces;
use crate::shooting::problem::Problem;
use crate::shooting::{Observations, Window};

/// What a second look found, and the data without it.
pub struct Look {
    /// The faults.
    pub faults: Vec<DataFault>,
    /// The observations; readings in a blind band do not count.
    pub observations: Observations,
    /// Stretches that no window may touch.
    pub masked: Masked,
}

/// Looks at the residuals of a fitted model, `force` being the forces it lacks. `None`: no fault is seen.
pub fn second_look(
    study: &Study,
    fitted: &Fitted,
    force: &[ResidualForce],
    masked: &Masked,
) -> Option<Look> {
    let residuals = Residuals::of(study, fitted);
    let mut look = Look {
        faults: Vec::new(),
        observations: study.observations.clone(),
        masked: masked.clone(),
    };
    blind_bands(study, fitted, &residuals, &mut look);
    if look.faults.is_empty() {
        unlogged_forces(study, &residuals, force, &mut look);
    }
    (!look.faults.is_empty()).then_some(look)
}

/// One position residual: its sample in the recording, the reading that the model expects, |residual| over the sensor's noise.
#[derive(Debug, Clone, Copy)]
pub struct Residual {
    pub sample: usize,
    pub expected: f64,
    pub size: f64,
}

/// Residuals of the positions: one list a channel, for each window, seen ones first.
pub struct Residuals {
    pub windows: Vec<Window>,
    /// `None` where the model diverges.
    pub sizes: Vec<Option<Vec<Vec<Residual>>>>,
}

impl Residuals {
    pub fn of(study: &Study, fitted: &Fitted) -> Self {
        let theta = &fitted.inside.theta;
        let hybrid = &fitted.hybrid;
        let observations = &study.observations;
        let paths = study.hidden_paths(hybrid, theta, fitted.substeps);
        let mut all = Residuals {
            windows: Vec::new(),
            sizes: Vec::new(),
        };
        let sides = [
            (&study.windows.fit, &fitted.inside.states),
            (&study.windows.held_out, &fitted.outside.states),
        ];
        for (windows, states) in sides {
            let hidden = study.hidden_prior(hybrid, (theta, true), windows, &paths);
            let problem =
                Problem::new(hybrid, observations, windows, &[], &hidden, fitted.substeps);
            for (window, rolled) in windows.iter().zip(problem.rolled(theta, states.clone())) {
                all.windows.push(*window);
                all.sizes.push(
                    rolled
                        .residuals
                        .map(|residuals| by_channel(observations, window, &residuals, hybrid.nv())),
                );
            }
        }
        all
    }
}

/// Residuals of a window, which come sample by sample and, within a sample, channel by channel, those of invalid readings left out.
fn by_channel(
    observations: &Observations,
    window: &Window,
    residuals: &[(usize, f64)],
    nv: usize,
) -> Vec<Vec<Residual>> {
    let run = &observations.runs[window.run];
    let mut lists = vec![Vec::new(); nv];
    let mut next = residuals.iter();
    for sample in window.first..window.first + window.count {
        for (c, channel) in observations.channels.iter().enumerate() {
            if !run.valid[c][sample] {
                continue;
            }
            let Some(&(_, residual)) = next.next() else {
                return lists;
            };
            if c < nv {
                lists[c].push(Residual {
                    sample,
                    expected: run.y[c][sample] - residual,
                    size: residual.abs() / channel.noise,
                });
            }
        }
    }
    lists
}

/// The value that this share of `values` does not exceed.
pub fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values
        .get((share * last as f64).round() as usize)
        .copied()
        .unwrap_or(0.0)
}

/// Median over 0.6745: the deviation of residuals of which most are normal.
pub fn robust(sizes: impl Iterator<Item = f64>) -> f64 {
    quantile(sizes.collect(), 0.5) / 0.6745
}
