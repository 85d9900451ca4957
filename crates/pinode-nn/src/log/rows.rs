//! What is asked of every row, whatever the file's format: finite numbers, times that increase, runs that stand together.

use std::borrow::Cow;
use std::path::Path;

use lagrange::{Problem, Problems};

use super::columns::{Layout, Source};
use super::{Channels, FEWEST_SAMPLES, Log, Run, unit};
use crate::Error;
use crate::entries::starts;
use crate::naming::quoted;

/// So many samples a recording has at least of which the inputs alone are read.
const FEWEST_INPUTS: usize = 2;
/// More problems than these are only counted.
const MOST_PROBLEMS: usize = 20;

/// What stands in one column of one row.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    not(feature = "parquet"),
    allow(dead_code) // CSV has texts only, MCAP no integers
)]
pub(super) enum Cell<'a> {
    /// A word, or a number as text.
    Text(&'a str),
    Number(f64),
    /// Kept apart from other numbers because ids of runs may be longer than those can tell.
    Integer(i128),
    Missing,
}

/// One row of a file, by the columns of its header.
pub(super) trait Row {
    fn cell(&self, index: usize) -> Cell<'_>;
    /// A fault of the cell in column `index`, with its place.
    fn problem(&self, index: usize, message: String) -> Problem;
    /// Whether one that repeats the row before may be that row written twice.
    fn may_repeat(&self) -> bool {
        true
    }
}

/// Problems, of which the first are kept.
#[derive(Debug, Default)]
pub(super) struct Found {
    list: Vec<Problem>,
    more: usize,
}

impl Found {
    pub(super) fn push(&mut self, problem: impl FnOnce() -> Problem) {
        if self.list.len() < MOST_PROBLEMS {
            self.list.push(problem());
        } else {
            self.more += 1;
        }
    }

    pub(super) fn into_error(mut self, path: &Path) -> Error {
        if self.more > 0 {
            self.list
                .push(Problem::general(format!("and {} more", self.more)));
        }
        Error::Problems(Problems {
            source: path.display().to_string(),
            list: self.list,
        })
    }
}

impl From<Vec<Problem>> for Found {
    fn from(list: Vec<Problem>) -> Self {
        let mut found = Found::default();
        for problem in list {
            found.push(|| problem);
        }
        found
    }
}

/// The file cannot be read at all, for one reason.
pub(super) fn refused(path: &Path, problem: Problem) -> Error {
    Found::from(vec![problem]).into_error(path)
}

/// The runs, as far as they were read.
pub(super) struct Rows<'a> {
    header: &'a [&'a str],
    layout: &'a Layout,
    runs: Vec<Run>,
    clock: Clock,
    /// The first row that repeats the one before in all that is read, and how many do.
    doubled: Option<(Problem, usize)>,
    pub(super) found: Found,
}

/// What the column `t` counts from.
#[derive(Debug, Default)]
struct Clock {
    /// The first time, s, as the file has it.
    first: Option<f64>,
    /// What is taken from all others, in the unit of the column: the first where it is whole and of a day long ago. A number of nanoseconds since 1970 has
    /// more digits than an `f64`.
    origin: Option<i128>,
}

