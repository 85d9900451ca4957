//! Names that undo one another.
//!
//! Two effects that push alike and the other way, by nearly as much, leave of each other a difference that neither would make by itself: a weight on the cart and as much less inertia of its motor
//! are a pull along a rail that is not level. That two effects which are there cancel to a part f of what they are is a coincidence, and as likely as f is large.

use super::candidate::Candidate;
use super::found::{position, prune, without};
use super::step::Report;
use super::study::{Fitted, Study};

/// What is left of two effects counts as all of them where it is this part.
const DISTINCT: f64 = 0.2;
/// … and two of which this part is left are none: what they make together is something else.
const UNDONE: f64 = 0.05;

/// Drops effects of which two of those `added` leave of one another next to nothing, and what is not needed without them; `null` is the model that the search
/// began with. What they stood in for is left.
pub fn drop_undone(
    study: &Study,
    null: &Fitted,
    current: &mut Fitted,
    added: &mut Vec<Candidate>,
    report: Report,
) {
    while let Some([a, b]) = undone(current, added) {
        report(&format!(
            "dropped: {} and {}, which undo one another",
            a.kind.name, b.kind.name
        ));
        for candidate in [a, b] {
            if let Some(index) = position(current, &candidate) {
                *current = without(study, null, current, index);
            }
            added.retain(|other| *other != candidate);
        }
        prune(study, null, current, added, report);
    }
}

/// Two effects of which next to nothing is left together.
fn undone(fitted: &Fitted, added: &[Candidate]) -> Option<[Candidate; 2]> {
    let pairs = added.iter().enumerate().flat_map(|(k, a)| {
        let later = added.iter().skip(k + 1);
        later.map(move |b| [*a, *b])
    });
    let mut pairs = pairs.filter(|[a, b]| part_left(fitted, a, b).is_some_and(|x| x < UNDONE));
    pairs.next()
}

/// How likely it is that `candidate`, one of those `added` to a fitted model, is there with the others as they are: 1 unless one of them undoes it.
pub fn share_not_undone(fitted: &Fitted, candidate: &Candidate, added: &[Candidate]) -> f64 {
    let others = added.iter().filter(|other| *other != candidate);
    let left = others.filter_map(|other| part_left(fitted, candidate, other));
    let least = left.fold(f64::INFINITY, f64::min);
    (least / DISTINCT).min(1.0)
}

/// |r_a + r_b| / (|r_a| + |r_b|) of what the strengths of two effects change of the readings, to first order, once the windows' initial states have given what they can.
fn part_left(fitted: &Fitted, a: &Candidate, b: &Candidate) -> Option<f64> {
    let fit = &fitted.inside;
    let strength = |candidate: &Candidate| {
        let i = fitted.hybrid.range(position(fitted, candidate)?).start;
        let [first, others @ ..] = candidate.kind.parameters else {
            return None;
        };
        // Of what has two, or none that is nothing at 0, the first parameter is not how strong it is.
        let is_strength = first.neutral == 0.0 || candidate.kind.name == "centre_of_mass";
        let is_only = others.iter().all(|p| p.quantity != first.quantity);
        let neutral = (is_strength && is_only).then_some(first.neutral)?;
        let k = fit.free.iter().position(|&free| free == i)?;
        Some((k, fit.theta[i] - neutral)).filter(|(_, size)| size.is_finite())
    };
    let ((i, x), (j, y)) = (strength(a)?, strength(b)?);
    let product = |(i, x): (usize, f64), (j, y): (usize, f64)| x * y * fit.information[(i, j)];
    let (xx, yy) = (product((i, x), (i, x)), product((j, y), (j, y)));
    let together = xx + yy + 2.0 * product((i, x), (j, y));
    let apart = xx.sqrt() + yy.sqrt();
    (apart > 0.0).then(|| together.max(0.0).sqrt() / apart)
}

#[cfg(test)]
mod tests {
    use super::super::pushes::tests::prepared;
    use super::super::setup::Prepared;
    use super::*;

    /// (m + J) ẍ = (1 + g) u is m ẍ = u where J = g m.
    #[test]
    fn a_gain_and_as_much_more_inertia_undo_one_another() {
        const MASS: f64 = 2.0;
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        let named = ["input_gain_error", "reflected_inertia"].map(|name| Candidate::named(name, 0));
        let with = |gain: f64, inertia: f64| {
            let [scale, rotor] = named;
            let (hybrid, theta) = scale.place(&null.hybrid, &null.inside.theta, &[gain]);
            let (hybrid, theta) = rotor.place(&hybrid, &theta, &[inertia]);
            study.fit(hybrid, null.start(theta), 1, 0)
        };
        let mut undoing = with(0.2, 0.2 * MASS);
        assert!(share_not_undone(&undoing, &named[0], &named) < 0.05 / DISTINCT);
        let added = with(0.2, -0.2 * MASS);
        assert!((share_not_undone(&added, &named[0], &named) - 1.0).abs() < 1e-12);
        assert!((share_not_undone(&undoing, &named[0], &named[..1]) - 1.0).abs() < 1e-12);
        let mut left = named.to_vec();
        drop_undone(&study, &null, &mut undoing, &mut left, &|_| ());
        assert!(left.is_empty());
        assert_eq!(undoing.hybrid.effects().len(), null.hybrid.effects().len());
    }
}
