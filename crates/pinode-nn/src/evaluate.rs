//! How far free runs get from measurements: errors over many windows of a log, per coordinate, as in the paper.

use rayon::prelude::*;
use serde::Serialize;

use crate::Error;
use crate::entries::refuse_poses;
use crate::free_run::{FreeRun, Initial, LONGEST_STEP, initial_states, longest_step, step_warning};
use crate::hybrid::{DrivenInputs, Hybrid, Reading};
use crate::learnt::{Departure, Guard, Tally, other_intervals};
use crate::log::{Log, Run, typical_interval};
use crate::model::{Model, Velocity};
use crate::past::{States, states_by_the_past};
use crate::shooting::{Trajectory, wrap_angle};
use crate::spread::{Squares, spread};

/// More than so many typical sample intervals between two samples are a gap.
pub(crate) const GAP: f64 = 10.0;
/// What this is called in errors.
pub(crate) const WORK: &str = "an evaluation by free runs";

/// What to evaluate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Length of a window, s.
    pub horizon: f64,
    /// Number of windows, spread evenly over the logs; fewer when there are not so many different ones.
    pub windows: usize,
    /// Initial state of each window.
    pub initial: Initial,
    /// Longest integration step, s.
    pub longest_step: f64,
}

impl Default for Options {
    /// The paper's: 1000 windows of 0.6 s from measured states.
    fn default() -> Self {
        Options {
            horizon: 0.6,
            windows: 1000,
            initial: Initial::Measured,
            longest_step: LONGEST_STEP,
        }
    }
}

/// Errors of free runs, simulated less measured, over all samples of all windows but the first of each.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Length of a window, s.
    pub horizon_s: f64,
    /// Number of windows.
    pub windows: usize,
    /// How many of them diverged; they are not in the errors.
    pub diverged: usize,
    /// Where they start from: `measured`, `estimated` or `past`.
    pub initial: &'static str,
    /// How many start from the measured state after all: too little is measured before them, or the model does not get there.
    pub fallen_back: usize,
    /// Positions, then those velocities that the logs have.
    pub coordinates: Vec<SignalError>,
    /// What should be known of the logs: gaps that no window spans, steps that were not taken as asked for, samples of another rate
    /// than a network knows.
    pub warnings: Vec<String>,
    /// The networks of the model that left what they were trained on in a window, diverged ones too.
    pub left_training: Vec<Departure>,
}

/// The error of one signal.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SignalError {
    /// `q.<joint>` or `v.<joint>`.
    pub name: String,
    /// SI unit of the three errors.
    pub unit: String,
    /// Mean of the absolute error.
    pub mae: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// Standard deviation of the error about its mean.
    pub std: f64,
    /// How far the members of an ensemble are apart, see [`spread`](crate::spread): root mean square over the samples of the windows in which no member
    /// diverged; none without an ensemble.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
}

/// A measured signal.
#[derive(Clone, Copy)]
struct Channel {
    coordinate: usize,
    velocity: bool,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    count: f64,
    sum: f64,
    absolute: f64,
    squares: f64,
}

impl Sums {
    fn add(&mut self, error: f64) {
        self.count += 1.0;
        self.sum += error;
        self.absolute += error.abs();
        self.squares += error * error;
    }
}

/// What is kept of a window.
#[derive(Default)]
struct Rolled {
    /// One a channel; none where it diverged.
    sums: Option<Vec<Sums>>,
    /// One a network.
    seen: Vec<Tally>,
    /// How far the members of an ensemble are apart.
    apart: Squares,
}

