//! The rows of a log, put together from topics that each have their own times.

use lagrange::Problem;

use super::catalogue::Catalogue;
use super::readings::{Readings, seconds};
use super::series::{Series, period};
use super::turn::Turn;
use crate::entries::starts;
use crate::log::Channels;
use crate::log::columns::{Layout, Source};
use crate::log::rows::{Cell, Row, Rows};
use crate::naming::quoted;

/// How a column is read between its messages.
#[derive(Clone, Copy)]
enum Between {
    /// On a line, or an arc where it goes round with this period.
    Line(Option<f64>),
    Held,
}

/// A column that is read.
struct Signal<'a> {
    /// In the catalogue.
    index: usize,
    series: &'a Series,
    between: Between,
    /// Neighbours between which it was read were so far apart, ns.
    widest: i64,
}

/// What a signal says in one row.
#[derive(Clone, Copy)]
struct Reading {
    index: usize,
    number: f64,
    /// Of the message.
    message: usize,
}

pub(super) struct Table<'a> {
    catalogue: &'a Catalogue,
    signals: Vec<Signal<'a>>,
    turns: Vec<Turn>,
    /// Whose messages are the rows, in the catalogue.
    first: usize,
    run: Option<usize>,
    /// Rows left out before the first and after the last that is whole.
    before: usize,
    after: usize,
}

impl<'a> Table<'a> {
    pub(super) fn new(
        catalogue: &'a Catalogue,
        readings: &'a Readings<'a>,
        layout: &Layout,
        channels: &Channels,
    ) -> Self {
        let mut signals: Vec<Signal> = Vec::new();
        let mut add = |column: usize, between: Between| {
            // The time of the row is no column of the file.
            let Some(index) = column.checked_sub(1) else {
                return;
            };
            // A column with two roles has the first.
            if let (Some(series), false) = (
                readings.series.get(index),
                signals.iter().any(|signal| signal.index == index),
            ) {
                signals.push(Signal {
                    index,
                    series,
                    between,
                    widest: 0,
                });
            }
        };
        let coordinates = channels.coordinates.iter();
        let wraps = coordinates.flat_map(|c| std::iter::repeat_n(c.wraps, c.nq()));
        for (source, wraps) in layout.q.iter().zip(wraps) {
            let period = period(source.scale).filter(|_| wraps);
            add(source.index, Between::Line(period));
        }
        for source in layout.v.iter().flatten() {
            add(source.index, Between::Line(None));
        }
        for source in layout.u.iter().chain([&layout.t]) {
            add(source.index, Between::Held);
        }
        if let Some(index) = layout.run {
            add(index, Between::Held);
        }
        let first = layout.q.first().or(layout.u.first()).unwrap_or(&layout.t);
        Table {
            catalogue,
            turns: turns(&signals, layout, channels),
            signals,
            first: first.index.saturating_sub(1),
            run: layout.run.and_then(|index| index.checked_sub(1)),
            before: 0,
            after: 0,
        }
    }

    /// Adds a row for each message of the first signal at which every signal has a value.
    pub(super) fn fill(&mut self, rows: &mut Rows) {
        let Some(first) = self
            .signals
            .iter()
            .find(|signal| signal.index == self.first)
        else {
            return;
        };
        let topic = self.topic(self.first).to_owned();
        let times = &first.series.times;
        let mut readings = Vec::with_capacity(self.signals.len());
        let mut zero = None;
        for &time in times {
            readings.clear();
            for signal in &mut self.signals {
                readings.extend(signal.at(time));
            }
            if readings.len() < self.signals.len() {
                match zero {
                    None => self.before += 1,
                    Some(_) => self.after += 1,
                }
                continue;
            }
            self.turn(time, &mut readings);
            let zero = *zero.get_or_insert(time);
            rows.add(&Instant {
                readings: &readings,
                topic: &topic,
                time,
                t: time.saturating_sub(zero) as f64 / 1e9,
                run: self.run,
                signals: &self.signals,
            });
        }
    }

    /// Puts orientations in the place of numbers that were read between those of two; there is one reading a signal.
    fn turn(&self, time: i64, readings: &mut [Reading]) {
        for turn in &self.turns {
            let series = turn.signals.map(|signal| self.signals[signal].series);
            for (signal, number) in
                (turn.signals.into_iter()).zip(turn.between(series, time).into_iter().flatten())
            {
                readings[signal].number = number;
            }
        }
    }

