//! How far the smoothed friction of a model takes its free runs from those of friction that sticks.
//!
//! Fits need forces that have derivatives, and so dry friction is spread over its `smoothing` velocity ε. A joint that its friction
//! would hold under a force F then creeps with v = ε artanh(F/F_c), and every slide ends and begins with an error of the order of ε. The
//! same free runs under the set-valued laws ([`contact_run`](crate::contact_run)) say whether that matters: their difference, in units
//! of the sensor noise. End stops are the same on both sides, compliant: their stiffness is a property of the rig, no smoothing.

use lagrange::Coordinate;
use rayon::prelude::*;
use serde::Serialize;

use crate::Error;
use crate::contact_run::roll_system;
use crate::diagnose::audit;
use crate::entries::refuse_poses;
use crate::evaluate::{Options, places};
use crate::free_run::{initial_states, substeps};
use crate::hybrid::{DrivenInputs, Hybrid, HybridContacts};
use crate::log::{Log, Run};
use crate::model::Model;
use crate::motion::NotFree;
use crate::shooting::{Roller, Trajectory, Window, wrap_angle};

/// From this part of the sensor noise on a difference begins: what the choice of an integration step may change as well.
pub const NOTICEABLE: f64 = 0.3;

/// Root mean square, in units of the sensor noise, above which a difference is worth a word: more than the noise that hides it.
pub const VISIBLE: f64 = 1.0;

/// The difference between free runs with smoothed and with set-valued friction, from the same states under the same inputs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SmoothingError {
    /// Number of free runs.
    pub windows: usize,
    /// How many of them one of the two does not finish; they are not in the differences.
    pub stopped: usize,
    /// Each coordinate; none where no free run is finished.
    pub coordinates: Vec<Difference>,
}

/// The difference of one coordinate, over all samples of all free runs but the first of each.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// `q.<coordinate>`.
    pub name: String,
    /// Unit of `noise`.
    pub unit: String,
    /// Standard deviation of the sensor's noise, in `unit`.
    pub noise: f64,
    /// Root mean square, in units of `noise`.
    pub rms: f64,
    /// The largest, in units of `noise`.
    pub largest: f64,
    /// Where it starts in the free run that has the largest: the first sample with more than [`NOTICEABLE`].
    pub starts: Option<Onset>,
}

/// A sample of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Onset {
    /// The recording, counted from 0 over all logs.
    pub run: usize,
    /// Its time, s.
    pub t: f64,
}

impl SmoothingError {
    /// The coordinates that smoothing moves by more than [`VISIBLE`], root mean square.
    pub fn visible(&self) -> impl Iterator<Item = &Difference> {
        let moved = |c: &&Difference| c.rms > VISIBLE;
        self.coordinates.iter().filter(moved)
    }
}

/// Over the free runs of an [evaluation](crate::evaluate::evaluate) with the same `options`; noise as a diagnosis of these logs sees it.
///
/// # Errors
/// [`Error::Floating`] when a coordinate is the pose of a floating body; [`Error::NotFree`] under constraints; [`Error::NoWindow`] when
/// no recording is long enough.
pub fn check(model: &Model, logs: &[Log], options: &Options) -> Result<SmoothingError, Error> {
    refuse_poses(model.mechanics.coordinates(), "a check of its smoothing")?;
    let runs: Vec<&Run> = logs.iter().flat_map(|log| &log.runs).collect();
    let windows: Vec<Window> = places(&runs, options, |_| 0)
        .into_iter()
        .map(|(run, first, count)| Window { run, first, count })
        .collect();
    if windows.is_empty() {
        return Err(Error::NoWindow {
            horizon: options.horizon,
        });
    }
    let hybrid = Hybrid::of(model);
    let theta = hybrid.theta();
    let inputs: Vec<DrivenInputs> = runs
        .iter()
        .map(|run| {
            let substeps = substeps(&run.t, options.longest_step);
            hybrid.drive(&run.t, &run.u, substeps, &theta, &[])
        })
        .collect();
    let states: Vec<Vec<Vec<f64>>> = runs
        .iter()
        .map(|run| initial_states(model, run, options.initial))
        .collect();
    let tasks: Vec<(Window, &[f64])> = windows
        .into_iter()
        .filter_map(|window| {
            let state = states.get(window.run)?.get(window.first)?;
            Some((window, state.as_slice()))
        })
        .collect();
    let noise = audit::audit(model, logs, &[]).observations.noise();
    Ok(compare(&hybrid, &theta, &inputs, &tasks, &noise)?)
}

