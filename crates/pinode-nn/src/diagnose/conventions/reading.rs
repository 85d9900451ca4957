//! Ways in which a log may count: how its signals are read, what that is in words, and what a model file says of it.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::diagnose::audit::scale_of_time;
use crate::entries::{q_names, v_names};
use crate::log::{
    ColumnMap, Log, MICROSECOND, MILLISECOND, Mapping, Run, sizes_of_a_count, typical,
};
use crate::model::Model;
use crate::naming::quoted;

const DEGREE: f64 = PI / 180.0;
const MILLIMETRE: f64 = 1e-3;
const CENTIMETRE: f64 = 1e-2;

/// What a coordinate may be counted in.
const UNITS: [(f64, &str); 3] = [
    (DEGREE, "degrees"),
    (MILLIMETRE, "millimetres"),
    (CENTIMETRE, "centimetres"),
];

/// What an input may be counted in, and how people say it: millinewtons or percent, for two.
const PARTS: [(f64, &str); 6] = [
    (1e-3, "thousandths"),
    (1e-2, "hundredths"),
    (0.1, "tenths"),
    (10.0, "tens"),
    (100.0, "hundreds"),
    (1e3, "thousands"),
];

/// As far from a unit as this factor it is another.
const NEAR: f64 = 2.0;

/// What a log calls its time.
const TIME: &str = "t";

/// What moves further than this in a log, rad or m, may be in smaller units.
const FAR: (f64, f64) = (2.0 * PI, 2.0);

/// A signal of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Signal {
    Time,
    Coordinate(usize),
    Input(usize),
}

impl Signal {
    /// Its place among those of its sort.
    fn place(self) -> usize {
        match self {
            Signal::Time => 0,
            Signal::Coordinate(place) | Signal::Input(place) => place,
        }
    }
}

/// How a signal is read: scale · (that signal `from` of the log) + offset, an input from so many rows further down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    pub signal: Signal,
    pub from: usize,
    pub scale: f64,
    pub offset: f64,
    pub rows_late: usize,
}

/// One thing that may be otherwise in a log: one reading, the two of signals that are exchanged, those of a joint that was put in the other way round, or all of a unit.
pub type Change = Vec<Reading>;

impl Reading {
    pub fn of(signal: Signal, scale: f64, offset: f64) -> Self {
        Reading {
            signal,
            from: signal.place(),
            scale,
            offset,
            rows_late: 0,
        }
    }

    fn reads(&self, column: &[f64]) -> Vec<f64> {
        let read = |x: &f64| self.scale * x + self.offset;
        column.iter().map(read).collect()
    }

    /// Whether it reads the signal otherwise than it is.
    pub fn is_other(&self) -> bool {
        *self != Reading::of(self.signal, 1.0, 0.0)
    }

    /// Whether it is an input in other units.
    pub fn is_unit_of_input(&self) -> bool {
        matches!(self.signal, Signal::Input(_)) && self.scale.abs() != 1.0
    }

    /// Where the signal stands in a log whose own signals stand where `columns` says.
    fn mapping(&self, names: impl Fn(usize) -> String, columns: &ColumnMap) -> Mapping {
        let old = columns.of(&names(self.from));
        Mapping {
            signal: names(self.signal.place()),
            column: old.column,
            scale: self.scale * old.scale,
            offset: self.scale * old.offset + self.offset,
            rows_late: self.rows_late + old.rows_late,
        }
    }
}

/// An input counts in the unit nearest to what its force asks for; in its own where none is near.
pub fn unit_of_input(asked: f64) -> f64 {
    let sizes = std::iter::once(1.0).chain(PARTS.map(|(scale, _)| scale));
    let near = |size: &f64| (asked.abs() / size).ln().abs() < NEAR.ln();
    sizes.into_iter().find(near).unwrap_or(1.0).copysign(asked)
}

/// The two signals exchanged.
fn exchanged(signal: fn(usize) -> Signal, i: usize, j: usize) -> Change {
    let reading = |own, from| Reading {
        from,
        ..Reading::of(signal(own), 1.0, 0.0)
    };
    vec![reading(i, j), reading(j, i)]
}

/// How far a coordinate goes in some logs.
fn range(logs: &[Log], c: usize) -> f64 {
    let runs = || logs.iter().flat_map(|log| &log.runs);
    let q = || runs().flat_map(|run| &run.q[c]).copied();
    q().fold(f64::NEG_INFINITY, f64::max) - q().fold(f64::INFINITY, f64::min)
}

