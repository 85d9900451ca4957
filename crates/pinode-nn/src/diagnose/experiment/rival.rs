//! The rival of a found effect, fitted in its place.

use super::super::candidate::{Candidate, gives_way};
use super::super::found::{Found, position, stripped};
use super::super::search::Search;
use super::super::study::{Fitted, Study};
use crate::hybrid::{Hybrid, Placed};

/// The model with `other` in the place of `found`: as the search fitted it, or fitted now. `None` where it has no fit.
pub fn fitted(study: &Study, search: &Search, found: &Found, other: Candidate) -> Option<Fitted> {
    let own = found.candidate;
    let of_the_search = found.rivals.iter().find(|(c, _)| *c == other);
    if let Some((_, fitted)) = of_the_search
        && has_the_same_rest(&search.model.hybrid, &fitted.hybrid, own, other)
    {
        return Some(fitted.clone());
    }
    let index = position(&search.model, &own)?;
    let theta = &search.model.inside.theta;
    let values = &theta[search.model.hybrid.range(index)];
    let (mut hybrid, mut rest) = stripped(&search.null, &search.model, index);
    let start = match (own.kind.name, other.kind.name, values) {
        // While sliding, −F s + F₀ is F − F₀ one way and F + F₀ the other.
        ("constant_force", "asymmetric_coulomb_friction", [constant]) => {
            let friction = other.contained(&hybrid, &rest);
            let friction = friction.first().copied().unwrap_or(0.0);
            [friction - constant, friction + constant]
                .map(|f| f.max(0.0))
                .to_vec()
        }
        ("asymmetric_coulomb_friction", "constant_force", [positive, negative]) => {
            let kind = crate::effect::registry::find("coulomb_friction")?;
            let target = own.target;
            let symmetric = Candidate { kind, target };
            let mean = 0.5 * (positive + negative);
            match hybrid.effects().iter().position(|e| symmetric.is(e)) {
                Some(known) => rest[hybrid.range(known).start] = mean,
                None => (hybrid, rest) = symmetric.place(&hybrid, &rest, &[mean]),
            }
            vec![0.5 * (negative - positive)]
        }
        _ => {
            let (_, fitted) = of_the_search?;
            let place = position(fitted, &other)?;
            fitted.inside.theta[fitted.hybrid.range(place)].to_vec()
        }
    };
    let (hybrid, theta) = other.place(&hybrid, &rest, &start);
    let fitted = study.fit(hybrid, search.model.start(theta), 1, 10);
    fitted
        .inside_scores
        .iter()
        .any(|s| s.is_finite())
        .then_some(fitted)
}

/// Whether two models have the same effects but for the two compared and what those contain.
fn has_the_same_rest(a: &Hybrid, b: &Hybrid, own: Candidate, other: Candidate) -> bool {
    let compared = |e: &&Placed| {
        [own, other]
            .iter()
            .any(|c| c.is(e) || gives_way(e, c.kind, c.target))
    };
    let rest = |hybrid: &Hybrid| {
        let effects = hybrid.effects().iter().filter(|e| !compared(e));
        let mut rest: Vec<_> = effects.map(|e| (e.kind.name, e.target, e.fixed)).collect();
        rest.sort_unstable();
        rest
    };
    rest(a) == rest(b)
}
