//! Whether what a fitted model leaves follows from anything: any law at all of the present or of the past, known to the library or not.
//!
//! Sensor noise and a push from outside follow from nothing; a law that is missing follows from where the joint is, how it moves, what
//! drives it, or what all this was a moment ago. A general force on a joint, f = Σ c_k φ_k, is a column for each φ_k in the
//! linearisation of the windows. Its coefficients are those of all windows but a fifth, and it counts by what it explains of that
//! fifth: c·e_w − ½ cᵀ D_w c nats in the window w of score e_w and information D_w.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::linear::{AtWindow, Linearisation};
use super::score::{paired, samples_per_window};
use super::study::{Fitted, Study};
use crate::shooting::Window;

/// The windows are set aside in so many parts, one after the other.
const FOLDS: usize = 5;
/// Points of a curve over a signal.
const POINTS: usize = 7;
/// What an input was so many samples ago.
const INPUT_AGO: [usize; 8] = [0, 1, 2, 3, 4, 6, 8, 12];
/// What a velocity was so many samples ago.
const MOTION_AGO: [usize; 3] = [1, 3, 6];
/// Ways after a reversal over which friction builds up, shares of the range of the motion.
const WAYS: [f64; 4] = [0.003, 0.01, 0.03, 0.1];
/// Share of a column's information that is added to it: columns that look alike share what they explain.
const RIDGE: f64 = 1e-3;
/// A law is there when it explains so many nats a sample of what it was not fitted to …
const GAIN: f64 = 0.05;
/// … and so many standard errors.
const SIGNIFICANT: f64 = 4.0;

/// What the input explains is the input's where it is so many times what the motion explains, which follows the input.
const OF_INPUT: f64 = 1.3;

/// A general force that explains what is left.
#[derive(Debug, Clone, PartialEq)]
pub struct Remainder {
    /// The coordinate it acts on.
    pub coordinate: usize,
    /// What it follows.
    pub follows: Follows,
    /// What it explains of windows it was not fitted to, nats.
    pub gain: f64,
    /// The same a sample.
    pub gain_per_sample: f64,
    /// The same over its standard error.
    pub z: f64,
    /// What the best law of where a joint is and how it moves or moved explains, nats.
    pub by_motion: f64,
}

/// What a general force follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Follows {
    /// The velocity of its joint.
    Velocity,
    /// The position of its joint.
    Position,
    /// Its position and direction of motion.
    PositionAndDirection,
    /// The input on its joint.
    Input,
    /// What that input was before.
    PastInput,
    /// How the joint moved before.
    PastMotion,
}

impl Remainder {
    /// Whether friction of any sort may be what is missing: that knows of the input only by what it moves.
    pub fn may_be_friction(&self) -> bool {
        !self.follows.is_of_input() || self.gain < OF_INPUT * self.by_motion
    }
}

impl Follows {
    /// Whether it is the past.
    pub fn is_past(self) -> bool {
        matches!(self, Follows::PastInput | Follows::PastMotion)
    }

    /// Whether it is what drives the joint, now or before.
    pub fn is_of_input(self) -> bool {
        matches!(self, Follows::Input | Follows::PastInput)
    }

    /// In words, of the joint called `joint`.
    pub fn words(self, joint: &str) -> String {
        match self {
            Follows::Velocity => format!("the velocity of `{joint}`"),
            Follows::Position => format!("the position of `{joint}`"),
            Follows::PositionAndDirection => {
                format!("the position of `{joint}` and the direction of its motion")
            }
            Follows::Input => format!("the input on `{joint}`"),
            Follows::PastInput => format!("what the input on `{joint}` was before"),
            Follows::PastMotion => format!("how `{joint}` moved before"),
        }
    }
}

/// General forces of one sort on one coordinate.
struct Group {
    coordinate: usize,
    follows: Follows,
    /// φ_k of every sample of every recording.
    forces: Vec<Vec<Vec<f64>>>,
}