/// Over these windows with these initial states. `inputs` has one entry a recording; `noise` begins with that of the positions.
pub(crate) fn compare(
    hybrid: &Hybrid,
    theta: &[f64],
    inputs: &[DrivenInputs],
    windows: &[(Window, &[f64])],
    noise: &[f64],
) -> Result<SmoothingError, NotFree> {
    if let Some(inputs) = inputs.first() {
        HybridContacts::new(hybrid, theta, inputs)?;
    }
    // One answer a window, put together in their order: the same bits for any number of threads.
    let apart: Vec<Option<Vec<f64>>> = windows
        .par_iter()
        .map_init(
            || (Roller::new(hybrid, &[]), Trajectory::default()),
            |(roller, smoothed), &(window, initial)| {
                let span = (window.first, window.count);
                let inputs = inputs.get(window.run)?;
                let system = HybridContacts::new(hybrid, theta, inputs).ok()?;
                let system = system.with_compliant_stops();
                let sticking = roll_system(&system, inputs, span, initial).ok()?;
                roller.roll(theta, inputs, span, initial, smoothed).ok()?;
                Some(differences(hybrid, smoothed, &sticking.states))
            },
        )
        .collect();
    let finished: Vec<(Window, &[f64])> = windows
        .iter()
        .zip(&apart)
        .filter_map(|(&(window, _), apart)| Some((window, apart.as_deref()?)))
        .collect();
    let coordinates = hybrid.mechanics().coordinates().iter().zip(noise);
    let sum_up = |(c, (coordinate, &noise)): (usize, (&Coordinate, &f64))| {
        let (rms, largest, starts) = over_windows(&finished, (c, hybrid.nv()), noise);
        Difference {
            name: format!("q.{}", coordinate.name),
            unit: coordinate.unit().into(),
            noise,
            rms,
            largest,
            starts: starts.and_then(|(run, sample)| {
                let grid = &inputs.get(run)?.grid;
                let t = *grid.bounds.get(grid.steps_from(sample).start)?;
                Some(Onset { run, t })
            }),
        }
    };
    Ok(SmoothingError {
        windows: windows.len(),
        stopped: windows.len() - finished.len(),
        coordinates: match finished.is_empty() {
            true => Vec::new(),
            false => coordinates.enumerate().map(sum_up).collect(),
        },
    })
}

/// Smoothed less sticking positions, nv a sample, angles on the circle; without the sample that both start at.
fn differences(hybrid: &Hybrid, smoothed: &Trajectory, sticking: &[Vec<f64>]) -> Vec<f64> {
    let nv = hybrid.nv();
    let coordinates = hybrid.mechanics().coordinates();
    let samples = smoothed.states.chunks_exact(2 * nv).zip(sticking).skip(1);
    samples
        .flat_map(|(a, b)| {
            let positions = a.iter().zip(b).zip(coordinates);
            positions.map(|((a, b), coordinate)| match coordinate.wraps {
                true => wrap_angle(a - b),
                false => a - b,
            })
        })
        .collect()
}

/// Root mean square, the largest and where that one's window begins to differ (run, sample), of coordinate `c` of `nv`.
fn over_windows(
    windows: &[(Window, &[f64])],
    (c, nv): (usize, usize),
    noise: f64,
) -> (f64, f64, Option<(usize, usize)>) {
    let own = |apart: &'_ [f64]| -> Vec<f64> {
        let column = apart.iter().skip(c).step_by(nv);
        column.map(|d| d.abs() / noise).collect()
    };
    let (mut squares, mut count) = (0.0, 0_usize);
    let (mut largest, mut starts) = (0.0, None);
    for (window, apart) in windows {
        let own = own(apart);
        squares += own.iter().map(|d| d * d).sum::<f64>();
        count += own.len();
        let most = own.iter().copied().fold(0.0, f64::max);
        if most > largest {
            largest = most;
            let onset = own.iter().position(|d| *d > NOTICEABLE);
            starts = onset.map(|k| (window.run, window.first + k + 1));
        }
    }
    ((squares / count.max(1) as f64).sqrt(), largest, starts)
}
