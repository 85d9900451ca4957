//! Typed access to a TOML document that gathers all faults, with their places.

use std::ops::Range;

use lagrange::{Position, Problem};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::naming::{hint, quoted};

/// More faults than these are only counted.
const MOST_FAULTS: usize = 50;

/// Faults by byte offset.
#[derive(Debug, Default)]
pub(super) struct Faults {
    list: Vec<(usize, String)>,
}

impl Faults {
    pub fn at(&mut self, offset: usize, message: impl Into<String>) {
        self.list.push((offset, message.into()));
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// In the order of the text; the first ones and how many more.
    pub fn into_problems(mut self, text: &str) -> Vec<Problem> {
        self.list.sort();
        self.list.dedup();
        let more = self.list.len().saturating_sub(MOST_FAULTS);
        let mut problems: Vec<Problem> = self
            .list
            .into_iter()
            .take(MOST_FAULTS)
            .map(|(offset, message)| Problem::at(Position::of(text, offset), message))
            .collect();
        if more > 0 {
            problems.push(Problem::general(format!("and {more} more")));
        }
        problems
    }
}

/// A value and where it stands.
#[derive(Debug, Clone)]
pub(super) struct Placed<T> {
    pub value: T,
    pub span: Range<usize>,
}

impl<T> Placed<T> {
    /// Byte offset of its start.
    pub fn offset(&self) -> usize {
        self.span.start
    }
}

/// A table of the document.
#[derive(Debug, Clone)]
pub(super) struct Section<'a> {
    /// As it is called in messages: `[sensor.pole]`.
    pub title: String,
    pub table: &'a DeTable<'a>,
    /// Byte offset of its start.
    pub offset: usize,
}

impl<'a> Section<'a> {
    /// Every key that is not among `known` is a fault.
    pub fn check_keys(&self, known: &[&str], faults: &mut Faults) {
        for (key, _) in self.table.iter() {
            let name: &str = key.get_ref();
            if !known.contains(&name) {
                faults.at(
                    key.span().start,
                    format!(
                        "unknown key {} in {}{}",
                        quoted(name),
                        self.title,
                        hint(name, "keys", known)
                    ),
                );
            }
        }
    }

    pub fn get(&self, key: &str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.table
            .iter()
            .find(|(k, _)| k.get_ref() == key)
            .map(|(_, value)| value)
    }

