//! What the part that is held out contradicts: a name for what the seen windows lack whose constant is another one there.

use super::candidate::Candidate;
use super::comparison::Lack;
use super::refine::{Contender, ITERATIONS};
use super::search::Search;
use super::study::{Fitted, Study};
use crate::effect::ParameterSpec;

/// A constant is another one where it differs by so many standard errors of both, and by this part of the larger.
const ANOTHER: f64 = 4.0;
const WORTH_TELLING: f64 = 0.1;

/// A name with a constant that is another one in the windows held out.
pub struct Elsewhere {
    /// The name.
    pub candidate: Candidate,
    /// Its constant that differs most clearly.
    pub parameter: &'static ParameterSpec,
    /// Its value in the seen windows and its standard error.
    pub seen: (f64, f64),
    /// The same in those held out.
    pub held_out: (f64, f64),
}

/// The name that explains most of what the seen windows lack, with the constant in which those held out contradict it, if they do. Both are fitted by themselves.
pub fn elsewhere(study: &Study, search: &Search) -> Option<Elsewhere> {
    let contenders = search.steps.iter().flat_map(|step| &step.contenders);
    let explaining = contenders.filter(|c| {
        c.is_sensible && c.added.len() == 1 && c.comparison.lacks() != Some(Lack::Gain)
    });
    let gain = |c: &&Contender| c.comparison.inside.gain;
    let best = explaining.max_by(|a, b| gain(a).total_cmp(&gain(b)))?;
    let [candidate] = best.added[..] else {
        return None;
    };
    let (own, there) = study.of_held_out(&best.fitted);
    let start = there.start(there.inside.theta.clone());
    let there = own.fit(there.hybrid.clone(), start, 1, ITERATIONS);
    let effects = best.fitted.hybrid.effects();
    let index = effects.iter().position(|effect| candidate.is(effect))?;
    let parameters = candidate.kind.parameters.iter();
    let differing = parameters.zip(best.fitted.hybrid.range(index));
    let differing = differing.filter_map(|(parameter, i)| {
        let seen = with_error(&best.fitted, study, i)?;
        let held_out = with_error(&there, &own, i)?;
        let by = (seen.0 - held_out.0).abs();
        let z = by / seen.1.hypot(held_out.1);
        let tells = by > WORTH_TELLING * seen.0.abs().max(held_out.0.abs());
        (z > ANOTHER && tells).then_some((z, parameter, seen, held_out))
    });
    let most = differing.max_by(|a, b| a.0.total_cmp(&b.0));
    most.map(|(_, parameter, seen, held_out)| Elsewhere {
        candidate,
        parameter,
        seen,
        held_out,
    })
}

/// An entry of θ with its standard error, where the windows determine it.
fn with_error(fitted: &Fitted, study: &Study, index: usize) -> Option<(f64, f64)> {
    let error = fitted.standard_error(study, index)?;
    (error.is_finite() && error > 0.0).then_some((fitted.inside.theta[index], error))
}
