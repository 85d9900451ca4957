//! What no effect of the library explains is taught to a small network on that coordinate, or on all that are off.
//!
//! M(q) v̇ + C(q, v) v + G(q) = Q + s Σ_k a_k tanh(w_kᵀ z + b_k) + s b: the network sees only the signals z that the missing law was seen to follow
//! (where there is no hint of any, the joint's position and velocity and what drives it). Where others are off beside one on the worst coordinate, or it explains nothing, one network with
//! a force on each of them is asked for. Its parameters are entries of θ like those of every effect: they are
//! fitted with all others over the same windows, each with a prior; but a network that sees what a found effect follows would take over its work, and the
//! effect would be told with what is left of it: a constant of an effect that would be known much better if the network were known stays what it was without.
//! The network is added where it explains the windows better, pair by pair, both those that the fit saw and those held out, and shrinks the gap of free
//! runs: pushes from outside can be learnt, but say nothing of later ones.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::advise::spoken;
use super::audit::Masked;
use super::comparison::Comparison;
use super::curves::ResidualForce;
use super::locate::locate;
use super::search::Search;
use super::setup::Prepared;
use super::shapes::Follows;
use super::study::{Fitted, Study};
use super::unexplained::describe;
use super::verdict::{Gap, Learnt, Name, Provenance, Unexplained};
use crate::digits::number;
use crate::entries::starts;
use crate::hybrid::{ConstantId, Hybrid};
use crate::learnt::law::Law;
use crate::learnt::{Card, Feature, LearntForce, Names, Output, Quantity};
use crate::log::same_rate;
use crate::model::{Model, NewNetwork};
use crate::network::{Activation, Mlp, Shape};

/// The name of its weights beside the new model.
pub const WEIGHTS: &str = "network.safetensors";
/// Hidden units: so many, and so many more for each signal; at most the last.
const UNITS: [usize; 3] = [8, 4, 24];
/// How steep they are at first, in deviations of the signals.
const SLOPES: [f64; 2] = [0.5, 10.0];
/// The prior of its parameters, about those at first; the force in units of what is left.
const TOLERANCE: f64 = 3.0;
/// Iterations of the fit: of the initial states alone, and of all.
const ITERATIONS: [usize; 2] = [0, 30];
/// Where those would take more integration steps of a state or a constant than this, some ten seconds of them, it is taught on as many fewer of the windows, and goes on with so many iterations on all.
const MOST_WORK: u64 = 50_000_000;
const ON_ALL: usize = 3;
/// A network could do the work of a constant that would be known so many times as well if the network were known.
const DOES_THE_SAME: f64 = 1.5;
/// So many times it is asked what it could.
const ROUNDS: usize = 3;
/// What an input was so many samples ago.
const AGO: [usize; 5] = [1, 2, 3, 5, 8];

/// It is off beside a network where free runs or windows leave so many times what they should.
const STILL_OFF: f64 = 4.0;

/// A coordinate of which the fits and the free runs leave less than this part of what they leave of the worst, in units of their noises, is not what is off.
const WITHIN: f64 = 0.25;

/// What is left, and what is known of it.
pub struct Resort<'a> {
    /// The model as given.
    pub model: &'a Model,
    /// The data of the diagnosis.
    pub study: &'a Study,
    /// Typical time between two samples of the logs, s.
    pub interval: f64,
    /// The coordinate that is off.
    pub own: Off,
    /// The others that a force is left on.
    pub others: Vec<Off>,
    /// Of the first parameters.
    pub seed: u64,
}

/// A coordinate on which a force is left.
pub struct Off {
    /// The coordinate.
    pub coordinate: usize,
    /// Root mean square of the force, N or N·m.
    pub rms: f64,
    /// What it follows, where windows that were set aside hint at it.
    pub follows: Option<Follows>,
    /// The signals that it follows most.
    pub signals: Vec<Quantity>,
}

/// A network that explains what is left.
pub struct Taught {
    /// The model with it, fitted; what it could have taken over is held.
    pub fitted: Fitted,
    /// That, by index in θ.
    pub shared: Vec<usize>,
    /// The force.
    pub force: LearntForce,
    /// What its file says of it.
    pub card: Card,
    /// What it is like, one a coordinate; none where it was taught too few states.
    pub laws: Vec<Option<Law>>,
}

