//! The menu: what can be done with the rig that was logged.
//!
//! Every experiment starts at rest where the mechanism hangs still without input, or is let go where it was farthest from there in the
//! log. Its inputs are at most as large as the largest logged one; one input moves at a time, the others are zero.

use std::f64::consts::PI;

use super::super::candidate::Candidate;
use super::super::study::{Fitted, Study};
use super::super::verdict::Payload;
use crate::effect::{Action, Inertial, registry};
use crate::hybrid::{Hybrid, Placed};
use crate::shooting::{Roller, Trajectory, wrap_angle};

/// Parts of the largest logged input that are tried.
const SIZES: [f64; 6] = [1.0, 0.6, 0.35, 0.2, 0.12, 0.07];
/// A chirp goes so many times below and beyond the mean frequency of the log.
const BEYOND: f64 = 4.0;
/// A chirp has at least so many samples a period.
const SAMPLES_A_PERIOD: f64 = 8.0;
/// At most so many coordinates are let go from a displacement.
const MOST_DECAYS: usize = 4;
/// A payload has this part of the mass of its body.
const PAYLOAD: f64 = 0.5;

/// How the rig is set up.
#[derive(Debug, Clone, PartialEq)]
pub enum Setup {
    /// As in the log.
    AsLogged,
    /// The base turned by half a turn about the vertical: what pulls from outside, and the slope it stands on, now go the other way.
    Turned,
    /// So many kg more at the centre of mass of the body with this link.
    Payload(usize, f64),
}

impl Setup {
    /// Whether the base is turned.
    pub fn is_turned(&self) -> bool {
        *self == Setup::Turned
    }

    /// The payload.
    pub fn payload(&self, hybrid: &Hybrid) -> Option<Payload> {
        let &Setup::Payload(link, mass) = self else {
            return None;
        };
        Some(Payload {
            link: hybrid.links().get(link)?.name.clone(),
            mass,
        })
    }

    /// A model set up like this.
    pub fn applied(&self, hybrid: &Hybrid) -> Hybrid {
        let mut hybrid = hybrid.clone();
        if let Setup::Payload(link, mass) = *self
            && loaded(&hybrid, link).is_none()
            && let Some(kind) = registry::find(ADDED_MASS)
        {
            let placed = Placed {
                kind,
                target: link,
                smoothing: 0.0,
                fixed: true,
            };
            hybrid.add(placed, &[mass]);
        }
        hybrid
    }

    /// θ of a model set up like this, from `theta` of the model as logged.
    pub fn constants(&self, applied: &Hybrid, theta: &[f64]) -> Vec<f64> {
        let mut theta = theta.to_vec();
        match *self {
            Setup::AsLogged => {}
            Setup::Turned => {
                for (index, effect) in applied.effects().iter().enumerate() {
                    let candidate = Candidate {
                        kind: effect.kind,
                        target: effect.target,
                    };
                    if is_turned_round(applied, candidate) {
                        theta[applied.range(index)]
                            .iter_mut()
                            .for_each(|x| *x = -*x);
                    }
                }
            }
            Setup::Payload(link, mass) => match loaded(applied, link) {
                Some(known) if known < theta.len() => theta[known] += mass,
                _ => theta.push(mass),
            },
        }
        theta
    }
}

const ADDED_MASS: &str = "added_mass";

/// Where θ has the mass added to the body of `link`.
fn loaded(hybrid: &Hybrid, link: usize) -> Option<usize> {
    let there = |e: &Placed| e.kind.name == ADDED_MASS && e.target == link;
    let index = hybrid.effects().iter().position(there)?;
    Some(hybrid.range(index).start)
}

/// Whether an effect has the other sign on a base that is turned about the vertical: the slope it stands on, and what pulls from outside
/// along a level rail.
fn is_turned_round(hybrid: &Hybrid, Candidate { kind, target }: Candidate) -> bool {
    match kind.name {
        "gravity_tilt" => true,
        "constant_force" => {
            !hybrid.is_angular(kind, target) && hybrid.may_change(Inertial::Tilt, target)
        }
        _ => false,
    }
}

