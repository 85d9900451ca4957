//! An input that is late, hidden by a force that no library has: the screens see it only beside the network that has learnt the force.

use pinode_nn::log::Log;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped, torque};

const NOISE: f64 = 5e-4;
/// kg, N/m, N·s/m and N per unit of the input, known.
const MASS: f64 = 1.5;
const STIFFNESS: f64 = 4.0;
const VISCOUS: f64 = 0.8;
const GAIN: f64 = 2.0;
/// By so many samples of 10 ms the input acts late.
const LATE: usize = 4;

const MODEL: &str = "name = \"mass on a rail\"\n\
     lagrangian = { coordinates = [\"x\"], kinetic = \"0.75*x_dot^2\", potential = \"2*x^2\" }\n\
     [[input]]\nname = \"f\"\njoint = \"x\"\ngain = 2.0\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 0.8\nfixed = true\n\
     [sensor.x]\nposition_noise = 5e-4\nvelocity = \"none\"\n";

/// N: of a damper that is wider in the middle, and more so on one side.
fn damper(x: f64, v: f64) -> f64 {
    -8.0 * x * x * v + 1.2 * x * v
}

/// 60 s at 100 Hz.
fn log() -> Log {
    let mut noise = ChaCha8Rng::seed_from_u64(9);
    let mut noise = || -> f64 { NOISE * Distribution::<f64>::sample(&StandardNormal, &mut noise) };
    let t: Vec<f64> = (0..6000).map(|k| 0.01 * f64::from(k)).collect();
    // Steps show when it acts.
    let put_out = |t: &f64| 2.0 * torque(*t) + 1.2 * (2.3 * t).sin().signum();
    let input: Vec<f64> = t.iter().map(put_out).collect();
    let mut state = [0.0; 2];
    let mut x = Vec::new();
    for k in 0..t.len() {
        x.push(state[0] + noise());
        let acts = k.checked_sub(LATE).map_or(0.0, |k| GAIN * input[k]);
        for _ in 0..10 {
            state = stepped(state, 1e-3, |[x, v]: [f64; 2]| {
                let force = acts - STIFFNESS * x - VISCOUS * v + damper(x, v);
                [v, force / MASS]
            });
        }
    }
    recorded(t, vec![x], vec![input])
}

#[test]
fn a_delay_behind_a_force_that_no_library_has_is_found_beside_the_network_that_learns_the_force() {
    let found = diagnosed(&parsed(MODEL), log());
    let left = found.unexplained.unwrap();
    let [delay] = &found.effects[..] else {
        panic!("{:?} {:?}", found.effects, left.sentences)
    };
    assert_eq!((&*delay.kind, &*delay.target), ("input_delay", "f"));
    let time = &delay.parameters["delay"];
    let error = time.std.unwrap();
    assert!(error < 2e-3, "{time:?}");
    assert!((time.value - 0.04).abs() < 3.0 * error, "{time:?}");
    assert!(delay.confidence > 0.9, "{delay:?}");
    let learnt = left.learnt.unwrap();
    assert_eq!(learnt.coordinates, ["x"]);
    let [gap] = &found.gap.coordinates[..] else {
        panic!("{:?}", found.gap)
    };
    assert!(gap.after < 0.1 * gap.before, "{gap:?}");
}
