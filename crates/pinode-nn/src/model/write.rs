//! Writing a revised model: the file that was read, with its comments and layout, and what changed in it.

use std::path::{Path, PathBuf};

use lagrange::{Problem, Problems, Role};
use toml_edit::{ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value};

use super::{EffectEntry, Model, Target, band, networks};
use crate::Error;
use crate::band::Band;
use crate::disk::Together;
use crate::effect::{LeftOut, ParameterSpec};

/// New numbers and effects for a [`Model`].
#[derive(Debug, Clone, PartialEq)]
pub struct Revision {
    /// The complete new list of effects; each with the comment that says where it comes from, which precedes it in the file when
    /// it is new there (may be empty).
    pub effects: Vec<(EffectEntry, String)>,
    /// In place of [`Model::parameter_values`].
    pub parameter_values: Vec<f64>,
    /// In place of the inputs' gains.
    pub gains: Vec<f64>,
    /// In place of the sensors' zeros.
    pub zeros: Vec<f64>,
    /// A learnt force that comes to those of the model.
    pub network: Option<NewNetwork>,
    /// In place of [`Model::band`]; that of the model itself goes where anything else changes.
    pub band: Option<Band>,
}

/// A learnt force that is new in a model.
#[derive(Debug, Clone, PartialEq)]
pub struct NewNetwork {
    /// The file of its weights, beside the model; of an ensemble those of all members.
    pub weights: Vec<String>,
    /// The joints that it acts on.
    pub joints: Vec<String>,
    /// Where it comes from.
    pub comment: String,
}

impl Revision {
    /// The revision that changes nothing.
    pub fn of(model: &Model) -> Self {
        Revision {
            effects: model
                .effects
                .iter()
                .map(|entry| (entry.clone(), String::new()))
                .collect(),
            parameter_values: model.parameter_values.clone(),
            gains: model.inputs.iter().map(|input| input.gain).collect(),
            zeros: model.sensors.iter().map(|sensor| sensor.zero).collect(),
            network: None,
            band: model.band.clone(),
        }
    }

    /// Whether it changes what a model does.
    fn changes(&self, model: &Model) -> bool {
        let as_before = Revision {
            band: self.band.clone(),
            ..Revision::of(model)
        };
        *self != as_before
    }
}

impl Model {
    /// The model with `revision` applied, but for what is learnt: that is in no file yet.
    pub(crate) fn revised(&self, revision: &Revision) -> Model {
        let mut model = self.clone();
        model
            .parameter_values
            .clone_from(&revision.parameter_values);
        for (input, gain) in model.inputs.iter_mut().zip(&revision.gains) {
            input.gain = *gain;
        }
        for (sensor, zero) in model.sensors.iter_mut().zip(&revision.zeros) {
            sensor.zero = *zero;
        }
        let effects = revision.effects.iter().map(|(entry, _)| entry.clone());
        model.effects = effects.collect();
        model.band.clone_from(&revision.band);
        model
    }

    /// Writes the model with `revision` applied to `dir/file_name`, and its URDF beside it; returns the path of the model.
    ///
    /// Numbers that did not change stay as they are written. The URDF keeps its name; where another file has it already, part of
    /// the URDF's hash is added. All files are written or none. `dir` is made where it is missing.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::OverwritesInput`], [`Error::Revision`] when a list has the wrong length, [`Error::Problems`] when a
    /// number is not finite.
    pub fn write_revision(
        &self,
        dir: &Path,
        file_name: &str,
        revision: &Revision,
    ) -> Result<PathBuf, Error> {
        let mut files = Together::new(dir);
        let path = self.stage_revision(&mut files, file_name, revision)?;
        files.commit()?;
        Ok(path)
    }