/// The entries of θ whose work the network of a fit could do, among those that nothing is known of beforehand: where it could for one constant of an effect,
/// all of them, and beside the error of a gain the gain.
fn taken_over(fitted: &Fitted) -> Vec<usize> {
    let Fitted { hybrid, inside, .. } = fitted;
    let constants = hybrid.constants();
    let of_network = |i: usize| matches!(constants[i].id, ConstantId::Network(..));
    let beside = inside.nominal_errors();
    let alone = inside.nominal_errors_knowing(of_network);
    let is_taken = |k: usize| {
        let i = inside.free[k];
        let unknown = constants[i].tolerance.is_infinite() && !of_network(i);
        unknown && alone[k].is_finite() && beside[k] > DOES_THE_SAME * alone[k]
    };
    let taken = (0..inside.free.len()).filter(|&k| is_taken(k));
    let taken: Vec<usize> = taken.map(|k| inside.free[k]).collect();
    let mut held = Vec::new();
    for (index, effect) in hybrid.effects().iter().enumerate() {
        let range = hybrid.range(index);
        if taken.iter().any(|i| range.contains(i)) {
            held.extend(range);
            if effect.kind.name == "input_gain_error" {
                held.push(hybrid.gain_index(effect.target));
            }
        }
    }
    held.retain(|i| inside.free.contains(i));
    held
}

/// On which coordinates the model is off, by what is left of each: not on those that stay within their noise while another leaves it.
fn off(left: &[f64]) -> Vec<bool> {
    let most = left.iter().copied().fold(0.0, f64::max);
    left.iter().map(|&x| x >= WITHIN * most).collect()
}

/// What a fitted model leaves on each coordinate in its windows or in free runs, whichever is more, in units of the noise.
fn left(study: &Study, fitted: &Fitted, gap: &Gap) -> Vec<f64> {
    let excess = fitted.excess(&study.observations);
    let pairs = gap.coordinates.iter().zip(excess);
    pairs.map(|(free, excess)| free.after.max(excess)).collect()
}

/// Whether it leaves far more than it should on each.
fn is_far(study: &Study, fitted: &Fitted, gap: &Gap) -> Vec<bool> {
    let excess = fitted.excess(&study.observations);
    let pairs = gap.coordinates.iter().zip(excess);
    let far =
        pairs.map(|(free, excess)| free.after > STILL_OFF * free.expected || excess > STILL_OFF);
    far.collect()
}