/// Whether more weight changes what an effect does, or what it is confused with.
fn bears_weight(candidate: Candidate) -> bool {
    let named = ["input_gain_error", "load_dependent_friction"];
    matches!(candidate.kind.action, Action::Inertial(_)) || named.contains(&candidate.kind.name)
}

/// The course of an input, in parts of its amplitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// To +1, to −1 and back to 0.
    Triangle,
    /// 0, 1, 0, −1, 0.
    Steps,
    /// Four periods of ±1.
    Square,
    /// From one frequency to another, Hz, exponentially.
    Chirp(f64, f64),
    /// A push each way, and no input after it.
    PushAndCoast,
    /// 1.
    Push,
    /// 0, let go from a displacement of this coordinate.
    Decay(usize),
}

impl Shape {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Shape::Triangle => "slow_triangle",
            Shape::Steps => "steps",
            Shape::Square => "square_wave",
            Shape::Chirp(..) => "chirp",
            Shape::PushAndCoast => "push_and_coast",
            Shape::Push => "constant_push",
            Shape::Decay(_) => "free_decay",
        }
    }

    /// Its length, s at the usual pace.
    fn duration(self) -> f64 {
        match self {
            Shape::Triangle | Shape::Chirp(..) => 8.0,
            Shape::PushAndCoast => 6.0,
            Shape::Decay(_) => 5.0,
            Shape::Steps | Shape::Square | Shape::Push => 4.0,
        }
    }

    /// The part of it that has to lie within the logged reach: a push ends at its end.
    pub fn least_share(self) -> f64 {
        match self {
            Shape::Push => 0.1,
            Shape::Decay(_) => 0.3,
            _ => 0.8,
        }
    }

    /// The value at the time `s` in [0, 1] of its length, `duration` s.
    fn at(self, s: f64, duration: f64) -> f64 {
        match self {
            Shape::Triangle => 2.0 / PI * (2.0 * PI * s).sin().asin(),
            Shape::Steps => [0.0, 1.0, 0.0, -1.0, 0.0][((5.0 * s) as usize).min(4)],
            Shape::Square => [1.0, -1.0][(8.0 * s) as usize % 2],
            Shape::Chirp(from, to) => {
                let growth = (to / from).ln();
                (2.0 * PI * from * duration / growth * (growth * s).exp_m1()).sin()
            }
            Shape::PushAndCoast => match s {
                s if s < 0.1 => 1.0,
                s if (0.5..0.6).contains(&s) => -1.0,
                _ => 0.0,
            },
            Shape::Push => 1.0,
            Shape::Decay(_) => 0.0,
        }
    }
}

/// One experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// How the rig is set up.
    pub setup: Setup,
    /// What is done.
    pub shape: Shape,
    /// With which input; `None`: with none.
    pub input: Option<usize>,
    /// Largest value of the input, of either sign; 0 without one.
    pub amplitude: f64,
    /// What the sensors read at its start, one value a coordinate; everything is at rest.
    pub start: Vec<f64>,
    /// Where it hangs still without input, one value a coordinate.
    pub rest: Vec<f64>,
    /// The inputs, one column each.
    pub u: Vec<Vec<f64>>,
    /// Number of samples.
    pub samples: usize,
    /// Its length, s.
    pub duration: f64,
}

impl Trial {
    /// From `rest`, as logged.
    pub fn new(
        study: &Study,
        inputs: usize,
        (shape, input, amplitude): (Shape, Option<usize>, f64),
        rest: &[f64],
    ) -> Self {
        let duration = shape.duration() * study.pace.times();
        let samples = (duration / study.interval).round() as usize + 1;
        let mut u = vec![vec![0.0; samples]; inputs];
        if let Some(column) = input.and_then(|i| u.get_mut(i)) {
            for (k, value) in column.iter_mut().enumerate() {
                let s = k as f64 / (samples - 1).max(1) as f64;
                *value = amplitude * shape.at(s, duration);
            }
        }
        Trial {
            setup: Setup::AsLogged,
            shape,
            input,
            amplitude,
            start: rest.to_vec(),
            rest: rest.to_vec(),
            u,
            samples,
            duration,
        }
    }