    /// Puts what [`write_revision`](Self::write_revision) writes among `files`, the model last.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn stage_revision(
        &self,
        files: &mut Together<'_>,
        file_name: &str,
        revision: &Revision,
    ) -> Result<PathBuf, Error> {
        self.check(revision)?;
        let path = files.dir().join(file_name);
        if let (Ok(new), Ok(old)) = (path.canonicalize(), self.path.canonicalize())
            && new == old
        {
            return Err(Error::OverwritesInput { path });
        }
        let mut document = self.document()?;
        if let Some(urdf) = &self.urdf {
            let name = files.put_beside(&urdf.path, urdf.text.as_bytes())?;
            set(document.as_table_mut(), "urdf", Value::from(name));
        }
        self.copy_weights(&mut document, files)?;
        self.revise(&mut document, revision);
        if let Some(network) = &revision.network {
            add_network(&mut document, network);
        }
        // A band was found with the model as it was.
        let is_old = revision.band == self.band && revision.changes(self);
        let band = revision.band.as_ref().filter(|_| !is_old);
        if band != self.band.as_ref() {
            band::write(&mut document, band, self.mechanics.coordinates());
        }
        files.put(file_name, document.to_string().as_bytes())?;
        Ok(path)
    }

    /// Puts the weights of the networks among `files`.
    fn copy_weights(
        &self,
        document: &mut DocumentMut,
        files: &mut Together<'_>,
    ) -> Result<(), Error> {
        if self.networks.is_empty() {
            return Ok(());
        }
        let Some(tables) = array_of_tables(document, "effect") else {
            return Ok(());
        };
        let own =
            |table: &&mut Table| table.get("kind").and_then(Item::as_str) == Some(networks::KIND);
        let networks = self.networks.chunk_by(|a, b| a.table == b.table);
        for (table, networks) in tables.iter_mut().filter(own).zip(networks) {
            let mut names = Vec::new();
            for network in networks {
                let bytes =
                    std::fs::read(&network.path).map_err(|e| Error::io(&network.path, e))?;
                names.push(files.put_beside(&network.path, &bytes)?);
            }
            set(table, "weights", one_or_list(names));
        }
        Ok(())
    }

    fn check(&self, revision: &Revision) -> Result<(), Error> {
        let parameters: usize = self.parameter_values.len();
        for (what, found, expected) in [
            (
                "parameter values",
                revision.parameter_values.len(),
                parameters,
            ),
            ("gains", revision.gains.len(), self.inputs.len()),
            ("zeros", revision.zeros.len(), self.sensors.len()),
        ] {
            if found != expected {
                return Err(Error::Revision {
                    what,
                    found,
                    expected,
                });
            }
        }
        for (entry, _) in &revision.effects {
            if entry.values.len() != entry.kind.parameters.len() {
                return Err(Error::Revision {
                    what: "parameters of an effect",
                    found: entry.values.len(),
                    expected: entry.kind.parameters.len(),
                });
            }
        }
        let given = |(spec, x): &(&ParameterSpec, &f64)| spec.default != Some(LeftOut::Value(**x));
        let effects = revision.effects.iter().flat_map(|(e, _)| {
            let numbers = e.kind.parameters.iter().zip(&e.values);
            numbers.filter(given).map(|(_, x)| x)
        });
        let mut numbers = revision
            .parameter_values
            .iter()
            .chain(&revision.gains)
            .chain(&revision.zeros)
            .chain(effects);
        match numbers.find(|x| !x.is_finite()) {
            None => Ok(()),
            Some(x) => Err(Error::Problems(Problems {
                source: self.path.display().to_string(),
                list: vec![Problem::general(format!(
                    "the revision holds the number {x}: all must be finite"
                ))],
            })),
        }
    }

    fn revise(&self, document: &mut DocumentMut, revision: &Revision) {
        let parameters = self.mechanics.parameters();
        for ((parameter, &old), &new) in parameters
            .iter()
            .zip(&self.parameter_values)
            .zip(&revision.parameter_values)
        {
            if new == old {
                continue;
            }
            let keys: &[&str] = match parameter.role {
                Role::MassScale => &["mass_scale"],
                _ => &["lagrangian", "parameters"],
            };
            set_number(document, keys, &parameter.name, new);
        }
        let coordinates = self.mechanics.coordinates();
        for ((sensor, coordinate), &zero) in
            self.sensors.iter().zip(coordinates).zip(&revision.zeros)
        {
            if zero != sensor.zero {
                set_number(document, &["sensor", &coordinate.name], "zero", zero);
            }
        }
        self.revise_inputs(document, &revision.gains);
        self.revise_effects(document, &revision.effects);
    }

    fn revise_inputs(&self, document: &mut DocumentMut, gains: &[f64]) {
        if self
            .inputs
            .iter()
            .zip(gains)
            .all(|(i, &gain)| i.gain == gain)
        {
            return;
        }
        let Some(tables) = array_of_tables(document, "input") else {
            return;
        };
        for ((table, input), &gain) in tables.iter_mut().zip(&self.inputs).zip(gains) {
            if gain != input.gain {
                set(table, "gain", number(gain));
            }
        }
    }

    fn revise_effects(&self, document: &mut DocumentMut, effects: &[(EffectEntry, String)]) {
        if effects.len() == self.effects.len()
            && effects
                .iter()
                .zip(&self.effects)
                .all(|((new, _), old)| new == old)
        {
            return;
        }
        if self.urdf.is_some() {
            // From here on all effects stand in the model.
            let as_before = document.get("urdf_dynamics").and_then(Item::as_bool) == Some(false);
            if !as_before && self.has_urdf_effects(document) {
                set(document.as_table_mut(), "urdf_dynamics", Value::from(false));
            }
        }
        let Some(tables) = array_of_tables(document, "effect") else {
            return;
        };
        let target_of = |table: &Table| -> (String, String, bool) {
            let text = |key| {
                table
                    .get(key)
                    .and_then(Item::as_str)
                    .unwrap_or("")
                    .to_owned()
            };
            let key = ["joint", "input", "link"];
            let key = key.into_iter().find(|key| table.contains_key(key));
            (
                text("kind"),
                key.map(text).unwrap_or_default(),
                is_fixed(table),
            )
        };
        let key_of = |entry: &EffectEntry| -> (String, String, bool) {
            let target = self.target_name(entry.target).to_owned();
            (entry.kind.name.to_owned(), target, entry.fixed)
        };
        tables.retain(|table| {
            let key = target_of(table);
            key.0 == networks::KIND || effects.iter().any(|(entry, _)| key_of(entry) == key)
        });
        for (entry, comment) in effects {
            let key = key_of(entry);
            let existing = tables.iter_mut().find(|table| target_of(table) == key);
            match existing {
                Some(table) => fill(table, entry),
                None => {
                    let mut table = commented(comment);
                    set(&mut table, "kind", Value::from(entry.kind.name));
                    let target_key = match entry.target {
                        Target::Coordinate(_) => "joint",
                        Target::Input(_) => "input",
                        Target::Link(_) => "link",
                    };
                    set(&mut table, target_key, Value::from(key.1));
                    fill(&mut table, entry);
                    tables.push(table);
                }
            }
        }
        if tables.is_empty() {
            document.remove("effect");
        }
    }

    /// Whether the model has more effects than its file: those of the URDF.
    fn has_urdf_effects(&self, document: &DocumentMut) -> bool {
        let written = match document.get("effect") {
            Some(Item::ArrayOfTables(tables)) => tables.len(),
            Some(Item::Value(Value::Array(array))) => array.len(),
            _ => 0,
        };
        let tables = self.networks.chunk_by(|a, b| a.table == b.table).count();
        self.effects.len() + tables > written
    }
}

