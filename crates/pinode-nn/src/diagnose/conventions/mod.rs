//! Whether a log counts as the model does. A coordinate that counts the other way round, begins elsewhere, is in degrees or millimetres or stands under
//! another's name is no missing effect, and none explains it.
//!
//! Some short windows of the log are read in every such way, and the model as given is fitted to them a little. What it leaves of each coordinate,
//!
//! share = √(⟨(q − q̂)²⟩ − noise²) / √⟨(q − line)²⟩,
//!
//! in the median of the windows, compares it with the straight line through each: it has no unit, and needs to know nothing of the sensor. A model that lacks an
//! effect leaves a few hundredths; one that is told the wrong sign a good part of the motion.

mod reading;
#[cfg(test)]
mod tests;

use std::borrow::Cow;

use rayon::prelude::*;

use self::reading::{Change, Reading, Signal, changes, mappings, name, read, words};
use super::setup::{COARSEST_STEP, STIFF_STEP, WINDOW_S, dominant_frequency};
use super::smooth::{polynomial, smooth, unwrapped};
use super::verdict::DataFault;
use crate::Error;
use crate::effect::registry;
use crate::hybrid::{Hybrid, Placed};
use crate::log::{ColumnMap, Log, Run};
use crate::model::Model;
use crate::model::log_columns::value;
use crate::poses::Poses;
use crate::shooting::{
    Channel, FitOptions, HiddenPrior, Observations, ObservedRun, Window, consecutive, fit,
};

/// So many windows are looked at, and no fewer.
const WINDOWS: usize = 12;
const FEWEST_WINDOWS: usize = 4;
/// Iterations of a fit, of the initial states and of all.
const ITERATIONS: (usize, usize) = (3, 4);
/// What is left of the straight line's error is explained well enough, …
const WELL: f64 = 0.15;
/// … where that is more than so many times the noise.
const MOVES: f64 = 10.0;
/// A share of less than this is none.
const NONE: f64 = 0.02;
/// Another way to read a log has to leave so much less of all coordinates together, …
const LESS: f64 = 4.0;
/// … of none more than this factor, …
const NO_MORE: f64 = 1.3;
/// … and of what it reads otherwise no more than this.
const MOST_LEFT: f64 = 0.3;
/// Two ways are as good within this factor.
const AS_GOOD: f64 = 1.5;
/// Two changes at once are tried where that is no more than so many fits.
const MOST_PAIRS: usize = 400;
/// Of what does not need it.
const SMOOTHING: f64 = 0.01;
/// A third difference of noise has so many times its variance.
const THIRD: f64 = 20.0;
/// Standard deviation of a normal distribution over its median size.
const FROM_MEDIAN: f64 = 1.4826;

/// A model and its logs, read as they are meant.
pub struct AsMeant<'a> {
    /// The model, with `[log.columns]` that say so.
    pub model: Cow<'a, Model>,
    /// The logs.
    pub logs: Cow<'a, [Log]>,
    /// Those that no fit may see.
    pub held_out: Cow<'a, [Log]>,
    /// What they count otherwise, one a signal.
    pub faults: Vec<DataFault>,
}

/// The logs as they are meant: as they are, unless the model explains them far better where they are read otherwise.
///
/// # Errors
/// Those of [`Model::with_columns`].
pub fn as_meant<'a>(
    model: &'a Model,
    logs: &'a [Log],
    held_out: &'a [Log],
    report: &dyn Fn(&str),
) -> Result<AsMeant<'a>, Error> {
    let found = Looking::new(model, logs).and_then(|looking| looking.otherwise(report));
    let (Some(found), Some(first)) = (found, logs.first()) else {
        return Ok(AsMeant {
            model: Cow::Borrowed(model),
            logs: Cow::Borrowed(logs),
            held_out: Cow::Borrowed(held_out),
            faults: Vec::new(),
        });
    };
    let own = first.columns(model);
    let of_reading = |reading: &Reading| mappings(reading, model, (first, &own));
    let columns: Vec<_> = found.readings.iter().flat_map(of_reading).collect();
    let again = |logs: &[Log]| -> Vec<Log> {
        let mut logs = logs.to_vec();
        for log in &mut logs {
            let runs = log.runs.iter().map(|run| read(&found.readings, run));
            log.runs = runs.collect();
        }
        logs
    };
    Ok(AsMeant {
        faults: found.faults(model, (first, &own)),
        logs: Cow::Owned(again(logs)),
        held_out: Cow::Owned(again(held_out)),
        model: Cow::Owned(model.with_columns(&columns)?),
    })
}

/// Another way to read a log.
struct Otherwise {
    readings: Vec<Reading>,
    /// The largest share that the model leaves of a coordinate with the log as it is, and so.
    shares: [f64; 2],
    /// What explains it as well.
    others: Vec<Vec<Reading>>,
}

