//! A slide whose force arrives late, or slowly, by a part of a sample.
//!
//! m ẍ = y − d ẋ, y(t) = u(t − T) or τ ẏ = u − y, u another at every sample: a feedback of noisy readings, and what the operator wants.

use pinode_nn::diagnose::verdict::Verdict;
use pinode_nn::log::Log;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped};

const INTERVAL: f64 = 5e-3;
const STEPS: usize = 100;
const MASS: f64 = 2.0;
const VISCOUS: f64 = 5.0;
const NOISE: f64 = 1e-5;

const MODEL: &str = "name = \"slide\"\n\
     [lagrangian]\ncoordinates = [\"x\"]\nkinetic = \"0.5*m*x_dot^2\"\npotential = \"0*x\"\nparameters = { m = 2.0 }\n\
     [[input]]\nname = \"motor\"\njoint = \"x\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 5.0\n\
     [sensor.x]\nposition_noise = 1e-5\nvelocity = \"none\"\n";

/// 40 s at 200 Hz; `steps` of a hundredth of a sample late, and slow with the time constant `slow`, s.
fn log(steps: usize, slow: Option<f64>) -> Log {
    let h = INTERVAL / STEPS as f64;
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
    let t: Vec<f64> = (0..8000).map(|k| INTERVAL * f64::from(k)).collect();
    let (mut q, mut u) = (Vec::new(), Vec::new());
    let (mut state, mut before) = ([0.0, 0.0, 0.0], 0.0);
    for &t in &t {
        let read = state[0] + NOISE * noise();
        let wanted = 0.2 * (2.0 * t).sin() + 0.1 * (5.3 * t + 1.0).sin();
        let push = 60.0 * (wanted - read) - 10.0 * state[1] + 3.0 * noise();
        q.push(read);
        u.push(push);
        for step in 0..STEPS {
            let arrives = if step < steps { before } else { push };
            state = stepped(state, h, |[_, v, y]| {
                let (force, rate) = match slow {
                    Some(slow) => (y, (arrives - y) / slow),
                    None => (arrives, 0.0),
                };
                [v, (force - VISCOUS * v) / MASS, rate]
            });
        }
        before = push;
    }
    recorded(t, vec![q], vec![u])
}

/// The force over a step is known by its mean; within a sample what is late by as much as what is slow has nearly the same, and had been told with > 99 % for it.
#[test]
fn what_is_slow_by_a_part_of_a_sample_is_not_late_and_what_is_late_is_not_slow() {
    for (log, kind, parameter) in [
        (log(0, Some(2e-3)), "actuator_lag", "time_constant"),
        (log(40, None), "input_delay", "delay"),
    ] {
        let found = diagnosed(&parsed(MODEL), log);
        assert_eq!(found.verdict, Verdict::EffectsFound, "{kind}");
        let [effect] = found.effects.as_slice() else {
            panic!("{kind}: {:?}", found.effects);
        };
        assert_eq!(effect.kind, kind);
        // The sensor of a single axis that is late is one equation with its input that is, and no slow input.
        let others: Vec<&str> = effect
            .indistinguishable_from
            .iter()
            .map(|other| &*other.kind)
            .collect();
        let expected: &[&str] = if kind == "input_delay" {
            &["sensor_delay"]
        } else {
            &[]
        };
        assert_eq!(others, expected, "{kind}");
        let value = &effect.parameters[parameter];
        let off = (value.value - 2e-3).abs();
        assert!(off < 2e-5, "{kind}: {value:?}");
        assert!(off < 3.0 * value.std.unwrap(), "{kind}: {value:?}");
    }
}
