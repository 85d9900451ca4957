//! What a search has found, looked at once more: pruned, revisited, and weighed against its rivals.

use super::accept::simpler;
use super::candidate::{Candidate, gives_way};
use super::comparison::Comparison;
use super::confidence::DRAWS;
use super::duals::with_duals;
use super::experiment::CLOSE;
use super::refine::{
    Contender, FIRST_LOOK, contender, does_more, is_imitated, is_sensible, polish, rank, refine_one,
};
use super::released::{Instead, instead};
use super::remainder::Remainder;
use super::screen::screen;
use super::step::{LEAST_T2, Report, Step, is_second_choice, lookalikes};
use super::study::{Fitted, Study};
use super::twins::twins_of;
use super::unseen_spring::UnseenSpring;
use super::verdict::{DOUBTFUL, EVEN};
use crate::hybrid::{Hybrid, Placed};

/// So many draws cannot promise more.
const SUREST: f64 = 1.0 - 1.0 / DRAWS as f64;

/// At most so many rivals of a found effect are refined …
const RIVALS: usize = 3;
/// … and of these one that is no richer form of it if the screen promises this share of what the found effect explains: what was promised less came to a tenth of
/// that at most, in the fits that were looked at on carts and arms.
const SERIOUS: f64 = 0.1;

/// A found effect.
#[derive(Clone)]
pub struct Found {
    /// What it is.
    pub candidate: Candidate,
    /// Probability that it is this one or one of those that the data do not tell from it, given that one of the contenders is.
    pub confidence: f64,
    /// Its rivals, with their probabilities.
    pub alternatives: Vec<(Candidate, f64)>,
    /// Rivals that the data do not tell from it.
    pub indistinguishable: Vec<Candidate>,
    /// The fitted models of the rivals among them and of those with a confidence above [`CLOSE`].
    pub rivals: Vec<(Candidate, Fitted)>,
    /// The model with it against the model without.
    pub comparison: Comparison,
    /// The spring by which it may be driven and not show.
    pub unseen_spring: Option<UnseenSpring>,
    /// The constant of the mechanism that it may be instead.
    pub instead: Option<Instead>,
}

impl Found {
    /// Whether anybody would believe in it: states of its own explain nearly anything, and are to be likely.
    pub fn is_believed(&self) -> bool {
        let least = match self.candidate.kind.states() {
            0 => DOUBTFUL,
            _ => EVEN,
        };
        self.confidence >= least
    }

    /// The share of what it explains in that and what is left: a law that is missing may be what it stands in for.
    pub fn share_beside(&self, left: Option<&Remainder>) -> f64 {
        let own = self.comparison.total().max(0.0);
        left.map_or(1.0, |left| own / (own + left.gain))
    }

    /// Calls it by the `name` of two that do the same or nearly, as of a law that contains the other: what spoke for either speaks for that.
    pub fn rename(&mut self, name: Candidate, other: Candidate) {
        let same = |c: &Candidate| *c == name || *c == other;
        let of_both = self.alternatives.iter().filter(|(c, _)| same(c));
        let more: f64 = of_both.map(|(_, confidence)| confidence).sum();
        self.candidate = name;
        self.confidence = (self.confidence + more).min(SUREST);
        self.alternatives.retain(|(c, _)| !same(c));
        self.indistinguishable.retain(|c| !same(c));
        self.rivals.retain(|(c, _)| !same(c));
    }

    /// An elastic transmission is no less likely.
    pub fn may_be_elastic(&mut self, spring: UnseenSpring, model: Fitted) {
        self.is_also(spring.candidate, model);
        self.unseen_spring = Some(spring);
    }

    /// Another name, with the `model` that has it, is no less likely: what spoke for that speaks for this one or that.
    pub fn is_also(&mut self, candidate: Candidate, model: Fitted) {
        let own = self.alternatives.iter().filter(|(c, _)| *c == candidate);
        let more: f64 = own.map(|(_, confidence)| confidence).sum();
        self.confidence = (self.confidence + more).min(SUREST);
        self.alternatives.retain(|(c, _)| *c != candidate);
        if !self.indistinguishable.contains(&candidate) {
            self.indistinguishable.push(candidate);
            self.rivals.retain(|(c, _)| *c != candidate);
            self.rivals.push((candidate, model));
        }
    }

