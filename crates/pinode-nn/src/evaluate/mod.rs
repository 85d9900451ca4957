//! How far free runs get from measurements: errors over many windows of a log, per coordinate, as in the paper.

mod ensemble;
mod windows;

use serde::Serialize;

pub(crate) use self::ensemble::{Deviation, deviations};
use self::ensemble::{Driven, members};
pub(crate) use self::windows::{Channel, places};
use self::windows::{Windows, whole_horizon};
use crate::Error;
use crate::band::Width;
use crate::free_run::{Initial, LONGEST_STEP, longest_step, step_warning};
use crate::learnt::{Departure, Guard, Tally, other_intervals};
use crate::log::{Log, Run, typical_interval};
use crate::model::Model;
use crate::shooting::wrap_angle;
use crate::spread::Squares;

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
    /// Share of those samples whose error is within the [band](crate::band) of the model; none where it has none of this signal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub within_band: Option<f64>,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    count: f64,
    sum: f64,
    absolute: f64,
    squares: f64,
    /// Samples within the band, of how many.
    within: (usize, usize),
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
    let windows = Windows::new(model, logs, options, |_| 0)?;
    let Windows {
        runs,
        places,
        channels,
        ..
    } = &windows;
    let members = members(model);
    let driven = Driven::new(&members, runs, options.longest_step);
    let nv = model.mechanics.nv();
    let widths: Vec<Option<Width>> = (channels.iter())
        .map(|channel| model.band.as_ref()?.of(*channel).copied())
        .collect();
    let mut guard = Guard::new(model);
    let rolled = windows.roll_out(|window| {
        let apart = driven.apart(window);
        let of_channel = |(channel, width): (&Channel, &Option<Width>)| {
            let mut sums = Sums::default();
            window.errors(*channel, |k, error| {
                sums.add(error);
                if let (Some(width), Some(apart)) = (width, apart.get(k - 1)) {
                    let half = width.half(apart[channel.entry(nv)], window.since(k));
                    sums.within.0 += usize::from(error.abs() <= half);
                    sums.within.1 += 1;
                }
            });
            sums
        };
        let channels = channels.iter().zip(&widths);
        let sums = window.arrived.then(|| channels.map(of_channel).collect());
        let states = window.states.chunks_exact(window.nx);
        let seen = guard.look(window.inputs, window.first, states);
        let mut squares = Squares::default();
        apart.iter().for_each(|deviations| squares.take(deviations));
        Rolled {
            sums,
            seen,
            apart: squares,
        }
    });
    let mut sums = Vec::with_capacity(rolled.len());
    let mut apart = Squares::default();
    for (window, &(run, ..)) in rolled.into_iter().zip(places) {
        sums.push(window.sums);
        apart.add(&window.apart);
        guard.add(&runs[run].id, &runs[run].t, window.seen);
    }
    let diverged = sums.iter().filter(|window| window.is_none()).count();
    if diverged == places.len() {
        return Err(Error::Unfittable {
            diverged,
            windows: places.len(),
        });
    }
    let mut total = vec![Sums::default(); channels.len()];
    for window in sums.into_iter().flatten() {
        for (total, part) in total.iter_mut().zip(window) {
            total.count += part.count;
            total.sum += part.sum;
            total.absolute += part.absolute;
            total.squares += part.squares;
            total.within.0 += part.within.0;
            total.within.1 += part.within.1;
        }
    }
    let coordinates = model.mechanics.coordinates();
    let signal = |(channel, sums): (&Channel, &Sums)| {
        let coordinate = coordinates.get(channel.coordinate)?;
        let (mean, square) = (sums.sum / sums.count, sums.squares / sums.count);
        Some(SignalError {
            name: channel.name(model),
            unit: format!(
                "{}{}",
                coordinate.unit(),
                if channel.velocity { "/s" } else { "" }
            ),
            mae: sums.absolute / sums.count,
            rmse: square.sqrt(),
            std: (square - mean * mean).max(0.0).sqrt(),
            spread: apart.root_mean(channel.entry(nv)),
            within_band: (sums.within.1 > 0).then(|| sums.within.0 as f64 / sums.within.1 as f64),
        })
    };
    let errors: Vec<SignalError> = channels.iter().zip(&total).filter_map(signal).collect();
    for (error, channel) in errors.iter().zip(channels) {
        let numbers = [error.mae, error.rmse, error.std];
        if numbers.iter().any(|x| !x.is_finite()) {
            return Err(overflow(error, *channel, runs));
        }
    }
    Ok(Evaluation {
        horizon_s: horizon(runs, places, options),
        windows: places.len(),
        diverged,
        initial: options.initial.name(),
        fallen_back: windows.fallen_back(),
        coordinates: errors,
        warnings: warnings(model, runs, options),
        left_training: guard.departures(),
    })
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
        let horizon = horizon_warning(run, options.horizon);
        gap_warning(run).into_iter().chain(steps).chain(horizon)
    };
    let mut warnings: Vec<String> = runs.iter().flat_map(of_run).collect();
    warnings.extend(other_intervals(model, runs));
    warnings
}

/// How long the windows are, s, the longest of several recordings.
fn horizon(runs: &[&Run], places: &[(usize, usize, usize)], options: &Options) -> f64 {
    let mut used: Vec<usize> = places.iter().map(|place| place.0).collect();
    used.dedup();
    let own = used.iter().filter_map(|&run| runs.get(run));
    let lengths = own.filter_map(|run| whole_horizon(run, options.horizon));
    let longest = lengths.fold(f64::NAN, f64::max);
    if longest.is_nan() {
        options.horizon
    } else {
        longest
    }
}

/// Where windows are of another length than was asked for.
fn horizon_warning(run: &Run, asked: f64) -> Option<String> {
    let taken = whole_horizon(run, asked).filter(|taken| *taken != asked)?;
    Some(format!(
        "run `{}`: windows are {taken:.6} s long, not {asked} s: they are of whole sample intervals",
        run.id
    ))
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

/// The errors themselves behind an [`Evaluation`], one list a signal of [`Evaluation::coordinates`], window after window.
///
/// # Errors
/// As [`evaluate`], but for overflow.
pub fn errors(model: &Model, logs: &[Log], options: &Options) -> Result<Vec<Vec<f64>>, Error> {
    let windows = Windows::new(model, logs, options, |_| 0)?;
    let channels = &windows.channels;
    let of_window = windows.roll_out(|window| {
        let list = |channel: &Channel| {
            let mut list = Vec::new();
            if window.arrived {
                window.errors(*channel, |_, error| list.push(error));
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
    let windows = Windows::new(model, logs, options, |_| 0)?;
    Ok(windows.roll_out(|window| {
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
            signals: windows.channels.iter().map(signal).collect(),
        }
    }))
}
