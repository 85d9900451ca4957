//! Over how wide a range of speeds dry friction changes its sign.
//!
//! The sign of friction, smooth_sign(v / w), is fitted with a width w that no fit moves. Where the data see it, a wrong one is made up for by other constants, and by
//! other laws: w is searched for by what fits beside it explain, and what constants owe to it is a part of their errors.

use std::f64::consts::LN_2;

use super::bracket::Bracket;
use super::candidate::Candidate;
use super::comparison::{Comparison, RELIEF};
use super::nuisance::owe;
use super::step::LOUD;
use super::study::{Fitted, Study};
use crate::effect::Quantity;
use crate::hybrid::{Hybrid, Placed};

/// Iterations of a fit.
const ITERATIONS: usize = 12;
/// So many times as wide ranges of speeds are tried for the sign of dry friction: what is nearly as sharp as it is taken to be, over all windows, where one of
/// them that sticks the other way would decide for a part of them; and what is far from that, over one in so many windows by so many iterations. Where one gains
/// so many nats it is tried in all.
const NEAR: [f64; 2] = [0.6, 1.5];
const FAR: [f64; 3] = [4.0, 16.0, 64.0];
const SHARE: usize = 4;
const TRIED: usize = 4;
const WORTH_A_TRIAL: f64 = 3.0;
/// No ranges are tried whose logarithms are closer; beside constants that are stretched, where the best one is that of another model, none closer than the last.
const CLOSEST: f64 = 0.007;
const CLOSEST_STRETCHED: f64 = 0.09;
/// A range that gains so many nats on the seen windows, and any on those held out, is the one: it is no effect that asks for a name.
const IS_IT: f64 = 6.0;
/// … and no wider than this share of a speed over which its law changes: what is wider is a part of the law.
const NARROW: f64 = 0.1;
/// So many times the usual range is no numerical one.
const SOFT: f64 = 1.3;

/// Whether a fitted effect is dry friction.
fn is_dry(placed: &Placed) -> bool {
    placed.kind.dry().is_some()
}

/// A fitted model with the dry friction that was `added` spread over the speeds that explain the data. Over many more than usual it holds no joint at rest: fluid
/// friction of what is lubricated, and the tanh of other people's simulations. `None` where it explains no more so, and where the model says how
/// wide it is.
pub fn respread(study: &Study, fitted: &Fitted, added: &[Candidate]) -> Option<Fitted> {
    let is_its = |placed: &Placed| is_dry(placed) && added.iter().any(|c| c.is(placed));
    if !study.may_sharpen || !fitted.hybrid.effects().iter().any(is_its) {
        return None;
    }
    let spread = |study: &Study, from: &Fitted, factor: f64, iterations: usize| {
        spread(study, (from, factor), is_its, iterations)
    };
    let gain = |wider: &Fitted, from: &Fitted| match is_narrow(wider, from, is_its) {
        true => Comparison::of(wider, from).total(),
        false => f64::NEG_INFINITY,
    };
    let fit = |from: &Fitted, apart: f64| spread(study, from, apart.exp(), ITERATIONS);
    let closest = |fit: &Fitted| match fit.inside.stretch < RELIEF {
        true => CLOSEST,
        false => CLOSEST_STRETCHED,
    };
    let best = |middle: Fitted, apart: [f64; 2]| {
        Bracket::around(middle, apart, fit).best(fit, gain, closest)
    };
    let near = best(fitted.clone(), NEAR.map(f64::ln));
    let near = Some(near).filter(|near| gain(near, fitted) > WORTH_A_TRIAL);
    let wide = match near {
        Some(near) if near.most_excess(study) < LOUD => near,
        near => {
            // Little changes before the range reaches speeds that the motion has often. Some of the windows tell whether it does.
            let (some, there) = study.some_windows(fitted, SHARE);
            let far = FAR.map(|factor| (spread(&some, &there, factor, TRIED), factor));
            let far = far.map(|(far, factor)| (gain(&far, &there), factor));
            let far = far.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
            let far = far.filter(|(gained, _)| *gained > WORTH_A_TRIAL);
            let far = far.map(|(_, factor)| best(fit(fitted, factor.ln()), [-LN_2, LN_2]));
            match (far, near) {
                (Some(far), Some(near)) if gain(&far, &near) > 0.0 => far,
                (far, near) => near.or(far)?,
            }
        }
    };
    let lead = Comparison::of(&wide, fitted);
    let is_it = lead.inside.gain > IS_IT && lead.outside.gain > 0.0;
    (is_it && is_narrow(&wide, fitted, is_its)).then_some(wide)
}