    /// Says what was made up and what was left out.
    pub(super) fn tell(&self, rows: &mut Rows, warnings: &mut Vec<Problem>) {
        let topic = self.topic(self.first);
        for signal in self.signals.iter().filter(|signal| signal.widest > 0) {
            let name = self.catalogue.columns.get(signal.index);
            warnings.push(Problem::general(format!(
                "{} is interpolated to the times of {}, between messages up to {} s apart",
                quoted(name.map_or("", |column| &column.name)),
                quoted(topic),
                signal.widest as f64 / 1e9
            )));
        }
        let (before, after) = (self.before, self.after);
        if before + after == 0 {
            return;
        }
        let all = self
            .signals
            .iter()
            .find(|signal| signal.index == self.first);
        if all.is_some_and(|first| before == first.series.times.len()) {
            let spans: Vec<String> = self.signals.iter().map(|s| self.span(s)).collect();
            rows.found.push(|| {
                Problem::general(format!(
                    "at no message of {} has every signal a value: {}; are these of one recording and one clock?",
                    quoted(topic),
                    spans.join(", ")
                ))
            });
        } else {
            warnings.push(Problem::general(format!(
                "{before} rows left out before the first at which every signal has a value, {after} after the last"
            )));
        }
    }

    fn span(&self, signal: &Signal) -> String {
        let ends = match (signal.series.times.first(), signal.series.times.last()) {
            (Some(first), Some(last)) => {
                format!("from {} to {} s", seconds(*first), seconds(*last))
            }
            _ => "nowhere".into(),
        };
        let name = self.catalogue.columns.get(signal.index);
        format!("{} {ends}", quoted(name.map_or("", |column| &column.name)))
    }

    /// The topic of a column.
    fn topic(&self, column: usize) -> &str {
        let column = self.catalogue.columns.get(column);
        let topic = column.and_then(|column| self.catalogue.topics.get(column.topic));
        topic.map_or("", |topic| &topic.name)
    }
}

/// The quaternions among the signals whose parts stand in the same messages; others stay numbers on lines of their own, and so do those with an offset, which
/// are none until it is added.
fn turns(signals: &[Signal], layout: &Layout, channels: &Channels) -> Vec<Turn> {
    let coordinates = channels.coordinates.iter();
    let quaternions = coordinates
        .zip(starts(channels.coordinates))
        .filter(|(c, _)| c.floating)
        .filter_map(|(_, start)| layout.q.get(start.q + 3..start.q + 7)?.try_into().ok());
    let of = |parts: [Source; 4]| {
        let mut found = [0; 4];
        for (found, part) in found.iter_mut().zip(parts) {
            *found = (signals.iter())
                .position(|signal| Some(signal.index) == part.index.checked_sub(1))?;
        }
        let times = |signal: usize| &signals[signal].series.times;
        let together = found.iter().all(|signal| times(*signal) == times(found[0]));
        let plain = parts.iter().all(|part| part.offset == 0.0);
        (together && plain).then_some(Turn {
            signals: found,
            scales: parts.map(|part| part.scale),
        })
    };
    quaternions.filter_map(of).collect()
}

impl Signal<'_> {
    fn at(&mut self, time: i64) -> Option<Reading> {
        let message = self.series.held(time)?;
        let number = match self.between {
            Between::Held => *self.series.numbers.get(message)?,
            Between::Line(period) => {
                let (number, apart) = self.series.between(time, period)?;
                self.widest = self.widest.max(apart);
                number
            }
        };
        Some(Reading {
            index: self.index,
            number,
            message,
        })
    }
}

/// A row.
struct Instant<'a> {
    readings: &'a [Reading],
    signals: &'a [Signal<'a>],
    run: Option<usize>,
    topic: &'a str,
    /// In the file, ns.
    time: i64,
    /// Since the first row, s.
    t: f64,
}

impl Row for Instant<'_> {
    /// Rows of one time are one, whatever the messages at that time say.
    fn may_repeat(&self) -> bool {
        false
    }

    fn cell(&self, index: usize) -> Cell<'_> {
        let Some(index) = index.checked_sub(1) else {
            return Cell::Number(self.t);
        };
        let mut both = self.readings.iter().zip(self.signals);
        let Some((reading, signal)) = both.find(|(reading, _)| reading.index == index) else {
            return Cell::Missing;
        };
        match signal.series.texts.get(reading.message) {
            Some(text) if self.run == Some(index) => Cell::Text(text),
            _ => Cell::Number(reading.number),
        }
    }

    fn problem(&self, _: usize, message: String) -> Problem {
        Problem::general(format!(
            "{} at {} s (row at {:.3} s): {message}",
            quoted(self.topic),
            seconds(self.time),
            self.t
        ))
    }
}
