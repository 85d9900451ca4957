//! The networks of a model: `[[effect]]` tables of the kind `neural_network`.
//!
//! ```toml
//! [[effect]]
//! kind    = "neural_network"
//! weights = "friction.safetensors"   # relative to the model file
//! joints  = ["slider"]               # what it acts on: those that the weights were trained for
//! ```

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::document::{Faults, Section};
use super::mechanism::Mechanism;
use super::{Input, Model};
use crate::Error;
use crate::learnt::{Card, Described, LearntForce, Names, weights};
use crate::naming::quoted;

/// The kind of these tables.
pub(super) const KIND: &str = "neural_network";

/// A learnt force of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkEntry {
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
    let tables = tables.into_iter().filter(is_network);
    tables
        .filter_map(|table| read_one(&table, path, mechanism, inputs, faults))
        .collect()
}

fn read_one(
    table: &Section,
    model: &Path,
    mechanism: Option<&Mechanism>,
    inputs: &[Input],
    faults: &mut Faults,
) -> Option<NetworkEntry> {
    let titled = Section {
        title: KIND.to_owned(),
        ..table.clone()
    };
    titled.check_keys(&["kind", "weights", "joints"], faults);
    let file = titled.needed_string("weights", faults);
    if table.get("joints").is_none() {
        faults.at(
            table.offset,
            "a neural_network needs `joints = [\"…\"]`, those that it acts on",
        );
    }
    let joints = table.strings("joints", faults);
    let (file, joints, mechanism) = (file?, joints?, mechanism?);
    let inputs: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).collect();
    let names = Names {
        coordinates: mechanism.mechanics.coordinates(),
        inputs: &inputs,
    };
    let folder = model.parent().unwrap_or(Path::new(""));
    let path = folder.join(file.value);
    let stored = match weights::read(&path, names) {
        Ok(read) => read,
        Err(Error::Problems(problems)) => {
            for problem in &problems.list {
                faults.at(file.offset(), format!("{}: {problem}", problems.source));
            }
            return None;
        }
        Err(other) => {
            faults.at(file.offset(), other.to_string());
            return None;
        }
    };
    let trained: Vec<&str> = stored
        .card
        .joints
        .iter()
        .map(|joint| joint.name.as_str())
        .collect();
    let named: Vec<&str> = joints.iter().map(|joint| joint.value).collect();
    if trained != named {
        let list = |names: &[&str]| -> String {
            let quoted: Vec<String> = names.iter().map(|name| quoted(name)).collect();
            quoted.join(", ")
        };
        faults.at(
            joints.first().map_or(table.offset, |joint| joint.offset()),
            format!(
                "`joints` are {}, and {} was trained for {}: name those, in this order",
                list(&named),
                quoted(file.value),
                list(&trained)
            ),
        );
    }
    Some(NetworkEntry {
        weights: file.value.to_owned(),
        path,
        sha256: stored.sha256,
        single: stored.single,
        force: Arc::new(stored.force),
        card: stored.card,
    })
}