impl<'a> Resort<'a> {
    /// What is left, in words, and what a network would be taught of it. `None` where too little is.
    pub fn of(
        model: &'a Model,
        (study, search): (&'a Study, &Search),
        prepared: &Prepared,
        (masked, inputs): (&Masked, &[String]),
        (interval, gap): (f64, &Gap),
        seed: u64,
    ) -> Option<(Unexplained, Self)> {
        let (smoothed, half_width) = (&prepared.smoothed, prepared.study.pace.half_width());
        let fitted = &search.model;
        let (_, all) = locate(study, fitted, smoothed, half_width, inputs, masked);
        let coordinates = model.mechanics.coordinates();
        let left = search.left.as_ref();
        let there = left.map(|left| coordinates[left.coordinate].name.as_str());
        let named = |force: &&ResidualForce| Some(force.coordinate.as_str()) == there;
        let off = off(&self::left(study, fitted, gap));
        let is_off = |force: &&ResidualForce| {
            let mut coordinates = coordinates.iter().zip(&off);
            coordinates.any(|(c, off)| *off && c.name == force.coordinate)
        };
        let worst = || all.iter().find(is_off).or(all.first());
        let force = all.iter().find(named).or_else(worst)?;
        let c = coordinates
            .iter()
            .position(|c| c.name == force.coordinate)?;
        let left = left.filter(|left| left.coordinate == c);
        let (words, signals) = describe(study, fitted, (force, c), left, inputs)?;
        let hint = fitted.hint(study, true);
        let own = Off {
            coordinate: c,
            rms: words.rms,
            follows: hint.filter(|h| h.coordinate == c).map(|h| h.follows),
            signals,
        };
        let others = all.iter().filter_map(|force| {
            let mut names = coordinates.iter();
            let other = names.position(|own| own.name == force.coordinate)?;
            if other == c {
                return None;
            }
            let (words, signals) = describe(study, fitted, (force, other), None, inputs)?;
            Some(Off {
                coordinate: other,
                rms: words.rms,
                follows: None,
                signals,
            })
        });
        let resort = Resort {
            model,
            study,
            interval,
            own,
            others: others.collect(),
            seed,
        };
        Some((words, resort))
    }

    /// The coordinates that are off, the worst first, with the others that a fitted model leaves far more than it should on.
    pub fn all_off(&self, fitted: &Fitted, gap: &Gap) -> Vec<&Off> {
        let (far, off) = (
            is_far(self.study, fitted, gap),
            off(&left(self.study, fitted, gap)),
        );
        let outputs = |c: usize| {
            let networks = self.model.networks.iter();
            let mut outputs = networks.flat_map(|network| network.force.outputs());
            outputs.any(|output| output.coordinate == c)
        };
        let is_off = |other: &&Off| {
            let c = other.coordinate;
            far.get(c) == Some(&true) && off.get(c) == Some(&true) && !outputs(c)
        };
        [&self.own]
            .into_iter()
            .chain(self.others.iter().filter(is_off))
            .collect()
    }

    /// Teaches a network the forces on some coordinates beside what was found.
    ///
    /// # Errors
    /// In words, where there is none that explains windows it has not seen.
    pub fn teach(
        &self,
        off: &[&Off],
        search: &Search,
        provenance: &Provenance,
    ) -> Result<Taught, String> {
        let given = &search.model;
        let taken = given.hybrid.networks().iter().flat_map(|n| n.outputs());
        let coordinates = self.model.mechanics.coordinates();
        let mut taken = taken.filter(|o| off.iter().any(|off| off.coordinate == o.coordinate));
        if let Some(output) = taken.next() {
            let name = &coordinates[output.coordinate].name;
            return Err(format!(
                "No network was taught it: the model has one on `{name}` already."
            ));
        }
        let quantities = self.quantities(off, &given.hybrid);
        let states = self.states(&given.hybrid, &given.inside.theta, &quantities);
        let force = self
            .beginning(off, &quantities, &states)
            .ok_or("No network was taught it: nothing moves that it could follow.")?;
        let mut hybrid = given.hybrid.clone();
        let theta = [&given.inside.theta, force.network().parameters()].concat();
        hybrid.add_open_network(Arc::new(force), TOLERANCE);
        let [alone, all] = ITERATIONS;
        let substeps = self.study.substeps_for(&hybrid, &theta);
        let work = self.study.work_of_one(&hybrid, substeps) * all as u64;
        let share = usize::try_from(work.div_ceil(MOST_WORK))
            .unwrap_or(usize::MAX)
            .max(1);
        let (some, there) = match share {
            1 => (self.study.clone(), given.clone()),
            _ => self.study.some_windows(given, share),
        };
        let mut fitted = some.fit(hybrid, there.start(theta), alone, all);
        // What does the same as a constant that is held may be next.
        let mut shared = Vec::new();
        for _ in 0..ROUNDS {
            let taken = taken_over(&fitted);
            if taken.is_empty() {
                break;
            }
            let mut hybrid = fitted.hybrid.clone();
            let mut theta = fitted.inside.theta.clone();
            for i in taken {
                shared.push(i);
                theta[i] = given.inside.theta[i];
                let constant = &mut hybrid.constants_mut()[i];
                (constant.value, constant.tolerance) = (theta[i], 0.0);
            }
            fitted = some.fit(hybrid, fitted.start(theta), alone, all);
        }
        if share > 1 {
            let start = given.start(fitted.inside.theta);
            fitted = self.study.fit(fitted.hybrid, start, 1, ON_ALL);
        }
        let comparison = Comparison::of(&fitted, given);
        if !comparison.explains() {
            return Err(format!(
                "A small network that was taught it explains too little: {} nats a sample of the windows that it was taught ({:.1} standard errors) and {} of \
                 those that it has not seen ({:.1}). It is not added.",
                number(comparison.inside_gain),
                comparison.inside.z,
                number(comparison.outside_gain),
                comparison.outside.z
            ));
        }
        let learnt = fitted.hybrid.networks_at(&fitted.inside.theta).pop();
        let force = learnt.ok_or("No network was taught it.")?;
        let force = (*force).clone().trained_on(&states);
        let inputs: Vec<&str> = self.model.inputs.iter().map(|i| i.name.as_str()).collect();
        let mut card = Card::of(
            &force,
            Names {
                coordinates,
                inputs: &inputs,
            },
        );
        card.interval = Some(self.interval);
        let laws = (0..off.len()).map(|k| Law::of(&force, k, &states, self.model));
        let laws: Vec<Option<Law>> = laws.collect();
        let words = serde_json::json!({
            "program": concat!("pinode ", env!("CARGO_PKG_VERSION")),
            "model": provenance.model,
            "logs": provenance.logs,
            "seed": self.seed,
            "windows": self.study.windows.fit.len(),
            "gain_per_sample_held_out": comparison.outside_gain,
            "laws": laws.iter().flatten().collect::<Vec<_>>(),
        });
        if let serde_json::Value::Object(words) = words {
            card.training = words;
        }
        Ok(Taught {
            fitted,
            shared,
            force,
            card,
            laws,
        })
    }

    /// What a network on some coordinates sees; angles that wrap by cosine and sine.
    fn quantities(&self, off: &[&Off], hybrid: &Hybrid) -> Vec<Quantity> {
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
            Some(Follows::PastInput) if !same_rate(self.study.interval, self.interval) => ago(0),
            Some(Follows::PastInput) => {
                [0].iter().chain(&AGO).flat_map(|&back| ago(back)).collect()
            }
        };
        sees.extend(&off.signals);
        sees
    }