    /// The experiment in words, when it lasts `duration` s.
    pub fn words(&self, hybrid: &Hybrid, inputs: &[String], duration: f64) -> String {
        let own = self.input.and_then(|i| inputs.get(i));
        let input = own.map_or(String::new(), |name| format!("of `{name}`"));
        let size = short(self.amplitude.abs());
        let over = format!("over {} s", short(duration));
        let done = match self.shape {
            Shape::Triangle => {
                format!("a slow triangle {input} between -{size} and {size} {over}")
            }
            Shape::Steps => format!("steps {input} from 0 to {size}, 0, -{size} and 0 {over}"),
            Shape::Square => format!(
                "a square wave {input} between -{size} and {size} with a period of {} s {over}",
                short(self.duration / 4.0)
            ),
            Shape::Chirp(from, to) => format!(
                "a chirp {input} between -{size} and {size} from {} to {} Hz {over}",
                short(from),
                short(to)
            ),
            Shape::PushAndCoast => format!(
                "a push {input} of {size}, one of -{size}, {} s each, and rest without input after either, {over}",
                short(self.duration / 10.0)
            ),
            Shape::Push => {
                let sign = if self.amplitude < 0.0 { "-" } else { "" };
                format!("a constant {sign}{size} {input} for {} s", short(duration))
            }
            Shape::Decay(c) => {
                let coordinate = &hybrid.mechanics().coordinates()[c];
                let from = self.start.get(c).copied().unwrap_or(f64::NAN);
                let (name, unit) = (&coordinate.name, coordinate.unit());
                format!(
                    "letting go at `{name}` = {} {unit} without input {over}",
                    short(from)
                )
            }
        };
        match self.setup {
            Setup::AsLogged => done,
            Setup::Turned => format!("{done}, with the base turned by 180° about the vertical"),
            Setup::Payload(link, mass) => {
                let link = hybrid.links().get(link).map_or("", |l| &l.name);
                format!("{done}, with {} kg more on `{link}`", short(mass))
            }
        }
    }
}

/// All experiments for two candidates on the found model, one of which it has; `rival` is the model with the other. Those of one list
/// differ in the size of the input alone, the largest first.
pub fn menu(
    study: &Study,
    own: &Fitted,
    (a, b): (Candidate, Candidate),
    rival: &Fitted,
) -> Vec<Vec<Trial>> {
    let hybrid = &own.hybrid;
    let rest = rest(study, own);
    let concerned = [a, b].map(|c| hybrid.coordinate_of(c.kind, c.target));
    let mut inputs: Vec<usize> = (0..hybrid.inputs())
        .filter(|&i| concerned.iter().any(|&c| hybrid.moves(i, c)))
        .collect();
    if inputs.is_empty() {
        inputs = (0..hybrid.inputs()).collect();
    }
    let mut trials: Vec<Vec<Trial>> = Vec::new();
    for input in inputs {
        let columns = study.observations.runs.iter().map(|run| &run.u[input]);
        let largest = columns.flatten().fold(0.0_f64, |m, u| m.max(u.abs()));
        if !(largest > 0.0 && largest.is_finite()) {
            continue;
        }
        let chirp = band(study, hybrid.input_coordinates()[input]);
        let shapes = [
            Some(Shape::Triangle),
            Some(Shape::Steps),
            Some(Shape::Square),
            chirp,
            Some(Shape::PushAndCoast),
            Some(Shape::Push),
        ];
        for shape in shapes.into_iter().flatten() {
            let both_ways: &[f64] = match shape {
                Shape::Push => &[1.0, -1.0],
                _ => &[1.0],
            };
            for sign in both_ways {
                let of_size = |size: f64| {
                    let how = (shape, Some(input), sign * rounded(size * largest));
                    Trial::new(study, hybrid.inputs(), how, &rest)
                };
                trials.push(SIZES.map(of_size).to_vec());
            }
        }
    }
    let decays = decays(study, hybrid, concerned, &rest);
    let mut setups = Vec::new();
    if is_turned_round(hybrid, a) || is_turned_round(hybrid, b) {
        setups.push(Setup::Turned);
    }
    if bears_weight(a) || bears_weight(b) {
        setups.extend(payload(hybrid, rival, concerned));
    }
    let quick = |t: &Trial| !matches!(t.shape, Shape::Square | Shape::Chirp(..));
    let changed: Vec<Vec<Trial>> = setups
        .iter()
        .flat_map(|setup| {
            let own = trials.iter().filter(|sizes| sizes.iter().all(quick));
            let own = own.chain(&decays).cloned();
            own.map(|mut sizes| {
                sizes.iter_mut().for_each(|t| t.setup = setup.clone());
                sizes
            })
        })
        .collect();
    trials.extend(decays);
    trials.extend(changed);
    trials
}

