//! Two wagons with an engine each that are pushed late: what is late everywhere may be the clock.

use pinode_nn::diagnose::verdict::Diagnosis;
use pinode_nn::log::Log;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped, torque};

const NOISE: f64 = 5e-4;
/// N/m, N·s/m; both wagons have 1 kg.
const STIFFNESS: f64 = 25.0;
const VISCOUS: f64 = 1.5;

const MODEL: &str = "name = \"wagons\"\n\
     lagrangian = { coordinates = [\"front\", \"rear\"], kinetic = \"0.5*front_dot^2 + 0.5*rear_dot^2\", potential = \"12.5*(rear - front)^2\" }\n\
     [[input]]\nname = \"pulling\"\njoint = \"front\"\n\
     [[input]]\nname = \"pushing\"\njoint = \"rear\"\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"front\"\ncoefficient = 1.5\n\
     [[effect]]\nkind = \"viscous_friction\"\njoint = \"rear\"\ncoefficient = 1.5\n\
     [sensor.front]\nposition_noise = 5e-4\nvelocity = \"none\"\n\
     [sensor.rear]\nposition_noise = 5e-4\nvelocity = \"none\"\n";

/// 30 s at 50 Hz, the engines so many ms late.
fn log(late: [usize; 2]) -> Log {
    let mut noise = ChaCha8Rng::seed_from_u64(3);
    let mut noise = || -> f64 { StandardNormal.sample(&mut noise) };
    let t: Vec<f64> = (0..1500).map(|k| 0.02 * f64::from(k)).collect();
    let u = [
        t.iter().map(|&t| 6.0 * torque(t)).collect::<Vec<f64>>(),
        t.iter().map(|&t| 3.0 * torque(1.3 * t + 1.0)).collect(),
    ];
    let mut x = [0.0; 4];
    let mut q = vec![Vec::new(), Vec::new()];
    for k in 0..t.len() {
        for (column, x) in q.iter_mut().zip(x) {
            column.push(x + NOISE * noise());
        }
        for ms in 0..20 {
            let held = |engine: usize| {
                let at = (20 * k + ms).saturating_sub(late[engine]);
                u[engine][at / 20]
            };
            let rates = |x: [f64; 4]| {
                let pull = STIFFNESS * (x[1] - x[0]);
                [
                    x[2],
                    x[3],
                    held(0) + pull - VISCOUS * x[2],
                    held(1) - pull - VISCOUS * x[3],
                ]
            };
            x = stepped(x, 1e-3, rates);
        }
    }
    recorded(t, q, u.to_vec())
}

/// A found effect: kind and target, those that it cannot be told from, and its delay, s.
#[derive(Debug)]
struct Told<'a> {
    name: [&'a str; 2],
    others: Vec<[&'a str; 2]>,
    delay: f64,
}

fn told(found: &Diagnosis) -> Vec<Told<'_>> {
    let effects = found.effects.iter();
    let told = effects.map(|effect| {
        let others = effect.indistinguishable_from.iter();
        let others = others.map(|other| [other.kind.as_str(), other.target.as_str()]);
        Told {
            name: [effect.kind.as_str(), effect.target.as_str()],
            others: others.collect(),
            delay: effect.parameters["delay"].value,
        }
    });
    told.collect()
}

#[test]
fn engines_that_are_late_by_the_same_may_be_wagons_that_are_read_late() {
    let found = diagnosed(&parsed(MODEL), log([30, 30]));
    let mut told = told(&found);
    told.sort_by_key(|told| told.name);
    let [pulling, pushing] = &told[..] else {
        panic!("{told:?}")
    };
    assert_eq!(pulling.name, ["input_delay", "pulling"]);
    assert_eq!(pulling.others, [["sensor_delay", "front"]]);
    assert_eq!(pushing.name, ["input_delay", "pushing"]);
    assert_eq!(pushing.others, [["sensor_delay", "rear"]]);
    for engine in [pulling, pushing] {
        assert!((engine.delay - 0.03).abs() < 1e-3, "{engine:?}");
    }
}

#[test]
fn one_engine_that_is_late_is_no_other_clock() {
    let found = diagnosed(&parsed(MODEL), log([30, 0]));
    let told = told(&found);
    let [only] = &told[..] else {
        panic!("{told:?}")
    };
    assert_eq!(only.name, ["input_delay", "pulling"]);
    assert!(only.others.is_empty(), "{only:?}");
    assert!((only.delay - 0.03).abs() < 1e-3, "{only:?}");
}
