//! Particulars of a drive, which are asked for where the drive was found.
//!
//! What shows of a play is the time without force; what happens where teeth touch is over within a sample or two, and taken as of usual teeth by whoever looks for plays. With teeth that are
//! too soft the gap and the motor make up for blows that last too long. Friction that a rigid model has on the joint is the load's; where it is the motor's, an elastic drive
//! has a lag beside it that is not there. So stiffness and damping of teeth, and friction of motors, are fitted last, from more and less of them.

use super::candidate::Candidate;
use super::comparison::Comparison;
use super::found::position;
use super::refine::{ITERATIONS, SHARE, best, is_sensible};
use super::study::{Fitted, Study};
use super::valley::along_the_valley;
use crate::effect::Quantity;

/// Fits start from teeth so many times as hard, that give as much of the speed back, and from friction that slows the motor down so many times as fast as [`SLOWING`]; and from more
/// again where the most does best.
const MORE: [f64; 3] = [0.2, 1.0, 6.0];
const MOST: f64 = 40.0;
/// 1/s, at the usual pace.
const SLOWING: f64 = 0.5;
/// They explain the seen windows by so many standard errors, and those held out at all.
const SURE: f64 = 2.0;
/// Iterations by which the starts are compared, of the initial states and of all.
const COMPARING: (usize, usize) = (3, 8);
/// Nats on those windows that make a fit to all of them worth it: a few more constants gain as many by chance.
const PROMISING: f64 = 4.0;
/// Iterations of the initial states of the fit that follows.
const STATES_ALONE: usize = 10;

/// The model with the particulars of the drive that was `accepted` fitted as well, where these explain more.
pub fn with_particulars(study: &Study, model: &Fitted, accepted: &Candidate) -> Option<Fitted> {
    let motor = accepted.kind.motor()?;
    let range = model.hybrid.range(position(model, accepted)?);
    let pace = accepted.scales(&model.hybrid, &study.scales).pace;
    let parameters = range.clone().zip(accepted.kind.parameters);
    let held = parameters.filter(|(_, spec)| spec.held && !spec.is_flag);
    let held: Vec<(usize, Quantity)> = held.map(|(i, spec)| (i, spec.quantity)).collect();
    if held.is_empty() {
        return None;
    }
    let mut hybrid = model.hybrid.clone();
    for (i, _) in &held {
        hybrid.constants_mut()[*i].tolerance = f64::INFINITY;
    }
    let (some, there) = study.some_windows(model, SHARE);
    let tried = |factor: f64| {
        let mut theta = model.inside.theta.clone();
        let inertia = theta[range.start + motor.inertia];
        for &(i, quantity) in &held {
            match (quantity, theta[i] == 0.0) {
                (Quantity::Stiffness, _) => theta[i] *= factor,
                (_, false) => theta[i] *= factor.sqrt(),
                (_, true) => theta[i] = factor * SLOWING / pace * inertia,
            }
        }
        some.fit(hybrid.clone(), there.start(theta), COMPARING.0, COMPARING.1)
    };
    let mut all = MORE.map(tried).to_vec();
    let scores: Vec<f64> = all.iter().map(|fit| fit.score(0)).collect();
    if let [others @ .., most] = &scores[..]
        && others.iter().all(|other| other < most)
    {
        all.push(tried(MOST));
    }
    let promising = best(all).filter(|fit| Comparison::of(fit, &there).total() > PROMISING)?;
    let theta = promising.inside.theta;
    let fitted = study.fit(hybrid, model.start(theta), STATES_ALONE, ITERATIONS);
    let fitted = along_the_valley(study, fitted, accepted);
    let lead = Comparison::of(&fitted, model);
    let is_better = fitted.score(held.len()) > model.score(0);
    let is_sure = lead.inside.z > SURE && lead.outside.z > 0.0;
    (is_better && is_sure && is_sensible(study, accepted, &fitted)).then_some(fitted)
}
