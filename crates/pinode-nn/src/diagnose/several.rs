//! Several laws at once, from the forces that are needed and not modelled.
//!
//! A machine that nobody has identified lacks friction on every joint, and has other masses besides. The roll-outs of a model that lacks all of it are so far from the
//! log that their linearisation promises more to a stand-in than to any part of the truth. Inverse dynamics need no roll-outs: at the smoothed states of the log
//!
//! v̇ − v̇_model = Σ x_i (v̇_i − v̇_model) + noise, v̇_i the acceleration with a step into candidate i,
//!
//! is linear in the steps x_i however large they are (Khalil and Dombre, *Modeling, Identification and Control of Robots*, 2002, ch. 12). The set of candidates
//! is [selected](super::selection). Its noise is high and its smoothed velocities are biased: what comes of it is where
//! a fit starts, and nothing is accepted for it.

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

/// Whether a law is one constant times a shape that the log shows.
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

/// Laws that explain the accelerations of the seen windows together. `None` where they are on one coordinate: one by itself is what a screen sees, and two may be
/// one law with more constants.
pub fn several(study: &Study, current: &Fitted) -> Option<Several> {
    let hybrid = &current.hybrid;
    let fit = &current.inside;
    let constants = hybrid.constants();
    let said = constants.iter().zip(&fit.theta);
    let theta: Vec<f64> = said
        .map(|(constant, &fitted)| match constant.tolerance.is_finite() {
            true => constant.value,
            false => fitted,
        })
        .collect();
    let rows = Rows::of(study);
    let before = rows.accelerations(hybrid, &theta);
    let change = |with: &Hybrid, at: &[f64], step: f64| -> DVector<f64> {
        (rows.accelerations(with, at) - &before) / step
    };
    // What is free is free beside them: in units of its tolerance, or of itself.
    let moved = |&i: &usize| {
        let constant = &constants[i];
        let unit = match constant.tolerance.is_finite() {
            true => constant.tolerance,
            false => theta[i].abs(),
        };
        let is_read = matches!(constant.id, ConstantId::Zero(_));
        (!is_read && unit > 0.0).then(|| {
            let mut at = theta.clone();
            at[i] += STEP * unit;
            let held = f64::from(u8::from(constant.tolerance.is_finite()));
            (change(hybrid, &at, STEP), held)
        })
    };
    let (free, held): (Vec<DVector<f64>>, Vec<f64>) = fit.free.par_iter().filter_map(moved).unzip();
    let asked: Vec<Column> = columns(study, (hybrid, &theta), is_linear);
    let (asked, changes): (Vec<Column>, Vec<DVector<f64>>) = asked
        .into_par_iter()
        .filter_map(|column| {
            let (with, at) = column.candidate.place(hybrid, &theta, &column.perturbed);
            let change = change(&with, &at, 1.0);
            (change.norm_squared() > 0.0 && change.norm_squared().is_finite())
                .then_some((column, change))
        })
        .unzip();
    let needed = rows.measured(study) - &before;
    let mut regression = Regression::of(&needed, free.iter().chain(&changes), held);
    let allowed = |k: usize, x: f64| asked[k].start(x).is_some();
    let chosen = regression.choose(MOST * hybrid.nv(), &allowed);
    let start = |&(k, x): &(usize, f64)| Some((asked[k].candidate, asked[k].start(x)?));
    let laws: Vec<_> = chosen.iter().filter_map(start).collect();
    let coordinates = || {
        let of = |(c, _): &(Candidate, Vec<f64>)| hybrid.coordinate_of(c.kind, c.target);
        laws.iter().map(of)
    };
    (coordinates().min() != coordinates().max()).then_some(Several { theta, laws })
}

/// The samples that count, recording by recording, and the scale of their accelerations.
struct Rows<'a> {
    study: &'a Study,
    runs: Vec<(Seen, Vec<usize>)>,
}

impl<'a> Rows<'a> {
    /// Those whose polynomials lie in the seen windows.
    fn of(study: &'a Study) -> Self {
        let runs = study.observations.runs.iter().enumerate();
        let seen = |(r, run): (usize, &ObservedRun)| {
            let seen = Seen::of(&run.t, study.pace.half_width());
            let windows = study.windows.fit.iter().filter(|w| w.run == r);
            let samples = windows.flat_map(|w| {
                let inside = (0..w.count).step_by(seen.stride);
                let inside = inside.filter(|&k| seen.reaches(k, w.count));
                inside.map(|k| w.first + k).collect::<Vec<_>>()
            });
            let samples = samples.collect();
            (seen, samples)
        };
        let runs = runs.map(seen).collect();
        Rows { study, runs }
    }

    /// What `acceleration` of a recording gives at each of its samples, in units of its noise.
    fn gather(
        &self,
        acceleration: impl Fn(usize, &Seen, &[usize]) -> Vec<Vec<f64>>,
    ) -> DVector<f64> {
        let channels = &self.study.observations.channels;
        let runs = self.runs.iter().enumerate();
        let all = runs.flat_map(|(r, (seen, samples))| {
            let scaled = |a: Vec<f64>| -> Vec<f64> {
                let scale = channels.iter().map(|c| c.noise * seen.noise);
                a.into_iter().zip(scale).map(|(a, s)| a / s).collect()
            };
            let at = acceleration(r, seen, samples).into_iter();
            at.flat_map(scaled).collect::<Vec<f64>>()
        });
        DVector::from_vec(all.collect())
    }

    /// Those of a model, as the smoothing sees them.
    fn accelerations(&self, hybrid: &Hybrid, theta: &[f64]) -> DVector<f64> {
        self.gather(|r, seen, samples| {
            let run = &self.study.observations.runs[r];
            let modelled = modelled((hybrid, theta), run, &self.study.smoothed[r]);
            let samples = samples.iter();
            samples.map(|&k| seen.averaged(&modelled, k)).collect()
        })
    }

    /// Those of the log.
    fn measured(&self, study: &Study) -> DVector<f64> {
        self.gather(|r, _, samples| {
            let a = &study.smoothed[r].a;
            let at = |&k: &usize| a.iter().map(|a| a[k]).collect();
            samples.iter().map(at).collect()
        })
    }
}
