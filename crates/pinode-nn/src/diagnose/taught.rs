//! A small network that is taught what is left, beside all that was found.
//!
//! M(q) v̇ + C(q, v) v + G(q) = Q + s Σ_k a_k tanh(w_kᵀ z + b_k) + s b, with the signals z that it [sees](super::sight). Its parameters are entries of θ like
//! those of every effect: they are fitted with all others over the same windows, each with a prior; but a network that sees what a found effect follows would
//! take over its work, and the effect would be told with what is left of it: a constant of an effect that would be known much better if the network were known
//! stays what it was without.

use std::sync::Arc;

use super::advise::spoken;
use super::comparison::Comparison;
use super::leftover::{Leftover, Off};
use super::refine::best;
use super::search::Search;
use super::sight::Sight;
use super::step::FAR;
use super::study::{Fitted, Study};
use super::verdict::{Learnt, Name};
use crate::digits::number;
use crate::hybrid::{ConstantId, Hybrid};
use crate::learnt::law::Law;
use crate::learnt::{Card, Feature, LearntForce, Names, Quantity};
use crate::model::NewNetwork;

/// The prior of its parameters, about those at first; the force in units of what is left.
const TOLERANCE: f64 = 3.0;
/// Iterations between two looks at the windows held out, and so many looks at most.
const ITERATIONS: usize = 10;
const LOOKS: usize = 14;
/// It ends where so many looks in a row see nothing better.
const IN_VAIN: usize = 4;
/// Where those would take more integration steps of a state or a constant than this, some ten seconds of them, it is taught on as many fewer of the windows, and goes on with so many iterations on all.
const MOST_WORK: u64 = 50_000_000;
const ON_ALL: usize = 3;
/// … so many iterations being what it takes.
const TYPICAL: u64 = 30;
/// A network could do the work of a constant that would be known so many times as well if the network were known.
const DOES_THE_SAME: f64 = 1.5;
/// So many times it is asked what it could.
const ROUNDS: usize = 3;

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
/// all of them, and beside the error of a gain the gain. One that sees only what is does not do the work of what [remembers](crate::effect::Kind::remembers).
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
    let is_past = |f: &Feature| matches!(f.quantity, Quantity::Input { back: 1.., .. });
    let mut networks = hybrid.networks().iter();
    let sees_the_past = networks.any(|n| n.features().iter().any(is_past));
    let mut held = Vec::new();
    for (index, effect) in hybrid.effects().iter().enumerate() {
        if effect.kind.remembers() && !sees_the_past {
            continue;
        }
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

/// A fitted model with a network in it, and θ, `theta` for all that was there before.
fn with_network(given: &Fitted, theta: &[f64], force: LearntForce) -> (Hybrid, Vec<f64>) {
    let mut hybrid = given.hybrid.clone();
    let theta = [theta, force.network().parameters()].concat();
    hybrid.add_open_network(Arc::new(force), TOLERANCE);
    (hybrid, theta)
}

/// Goes on with a fit as long as the windows held out are better explained: behind that it learns the noise, and what it cannot express.
fn taught_on(study: &Study, fitted: Fitted) -> Fitted {
    let held_out = |fitted: &Fitted| fitted.outside_scores.iter().sum::<f64>();
    let (mut best, mut last) = (fitted.clone(), fitted);
    let mut in_vain = 0;
    for _ in 1..LOOKS {
        if last.inside.converged || in_vain == IN_VAIN {
            break;
        }
        let start = last.start(last.inside.theta.clone());
        last = study.fit(last.hybrid, start, 0, ITERATIONS);
        if held_out(&last) > held_out(&best) {
            (best, in_vain) = (last.clone(), 0);
        } else {
            in_vain += 1;
        }
    }
    best
}

impl Leftover<'_> {
    /// On one in how many of the windows a network is taught.
    fn share_of_work(&self, given: &Fitted, force: &LearntForce) -> usize {
        let (hybrid, theta) = with_network(given, &given.inside.theta, force.clone());
        let substeps = self.study.substeps_for(&hybrid, &theta);
        let work = self.study.work_of_one(&hybrid, substeps) * TYPICAL;
        let share = usize::try_from(work.div_ceil(MOST_WORK));
        share.unwrap_or(usize::MAX).max(1)
    }

    /// Teaches a network that sees so much the forces on some coordinates beside what was found.
    ///
    /// # Errors
    /// In words, where there is none that explains the windows held out, which decide only when its fits end.
    pub fn teach(&self, off: &[&Off], sight: Sight, search: &Search) -> Result<Taught, String> {
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
        let quantities = self.quantities(off, sight, &given.hybrid);
        let states = self.states(&given.hybrid, &given.inside.theta, &quantities);
        let force = self
            .beginning(off, &quantities, &states)
            .ok_or("No network was taught it: nothing moves that it could follow.")?;
        let share = self.share_of_work(given, &force);
        let (some, there) = match share {
            1 => (self.study.clone(), given.clone()),
            _ => self.study.some_of_both(given, share),
        };
        // From far off, roll-outs lead nowhere, and what the model as given came to there may be no start.
        let is_far = given.most_excess(self.study) > FAR;
        let from_no_force = || {
            let (hybrid, theta) = with_network(given, &given.inside.theta, force.clone());
            (hybrid, there.start(theta))
        };
        let from_the_forces = || {
            let theta = given.as_said();
            let parameters = self.matched(&force, (&given.hybrid, &theta), TOLERANCE);
            let (hybrid, mut theta) = with_network(given, &theta, force.clone());
            let own = theta.len() - parameters.len();
            theta[own..].copy_from_slice(&parameters);
            let start = some.measured(&hybrid, theta);
            (hybrid, start)
        };
        let mut starts = vec![from_no_force()];
        if is_far {
            starts.push(from_the_forces());
        }
        let fits = starts.into_iter();
        let fits = fits.map(|(hybrid, start)| some.fit(hybrid, start, 0, ITERATIONS));
        let ahead = best(fits.collect()).ok_or("No network was taught it.")?;
        let mut fitted = taught_on(&some, ahead);
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
            let again = some.fit(hybrid, fitted.start(theta), 0, ITERATIONS);
            fitted = taught_on(&some, again);
        }
        if share > 1 {
            let theta = fitted.inside.theta;
            let start = match is_far {
                true => self.study.measured(&fitted.hybrid, theta),
                false => given.start(theta),
            };
            fitted = self.study.fit(fitted.hybrid, start, 1, ON_ALL);
        }
        let comparison = Comparison::of(&fitted, given);
        if !comparison.explains() {
            return Err(format!(
                "A small network that was taught it explains too little: {} nats a sample of the windows that it was taught ({:.1} standard errors) and {} of \
                 those held out ({:.1}). It is not added.",
                number(comparison.inside_gain),
                comparison.inside.z,
                number(comparison.outside_gain),
                comparison.outside.z
            ));
        }
        let learnt = fitted.hybrid.networks_at(&fitted.inside.theta).pop();
        let force = learnt.ok_or("No network was taught it.")?;
        let force = (*force).clone().trained_on(&states);
        let laws = (0..off.len()).map(|k| Law::of(&force, k, &states, self.model));
        let laws: Vec<Option<Law>> = laws.collect();
        let card = self.card(&force, &laws, comparison.outside_gain);
        Ok(Taught {
            fitted,
            shared,
            force,
            card,
            laws,
        })
    }

    /// What the file of its weights says of a force that explains so many nats a sample of the windows held out.
    fn card(&self, force: &LearntForce, laws: &[Option<Law>], gain: f64) -> Card {
        let inputs: Vec<&str> = self.model.inputs.iter().map(|i| i.name.as_str()).collect();
        let mut card = Card::of(
            force,
            Names {
                coordinates: self.model.mechanics.coordinates(),
                inputs: &inputs,
            },
        );
        card.interval = Some(self.sitting.interval);
        let words = serde_json::json!({
            "program": concat!("pinode ", env!("CARGO_PKG_VERSION")),
            "model": self.sitting.provenance.model,
            "logs": self.sitting.provenance.logs,
            "seed": self.sitting.seed,
            "windows": self.study.windows.fit.len(),
            "gain_per_sample_held_out": gain,
            "laws": laws.iter().flatten().collect::<Vec<_>>(),
        });
        if let serde_json::Value::Object(words) = words {
            card.training = words;
        }
        card
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