impl<'a> Rows<'a> {
    pub(super) fn new(header: &'a [&'a str], layout: &'a Layout) -> Self {
        Rows {
            header,
            layout,
            runs: Vec::new(),
            clock: Clock::default(),
            doubled: None,
            found: Found::default(),
        }
    }

    pub(super) fn add(&mut self, row: &impl Row) {
        let layout = self.layout;
        if self.runs.is_empty() && self.found.list.is_empty() && self.is_of_words(row) {
            self.found.push(|| {
                row.problem(
                    layout.t.index,
                    "this line holds words, units it may be, where the first numbers should stand: take it out; what is not in SI units is read by its `scale` in \
                     [log.columns] of the model"
                        .to_owned(),
                )
            });
            return;
        }
        let Some(t) = self.time(row) else {
            return;
        };
        let id = layout
            .run
            .map_or("0".into(), |index| id_of(row.cell(index)));
        if self.runs.last().is_none_or(|run| run.id != id) {
            if self.runs.iter().any(|run| run.id == id) {
                self.found.push(|| {
                    row.problem(
                        layout.run.unwrap_or(0),
                        format!(
                            "run {} returns after another run: keep its rows together, or give the second recording its own id",
                            quoted(&id)
                        ),
                    )
                });
            }
            self.runs.push(Run {
                id: id.into_owned(),
                t: Vec::new(),
                q: vec![Vec::new(); layout.q.len()],
                v: layout.v.iter().map(|v| v.map(|_| Vec::new())).collect(),
                u: vec![Vec::new(); layout.u.len()],
            });
        } else if let Some(&last) = self.runs.last().and_then(|run| run.t.last())
            && t <= last
        {
            if t == last && row.may_repeat() && self.is_doubled(row) {
                let (_, n) = self.doubled.get_or_insert_with(|| {
                    let message = "repeats the row before: left out".to_owned();
                    (row.problem(layout.t.index, message), 0)
                });
                *n += 1;
                return;
            }
            let happened = if t == last {
                "repeats"
            } else {
                "goes backwards"
            };
            self.found.push(|| {
                row.problem(
                    layout.t.index,
                    format!(
                        "time {happened}: {t} s after {last} s; recordings that do not continue one another are told apart by a column `run`"
                    ),
                )
            });
        }
        // Numbers go in even where others of the row are missing: a log with problems is not returned.
        let Some(mut run) = self.runs.pop() else {
            return;
        };
        run.t.push(t);
        for (column, &source) in run.q.iter_mut().zip(&layout.q) {
            column.extend(self.number(row, source));
        }
        for (column, source) in run.v.iter_mut().zip(&layout.v) {
            if let (Some(column), &Some(source)) = (column, source) {
                column.extend(self.number(row, source));
            }
        }
        for (column, &source) in run.u.iter_mut().zip(&layout.u) {
            column.extend(self.number(row, source));
        }
        self.runs.push(run);
    }

    /// Whether nothing that is read of a row is a number, and all of it stands there.
    fn is_of_words(&self, row: &impl Row) -> bool {
        let Layout { t, q, u, .. } = self.layout;
        let mut read = q.iter().chain(u).chain([t]);
        read.all(|source| match row.cell(source.index) {
            Cell::Text(field) => field.parse::<f64>().is_err(),
            _ => false,
        })
    }

    /// The time of a row, s.
    fn time(&mut self, row: &impl Row) -> Option<f64> {
        let source = self.layout.t;
        let t = self.number(row, source)?;
        let cell = row.cell(source.index);
        let whole = match cell {
            Cell::Text(field) => field.parse().ok(),
            Cell::Integer(raw) => Some(raw),
            Cell::Number(_) | Cell::Missing => None,
        };
        if self.clock.first.is_none() {
            self.clock.first = Some(t);
            self.clock.origin = whole.filter(|_| t.abs() >= unit::LONG_AGO);
        }
        Some(match (self.clock.origin, whole) {
            (None, _) => t,
            (Some(origin), Some(whole)) => whole.saturating_sub(origin) as f64 * source.scale,
            (Some(origin), None) => t - (origin as f64 * source.scale + source.offset),
        })
    }

    /// Whether all that is read of a row is what the one before had: loggers write one twice.
    fn is_doubled(&self, row: &impl Row) -> bool {
        let Some(run) = self.runs.last() else {
            return false;
        };
        let is_again = |(column, &source): (&Vec<f64>, &Source)| {
            column.last().copied() == value(row.cell(source.index), source)
        };
        let mut velocities = run.v.iter().zip(&self.layout.v);
        run.q.iter().zip(&self.layout.q).all(is_again)
            && run.u.iter().zip(&self.layout.u).all(is_again)
            && velocities.all(|pair| match pair {
                (Some(column), Some(source)) => is_again((column, source)),
                _ => true,
            })
    }

    fn number(&mut self, row: &impl Row, source: Source) -> Option<f64> {
        let cell = row.cell(source.index);
        if let Some(value) = value(cell, source) {
            return Some(value);
        }
        let raw = raw(cell);
        let name = self.header.get(source.index).unwrap_or(&"");
        self.found.push(|| {
            let fault = match (raw, cell) {
                (Some(raw), _) if raw.is_finite() => {
                    format!("is {raw}, which scale and offset make infinite")
                }
                (Some(raw), _) => format!("is {raw}"),
                (None, Cell::Text(field)) => format!("is {}, not a number", quoted(field)),
                (None, _) => "is empty".to_owned(),
            };
            let is_clock = source.index == self.layout.t.index;
            let cure = match (raw, cell) {
                (None, Cell::Text(_)) if is_clock => {
                    "times are numbers of seconds, as those since the first row; dates are not read"
                }
                _ => {
                    "every entry must be a finite number; where the sensor failed, cut the recording into two runs"
                }
            };
            row.problem(source.index, format!("{} {fault}: {cure}", quoted(name)))
        });
        None
    }

    /// The log, unless something was found in the rows or in all of them together.
    pub(super) fn into_log(
        self,
        path: &Path,
        bytes: &[u8],
        channels: &Channels,
        mut warnings: Vec<Problem>,
    ) -> Result<Log, Error> {
        let Rows {
            runs,
            clock,
            doubled,
            mut found,
            ..
        } = self;
        if found.list.is_empty() {
            let mapping = channels.columns.of("t");
            match unit::check(&runs, clock.first.unwrap_or(0.0), &mapping) {
                Ok(warning) => warnings.extend(warning),
                Err(problem) => found.push(|| problem),
            }
            if let Some((mut first, n)) = doubled {
                if n > 1 {
                    first.message = format!("{} ({} more like it)", first.message, n - 1);
                }
                warnings.push(first);
            }
            if clock.origin.is_some() {
                warnings.push(Problem::general(format!(
                    "{} counts from a day long ago: times are those since its first",
                    quoted(&mapping.column)
                )));
            }
            let fewest = match channels.coordinates {
                [] => FEWEST_INPUTS,
                _ => FEWEST_SAMPLES,
            };
            let mut runs = long_enough(runs, fewest, &mut warnings, &mut found);
            for (i, name) in channels.inputs.iter().enumerate() {
                let rows_late = channels.columns.of(&format!("u.{name}")).rows_late;
                runs.iter_mut()
                    .for_each(|run| run.read_input_later(i, rows_late));
            }
            still(&runs, channels, &mut warnings, &mut found);
            if found.list.is_empty() {
                return Ok(Log {
                    path: path.to_owned(),
                    sha256: crate::disk::sha256(bytes),
                    runs,
                    warnings,
                });
            }
        }
        Err(found.into_error(path))
    }
}

