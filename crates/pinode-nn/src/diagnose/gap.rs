//! Free-run errors on data that no fit has seen.

use super::audit::Masked;
use super::curves::{FreeRun, FreeRunCoordinate};
use super::start_errors::{Started, start_errors};
use super::study::Study;
use super::verdict::{CoordinateGap, Gap};
use crate::hybrid::Hybrid;
use crate::shooting::{
    FitOptions, ObservedRun, Roller, Trajectory, Window, consecutive, fit, wrap_angle,
};

/// Samples that an initial state is fitted to, at least.
const FEWEST_LEADING: usize = 4;

/// Free runs over held-out data by two models, with their parameters: before and after.
///
/// Over the part of the recordings that is held out: the initial state is fitted on `lead` s with the same model, then the model
/// runs free for `horizon` s, or for less where `shorter` allows it and the recordings are too short. A window in which either model
/// diverges counts for neither; one that touches what is masked is left out.
pub fn free_runs(
    study: &Study,
    (before, before_theta): (&Hybrid, &[f64]),
    (after, after_theta): (&Hybrid, &[f64]),
    (lead, horizon, shorter): (f64, f64, bool),
    masked: &Masked,
) -> Vec<FreeRun> {
    let observations = &study.observations;
    // A start takes some samples to fit, and what runs free follows them.
    let lead = lead.max(FEWEST_LEADING as f64 * observations.typical_interval());
    let cut = held_out_windows(study, lead + horizon, shorter);
    let windows = masked.leave(cut, observations);
    let leads: Vec<Window> = windows
        .iter()
        .map(|w| Window {
            count: lead_samples(&observations.runs[w.run], w, lead),
            ..*w
        })
        .collect();
    let cut = (&windows[..], &leads[..]);
    let (runs_before, _) = rolled(study, (before, before_theta), cut, false);
    let (runs_after, errors) = rolled(study, (after, after_theta), cut, true);

    let nv = before.nv();
    let mut curves = Vec::new();
    for (i, window) in windows.iter().enumerate() {
        let run = &observations.runs[window.run];
        let span = window.first..window.first + window.count;
        let leading = leads[i].count;
        let coordinate = |c: usize, roll: &Option<Vec<f64>>, theta: &[f64], hybrid: &Hybrid| {
            roll.as_ref().map_or_else(Vec::new, |states| {
                let reading = hybrid.reading(c, theta, &[]);
                let channel = &observations.channels[c];
                let sizes = (nv, hybrid.nx());
                let t = &run.t[span.clone()];
                (0..window.count)
                    .map(|k| channel.predict(&reading, sizes, states, t, k).value)
                    .collect::<Vec<f64>>()
            })
        };
        let coordinates = (0..nv)
            .map(|c| {
                let valid = &run.valid[c][span.clone()];
                let free = |(k, valid): (usize, &bool)| *valid && k >= leading;
                let curves = FreeRunCoordinate {
                    measured: run.y[c][span.clone()].to_vec(),
                    before: coordinate(c, &runs_before[i], before_theta, before),
                    after: coordinate(c, &runs_after[i], after_theta, after),
                    of_start: errors[i].as_ref().map_or_else(Vec::new, |of| of[c].clone()),
                    counts: valid.iter().enumerate().map(free).collect(),
                };
                continuous(curves, observations.channels[c].wraps)
            })
            .collect();
        curves.push(FreeRun {
            run: window.run,
            start: run.t[window.first + leading - 1],
            t: run.t[span.clone()].to_vec(),
            coordinates,
        });
    }
    curves
}