    /// Its probabilities, and those of its rivals, are those under a condition that holds with the probability `share`.
    pub fn believe(&mut self, share: f64) {
        self.confidence *= share;
        for (_, confidence) in &mut self.alternatives {
            *confidence *= share;
        }
        if let Some(instead) = &mut self.instead {
            instead.confidence *= share;
        }
    }
}

/// The effect of a model that is `candidate`.
pub fn position(fitted: &Fitted, candidate: &Candidate) -> Option<usize> {
    fitted.hybrid.effects().iter().position(|e| candidate.is(e))
}

/// The model fitted anew without one of its effects. A known effect whose place it had taken comes back.
pub fn without(study: &Study, null: &Fitted, current: &Fitted, index: usize) -> Fitted {
    let (hybrid, theta) = stripped(null, current, index);
    study.fit(hybrid, current.start(theta), 1, 10)
}

/// The model without one of its effects, and θ, as fitted with it. A known effect whose place it had taken comes back.
pub fn stripped(null: &Fitted, current: &Fitted, index: usize) -> (Hybrid, Vec<f64>) {
    let removed = current.hybrid.effects()[index];
    let range = current.hybrid.range(index);
    let theta = &current.inside.theta;
    let mut theta = [&theta[..range.start], &theta[range.end..]].concat();
    let mut hybrid = current.hybrid.without(index);
    for (known, placed) in null.hybrid.effects().iter().enumerate() {
        if gives_way(placed, removed.kind, removed.target) {
            let values = &null.inside.theta[null.hybrid.range(known)];
            // As sharp as what had taken its place.
            let smoothing = match placed.kind.dry().and(removed.kind.dry()) {
                Some(_) => removed.smoothing,
                None => placed.smoothing,
            };
            hybrid.add(
                Placed {
                    smoothing,
                    ..*placed
                },
                values,
            );
            theta.extend_from_slice(values);
        }
    }
    (hybrid, theta)
}

/// Drops what later effects have made superfluous, what explains least first, and what a fit beside them has taken to parameters that make it something
/// else.
pub fn prune(
    study: &Study,
    null: &Fitted,
    current: &mut Fitted,
    added: &mut Vec<Candidate>,
    report: Report,
) {
    added.retain(|candidate| position(current, candidate).is_some());
    while let Some((k, reduced)) = superfluous(study, null, current, added) {
        report(&format!("dropped: {}", added[k].kind.name));
        *current = reduced;
        added.remove(k);
    }
}

/// Of what was added the one that is something else than its name, or else the one that explains least of those that are not needed; with the model
/// without it.
fn superfluous(
    study: &Study,
    null: &Fitted,
    current: &Fitted,
    added: &[Candidate],
) -> Option<(usize, Fitted)> {
    let index = |candidate: &Candidate| position(current, candidate);
    let other = added.iter().position(|c| !is_sensible(study, c, current));
    if let Some((k, index)) = other.and_then(|k| Some((k, index(&added[k])?))) {
        return Some((k, without(study, null, current, index)));
    }
    // What is alone was accepted as it is; but where its constants may as well do nothing, what explains may be what its fit has moved of the others.
    if let [only] = added {
        let contained = only.contained(&null.hybrid, &null.inside.theta);
        if does_more(study, only, current, &contained) {
            return None;
        }
    }
    let places = added.iter().enumerate();
    places
        .filter_map(|(k, candidate)| {
            let reduced = without(study, null, current, index(candidate)?);
            let needed = Comparison::of(current, &reduced);
            let explains =
                needed.inside.z > 3.0 && needed.outside.z > 1.5 && needed.inside_gain > 0.01;
            let is_needed = match added.len() {
                1 => needed.total() > SAME,
                _ => explains || needed.relieves(),
            };
            (!is_needed).then_some((needed.total(), k, reduced))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k, reduced)| (k, reduced))
}

