//! What a search has found, looked at once more: pruned, revisited, and weighed against its rivals.

use super::candidate::{Candidate, gives_way};
use super::confidence::DRAWS;
use super::experiment::CLOSE;
use super::refine::{
    Contender, FIRST_LOOK, contender, is_imitated, is_sensible, polish, rank, refine_one,
};
use super::released::share_beside;
use super::remainder::Remainder;
use super::screen::screen;
use super::step::{LEAST_T2, Report, Step, is_second_choice, lookalikes, simpler};
use super::study::{Comparison, Fitted, Study};
use super::unseen_spring::UnseenSpring;
use crate::effect::{ActsOn, Kind};
use crate::hybrid::{Hybrid, Placed};

/// So many draws cannot promise more.
const SUREST: f64 = 1.0 - 1.0 / DRAWS as f64;

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
}

impl Found {
    /// The share of what it explains in that and what is left: a law that is missing may be what it stands in for.
    pub fn share_beside(&self, left: Option<&Remainder>) -> f64 {
        let own = self.comparison.total().max(0.0);
        left.map_or(1.0, |left| own / (own + left.gain))
    }

    /// Calls it by the name of a law that its own contains: what spoke for either speaks for that.
    pub fn rename(&mut self, simple: Candidate, rich: Candidate) {
        let same = |c: &Candidate| *c == simple || *c == rich;
        let of_both = self.alternatives.iter().filter(|(c, _)| same(c));
        let more: f64 = of_both.map(|(_, confidence)| confidence).sum();
        self.candidate = simple;
        self.confidence = (self.confidence + more).min(SUREST);
        self.alternatives.retain(|(c, _)| !same(c));
        self.indistinguishable.retain(|c| !same(c));
        self.rivals.retain(|(c, _)| !same(c));
    }

    /// An elastic transmission is no less likely.
    pub fn may_be_elastic(&mut self, spring: UnseenSpring, model: Fitted) {
        let candidate = spring.candidate;
        self.alternatives.retain(|(c, _)| *c != candidate);
        if !self.indistinguishable.contains(&candidate) {
            self.indistinguishable.push(candidate);
            self.rivals.push((candidate, model));
        }
        self.unseen_spring = Some(spring);
    }

