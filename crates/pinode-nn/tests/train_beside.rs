//! What a network learns beside effects with a memory and behind sensors that distort is the force that is missing, and no more than that.
//!
//! The logs are of a sledge whose friction no effect has, integrated here by midpoint steps of 0.5 ms.

use pinode_nn::learnt::Quantity;
use pinode_nn::log::Log;
use pinode_nn::model::Model;
use pinode_nn::network::Activation;
use pinode_nn::train::{Options, Training, train};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const MODEL: &str = include_str!("data/known_sledge.toml");
/// kg, m, s.
const MASS: f64 = 2.0;
const NOISE: f64 = 3e-4;
const INTERVAL: f64 = 0.02;

/// What lies between input and log, and is known.
#[derive(Clone, Copy)]
struct Rig {
    /// Stiffness, N/m, damping, N·s/m, and motor inertia, kg, of a string.
    string: Option<[f64; 3]>,
    /// The sensor reads factor times what was so many samples ago.
    late: usize,
    factor: f64,
}

const PLAIN: Rig = Rig {
    string: None,
    late: 0,
    factor: 1.0,
};

/// The force that the model lacks, N at v m/s.
fn missing(v: f64) -> f64 {
    -1.5 * v - 0.6 * (2.0 * v).sin()
}

impl Rig {
    /// (ẋ, v̇, ż, z̈) under the input u, z the motor's place.
    fn rates(&self, [x, v, z, w]: [f64; 4], u: f64) -> [f64; 4] {
        match self.string {
            Some([k, c, j]) => {
                let pull = k * (z - x) + c * (w - v);
                [v, (pull + missing(v)) / MASS, w, (u - pull) / j]
            }
            None => [v, (u + missing(v)) / MASS, v, 0.0],
        }
    }

    fn log(&self, duration: f64) -> String {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (mut state, mut u) = ([0.0; 4], 0.0);
        let mut places = Vec::new();
        let mut text = "t,q.x,u.push\n".to_owned();
        for k in 0..(duration / INTERVAL) as usize {
            if k % 20 == 0 {
                u = rng.random_range(-6.0..6.0) - state[0];
            }
            places.push(state[0]);
            let noise: f64 = rng.sample(StandardNormal);
            let read = self.factor * places[k.saturating_sub(self.late)] + NOISE * noise;
            text += &format!("{},{read},{u}\n", INTERVAL * k as f64);
            for _ in 0..40 {
                let h = INTERVAL / 40.0;
                let along = |state: [f64; 4], rates: [f64; 4], h: f64| -> [f64; 4] {
                    std::array::from_fn(|i| state[i] + h * rates[i])
                };
                let middle = along(state, self.rates(state, u), 0.5 * h);
                state = along(state, self.rates(middle, u), h);
            }
        }
        text
    }

    /// What a network that learns beside `known` misses of the force, root mean square, N; and the loss of the windows held out, in squares of the noise.
    fn missed(&self, known: &str, epochs: usize) -> (f64, f64) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(&path, self.log(60.0)).unwrap();
        let text = MODEL.replace("1e-3", &NOISE.to_string()) + known;
        let model = Model::parse(&folder.path().join("sledge.toml"), text).unwrap();
        let log = Log::read(&path, &model).unwrap();
        let options = Options {
            quantities: vec![Quantity::Velocity(0)],
            units: vec![24, 24],
            hidden: Activation::Tanh,
            rate: 5e-3,
            epochs,
            ..Options::new(vec![0])
        };
        let training = Training {
            model: &model,
            logs: &[log],
            held_out: &[],
        };
        let trained = train(&training, &options, None, &mut |_| Ok(())).unwrap();
        let force = &trained.force;
        let feature = &force.features()[0];
        let squares = (-10..=10).map(|k| {
            let v = 0.15 * f64::from(k);
            let z = (v - feature.offset) / feature.width;
            let found = force.outputs()[0].scale * force.network().evaluate(&[z])[0];
            (found - missing(v)).powi(2)
        });
        let last = trained.history.last().unwrap();
        ((squares.sum::<f64>() / 21.0).sqrt(), last.held_out)
    }
}

#[test]
fn a_network_learns_the_friction_behind_an_elastic_string() {
    let rig = Rig {
        string: Some([120.0, 1.5, 0.4]),
        ..PLAIN
    };
    let known = "[[effect]]\nkind = 'elastic_transmission'\ninput = 'push'\nstiffness = 120.0\ndamping = 1.5\nmotor_inertia = 0.4\nfixed = true\n";
    let (missed, loss) = rig.missed(known, 200);
    assert!(missed < 0.06 && loss < 1.3, "{missed} N, {loss}");
    // Without the string no force at the sledge is right.
    let (_, loss) = rig.missed("", 40);
    assert!(loss > 10.0, "{loss}");
}

#[test]
fn a_network_learns_the_friction_behind_a_sensor_that_is_late_and_long() {
    let rig = Rig {
        late: 2,
        factor: 1.1,
        ..PLAIN
    };
    let known = "[[effect]]\nkind = 'sensor_delay'\njoint = 'x'\ndelay = 0.04\nfixed = true\n\
        [[effect]]\nkind = 'sensor_scale'\njoint = 'x'\nscale = 0.1\nfixed = true\n";
    let (missed, loss) = rig.missed(known, 200);
    assert!(missed < 0.06 && loss < 3.0, "{missed} N, {loss}");
    let (missed, loss) = rig.missed("", 40);
    assert!(missed > 0.2 && loss > 10.0, "{missed} N, {loss}");
}

#[test]
fn a_memory_that_is_too_fast_is_refused_with_a_cure() {
    let lugre = |stiffness: &str| {
        format!(
            "[[effect]]\nkind = 'lugre_friction'\njoint = 'x'\nstiffness = {stiffness}\ndamping = 100.0\ncoulomb_force = 1.0\nstatic_force = 1.5\n\
             stribeck_velocity = 0.1\n"
        )
    };
    let refused = |stiffness: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(&path, PLAIN.log(20.0)).unwrap();
        let text = MODEL.to_owned() + &lugre(stiffness);
        let model = Model::parse(&folder.path().join("sledge.toml"), text).unwrap();
        let training = Training {
            model: &model,
            logs: &[Log::read(&path, &model).unwrap()],
            held_out: &[],
        };
        train(&training, &Options::new(vec![0]), None, &mut |_| Ok(()))
            .unwrap_err()
            .to_string()
    };
    let fast = refused("3e3");
    assert!(
        fast.contains("give --step") && fast.contains("pinode diagnose"),
        "{fast}"
    );
    let too_fast = refused("1e7");
    assert!(
        !too_fast.contains("--step") && too_fast.contains("take it out"),
        "{too_fast}"
    );
}