    /// What it sees of the samples in the windows that are fitted, one row a sample.
    fn states(&self, hybrid: &Hybrid, theta: &[f64], quantities: &[Quantity]) -> Vec<Vec<f64>> {
        let study = self.study;
        let places = starts(hybrid.mechanics().coordinates());
        let mut rows = Vec::new();
        for (r, (run, smoothed)) in study
            .observations
            .runs
            .iter()
            .zip(study.smoothed.iter())
            .enumerate()
        {
            let inputs = hybrid.drive(&run.t, &run.u, 1, theta, &[]);
            for window in study.windows.fit.iter().filter(|w| w.run == r) {
                for k in window.first..window.first + window.count {
                    let state = smoothed.state(k);
                    let value = |q: &Quantity| q.value(&state, k, &places, hybrid.nq(), &inputs);
                    rows.push(quantities.iter().map(value).collect());
                }
            }
        }
        rows
    }

    /// A network without force: units that change at states that were seen, at first with no weight. `None` where nothing that it sees moves.
    fn beginning(
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
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
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

impl Taught {
    /// What the new model says of it, where its weights have this name.
    pub fn entry(&self, weights: &str, seed: u64) -> NewNetwork {
        NewNetwork {
            weights: vec![weights.to_owned()],
            joints: self.card.joints.iter().map(|j| j.name.clone()).collect(),
            comment: format!(
                "what no effect explains, learnt by pinode {}; the other constants are as fitted beside it; seed {seed}",
                env!("CARGO_PKG_VERSION"),
            ),
        }
    }
}

impl Learnt {
    /// The coordinates that it acts on, as people list them.
    pub fn places(&self) -> String {
        let names: Vec<String> = self.coordinates.iter().map(|c| format!("`{c}`")).collect();
        match names.as_slice() {
            [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
            names => names.join(""),
        }
    }

    /// In sentences.
    pub(super) fn sentences(&self) -> Vec<String> {
        let mut said = vec![format!(
            "A small network on {} has learnt it and is added to the model as `{}`: the free-run errors on unseen data go from {} to {}, \
             in units of the sensors' noise.",
            self.places(),
            self.weights,
            number(self.without),
            number(self.with)
        )];
        let name = |name: &Name| format!("{} on `{}`", spoken(&name.kind), name.target);
        let shared: Vec<String> = self.shares_with.iter().map(name).collect();
        if !shared.is_empty() {
            said.push(format!(
                "How the force is shared between it and {}, the data do not say: what was named has all that its law could explain of both.",
                shared.join(" and ")
            ));
        }
        said.extend(
            self.law
                .iter()
                .chain(&self.more_laws)
                .flat_map(Law::sentences),
        );
        said
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A satellite whose wheel is 30 noises off does not lack a force on its resting height.
    #[test]
    fn what_stays_within_its_noise_while_another_coordinate_leaves_it_is_not_off() {
        assert_eq!(off(&[1.1, 0.9, 30.0]), [false, false, true]);
        assert_eq!(off(&[12.0, 30.0]), [true, true]);
        assert_eq!(off(&[1.0, 0.9]), [true, true]);
    }
}
