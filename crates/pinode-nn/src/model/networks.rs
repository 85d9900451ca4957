//! The networks of a model: `[[effect]]` tables of the kind `neural_network`.
//!
//! ```toml
//! [[effect]]
//! kind    = "neural_network"
//! weights = "friction.safetensors"   # relative to the model file
//! joints  = ["slider"]               # what it acts on: those that the weights were trained for
//! ```
//!
//! With a list of files, `weights = ["network-1.safetensors", "network-2.safetensors"]`, the table is an ensemble: networks that were trained for the
//! same from different beginnings. The force is their mean, and how far the roll-outs of [`Model::members`] are apart says how far it is known, by the
//! [`Band`](crate::band::Band) of the model.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::document::{Faults, Placed, Section};
use super::mechanism::Mechanism;
use super::{Input, Model};
use crate::Error;
use crate::learnt::{Card, Described, LearntForce, Names, Stored, weights};
use crate::log::Log;
use crate::naming::quoted;

/// The kind of these tables.
pub(super) const KIND: &str = "neural_network";

/// A learnt force of a model, or one member of an ensemble.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkEntry {
    /// Which of the networks' tables it is of; the members of an ensemble share one and follow each other.
    pub table: usize,
    /// The part of its force that counts: 1 over the number of the members.
    pub share: f64,
    /// The file of weights, as the model names it.
    pub weights: String,
    /// Where it was read.
    pub path: PathBuf,
    /// SHA-256 of that file, hexadecimal.
    pub sha256: String,
    /// Whether its numbers have 32 bits.
    pub single: bool,
    /// The force.
    pub force: Arc<LearntForce>,
    /// What the file says of itself.
    pub card: Card,
}

impl NetworkEntry {
    /// Whether it is one of several whose mean is the force.
    pub fn is_member(&self) -> bool {
        self.share != 1.0
    }

    /// What it adds to Q of the model: its share of its force.
    pub(crate) fn shared(&self) -> Arc<LearntForce> {
        match self.is_member() {
            true => Arc::new(self.force.scaled(self.share)),
            false => self.force.clone(),
        }
    }

    /// What the network sees, one an input; `model` is the one that it is in.
    pub fn sees(&self, model: &Model) -> Vec<Described> {
        let features = self.force.features().iter();
        features
            .map(|feature| Described::seen(feature.quantity, model))
            .collect()
    }

    /// What it adds to Q, one an output.
    pub fn gives(&self, model: &Model) -> Vec<Described> {
        let outputs = self.force.outputs().iter();
        outputs
            .map(|output| Described::given(output, model))
            .collect()
    }
}

impl Model {
    /// Said of logs that a network of the model has learnt from, or that told it when to stop, by what its file of weights says: errors on them are not those on data that nothing
    /// has seen.
    pub(crate) fn has_learnt_from<'a>(
        &self,
        logs: impl Iterator<Item = &'a Log>,
    ) -> Option<String> {
        let has = |entry: &NetworkEntry, log: &Log| {
            let sides = ["logs", "held_out"].map(|side| entry.card.training.get(side));
            let lists = sides
                .into_iter()
                .flatten()
                .filter_map(|side| side.as_array());
            let mut sums = lists
                .flatten()
                .filter_map(|file| file.get("sha256")?.as_str());
            // One that was made in memory may have none.
            !log.sha256.is_empty() && sums.any(|sum| sum == log.sha256)
        };
        let learnt = logs.filter(|log| self.networks.iter().any(|entry| has(entry, log)));
        let learnt: Vec<String> = learnt.map(|log| log.path.display().to_string()).collect();
        (!learnt.is_empty()).then(|| {
            format!(
                "a network of the model has learnt from {}: errors on these logs are no measure of those on data that it has not seen; give a log that it has not learnt from.",
                learnt.join(", ")
            )
        })
    }

    /// The models whose mean this one is: each with one member of every ensemble; itself alone where it has no ensemble. A network that is none is in all
    /// of them, and an ensemble with fewer members than another begins again.
    pub fn members(&self) -> Vec<Model> {
        let tables: Vec<&[NetworkEntry]> =
            self.networks.chunk_by(|a, b| a.table == b.table).collect();
        let count = tables.iter().map(|table| table.len()).max().unwrap_or(1);
        let member = |k: usize| {
            let of = |table: &&[NetworkEntry]| {
                let entry = table.get(k % table.len().max(1))?;
                Some(NetworkEntry {
                    share: 1.0,
                    ..entry.clone()
                })
            };
            Model {
                networks: tables.iter().filter_map(of).collect(),
                ..self.clone()
            }
        };
        (0..count).map(member).collect()
    }

    /// The files that it was read from: its own, its URDF and the weights of its networks.
    pub(crate) fn files(&self) -> Vec<&Path> {
        let urdf = self.urdf.iter().map(|urdf| urdf.path.as_path());
        let weights = self.networks.iter().map(|entry| entry.path.as_path());
        let own = std::iter::once(self.path.as_path());
        own.chain(urdf).chain(weights).collect()
    }

    /// Whether a network of it is an ensemble.
    pub fn has_ensemble(&self) -> bool {
        self.networks.iter().any(NetworkEntry::is_member)
    }
}