/// All that may be otherwise by itself in the logs of a model; what is most usual first.
pub fn changes(model: &Model, logs: &[Log]) -> Vec<Change> {
    let coordinates = model.mechanics.coordinates();
    let runs: Vec<&Run> = logs.iter().flat_map(|log| &log.runs).collect();
    let times = match scale_of_time(model, &runs) {
        Some(scale) => vec![scale],
        None => {
            let steps = runs.iter().flat_map(|run| run.t.windows(2));
            let step = typical(steps.map(|pair| pair[1] - pair[0]).collect());
            step.map_or(Vec::new(), sizes_of_a_count)
        }
    };
    let times = times.into_iter();
    let mut all: Vec<Change> = times
        .map(|scale| vec![Reading::of(Signal::Time, scale, 0.0)])
        .collect();
    let turned = |i| vec![Reading::of(Signal::Input(i), -1.0, 0.0)];
    all.extend((0..model.inputs.len()).map(turned));
    for (c, coordinate) in coordinates.iter().enumerate() {
        let (far, units, zeros) = match coordinate.angular {
            true => (FAR.0, &[DEGREE][..], &[0.0, PI, FRAC_PI_2, -FRAC_PI_2][..]),
            false => (FAR.1, &[MILLIMETRE, CENTIMETRE][..], &[0.0][..]),
        };
        let is_far = range(logs, c) > far;
        let units = units.iter().filter(|_| is_far);
        for unit in std::iter::once(&1.0).chain(units) {
            for offset in zeros {
                for scale in [*unit, -unit] {
                    if (scale, *offset) != (1.0, 0.0) {
                        all.push(vec![Reading::of(Signal::Coordinate(c), scale, *offset)]);
                    }
                }
            }
        }
    }
    // Of a linear mechanism all in millimetres do what an input in thousandths does.
    for (angular, far, units) in [
        (true, FAR.0, &[DEGREE][..]),
        (false, FAR.1, &[MILLIMETRE, CENTIMETRE][..]),
    ] {
        let own: Vec<usize> = (0..coordinates.len())
            .filter(|&c| coordinates[c].angular == angular)
            .collect();
        if own.len() > 1 && own.iter().all(|&c| range(logs, c) > far) {
            let in_unit = |unit: &f64| {
                let reading = |&c: &usize| Reading::of(Signal::Coordinate(c), *unit, 0.0);
                own.iter().map(reading).collect()
            };
            all.extend(units.iter().map(in_unit));
        }
    }
    for i in 0..model.inputs.len() {
        all.extend(PARTS.map(|(scale, _)| vec![Reading::of(Signal::Input(i), scale, 0.0)]));
    }
    for j in 0..coordinates.len() {
        all.extend((0..j).map(|i| exchanged(Signal::Coordinate, i, j)));
    }
    for j in 0..model.inputs.len() {
        all.extend((0..j).map(|i| exchanged(Signal::Input, i, j)));
    }
    all.extend((0..coordinates.len()).filter_map(|c| turned_round(model, c)));
    all
}

/// A coordinate with all inputs on it, where there are some, the other way round: as a whole joint may be mounted.
fn turned_round(model: &Model, c: usize) -> Option<Change> {
    let other = |signal| Reading::of(signal, -1.0, 0.0);
    let on_it = |i: &usize| model.inputs[*i].coordinate() == Some(c);
    let inputs = (0..model.inputs.len()).filter(on_it);
    let inputs: Change = inputs.map(|i| other(Signal::Input(i))).collect();
    let all = |inputs| [vec![other(Signal::Coordinate(c))], inputs].concat();
    (!inputs.is_empty()).then(|| all(inputs))
}

/// The readings with all signs turned round: what these leave as it is too, and nothing of what is then as it is.
pub fn mirrored(model: &Model, readings: &[Reading]) -> Vec<Reading> {
    let coordinates = (0..model.mechanics.coordinates().len()).map(Signal::Coordinate);
    let signals = coordinates.chain((0..model.inputs.len()).map(Signal::Input));
    let read = |signal| {
        let known = readings.iter().find(|r| r.signal == signal).copied();
        let reading = known.unwrap_or(Reading::of(signal, 1.0, 0.0));
        Reading {
            scale: -reading.scale,
            offset: -reading.offset,
            ..reading
        }
    };
    signals.map(read).filter(Reading::is_other).collect()
}

