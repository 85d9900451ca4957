//! Effects that the model has as `fixed`: what is known exactly stays, and more of its kind may act beside it.

use super::pendulum::*;
use pinode_nn::diagnose::verdict::{Diagnosis, Verdict};

/// The only effect that was found, of this kind and beside a fixed one, and its only parameter.
fn only(found: &Diagnosis, kind: &str) -> (f64, f64) {
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, kind, "{effect:?}");
    assert!(effect.beside_fixed && effect.confidence > 0.9, "{effect:?}");
    let parameter = effect.parameters.values().next().unwrap();
    (parameter.value, parameter.std.unwrap())
}

#[test]
fn more_viscous_friction_than_is_fixed_is_viscous_friction() {
    let found = diagnosed(&model(true), log(11, |_, [_, v], u| u - 0.025 * v));
    let (more, error) = only(&found, "viscous_friction");
    assert!(
        (more - 0.015).abs() < 3.0 * error && error < 5e-4,
        "{more} ± {error}"
    );
    assert!(found.gap.after < 1.5, "{:?}", found.gap);
}

/// The friction that is fixed stands in the new model as it was given, and what was found beside it.
#[test]
fn a_model_with_more_than_is_fixed_is_written_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let log = log(12, |_, [_, v], u| u - 0.025 * v);
    let outcome = pinode_nn::diagnose::diagnose(&model(true), &[log], &[], dir.path(), 0, &|_| ())
        .unwrap_or_else(|e| panic!("{e}"));
    let written = pinode_nn::model::Model::load(&outcome.model).unwrap_or_else(|e| panic!("{e}"));
    let [known, more] = written.effects.as_slice() else {
        panic!("{:?}", written.effects);
    };
    assert!(known.fixed && known.values == [VISCOUS], "{known:?}");
    assert!(
        !more.fixed && (more.values[0] - 0.015).abs() < 1e-3,
        "{more:?}"
    );
}

#[test]
fn drag_beside_fixed_friction_is_drag() {
    let law = |_, [_, v]: [f64; 2], u: f64| u - VISCOUS * v - 0.004 * v.abs() * v;
    let found = diagnosed(&model(true), log(13, law));
    let [drag] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(drag.kind, "quadratic_drag", "{drag:?}");
    assert!(!drag.beside_fixed);
}

#[test]
fn nothing_is_missing_beside_fixed_friction_that_is_right() {
    let found = diagnosed(&model(true), log(14, |_, [_, v], u| u - VISCOUS * v));
    assert_eq!(
        found.verdict,
        Verdict::NothingMissing,
        "{:?}",
        found.effects
    );
}

#[test]
fn less_viscous_friction_than_is_fixed_is_that() {
    let found = diagnosed(&model(true), log(15, |_, [_, v], u| u - 0.004 * v));
    let (less, error) = only(&found, "viscous_friction");
    assert!(
        (less + 0.006).abs() < 3.0 * error && error < 5e-4,
        "{less} ± {error}"
    );
    // It swings round and round at up to 20 rad/s: estimated starts are worth less than in a slow motion.
    assert!(found.gap.after < 2.0, "{:?}", found.gap);
}

#[test]
fn less_coulomb_friction_than_is_fixed_is_that() {
    let given = parsed(&format!(
        "{}[[effect]]\nkind = \"coulomb_friction\"\njoint = \"phi\"\nforce = 0.06\nfixed = true\n",
        text(true)
    ));
    let law = |_, [_, v]: [f64; 2], u: f64| u - VISCOUS * v - 0.04 * (v / 1e-3).tanh();
    let found = diagnosed(&given, log(16, law));
    let (less, error) = only(&found, "coulomb_friction");
    assert!(
        (less + 0.02).abs() < 3.5 * error && error < 1e-3,
        "{less} ± {error}"
    );
}

/// Whichever stands first in the file.
#[test]
fn a_model_may_take_from_what_is_fixed_and_no_more_than_that() {
    let less = |coefficient: f64| {
        format!(
            "[[effect]]\nkind = \"viscous_friction\"\njoint = \"phi\"\ncoefficient = {coefficient}\n"
        )
    };
    let after = parsed(&format!("{}{}", text(true), less(-0.4 * VISCOUS)));
    let (head, tail) = text(true)
        .split_once("[[effect]]")
        .map(|(a, b)| (a.to_owned(), b.to_owned()))
        .unwrap();
    let before = parsed(&format!("{head}{}[[effect]]{tail}", less(-0.4 * VISCOUS)));
    for model in [after, before] {
        let hybrid = pinode_nn::hybrid::Hybrid::of(&model);
        let lower = hybrid
            .constants()
            .iter()
            .filter(|c| c.value == -0.4 * VISCOUS)
            .map(|c| c.lower);
        assert_eq!(lower.collect::<Vec<_>>(), [-VISCOUS]);
    }
    let too_much = format!("{}{}", text(true), less(-1.1 * VISCOUS));
    let refused = pinode_nn::model::Model::parse("m.toml".as_ref(), too_much)
        .err()
        .unwrap()
        .to_string();
    assert!(refused.contains("at least -0.01 N·m·s/rad"), "{refused}");
    let alone = format!("{}{}", text(false), less(-0.4 * VISCOUS));
    assert!(pinode_nn::model::Model::parse("m.toml".as_ref(), alone).is_err());
}