    pub fn string(&self, key: &str, faults: &mut Faults) -> Option<Placed<&'a str>> {
        string(key, self.get(key)?, faults)
    }

    /// A string that must be there.
    pub fn needed_string(&self, key: &str, faults: &mut Faults) -> Option<Placed<&'a str>> {
        if self.get(key).is_none() {
            faults.at(
                self.offset,
                format!("{} has no {}, a string", self.title, quoted(key)),
            );
        }
        self.string(key, faults)
    }

    /// A finite number.
    pub fn number(&self, key: &str, faults: &mut Faults) -> Option<Placed<f64>> {
        number(key, self.get(key)?, faults)
    }

    /// A finite number within bounds; `condition` says which.
    pub fn number_that(
        &self,
        key: &str,
        condition: &str,
        holds: impl Fn(f64) -> bool,
        faults: &mut Faults,
    ) -> Option<f64> {
        let number = self.number(key, faults)?;
        if holds(number.value) {
            return Some(number.value);
        }
        faults.at(
            number.offset(),
            format!(
                "{} is {}: it must be {condition}",
                quoted(key),
                number.value
            ),
        );
        None
    }

    pub fn boolean(&self, key: &str, faults: &mut Faults) -> Option<bool> {
        let value = self.get(key)?;
        let boolean = value.get_ref().as_bool();
        if boolean.is_none() {
            mismatch(key, value, "true or false", faults);
        }
        boolean
    }

    pub fn array(&self, key: &str, faults: &mut Faults) -> Option<&'a [Spanned<DeValue<'a>>]> {
        let value = self.get(key)?;
        match value.get_ref() {
            DeValue::Array(array) => Some(array),
            _ => {
                mismatch(key, value, "an array", faults);
                None
            }
        }
    }

    /// Three numbers; `meaning` is what stands behind [x, y, z] in messages.
    pub fn triple(&self, key: &str, meaning: &str, faults: &mut Faults) -> Option<[f64; 3]> {
        let list = self.array(key, faults)?;
        let numbers: Vec<f64> = list
            .iter()
            .filter_map(|value| number(key, value, faults))
            .map(|placed| placed.value)
            .collect();
        if list.len() != 3 {
            let offset = self.get(key).map_or(0, |value| value.span().start);
            faults.at(
                offset,
                format!(
                    "`{key}` has {} entries: it must be [x, y, z] {meaning}",
                    list.len()
                ),
            );
        }
        <[f64; 3]>::try_from(numbers).ok()
    }

    /// An array of strings.
    pub fn strings(&self, key: &str, faults: &mut Faults) -> Option<Vec<Placed<&'a str>>> {
        let list = self.array(key, faults)?;
        Some(
            list.iter()
                .filter_map(|value| string(key, value, faults))
                .collect(),
        )
    }

    /// A table in this one, e.g. `[tolerance]`; `title` is its name in messages.
    pub fn section(&self, key: &str, title: &str, faults: &mut Faults) -> Option<Section<'a>> {
        as_section(key, self.get(key)?, title.to_owned(), faults)
    }

    /// The tables of `[[key]]`.
    pub fn sections(&self, key: &str, faults: &mut Faults) -> Vec<Section<'a>> {
        let value = self.get(key);
        if let Some(table) = value.filter(|value| value.get_ref().as_table().is_some()) {
            faults.at(
                table.span().start,
                format!("`{key}` is a single table: write `[[{key}]]`, in two pairs of brackets, of which there may be several"),
            );
            return Vec::new();
        }
        let Some(list) = self.array(key, faults) else {
            return Vec::new();
        };
        list.iter()
            .filter_map(|value| as_section(key, value, format!("[[{key}]]"), faults))
            .collect()
    }

    /// The tables in this one, which is `[title]`, by name, in the order of the text.
    pub fn named_sections(
        &self,
        title: &str,
        faults: &mut Faults,
    ) -> Vec<(Placed<&'a str>, Section<'a>)> {
        self.entries()
            .into_iter()
            .filter_map(|(key, value)| {
                let title = format!("[{title}.{}]", quoted(key.value).trim_matches('`'));
                let section = as_section(key.value, value, title, faults)?;
                Some((key, section))
            })
            .collect()
    }

    /// Keys and values in the order of the text.
    pub fn entries(&self) -> Vec<(Placed<&'a str>, &'a Spanned<DeValue<'a>>)> {
        let mut entries: Vec<_> = self
            .table
            .iter()
            .map(|(key, value)| {
                let name: &'a str = key.get_ref();
                let span = key.span();
                (Placed { value: name, span }, value)
            })
            .collect();
        entries.sort_by_key(|(key, _)| key.offset());
        entries
    }
}

pub(super) fn as_section<'a>(
    key: &str,
    value: &'a Spanned<DeValue<'a>>,
    title: String,
    faults: &mut Faults,
) -> Option<Section<'a>> {
    match value.get_ref() {
        DeValue::Table(table) => Some(Section {
            title,
            table,
            offset: value.span().start,
        }),
        _ => {
            mismatch(key, value, "a table", faults);
            None
        }
    }
}

fn string<'a>(
    key: &str,
    value: &'a Spanned<DeValue<'a>>,
    faults: &mut Faults,
) -> Option<Placed<&'a str>> {
    match value.get_ref() {
        DeValue::String(text) => Some(Placed {
            value: text,
            span: value.span(),
        }),
        _ => {
            mismatch(key, value, "a string", faults);
            None
        }
    }
}

/// A finite number, written as integer or float.
pub(super) fn number(
    key: &str,
    value: &Spanned<DeValue>,
    faults: &mut Faults,
) -> Option<Placed<f64>> {
    let parsed = match value.get_ref() {
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix())
            .ok()
            .map(|i| i as f64),
        DeValue::Float(float) => float.as_str().parse::<f64>().ok(),
        _ => {
            mismatch(key, value, "a number", faults);
            return None;
        }
    };
    match parsed {
        Some(x) if x.is_finite() => Some(Placed {
            value: x,
            span: value.span(),
        }),
        Some(x) => {
            faults.at(
                value.span().start,
                format!("{} is {x}: it must be finite", quoted(key)),
            );
            None
        }
        None => {
            faults.at(
                value.span().start,
                format!("{} is too large a number", quoted(key)),
            );
            None
        }
    }
}

pub(super) fn mismatch(key: &str, value: &Spanned<DeValue>, expected: &str, faults: &mut Faults) {
    let found = match value.get_ref() {
        DeValue::String(_) => "a string",
        DeValue::Integer(_) | DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "a boolean",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "an array",
        DeValue::Table(_) => "a table",
    };
    faults.at(
        value.span().start,
        format!("{} is {found}: it must be {expected}", quoted(key)),
    );
}
