//! What a network of the last resort sees, and how it begins.
//!
//! It sees only the signals z that the missing law was seen to follow; where there is no hint of any, the joint's position and velocity and what drives it.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::leftover::{Leftover, Off};
use super::matched::matched;
use super::needed::Needed;
use super::shapes::Follows;
use crate::entries::starts;
use crate::hybrid::Hybrid;
use crate::learnt::{Feature, LearntForce, Output, Quantity, usual_quantities};
use crate::log::same_rate;
use crate::network::{Activation, Mlp, Shape};

/// Hidden units: so many, and so many more for each signal; at most the last.
const UNITS: [usize; 3] = [8, 4, 24];
/// How steep they are at first, in deviations of the signals.
const SLOPES: [f64; 2] = [0.5, 10.0];
/// What an input was so many samples ago.
const AGO: [usize; 5] = [1, 2, 3, 5, 8];

/// How much a network sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight {
    /// What the force was seen to follow.
    Followed,
    /// All that moves and that the motion depends on.
    All,
}

impl Leftover<'_> {
    /// What a network on some coordinates sees; angles that wrap by cosine and sine.
    pub fn quantities(&self, off: &[&Off], sight: Sight, hybrid: &Hybrid) -> Vec<Quantity> {
        if sight == Sight::All {
            return usual_quantities(self.model, false);
        }
        let coordinates = self.model.mechanics.coordinates();
        let sees = off.iter().flat_map(|off| self.followed(off, hybrid));
        let mut distinct = Vec::new();
        for quantity in sees {
            let wraps = |c: usize| coordinates.get(c).is_some_and(|c| c.wraps);
            let parts = match quantity {
                Quantity::Position(c) if wraps(c) => vec![Quantity::Cosine(c), Quantity::Sine(c)],
                other => vec![other],
            };
            for part in parts {
                if !distinct.contains(&part) {
                    distinct.push(part);
                }
            }
        }
        distinct
    }

    /// Whether all that moves is more than what the forces were seen to follow.
    pub fn is_more(&self, off: &[&Off], hybrid: &Hybrid) -> bool {
        let [followed, all] =
            [Sight::Followed, Sight::All].map(|sight| self.quantities(off, sight, hybrid));
        all.iter().any(|quantity| !followed.contains(quantity))
    }

    /// What the force on a coordinate may follow.
    fn followed(&self, off: &Off, hybrid: &Hybrid) -> Vec<Quantity> {
        let c = off.coordinate;
        let own = |input: &usize| hybrid.moves(*input, c);
        let inputs: Vec<usize> = (0..self.model.inputs.len()).filter(own).collect();
        let ago = |back: usize| -> Vec<Quantity> {
            let of = |&input: &usize| Quantity::Input { input, back };
            inputs.iter().map(of).collect()
        };
        let (place, speed) = (Quantity::Position(c), Quantity::Velocity(c));
        let mut sees = match off.follows {
            None => [vec![place, speed], ago(0)].concat(),
            Some(Follows::Velocity) => vec![speed],
            Some(Follows::Position) => vec![place],
            Some(Follows::PositionBeyond) => vec![place, Quantity::Position(c + 1)],
            Some(Follows::VelocityBeyond) => vec![speed, Quantity::Velocity(c + 1)],
            // A network remembers nothing: what it can know of the past of the motion is where that has led.
            Some(Follows::PositionAndDirection | Follows::PastMotion) => vec![place, speed],
            Some(Follows::Input) => ago(0),
            // Samples ago are those of the log, which may have been thinned.
            Some(Follows::PastInput) if !same_rate(self.study.interval, self.sitting.interval) => {
                ago(0)
            }
            Some(Follows::PastInput) => {
                [0].iter().chain(&AGO).flat_map(|&back| ago(back)).collect()
            }
        };
        sees.extend(&off.signals);
        sees
    }

    /// What it sees of the samples in the windows that are fitted, one row a sample.
    pub fn states(&self, hybrid: &Hybrid, theta: &[f64], quantities: &[Quantity]) -> Vec<Vec<f64>> {
        let runs = 0..self.study.observations.runs.len();
        let of_run = |r: usize| -> Vec<usize> {
            let windows = self.study.windows.fit.iter().filter(|w| w.run == r);
            windows.flat_map(|w| w.first..w.first + w.count).collect()
        };
        let samples: Vec<Vec<usize>> = runs.map(of_run).collect();
        let samples = samples.iter().map(Vec::as_slice);
        self.seen(samples, (hybrid, theta), quantities)
    }

    /// What it sees of some samples of each recording, one row a sample.
    fn seen<'s>(
        &self,
        samples: impl Iterator<Item = &'s [usize]>,
        (hybrid, theta): (&Hybrid, &[f64]),
        quantities: &[Quantity],
    ) -> Vec<Vec<f64>> {
        let study = self.study;
        let places = starts(hybrid.mechanics().coordinates());
        let runs = study.observations.runs.iter().zip(study.smoothed.iter());
        let mut rows = Vec::new();
        for ((run, smoothed), samples) in runs.zip(samples) {
            let inputs = hybrid.drive(&run.t, &run.u, 1, theta, &[]);
            for &k in samples {
                let state = smoothed.state(k);
                let value = |q: &Quantity| q.value(&state, k, &places, hybrid.nq(), &inputs);
                rows.push(quantities.iter().map(value).collect());
            }
        }
        rows
    }

    /// The parameters of a network with the forces that the accelerations ask for of a model at θ, each within this tolerance of those of one [without force](Self::beginning).
    pub fn matched(
        &self,
        force: &LearntForce,
        (hybrid, theta): (&Hybrid, &[f64]),
        tolerance: f64,
    ) -> Vec<f64> {
        let needed = Needed::of(self.study);
        let forces = needed.forces(hybrid, theta);
        let quantities: Vec<Quantity> = force.features().iter().map(|f| f.quantity).collect();
        let seen = self.seen(needed.samples(), (hybrid, theta), &quantities);
        let (mut z, mut y) = (Vec::new(), Vec::new());
        for (k, x) in seen.iter().enumerate() {
            let wanted = force.outputs().iter();
            let wanted = wanted.map(|output| forces[output.coordinate][k] / output.scale);
            let wanted: Vec<f64> = wanted.collect();
            let features = force.features().iter().zip(x);
            let sees: Vec<f64> = features.map(|(f, x)| (x - f.offset) / f.width).collect();
            if wanted.iter().chain(&sees).all(|x| x.is_finite()) {
                z.push(sees);
                y.push(wanted);
            }
        }
        let network = matched(force.network(), &z, &y, tolerance);
        network.parameters().to_vec()
    }

    /// A network without force: units that change at states that were seen, at first with no weight. `None` where nothing that it sees moves.
    pub fn beginning(
        &self,
        off: &[&Off],
        quantities: &[Quantity],
        states: &[Vec<f64>],
    ) -> Option<LearntForce> {
        let features: Vec<Feature> = quantities
            .iter()
            .enumerate()
            .map(|(k, &quantity)| Feature::scaled(quantity, states.iter().map(|x| x[k])))
            .collect();
        let moving: Vec<usize> = (0..features.len())
            .filter(|&k| features[k].range[1] > features[k].range[0])
            .collect();
        if moving.is_empty() || !off.iter().all(|off| off.rms > 0.0) {
            return None;
        }
        let d = features.len();
        let units = (UNITS[0] + UNITS[1] * moving.len()).min(UNITS[2]);
        let sizes = [d, units, off.len()];
        let shape = Shape::new(&sizes, Activation::Tanh, Activation::Identity).ok()?;
        let mut parameters = vec![0.0; shape.parameters()];
        let mut rng = ChaCha8Rng::seed_from_u64(self.sitting.seed);
        let layer = shape.layers().next()?;
        for unit in 0..units {
            let at = &states[rng.random_range(0..states.len())];
            let slope = SLOPES[0] * (SLOPES[1] / SLOPES[0]).powf(rng.random::<f64>());
            let direction: Vec<f64> = moving
                .iter()
                .map(|_| 2.0 * rng.random::<f64>() - 1.0)
                .collect();
            let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
            let mut sum = 0.0;
            for (&k, part) in moving.iter().zip(&direction) {
                let weight = slope * part / length.max(f64::MIN_POSITIVE);
                parameters[layer.weights + unit * d + k] = weight;
                sum += weight * (at[k] - features[k].offset) / features[k].width;
            }
            parameters[layer.biases + unit] = -sum;
        }
        let network = Mlp::from_parameters(shape, parameters).ok()?;
        let output = |off: &&Off| Output {
            coordinate: off.coordinate,
            scale: off.rms,
        };
        LearntForce::new(network, features, off.iter().map(output).collect(), false).ok()
    }
}
