//! A block that is pushed now and then, and rests for nineteen twentieths of the time.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::*;
use pinode_nn::diagnose::verdict::Diagnosis;

const MASS: f64 = 0.3;
const DAMPING: f64 = 0.2;
const SENSOR: f64 = 2e-4;
const INTERVAL: f64 = 0.01;

/// What is found in 150 s of so many pushes, each a quarter of a second there and as long back, over a table of so much dry friction, N. Each begins at
/// any time in its own 20 s.
fn pushed(pushes: usize, friction: f64, seed: u64) -> Diagnosis {
    const SUBSTEPS: usize = 100;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut force = vec![0.0; 15_000];
    for push in 0..pushes {
        let start = 500 + 2000 * push + rng.random_range(0..1500);
        let size: f64 = rng.random_range(1.0..2.5);
        force[start..start + 25].fill(size);
        force[start + 25..start + 50].fill(-size);
    }
    let h = INTERVAL / SUBSTEPS as f64;
    let (mut x, mut v, mut read) = (0.0, 0.0, Vec::new());
    for &u in &force {
        let noise: f64 = StandardNormal.sample(&mut rng);
        read.push(x + SENSOR * noise);
        for _ in 0..SUBSTEPS {
            // What would stop it within the step, or hold it where it is.
            let stops = MASS * v / h + u - DAMPING * v;
            v += h / MASS * (u - DAMPING * v - stops.clamp(-friction, friction));
            x += h * v;
        }
    }
    let model = parsed(&format!(
        "name = \"block\"\n\
         lagrangian = {{ coordinates = [\"x\"], kinetic = \"0.5*{MASS}*x_dot^2\", potential = \"0\" }}\n\
         [[input]]\nname = \"push\"\njoint = \"x\"\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = {DAMPING}\n\
         [sensor.x]\nposition_noise = {SENSOR:e}\nvelocity = \"none\"\n"
    ));
    let mut log = log_of_swings(0, |_, _, u| u);
    let run = &mut log.runs[0];
    run.t = (0..force.len()).map(|k| INTERVAL * k as f64).collect();
    (run.q, run.u) = (vec![read], vec![force]);
    diagnosed(&model, log)
}

/// Averages over windows in which it rests hid how steadily the pushes say so, and a scale of the sensor or a gain, which may each be off a little, was
/// named in its place.
#[test]
fn friction_is_found_in_a_few_pushes_between_long_rests() {
    const FORCE: f64 = 0.15;
    for seed in [1, 2, 3] {
        let found = pushed(7, FORCE, seed);
        let [effect] = found.effects.as_slice() else {
            panic!("{seed}: {:?} {:?}", found.verdict, found.effects);
        };
        assert_eq!(effect.kind, "coulomb_friction", "{seed}");
        let force = &effect.parameters["force"];
        assert!(
            (force.value / FORCE - 1.0).abs() < 0.02,
            "{seed}: {force:?}"
        );
        assert!(found.gap.after < 1.5, "{seed}: {:?}", found.gap);
    }
}

#[test]
fn nothing_is_found_in_an_exact_model_of_a_few_pushes_between_long_rests() {
    for seed in [4, 5] {
        let found = pushed(7, 0.0, seed);
        assert!(found.effects.is_empty(), "{seed}: {:?}", found.effects);
        assert!(
            found.unexplained.is_none(),
            "{seed}: {:?}",
            found.unexplained
        );
    }
}

/// Its busy windows alone are fewer than a fit needs: then those of the rests count as well.
#[test]
fn a_log_of_one_push_is_not_refused() {
    let found = pushed(1, 0.0, 6);
    assert!(found.effects.is_empty(), "{:?}", found.effects);
    assert!(found.gap.windows > 4, "{:?}", found.gap);
}
