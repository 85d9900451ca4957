//! What a model leaves of some short windows of a log that are read in some way.

use std::f64::consts::PI;
use std::ops::Range;

use super::reading::{Reading, Signal, read};
use crate::diagnose::audit::{Readings, median, noise};
use crate::diagnose::pace::Pace;
use crate::diagnose::smooth::{polynomial, smooth, unwrapped};
use crate::diagnose::study::MOST_SUBSTEPS;
use crate::effect::{ActsOn, Kind, registry};
use crate::hybrid::{Hybrid, Placed};
use crate::log::{Log, Run};
use crate::model::Model;
use crate::poses::Poses;
use crate::shooting::{
    Channel, Finer, Fit, FitOptions, HiddenPrior, Observations, ObservedRun, Window, consecutive,
    fit,
};

/// So many windows are looked at, and no fewer, …
const WINDOWS: usize = 12;
const FEWEST_WINDOWS: usize = 4;
/// … of about so many samples at most, and no fewer: the noise takes seven readings to see.
const SAMPLES: f64 = 60.0;
const FEWEST_SAMPLES: usize = 8;
/// Iterations of a fit, of the initial states and of all.
const ITERATIONS: (usize, usize) = (3, 4);
/// The same where a constant of each coordinate is asked for.
const ITERATIONS_OF_EACH: (usize, usize) = (3, 12);
/// A coordinate moves where it is off a straight line by so many times its noise.
const MOVES: f64 = 10.0;
/// A coordinate that is read as one number is off its line by what rounding leaves of it.
const STILL: f64 = 1e-12;
/// √⟨e²⟩ of an error e that is anywhere within a turn, ±π: what wraps is never further off, however far it moves.
const ANYWHERE: f64 = PI / 1.732_050_807_568_877_2;
/// A share of less than this is none.
pub const NONE: f64 = 0.02;
/// Of friction that is no sign change.
const SMOOTHING: f64 = 0.01;

/// Some short windows of a log, and the model that is compared with them.
pub struct Windows {
    hybrid: Hybrid,
    wraps: Vec<bool>,
    /// A recording each.
    runs: Vec<Run>,
    /// Half width of the smoothing, s.
    half_width: f64,
    substeps: usize,
    /// Which coordinates move.
    moving: Vec<bool>,
}

impl Windows {
    /// `None` where there is too little to look at, and where columns are of poses.
    pub fn of(model: &Model, logs: &[Log]) -> Option<Self> {
        Self::at_most(WINDOWS, model, logs)
    }

    /// The same, of no more than so many windows.
    pub fn at_most(windows: usize, model: &Model, logs: &[Log]) -> Option<Self> {
        let coordinates = model.mechanics.coordinates();
        if Poses::of(model).is_some() || coordinates.iter().any(|c| c.floating) {
            return None;
        }
        let nv = coordinates.len();
        let logged = logs.iter().flat_map(|log| &log.runs);
        let observations = Observations {
            channels: channels(nv, |_| (false, 0.0)),
            runs: logged.map(observed).collect(),
        };
        let lively = |pace: &Pace| {
            let observations = observations.clone().thinned(pace.window() / SAMPLES);
            let interval = observations.typical_interval();
            (lively(&observations, pace.window()), interval)
        };
        let enough = |(lively, _): &(Vec<Run>, f64)| lively.len() >= FEWEST_WINDOWS;
        let pace = Pace::of(&observations);
        let interval = observations.typical_interval();
        let (pace, (lively, interval)) = pace.shortened(interval, lively, enough);
        let hybrid = usual(model, &pace);
        let substeps = pace.first_steps(interval, hybrid.is_stiff());
        let count = lively.len().min(windows);
        let taken = (0..count).map(|k| lively[k * lively.len() / count].clone());
        let runs: Vec<Run> = taken.collect();
        // Jumps by a turn are no motion; nor are they there in degrees.
        let moves = |c: usize| {
            let of = |wraps: bool| Sizes::of(&runs, c, wraps);
            let off = |sizes: Sizes| {
                sizes.off_line > MOVES * sizes.noise && sizes.off_line > STILL * sizes.largest
            };
            off(of(false)) || (coordinates[c].angular && off(of(true)))
        };
        let moving = (0..nv).map(moves).collect();
        (count >= FEWEST_WINDOWS).then(|| Windows {
            moving,
            half_width: pace.half_width(),
            substeps,
            wraps: hybrid.wraps(),
            hybrid,
            runs,
        })
    }