/// Runs `model` freely over windows of `logs`. A velocity that the model calls a backward difference is compared with the backward
/// difference of the simulated positions.
///
/// # Errors
/// [`Error::NoWindow`] when no recording is long enough; [`Error::Unfittable`] when every window diverges; [`Error::Overflow`] when
/// the squares of the errors are beyond the range of numbers; [`Error::Floating`] when a coordinate is the pose of a floating body;
/// [`Error::OtherModel`] when a log was read for a model with other coordinates or inputs.
pub fn evaluate(model: &Model, logs: &[Log], options: &Options) -> Result<Evaluation, Error> {
    refuse_others(model, logs)?;
    let runs: Vec<&Run> = logs.iter().flat_map(|log| &log.runs).collect();
    let starts = starts(&runs, options);
    if starts.is_empty() {
        return Err(Error::NoWindow {
            horizon: options.horizon,
        });
    }
    let channels = channels(model, &runs);
    let members: Vec<Hybrid> = match model.has_ensemble() {
        true => model.members().iter().map(Hybrid::of).collect(),
        false => Vec::new(),
    };
    let of_members: Vec<Vec<FreeRun>> = members
        .iter()
        .map(|member| {
            let driven = |run: &&Run| FreeRun::new(member, &run.t, &run.u, options.longest_step);
            runs.iter().map(driven).collect()
        })
        .collect();
    let mut guard = Guard::new(model);
    let begun = beginnings(model, logs, options, &starts);
    let windows = (starts.as_slice(), begun.states.as_slice());
    let windows = over_windows(model, logs, options, windows, |window| {
        let sums = window.arrived.then(|| {
            let mut sums = vec![Sums::default(); channels.len()];
            for (channel, sums) in channels.iter().zip(&mut sums) {
                window.errors(*channel, |error| sums.add(error));
            }
            sums
        });
        let states = window.states.chunks_exact(window.nx);
        let seen = guard.look(window.inputs, window.first, states);
        let free_runs = of_members.iter().filter_map(|runs| runs.get(window.index));
        let apart = member_squares(free_runs, (window.first, window.count), window.initial);
        Rolled { sums, seen, apart }
    });
    let mut sums = Vec::with_capacity(windows.len());
    let mut apart = Squares::default();
    for (window, &(run, ..)) in windows.into_iter().zip(&starts) {
        sums.push(window.sums);
        apart.add(&window.apart);
        guard.add(&runs[run].id, &runs[run].t, window.seen);
    }
    let diverged = sums.iter().filter(|window| window.is_none()).count();
    if diverged == starts.len() {
        return Err(Error::Unfittable {
            diverged,
            windows: starts.len(),
        });
    }
    let mut total = vec![Sums::default(); channels.len()];
    for window in sums.into_iter().flatten() {
        for (total, part) in total.iter_mut().zip(window) {
            total.count += part.count;
            total.sum += part.sum;
            total.absolute += part.absolute;
            total.squares += part.squares;
        }
    }
    let coordinates = model.mechanics.coordinates();
    let nv = model.mechanics.nv();
    let signal = |(channel, sums): (&Channel, &Sums)| {
        let coordinate = coordinates.get(channel.coordinate)?;
        let (mean, square) = (sums.sum / sums.count, sums.squares / sums.count);
        Some(SignalError {
            name: format!(
                "{}.{}",
                if channel.velocity { "v" } else { "q" },
                coordinate.name
            ),
            unit: format!(
                "{}{}",
                coordinate.unit(),
                if channel.velocity { "/s" } else { "" }
            ),
            mae: sums.absolute / sums.count,
            rmse: square.sqrt(),
            std: (square - mean * mean).max(0.0).sqrt(),
            spread: apart.root_mean(channel.coordinate + usize::from(channel.velocity) * nv),
        })
    };
    let errors: Vec<SignalError> = channels.iter().zip(&total).filter_map(signal).collect();
    for (error, channel) in errors.iter().zip(&channels) {
        let numbers = [error.mae, error.rmse, error.std];
        if numbers.iter().any(|x| !x.is_finite()) {
            return Err(overflow(error, *channel, &runs));
        }
    }
    Ok(Evaluation {
        horizon_s: options.horizon,
        windows: starts.len(),
        diverged,
        initial: options.initial.name(),
        fallen_back: begun.fallen_back,
        coordinates: errors,
        warnings: warnings(model, &runs, options),
        left_training: guard.departures(),
    })
}

/// Refuses poses, and logs that were read for another model.
fn refuse_others(model: &Model, logs: &[Log]) -> Result<(), Error> {
    refuse_poses(model.mechanics.coordinates(), WORK)?;
    logs.iter().try_for_each(|log| log.check(model))
}