fn add_network(document: &mut DocumentMut, network: &NewNetwork) {
    let Some(tables) = array_of_tables(document, "effect") else {
        return;
    };
    let mut table = commented(&network.comment);
    set(&mut table, "kind", Value::from(networks::KIND));
    set(&mut table, "weights", one_or_list(network.weights.clone()));
    let joints: toml_edit::Array = network.joints.iter().map(String::as_str).collect();
    set(&mut table, "joints", Value::Array(joints));
    tables.push(table);
}

/// A name as a string, several as an array.
fn one_or_list(mut names: Vec<String>) -> Value {
    match (names.pop(), names.is_empty()) {
        (Some(only), true) => Value::from(only),
        (last, _) => Value::Array(names.into_iter().chain(last).collect()),
    }
}

/// A table that begins with a comment.
fn commented(comment: &str) -> Table {
    let mut prefix = String::from("\n");
    for line in comment.lines() {
        prefix.push_str("# ");
        prefix.extend(line.chars().filter(|c| !c.is_control()));
        prefix.push('\n');
    }
    let mut table = Table::new();
    table.decor_mut().set_prefix(prefix);
    table
}

/// Writes the numbers of `entry`.
fn fill(table: &mut Table, entry: &EffectEntry) {
    for (spec, &value) in entry.kind.parameters.iter().zip(&entry.values) {
        // A part that is not there cannot be written; what a file means by leaving it out need not be.
        let unsaid = spec.default == Some(LeftOut::Value(value)) && !table.contains_key(spec.name);
        let said = (value.is_finite() && !unsaid).then_some(value);
        match said {
            Some(yes) if spec.is_flag => set(table, spec.name, Value::from(yes != 0.0)),
            _ => put(table, spec.name, said),
        }
    }
    put(table, "smoothing", entry.smoothing);
    if is_fixed(table) != entry.fixed {
        set(table, "fixed", Value::from(entry.fixed));
    }
}