/// Whether an `[[effect]]` table is a network's.
pub(super) fn is_network(table: &Section) -> bool {
    let kind = table.get("kind").and_then(|kind| kind.get_ref().as_str());
    kind == Some(KIND)
}

/// The networks among the `[[effect]]` tables.
pub(super) fn read(
    root: &Section,
    path: &Path,
    mechanism: Option<&Mechanism>,
    inputs: &[Input],
    faults: &mut Faults,
) -> Vec<NetworkEntry> {
    let mut unheard = Faults::default(); // what is wrong with the tables is told by the reader of effects
    let tables = root.sections("effect", &mut unheard);
    let tables = tables.into_iter().filter(is_network).enumerate();
    tables
        .flat_map(|table| read_one(table, path, mechanism, inputs, faults))
        .collect()
}

/// The network of a table, or the members of its ensemble; none where a file is faulty.
fn read_one(
    (index, table): (usize, Section),
    model: &Path,
    mechanism: Option<&Mechanism>,
    inputs: &[Input],
    faults: &mut Faults,
) -> Vec<NetworkEntry> {
    let titled = Section {
        title: KIND.to_owned(),
        ..table.clone()
    };
    titled.check_keys(&["kind", "weights", "joints"], faults);
    let files = files(&titled, faults);
    if table.get("joints").is_none() {
        faults.at(
            table.offset,
            "a neural_network needs `joints = [\"…\"]`, those that it acts on",
        );
    }
    let joints = table.strings("joints", faults);
    let (Some(joints), Some(mechanism)) = (joints, mechanism) else {
        return Vec::new();
    };
    let inputs: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).collect();
    let names = Names {
        coordinates: mechanism.mechanics.coordinates(),
        inputs: &inputs,
    };
    let folder = model.parent().unwrap_or(Path::new(""));
    let read = files.iter().map(|file| {
        let stored = read_file(file, &folder.join(file.value), names, faults)?;
        check_joints(file, &stored.card, &joints, table.offset, faults);
        Some(NetworkEntry {
            table: index,
            share: 1.0 / files.len() as f64,
            weights: file.value.to_owned(),
            path: folder.join(file.value),
            sha256: stored.sha256,
            single: stored.single,
            force: Arc::new(stored.force),
            card: stored.card,
        })
    });
    let Some(entries) = read.collect::<Option<Vec<_>>>() else {
        return Vec::new();
    };
    let mut pairs = files.iter().zip(&entries);
    if let Some((_, first)) = pairs.next()
        && let Some((file, _)) = pairs.find(|(_, e)| e.force.is_alone() != first.force.is_alone())
    {
        faults.at(
            file.offset(),
            format!(
                "{} and {} are no ensemble: the inputs act through the one alone and not through the other",
                quoted(&first.weights),
                quoted(file.value)
            ),
        );
    }
    entries
}

/// `weights`: a file, or those of the members of an ensemble.
fn files<'a>(table: &Section<'a>, faults: &mut Faults) -> Vec<Placed<&'a str>> {
    let list = table.get("weights").filter(|w| w.get_ref().is_array());
    let Some(list) = list else {
        return table.needed_string("weights", faults).into_iter().collect();
    };
    let files = table.strings("weights", faults).unwrap_or_default();
    for (k, file) in files.iter().enumerate() {
        if files.iter().take(k).any(|other| other.value == file.value) {
            faults.at(
                file.offset(),
                format!(
                    "{} is there twice among the members of an ensemble",
                    quoted(file.value)
                ),
            );
        }
    }
    if files.is_empty() {
        faults.at(
            list.span().start,
            "`weights` is an empty list: name the file of a network",
        );
    }
    files
}

fn read_file(
    file: &Placed<&str>,
    path: &Path,
    names: Names<'_>,
    faults: &mut Faults,
) -> Option<Stored> {
    match weights::read(path, names) {
        Ok(stored) => return Some(stored),
        Err(Error::Problems(problems)) => {
            for problem in &problems.list {
                faults.at(file.offset(), format!("{}: {problem}", problems.source));
            }
        }
        Err(other) => faults.at(file.offset(), other.to_string()),
    }
    None
}

/// Whether the table names the joints that the file was trained for.
fn check_joints(
    file: &Placed<&str>,
    card: &Card,
    joints: &[Placed<&str>],
    table: usize,
    faults: &mut Faults,
) {
    let trained: Vec<&str> = card
        .joints
        .iter()
        .map(|joint| joint.name.as_str())
        .collect();
    let named: Vec<&str> = joints.iter().map(|joint| joint.value).collect();
    if trained == named {
        return;
    }
    let list = |names: &[&str]| -> String {
        let quoted: Vec<String> = names.iter().map(|name| quoted(name)).collect();
        quoted.join(", ")
    };
    faults.at(
        joints.first().map_or(table, |joint| joint.offset()),
        format!(
            "`joints` are {}, and {} was trained for {}: name those, in this order",
            list(&named),
            quoted(file.value),
            list(&trained)
        ),
    );
}