/// The squares of how far the members of an ensemble are apart in a window; none where one of them diverges.
fn member_squares<'a>(
    free_runs: impl Iterator<Item = &'a FreeRun<'a>>,
    span: (usize, usize),
    initial: &[f64],
) -> Squares {
    let mut rolled = Vec::new();
    let mut trajectory = Trajectory::default();
    for free_run in free_runs {
        let mut roller = free_run.roller();
        if free_run
            .roll(&mut roller, span, initial, &mut trajectory)
            .is_err()
        {
            return Squares::default();
        }
        let states = trajectory.states.chunks_exact(initial.len().max(1));
        rolled.push(states.map(<[f64]>::to_vec).collect::<Vec<_>>());
    }
    let mut squares = Squares::default();
    // The first state of a window is given.
    for deviations in spread(&rolled).iter().skip(1) {
        squares.take(deviations);
    }
    squares
}

/// Names the largest reading of a signal whose errors cannot be summed up.
fn overflow(error: &SignalError, channel: Channel, runs: &[&Run]) -> Error {
    let mut largest = Error::Overflow {
        signal: error.name.clone(),
        run: String::new(),
        sample: 0,
        time: 0.0,
        value: 0.0,
    };
    let mut most = 0.0;
    for run in runs {
        let column = match channel.velocity {
            false => run.q.get(channel.coordinate),
            true => run.v.get(channel.coordinate).and_then(Option::as_ref),
        };
        for (sample, (&value, &time)) in column.into_iter().flatten().zip(&run.t).enumerate() {
            if value.abs() > most {
                most = value.abs();
                largest = Error::Overflow {
                    signal: error.name.clone(),
                    run: run.id.clone(),
                    sample,
                    time,
                    value,
                };
            }
        }
    }
    largest
}

/// Of gaps, steps and samples that are not what they should be.
fn warnings(model: &Model, runs: &[&Run], options: &Options) -> Vec<String> {
    let of_run = |run: &&Run| {
        let spanned = GAP * typical_interval(&run.t).unwrap_or(0.0);
        let taken = longest_step(&run.t, spanned, options.longest_step);
        let steps = step_warning(&run.id, taken, options.longest_step);
        gap_warning(run).into_iter().chain(steps)
    };
    let mut warnings: Vec<String> = runs.iter().flat_map(of_run).collect();
    warnings.extend(other_intervals(model, runs));
    warnings
}

/// How many gaps a recording has, and the longest of them.
fn gap_warning(run: &Run) -> Option<String> {
    let typical = typical_interval(&run.t)?;
    let gaps = run
        .t
        .windows(2)
        .filter(|pair| pair[1] - pair[0] > GAP * typical);
    let count = gaps.clone().count();
    let longest = gaps.max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    Some(format!(
        "run `{}` has {count} {} of more than {GAP} sample intervals, the longest {:.6} s from t = {} s on: no window spans one",
        run.id,
        if count == 1 { "gap" } else { "gaps" },
        longest[1] - longest[0],
        longest[0]
    ))
}

/// All positions, and the velocities that every recording has.
fn channels(model: &Model, runs: &[&Run]) -> Vec<Channel> {
    let n = model.mechanics.nv();
    let channel = |velocity| {
        move |coordinate| Channel {
            coordinate,
            velocity,
        }
    };
    let measured = |c: &usize| {
        runs.iter()
            .all(|run| run.v.get(*c).is_some_and(Option::is_some))
    };
    (0..n)
        .map(channel(false))
        .chain((0..n).filter(measured).map(channel(true)))
        .collect()
}

/// Where a window is: run, first sample, number of samples.
type Place = (usize, usize, usize);

