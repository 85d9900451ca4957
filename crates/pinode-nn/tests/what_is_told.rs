//! What a diagnosis tells of logs that no constant law explains, or that hold a mistake of who recorded them. The logs come from an
//! integrator of their own here, of a pendulum's closed form.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};

use pinode_nn::diagnose::diagnose;
use pinode_nn::diagnose::verdict::{Diagnosis, Verdict};
use pinode_nn::log::{Log, Run};
use pinode_nn::model::Model;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const NOISE: f64 = 1e-3;
/// m l², m g l, and the viscous friction that the model knows of.
const INERTIA: f64 = 0.05;
const WEIGHT: f64 = 0.981;
const VISCOUS: f64 = 0.01;

fn model(fixed: bool) -> Model {
    parsed(&text(fixed))
}

fn parsed(text: &str) -> Model {
    Model::parse(Path::new("pendulum.toml"), text.to_owned()).unwrap_or_else(|e| panic!("{e}"))
}

fn text(fixed: bool) -> String {
    format!(
        "name = \"pendulum\"\n\
         lagrangian = {{ coordinates = [\"phi\"], angles = [\"phi\"], kinetic = \"0.5*{INERTIA}*phi_dot^2\", potential = \"-{WEIGHT}*cos(phi)\" }}\n\
         [[input]]\nname = \"motor\"\njoint = \"phi\"\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"phi\"\ncoefficient = {VISCOUS}\nfixed = {fixed}\n\
         [sensor.phi]\nposition_noise = {NOISE:e}\nvelocity = \"none\"\n"
    )
}

/// A torque of four sines, N·m.
fn torque(t: f64) -> f64 {
    0.35 * (1.3 * t).sin()
        + 0.3 * (2.9 * t + 1.0).sin()
        + 0.25 * (4.7 * t + 2.0).sin()
        + 0.2 * (7.1 * t + 0.5).sin()
}

/// 60 s at 50 Hz of I φ̈ = −m g l sin φ − d φ̇ + τ, τ held from sample to sample, by `law`(t, [φ, φ̇], u) = τ − d φ̇.
fn log(seed: u64, law: impl Fn(f64, [f64; 2], f64) -> f64) -> Log {
    log_by(NOISE, seed, law)
}