/// The gap that free runs of `horizon` s show: errors of their free part alone, in units of each coordinate's measurement noise; NaN where there is no free run.
pub fn gap(study: &Study, hybrid: &Hybrid, free_runs: &[FreeRun], horizon: f64) -> Gap {
    let coordinates: Vec<CoordinateGap> = hybrid
        .mechanics()
        .coordinates()
        .iter()
        .zip(&study.observations.channels)
        .enumerate()
        .map(|(c, (coordinate, channel))| {
            let errors = Errors::of(free_runs, c, channel.noise, |_, _| true);
            let measured = |error: f64| match errors.samples {
                0 => f64::NAN,
                _ => error,
            };
            CoordinateGap {
                name: format!("q.{}", coordinate.name),
                unit: coordinate.unit().into(),
                before: measured(errors.before),
                after: measured(errors.after),
                expected: measured(errors.expected),
                noise_floor: 1.0,
                noise: channel.noise,
            }
        })
        .collect();
    let all = |error: fn(&CoordinateGap) -> f64| {
        let measured = coordinates.iter().map(error).filter(|e| !e.is_nan());
        let measured: Vec<f64> = measured.collect();
        match measured.is_empty() {
            true => f64::NAN,
            false => overall(measured.into_iter()),
        }
    };
    Gap {
        horizon_s: horizon,
        windows: finite(free_runs),
        before: all(|c| c.before),
        after: all(|c| c.after),
        expected: all(|c| c.expected),
        noise_floor: 1.0,
        horizons: Vec::new(),
        regions: Vec::new(),
        coordinates,
    }
}

/// Number of free runs in which neither model diverges.
pub fn finite(free_runs: &[FreeRun]) -> usize {
    let whole = |run: &&FreeRun| run.coordinates.iter().all(FreeRunCoordinate::is_finite);
    free_runs.iter().filter(whole).count()
}

/// Root mean square over the coordinates.
pub fn overall(errors: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = errors.len().max(1) as f64;
    (errors.map(|e| e * e).sum::<f64>() / n).sqrt()
}

/// Root-mean-square errors of one coordinate over some samples of free runs, in units of its noise; 0 without samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Of the model as given.
    pub before: f64,
    /// Of the new model.
    pub after: f64,
    /// What the noise and the error of the start make of a right one, to first order; NaN where that is known of no sample.
    pub expected: f64,
    /// Number of samples.
    pub samples: usize,
}

impl Errors {
    /// Over the samples of coordinate `c` that count and that `keep` takes, by free run and index.
    pub fn of(
        free_runs: &[FreeRun],
        c: usize,
        noise: f64,
        keep: impl Fn(&FreeRun, usize) -> bool,
    ) -> Self {
        let (mut before, mut after, mut samples) = (0.0, 0.0, 0_usize);
        // Of the samples of which it is known.
        let (mut expected, mut known) = (0.0, 0_usize);
        for run in free_runs {
            let coordinate = &run.coordinates[c];
            if !coordinate.is_finite() {
                continue;
            }
            for (k, _) in coordinate.counts.iter().enumerate().filter(|c| *c.1) {
                if keep(run, k) {
                    before += (coordinate.measured[k] - coordinate.before[k]).powi(2);
                    after += (coordinate.measured[k] - coordinate.after[k]).powi(2);
                    if let Some(of_start) = coordinate.of_start.get(k) {
                        expected += 1.0 + of_start.powi(2);
                        known += 1;
                    }
                    samples += 1;
                }
            }
        }
        let rms = |sum: f64| (sum / samples.max(1) as f64).sqrt() / noise;
        Errors {
            before: rms(before),
            after: rms(after),
            expected: match (known, samples) {
                (0, 1..) => f64::NAN,
                _ => (expected / known.max(1) as f64).sqrt(),
            },
            samples,
        }
    }
}

/// Windows over what no fit has seen; `shorter` ones when the recordings are too short.
fn held_out_windows(study: &Study, duration: f64, shorter: bool) -> Vec<Window> {
    let held_out = &study.windows.held_out;
    let mut windows = Vec::new();
    for (r, run) in study.observations.runs.iter().enumerate() {
        let own = held_out.iter().filter(|w| w.run == r);
        let (Some(first), Some(last)) = (
            own.clone().map(|w| w.first).min(),
            own.map(|w| w.first + w.count).max(),
        ) else {
            continue;
        };
        let mut cut = consecutive(r, &run.t[first..last], duration);
        if cut.is_empty() && shorter {
            cut = consecutive(r, &run.t[first..last], duration / 2.0);
        }
        windows.extend(cut.into_iter().map(|w| Window {
            first: w.first + first,
            ..w
        }));
    }
    windows
}

