//! A drive that rings from sample to sample, by equations and steps of its own.

use pinode_nn::log::Log;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped};

/// kg of the motor, as it acts on the carriage of 1 kg; N/m and N·s/m of the belt between them: 250 rad/s, a tenth of the critical damping.
const MOTOR: f64 = 0.1;
const STIFFNESS: f64 = 5700.0;
const DAMPING: f64 = 4.5;
const VISCOUS: f64 = 3.0;
/// Steps of 0.1 ms to a sample of 4 ms.
const STEPS: usize = 40;

const MODEL: &str = "name = \"carriage\"\n\
     lagrangian = { coordinates = [\"carriage\"], kinetic = \"0.5*carriage_dot^2\", potential = \"0\" }\n\
     [[input]]\nname = \"motor\"\njoint = \"carriage\"\n\
     [tolerance]\ngain = 0.0\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"carriage\"\ncoefficient = 3.0\n\
     [sensor.carriage]\nposition_noise = 1e-4\nvelocity = \"none\"\n";

/// 48 s at 250 Hz of pushes of up to 15 N that change every 60 ms.
fn log() -> Log {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let (mut q, mut t, mut u) = (Vec::new(), Vec::new(), Vec::new());
    // The carriage, the motor as it acts on it, and their velocities.
    let mut x = [0.0; 4];
    let mut push = 0.0;
    for k in 0..12000 {
        if k % 15 == 0 {
            push = 15.0 * random.random_range(-1.0..1.0) - 20.0 * x[0];
        }
        let noise: f64 = StandardNormal.sample(&mut random);
        t.push(0.004 * f64::from(k));
        q.push(x[0] + 1e-4 * noise);
        u.push(push);
        let rates = |x: [f64; 4]| {
            let belt = STIFFNESS * (x[1] - x[0]) + DAMPING * (x[3] - x[2]);
            [x[2], x[3], belt - VISCOUS * x[2], (push - belt) / MOTOR]
        };
        let h = 0.004 / STEPS as f64;
        for _ in 0..STEPS {
            x = stepped(x, h, rates);
        }
    }
    recorded(t, vec![q], vec![u])
}

/// Steps of a whole sample move no roll-out by more than a third of the noise, and the stiffness with them is 2 % too high: five standard errors.
#[test]
fn a_drive_that_rings_within_a_few_samples_has_its_stiffness_and_its_damping() {
    let found = diagnosed(&parsed(MODEL), log());
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "elastic_transmission");
    for (name, truth) in [
        ("stiffness", STIFFNESS),
        ("damping", DAMPING),
        ("motor_inertia", MOTOR),
    ] {
        let own = &effect.parameters[name];
        let error = own.std.unwrap_or(f64::INFINITY);
        let off = (own.value - truth).abs();
        assert!(off < 3.0 * error, "{name} {truth}: {own:?}");
        assert!(error < 0.1 * truth, "{name}: {own:?}");
    }
}
