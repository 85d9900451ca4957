//! Effects that no data of a mechanism tell apart, for they are one equation.

use super::candidate::Candidate;
use super::clock::{LATE, on_another_clock};
use super::study::{Fitted, Study};
use crate::effect::{ActsOn, Kind, registry};
use crate::hybrid::Hybrid;

/// The offset class: while sliding, a constant force, an offset of the input and a difference of Coulomb friction between the directions are one
/// equation.
const OFFSET_CLASS: [&str; 3] = [
    "constant_force",
    "asymmetric_coulomb_friction",
    "input_offset",
];

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

/// The twins of an effect of a model, one of those `added` to what was given, `reduced` the model without it: a difference of Coulomb friction is one only where there is such friction
/// on the same coordinate without it, an offset of the input only where that arrives as it is.
pub fn twins_of(
    study: &Study,
    candidate: &Candidate,
    added: &[Candidate],
    (model, reduced): (&Fitted, &Fitted),
) -> Vec<Candidate> {
    let hybrid = &model.hybrid;
    if LATE.contains(&candidate.kind.name) {
        return late_twins(study, candidate, added, model);
    }
    if !OFFSET_CLASS.contains(&candidate.kind.name) {
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
        .filter_map(|name| registry::find(name))
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

/// Whether a candidate is asked for as another of `all`: of two delays that are one equation the input's, which no sample is lost to.
pub fn is_told_as_another(candidate: &Candidate, all: &[Candidate], hybrid: &Hybrid) -> bool {
    let [pushed, read] = LATE;
    let is_there = all.iter().any(|other| other.kind.name == pushed);
    candidate.kind.name == read && is_there && is_one_delay(hybrid)
}

/// One coordinate and one input.
fn is_one_delay(hybrid: &Hybrid) -> bool {
    hybrid.nv() == 1 && hybrid.inputs() == 1
}

/// The other delay, where there is one only, or all are late by the same.
fn late_twins(
    study: &Study,
    candidate: &Candidate,
    added: &[Candidate],
    model: &Fitted,
) -> Vec<Candidate> {
    let twin = match is_one_delay(&model.hybrid) {
        true => LATE
            .iter()
            .filter(|name| **name != candidate.kind.name)
            .find_map(|name| registry::find(name))
            .map(|kind| Candidate { kind, target: 0 }),
        false => on_another_clock(candidate, added, model),
    };
    twin.filter(|twin| !study.without.contains(&twin.kind))
        .into_iter()
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::pushes::tests::prepared;
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
            let twins = twins_of(&study, &difference, &[], (&found, without));
            assert_eq!(twins.contains(&candidate("constant_force")), has_twins);
            let found = with(without, "constant_force", &[0.1]);
            let twins = twins_of(&study, &candidate("constant_force"), &[], (&found, without));
            assert_eq!(twins.contains(&difference), has_twins);
        }
    }

    #[test]
    fn one_input_that_is_late_is_one_coordinate_that_is_read_late() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        let [pushed, read] = LATE.map(|name| Candidate::named(name, 0));
        assert_eq!(twins_of(&study, &pushed, &[pushed], (&null, &null)), [read]);
        assert_eq!(twins_of(&study, &read, &[read], (&null, &null)), [pushed]);
        let both = [pushed, read];
        assert!(is_told_as_another(&read, &both, &null.hybrid));
        assert!(!is_told_as_another(&pushed, &both, &null.hybrid));
        assert!(!is_told_as_another(&read, &both[1..], &null.hybrid));
        let without = Study {
            without: vec![read.kind],
            ..study
        };
        assert!(twins_of(&without, &pushed, &[pushed], (&null, &null)).is_empty());
        let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let cartpole = crate::model::Model::load(&models.join("cartpole/cartpole.toml")).unwrap();
        assert!(!is_one_delay(&Hybrid::of(&cartpole)));
    }
}