/// The same by a sensor of this noise.
fn log_by(sensor: f64, seed: u64, law: impl Fn(f64, [f64; 2], f64) -> f64) -> Log {
    const SUBSTEPS: usize = 20;
    let mut noise = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = || -> f64 { StandardNormal.sample(&mut noise) };
    let t: Vec<f64> = (0..3000).map(|k| 0.02 * f64::from(k)).collect();
    let u: Vec<f64> = t.iter().map(|&t| torque(t)).collect();
    let h = 0.02 / SUBSTEPS as f64;
    let mut x = [0.2, 0.0];
    let mut q = Vec::new();
    for (&start, &u) in t.iter().zip(&u) {
        q.push(x[0] + sensor * noise());
        for k in 0..SUBSTEPS {
            let now = start + h * k as f64;
            let slope =
                |x: [f64; 2], t: f64| [x[1], (law(t, x, u) - WEIGHT * x[0].sin()) / INERTIA];
            let ahead = |by: f64, k: [f64; 2]| [x[0] + by * k[0], x[1] + by * k[1]];
            let a = slope(x, now);
            let b = slope(ahead(0.5 * h, a), now + 0.5 * h);
            let c = slope(ahead(0.5 * h, b), now + 0.5 * h);
            let d = slope(ahead(h, c), now + h);
            x = [0, 1].map(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
    }
    Log {
        path: PathBuf::from("log.csv"),
        sha256: String::new(),
        runs: vec![Run {
            id: "0".into(),
            t,
            q: vec![q],
            v: vec![None],
            u: vec![u],
        }],
        warnings: Vec::new(),
    }
}

fn diagnosed(model: &Model, log: Log) -> Diagnosis {
    let dir = tempfile::tempdir().unwrap();
    diagnose(model, &[log], &[], dir.path(), 0, &|_| ())
        .unwrap_or_else(|e| panic!("{e}"))
        .diagnosis
}

#[test]
fn milliseconds_for_seconds_are_refused() {
    let mut log = log(6, |_, [_, v], u| u - VISCOUS * v);
    log.runs[0].t.iter_mut().for_each(|t| *t *= 1000.0);
    let dir = tempfile::tempdir().unwrap();
    let outcome = diagnose(&model(false), &[log], &[], dir.path(), 0, &|_| ());
    let error = outcome.err().unwrap();
    assert!(error.to_string().contains("is `t` in seconds?"), "{error}");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

fn advises(diagnosis: &Diagnosis, words: &str) -> bool {
    diagnosis.advice.iter().any(|a| a.contains(words))
}

#[test]
fn an_input_of_the_wrong_sign_is_said_to_be_reversed() {
    let found = diagnosed(&model(false), log(1, |_, [_, v], u| -u - VISCOUS * v));
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "input_gain_error");
    let gain = effect.parameters["gain"].value;
    assert!((gain + 2.0).abs() < 0.03, "{gain}");
    assert!(advises(&found, "the other way round"), "{:?}", found.advice);
    assert!(found.gap.after < 3.0, "{:?}", found.gap);
}

#[test]
fn a_motor_that_weakens_is_said_to_change_with_time() {
    let weaker = |t: f64| 1.0 - 0.3 * t / 60.0;
    let found = diagnosed(
        &model(true),
        log(2, |t, [_, v], u| weaker(t) * u - VISCOUS * v),
    );
    let change = found
        .change
        .as_ref()
        .unwrap_or_else(|| panic!("{:?}", found.advice));
    assert!(change.name.contains("gain"), "{change:?}");
    // It weakens: the gain error, or the gain, is higher before than after, by half of what it loses over the fitted 45 s.
    let loss = change.before - change.after;
    assert!((0.06..0.2).contains(&loss), "{change:?}");
    assert!((10.0..35.0).contains(&change.t), "{change:?}");
    assert!(
        advises(&found, "not one number over the log"),
        "{:?}",
        found.advice
    );
}

#[test]
fn what_stays_the_same_is_not_said_to_change() {
    let found = diagnosed(&model(false), log(3, |_, [_, v], u| 0.8 * u - VISCOUS * v));
    assert_eq!(found.change, None);
    assert_eq!(found.verdict, Verdict::EffectsFound);
}

#[test]
fn friction_that_warms_up_does_not_end_with_nothing_missing() {
    // The model's own friction moves to the mean of it, which serves the last quarter worse than what was given.
    let extra = |t: f64| 0.04 * (-t / 15.0).exp();
    let found = diagnosed(
        &model(false),
        log(4, |t, [_, v], u| u - (VISCOUS + extra(t)) * v),
    );
    assert_ne!(found.verdict, Verdict::NothingMissing, "{:?}", found.gap);
    assert!(
        advises(&found, "free runs over data that no fit has seen"),
        "{:?}",
        found.advice
    );
}

#[test]
fn known_friction_that_moves_far_is_said() {
    let found = diagnosed(&model(false), log(5, |_, [_, v], u| u - 0.03 * v));
    assert_eq!(found.verdict, Verdict::NothingMissing);
    assert!(
        advises(&found, "without `fixed = true`"),
        "{:?}",
        found.advice
    );
}

#[test]
fn a_stop_that_gives_for_a_sixth_of_a_second_is_a_stop() {
    // π √(m l²/k) = 0.172 s
    let (place, stiffness) = (0.1, 16.7);
    let pushes = |q: f64| -stiffness * (q - place).max(0.0);
    // What goes round has no ends: here it does not, by a motor of 0.4 times the torque.
    let swings = text(false)
        .replace(" angles = [\"phi\"],", "")
        .replace("name = \"motor\"", "name = \"motor\"\ngain = 0.4");
    let found = diagnosed(
        &parsed(&swings),
        log(7, |_, [q, v], u| 0.4 * u - VISCOUS * v + pushes(q)),
    );
    let [stop] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(stop.kind, "end_stop");
    let value = |name: &str| stop.parameters[name].value;
    assert!((value("upper") - place).abs() < 2e-3, "{stop:?}");
    assert!(
        (value("stiffness") / stiffness - 1.0).abs() < 0.02,
        "{stop:?}"
    );
}

const FORCE: f64 = 0.2;

/// What friction of so much force lets through of the other forces on a pendulum, sums with them to nothing at rest: what would stop it within a few of the
/// integrator's steps, of 1 ms, or hold it where it is.
fn rubs([q, v]: [f64; 2], u: f64, force: f64) -> f64 {
    let stops = INERTIA * v / 4e-3 + u - WEIGHT * q.sin();
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
