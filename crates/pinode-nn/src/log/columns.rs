//! Which column of a log holds which signal.

use std::collections::HashSet;

use lagrange::{Position, Problem};

use super::Channels;
use crate::entries::{q_names, v_names};
use crate::naming::{hint, quoted};

/// The `[log.columns]` of a model: signals whose columns have other names.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ColumnMap {
    /// The mapped signals, in the order of the model file.
    pub mappings: Vec<Mapping>,
}

/// Where one signal stands: signal = column · scale + offset, `rows_late` rows further down than the rest of its row.
#[derive(Debug, Clone, PartialEq)]
pub struct Mapping {
    /// `t`, `run`, `q.<joint>`, `v.<joint>` or `u.<input>`.
    pub signal: String,
    /// Name in the log's header.
    pub column: String,
    /// Factor on the number in the log.
    pub scale: f64,
    /// Added after scaling, in the signal's unit.
    pub offset: f64,
    /// Of an input: that of row k, held over [t_k, t_{k+1}), stands so many rows further down, as where a row holds what was put out before its
    /// state was measured.
    pub rows_late: usize,
}

impl Mapping {
    /// The signal is what stands in the column.
    pub fn new(signal: impl Into<String>, column: impl Into<String>) -> Self {
        Mapping {
            signal: signal.into(),
            column: column.into(),
            scale: 1.0,
            offset: 0.0,
            rows_late: 0,
        }
    }
}

impl ColumnMap {
    /// Where `signal` stands: as mapped, else under its own name.
    pub fn of(&self, signal: &str) -> Mapping {
        self.mappings
            .iter()
            .find(|mapping| mapping.signal == signal)
            .cloned()
            .unwrap_or_else(|| Mapping::new(signal, signal))
    }
}

/// A column that is read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source {
    /// Index in a record.
    pub index: usize,
    pub scale: f64,
    pub offset: f64,
}

/// All columns that are read.
#[derive(Debug)]
pub(super) struct Layout {
    pub t: Source,
    pub q: Vec<Source>,
    pub v: Vec<Option<Source>>,
    pub u: Vec<Source>,
    pub run: Option<usize>,
}

#[cfg(any(feature = "parquet", feature = "mcap"))]
impl Layout {
    /// Indices of all columns that are read; a column may stand for several signals.
    pub fn used(&self) -> impl Iterator<Item = usize> {
        let velocities = self.v.iter().flatten();
        std::iter::once(&self.t)
            .chain(&self.q)
            .chain(velocities)
            .chain(&self.u)
            .map(|source| source.index)
            .chain(self.run)
    }
}

/// Finds the columns of `channels` in `header`, which stands at `top` of a text.
pub(super) fn resolve(
    header: &[&str],
    top: Option<Position>,
    channels: &Channels,
    warnings: &mut Vec<Problem>,
) -> Result<Layout, Vec<Problem>> {
    let mut problems = Vec::new();
    let mut seen = HashSet::with_capacity(header.len());
    let said = |message: String| Problem {
        position: top,
        message,
    };
    for name in header {
        if !name.is_empty() && !seen.insert(name) {
            problems.push(said(format!(
                "the header has column {} twice: rename one",
                quoted(name)
            )));
        }
    }

    let mut search = Search {
        header,
        channels,
        used: vec![false; header.len()],
        missing: Vec::new(),
    };
    let t = search.needed("t");
    let q: Vec<_> = q_names(channels.coordinates)
        .iter()
        .filter_map(|signal| search.needed(signal))
        .collect();
    let wanted = channels.coordinates.iter().zip(channels.velocities);
    let wanted = wanted.flat_map(|(c, &wanted)| std::iter::repeat_n(wanted, c.nv()));
    let v: Vec<_> = v_names(channels.coordinates)
        .iter()
        .zip(wanted)
        .map(|(signal, wanted)| {
            let mapped = channels
                .columns
                .mappings
                .iter()
                .any(|m| m.signal == *signal);
            match (wanted, mapped) {
                (false, _) => None,
                (true, true) => search.needed(signal),
                (true, false) => search.find(signal),
            }
        })
        .collect();
    let u: Vec<_> = channels
        .inputs
        .iter()
        .filter_map(|name| search.needed(&format!("u.{name}")))
        .collect();
    let run_mapped = channels.columns.mappings.iter().any(|m| m.signal == "run");
    let run = if run_mapped {
        search.needed("run")
    } else {
        search.find("run")
    };

    let Search { used, missing, .. } = search;
    // Some name their columns by numbers, and map them.
    let is_number = |name: &&str| name.trim().parse::<f64>().is_ok();
    if !missing.is_empty() && header.iter().all(is_number) {
        return Err(vec![said(format!(
            "the first line holds numbers: a log begins with the names of its columns, {} and so on",
            quoted("t")
        ))]);
    }
    let unused: Vec<&str> = header
        .iter()
        .zip(&used)
        .filter(|(_, used)| !**used)
        .map(|(name, _)| *name)
        .collect();
    for (signal, column) in missing {
        let spelled = if signal == column {
            quoted(&signal)
        } else {
            format!("{} (for {signal}, by [log.columns])", quoted(&column))
        };
        problems.push(said(format!(
            "column {spelled} is missing{}; other names are mapped by [log.columns] in the model",
            hint(&column, "unused columns", &unused)
        )));
    }
    if let (Some(t), true) = (t, problems.is_empty()) {
        let names = q_names(channels.coordinates);
        for (k, (name, source)) in names.iter().zip(&q).enumerate() {
            let same = |(_, other): &(&String, &Source)| other.index == source.index;
            if let Some((other, _)) = names.iter().zip(&q).take(k).find(same) {
                warnings.push(said(format!(
                    "{} and {} are both read from the column {}",
                    quoted(other),
                    quoted(name),
                    quoted(header.get(source.index).copied().unwrap_or_default())
                )));
            }
        }
        // Where inputs alone are asked for, nobody misses the rest.
        if !unused.is_empty() && !channels.coordinates.is_empty() {
            let names: Vec<String> = unused.iter().take(20).map(|name| quoted(name)).collect();
            let more = match unused.len().saturating_sub(20) {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            warnings.push(said(format!(
                "columns not used: {}{more}",
                names.join(", ")
            )));
        }
        return Ok(Layout {
            t,
            q,
            v,
            u,
            run: run.map(|source| source.index),
        });
    }
    Err(problems)
}

struct Search<'a> {
    header: &'a [&'a str],
    channels: &'a Channels<'a>,
    used: Vec<bool>,
    /// (signal, column) of what was needed and is not there.
    missing: Vec<(String, String)>,
}

impl Search<'_> {
    fn find(&mut self, signal: &str) -> Option<Source> {
        let mapping = self.channels.columns.of(signal);
        let index = self
            .header
            .iter()
            .position(|name| *name == mapping.column)?;
        if let Some(used) = self.used.get_mut(index) {
            *used = true;
        }
        Some(Source {
            index,
            scale: mapping.scale,
            offset: mapping.offset,
        })
    }

    fn needed(&mut self, signal: &str) -> Option<Source> {
        let found = self.find(signal);
        if found.is_none() {
            let column = self.channels.columns.of(signal).column;
            self.missing.push((signal.to_owned(), column));
        }
        found
    }
}