    /// What the model leaves of each coordinate where the log is read so, over what the straight line does. Infinite where roll-outs diverge.
    pub fn shares(&self, readings: &[Reading]) -> Vec<f64> {
        self.left(&self.hybrid, readings, &self.hybrid.free(), ITERATIONS)
    }

    /// The same where the initial states alone are fitted.
    pub fn shares_by_states(&self, readings: &[Reading]) -> Vec<f64> {
        self.left(&self.hybrid, readings, &[], (ITERATIONS.0, 0))
    }

    fn left(
        &self,
        hybrid: &Hybrid,
        readings: &[Reading],
        free: &[usize],
        iterations: (usize, usize),
    ) -> Vec<f64> {
        let (fitted, sizes) = self.fitted(hybrid, readings, free, iterations);
        let of_coordinate = |(c, sizes): (usize, &Sizes)| {
            let squares = fitted.squares.iter().map(|of_window| of_window[c]);
            let square = middle(squares.map(|(sum, n)| sum / n.max(1) as f64));
            let left = (square - sizes.noise * sizes.noise).max(0.0).sqrt();
            let most = match self.wraps[c] {
                true => ANYWHERE,
                false => f64::INFINITY,
            };
            left / sizes.off_line.min(most)
        };
        sizes.iter().enumerate().map(of_coordinate).collect()
    }

    /// The zeros of the sensors in these windows, and their standard errors; those that the windows do not tell have infinite ones.
    pub fn zeros(&self) -> Vec<(f64, f64)> {
        let (hybrid, own) = self.with_on_each("sensor_offset");
        let free = hybrid.free();
        let (fitted, _) = self.fitted(&hybrid, &[], &free, ITERATIONS_OF_EACH);
        let errors = fitted.standard_errors();
        let of = |(c, index): (usize, usize)| {
            let error = free.iter().zip(&errors).find(|(i, _)| **i == index);
            let told = error.filter(|_| self.moves(c));
            (fitted.theta[index], told.map_or(f64::INFINITY, |(_, e)| *e))
        };
        own.enumerate().map(of).collect()
    }

    /// Σ ln share where each sensor has a zero, and where a force is on each coordinate instead.
    pub fn by_zeros_or_forces(&self) -> [f64; 2] {
        ["sensor_offset", "constant_force"].map(|kind| {
            let (hybrid, _) = self.with_on_each(kind);
            self.score(&self.left(&hybrid, &[], &hybrid.free(), ITERATIONS_OF_EACH))
        })
    }

    /// The model with an effect of a kind that has one constant on each coordinate, and the places of these constants.
    fn with_on_each(&self, kind: &str) -> (Hybrid, Range<usize>) {
        let mut hybrid = self.hybrid.clone();
        let first = hybrid.theta().len();
        if let Some(kind) = registry::find(kind) {
            (0..self.wraps.len()).for_each(|target| hybrid.add(placed(kind, target), &[0.0]));
        }
        let own = first..hybrid.theta().len();
        (hybrid, own)
    }

