//! Free-run errors on data that no fit has seen.

use super::audit::Masked;
use super::curves::{FreeRun, FreeRunCoordinate};
use super::study::Study;
use super::verdict::{CoordinateGap, Gap};
use crate::hybrid::Hybrid;
use crate::shooting::{
    FitOptions, ObservedRun, Roller, Trajectory, Window, consecutive, fit, wrap_angle,
};

/// The gap before and after, and the free runs behind it.
///
/// Over the part of the recordings that is held out: the initial state is fitted on `lead` s with the same model, then the model
/// runs free for `horizon` s. Errors of that part alone, in units of each coordinate's measurement noise. A window in which either
/// model diverges counts for neither; one that touches what is masked is left out.
pub fn gap(
    study: &Study,
    (before, before_theta): (&Hybrid, &[f64]),
    (after, after_theta): (&Hybrid, &[f64]),
    first_guess: &dyn Fn(usize, usize) -> Vec<f64>,
    (lead, horizon): (f64, f64),
    masked: &Masked,
) -> (Gap, Vec<FreeRun>) {
    let observations = &study.observations;
    let windows = masked.leave(held_out_windows(study, lead + horizon), observations);
    let runs_before = free_runs(study, before, before_theta, &windows, first_guess, lead);
    let runs_after = free_runs(study, after, after_theta, &windows, first_guess, lead);

    let nv = before.nv();
    let mut squares = vec![(0.0, 0.0, 0_usize); nv];
    let mut curves = Vec::new();
    let mut counted = 0;
    for (i, window) in windows.iter().enumerate() {
        let run = &observations.runs[window.run];
        let span = window.first..window.first + window.count;
        let leading = lead_samples(run, window, lead);
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
        let mut free_run = FreeRun {
            run: window.run,
            start: run.t[window.first + leading - 1],
            t: run.t[span.clone()].to_vec(),
            coordinates: Vec::new(),
        };
        let both = runs_before[i].is_some() && runs_after[i].is_some();
        counted += usize::from(both);
        for (c, sum) in squares.iter_mut().enumerate() {
            let channel = &observations.channels[c];
            let measured = &run.y[c][span.clone()];
            let b = coordinate(c, &runs_before[i], before_theta, before);
            let a = coordinate(c, &runs_after[i], after_theta, after);
            if both {
                for k in (leading..window.count).filter(|k| run.valid[c][window.first + k]) {
                    sum.0 += channel.difference(measured[k], b[k]).powi(2);
                    sum.1 += channel.difference(measured[k], a[k]).powi(2);
                    sum.2 += 1;
                }
            }
            free_run.coordinates.push(continuous(
                FreeRunCoordinate {
                    measured: measured.to_vec(),
                    before: b,
                    after: a,
                },
                channel.wraps,
            ));
        }
        curves.push(free_run);
    }

    let coordinates: Vec<CoordinateGap> = before
        .mechanics()
        .coordinates()
        .iter()
        .zip(&squares)
        .zip(&observations.channels)
        .map(|((coordinate, &(b, a, n)), channel)| {
            let rms = |sum: f64| (sum / n.max(1) as f64).sqrt() / channel.noise;
            CoordinateGap {
                name: format!("q.{}", coordinate.name),
                unit: coordinate.unit().into(),
                before: rms(b),
                after: rms(a),
                noise_floor: 1.0,
                noise: channel.noise,
            }
        })
        .collect();
    let overall = |f: fn(&CoordinateGap) -> f64| {
        let sum: f64 = coordinates.iter().map(|c| f(c).powi(2)).sum();
        (sum / coordinates.len().max(1) as f64).sqrt()
    };
    let gap = Gap {
        horizon_s: horizon,
        windows: counted,
        before: overall(|c| c.before),
        after: overall(|c| c.after),
        noise_floor: 1.0,
        coordinates,
    };
    (gap, curves)
}

/// Windows over what no fit has seen; shorter ones when the recordings are too short.
fn held_out_windows(study: &Study, duration: f64) -> Vec<Window> {
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
        if cut.is_empty() {
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
    within.clamp(
        4.min(window.count),
        (2 * window.count / 3).max(4.min(window.count)),
    )
}

/// States over each window: `None` where the roll-out diverges.
fn free_runs(
    study: &Study,
    hybrid: &Hybrid,
    theta: &[f64],
    windows: &[Window],
    first_guess: &dyn Fn(usize, usize) -> Vec<f64>,
    lead: f64,
) -> Vec<Option<Vec<f64>>> {
    let observations = &study.observations;
    let leads: Vec<Window> = windows
        .iter()
        .map(|w| Window {
            count: lead_samples(&observations.runs[w.run], w, lead),
            ..*w
        })
        .collect();
    let substeps = study.substeps_for(hybrid, theta);
    let paths = study.hidden_paths(hybrid, theta, substeps);
    let hidden = study.hidden_prior(hybrid, theta, &leads, &paths);
    let guess = |(w, h): (&Window, &Vec<f64>)| [first_guess(w.run, w.first), h.clone()].concat();
    let guesses = leads.iter().zip(&hidden.means).map(guess).collect();
    let noise = observations.channels.iter().map(|c| c.noise).collect();
    let fitted = fit(
        hybrid,
        observations,
        &leads,
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
        .map(|run| hybrid.drive(&run.t, &run.u, substeps, theta, &[]))
        .collect();
    let mut roller = Roller::new(hybrid, &[]);
    windows
        .iter()
        .zip(&fitted.states)
        .map(|(window, state)| {
            let mut out = Trajectory::default();
            let span = (window.first, window.count);
            roller
                .roll(theta, &inputs[window.run], span, state, &mut out)
                .ok()
                .map(|()| out.states)
        })
        .collect()
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
