//! A stage on a table whose bearing has dry friction that its model lacks, its damping known: a few seconds of it, and a clock that counts milliseconds.

use pinode_nn::diagnose::verdict::Diagnosis;
use pinode_nn::log::Log;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded};

const NOISE: f64 = 2e-5;
/// kg, N·s/m, N.
const MASS: f64 = 12.0;
const VISCOUS: f64 = 15.0;
const FRICTION: f64 = 6.0;
/// s, of the controller.
const INTERVAL: f64 = 2e-3;

const MODEL: &str = "name = \"stage\"\n\
     lagrangian = { coordinates = [\"x\"], kinetic = \"6*x_dot^2\", potential = \"0\" }\n\
     [[input]]\nname = \"motor\"\njoint = \"x\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 15.0\n";

/// So many seconds under a controller that follows three sines; friction stops the stage within a step where it can.
fn log(seconds: f64) -> Log {
    let mut noise = ChaCha8Rng::seed_from_u64(11);
    let mut noise = || -> f64 { NOISE * Distribution::<f64>::sample(&StandardNormal, &mut noise) };
    let wanted = |t: f64| {
        let sines = [(0.08, 1.9, 0.0), (0.03, 4.4, 1.0), (0.015, 6.9, 2.5)];
        let of = |(size, rate, phase): (f64, f64, f64)| {
            let angle = rate * t + phase;
            [
                size * (angle.sin() - phase.sin()),
                size * rate * angle.cos(),
            ]
        };
        let each = sines.map(of);
        [0, 1].map(|k| each.iter().map(|of| of[k]).sum::<f64>())
    };
    let (mut x, mut v) = (0.0, 0.0_f64);
    let (mut t, mut positions, mut forces) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..(seconds / INTERVAL) as u32 {
        let now = INTERVAL * f64::from(k);
        let [place, speed] = wanted(now);
        let force = 320.0 * (place - x) + 24.0 * (speed - v);
        t.push(now);
        positions.push(x + noise());
        forces.push(force);
        const PARTS: u32 = 40;
        let h = INTERVAL / f64::from(PARTS);
        for _ in 0..PARTS {
            let pushed = v + h * (force - VISCOUS * v) / MASS;
            let most = h * FRICTION / MASS;
            v = pushed - pushed.clamp(-most, most);
            x += h * v;
        }
    }
    recorded(t, vec![positions], vec![forces])
}

fn tells_the_friction(found: &Diagnosis) {
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "coulomb_friction");
    assert!(effect.confidence > 0.9, "{}", effect.confidence);
    let force = &effect.parameters["force"];
    let off = (force.value - FRICTION).abs();
    assert!(off < 0.02 * FRICTION, "{force:?}");
    assert!(off < 4.0 * force.std.unwrap(), "{force:?}");
}

/// They have been refused: they are ten windows of the usual length, and twelve are needed.
#[test]
fn friction_is_told_by_six_seconds() {
    tells_the_friction(&diagnosed(&parsed(MODEL), log(6.0)));
}

/// In a motion a thousand times as slow there is damping alone: the equations, moment by moment, had spoken for it.
#[test]
fn a_clock_in_milliseconds_is_told_where_damping_is_known() {
    let mut log = log(20.0);
    log.runs[0].t.iter_mut().for_each(|t| *t *= 1000.0);
    let found = diagnosed(&parsed(MODEL), log);
    let [fault] = found.data_faults.as_slice() else {
        panic!("{:?}", found.data_faults)
    };
    assert_eq!((&*fault.kind, &*fault.column), ("convention", "t"));
    assert!(fault.detail.contains("is in ms"), "{}", fault.detail);
    tells_the_friction(&found);
}
