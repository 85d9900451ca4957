//! Friction that sticks.

use super::pendulum::*;
use pinode_nn::diagnose::verdict::Diagnosis;

const FORCE: f64 = 0.2;

/// What friction of so much force lets through of the other forces on a pendulum, sums with them to nothing at rest: what would stop it within a few of the
/// integrator's steps, of 0.25 ms, or hold it where it is.
fn rubs([q, v]: [f64; 2], u: f64, force: f64) -> f64 {
    let stops = INERTIA * v / 1e-3 + u - WEIGHT * q.sin();
    -stops.clamp(-force, force)
}

/// A log of a pendulum with friction by its speed, driven by a motor of so many times the torque.
fn rubbing(gain: f64, seed: u64, friction: impl Fn(f64) -> f64) -> Diagnosis {
    let motor = format!("name = \"motor\"\ngain = {gain}");
    let driven = text(true).replace("name = \"motor\"", &motor);
    let law = |_, [q, v]: [f64; 2], u: f64| {
        let u = gain * u - VISCOUS * v;
        u + rubs([q, v], u, friction(v))
    };
    diagnosed(&parsed(&driven), log(seed, law))
}

fn is_coulomb_friction(found: &Diagnosis, within: f64) {
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "coulomb_friction", "{effect:?}");
    let force = effect.parameters["force"].value;
    assert!((force / FORCE - 1.0).abs() < within, "{force}");
}

/// The steps and the smoothed friction of a search are too coarse for a pendulum that sticks now and then, and what they miss looks like a force that is
/// larger at low speed, or another one elsewhere.
#[test]
fn friction_that_sticks_is_not_called_a_law_with_more_constants() {
    let found = rubbing(0.35, 16, |_| FORCE);
    is_coulomb_friction(&found, 0.01);
    assert!(found.gap.after < 1.5, "{:?}", found.gap);
}

/// Most of the time the motor does not move the pendulum at all. A model without friction swings where it rests, so that no linearisation shows friction:
/// what the motor does while it rests does.
#[test]
fn friction_that_hardly_ever_slips_is_friction_and_no_inertia() {
    let found = rubbing(0.25, 12, |_| FORCE);
    is_coulomb_friction(&found, 0.03);
    assert!(found.gap.after < 1.5, "{:?}", found.gap);
}

#[test]
fn friction_that_halves_half_way_is_said_to_change() {
    let found = diagnosed(
        &model(true),
        log(3, |t, [q, v], u| {
            let force = if t < 30.0 { 0.08 } else { 0.04 };
            let u = u - VISCOUS * v;
            u + rubs([q, v], u, force)
        }),
    );
    let change = found
        .change
        .as_ref()
        .unwrap_or_else(|| panic!("{:?}", found.effects));
    assert!(change.name.contains("friction"), "{change:?}");
    assert!(change.before > change.after, "{change:?}");
    assert!((20.0..40.0).contains(&change.t), "{change:?}");
}

/// An elastic drive holds a pendulum that hardly slips better than friction does that is not yet sharp.
#[test]
fn stribeck_friction_that_hardly_ever_slips_is_found_with_its_constants() {
    let found = rubbing(0.35, 21, |v| 0.15 + 0.1 * (-(v / 0.1).powi(2)).exp());
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "stribeck_friction", "{effect:?}");
    let value = |name: &str| effect.parameters[name].value;
    for (name, expected) in [
        ("coulomb_force", 0.15),
        ("static_force", 0.25),
        ("stribeck_velocity", 0.1),
    ] {
        assert!((value(name) / expected - 1.0).abs() < 0.15, "{effect:?}");
    }
    assert!(found.gap.after < 2.5, "{:?}", found.gap);
}

/// A sensor of 2·10⁻⁴ rad sees what smoothed friction does at rest, which the friction that the model knows of does not do: the gain was called a scale
/// of the sensor.
#[test]
fn known_friction_that_sticks_hides_no_gain_and_stands_for_no_sensor() {
    const GAIN: f64 = 0.5;
    const FINE: f64 = 2e-4;
    let motor = format!("name = \"motor\"\ngain = {GAIN}");
    let knows = text(true)
        .replace("name = \"motor\"", &motor)
        .replace(&format!("{NOISE:e}"), &format!("{FINE:e}"))
        + &format!("[[effect]]\nkind = \"coulomb_friction\"\njoint = \"phi\"\nforce = {FORCE}\n");
    let law = |_, [q, v]: [f64; 2], u: f64| {
        let u = 0.8 * GAIN * u - VISCOUS * v;
        u + rubs([q, v], u, FORCE)
    };
    let found = diagnosed(&parsed(&knows), log_by(FINE, 42, law));
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "input_gain_error", "{effect:?}");
    let gain = effect.parameters["gain"].value;
    assert!((gain + 0.2).abs() < 0.03, "{gain}");
}

/// As many simulations have it, and a film of oil: below half a rad/s it is viscous.
#[test]
fn friction_whose_sign_is_spread_over_the_speeds_of_the_motion_is_said_to_hold_nothing() {
    const SPREAD: f64 = 0.5;
    let law = |_, [_, v]: [f64; 2], u| u - VISCOUS * v - 0.05 * (v / SPREAD).tanh();
    let found = diagnosed(&model(true), log_of_swings(18, law));
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "coulomb_friction", "{effect:?}");
    let force = effect.parameters["force"].value;
    assert!((force / 0.05 - 1.0).abs() < 0.03, "{force}");
    assert!(found.gap.after < 1.5, "{:?}", found.gap);
    let said = "the Coulomb friction on `phi` does not hold it at rest: its sign is spread over ";
    let said = found.advice.iter().find_map(|a| a.strip_prefix(said));
    let spread = said.unwrap_or_else(|| panic!("{:?}", found.advice));
    let spread: f64 = spread.split(' ').next().unwrap().parse().unwrap();
    assert!((spread / SPREAD).log2().abs() < 0.5, "{spread}");
}
