//! A slide of which a fault has two names that are one equation.
//!
//! (m + J) ẍ = u − F tanh(v/w) − d v is m ẍ = (1 + g) (u − …) with 1 + g = m/(m + J): an inertia that is too large is a gain that is too small, with all friction in proportion.

use pinode_nn::diagnose::verdict::Verdict;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped};

/// Steps to a sample of 5 ms.
const STEPS: usize = 20;
const NOISE: f64 = 1e-5;

const MODEL: &str = "name = \"slide\"\n\
     [lagrangian]\ncoordinates = [\"x\"]\nkinetic = \"0.5*m*x_dot^2\"\npotential = \"0*x\"\nparameters = { m = 2.0 }\n\
     [tolerance]\nparameters = { m = 0.02 }\ngain = 0.01\n\
     [[input]]\nname = \"motor\"\njoint = \"x\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 5.0\n\
     [sensor.x]\nposition_noise = 1e-5\nvelocity = \"none\"\n";

/// Beside dry friction no screen sees that, for its roll-outs stick where another inertia slips: the gain alone had been told.
#[test]
fn an_inertia_that_is_too_large_may_be_a_gain_that_is_too_small_beside_friction() {
    let (mass, coulomb, viscous) = (2.3, 2.0, 5.0);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
    let t: Vec<f64> = (0..6000).map(|k| 5e-3 * f64::from(k)).collect();
    let (mut q, mut u) = (Vec::new(), Vec::new());
    let mut state = [0.0, 0.0];
    for &t in &t {
        let read = state[0] + NOISE * noise();
        let wanted = 0.2 * (2.0 * t).sin() + 0.1 * (5.3 * t + 1.0).sin();
        let push = 60.0 * (wanted - read) - 10.0 * state[1];
        q.push(read);
        u.push(push);
        for _ in 0..STEPS {
            state = stepped(state, 5e-3 / STEPS as f64, |[_, v]| {
                let friction = coulomb * (v / 1e-3).tanh() + viscous * v;
                [v, (push - friction) / mass]
            });
        }
    }
    let found = diagnosed(&parsed(MODEL), recorded(t, vec![q], vec![u]));
    assert_eq!(found.verdict, Verdict::EffectsFound);
    let kinds: Vec<&str> = found.effects.iter().map(|e| &*e.kind).collect();
    let [friction, other] = found.effects.as_slice() else {
        panic!("{kinds:?}");
    };
    assert_eq!(friction.kind, "coulomb_friction");
    let others = other.indistinguishable_from.iter();
    let mut names: Vec<&str> = others.map(|other| &*other.kind).collect();
    names.push(&other.kind);
    for name in ["input_gain_error", "reflected_inertia"] {
        assert!(names.contains(&name), "{name} in {names:?}");
    }
}
