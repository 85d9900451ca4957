//! A cart on a rail with a pole that hangs from it, under feedback: what acts on both at once.
//!
//! (M + m) ẍ + m l (φ̈ cos φ − φ̇² sin φ) = u − d ẋ − R(ẋ) − (M + m) g sin α
//! (J + m l²) φ̈ + m l ẍ cos φ = −m g l sin(φ + α) − b φ̇

use std::f64::consts::TAU;

use pinode_nn::diagnose::verdict::{Diagnosis, NamedEffect, Verdict};
use pinode_nn::log::Log;

use super::pendulum::{accelerated, diagnosed, parsed, under_feedback};

const CART: f64 = 0.8;
const POLE: f64 = 0.15;
const LENGTH: f64 = 0.3;
const INERTIA: f64 = 0.004;
const GRAVITY: f64 = 9.81;
const VISCOUS: [f64; 2] = [0.8, 0.003];
const NOISE: [f64; 2] = [2e-4, 5e-4];
const TILT: f64 = 0.02;

const MODEL: &str = "name = \"cart\"\n\
     [lagrangian]\ncoordinates = [\"x\", \"phi\"]\nangles = [\"phi\"]\n\
     kinetic = \"0.5*(M+m)*x_dot^2 + m*l*x_dot*phi_dot*cos(phi) + 0.5*(J+m*l^2)*phi_dot^2\"\n\
     potential = \"-m*g*l*cos(phi)\"\n\
     parameters = { M = 0.8, m = 0.15, l = 0.3, J = 0.004, g = 9.81 }\n\
     [[input]]\nname = \"motor\"\njoint = \"x\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 0.8\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"phi\"\ncoefficient = 0.003\n\
     [sensor.x]\nposition_noise = 2e-4\nvelocity = \"none\"\n\
     [sensor.phi]\nposition_noise = 5e-4\nvelocity = \"none\"\n";

/// What is not as the model has it.
struct Truth {
    /// α, rad.
    tilt: f64,
    /// m, kg.
    pole: f64,
    /// R, N.
    rubs: fn(f64) -> f64,
    /// How far the cart is sent, m.
    reach: f64,
}

const AS_MODELLED: Truth = Truth {
    tilt: 0.0,
    pole: POLE,
    rubs: |_| 0.0,
    reach: 0.08,
};

/// 50 s at 100 Hz along sines.
fn log(truth: &Truth) -> Log {
    let t = (0..5000).map(|k| 0.01 * f64::from(k)).collect();
    let push = |t: f64, read: [f64; 2], state: [f64; 4]| {
        let wave = |k: i32| {
            let (k, phase) = (f64::from(k), 1.7 * f64::from(k * k));
            (TAU * (0.13 + 0.22 * k) * t + phase).sin() / (1.0 + 0.5 * k)
        };
        let wanted: f64 = truth.reach * (0..7).map(wave).sum::<f64>();
        let dither = 0.54 * (TAU * 0.85 * t + 2.0 * (0.3 * t).sin()).sin();
        25.0 * (wanted - read[0]) - 6.0 * state[2] + dither
    };
    let rates = |[_, phi, v, w]: [f64; 4], push: f64| {
        let &Truth {
            tilt, pole, rubs, ..
        } = truth;
        let mass = CART + pole;
        let forces = [
            push - VISCOUS[0] * v - rubs(v) - mass * GRAVITY * tilt.sin()
                + pole * LENGTH * w * w * phi.sin(),
            -pole * GRAVITY * LENGTH * (phi + tilt).sin() - VISCOUS[1] * w,
        ];
        let (both, own) = (pole * LENGTH * phi.cos(), INERTIA + pole * LENGTH * LENGTH);
        let [a, b] = accelerated([mass, both, own], forces);
        [v, w, a, b]
    };
    under_feedback(
        t,
        (NOISE, 11),
        (2e-4, 50),
        [0.03, 0.4, 0.0, 0.0],
        push,
        rates,
    )
}

