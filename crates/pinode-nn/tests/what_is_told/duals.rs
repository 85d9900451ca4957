//! A slide of which a fault has two names that are one equation.
//!
//! m ẍ = (1 + g) u − d ẋ, read as (1 + s) x: without a law that knows the position g alone moves the readings as s does.

use pinode_nn::diagnose::verdict::Verdict;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped};

const INTERVAL: f64 = 5e-3;
const STEPS: usize = 20;
const MASS: f64 = 2.0;
const VISCOUS: f64 = 5.0;
const NOISE: f64 = 1e-5;

const MODEL: &str = "name = \"slide\"\n\
     [lagrangian]\ncoordinates = [\"x\"]\nkinetic = \"0.5*m*x_dot^2\"\npotential = \"0*x\"\nparameters = { m = 2.0 }\n\
     [tolerance]\nparameters = { m = 0.001 }\ngain = 0.01\n\
     [[input]]\nname = \"motor\"\njoint = \"x\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 5.0\nfixed = true\n\
     [sensor.x]\nposition_noise = 1e-5\nvelocity = \"none\"\n";

/// The gain alone had been told, with > 99 %.
#[test]
fn a_sensor_that_reads_too_much_may_be_an_input_that_pushes_too_much() {
    let h = INTERVAL / STEPS as f64;
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
    let t: Vec<f64> = (0..6000).map(|k| INTERVAL * f64::from(k)).collect();
    let (mut q, mut u) = (Vec::new(), Vec::new());
    let mut state = [0.0, 0.0];
    for &t in &t {
        let read = 1.04 * state[0] + NOISE * noise();
        let wanted = 0.2 * (2.0 * t).sin() + 0.1 * (5.3 * t + 1.0).sin();
        let push = 60.0 * (wanted - read) - 10.0 * state[1];
        q.push(read);
        u.push(push);
        for _ in 0..STEPS {
            state = stepped(state, h, |[_, v]| [v, (push - VISCOUS * v) / MASS]);
        }
    }
    let found = diagnosed(&parsed(MODEL), recorded(t, vec![q], vec![u]));
    assert_eq!(found.verdict, Verdict::EffectsFound);
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    let others = effect.indistinguishable_from.iter();
    let mut names: Vec<&str> = others.map(|other| &*other.kind).collect();
    names.push(&effect.kind);
    for name in ["input_gain_error", "sensor_scale"] {
        assert!(names.contains(&name), "{name} in {names:?}");
    }
}