/// Looks at every found effect once more, with all others in place: a stand-in that was accepted early gives way to what explains
/// more, and the rivals give the confidence.
pub fn revisit(
    study: &Study,
    null: &Fitted,
    current: &mut Fitted,
    added: &mut [Candidate],
    steps: &[Step],
    seed: u64,
    report: Report,
) -> Vec<Found> {
    let mut found: Vec<Found> = Vec::new();
    for k in 0..added.len() {
        let Some(index) = position(current, &added[k]) else {
            continue;
        };
        // It was the first step's only choice, and is all that was found.
        let mut accepted = steps.iter().filter_map(Step::accepted);
        let single = accepted.next().is_some_and(|c| c.added.len() == 1)
            && accepted.next().is_none()
            && added.len() == 1;
        let reduced = match single {
            true => null.clone(),
            false => without(study, null, current, index),
        };
        let rivals = if single {
            let mut rivals = steps[0].contenders.clone();
            // A drive that was laid out in another way explains more than the one that was accepted.
            let own = rivals
                .iter_mut()
                .find(|rival| rival.added[..] == [added[k]]);
            if let Some(own) = own.filter(|_| added[k].kind.motor().is_some()) {
                *own = Contender {
                    imitated: own.imitated,
                    ..contender(study, vec![added[k]], current.clone(), &reduced)
                };
                rank(&mut rivals, seed);
            }
            rivals
        } else {
            report(&format!("revisiting {}", added[k].kind.name));
            let mut rivals = rivals(study, current, &reduced, added, k);
            rank(&mut rivals, seed);
            // What was taken together with others may explain little by itself, and be sure all the same.
            let has_a_say = |c: &Contender| c.added[0] == added[k] && c.is_rival();
            if !rivals.iter().any(has_a_say) {
                let step = Step {
                    contenders: rivals,
                    ..Step::default()
                };
                rivals = step.or_slight(study, &reduced, seed).contenders;
            }
            let own = rivals.iter().position(|r| r.added[0] == added[k]);
            let simple = own.and_then(|own| simpler(study, &rivals, own, own));
            // What takes its place leaves the others what they are called, or takes theirs as well.
            let others_stay = |rival: &Contender| {
                let mut others = added.iter().enumerate().filter(|(other, _)| *other != k);
                others.all(|(_, other)| {
                    position(&rival.fitted, other).is_none()
                        || is_sensible(study, other, &rival.fitted)
                })
            };
            let may_replace = |rival: &Contender| rival.is_acceptable() && others_stay(rival);
            if let Some(simple) = simple.filter(|&simple| may_replace(&rivals[simple])) {
                added[k] = rivals[simple].added[0];
                *current = rivals[simple].fitted.clone();
            } else if let Some(best) = rivals.first()
                && best.added[0] != added[k]
                && best.wins > 0.9
                && may_replace(best)
                && Comparison::of(&best.fitted, current).inside.z > 2.0
            {
                report(&format!(
                    "{} gives way to {}",
                    added[k].kind.name, best.added[0].kind.name
                ));
                added[k] = best.added[0];
                *current = best.fitted.clone();
            }
            rivals
        };
        let mut weighed = weigh(study, (&*added, k), &rivals, (current, &reduced));
        if let Some(instead) = instead(study, &weighed, (current, &reduced)) {
            weighed.believe(1.0 - instead.confidence);
            weighed.instead = Some(instead);
        }
        with_duals(study, null, current, &mut weighed);
        found.push(weighed);
    }
    // Of what was looked at before, something may have given its place to what another became.
    found.retain(|own| position(current, &own.candidate).is_some());
    found
}

/// What explains most beside the others first: that is not always what was accepted first.
pub fn in_order_of_contribution(found: &mut [Found]) {
    found.sort_by(|a, b| b.comparison.total().total_cmp(&a.comparison.total()));
}