/// Either of them alone moves the pole in a way that it does not move: a cart that rolls down takes its pole along.
#[test]
fn a_tilted_rail_is_a_force_on_the_cart_beside_another_zero_of_the_pole() {
    let tilted = Truth {
        tilt: TILT,
        ..AS_MODELLED
    };
    let found = diagnosed(&parsed(MODEL), log(&tilted));
    assert_eq!(found.verdict, Verdict::EffectsFound, "{:?}", found.effects);
    let size = |kinds: &[&str], on_the_pole: bool| {
        let is = |e: &&NamedEffect| kinds.contains(&&*e.kind) && (e.target == "phi") == on_the_pole;
        let found = found.effects.iter().find(is)?;
        let size = found.parameters.values().next().unwrap();
        Some((size.value, size.std.unwrap()))
    };
    let close = |found: f64, truth: f64, within: f64| {
        assert!((found / truth - 1.0).abs() < within, "{found} {truth}");
    };
    let (pull, std) = size(&["constant_force", "input_offset"], false).unwrap();
    let weight = (CART + POLE) * GRAVITY * TILT.sin();
    close(pull, -weight, 0.02);
    assert!((pull + weight).abs() < 4.0 * std, "{pull} {std}");
    // What is left is that the cart does not pull along the level: a part of the zero may be called a torque, for which it is much the same.
    let (zero, _) = size(&["sensor_offset"], true).unwrap();
    let (torque, _) = size(&["constant_force"], true).unwrap_or_default();
    close(zero + torque / (POLE * GRAVITY * LENGTH), -TILT, 0.04);
    assert!(found.gap.after < 0.1 * found.gap.before, "{:?}", found.gap);
}

/// It had been two effects with > 99 % each: a force that changes with the angle, and an inertia.
#[test]
fn a_mass_in_energies_that_is_off_is_told_as_that_mass() {
    let heavy = Truth {
        pole: 1.08 * POLE,
        ..AS_MODELLED
    };
    let found = diagnosed(&parsed(MODEL), log(&heavy));
    assert_eq!(
        found.verdict,
        Verdict::NothingMissing,
        "{:?}",
        found.effects
    );
    let mut constants = found.constants.iter();
    let mass = constants.find(|c| c.name == "`m`").unwrap();
    let off = (mass.fitted - heavy.pole).abs();
    assert!(off < 0.005 * heavy.pole, "{mass:?}");
    assert!(off < 4.0 * mass.std.unwrap(), "{mass:?}");
    assert!(found.gap.after < 0.1 * found.gap.before, "{:?}", found.gap);
    let told = |a: &String| a.contains("`m` went from 0.150 to 0.16");
    assert!(found.advice.iter().any(told), "{:?}", found.advice);
}

/// One that the model says is exact is exact: then it is what does the same.
#[test]
fn a_mass_in_energies_that_is_said_to_be_exact_stays() {
    let heavy = Truth {
        pole: 1.08 * POLE,
        ..AS_MODELLED
    };
    let exact = "[tolerance]\nparameters = { M = 0, m = 0, l = 0, J = 0, g = 0 }\n";
    let found = diagnosed(&parsed(&format!("{MODEL}{exact}")), log(&heavy));
    assert!(!found.constants.iter().any(|c| c.name == "`m`"));
    assert_ne!(found.verdict, Verdict::NothingMissing);
}

/// What was found of the cart, which is one effect of this kind.
fn only<'a>(found: &'a Diagnosis, kind: &str) -> &'a NamedEffect {
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!((&*effect.kind, &*effect.target), (kind, "x"));
    effect
}

/// Sharper or less sharp than the library has it, by no more than a factor of two: what is left of it had been a spring that slips, a hump at low speed, or a part of
/// the force.
#[test]
fn dry_friction_whose_sign_is_spread_a_little_otherwise_is_dry_friction() {
    let less_sharp: fn(f64) -> f64 = |v| 0.5 * (v / 0.005).tanh();
    let sharper: fn(f64) -> f64 = |v| 0.5 * (v / 0.002).tanh();
    for rubs in [less_sharp, sharper] {
        let truth = Truth {
            rubs,
            ..AS_MODELLED
        };
        let found = diagnosed(&parsed(MODEL), log(&truth));
        let effect = only(&found, "coulomb_friction");
        let force = &effect.parameters["force"];
        let off = (force.value - 0.5).abs();
        assert!(off < 0.005, "{force:?}");
        assert!(off < 3.0 * force.std.unwrap(), "{force:?}");
    }
}

/// A hump at 50 mm/s of a motion that is faster than 1 m/s in one sample of twenty. On faster carts Coulomb friction may stand for it: BENCHMARKS, "How sharp dry friction is".
#[test]
fn a_hump_of_friction_that_the_motion_hardly_visits_is_stribeck_friction() {
    let truth = Truth {
        rubs: |v| (0.4 + 0.35 * (-(v / 0.05).powi(2)).exp()) * (v / 0.001).tanh(),
        reach: 0.3,
        ..AS_MODELLED
    };
    let found = diagnosed(&parsed(MODEL), log(&truth));
    let effect = only(&found, "stribeck_friction");
    for (name, truth, within) in [
        ("coulomb_force", 0.4, 0.01),
        ("static_force", 0.75, 0.1),
        ("stribeck_velocity", 0.05, 0.1),
    ] {
        let found = &effect.parameters[name];
        let off = (found.value - truth).abs();
        assert!(off < within * truth, "{name}: {found:?}");
        assert!(off < 4.0 * found.std.unwrap(), "{name}: {found:?}");
    }
}