/// Samples of a window that its initial state is fitted to: those within `lead` s, at most two thirds of it.
fn lead_samples(run: &ObservedRun, window: &Window, lead: f64) -> usize {
    let start = run.t[window.first];
    let within = (window.first..window.first + window.count)
        .take_while(|&k| run.t[k] - start <= lead)
        .count();
    let fewest = FEWEST_LEADING.min(window.count.saturating_sub(1));
    within.clamp(fewest, (2 * window.count / 3).max(fewest))
}

/// By how much a right model errs because of its start, at each sample of each channel, in units of the noise.
type OfStart = Option<Vec<Vec<f64>>>;

/// States over each window, from one that is fitted to the window's lead: `None` where the roll-out diverges; and what the errors of the starts do to them, where
/// that is asked.
fn rolled(
    study: &Study,
    (hybrid, theta): (&Hybrid, &[f64]),
    (windows, leads): (&[Window], &[Window]),
    is_asked: bool,
) -> (Vec<Option<Vec<f64>>>, Vec<OfStart>) {
    let observations = &study.observations;
    let substeps = study.substeps_for(hybrid, theta);
    let paths = study.hidden_paths(hybrid, theta, substeps);
    let hidden = study.hidden_prior(hybrid, (theta, true), leads, &paths);
    let measured = study.starts(hybrid, theta, leads, None);
    let guess = |(state, h): (&Vec<f64>, &Vec<f64>)| [&state[..], h].concat();
    let guesses = measured.iter().zip(&hidden.means).map(guess).collect();
    let noise = observations.noise();
    let fitted = fit(
        hybrid,
        observations,
        leads,
        &[],
        theta.to_vec(),
        guesses,
        noise,
        &hidden,
        &FitOptions {
            substeps,
            iterations: 10,
            state_iterations: 3,
        },
    );
    let inputs: Vec<_> = observations
        .runs
        .iter()
        .map(|run| run.drive(hybrid, substeps, theta, &[]))
        .collect();
    let mut roller = Roller::new(hybrid, &[]);
    let mut roll = |(window, state): (&Window, &Vec<f64>)| {
        let mut out = Trajectory::default();
        let span = (window.first, window.count);
        roller
            .roll(theta, &inputs[window.run], span, state, &mut out)
            .ok()
            .map(|()| out.states)
    };
    let rolls = windows.iter().zip(&fitted.states).map(&mut roll).collect();
    let started = Started {
        windows,
        leads,
        states: &fitted.states,
        hidden: &hidden,
    };
    let errors = match is_asked {
        true => start_errors((hybrid, theta), observations, &started, substeps),
        false => Vec::new(),
    };
    (rolls, errors)
}

/// The same curves without jumps by whole turns, simulation beside measurement.
fn continuous(mut curves: FreeRunCoordinate, wraps: bool) -> FreeRunCoordinate {
    if wraps {
        curves.measured = super::smooth::unwrapped(&curves.measured);
        for simulated in [&mut curves.before, &mut curves.after] {
            for (x, y) in simulated.iter_mut().zip(&curves.measured) {
                *x = y + wrap_angle(*x - y);
            }
        }
    }
    curves
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shooting::Finer;

    /// Of four samples all four were the start's, and the error of none of them 0.
    #[test]
    fn some_samples_run_free_however_coarse_the_log_is() {
        let run = |interval: f64| ObservedRun {
            finer: Finer::default(),
            t: (0..40).map(|k| interval * f64::from(k)).collect(),
            u: Vec::new(),
            y: Vec::new(),
            valid: Vec::new(),
        };
        let leading = |interval: f64, count: usize| {
            let window = Window {
                run: 0,
                first: 0,
                count,
            };
            lead_samples(&run(interval), &window, 0.3)
        };
        assert_eq!(leading(0.2, 4), 3);
        assert_eq!(leading(0.2, 7), 4);
        // 0.3 s of 0.9, and the sample at its end.
        assert_eq!(leading(0.02, 45), 16);
    }
}