/// The places of the windows: evenly spread over all that are possible. No window spans a gap.
pub(crate) fn starts(runs: &[&Run], options: &Options) -> Vec<Place> {
    let mut possible = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        let Some(typical) = typical_interval(&run.t) else {
            continue;
        };
        let steps = (options.horizon / typical).round().max(1.0);
        if steps >= run.len() as f64 {
            continue;
        }
        let count = steps as usize + 1;
        let mut since_gap = 0; // samples since the last gap, this one included
        for k in 0..run.len() {
            let gap = k > 0 && run.t[k] - run.t[k - 1] > GAP * typical;
            since_gap = if gap { 1 } else { since_gap + 1 };
            if since_gap >= count {
                possible.push((index, k + 1 - count, count));
            }
        }
    }
    let n = options.windows.min(possible.len());
    (0..n)
        .filter_map(|i| possible.get(i * possible.len() / n).copied())
        .collect()
}

/// The states that the windows start from.
fn beginnings(model: &Model, logs: &[Log], options: &Options, starts: &[Place]) -> States {
    if options.initial == Initial::Past {
        let at: Vec<_> = starts.iter().map(|start| (start.0, start.1)).collect();
        return states_by_the_past(model, logs, &at, options);
    }
    let hybrid = Hybrid::of(model);
    let states = |run: &Run| {
        let free_run = FreeRun::new(&hybrid, &run.t, &run.u, options.longest_step);
        free_run.with_hidden(initial_states(model, run, options.initial))
    };
    let runs = logs.iter().flat_map(|log| &log.runs);
    let all: Vec<_> = runs.map(states).collect();
    let one = |&(run, first, _): &Place| all[run][first].clone();
    States {
        states: starts.iter().map(one).collect(),
        fallen_back: 0,
    }
}

/// Every window rolled out from its state, and what `of` makes of it, in their order: the same for any number of threads.
fn over_windows<T: Send>(
    model: &Model,
    logs: &[Log],
    options: &Options,
    (starts, initial): (&[Place], &[Vec<f64>]),
    of: impl Fn(&RolledWindow<'_>) -> T + Sync,
) -> Vec<T> {
    let runs: Vec<&Run> = logs.iter().flat_map(|log| &log.runs).collect();
    let hybrid = Hybrid::of(model);
    let readings = hybrid.readings(&hybrid.theta(), &[]);
    let free_runs: Vec<FreeRun> = runs
        .iter()
        .map(|run| FreeRun::new(&hybrid, &run.t, &run.u, options.longest_step))
        .collect();
    starts
        .par_iter()
        .zip(initial)
        .map_init(
            Trajectory::default,
            |trajectory, (&(index, first, count), initial)| {
                let free_run = &free_runs[index];
                let mut roller = free_run.roller();
                let rolled = free_run.roll(&mut roller, (first, count), initial, trajectory);
                of(&RolledWindow {
                    model,
                    index,
                    run: runs[index],
                    inputs: free_run.inputs(),
                    first,
                    count,
                    initial,
                    nx: hybrid.nx(),
                    arrived: rolled.is_ok(),
                    states: &trajectory.states,
                    readings: &readings,
                })
            },
        )
        .collect()
}

/// A window that has been rolled out.
struct RolledWindow<'a> {
    model: &'a Model,
    /// Its recording.
    index: usize,
    run: &'a Run,
    inputs: &'a DrivenInputs,
    /// Its first sample, and their number.
    first: usize,
    count: usize,
    /// Where it begins.
    initial: &'a [f64],
    /// Whether it has not diverged.
    arrived: bool,
    /// `nx` numbers each, as far as it got.
    nx: usize,
    states: &'a [f64],
    readings: &'a [Reading],
}

impl RolledWindow<'_> {
    /// What the sensor of a channel would read at sample `k` of the window, from the second on: a velocity that is a backward difference of
    /// positions is one.
    fn reads(&self, channel: Channel, k: usize) -> f64 {
        let n = self.model.mechanics.nv();
        let c = channel.coordinate;
        let (reading, places) = (&self.readings[c], (c, n + c));
        let t = &self.run.t[self.first..];
        let position = |k| reading.position(places, self.nx, self.states, t, k).value;
        let velocity = self.model.sensors[c].velocity;
        match channel.velocity {
            false => position(k),
            true if velocity == Velocity::BackwardDifference => {
                (position(k) - position(k - 1)) / (t[k] - t[k - 1])
            }
            true => reading.velocity(places, self.nx, self.states, t, k).value,
        }
    }

    /// Errors of a channel at every sample but the first, simulated less measured.
    fn errors(&self, channel: Channel, mut each: impl FnMut(f64)) {
        let c = channel.coordinate;
        let wraps = self.model.mechanics.coordinates()[c].wraps;
        for k in 1..self.states.len() / self.nx {
            let reads = self.reads(channel, k);
            each(match (channel.velocity, &self.run.v[c]) {
                (true, Some(measured)) => reads - measured[self.first + k],
                _ => {
                    let error = reads - self.run.q[c][self.first + k];
                    if wraps { wrap_angle(error) } else { error }
                }
            });
        }
    }
}