    /// The model fitted to the windows, read so: the initial states alone at first, and then with what is free; and the sizes of the coordinates.
    fn fitted(
        &self,
        hybrid: &Hybrid,
        readings: &[Reading],
        free: &[usize],
        (alone, all): (usize, usize),
    ) -> (Fit, Vec<Sizes>) {
        let second = second(readings);
        let runs = self.runs.iter().map(|run| read(readings, run));
        let runs: Vec<Run> = runs.collect();
        let sizes = self.wraps.iter().enumerate();
        let sizes: Vec<Sizes> = sizes
            .map(|(c, wraps)| Sizes::of(&runs, c, *wraps))
            .collect();
        // What stands still says nothing, however exactly.
        let noise = |sizes: &Sizes| match sizes.off_line > STILL * sizes.largest {
            true => NONE * sizes.off_line,
            false => 1.0,
        };
        let of_channel = |c: usize| (self.wraps[c], noise(&sizes[c]));
        let observations = Observations {
            channels: channels(self.wraps.len(), of_channel),
            runs: runs.iter().map(observed).collect(),
        };
        let theta = hybrid.theta();
        let start = |run: &ObservedRun| {
            let mut state = smooth(run, &self.wraps, second * self.half_width).state(0);
            hybrid.keep_before_stops(&theta, &mut state);
            state.resize(hybrid.nx(), 0.0);
            state
        };
        let starts: Vec<Vec<f64>> = observations.runs.iter().map(start).collect();
        let hidden = HiddenPrior::kept(&starts, hybrid.nx() - hybrid.nh());
        let whole = |(run, of): (usize, &Run)| Window {
            run,
            first: 0,
            count: of.len(),
        };
        let spans: Vec<Window> = runs.iter().enumerate().map(whole).collect();
        let fitted = fit(
            hybrid,
            &observations,
            &spans,
            free,
            theta,
            starts,
            observations.noise(),
            &hidden,
            &FitOptions {
                substeps: (second * self.substeps as f64)
                    .ceil()
                    .clamp(1.0, MOST_SUBSTEPS as f64) as usize,
                state_iterations: alone,
                iterations: all,
            },
        );
        (fitted, sizes)
    }

    /// The windows' samples, read so and smoothed, and half the smoothing apart: closer ones say much the same. Those near an end have too little around them.
    pub fn smoothed(&self, readings: &[Reading]) -> Vec<Sample> {
        let half_width = second(readings) * self.half_width;
        let mut samples = Vec::new();
        for run in self.runs.iter().map(|run| read(readings, run)) {
            let smoothed = smooth(&observed(&run), &self.wraps, half_width);
            let near = |k: usize| {
                let from = run.t.partition_point(|t| *t < run.t[k] - half_width);
                from..run.t.partition_point(|t| *t <= run.t[k] + half_width)
            };
            let at = |columns: &[Vec<f64>], k: usize| columns.iter().map(|c| c[k]).collect();
            let (Some(first), Some(last)) = (run.t.first(), run.t.last()) else {
                continue;
            };
            let mut next = first + 0.5 * half_width;
            for k in 0..run.t.len() {
                if run.t[k] < next || run.t[k] > last - 0.5 * half_width {
                    continue;
                }
                next = run.t[k] + 0.5 * half_width;
                let mean = |u: &Vec<f64>| u[near(k)].iter().sum::<f64>() / near(k).len() as f64;
                samples.push(Sample {
                    q: at(&smoothed.q, k),
                    v: at(&smoothed.v, k),
                    a: at(&smoothed.a, k),
                    u: run.u.iter().map(mean).collect(),
                });
            }
        }
        samples
    }

    /// The model that is compared with them.
    pub fn hybrid(&self) -> &Hybrid {
        &self.hybrid
    }

    /// Whether a coordinate moves.
    pub fn moves(&self, coordinate: usize) -> bool {
        self.moving[coordinate]
    }

    /// Σ ln share over the coordinates that move.
    pub fn score(&self, shares: &[f64]) -> f64 {
        let moving = shares.iter().zip(&self.moving).filter(|(_, moves)| **moves);
        moving.map(|(share, _)| (share + NONE).ln()).sum()
    }

    /// The largest share of a coordinate that moves.
    pub fn worst(&self, shares: &[f64]) -> f64 {
        let moving = shares.iter().zip(&self.moving).filter(|(_, moves)| **moves);
        moving.map(|(share, _)| *share).fold(0.0, f64::max)
    }
}

/// A sample of a smoothed recording.
pub struct Sample {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub a: Vec<f64>,
    /// The inputs, smoothed as the accelerations are.
    pub u: Vec<f64>,
}