impl Otherwise {
    fn faults(&self, model: &Model, log: (&Log, &ColumnMap)) -> Vec<DataFault> {
        let all = |readings: &[Reading]| {
            let said: Vec<String> = readings.iter().map(|r| words(r, model)).collect();
            said.join(", ")
        };
        let others: Vec<String> = self.others.iter().map(|other| all(other)).collect();
        let or = match others.is_empty() {
            true => String::new(),
            false => format!("; or else, as well: {}", others.join("; or ")),
        };
        let fault = |reading: &Reading| {
            let written = mappings(reading, model, log);
            let written = written.iter();
            let written = written.map(|m| format!("`\"{}\" = {}`", m.signal, value(m)));
            let written: Vec<String> = written.collect();
            let [before, after] = self.shares.map(|share| 100.0 * share);
            DataFault {
                kind: CONVENTION.into(),
                column: name(reading, model),
                when: Vec::new(),
                detail: format!(
                    "{}: read as it is meant, the model leaves {after:.1} % of the motion in short windows at most, and {before:.0} % as it is{or}; it is \
                     read so here, by [log.columns] of the new model: {}",
                    words(reading, model),
                    written.join(" and ")
                ),
            }
        };
        self.readings.iter().map(fault).collect()
    }
}

/// The kind of these faults.
pub const CONVENTION: &str = "convention";

/// What is looked at.
struct Looking<'a> {
    model: &'a Model,
    hybrid: Hybrid,
    /// The windows, a recording each.
    windows: Vec<Run>,
    /// Half width of the smoothing, s.
    half_width: f64,
    substeps: usize,
    /// Which coordinates move.
    moving: Vec<bool>,
    /// How far each goes in the log.
    ranges: Vec<f64>,
}

impl<'a> Looking<'a> {
    /// `None` where there is too little to look at, and where columns are of poses.
    fn new(model: &'a Model, logs: &[Log]) -> Option<Self> {
        let coordinates = model.mechanics.coordinates();
        if Poses::of(model).is_some() || coordinates.iter().any(|c| c.floating) {
            return None;
        }
        let hybrid = rubbing(model);
        let runs = logs.iter().flat_map(|log| &log.runs);
        let observations = Observations {
            channels: channels(coordinates.len(), |_| (false, 0.0)),
            runs: runs.map(observed).collect(),
        };
        let nv = coordinates.len();
        let frequency = (0..nv).map(|c| dominant_frequency(&observations, c));
        let frequency = frequency.fold(0.0, f64::max);
        let length = WINDOW_S.min(5.0 / frequency);
        let observations = observations.thinned(length / 60.0);
        let coarsest = match hybrid.is_stiff() {
            true => STIFF_STEP,
            false => COARSEST_STEP,
        };
        let interval = observations.typical_interval();
        let all = observations.runs.iter().enumerate();
        let all: Vec<Window> = all
            .flat_map(|(run, observed)| consecutive(run, &observed.t, length))
            .filter(|window| window.count >= 6)
            .collect();
        let cut = |window: &Window| {
            let run = &observations.runs[window.run];
            let part = |x: &Vec<f64>| x[window.first..window.first + window.count].to_vec();
            Run {
                id: String::new(),
                t: part(&run.t),
                q: run.y.iter().map(part).collect(),
                v: vec![None; nv],
                u: run.u.iter().map(part).collect(),
            }
        };
        let all: Vec<Run> = all.iter().map(cut).collect();
        // Jumps by a turn are no motion; nor are they there in degrees.
        let motion = |run: &Run, c: usize| {
            let wrapping = unwrapped(&run.q[c]);
            [&run.q[c], &wrapping].map(|y| (off_line(&run.t, y), scatter(y)))
        };
        let moves = |c: usize| {
            let of_runs = || all.iter().map(|run| motion(run, c));
            let moves = |k: usize| {
                let size = median(of_runs().map(|m| m[k].0));
                size > MOVES * median(of_runs().map(|m| m[k].1))
            };
            moves(0) || (coordinates[c].angular && moves(1))
        };
        let range = |c: usize| {
            let q = || {
                logs.iter()
                    .flat_map(|log| &log.runs)
                    .flat_map(|run| &run.q[c])
            };
            q().fold(f64::NEG_INFINITY, |a, b| a.max(*b))
                - q().fold(f64::INFINITY, |a, b| a.min(*b))
        };
        // Windows in which nothing happens tell nothing: the half with more motion, evenly.
        let liveliness = |run: &Run| -> f64 { (0..nv).map(|c| motion(run, c)[0].0).sum() };
        let typical = median(all.iter().map(liveliness));
        let lively: Vec<&Run> = all
            .iter()
            .filter(|run| liveliness(run) >= typical)
            .collect();
        let count = lively.len().min(WINDOWS);
        (count >= FEWEST_WINDOWS).then(|| Looking {
            windows: (0..count)
                .map(|k| lively[k * lively.len() / count].clone())
                .collect(),
            half_width: 0.06_f64.min(0.15 / frequency),
            substeps: ((interval / coarsest).ceil() as usize).max(1),
            moving: (0..nv).map(moves).collect(),
            ranges: (0..nv).map(range).collect(),
            hybrid,
            model,
        })
    }