fn is_fixed(table: &Table) -> bool {
    table.get("fixed").and_then(Item::as_bool).unwrap_or(false)
}

/// Writes a number that is not there yet, or takes away what is there for `None`.
fn put(table: &mut Table, key: &str, new: Option<f64>) {
    let old = table.get(key).and_then(as_number);
    match new {
        Some(x) if old != Some(x) => set(table, key, number(x)),
        None => drop(table.remove(key)),
        _ => {}
    }
}

fn as_number(item: &Item) -> Option<f64> {
    item.as_float()
        .or_else(|| item.as_integer().map(|i| i as f64))
}

/// The shortest text that reads back as `x`.
pub(super) fn number(x: f64) -> Value {
    format!("{x:?}").parse().unwrap_or_else(|_| Value::from(x))
}

/// Sets a key; comments and spaces around an old value stay.
pub(super) fn set(table: &mut dyn TableLike, key: &str, mut value: Value) {
    if let Some(Item::Value(old)) = table.get(key) {
        *value.decor_mut() = old.decor().clone();
        if let Some(item) = table.get_mut(key) {
            *item = Item::Value(value);
        }
    } else {
        table.insert(key, Item::Value(value));
    }
}

/// The table at `path`, which is made where it is missing.
pub(super) fn table_at<'a>(
    document: &'a mut DocumentMut,
    path: &[&str],
) -> Option<&'a mut dyn TableLike> {
    let mut table: &mut dyn TableLike = document.as_table_mut();
    for (depth, name) in path.iter().enumerate() {
        if !table.contains_key(name) {
            // A new table has a header of its own, except within braces, where `insert` makes it inline.
            let mut new = Table::new();
            new.set_implicit(depth + 1 < path.len());
            table.insert(name, Item::Table(new));
        }
        table = table.get_mut(name).and_then(Item::as_table_like_mut)?;
    }
    Some(table)
}

/// Sets `key` in the table at `path`, which is made where it is missing.
fn set_number(document: &mut DocumentMut, path: &[&str], key: &str, x: f64) {
    if let Some(table) = table_at(document, path) {
        set(table, key, number(x));
    }
}

/// `[[key]]`, made where it is missing; an inline array of tables becomes one.
fn array_of_tables<'a>(document: &'a mut DocumentMut, key: &str) -> Option<&'a mut ArrayOfTables> {
    let item = document
        .entry(key)
        .or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()));
    if let Item::Value(Value::Array(array)) = item {
        let tables: ArrayOfTables = array
            .iter()
            .filter_map(Value::as_inline_table)
            .cloned()
            .map(InlineTable::into_table)
            .collect();
        *item = Item::ArrayOfTables(tables);
    }
    item.as_array_of_tables_mut()
}