/// How long a second of the log is where it is read so, s.
fn second(readings: &[Reading]) -> f64 {
    let time = readings.iter().find(|r| r.signal == Signal::Time);
    time.map_or(1.0, |time| time.scale)
}

/// The sizes of a coordinate in the windows.
struct Sizes {
    /// How far it is off the straight line, in the median.
    off_line: f64,
    noise: f64,
    /// The largest reading.
    largest: f64,
}

impl Sizes {
    fn of(runs: &[Run], coordinate: usize, wraps: bool) -> Self {
        let unfolded = |run: &Run| match wraps {
            true => unwrapped(&run.q[coordinate]),
            false => run.q[coordinate].clone(),
        };
        let columns: Vec<Vec<f64>> = runs.iter().map(unfolded).collect();
        let of_runs = || runs.iter().zip(&columns);
        let readings: Vec<Readings> = of_runs()
            .map(|(run, y)| Readings { t: &run.t, y })
            .collect();
        let off_line = middle(of_runs().map(|(run, y)| off_line(&run.t, y)));
        Sizes {
            off_line: off_line.max(f64::MIN_POSITIVE),
            noise: noise(&readings),
            largest: columns
                .iter()
                .flatten()
                .fold(f64::MIN_POSITIVE, |a, x| a.max(x.abs())),
        }
    }
}

/// The windows of this length in which something happens, a recording each: the half with more motion.
fn lively(observations: &Observations, length: f64) -> Vec<Run> {
    let all = cut(observations, length);
    let off = |run: &Run| -> f64 { run.q.iter().map(|q| off_line(&run.t, q)).sum() };
    let motion: Vec<f64> = all.iter().map(off).collect();
    let typical = middle(motion.iter().copied());
    let all = all.into_iter().zip(motion);
    let lively = all.filter(|(_, off)| *off >= typical);
    lively.map(|(run, _)| run).collect()
}

/// The windows of this length, a recording each.
fn cut(observations: &Observations, length: f64) -> Vec<Run> {
    let all = observations.runs.iter().enumerate();
    let all = all.flat_map(|(run, observed)| consecutive(run, &observed.t, length));
    let long = all.filter(|window| window.count >= FEWEST_SAMPLES);
    let cut = |window: Window| {
        let run = &observations.runs[window.run];
        let part = |x: &Vec<f64>| x[window.first..window.first + window.count].to_vec();
        Run {
            id: String::new(),
            t: part(&run.t),
            q: run.y.iter().map(part).collect(),
            v: vec![None; run.y.len()],
            u: run.u.iter().map(part).collect(),
        }
    };
    long.map(cut).collect()
}

/// What is free beside the model as given: most machines have some friction, and some are late; what these do must not blur the comparison.
const USUAL: [&str; 3] = ["viscous_friction", "coulomb_friction", "input_delay"];

/// The model with a viscous and a dry friction on every coordinate that has none, and a delay of every input that has none.
fn usual(model: &Model, pace: &Pace) -> Hybrid {
    let mut hybrid = Hybrid::at_pace(model, pace.times(), &[]);
    for kind in USUAL.iter().filter_map(|name| registry::find(name)) {
        let targets = match kind.acts_on() {
            ActsOn::Input => hybrid.inputs(),
            _ => hybrid.nv(),
        };
        for target in 0..targets {
            let has_some = |e: &Placed| e.kind == kind && e.target == target && !e.fixed;
            if !hybrid.effects().iter().any(has_some) {
                hybrid.add(placed(kind, target), &[0.0]);
            }
        }
    }
    hybrid
}

fn placed(kind: &'static Kind, target: usize) -> Placed {
    Placed {
        kind,
        target,
        smoothing: SMOOTHING,
        fixed: false,
    }
}

fn observed(run: &Run) -> ObservedRun {
    ObservedRun {
        finer: Finer::default(),
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

/// The median; infinite where more than half of the numbers are none.
fn middle(x: impl Iterator<Item = f64>) -> f64 {
    let number = |x: f64| if x.is_nan() { f64::INFINITY } else { x };
    median(&mut x.map(number).collect::<Vec<f64>>())
}
