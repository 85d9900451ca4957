//! Constants that a fit left stretched on the way from one end of a valley to the other.
//!
//! What is missing pulls masses and gains away from where they are known to be, and a fit with the effect that is missing starts there. Where all forces by one
//! factor are the same motion, or a mass in one place with a lighter body the same as one in another, only the tolerances lead back, along a valley in which
//! iterations creep. So what was found is fitted to constants as the model says they are first, and then all of them from there.

use super::comparison::RELIEF;
use super::refine::ITERATIONS;
use super::study::{Fitted, Study};

/// Nats that are worth it: iterations end as far apart.
const WORTH: f64 = 1.0;

/// A fitted model whose tolerances are stretched, fitted again from where they are not; `None` where it explains no more there.
pub fn unstretched(study: &Study, fitted: &Fitted) -> Option<Fitted> {
    let fit = &fitted.inside;
    if fit.stretch <= RELIEF {
        return None;
    }
    let (mut held, mut theta) = (fitted.hybrid.clone(), fit.theta.clone());
    for (constant, theta) in held.constants_mut().iter_mut().zip(&mut theta) {
        if constant.tolerance.is_finite() {
            *theta = constant.value;
            constant.tolerance = 0.0;
        }
    }
    let there = study.fit(held, fitted.start(theta), 1, ITERATIONS);
    let start = there.start(there.inside.theta.clone());
    let again = study.fit(fitted.hybrid.clone(), start, 1, ITERATIONS);
    (again.score(0) > fitted.score(0) + WORTH).then_some(again)
}