/// The general force that explains most of what `fitted` leaves in the seen windows; `None` where none does significantly.
pub fn remainder(study: &Study, fitted: &Fitted) -> Option<Remainder> {
    let groups = groups(study, fitted);
    let linear = Linearisation::new(study, fitted);
    let columns: Vec<(usize, &Vec<Vec<f64>>)> = groups
        .iter()
        .flat_map(|group| group.forces.iter().map(|force| (group.coordinate, force)))
        .collect();
    let changes = |at: &AtWindow| -> Vec<Vec<f64>> {
        let mut changes = Vec::with_capacity(columns.len());
        for eight in columns.chunks(lagrange::LANES) {
            let along = |runs: &Vec<Vec<f64>>| {
                let Window { run, first, count } = *at.window;
                runs[run][first..first + count - 1].to_vec()
            };
            let forces: Vec<_> = eight.iter().map(|(c, runs)| (*c, along(runs))).collect();
            let mut under = vec![Vec::new(); forces.len()];
            at.steps
                .under_given(at.states, at.inputs, &forces, &mut under);
            changes.extend(
                under
                    .iter()
                    .map(|states| linear.change(at, (&fitted.hybrid, linear.readings()), states)),
            );
        }
        changes
    };
    let mut windows: Vec<(DMatrix<f64>, DVector<f64>)> = Vec::new();
    linear.each_window(columns.len(), changes, |s, g| windows.push((s, g)));
    let (first_s, _) = windows.first()?;
    let n = first_s.nrows() - columns.len();
    let total = windows.iter().fold(
        DMatrix::zeros(first_s.nrows(), first_s.nrows()),
        |sum, (s, _)| sum + s,
    );
    let by_nuisance = linear.by_nuisance(&total);
    let samples = samples_per_window(&fitted.inside);
    let mut best: Option<Remainder> = None;
    let mut by_motion = 0.0_f64;
    let mut place = 0;
    for group in &groups {
        let k = group.forces.len();
        let efficient: Vec<(DMatrix<f64>, DVector<f64>)> = windows
            .iter()
            .map(|(s, g)| {
                let follow = by_nuisance.columns(place, k);
                let s_nn = s.view((0, 0), (n, n));
                let s_nc = s.view((0, n + place), (n, k));
                let s_cc = s.view((n + place, n + place), (k, k));
                let cross = follow.transpose() * s_nc;
                let d = s_cc - &cross - cross.transpose() + follow.transpose() * s_nn * follow;
                let e = g.rows(n + place, k) - follow.transpose() * g.rows(0, n);
                (d, e)
            })
            .collect();
        place += k;
        let gains = gains(&efficient);
        let explained = paired(&gains, &vec![0.0; gains.len()]);
        let gain_per_sample = explained.gain / (explained.windows.max(1) as f64 * samples);
        if !group.follows.is_of_input() {
            by_motion = by_motion.max(explained.gain);
        }
        let counts = gain_per_sample > GAIN && explained.z > SIGNIFICANT;
        if counts && best.as_ref().is_none_or(|best| explained.gain > best.gain) {
            best = Some(Remainder {
                coordinate: group.coordinate,
                follows: group.follows,
                gain: explained.gain,
                gain_per_sample,
                z: explained.z,
                by_motion,
            });
        }
    }
    best.map(|best| Remainder { by_motion, ..best })
}

/// What the coefficients of the other windows explain of each, nats.
fn gains(windows: &[(DMatrix<f64>, DVector<f64>)]) -> Vec<f64> {
    let Some((first, _)) = windows.first() else {
        return Vec::new();
    };
    let k = first.nrows();
    let mut gains = vec![0.0; windows.len()];
    for fold in 0..FOLDS {
        let (mut d, mut b) = (DMatrix::zeros(k, k), DVector::zeros(k));
        for (index, (own, e)) in windows.iter().enumerate() {
            if index % FOLDS != fold {
                d += own;
                b += e;
            }
        }
        // In units of each column's information.
        let scale = DVector::from_fn(k, |i, _| d[(i, i)].max(f64::MIN_POSITIVE).sqrt());
        let unit = DMatrix::from_fn(k, k, |i, j| {
            d[(i, j)] / (scale[i] * scale[j]) + if i == j { RIDGE } else { 0.0 }
        });
        let Some(factor) = Cholesky::new(unit) else {
            continue;
        };
        let c = factor.solve(&b.component_div(&scale)).component_div(&scale);
        for (index, (own, e)) in windows.iter().enumerate() {
            if index % FOLDS == fold {
                gains[index] = c.dot(e) - 0.5 * c.dot(&(own * &c));
            }
        }
    }
    gains
}