/// The found effect and its best rivals, refined beside all others.
fn rivals(
    study: &Study,
    current: &Fitted,
    reduced: &Fitted,
    added: &[Candidate],
    k: usize,
) -> Vec<Contender> {
    let with_memory = is_second_choice(added[k].kind);
    let screen = screen(study, reduced, |kind| {
        with_memory || !is_second_choice(kind)
    });
    let mut own = contender(study, vec![added[k]], current.clone(), reduced);
    own.imitated = screen
        .ranked
        .iter()
        .any(|s| s.candidate == added[k] && is_imitated(s));
    let least = SERIOUS * own.comparison.total();
    let mut rivals = vec![own];
    let promising = screen.ranked.iter();
    let promising = promising.filter(|s| s.t2 > LEAST_T2.1 && s.candidate != added[k]);
    for s in promising.take(RIVALS) {
        if s.gain > least || s.candidate.contains(&added[k]) {
            rivals.push(refine_one(study, reduced, s, FIRST_LOOK));
        }
    }
    polish(study, reduced, &mut rivals);
    rivals.extend(lookalikes(study, reduced, &screen, &rivals, &|_| {}));
    rivals
}

/// The confidence in a found effect of a model among its rivals, `reduced` the model without it; what the data do not tell apart counts together.
pub fn weigh(
    study: &Study,
    (added, k): (&[Candidate], usize),
    rivals: &[Contender],
    (model, reduced): (&Fitted, &Fitted),
) -> Found {
    let candidate = added[k];
    let own = rivals.iter().find(|c| c.added.contains(&candidate));
    let mut confidence = 0.0;
    let mut alternatives = Vec::new();
    let mut indistinguishable: Vec<Candidate> = Vec::new();
    let twins = twins_of(study, &candidate, added, (model, reduced));
    for rival in rivals {
        let [other] = rival.added[..] else {
            if rival.added.contains(&candidate) {
                confidence += rival.wins;
            }
            continue;
        };
        // A kind that contains the found one always fits as well: the simpler name is meant, and its wins are this one's. Only if it falls
        // short of taking its place by little do the data not tell.
        let contains = other.contains(&candidate);
        let tied = own.is_some_and(|own| !contains && are_tied(own, rival));
        if other == candidate || contains {
            confidence += rival.wins;
            let lead = |own: &Contender| Comparison::of(&rival.fitted, &own.fitted);
            if contains && own.is_some_and(|own| rival.is_rival() && lead(own).may_explain_more()) {
                indistinguishable.push(other);
            }
        } else if twins.contains(&other) || tied {
            confidence += rival.wins;
            indistinguishable.push(other);
        } else if rival.wins > 0.0 {
            alternatives.push((other, rival.wins));
        }
    }
    let is_close = |c: &Candidate| {
        let close = alternatives.iter().any(|(a, wins)| a == c && *wins > CLOSE);
        close || indistinguishable.contains(c)
    };
    let fitted = rivals.iter().filter_map(|rival| match rival.added[..] {
        [other] if is_close(&other) => Some((other, rival.fitted.clone())),
        _ => None,
    });
    let fitted: Vec<(Candidate, Fitted)> = fitted.collect();
    for twin in twins {
        if !indistinguishable.contains(&twin) {
            indistinguishable.push(twin);
        }
    }
    Found {
        candidate,
        confidence: confidence.min(SUREST),
        alternatives,
        indistinguishable,
        rivals: fitted,
        comparison: Comparison::of(model, reduced),
        unseen_spring: None,
        instead: None,
    }
}

/// Fits whose evidence differs by less than this, nats, are the same: what they differ by is where their iterations ended.
pub const SAME: f64 = 1.0;

