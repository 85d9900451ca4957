//! One constant of the mechanism that is not what the model says.
//!
//! A body that is heavier as a whole, its inertia in proportion, is no effect: a fit takes it as a mass scale, within its tolerance. Where that is narrow,
//! all other masses, the gains and whatever is free give a little each instead, and a name that frees one of those is accepted for the tolerances
//! that it relieves. The constant itself, with its tolerance set aside, is that name's rival.
//!
//! So is every constant in energies that are written down, of which the model does not say how well it is known: a mass that is 8 % off is a force that changes with
//! the angle and an inertia, or the exact likeness of one law.

use rayon::prelude::*;

use super::candidate::Candidate;
use super::comparison::{Comparison, RELIEF};
use super::found::Found;
use super::refine::{Contender, ITERATIONS};
use super::study::{Fitted, Study};
use crate::effect::Action;
use crate::hybrid::ConstantId;

/// So many constants are tried, those first whose release promises most.
const TRIED: usize = 2;
/// A name gives way to a constant that explains more by so many nats: iterations end as far apart.
const AHEAD: f64 = 1.0;
/// … and one that may say the same in other words, as that the inertia of a body or a joint is another, by so many: twenty to one.
const AHEAD_OF_LIKENESS: f64 = 3.0;

/// The index in θ of one constant of the mechanism and the model with its tolerance set aside, the one that explains most; `None` where the fit does not stretch
/// its tolerances so far that their relief would speak for anything.
///
/// Of a constant that is d from its value with the tolerance τ and the standard error s, its release promises d²/2(τ² − s²).
fn released(study: &Study, current: &Fitted) -> Option<(usize, Fitted)> {
    let fit = &current.inside;
    if fit.stretch <= RELIEF {
        return None;
    }
    let spread = fit.nominal_errors();
    let constants = current.hybrid.constants();
    let promise = |(&i, spread): (&usize, f64)| {
        let constant = &constants[i];
        let is_of_mechanism = matches!(constant.id, ConstantId::Mechanics(_));
        let far = fit.theta[i] - constant.value;
        let promised = 0.5 * far.powi(2) / (constant.tolerance.powi(2) - spread.powi(2));
        (is_of_mechanism && constant.tolerance.is_finite() && promised > RELIEF)
            .then_some((i, promised))
    };
    let mut promising: Vec<(usize, f64)> =
        fit.free.iter().zip(spread).filter_map(promise).collect();
    promising.sort_by(|a, b| b.1.total_cmp(&a.1));
    promising.truncate(TRIED);
    let promising: Vec<usize> = promising.into_iter().map(|(i, _)| i).collect();
    let best = freed(study, current, &promising);
    best.filter(|(_, fitted)| Comparison::of(fitted, current).relieves())
}

/// The same of the constants of which the model does not say how well they are known; `None` where none is worth it.
fn unsaid(
    study: &Study,
    current: &Fitted,
    is_worth: impl Fn(&Comparison) -> bool,
) -> Option<(usize, Fitted)> {
    let constants = current.hybrid.constants().iter().enumerate();
    let open = constants.filter(|(_, c)| !c.is_said && c.tolerance == 0.0 && c.value != 0.0);
    let open: Vec<usize> = open.map(|(i, _)| i).collect();
    let best = freed(study, current, &open);
    best.filter(|(_, fitted)| is_worth(&Comparison::of(fitted, current)))
}

/// The best model with one of these constants free.
fn freed(study: &Study, current: &Fitted, indices: &[usize]) -> Option<(usize, Fitted)> {
    let fits = indices.par_iter().map(|&i| {
        let mut hybrid = current.hybrid.clone();
        hybrid.constants_mut()[i].tolerance = f64::INFINITY;
        let start = current.start(current.inside.theta.clone());
        (i, study.fit(hybrid, start, 1, ITERATIONS))
    });
    let fits: Vec<(usize, Fitted)> = fits.collect();
    fits.into_iter()
        .max_by(|a, b| a.1.score(0).total_cmp(&b.1.score(0)))
}

/// A constant of the mechanism that explains more, free, than what a step accepts, with the model that has it so.
pub fn in_place_of(
    study: &Study,
    current: &Fitted,
    accepted: Option<&Contender>,
) -> Option<(usize, Fitted)> {
    let stretched = match accepted {
        Some(accepted) if accepted.comparison.explains() => None,
        Some(accepted) => released(study, current).filter(|(_, r)| is_ahead(r, accepted)),
        None => released(study, current),
    };
    let surpasses = |fitted: &Fitted| {
        accepted.is_none_or(|accepted| fitted.score(1) > accepted.score + AHEAD_OF_LIKENESS)
    };
    let unsaid = || unsaid(study, current, Comparison::explains);
    stretched.or_else(|| unsaid().filter(|(_, fitted)| surpasses(fitted)))
}

/// Whether a name does what the scale of a body does: it says that the inertia of a body, or of a joint, is another.
fn is_inertia(candidate: &Candidate) -> bool {
    matches!(candidate.kind.action, Action::Inertial(_))
}

/// Whether a constant, `released`, explains more than a contender that stands by the tolerances that it relieves.
fn is_ahead(released: &Fitted, contender: &Contender) -> bool {
    let ahead = match contender.added.iter().all(is_inertia) {
        true => AHEAD_OF_LIKENESS,
        false => AHEAD,
    };
    released.score(1) > contender.score + ahead
}

/// A constant of the mechanism that explains what a name does, where its tolerance is set aside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instead {
    /// Its index in θ: constants of the mechanism come first, whatever effects there are.
    pub index: usize,
    /// What the model says it is, and what it would be.
    pub values: [f64; 2],
    /// How probable it is that it is this one.
    pub confidence: f64,
}

/// The constant that would explain as much as what was found of what `reduced`, the model without it, lacks. One with a tolerance is none where the windows
/// themselves speak for the name, and where it says the same.
pub fn instead(
    study: &Study,
    found: &Found,
    (current, reduced): (&Fitted, &Fitted),
) -> Option<Instead> {
    let stretched = match is_inertia(&found.candidate) || found.comparison.explains() {
        true => None,
        false => released(study, reduced),
    };
    // A name that only relieves tolerances has a rival in a constant that does.
    let is_worth = |c: &Comparison| c.explains() || c.relieves();
    let (index, released) = stretched.or_else(|| unsaid(study, reduced, is_worth))?;
    let (own, other) = (&current.inside.free, &reduced.inside.free);
    let more = own.len().saturating_sub(other.len());
    let behind = released.score(1) - current.score(more);
    Some(Instead {
        index,
        values: [
            reduced.hybrid.constants()[index].value,
            released.inside.theta[index],
        ],
        confidence: 1.0 - 1.0 / (1.0 + behind.exp()),
    })
}
