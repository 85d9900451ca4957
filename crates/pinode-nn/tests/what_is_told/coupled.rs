//! Two bodies with a spring between them, each of which counts from where it stands: no law of one coordinate is what the model lacks.

use pinode_nn::log::Log;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped, torque};

const NOISE: f64 = 5e-4;
/// N/m, N·s/m; both bodies have 1 kg.
const STIFFNESS: f64 = 25.0;
const DAMPING: f64 = 0.3;
const VISCOUS: f64 = 1.5;

const MODEL: &str = "name = \"wagons\"\n\
     lagrangian = { coordinates = [\"front\", \"rear\"], kinetic = \"0.5*front_dot^2 + 0.5*rear_dot^2\", potential = \"0\" }\n\
     [[input]]\nname = \"engine\"\njoint = \"front\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"front\"\ncoefficient = 1.5\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"rear\"\ncoefficient = 1.5\n\
     [sensor.front]\nposition_noise = 5e-4\nvelocity = \"none\"\n\
     [sensor.rear]\nposition_noise = 5e-4\nvelocity = \"none\"\n";

/// 30 s at 50 Hz of an engine that pulls a wagon by a spring with this damping, read with this noise; the wagon so many ms late, after it has stood.
fn log(size: f64, damping: f64, late: usize) -> Log {
    let mut noise = ChaCha8Rng::seed_from_u64(3);
    let mut noise = || -> f64 { StandardNormal.sample(&mut noise) };
    let t: Vec<f64> = (0..1500).map(|k| 0.02 * f64::from(k)).collect();
    let u: Vec<f64> = t.iter().map(|&t| 6.0 * torque(t)).collect();
    let mut x = [0.0; 4];
    let (mut front, mut rear) = (Vec::new(), Vec::new());
    let mut past = vec![0.0; 1 + late];
    for &u in &u {
        front.push(x[0] + size * noise());
        rear.push(past[past.len() - 1 - late] + size * noise());
        let rates = |x: [f64; 4]| {
            let pull = STIFFNESS * (x[1] - x[0]) + damping * (x[3] - x[2]);
            [
                x[2],
                x[3],
                u + pull - VISCOUS * x[2],
                -pull - VISCOUS * x[3],
            ]
        };
        let h = 1e-3;
        for _ in 0..20 {
            x = stepped(x, h, rates);
            past.push(x[1]);
        }
    }
    recorded(t, vec![front, rear], vec![u])
}

#[test]
fn a_force_between_two_bodies_is_said_to_follow_the_one_from_the_other() {
    let found = diagnosed(&parsed(MODEL), log(NOISE, DAMPING, 0));
    let worst = &found.disagreement[0];
    let from = "follows the position of rear from front";
    assert!(worst.r#where.starts_with(from), "{worst:?}");
    let left = found
        .unexplained
        .unwrap_or_else(|| panic!("{:?}", found.effects));
    let follows = left.follows.unwrap_or_default();
    assert_eq!(follows, "the position of `rear` from `front`");
}

/// What is read in the first 35 ms of a window was before it, under forces that the window does not know: that was taken to be smooth, and the late sensor lost to
/// whatever else there is.
#[test]
fn a_wagon_that_is_read_late_is_told_however_little_noise_there_is() {
    let model = MODEL
        .replace("potential = \"0\"", "potential = \"12.5*(rear - front)^2\"")
        .replace("5e-4", "5e-6");
    let log = log(5e-6, 0.0, 35);
    let found = diagnosed(&parsed(&model), log.clone());
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(
        (effect.kind.as_str(), effect.target.as_str()),
        ("sensor_delay", "rear")
    );
    let delay = &effect.parameters["delay"];
    assert!((delay.value - 0.035).abs() < 3e-6, "{delay:?}");
    let late = "[[effect]]\nkind = \"sensor_delay\"\njoint = \"rear\"\ndelay = 0.035\n";
    let of_truth = diagnosed(&parsed(&format!("{model}{late}")), log)
        .gap
        .before;
    assert!(
        found.gap.after < 1.3 * of_truth,
        "{:?}, {of_truth}",
        found.gap
    );
}