/// The chirp for a coordinate: from below the mean frequency of its motion in the log to beyond it.
fn band(study: &Study, c: usize) -> Option<Shape> {
    let squares = |of: fn(&super::super::smooth::Smoothed) -> &Vec<Vec<f64>>| -> f64 {
        let columns = study.smoothed.iter().flat_map(|s| of(s).get(c));
        columns.flatten().map(|x| x * x).sum()
    };
    let mean = (squares(|s| &s.a) / squares(|s| &s.v)).sqrt() / (2.0 * PI);
    let highest = 1.0 / (SAMPLES_A_PERIOD * study.interval);
    let (from, to) = (mean / BEYOND, (BEYOND * mean).min(highest));
    let is_band = from > 0.0 && to > 1.5 * from && to.is_finite();
    is_band.then(|| Shape::Chirp(rounded(from), rounded(to)))
}

/// More weight on the body that a concerned coordinate moves.
fn payload(hybrid: &Hybrid, rival: &Fitted, concerned: [usize; 2]) -> Option<Setup> {
    let kind = registry::find(ADDED_MASS)?;
    let may = |link: &usize| {
        concerned.contains(&hybrid.coordinate_of(kind, *link))
            && hybrid.may_change(Inertial::PointMass, *link)
            && rival.hybrid.may_change(Inertial::PointMass, *link)
    };
    let link = (0..hybrid.links().len()).find(may)?;
    let mass = PAYLOAD * hybrid.mass_of_body(link)?;
    Some(Setup::Payload(link, rounded(mass)))
}

/// Free decays from the places farthest from rest in the log, to both sides, of the concerned coordinates first.
fn decays(study: &Study, hybrid: &Hybrid, concerned: [usize; 2], rest: &[f64]) -> Vec<Vec<Trial>> {
    let coordinates = hybrid.mechanics().coordinates();
    let mut order: Vec<usize> = (0..coordinates.len()).collect();
    order.sort_by_key(|c| !concerned.contains(c));
    let mut trials = Vec::new();
    for &c in order.iter().take(MOST_DECAYS) {
        let away = |q: f64| match coordinates[c].wraps {
            true => wrap_angle(q - rest[c]),
            false => q - rest[c],
        };
        for side in [1.0, -1.0] {
            let mut farthest: Option<(f64, usize, usize)> = None;
            for (run, smoothed) in study.smoothed.iter().enumerate() {
                for (k, &q) in smoothed.q[c].iter().enumerate() {
                    let far = side * away(q);
                    if far > farthest.map_or(0.0, |f| f.0) {
                        farthest = Some((far, run, k));
                    }
                }
            }
            let Some((_, run, k)) = farthest else {
                continue;
            };
            let how = (Shape::Decay(c), None, 0.0);
            let mut trial = Trial::new(study, hybrid.inputs(), how, rest);
            let state = study.smoothed[run].state(k);
            for (i, start) in trial.start.iter_mut().enumerate() {
                *start = match coordinates[i].wraps {
                    true => rest[i] + wrap_angle(state[i] - rest[i]),
                    false => state[i],
                };
            }
            trials.push(vec![trial]);
        }
    }
    trials
}