    /// Its probabilities, and those of its rivals, are those under a condition that holds with the probability `share`.
    pub fn believe(&mut self, share: f64) {
        self.confidence *= share;
        for (_, confidence) in &mut self.alternatives {
            *confidence *= share;
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
    // What is alone was accepted as it is.
    if added.len() < 2 {
        return None;
    }
    let places = added.iter().enumerate();
    places
        .filter_map(|(k, candidate)| {
            let reduced = without(study, null, current, index(candidate)?);
            let needed = Comparison::of(current, &reduced);
            let explains =
                needed.inside.z > 3.0 && needed.outside.z > 1.5 && needed.inside_gain > 0.01;
            let is_needed = explains || needed.relieves();
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
        let single = steps.iter().filter(|s| s.accepted.is_some()).count() == 1 && added.len() == 1;
        let reduced = match single {
            true => null.clone(),
            false => without(study, null, current, index),
        };
        let rivals = if single {
            steps[0].contenders.clone()
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
            let simple = own.and_then(|own| simpler(&rivals, own, own));
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
        let mut weighed = weigh(study, added[k], &rivals, (current, &reduced));
        weighed.believe(share_beside(study, &weighed, (current, &reduced)));
        found.push(weighed);
    }
    found
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
    let mut rivals = vec![own];
    for s in screen
        .ranked
        .iter()
        .filter(|s| s.t2 > LEAST_T2.1 && s.candidate != added[k])
        .take(3)
    {
        rivals.push(refine_one(study, reduced, s, FIRST_LOOK));
    }
    polish(study, reduced, &mut rivals);
    rivals.extend(lookalikes(study, reduced, &screen, &rivals, &|_| {}));
    rivals
}

/// The confidence in a found effect of a model among its rivals, `reduced` the model without it; what the data do not tell apart counts together.
fn weigh(
    study: &Study,
    candidate: Candidate,
    rivals: &[Contender],
    (model, reduced): (&Fitted, &Fitted),
) -> Found {
    let own = rivals.iter().find(|c| c.added.contains(&candidate));
    let mut confidence = 0.0;
    let mut alternatives = Vec::new();
    let mut indistinguishable: Vec<Candidate> = Vec::new();
    let twins = twins_of(study, &candidate, (model, reduced));
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
            if contains && own.is_some_and(|own| rival.is_rival() && lead(own).nearly_explains()) {
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

/// The offset class: while sliding, a constant force, an offset of the input and a difference of Coulomb friction between the directions are one
/// equation.
const OFFSET_CLASS: [&str; 3] = [
    "constant_force",
    "asymmetric_coulomb_friction",
    "input_offset",
];

fn in_offset_class(kind: &Kind) -> bool {
    OFFSET_CLASS.contains(&kind.name)
}

/// The coordinate that an effect on a joint or an input acts on; none for an input on a link, which pushes several, now this way and now that.
fn pushed(candidate: &Candidate, hybrid: &Hybrid) -> Option<usize> {
    let Candidate { kind, target } = *candidate;
    match kind.acts_on() {
        ActsOn::Input if hybrid.is_on_link(target) => None,
        ActsOn::Input => Some(hybrid.coordinate_of(kind, target)),
        _ => Some(target),
    }
}

/// Kinds that make another force of an offset of the input than a constant one, or more of it where there is a force.
const BEHIND_INPUTS: [&str; 3] = [
    "input_saturation",
    "input_dead_zone",
    "load_dependent_friction",
];

/// The twins of a found effect of a model, `reduced` the model without it: a difference of Coulomb friction is one only where there is such friction
/// on the same coordinate without it, an offset of the input only where that arrives as it is.
fn twins_of(
    study: &Study,
    candidate: &Candidate,
    (model, reduced): (&Fitted, &Fitted),
) -> Vec<Candidate> {
    let hybrid = &model.hybrid;
    if !in_offset_class(candidate.kind) {
        return Vec::new();
    }
    let Some(place) = pushed(candidate, hybrid) else {
        return Vec::new();
    };
    let there = |hybrid: &Hybrid, names: &[&str]| {
        hybrid.effects().iter().any(|e| {
            let (kind, target) = (e.kind, e.target);
            names.contains(&kind.name) && pushed(&Candidate { kind, target }, hybrid) == Some(place)
        })
    };
    let difference = "asymmetric_coulomb_friction";
    let rubs = there(&reduced.hybrid, &["coulomb_friction", difference]);
    if candidate.kind.name == difference && !rubs {
        return Vec::new();
    }
    let changed = there(hybrid, &BEHIND_INPUTS);
    let is_input = |kind: &Kind| kind.acts_on() == ActsOn::Input;
    let is_twin = |twin: &Candidate| {
        let apart = changed && is_input(twin.kind) != is_input(candidate.kind);
        let smooth = !rubs && twin.kind.name == difference;
        twin != candidate && pushed(twin, hybrid) == Some(place) && !apart && !smooth
    };
    OFFSET_CLASS
        .iter()
        .filter_map(|name| crate::effect::registry::find(name))
        .filter(|kind| !study.without.contains(kind))
        .flat_map(|kind| {
            let targets = match is_input(kind) {
                true => hybrid.inputs(),
                false => hybrid.nv(),
            };
            (0..targets).map(move |target| Candidate { kind, target })
        })
        .filter(is_twin)
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::pushes::tests::{prepared, prepared_with};
    use super::super::setup::Prepared;
    use super::*;

    #[test]
    fn an_offset_of_what_pushes_a_link_is_no_constant_force_on_any_joint() {
        let pushed_by = |name: &str| {
            let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
            let path = models.join(format!("{name}/{name}.toml"));
            let hybrid = Hybrid::of(&crate::model::Model::load(&path).unwrap());
            pushed(&Candidate::named("input_offset", 0), &hybrid)
        };
        assert_eq!(pushed_by("cartpole"), Some(0));
        assert_eq!(pushed_by("hovercraft"), None);
    }

    /// Without friction of the model's own, a difference of friction between the directions is friction as well, and no constant force.
    #[test]
    fn friction_by_direction_is_a_constant_force_only_beside_friction() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        let candidate = |name| Candidate::named(name, 0);
        let with = |fitted: &Fitted, name, values: &[f64]| {
            let theta = &fitted.inside.theta;
            let (hybrid, theta) = candidate(name).place(&fitted.hybrid, theta, values);
            study.fit(hybrid, fitted.start(theta), 0, 0)
        };
        let difference = candidate("asymmetric_coulomb_friction");
        let rubbing = with(&null, "coulomb_friction", &[0.2]);
        for (without, has_twins) in [(&null, false), (&rubbing, true)] {
            let found = with(without, difference.kind.name, &[0.3, 0.1]);
            let twins = twins_of(&study, &difference, (&found, without));
            assert_eq!(twins.contains(&candidate("constant_force")), has_twins);
            let found = with(without, "constant_force", &[0.1]);
            let twins = twins_of(&study, &candidate("constant_force"), (&found, without));
            assert_eq!(twins.contains(&difference), has_twins);
        }
    }

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
