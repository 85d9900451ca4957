//! Several laws at once, from the forces that are needed and not modelled.
//!
//! A machine that nobody has identified lacks friction on every joint, and has other masses besides. The roll-outs of a model that lacks all of it are so far from the
//! log that their linearisation promises more to a stand-in than to any part of the truth. Inverse dynamics need no roll-outs: at the smoothed states of the log
//!
//! v̇ − v̇_model = Σ x_i (v̇_i − v̇_model) + noise, v̇_i the acceleration with a step into candidate i,
//!
//! is linear in forces however large they are, and to first order in all else. Of forces, M v̇ + C v + G = Q, it would be linear in inertias too (Khalil and Dombre,
//! *Modeling, Identification and Control of Robots*, 2002, ch. 12); but nothing explains those as well as no mass and no input, where gains and masses are free. The set
//! of candidates is [selected](super::selection). The noise is high and the smoothed velocities are biased: what comes of it is where a fit starts, and nothing is
//! accepted for it.

use nalgebra::DVector;
use rayon::prelude::*;

use super::accelerations::{Seen, modelled};
use super::candidate::Candidate;
use super::screen::{Column, columns};
use super::selection::Regression;
use super::study::{Fitted, Study};
use crate::effect::{Family, Kind};
use crate::hybrid::{ConstantId, Hybrid};
use crate::shooting::ObservedRun;

/// At most so many laws a coordinate.
const MOST: usize = 4;
/// A constant of the mechanism is moved by this part of its tolerance, or of itself, to see what it does.
const STEP: f64 = 1e-3;

/// Whether a law has one constant, and acts as it is large or nearly so.
fn is_linear(kind: &Kind) -> bool {
    let by_itself = kind.parameters.len() == 1 && kind.contains.is_empty();
    by_itself && kind.states() == 0 && kind.family != Family::Sensor && !kind.starts_at_probes()
}

/// Laws that are missing together.
pub struct Several {
    /// θ of the model without them: as that says it is, where it says anything.
    pub theta: Vec<f64>,
    /// The laws, each with the constant that it has beside the others.
    pub laws: Vec<(Candidate, Vec<f64>)>,
}

/// Laws that explain the accelerations of the seen windows together. `None` where there are none, or all are on one coordinate: one by itself is what a screen sees, and
/// two may be one law with more constants.
pub fn several(study: &Study, current: &Fitted) -> Option<Several> {
    let hybrid = &current.hybrid;
    let theta = as_said(current);
    let rows = Rows::of(study);
    let needed = rows.missing(hybrid, &theta);
    let (mut changes, held) = of_constants(&rows, current, (&theta, &needed));
    let (asked, of_laws) = of_laws(&rows, hybrid, (&theta, &needed));
    changes.extend(of_laws);
    let regression = Regression::of(&needed, &changes, &held)?;
    // Each once, however many probes it has, and within its bounds.
    let allowed = |columns: &[usize], steps: &[f64]| {
        let mut all = columns.iter().zip(steps).enumerate();
        all.all(|(n, (&k, &x))| {
            let is_new = |&other: &usize| asked[other].candidate != asked[k].candidate;
            columns[..n].iter().all(is_new) && asked[k].unclamped(x).is_some()
        })
    };
    let chosen = regression.choose(MOST * hybrid.nv(), &allowed);
    let start = |&(k, x): &(usize, f64)| Some((asked[k].candidate, asked[k].unclamped(x)?));
    let laws: Vec<_> = chosen.iter().filter_map(start).collect();
    let coordinates = || {
        let of = |(c, _): &(Candidate, Vec<f64>)| hybrid.coordinate_of(c.kind, c.target);
        laws.iter().map(of)
    };
    (coordinates().min() != coordinates().max()).then_some(Several { theta, laws })
}

/// θ as the model says it is; as it was fitted where that says nothing.
fn as_said(current: &Fitted) -> Vec<f64> {
    let constants = current.hybrid.constants().iter();
    let both = constants.zip(&current.inside.theta);
    both.map(|(constant, &fitted)| match constant.tolerance.is_finite() {
        true => constant.value,
        false => fitted,
    })
    .collect()
}

