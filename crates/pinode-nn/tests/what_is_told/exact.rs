//! Logs of simulations whose velocities are exact.

use pinode_nn::diagnose::verdict::Verdict;
use pinode_nn::train::{Options, Training, train};

use super::pendulum::*;

/// N·m at v rad/s; the model lacks it, and no effect is it.
fn lacking(v: f64) -> f64 {
    -0.02 * v - 0.03 * (2.0 * v).sin()
}

fn measured() -> String {
    text(true).replace("velocity = \"none\"", "velocity = \"measured\"")
}

/// The noise of the velocity was what differences of a smooth motion leave, 10⁻⁸ of it. In units of that the errors of the steps were forces, as large as the
/// friction itself, that nothing explains; with more samples the diagnosis did not end, of ever finer steps.
#[test]
fn dry_friction_beside_exact_velocities_is_all_that_is_found() {
    let dry = |v: f64| 0.06 * (v / 2e-4).tanh();
    let log = log_of_both(NOISE, 21, |_, [_, v], u| u - VISCOUS * v - dry(v));
    let found = diagnosed(&parsed(&measured()), log);
    assert_eq!(found.verdict, Verdict::EffectsFound);
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "coulomb_friction");
    assert!(effect.confidence > 0.9, "{effect:?}");
    let force = effect.parameters["force"].value;
    assert!((force / 0.06 - 1.0).abs() < 3e-3, "{force}");
    assert!(found.unexplained.is_none(), "{:?}", found.unexplained);
}

/// A network lowered what is held out to a fifth, where it does to a fiftieth beside what a sensor might read.
#[test]
fn a_network_learns_from_exact_velocities_beside_noisy_positions() {
    let log = log_of_both(NOISE, 22, |_, [_, v], u| u - VISCOUS * v + lacking(v));
    let model = parsed(&measured());
    let options = Options {
        units: vec![16],
        epochs: 60,
        ..Options::new(vec![0])
    };
    let training = Training {
        model: &model,
        logs: &[log],
        held_out: &[],
    };
    let trained =
        train(&training, &options, None, &mut |_| Ok(())).unwrap_or_else(|e| panic!("{e}"));
    let best = trained
        .history
        .iter()
        .map(|epoch| epoch.held_out)
        .fold(f64::INFINITY, f64::min);
    let without = trained.without_network.unwrap();
    assert!(best < 0.1 * without, "{best} {without}");
}