/// Where the mechanism comes to rest without input, from the middle of the log: the found model with much viscous friction, followed for a
/// while. What goes far from the middle is put there.
fn rest(study: &Study, own: &Fitted) -> Vec<f64> {
    let coordinates = own.hybrid.mechanics().coordinates();
    let nv = own.hybrid.nv();
    let bound = own.hybrid.mechanics().constraints().is_some();
    // Under constraints only a logged configuration is known to be one.
    let middle: Vec<f64> = match bound {
        false => study.scales.iter().map(|s| s.centre).collect(),
        true => slowest(study),
    };
    let settled = settled(study, own, &middle).unwrap_or_else(|| middle.clone());
    if bound {
        return settled;
    }
    (0..nv)
        .map(|c| {
            let scales = &study.scales[c];
            let far = (settled[c] - scales.centre).abs() > 0.5 * scales.reach;
            match far && !coordinates[c].wraps {
                true => middle[c],
                false => settled[c],
            }
        })
        .collect()
}

/// The positions at the logged sample with the least speed, each coordinate in units of its usual one.
fn slowest(study: &Study) -> Vec<f64> {
    let mut best = (f64::INFINITY, 0, 0);
    for (run, smoothed) in study.smoothed.iter().enumerate() {
        for k in 0..smoothed.v.first().map_or(0, Vec::len) {
            let columns = smoothed.v.iter().zip(study.scales.iter());
            let speed: f64 = columns.map(|(v, s)| (v[k] / s.speed).powi(2)).sum();
            if speed < best.0 {
                best = (speed, run, k);
            }
        }
    }
    let mut state = study.smoothed[best.1].state(best.2);
    state.truncate(study.scales.len());
    state
}

/// So many seconds the mechanism has to settle, at the usual pace.
const SETTLING: f64 = 10.0;
/// The rate of its damping, 1/s, in the same unit.
const DAMPING: f64 = 10.0;

fn settled(study: &Study, own: &Fitted, from: &[f64]) -> Option<Vec<f64>> {
    let nv = own.hybrid.nv();
    let pace = study.pace.times();
    let viscous = registry::find("viscous_friction")?;
    let mut hybrid = own.hybrid.clone();
    let mut theta = own.inside.theta.clone();
    for (target, scales) in study.scales.iter().enumerate() {
        let coefficient = DAMPING / pace * scales.mass;
        let placed = Placed {
            kind: viscous,
            target,
            smoothing: 0.0,
            fixed: true,
        };
        hybrid.add(placed, &[coefficient]);
        theta.push(coefficient);
    }
    let count = (SETTLING * pace / study.interval).round() as usize + 2;
    let t: Vec<f64> = (0..count).map(|k| k as f64 * study.interval).collect();
    let substeps = study.substeps_anywhere(&hybrid, &theta);
    let inputs = hybrid.drive(
        &t,
        &vec![vec![0.0; count]; hybrid.inputs()],
        substeps,
        &theta,
        &[],
    );
    let mut start = from.to_vec();
    start.resize(2 * nv, 0.0);
    start.extend(hybrid.hidden_start(&vec![0.0; nv], &theta, &inputs, 0));
    let mut out = Trajectory::default();
    Roller::new(&hybrid, &[])
        .roll(&theta, &inputs, (0, count), &start, &mut out)
        .ok()?;
    let last = out.states.chunks_exact(hybrid.nx()).last()?;
    Some(last[..nv].to_vec())
}

/// To two digits, towards zero: an input as one sets it.
fn rounded(x: f64) -> f64 {
    let unit = 10f64.powf(x.abs().log10().floor() - 1.0);
    // A digit that is nearly full is full: 0.3 is no 0.29.
    let digits = (x / unit + 1e-9).trunc();
    short(digits * unit).parse().unwrap_or(x)
}

/// Three digits, without zeros at the end.
pub fn short(x: f64) -> String {
    let rounded: f64 = format!("{x:.2e}").parse().unwrap_or(x);
    rounded.to_string()
}