/// What the free constants of the model change, each in units of its tolerance, or of itself, and which of them are held by a tolerance.
fn of_constants(
    rows: &Rows,
    current: &Fitted,
    (theta, needed): (&[f64], &DVector<f64>),
) -> (Vec<DVector<f64>>, Vec<bool>) {
    let hybrid = &current.hybrid;
    let change = |&i: &usize| {
        let constant = &hybrid.constants()[i];
        let is_held = constant.tolerance.is_finite();
        let unit = match is_held {
            true => constant.tolerance,
            false => theta[i].abs(),
        };
        if matches!(constant.id, ConstantId::Zero(_)) || unit <= 0.0 {
            return None;
        }
        let mut at = theta.to_vec();
        at[i] += STEP * unit;
        let change = (needed - rows.missing(hybrid, &at)) / STEP;
        shows(&change).then_some((change, is_held))
    };
    let free = current.inside.free.par_iter();
    free.filter_map(change).unzip()
}

/// The probes of the candidates, and what each changes.
fn of_laws(
    rows: &Rows,
    hybrid: &Hybrid,
    (theta, needed): (&[f64], &DVector<f64>),
) -> (Vec<Column>, Vec<DVector<f64>>) {
    let asked = columns(rows.study, (hybrid, theta), is_linear).into_par_iter();
    let change = |column: Column| {
        let (with, at) = column.candidate.place(hybrid, theta, &column.perturbed);
        let change = needed - rows.missing(&with, &at);
        shows(&change).then_some((column, change))
    };
    asked.filter_map(change).unzip()
}

/// Whether a change is one, and finite.
fn shows(change: &DVector<f64>) -> bool {
    let square = change.norm_squared();
    square > 0.0 && square.is_finite()
}

/// The samples that count, recording by recording.
struct Rows<'a> {
    study: &'a Study,
    runs: Vec<(Seen, Vec<usize>)>,
}

impl<'a> Rows<'a> {
    /// Those whose polynomials lie in a seen window, with nothing in them that is not valid.
    fn of(study: &'a Study) -> Self {
        let runs = study.observations.runs.iter().enumerate();
        let of = |(r, run): (usize, &ObservedRun)| {
            let seen = Seen::of(&run.t, study.pace.half_width());
            let windows = study.windows.fit.iter().filter(|w| w.run == r);
            let samples = windows.flat_map(|w| {
                let inside = (0..w.count).step_by(seen.stride);
                let inside = inside.filter(|&k| seen.reaches(k, w.count));
                inside.map(|k| w.first + k).collect::<Vec<_>>()
            });
            let is_valid = |&k: &usize| {
                let mut channels = run.valid.iter();
                channels.all(|valid| valid[seen.samples(k)].iter().all(|valid| *valid))
            };
            let samples = samples.filter(is_valid).collect();
            (seen, samples)
        };
        let runs = runs.map(of).collect();
        Rows { study, runs }
    }

    /// v̇ − v̇ of a model at θ, in units of the noise of a smoothed acceleration.
    fn missing(&self, hybrid: &Hybrid, theta: &[f64]) -> DVector<f64> {
        let mut all = Vec::new();
        for (r, (seen, samples)) in self.runs.iter().enumerate() {
            let (run, smooth) = (&self.study.observations.runs[r], &self.study.smoothed[r]);
            let modelled = modelled((hybrid, theta), run, smooth);
            for &k in samples {
                let model = seen.averaged(&modelled, k).into_iter();
                let noise = self.study.observations.channels.iter().map(|c| c.noise);
                let missing = smooth.a.iter().zip(model).map(|(a, model)| a[k] - model);
                all.extend(
                    missing
                        .zip(noise)
                        .map(|(a, noise)| a / (noise * seen.noise)),
                );
            }
        }
        DVector::from_vec(all)
    }
}
