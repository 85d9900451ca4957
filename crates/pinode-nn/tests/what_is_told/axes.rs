//! Two axes of a table, each on a spring, with a force on each that no library has: what one network on one of them cannot learn.

use pinode_nn::log::Log;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped, torque};

const NOISE: f64 = 5e-4;
/// N/m and N·s/m, known; both axes have 1 kg.
const STIFFNESS: f64 = 4.0;
const VISCOUS: f64 = 0.5;
/// N·s/m³: −d x² ẋ, as of a damper that is narrower away from the middle.
const NARROWING: [f64; 2] = [8.0, 5.0];

const MODEL: &str = "name = \"table\"\n\
     lagrangian = { coordinates = [\"x\", \"y\"], kinetic = \"0.5*x_dot^2 + 0.5*y_dot^2\", potential = \"2*x^2 + 2*y^2\" }\n\
     [[input]]\nname = \"along\"\njoint = \"x\"\n[[input]]\nname = \"across\"\njoint = \"y\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 0.5\nfixed = true\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"y\"\ncoefficient = 0.5\nfixed = true\n\
     [sensor.x]\nposition_noise = 5e-4\nvelocity = \"none\"\n\
     [sensor.y]\nposition_noise = 5e-4\nvelocity = \"none\"\n";

/// 40 s at 50 Hz.
fn log() -> Log {
    let mut noise = ChaCha8Rng::seed_from_u64(8);
    let mut noise = || -> f64 { NOISE * Distribution::<f64>::sample(&StandardNormal, &mut noise) };
    let t: Vec<f64> = (0..2000).map(|k| 0.02 * f64::from(k)).collect();
    let [along, across] =
        [0.0, 37.3].map(|from| -> Vec<f64> { t.iter().map(|t| 6.0 * torque(t + from)).collect() });
    let mut state = [0.0; 4];
    let (mut x, mut y) = (Vec::new(), Vec::new());
    for (along, across) in along.iter().zip(&across) {
        x.push(state[0] + noise());
        y.push(state[1] + noise());
        let force = |[d, u, q, v]: [f64; 4]| u - STIFFNESS * q - VISCOUS * v - d * q * q * v;
        for _ in 0..20 {
            state = stepped(state, 1e-3, |[x, y, v, w]: [f64; 4]| {
                [
                    v,
                    w,
                    force([NARROWING[0], *along, x, v]),
                    force([NARROWING[1], *across, y, w]),
                ]
            });
        }
    }
    recorded(t, vec![x, y], vec![along, across])
}

#[test]
fn forces_on_two_axes_that_no_library_has_are_learnt_by_one_network_on_both() {
    let found = diagnosed(&parsed(MODEL), log());
    let left = found
        .unexplained
        .unwrap_or_else(|| panic!("{:?}", found.effects));
    let learnt = left
        .learnt
        .unwrap_or_else(|| panic!("{:?}", left.sentences));
    let mut coordinates = learnt.coordinates.clone();
    coordinates.sort();
    assert_eq!(coordinates, ["x", "y"], "{:?}", left.sentences);
    assert_eq!(learnt.more_laws.len(), 1);
    // A network on one of them leaves the other as it was.
    for axis in &found.gap.coordinates {
        assert!(
            axis.after < 0.2 * axis.before,
            "{:?}",
            found.gap.coordinates
        );
    }
}