/// Whether the windows do not tell two contenders apart: no significant difference, or a lead of the rival that would not be accepted
/// as an explanation of what the found one leaves.
fn are_tied(own: &Contender, rival: &Contender) -> bool {
    if !rival.is_rival() {
        return false;
    }
    let lead = Comparison::of(&rival.fitted, &own.fitted);
    lead.total().abs() < SAME
        || lead.inside.z.abs() < 2.0
        || (rival.score > own.score && !lead.explains())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::pushes::tests::{prepared, prepared_with};
    use super::super::score::Paired;
    use super::super::setup::Prepared;
    use super::*;

    /// Later fits may take friction to a force beyond reach at next to no stiffness: that is a force of each window's own, and no friction.
    #[test]
    fn friction_that_never_slips_is_dropped() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.3);
        let dahl = Candidate::named("dahl_friction", 0);
        for (values, stays) in [([1e3, 0.5], true), ([1e-2, 1e9], false)] {
            let (hybrid, theta) = dahl.place(&null.hybrid, &null.inside.theta, &values);
            let mut current = study.fit(hybrid, null.start(theta), 0, 0);
            let mut added = vec![dahl];
            prune(&study, &null, &mut current, &mut added, &|_| {});
            assert_eq!(added.len(), usize::from(stays), "{values:?}");
            assert_eq!(current.hybrid.effects().len(), usize::from(stays));
        }
    }

    /// A gain of −0.001 ± 0.010 had been the only name of a log whose known friction the same fit had doubled.
    #[test]
    fn a_single_name_that_does_nothing_is_dropped_and_one_that_does_something_stays() {
        let viscous = Candidate::named("viscous_friction", 0);
        for (damping, coefficient) in [(0.8, 0.8), (0.0, 1e-5)] {
            let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, damping);
            let (hybrid, theta) = viscous.place(&null.hybrid, &null.inside.theta, &[coefficient]);
            let mut current = study.fit(hybrid, null.start(theta), 1, 0);
            assert!(is_sensible(&study, &viscous, &current), "{coefficient}");
            let mut added = vec![viscous];
            prune(&study, &null, &mut current, &mut added, &|_| {});
            assert_eq!(added.is_empty(), damping == 0.0, "{coefficient}");
        }
    }

    #[test]
    fn what_explains_and_relieves_more_is_told_first() {
        let windows = Paired {
            z: 9.0,
            gain: 0.0,
            windows: 75,
        };
        let named = |kind, gain, relief| Found {
            candidate: Candidate::named(kind, 0),
            confidence: 0.9,
            alternatives: Vec::new(),
            indistinguishable: Vec::new(),
            rivals: Vec::new(),
            comparison: Comparison {
                inside: Paired { gain, ..windows },
                outside: windows,
                inside_gain: gain / 2250.0,
                outside_gain: 0.1,
                relief,
            },
            unseen_spring: None,
            instead: None,
        };
        let mut found = [
            named("viscous_friction", 300.0, 0.0),
            named("input_delay", 900.0, 0.0),
            named("input_gain_error", 200.0, 150.0),
        ];
        in_order_of_contribution(&mut found);
        let kinds = found.map(|found| found.candidate.kind.name);
        assert_eq!(
            kinds,
            ["input_delay", "input_gain_error", "viscous_friction"]
        );
    }

    /// In whatever order they were found.
    #[test]
    fn of_two_laws_that_the_data_do_not_need_both_the_weaker_is_dropped() {
        let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, 0.8);
        let on_the_sledge = |name| Candidate::named(name, 0);
        let drag = on_the_sledge("quadratic_drag");
        let viscous = on_the_sledge("viscous_friction");
        for order in [[drag, viscous], [viscous, drag]] {
            let (mut hybrid, mut theta) = (null.hybrid.clone(), null.inside.theta.clone());
            for candidate in order {
                (hybrid, theta) = candidate.place(&hybrid, &theta, &[0.1]);
            }
            let mut current = study.fit(hybrid, null.start(theta), 1, 12);
            let mut added = order.to_vec();
            prune(&study, &null, &mut current, &mut added, &|_| {});
            assert_eq!(added, [viscous], "{order:?}");
            let range = current.hybrid.range(current.hybrid.effects().len() - 1);
            let found = current.inside.theta[range.start];
            assert!((found - 0.8).abs() < 0.02, "{found}");
        }
    }
}
