//! A law with one constant in place of a richer one that contains it.

use integrators::event::Direction;

use super::candidate::Candidate;
use super::found::{position, stripped};
use super::study::{Fitted, Study};
use crate::hybrid::{Hybrid, Placed};

/// Iterations of its fit.
const ITERATIONS: usize = 12;

/// Whether a law may stand in the place of a `rich` one on what `given` has: it has one constant and is contained in that. Friction with a memory is what it is called by more
/// than its size, and what is known already has its place.
pub fn is_simpler(simple: &Candidate, rich: &Candidate, given: &Hybrid) -> bool {
    rich.contains(simple)
        && rich.kind.states() == 0
        && simple.kind.parameters.len() == 1
        && !given.effects().iter().any(|e| simple.is(e))
}

/// How large a law is, where that is what one with one constant has.
pub fn size(study: &Study, model: &Fitted, rich: &Candidate) -> Option<f64> {
    let own = &model.inside.theta[model.hybrid.range(position(model, rich)?)];
    let scales = rich.scales(&model.hybrid, &study.scales);
    match rich.kind.dry() {
        Some(law) => Some(law.size(Direction::Positive, scales.centre, scales.speed, own)),
        None => own.first().copied(),
    }
}

/// The model with a law of one constant in place of a richer one that contains it, fitted from where that came to: `base` is what it began from.
pub fn instead(
    study: &Study,
    base: &Fitted,
    (model, rich): (&Fitted, &Candidate),
    simple: &Candidate,
) -> Option<Fitted> {
    let (index, size) = (position(model, rich)?, size(study, model, rich)?);
    let (mut hybrid, mut theta) = stripped(base, model, index);
    let placed = Placed {
        kind: simple.kind,
        ..model.hybrid.effects()[index]
    };
    hybrid.add(placed, &[size]);
    theta.push(size);
    Some(study.fit(hybrid, model.start(theta), 1, ITERATIONS))
}