/// By how much each of the constants that were free may be off, in the order of `inside.free`, because the width is: what it [owes](owe) to it. Nothing where the model says
/// how wide it is, beside end stops, whose blows decide what little it shows, and beside a network that was taught, which would be taught again; by a wider one only where
/// that is still [narrow](is_narrow).
pub fn owed(study: &Study, fitted: &Fitted) -> Vec<f64> {
    let mut owed = vec![0.0_f64; fitted.inside.free.len()];
    let effects = fitted.hybrid.effects();
    let has_stops = effects.iter().any(|e| e.kind.stop().is_some());
    let is_taught = !fitted.hybrid.networks().is_empty();
    if !study.may_sharpen || has_stops || is_taught || !effects.iter().any(is_dry) {
        return owed;
    }
    // What more iterations move is not owed to the width.
    let gone_on = || spread(study, (fitted, 1.0), is_dry, ITERATIONS);
    let gone_on = (!fitted.inside.converged).then(gone_on);
    let best = gone_on.as_ref().unwrap_or(fitted);
    for factor in NEAR {
        let other = spread(study, (fitted, factor), is_dry, ITERATIONS);
        if !is_narrow(&other, best, is_dry) {
            continue;
        }
        let lost = Comparison::of(best, &other).total();
        owe(&mut owed, (best, &other), lost);
    }
    owed
}

/// The fit of a model with some of its dry friction spread over so many times the speeds, by steps that follow it at rest.
fn spread(
    study: &Study,
    (from, factor): (&Fitted, f64),
    is_its: impl Fn(&Placed) -> bool,
    iterations: usize,
) -> Fitted {
    let theta = &from.inside.theta;
    let hybrid = from.hybrid.smoothed_by(factor, is_its).stepped_for(theta);
    let at_rest = study.at_rest(&hybrid, theta);
    let study = at_rest.as_ref().unwrap_or(study);
    study.fit(hybrid, from.start(theta.clone()), 1, iterations)
}

/// Whether the sign of this dry friction of a fitted model changes within a small part of the speeds that its law knows, as is that of a hump at low speed, or within less of
/// them than in another fit.
fn is_narrow(fitted: &Fitted, other: &Fitted, is_its: impl Fn(&Placed) -> bool) -> bool {
    let (hybrid, theta) = (&fitted.hybrid, &fitted.inside.theta);
    let effects = hybrid.effects().iter().zip(other.hybrid.effects());
    let mut its = effects.enumerate().filter(|(_, (own, _))| is_its(own));
    its.all(|(index, (own, other))| {
        let constants = own.kind.parameters.iter().zip(&theta[hybrid.range(index)]);
        let mut speeds = constants.filter(|(spec, _)| spec.quantity == Quantity::Velocity);
        own.smoothing < other.smoothing || speeds.all(|(_, speed)| own.smoothing < NARROW * speed)
    })
}

/// The dry friction of a fitted model that is spread over more speeds than dry friction is.
pub fn soft(hybrid: &Hybrid) -> impl Iterator<Item = &Placed> {
    let effects = hybrid.effects().iter();
    effects.filter(|placed| is_soft(hybrid, placed))
}

/// Whether an effect is dry friction that is spread over more speeds than that is: by no numerical smoothing.
pub fn is_soft(hybrid: &Hybrid, placed: &Placed) -> bool {
    is_dry(placed) && placed.smoothing > SOFT * hybrid.default_smoothing(placed.target)
}