/// The errors themselves behind an [`Evaluation`], one list a signal of [`Evaluation::coordinates`], window after window.
///
/// # Errors
/// As [`evaluate`], but for overflow.
pub fn errors(model: &Model, logs: &[Log], options: &Options) -> Result<Vec<Vec<f64>>, Error> {
    refuse_others(model, logs)?;
    let runs: Vec<&Run> = logs.iter().flat_map(|log| &log.runs).collect();
    let starts = starts(&runs, options);
    let channels = channels(model, &runs);
    let begun = beginnings(model, logs, options, &starts);
    let windows = (starts.as_slice(), begun.states.as_slice());
    let of_window = over_windows(model, logs, options, windows, |window| {
        let list = |channel: &Channel| {
            let mut list = Vec::new();
            if window.arrived {
                window.errors(*channel, |error| list.push(error));
            }
            list
        };
        channels.iter().map(list).collect::<Vec<_>>()
    });
    let mut all = vec![Vec::new(); channels.len()];
    for window in of_window {
        for (all, own) in all.iter_mut().zip(window) {
            all.extend(own);
        }
    }
    match all.first().is_some_and(|errors| !errors.is_empty()) {
        true => Ok(all),
        false => Err(Error::NoWindow {
            horizon: options.horizon,
        }),
    }
}

/// A window as it was measured and as the model has it, from its second sample on.
#[derive(Debug, Clone, PartialEq)]
pub struct RollOut {
    /// Times of the samples, s.
    pub t: Vec<f64>,
    /// The signals of [`Evaluation::coordinates`].
    pub signals: Vec<Signal>,
}

/// One signal of a window.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// What the sensor read.
    pub measured: Vec<f64>,
    /// What it would read of the model, an angle that wraps within half a turn of the measured one; shorter where the model diverges.
    pub simulated: Vec<f64>,
}

/// The roll-outs behind an [`Evaluation`].
///
/// # Errors
/// As [`evaluate`], but for those of diverging windows and overflow.
pub fn roll_outs(model: &Model, logs: &[Log], options: &Options) -> Result<Vec<RollOut>, Error> {
    refuse_others(model, logs)?;
    let runs: Vec<&Run> = logs.iter().flat_map(|log| &log.runs).collect();
    let starts = starts(&runs, options);
    if starts.is_empty() {
        return Err(Error::NoWindow {
            horizon: options.horizon,
        });
    }
    let channels = channels(model, &runs);
    let begun = beginnings(model, logs, options, &starts);
    let windows = (starts.as_slice(), begun.states.as_slice());
    Ok(over_windows(model, logs, options, windows, |window| {
        let samples = window.first + 1..window.first + window.count;
        let signal = |channel: &Channel| {
            let column = match (channel.velocity, &window.run.v[channel.coordinate]) {
                (true, Some(v)) => v,
                _ => &window.run.q[channel.coordinate],
            };
            let wraps = model.mechanics.coordinates()[channel.coordinate].wraps;
            let there = window.states.len() / window.nx;
            let simulated = |k: usize| {
                let (reads, measured) = (window.reads(*channel, k), column[window.first + k]);
                match wraps && !channel.velocity {
                    true => measured + wrap_angle(reads - measured),
                    false => reads,
                }
            };
            Signal {
                measured: column[samples.clone()].to_vec(),
                simulated: (1..there).map(simulated).collect(),
            }
        };
        RollOut {
            t: window.run.t[samples.clone()].to_vec(),
            signals: channels.iter().map(signal).collect(),
        }
    }))
}