    /// How the log is to be read where the model explains it far better so.
    fn otherwise(&self, report: &dyn Fn(&str)) -> Option<Otherwise> {
        let given = self.shares(&[]);
        if self.worst(&given) < WELL {
            return None;
        }
        report("asking whether the log counts as the model does");
        let singles = changes(self.model, &self.ranges);
        let (mut readings, mut left): (Vec<Reading>, Vec<f64>) = (Vec::new(), given.clone());
        let mut others = Vec::new();
        while self.worst(&left) > WELL {
            let with = |change: &Change| -> Vec<Reading> { [&readings[..], change].concat() };
            let mut tried = self.tried(singles.iter().map(with).collect());
            let helps = |tried: &[Tried]| tried.iter().any(|t| self.explains_more(&left, t));
            let pairs = singles.len() * singles.len() / 2;
            if readings.is_empty() && !helps(&tried) && pairs <= MOST_PAIRS {
                let pair = |(k, first): (usize, &Change)| {
                    let rest = singles[..k].iter();
                    let pair: Vec<Change> =
                        rest.map(|second| [&first[..], second].concat()).collect();
                    pair
                };
                tried = self.tried(singles.iter().enumerate().flat_map(pair).collect());
            }
            tried.retain(|t| self.explains_more(&left, t));
            let score = |t: &Tried| self.score(&t.left);
            let least = tried.iter().map(score).fold(f64::INFINITY, f64::min);
            tried.retain(|t| score(t) < least + AS_GOOD.ln());
            // An input that acts the other way round is an effect, which the search finds.
            let is_reversed = |r: &Reading| matches!(r.signal, Signal::Input(_)) && r.scale < 0.0;
            if tried.iter().any(|t| t.readings.iter().all(is_reversed)) {
                return None;
            }
            let Some(best) = tried.first().cloned() else {
                break;
            };
            others = tried.drain(1..).map(|t| t.readings).collect();
            (readings, left) = (best.readings, best.left);
        }
        if readings.is_empty() {
            return None;
        }
        Some(Otherwise {
            shares: [self.worst(&given), self.worst(&left)],
            readings,
            others,
        })
    }

    /// What the model leaves where the log is read in these ways, each signal in one only.
    fn tried(&self, ways: Vec<Vec<Reading>>) -> Vec<Tried> {
        let once = |readings: &Vec<Reading>| {
            let mut rest = readings.iter().enumerate();
            rest.all(|(k, r)| readings[..k].iter().all(|other| other.signal != r.signal))
        };
        let ways: Vec<Vec<Reading>> = ways.into_iter().filter(once).collect();
        let ways = ways.into_par_iter().map(|readings| Tried {
            left: self.shares(&readings),
            readings,
        });
        ways.collect()
    }

    /// Whether the log read in another way is explained far better.
    fn explains_more(&self, before: &[f64], tried: &Tried) -> bool {
        let moving = || (0..before.len()).filter(|&c| self.moving[c]);
        let read = |r: &Reading| match r.signal {
            Signal::Coordinate(c) => !self.moving[c] || tried.left[c] < MOST_LEFT,
            Signal::Input(_) => true,
        };
        self.score(&tried.left) < self.score(before) - LESS.ln()
            && moving().all(|c| tried.left[c] <= NO_MORE * before[c] + NONE)
            && tried.readings.iter().all(read)
    }

    /// Σ ln share over the coordinates that move.
    fn score(&self, shares: &[f64]) -> f64 {
        let moving = shares.iter().zip(&self.moving).filter(|(_, moves)| **moves);
        moving.map(|(share, _)| (share + NONE).ln()).sum()
    }

    /// The largest share of a coordinate that moves.
    fn worst(&self, shares: &[f64]) -> f64 {
        let moving = shares.iter().zip(&self.moving).filter(|(_, moves)| **moves);
        moving.map(|(share, _)| *share).fold(0.0, f64::max)
    }

