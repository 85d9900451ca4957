//! Which column of a log holds which signal: `[log.columns]`.

use lagrange::Mechanics;
use toml::Spanned;
use toml::de::DeValue;
use toml_edit::{DocumentMut, InlineTable, Value};

use super::document::{Faults, Section, mismatch};
use super::write::{number, set, table_at};
use super::{Input, Model};
use crate::Error;
use crate::entries::{q_names, v_names};
use crate::log::{ColumnMap, Mapping};
use crate::naming::{hint, quoted};

/// The `[log.columns]` table.
pub(super) fn read(
    root: &Section,
    mechanics: Option<&dyn Mechanics>,
    inputs: &[Input],
    faults: &mut Faults,
) -> ColumnMap {
    let mut map = ColumnMap::default();
    let Some(log) = root.section("log", "[log]", faults) else {
        return map;
    };
    log.check_keys(&["columns"], faults);
    let Some(table) = log.section("columns", "[log.columns]", faults) else {
        return map;
    };
    let mut signals = vec!["t".to_owned(), "run".to_owned()];
    let single = mechanics.map_or(&[][..], |m| m.coordinates());
    let poses = crate::poses::with_poses(single);
    let poses = if poses == single { &[][..] } else { &poses };
    for coordinates in [single, poses] {
        signals.extend(q_names(coordinates));
        signals.extend(v_names(coordinates));
    }
    signals.extend(inputs.iter().map(|input| format!("u.{}", input.name)));
    let signals: Vec<&str> = signals.iter().map(String::as_str).collect();
    for (signal, value) in table.entries() {
        if mechanics.is_some() && !signals.contains(&signal.value) {
            let nested = matches!(value.get_ref(), DeValue::Table(_))
                && ["q", "v", "u"].contains(&signal.value);
            let cure = if nested {
                format!("; quote the whole signal: \"{}.<name>\" = …", signal.value)
            } else {
                hint(signal.value, "signals", &signals)
            };
            faults.at(
                signal.offset(),
                format!("unknown signal {}{cure}", quoted(signal.value)),
            );
            continue;
        }
        map.mappings.extend(mapping(signal.value, value, faults));
    }
    map
}

fn mapping(signal: &str, value: &Spanned<DeValue>, faults: &mut Faults) -> Option<Mapping> {
    let mapping = match value.get_ref() {
        DeValue::String(column) => Mapping::new(signal, column.as_ref()),
        DeValue::Table(table) => {
            let section = Section {
                title: format!("the column of {}", quoted(signal)),
                table,
                offset: value.span().start,
            };
            section.check_keys(&["column", "scale", "offset", "rows_late"], faults);
            let column = match section.get("column") {
                Some(_) => section.string("column", faults)?.value.to_owned(),
                None => signal.to_owned(),
            };
            let scale = section.number_that("scale", "different from 0", |x| x != 0.0, faults);
            let offset = section.number("offset", faults).map(|o| o.value);
            Mapping {
                scale: scale.unwrap_or(1.0),
                offset: offset.unwrap_or(0.0),
                rows_late: rows_late(signal, &section, faults),
                ..Mapping::new(signal, column)
            }
        }
        _ => {
            mismatch(
                signal,
                value,
                "the name of a column, or { column = \"…\", scale = …, offset = …, rows_late = … }",
                faults,
            );
            return None;
        }
    };
    if signal == "run" && (mapping.scale, mapping.offset) != (1.0, 0.0) {
        faults.at(
            value.span().start,
            "`run` is an id: it takes no scale and no offset",
        );
    }
    Some(mapping)
}

/// By how many rows an input stands too far down.
fn rows_late(signal: &str, section: &Section, faults: &mut Faults) -> usize {
    const MOST: f64 = 1e6;
    let key = "rows_late";
    let is_whole = |n: f64| n.fract() == 0.0 && (0.0..=MOST).contains(&n);
    let rows = section.number_that(key, "a whole number from 0 to a million", is_whole, faults);
    let (rows, place) = (rows.unwrap_or(0.0), section.get(key));
    if let Some(place) = place.filter(|_| rows != 0.0 && !signal.starts_with("u.")) {
        faults.at(
            place.span().start,
            "`rows_late` is of inputs alone: of a joint whose readings are late, write the effect `sensor_delay`",
        );
    }
    rows as usize
}

/// Writes where signals stand; those of the table that are not among the `mappings` stay.
fn write(document: &mut DocumentMut, mappings: &[Mapping]) {
    let Some(table) = table_at(document, &["log", "columns"]) else {
        return;
    };
    for mapping in mappings {
        set(table, &mapping.signal, value(mapping));
    }
}

/// As it is written: the name of a column, with scale, offset and rows where it has any.
pub(crate) fn value(mapping: &Mapping) -> Value {
    let own = Mapping::new(&mapping.signal, &mapping.column);
    if *mapping == own {
        return Value::from(&mapping.column);
    }
    let mut parts = InlineTable::new();
    parts.insert("column", Value::from(&mapping.column));
    if mapping.scale != 1.0 || mapping.rows_late == 0 {
        parts.insert("scale", number(mapping.scale));
    }
    if mapping.offset != 0.0 {
        parts.insert("offset", number(mapping.offset));
    }
    if mapping.rows_late != 0 {
        parts.insert("rows_late", Value::from(mapping.rows_late as i64));
    }
    Value::InlineTable(parts)
}

impl Model {
    /// The same that reads these signals of a log where the `mappings` say, in its file too.
    ///
    /// # Errors
    /// [`Error::Problems`] where its file is no TOML any more.
    pub(crate) fn with_columns(&self, mappings: &[Mapping]) -> Result<Model, Error> {
        let mut document = self.document()?;
        write(&mut document, mappings);
        let mut columns = self.columns.clone();
        let is_new = |old: &Mapping| mappings.iter().all(|new| new.signal != old.signal);
        columns.mappings.retain(is_new);
        columns.mappings.extend_from_slice(mappings);
        Ok(Model {
            columns,
            text: document.to_string(),
            ..self.clone()
        })
    }
}
