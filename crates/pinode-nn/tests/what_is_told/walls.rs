//! A carriage between two walls, by equations and steps of its own.

use pinode_nn::diagnose::diagnose_without;
use pinode_nn::effect::registry;
use pinode_nn::log::Log;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{parsed, recorded, stepped};

const NOISE: f64 = 2e-5;
const VISCOUS: f64 = 3.0;
/// m, N/m, N·s/m: each wall.
const WALL: (f64, f64, f64) = (0.1, 2e4, 20.0);

const MODEL: &str = "name = \"carriage\"\n\
     lagrangian = { coordinates = [\"carriage\"], kinetic = \"0.5*carriage_dot^2\", potential = \"0\" }\n\
     [[input]]\nname = \"motor\"\njoint = \"carriage\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"carriage\"\ncoefficient = 3.0\n\
     [sensor.carriage]\nposition_noise = 2e-5\nvelocity = \"none\"\n";

/// 60 s at 50 Hz of pushes that change every 0.4 s, and throw it against the walls in the first three quarters alone.
fn log() -> Log {
    const STEPS: usize = 100;
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let (mut q, mut u) = (Vec::new(), Vec::new());
    let (mut x, mut push) = ([0.0, 0.0], 0.0);
    let t: Vec<f64> = (0..3000).map(|k| 0.02 * f64::from(k)).collect();
    for (k, &t) in t.iter().enumerate() {
        if k % 20 == 0 {
            let size = if t < 44.0 { 6.0 } else { 1.0 };
            push = size * random.random_range(-1.0..1.0) - 10.0 * x[0];
        }
        let noise: f64 = StandardNormal.sample(&mut random);
        q.push(x[0] + NOISE * noise);
        u.push(push);
        let rates = |[x, v]: [f64; 2]| {
            let (place, stiffness, damping) = WALL;
            let wall = match x.abs() > place {
                true => -stiffness * (x - place * x.signum()) - damping * v,
                false => 0.0,
            };
            [v, push - VISCOUS * v + wall]
        };
        let h = 0.02 / STEPS as f64;
        for _ in 0..STEPS {
            x = stepped(x, h, rates);
        }
    }
    recorded(t, vec![q], vec![u])
}

/// A fit without walls makes its friction and its gain what walls would be on average, and a model that ran between them within the noise was written a hundred
/// times as bad.
#[test]
fn constants_that_only_make_up_for_what_was_not_found_are_not_written() {
    let without = registry::all();
    let dir = tempfile::tempdir().unwrap();
    let outcome = diagnose_without(
        &parsed(MODEL),
        &[log()],
        &[],
        dir.path(),
        0,
        &without,
        &|_| (),
    );
    let found = outcome.unwrap_or_else(|e| panic!("{e}")).diagnosis;
    assert!(found.effects.is_empty(), "{:?}", found.effects);
    let gap = &found.gap;
    assert!(gap.after < 1.5 * gap.before, "{gap:?}");
}
