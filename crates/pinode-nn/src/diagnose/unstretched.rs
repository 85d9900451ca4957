//! Constants that a fit left stretched on the way from one end of a valley to the other.
//!
//! What is missing pulls masses and gains away from where they are known to be, and a fit with the effect that is missing starts there. Where all forces by one
//! factor are the same motion, or a mass in one place with a lighter body the same as one in another, only the tolerances lead back, along a valley in which
//! iterations creep. So what was found is fitted to constants as the model says they are first, and then all of them from there.

use super::comparison::RELIEF;
use super::refine::ITERATIONS;
use super::study::{Fitted, Study};
use crate::hybrid::Hybrid;

/// Nats that are worth it: iterations end as far apart.
const WORTH: f64 = 1.0;

/// θ with what is known of the constants in place of what a fit has made of them; what nothing is known of stays.
pub fn unstrained(hybrid: &Hybrid, theta: &[f64]) -> Vec<f64> {
    let constants = hybrid.constants().iter().zip(theta);
    let known = constants.map(|(constant, &there)| match constant.tolerance.is_finite() {
        true => constant.value,
        false => there,
    });
    known.collect()
}

/// A fitted model whose tolerances are stretched, fitted again from where they are not; `None` where it explains no more there.
pub fn unstretched(study: &Study, fitted: &Fitted) -> Option<Fitted> {
    let fit = &fitted.inside;
    if fit.stretch <= RELIEF {
        return None;
    }
    let (mut held, theta) = (
        fitted.hybrid.clone(),
        unstrained(&fitted.hybrid, &fit.theta),
    );
    for constant in held.constants_mut() {
        if constant.tolerance.is_finite() {
            constant.tolerance = 0.0;
        }
    }
    let there = study.fit(held, fitted.start(theta), 1, ITERATIONS);
    let start = there.start(there.inside.theta.clone());
    let again = study.fit(fitted.hybrid.clone(), start, 1, ITERATIONS);
    (again.score(0) > fitted.score(0) + WORTH).then_some(again)
}
