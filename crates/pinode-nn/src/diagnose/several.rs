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

use super::candidate::Candidate;
use super::needed::Needed;
use super::screen::{Column, columns};
use super::selection::Regression;
use super::study::{Fitted, Study};
use crate::effect::{Family, Kind};
use crate::hybrid::{ConstantId, Hybrid};

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
    let theta = current.as_said();
    let rows = Needed::of(study);
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

/// What the free constants of the model change, each in units of its tolerance, or of itself, and which of them are held by a tolerance.
fn of_constants(
    rows: &Needed,
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
    rows: &Needed,
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