    /// What the model leaves of each coordinate where the log is read so, over what the straight line does. Infinite where roll-outs diverge.
    fn shares(&self, readings: &[Reading]) -> Vec<f64> {
        let hybrid = &self.hybrid;
        let wraps = hybrid.wraps();
        let windows = self.windows.iter().map(|run| read(readings, run));
        let windows: Vec<Run> = windows.collect();
        let sizes: Vec<[f64; 2]> = (0..wraps.len())
            .map(|c| {
                let unfolded = |run: &Run| match wraps[c] {
                    true => unwrapped(&run.q[c]),
                    false => run.q[c].clone(),
                };
                let sizes = windows.iter().map(|run| off_line(&run.t, &unfolded(run)));
                let scatters = windows.iter().map(|run| scatter(&unfolded(run)));
                [median(sizes).max(f64::MIN_POSITIVE), median(scatters)]
            })
            .collect();
        let observations = Observations {
            channels: channels(wraps.len(), |c| (wraps[c], NONE * sizes[c][0])),
            runs: windows.iter().map(observed).collect(),
        };
        let theta = hybrid.theta();
        let start = |run: &ObservedRun| {
            let mut state = smooth(run, &wraps, self.half_width).state(0);
            hybrid.keep_before_stops(&theta, &mut state);
            state.resize(hybrid.nx(), 0.0);
            state
        };
        let starts: Vec<Vec<f64>> = observations.runs.iter().map(start).collect();
        let hidden = HiddenPrior::kept(&starts, hybrid.nx() - hybrid.nh());
        let spans: Vec<Window> = (0..windows.len())
            .map(|run| Window {
                run,
                first: 0,
                count: windows[run].len(),
            })
            .collect();
        let fitted = fit(
            hybrid,
            &observations,
            &spans,
            &hybrid.free(),
            theta,
            starts,
            observations.noise(),
            &hidden,
            &FitOptions {
                substeps: self.substeps,
                state_iterations: ITERATIONS.0,
                iterations: ITERATIONS.1,
            },
        );
        let of_coordinate = |(c, [size, scatter]): (usize, &[f64; 2])| {
            let squares = fitted.squares.iter().map(|of_window| of_window[c]);
            let squares = median(squares.map(|(sum, n)| sum / n.max(1) as f64));
            (squares - scatter * scatter).max(0.0).sqrt() / size
        };
        sizes.iter().enumerate().map(of_coordinate).collect()
    }
}

/// The model with a viscous friction on every coordinate that has none: most machines have some, and what they do of it must not blur the comparison.
fn rubbing(model: &Model) -> Hybrid {
    let mut hybrid = Hybrid::of(model);
    let Some(kind) = registry::find("viscous_friction") else {
        return hybrid;
    };
    for target in 0..hybrid.nv() {
        let has_some = |e: &Placed| e.kind == kind && e.target == target && !e.fixed;
        if !hybrid.effects().iter().any(has_some) {
            let placed = Placed {
                kind,
                target,
                smoothing: SMOOTHING,
                fixed: false,
            };
            hybrid.add(placed, &[0.0]);
        }
    }
    hybrid
}

/// What is left where a log is read so.
#[derive(Clone)]
struct Tried {
    readings: Vec<Reading>,
    left: Vec<f64>,
}

fn observed(run: &Run) -> ObservedRun {
    ObservedRun {
        t: run.t.clone(),
        u: run.u.clone(),
        valid: run.q.iter().map(|q| vec![true; q.len()]).collect(),
        y: run.q.clone(),
    }
}

/// The positions of `nv` coordinates; of each whether it wraps, and its noise.
fn channels(nv: usize, of: impl Fn(usize) -> (bool, f64)) -> Vec<Channel> {
    let channel = |coordinate| {
        let (wraps, noise) = of(coordinate);
        Channel {
            coordinate,
            velocity: false,
            wraps,
            noise,
        }
    };
    (0..nv).map(channel).collect()
}

/// Root mean square distance from the straight line through a window.
fn off_line(t: &[f64], y: &[f64]) -> f64 {
    let (Some(&t0), Some(&y0)) = (t.first(), y.first()) else {
        return 0.0;
    };
    let points = || t.iter().zip(y).map(|(t, y)| (t - t0, y - y0));
    let Some(line) = polynomial::<2>(points()) else {
        return 0.0;
    };
    let squares = points().map(|(t, y)| (y - line[0] - line[1] * t).powi(2));
    (squares.sum::<f64>() / t.len() as f64).sqrt()
}

/// The noise that third differences show at most: in them nothing is left of a motion that is slow beside the samples.
fn scatter(y: &[f64]) -> f64 {
    let third = y.windows(4).map(|y| y[3] - 3.0 * y[2] + 3.0 * y[1] - y[0]);
    FROM_MEDIAN * median(third.map(f64::abs)) / THIRD.sqrt()
}

/// Infinite where more than half of the numbers are no number; 0 of none.
fn median(x: impl Iterator<Item = f64>) -> f64 {
    let mut x: Vec<f64> = x
        .map(|x| if x.is_nan() { f64::INFINITY } else { x })
        .collect();
    x.sort_by(f64::total_cmp);
    x.get(x.len() / 2).copied().unwrap_or(0.0)
}