/// The signals of a log, read by these readings where they are of them: positions, velocities and inputs.
pub fn read(readings: &[Reading], run: &Run) -> Run {
    let mut read = run.clone();
    for reading in readings {
        match reading.signal {
            Signal::Time => read.t = reading.reads(&run.t),
            Signal::Coordinate(c) => {
                read.q[c] = reading.reads(&run.q[reading.from]);
                let rates = Reading {
                    offset: 0.0,
                    ..*reading
                };
                read.v[c] = run.v[reading.from].as_deref().map(|v| rates.reads(v));
            }
            Signal::Input(i) => {
                read.u[i] = reading.reads(&run.u[reading.from]);
                read.read_input_later(i, reading.rows_late);
            }
        }
    }
    read
}

/// A log, read by these readings.
pub fn read_log(readings: &[Reading], log: &Log) -> Log {
    Log {
        runs: log.runs.iter().map(|run| read(readings, run)).collect(),
        ..log.clone()
    }
}

/// Where the signals stand that a reading reads, for a log whose own stand where `columns` says: a coordinate, and its velocity where the log has that.
pub fn mappings(
    reading: &Reading,
    model: &Model,
    (log, columns): (&Log, &ColumnMap),
) -> Vec<Mapping> {
    let coordinates = model.mechanics.coordinates();
    match reading.signal {
        Signal::Time => vec![reading.mapping(|_| TIME.to_owned(), columns)],
        Signal::Coordinate(_) => {
            let (q, v) = (q_names(coordinates), v_names(coordinates));
            let rates = Reading {
                offset: 0.0,
                ..*reading
            };
            let has_rates = log.runs.iter().all(|run| run.v[reading.from].is_some());
            let of_rates = || rates.mapping(|k| v[k].clone(), columns);
            let of_position = reading.mapping(|k| q[k].clone(), columns);
            std::iter::once(of_position)
                .chain(has_rates.then(of_rates))
                .collect()
        }
        Signal::Input(_) => {
            let name = |k: usize| format!("u.{}", model.inputs[k].name);
            vec![reading.mapping(name, columns)]
        }
    }
}

/// The signal of a reading as a log calls it.
pub fn name(reading: &Reading, model: &Model) -> String {
    match reading.signal {
        Signal::Time => TIME.to_owned(),
        Signal::Coordinate(c) => q_names(model.mechanics.coordinates())[c].clone(),
        Signal::Input(i) => format!("u.{}", model.inputs[i].name),
    }
}

/// Such as “`q.pole` is in degrees and counts the other way round”.
pub fn words(reading: &Reading, model: &Model) -> String {
    let mut said: Vec<String> = Vec::new();
    if reading.from != reading.signal.place() {
        let other = match reading.signal {
            Signal::Time => Signal::Time,
            Signal::Coordinate(_) => Signal::Coordinate(reading.from),
            Signal::Input(_) => Signal::Input(reading.from),
        };
        let other = name(&Reading::of(other, 1.0, 0.0), model);
        said.push(format!("stands in the place of {}", quoted(&other)));
    }
    let size = reading.scale.abs();
    match reading.signal {
        Signal::Time => said.push(match reading.scale {
            MILLISECOND => "is in ms".to_owned(),
            MICROSECOND => "is in µs".to_owned(),
            scale => format!("counts {scale} s as one, as the velocities say too"),
        }),
        Signal::Coordinate(_) => {
            let unit = UNITS.iter().find(|(unit, _)| *unit == size);
            said.extend(unit.map(|(_, plural)| format!("is in {plural}")));
        }
        Signal::Input(_) => {
            let part = PARTS.iter().find(|(scale, _)| *scale == size);
            said.extend(part.map(|(_, parts)| format!("is in {parts} of what the model takes")));
            match reading.rows_late {
                0 => {}
                1 => said.push(
                    "is written one row late, what was put out from a row on in the next"
                        .to_owned(),
                ),
                rows => said.push(format!("is written {rows} rows late")),
            }
        }
    }
    if reading.scale < 0.0 {
        said.push("counts the other way round".to_owned());
    }
    if reading.offset != 0.0 {
        let part = match reading.offset.abs() == PI {
            true => "half",
            false => "a quarter of",
        };
        said.push(format!("begins {part} a turn away"));
    }
    format!("{} {}", quoted(&name(reading, model)), said.join(" and "))
}