/// The general forces on every coordinate that is one number.
fn groups(study: &Study, fitted: &Fitted) -> Vec<Group> {
    let hybrid = &fitted.hybrid;
    let runs = &study.observations.runs;
    let mut groups = Vec::new();
    for (c, coordinate) in hybrid.mechanics().coordinates().iter().enumerate() {
        let of = |columns: fn(&super::smooth::Smoothed) -> &Vec<Vec<f64>>| -> Vec<Vec<f64>> {
            study
                .smoothed
                .iter()
                .map(|s| columns(s)[c].clone())
                .collect()
        };
        let (q, v) = (of(|s| &s.q), of(|s| &s.v));
        let mut push = |follows, forces: Vec<Vec<Vec<f64>>>| {
            groups.push(Group {
                coordinate: c,
                follows,
                forces,
            });
        };
        push(Follows::Velocity, curves(&v, POINTS));
        let places = match coordinate.angular {
            true => (1..=3).flat_map(|k| waves(&q, f64::from(k))).collect(),
            false => curves(&q, POINTS),
        };
        let directed = |force: &Vec<Vec<f64>>| -> Vec<Vec<f64>> {
            let run = |(force, v): (&Vec<f64>, &Vec<f64>)| {
                force.iter().zip(v).map(|(f, v)| f * v.signum()).collect()
            };
            force.iter().zip(&v).map(run).collect()
        };
        let mut both: Vec<Vec<Vec<f64>>> = places.iter().map(directed).collect();
        if coordinate.angular {
            both.push(
                v.iter()
                    .map(|v| v.iter().map(|v| v.signum()).collect())
                    .collect(),
            );
        }
        push(Follows::Position, places);
        push(Follows::PositionAndDirection, both);
        for input in (0..hybrid.inputs()).filter(|i| hybrid.input_coordinates()[*i] == c) {
            let u: Vec<Vec<f64>> = runs.iter().map(|run| run.u[input].clone()).collect();
            push(Follows::Input, curves(&u, POINTS));
            push(
                Follows::PastInput,
                INPUT_AGO.iter().map(|&ago| before(&u, ago)).collect(),
            );
        }
        let range = range(&q);
        let past = WAYS.iter().map(|way| stretched(&q, way * range));
        push(
            Follows::PastMotion,
            past.chain(MOTION_AGO.iter().map(|&ago| before(&v, ago)))
                .collect(),
        );
    }
    groups
}

/// Piecewise linear functions of a signal that are 1 at one of `points` quantiles of it and 0 at the others.
fn curves(signal: &[Vec<f64>], points: usize) -> Vec<Vec<Vec<f64>>> {
    let mut sorted = signal.concat();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| {
        sorted
            .get((share * (sorted.len().max(1) - 1) as f64) as usize)
            .copied()
    };
    let knots: Vec<f64> = (0..points)
        .filter_map(|k| at(0.02 + 0.96 * k as f64 / (points - 1) as f64))
        .collect();
    let mut knots: Vec<f64> = knots;
    knots.dedup();
    let hat = |k: usize, x: f64| -> f64 {
        let x = x.clamp(knots[0], knots[knots.len() - 1]);
        let rise = match k {
            0 => 1.0,
            _ => (x - knots[k - 1]) / (knots[k] - knots[k - 1]),
        };
        let fall = match knots.get(k + 1) {
            None => 1.0,
            Some(next) => (next - x) / (next - knots[k]),
        };
        rise.min(fall).clamp(0.0, 1.0)
    };
    (0..knots.len())
        .map(|k| {
            signal
                .iter()
                .map(|run| run.iter().map(|&x| hat(k, x)).collect())
                .collect()
        })
        .collect()
}

/// cos kq and sin kq.
fn waves(q: &[Vec<f64>], k: f64) -> [Vec<Vec<f64>>; 2] {
    let of = |f: fn(f64) -> f64| {
        q.iter()
            .map(|run| run.iter().map(|&x| f(k * x)).collect())
            .collect()
    };
    [of(f64::cos), of(f64::sin)]
}

/// The signal so many samples ago.
fn before(signal: &[Vec<f64>], ago: usize) -> Vec<Vec<f64>> {
    signal
        .iter()
        .map(|run| (0..run.len()).map(|k| run[k.saturating_sub(ago)]).collect())
        .collect()
}

/// A spring that slips where it is stretched by `way`: z/way, z' = q' held within ± way.
fn stretched(q: &[Vec<f64>], way: f64) -> Vec<Vec<f64>> {
    q.iter()
        .map(|run| {
            let mut z = 0.0_f64;
            let mut last = run.first().copied().unwrap_or(0.0);
            run.iter()
                .map(|&x| {
                    z = (z + x - last).clamp(-way, way);
                    last = x;
                    if way > 0.0 { z / way } else { 0.0 }
                })
                .collect()
        })
        .collect()
}

/// The range that holds nine tenths of a signal.
fn range(signal: &[Vec<f64>]) -> f64 {
    let mut sorted = signal.concat();
    sorted.sort_by(f64::total_cmp);
    let at = |twentieth: usize| {
        sorted
            .get(twentieth * (sorted.len().max(1) - 1) / 20)
            .copied()
            .unwrap_or(0.0)
    };
    at(19) - at(1)
}
