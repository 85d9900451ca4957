//! When roll-outs leave what the networks of a model were trained on.
//!
//! Looked at where the samples of a log are, not within integration steps. Members of an ensemble are trained on the same: the first stands for all.

use serde::Serialize;

use super::{Described, LearntForce, Outside};
use crate::entries::{Start, starts};
use crate::free_run::{LONGEST_STEP, substeps};
use crate::hybrid::{DrivenInputs, Hybrid};
use crate::model::{Model, NetworkEntry};

/// A network in roll-outs that left what it was trained on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Departure {
    /// The file of its weights, as the model names it.
    pub weights: String,
    /// The joints that it acts on.
    pub joints: Vec<String>,
    /// The recording in which it was outside first.
    pub run: String,
    /// Time of the first sample outside, s.
    pub t: f64,
    /// What it saw there; first what was beyond its range, the farthest first.
    pub saw: Vec<Saw>,
    /// How far that is from the nearest state of the training data that is kept, as the largest share of a range; none of networks whose files have
    /// ranges alone, and where a quantity is beyond its own.
    pub distance: Option<f64>,
    /// No state of the training data is farther than this from one that is kept.
    pub reach: Option<f64>,
    /// Samples outside.
    pub samples_outside: usize,
    /// All samples.
    pub samples: usize,
}

/// A quantity that a network saw.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Saw {
    /// As in files of weights.
    pub name: String,
    /// SI unit; `1` where it has none.
    pub unit: String,
    /// What it was.
    pub value: f64,
    /// The least and the largest value that the network was trained on.
    pub trained: [f64; 2],
}

/// What a network saw of some samples.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    samples: usize,
    outside: usize,
    /// The first sample outside.
    first: Option<First>,
}

#[derive(Debug, Clone)]
struct First {
    /// Index in the recording.
    sample: usize,
    x: Vec<f64>,
    how: Outside,
}

/// Watches the roll-outs of a model.
///
/// ```no_run
/// use pinode_nn::{free_run::{LONGEST_STEP, simulate}, learnt::Guard, model::Model};
///
/// let model = Model::load("out/learnt/model.toml".as_ref())?;
/// let t: Vec<f64> = (0..500).map(|k| 0.01 * f64::from(k)).collect();
/// let u = vec![vec![0.0; t.len()]; model.inputs.len()];
/// let states = simulate(&model, "0", &t, &u, &[0.1, 0.0], LONGEST_STEP)?;
/// let mut guard = Guard::new(&model);
/// guard.watch("0", &t, &u, &states);
/// for departure in guard.departures() {
///     eprintln!("on {:?} from t = {} s on", departure.joints, departure.t);
/// }
/// # Ok::<(), pinode_nn::Error>(())
/// ```
pub struct Guard<'a> {
    model: &'a Model,
    networks: Vec<&'a NetworkEntry>,
    starts: Vec<Start>,
    /// One a network.
    found: Vec<Found>,
}

#[derive(Default)]
struct Found {
    samples: usize,
    outside: usize,
    first: Option<(String, f64, First)>,
}

impl<'a> Guard<'a> {
    /// Of the networks of `model`.
    pub fn new(model: &'a Model) -> Self {
        let tables = model.networks.chunk_by(|a, b| a.table == b.table);
        let networks: Vec<&NetworkEntry> = tables.filter_map(|table| table.first()).collect();
        Guard {
            model,
            starts: starts(model.mechanics.coordinates()),
            found: networks.iter().map(|_| Found::default()).collect(),
            networks,
        }
    }

    /// Looks at the states (q, v) of a roll-out at the times `t` under the inputs `u`; `run` is what the recording is called.
    pub fn watch(&mut self, run: &str, t: &[f64], u: &[Vec<f64>], states: &[Vec<f64>]) {
        if self.found.is_empty() {
            return;
        }
        let hybrid = Hybrid::explicit(self.model);
        let steps = substeps(t, LONGEST_STEP);
        let inputs = hybrid.drive(t, u, steps, &hybrid.theta(), &[]);
        let tallies = self.look(&inputs, 0, states.iter().map(Vec::as_slice));
        self.add(run, t, tallies);
    }

    /// What the networks see in `states`, from sample `first` of a recording on.
    pub(crate) fn look<'s>(
        &self,
        inputs: &DrivenInputs,
        first: usize,
        states: impl Iterator<Item = &'s [f64]>,
    ) -> Vec<Tally> {
        let mut tallies = vec![Tally::default(); self.networks.len()];
        let nq = self.model.mechanics.nq();
        let mut x = Vec::new();
        for (sample, state) in (first..).zip(states) {
            for (network, tally) in self.networks.iter().zip(&mut tallies) {
                let features = network.force.features().iter();
                x.clear();
                x.extend(
                    features.map(|f| f.quantity.value(state, sample, &self.starts, nq, inputs)),
                );
                tally.add(&network.force, sample, &x);
            }
        }
        tallies
    }

    /// Adds what [`look`](Self::look) saw of a recording with these times.
    pub(crate) fn add(&mut self, run: &str, t: &[f64], tallies: Vec<Tally>) {
        for (found, tally) in self.found.iter_mut().zip(tallies) {
            found.samples += tally.samples;
            found.outside += tally.outside;
            if let (None, Some(first)) = (&found.first, tally.first) {
                let time = t.get(first.sample).copied().unwrap_or(f64::NAN);
                found.first = Some((run.to_owned(), time, first));
            }
        }
    }

    /// The networks that were outside, in the order of the model.
    pub fn departures(&self) -> Vec<Departure> {
        let networks = self.networks.iter().zip(&self.found);
        networks
            .filter_map(|(network, found)| departure(self.model, network, found))
            .collect()
    }
}

impl Tally {
    fn add(&mut self, force: &LearntForce, sample: usize, x: &[f64]) {
        self.samples += 1;
        if let Some(how) = force.outside(x) {
            self.outside += 1;
            self.first.get_or_insert_with(|| First {
                sample,
                x: x.to_vec(),
                how,
            });
        }
    }
}

fn departure(model: &Model, network: &NetworkEntry, found: &Found) -> Option<Departure> {
    let (run, t, first) = found.first.as_ref()?;
    let features = network.force.features();
    let mut saw: Vec<(f64, Saw)> = network
        .sees(model)
        .into_iter()
        .zip(features)
        .zip(&first.x)
        .map(|((Described { name, unit, .. }, feature), &value)| {
            let quantity = Saw {
                name,
                unit,
                value,
                trained: feature.range,
            };
            (feature.beyond(value), quantity)
        })
        .collect();
    saw.sort_by(|a, b| b.0.total_cmp(&a.0)); // stable: the others stay in their order
    let given = network.gives(model).into_iter();
    Some(Departure {
        weights: network.weights.clone(),
        joints: given.map(|joint| joint.name).collect(),
        run: run.clone(),
        t: *t,
        saw: saw.into_iter().map(|(_, saw)| saw).collect(),
        distance: match first.how {
            Outside::Range(_) => None,
            Outside::Unlike(distance) => Some(distance),
        },
        reach: network.force.region().map(|region| region.reach()),
        samples_outside: found.outside,
        samples: found.samples,
    })
}
