//! Reading CSV, with the place of every fault.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use lagrange::{Position, Problem, Problems};

use super::columns::{self, Layout, Source};
use super::{Channels, FEWEST_SAMPLES, Log, Run};
use crate::Error;
use crate::entries::starts;
use crate::naming::quoted;

/// A longer file is refused.
const LARGEST: u64 = 1 << 30;
/// More problems than these are only counted.
const MOST_PROBLEMS: usize = 20;

/// The whole file.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, Error> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let mut bytes = Vec::new();
    file.take(LARGEST + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, e))?;
    Ok(bytes)
}

/// Problems, of which the first are kept.
struct Found {
    list: Vec<Problem>,
    more: usize,
}

impl Found {
    fn push(&mut self, problem: impl FnOnce() -> Problem) {
        if self.list.len() < MOST_PROBLEMS {
            self.list.push(problem());
        } else {
            self.more += 1;
        }
    }

    fn into_error(mut self, path: &Path) -> Error {
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

fn one(path: &Path, problem: Problem) -> Error {
    Error::Problems(Problems {
        source: path.display().to_string(),
        list: vec![problem],
    })
}

/// The log in `bytes`.
pub(super) fn parse(path: &Path, bytes: &[u8], channels: &Channels) -> Result<Log, Error> {
    if bytes.len() as u64 > LARGEST {
        return Err(one(
            path,
            Problem::general("the file is larger than 1 GiB: split it by runs"),
        ));
    }
    let text = text_of(path, bytes)?;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .from_reader(text.as_bytes());
    let mut record = csv::StringRecord::new();
    let mut warnings = Vec::new();
    let csv_error = |e: csv::Error| one(path, Problem::general(e.to_string()));
    if !reader.read_record(&mut record).map_err(csv_error)? {
        return Err(one(
            path,
            Problem::general(
                "the file is empty: a log starts with the header `t,q.<joint>,…,u.<input>,…`",
            ),
        ));
    }
    let header: Vec<String> = record.iter().map(|name| name.trim().to_owned()).collect();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let layout = columns::resolve(&header, channels, &mut warnings).map_err(|list| {
        let mut found = Found {
            list: Vec::new(),
            more: 0,
        };
        for problem in list {
            found.push(|| problem);
        }
        found.into_error(path)
    })?;

    let mut rows = Rows {
        text,
        header: &header,
        layout: &layout,
        runs: Vec::new(),
        found: Found {
            list: Vec::new(),
            more: 0,
        },
    };
    while reader.read_record(&mut record).map_err(csv_error)? {
        rows.add(&record);
    }
    let Rows {
        runs, mut found, ..
    } = rows;
    if found.list.is_empty() {
        let runs = long_enough(runs, &mut warnings, &mut found);
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

/// The text after the byte-order mark.
fn text_of<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, Error> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(one(
            path,
            Problem::general("the file is UTF-16: save it as UTF-8"),
        ));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    std::str::from_utf8(bytes).map_err(|e| {
        let valid = bytes.get(..e.valid_up_to()).unwrap_or_default();
        let valid = std::str::from_utf8(valid).unwrap_or_default();
        one(
            path,
            Problem::at(
                Position::of(valid, valid.len()),
                "this byte is not UTF-8: a log is a CSV text in UTF-8 (other formats, such as Parquet, are not read)",
            ),
        )
    })
}

struct Rows<'a> {
    text: &'a str,
    header: &'a [&'a str],
    layout: &'a Layout,
    runs: Vec<Run>,
    found: Found,
}

impl Rows<'_> {
    fn add(&mut self, record: &csv::StringRecord) {
        if record.len() != self.header.len() {
            let (text, expected) = (self.text, self.header.len());
            self.found.push(|| {
                Problem::at(
                    place(text, record, 0),
                    format!("{} fields, the header has {expected}", record.len()),
                )
            });
            return;
        }
        let layout = self.layout;
        let Some(t) = self.number(record, layout.t) else {
            return;
        };
        let id = layout
            .run
            .and_then(|index| record.get(index))
            .map_or("0", str::trim);
        if self.runs.last().is_none_or(|run| run.id != id) {
            if self.runs.iter().any(|run| run.id == id) {
                let (text, index) = (self.text, layout.run.unwrap_or(0));
                self.found.push(|| {
                    Problem::at(
                        place(text, record, index),
                        format!(
                            "run {} returns after another run: keep its rows together, or give the second recording its own id",
                            quoted(id)
                        ),
                    )
                });
            }
            self.runs.push(Run {
                id: id.to_owned(),
                t: Vec::new(),
                q: vec![Vec::new(); layout.q.len()],
                v: layout.v.iter().map(|v| v.map(|_| Vec::new())).collect(),
                u: vec![Vec::new(); layout.u.len()],
            });
        } else if let Some(&last) = self.runs.last().and_then(|run| run.t.last())
            && t <= last
        {
            let (text, index) = (self.text, layout.t.index);
            let happened = if t == last {
                "repeats"
            } else {
                "goes backwards"
            };
            self.found.push(|| {
                Problem::at(
                    place(text, record, index),
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
            column.extend(self.number(record, source));
        }
        for (column, source) in run.v.iter_mut().zip(&layout.v) {
            if let (Some(column), &Some(source)) = (column, source) {
                column.extend(self.number(record, source));
            }
        }
        for (column, &source) in run.u.iter_mut().zip(&layout.u) {
            column.extend(self.number(record, source));
        }
        self.runs.push(run);
    }

    fn number(&mut self, record: &csv::StringRecord, source: Source) -> Option<f64> {
        let field = record.get(source.index).unwrap_or("").trim();
        let parsed = field.parse::<f64>();
        if let Ok(raw) = parsed
            && raw.is_finite()
        {
            let value = raw * source.scale + source.offset;
            if value.is_finite() {
                return Some(value);
            }
        }
        let (text, name) = (self.text, self.header.get(source.index).unwrap_or(&""));
        self.found.push(|| {
            let fault = match parsed {
                _ if field.is_empty() => "is empty".to_owned(),
                Ok(raw) if raw.is_finite() => {
                    format!("is {raw}, which scale and offset make infinite")
                }
                Ok(raw) => format!("is {raw}"),
                Err(_) => format!("is {}, not a number", quoted(field)),
            };
            Problem::at(
                place(text, record, source.index),
                format!(
                    "{} {fault}: every entry must be a finite number; where the sensor failed, cut the recording into two runs",
                    quoted(name)
                ),
            )
        });
        None
    }
}

/// Where field `index` of `record` stands in `text`.
fn place(text: &str, record: &csv::StringRecord, index: usize) -> Position {
    let (mut offset, mut line) = match record.position() {
        Some(p) => (usize::try_from(p.byte()).unwrap_or(0), p.line() as usize),
        None => (0, 1),
    };
    let mut rest = text.get(offset..).unwrap_or("");
    // The reader counts blank lines to the record after them.
    while let Some(c @ ('\r' | '\n')) = rest.chars().next() {
        line += usize::from(c == '\n');
        offset += 1;
        rest = text.get(offset..).unwrap_or("");
    }
    let (mut field, mut column, mut within_quotes) = (0, 1, false);
    for c in rest.chars() {
        if field == index {
            break;
        }
        match c {
            '"' => within_quotes = !within_quotes,
            ',' if !within_quotes => field += 1,
            _ => {}
        }
        if c == '\n' {
            line += 1;
            column = 1;
        } else {
            column += 1;
        }
    }
    Position { line, column }
}

/// The runs that are not too short.
fn long_enough(runs: Vec<Run>, warnings: &mut Vec<Problem>, found: &mut Found) -> Vec<Run> {
    let longest = runs.iter().map(Run::len).max().unwrap_or(0);
    if longest < FEWEST_SAMPLES {
        found.push(|| {
            Problem::general(format!(
                "too short: {longest} samples in the longest run, at least {FEWEST_SAMPLES} are needed"
            ))
        });
        return runs;
    }
    let (long, short): (Vec<Run>, Vec<Run>) = runs
        .into_iter()
        .partition(|run| run.len() >= FEWEST_SAMPLES);
    if let Some(first) = short.first() {
        warnings.push(Problem::general(format!(
            "{} runs left out because they have fewer than {FEWEST_SAMPLES} samples, the first is {}",
            short.len(),
            quoted(&first.id)
        )));
    }
    long
}

/// Coordinates that never move are suspicious; a log in which nothing moves is of no use.
fn still(runs: &[Run], channels: &Channels, warnings: &mut Vec<Problem>, found: &mut Found) {
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