/// The number that stands in a cell, as the file has it.
fn raw(cell: Cell) -> Option<f64> {
    match cell {
        Cell::Text(field) => field.parse::<f64>().ok(),
        Cell::Number(raw) => Some(raw),
        Cell::Integer(raw) => Some(raw as f64),
        Cell::Missing => None,
    }
}

/// … and in the unit that the log has it in, where it is finite.
fn value(cell: Cell, source: Source) -> Option<f64> {
    let raw = raw(cell).filter(|raw| raw.is_finite())?;
    let value = raw * source.scale + source.offset;
    value.is_finite().then_some(value)
}

/// What stands in the column `run`.
fn id_of(cell: Cell) -> Cow<str> {
    match cell {
        Cell::Text(id) => id.into(),
        Cell::Number(id) => id.to_string().into(),
        Cell::Integer(id) => id.to_string().into(),
        Cell::Missing => "".into(),
    }
}

/// The runs that are not too short, with `fewest` samples.
fn long_enough(
    runs: Vec<Run>,
    fewest: usize,
    warnings: &mut Vec<Problem>,
    found: &mut Found,
) -> Vec<Run> {
    let longest = runs.iter().map(Run::len).max().unwrap_or(0);
    if longest < fewest {
        found.push(|| {
            Problem::general(format!(
                "too short: {longest} samples in the longest run, at least {fewest} are needed"
            ))
        });
        return runs;
    }
    let (long, short): (Vec<Run>, Vec<Run>) = runs.into_iter().partition(|run| run.len() >= fewest);
    if let Some(first) = short.first() {
        warnings.push(Problem::general(format!(
            "{} runs left out because they have fewer than {fewest} samples, the first is {}",
            short.len(),
            quoted(&first.id)
        )));
    }
    long
}

/// Coordinates that never move are suspicious; a log in which nothing moves is of no use.
fn still(runs: &[Run], channels: &Channels, warnings: &mut Vec<Problem>, found: &mut Found) {
    // Without samples it is too short, and that is said.
    if runs.iter().all(Run::is_empty) {
        return;
    }
    let constant = |i: usize| {
        let mut values = runs.iter().filter_map(|run| run.q.get(i)).flatten();
        let first = values.next();
        values.all(|value| Some(value) == first)
    };
    let all = channels.coordinates.iter();
    let names: Vec<&str> = all
        .zip(starts(channels.coordinates))
        .filter(|(c, start)| (start.q..start.q + c.nq()).all(constant))
        .map(|(c, _)| c.name.as_str())
        .collect();
    if names.is_empty() {
        return;
    }
    if names.len() == channels.coordinates.len() {
        found.push(|| {
            Problem::general(format!(
                "nothing moves: every sample of {} has one and the same value",
                names.join(", ")
            ))
        });
    } else {
        warnings.push(Problem::general(format!(
            "never moves: {}; nothing can be said of its friction",
            names.join(", ")
        )));
    }
}
