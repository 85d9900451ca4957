//! Whether a log counts as the model does. A coordinate that counts the other way round, begins elsewhere, is in degrees or millimetres or stands under
//! another's name is no missing effect, and none explains it.
//!
//! Some short windows of the log are read in every such way, and the model as given is fitted to them a little. What it leaves of each coordinate,
//!
//! share = √(⟨(q − q̂)²⟩ − noise²) / √⟨(q − line)²⟩,
//!
//! in the median of the windows, compares it with the straight line through each: it has no unit, and needs to know nothing of the sensor. A model that lacks an
//! effect leaves a few hundredths; one that is told the wrong sign a good part of the motion.

mod late_rows;
mod needed;
mod reading;
mod signs;
#[cfg(test)]
mod tests;
mod unmoved;
mod windows;

use std::borrow::Cow;
use std::cell::LazyCell;

use rayon::prelude::*;

use self::reading::{Change, Reading, Signal, changes, mappings, mirrored, name, read, words};
pub use self::unmoved::refuse_unmoved;
use self::windows::{NONE, Windows};
use super::verdict::DataFault;
use crate::Error;
use crate::log::{ColumnMap, Log, Mapping};
use crate::model::Model;
use crate::model::log_columns::value;

/// What is left of the straight line's error is explained well enough.
const WELL: f64 = 0.15;
/// Another way to read a log has to leave so much less of all coordinates together, …
const LESS: f64 = 4.0;
/// … of none more than this factor, …
const NO_MORE: f64 = 1.3;
/// … and of what it reads otherwise no more than this.
const MOST_LEFT: f64 = 0.3;
/// An input in other units leaves no more than this of anything. One leaves 0.005; a limit or a dead zone, beside which a smaller input does better
/// too, 0.087 or more, and a gain of an eighth 0.022 as tenths.
const LEFT_BY_A_UNIT: f64 = 0.02;
/// The equations are against a way to read a log by which they leave so many times as much, squared, of all coordinates together.
const AGAINST: f64 = 1.1;
/// Two ways are as good within this factor.
const AS_GOOD: f64 = 1.5;
/// Two changes at once are tried where that is no more than so many fits.
const MOST_PAIRS: usize = 400;
/// … of which those are fitted, friction and delay with them, that explain most by initial states alone.
const MOST_FITTED: usize = 40;
/// Work that only warns of them tries no more than so many: two joints and a motor may have 40, seven of each have 140 or more.
const MOST_ASIDE: usize = 60;
/// The kind of these faults.
pub const CONVENTION: &str = "convention";
/// A model and its logs, read as they are meant.
pub struct AsMeant<'a> {
    /// The model, with `[log.columns]` that say so.
    pub model: Cow<'a, Model>,
    /// The logs.
    pub logs: Cow<'a, [Log]>,
    /// Those that no fit may see.
    pub held_out: Cow<'a, [Log]>,
    /// What they count otherwise, one a signal.
    pub faults: Vec<DataFault>,
    /// Whether rows were [left out](super::fresh_rows) of them: then what is some rows late is so by others.
    pub is_thinned: bool,
}

/// The logs as they are meant: as they are, unless the model explains them far better where they are read otherwise.
///
/// # Errors
/// Those of [`Model::with_columns`].
pub fn as_meant<'a>(
    model: &'a Model,
    logs: &'a [Log],
    held_out: &'a [Log],
    report: &dyn Fn(&str),
) -> Result<AsMeant<'a>, Error> {
    let found = meant(model, logs, report).into_reading();
    let own = || Some((logs.first()?, logs.first()?.columns(model)));
    let (mut faults, mut columns) = (Vec::new(), Vec::new());
    if let (Some(found), Some((log, own))) = (&found, own()) {
        faults = found.faults(model, (log, &own), Which::Seen);
        let of_reading = |reading: &Reading| mappings(reading, model, (log, &own));
        columns = found.readings.iter().flat_map(of_reading).collect();
    }
    // What is held out may have been recorded by others; where it does not tell, it counts as what is seen.
    let of_held_out = match meant(model, held_out, report) {
        Meant::Unclear => found.clone(),
        told => told.into_reading(),
    };
    if let (Some(other), Some(log)) = (&of_held_out, held_out.first())
        && found.as_ref().map(|found| &found.readings) != Some(&other.readings)
    {
        faults.extend(other.faults(model, (log, &log.columns(model)), Which::HeldOut));
    }
    Ok(AsMeant {
        is_thinned: false,
        faults,
        logs: again(found, logs),
        held_out: again(of_held_out, held_out),
        model: match columns.is_empty() {
            true => Cow::Borrowed(model),
            false => Cow::Owned(model.with_columns(&columns)?),
        },
    })
}

/// How logs count otherwise than the model, in words, for those who read them as they are. Of mechanisms with many signals, whose ways to count take minutes to
/// try, a diagnosis alone asks.
///
/// # Errors
/// [`Error::OtherModel`] when a log was read for another model.
pub fn counts_otherwise(model: &Model, logs: &[Log]) -> Result<Vec<String>, Error> {
    logs.iter().try_for_each(|log| log.check(model))?;
    if changes(model, logs).len() > MOST_ASIDE {
        return Ok(Vec::new());
    }
    let (Some(found), Some(log)) = (meant(model, logs, &|_| ()).into_reading(), logs.first())
    else {
        return Ok(Vec::new());
    };
    let faults = found.faults(model, (log, &log.columns(model)), Which::ReadAsTheyAre);
    Ok(faults.into_iter().map(|fault| fault.detail).collect())
}

/// How logs are to be read.
enum Meant {
    /// As they are: so the model explains them well.
    AsTheyAre,
    Otherwise(Otherwise),
    /// There is too little to look at, or the model explains them well in no way.
    Unclear,
}

impl Meant {
    /// How they are read otherwise; none where they are read as they are.
    fn into_reading(self) -> Option<Otherwise> {
        match self {
            Meant::Otherwise(found) => Some(found),
            Meant::AsTheyAre | Meant::Unclear => None,
        }
    }
}

/// The logs, read so.
fn again(found: Option<Otherwise>, logs: &[Log]) -> Cow<'_, [Log]> {
    match found {
        Some(found) => Cow::Owned(read_all(&found.readings, logs)),
        None => Cow::Borrowed(logs),
    }
}

fn read_all(readings: &[Reading], logs: &[Log]) -> Vec<Log> {
    let mut logs = logs.to_vec();
    for log in &mut logs {
        let runs = log.runs.iter().map(|run| read(readings, run));
        log.runs = runs.collect();
    }
    logs
}

/// Which logs.
#[derive(Clone, Copy, PartialEq)]
enum Which {
    Seen,
    HeldOut,
    /// Those of work that does not read them otherwise.
    ReadAsTheyAre,
}

/// Another way to read a log.
#[derive(Clone)]
struct Otherwise {
    readings: Vec<Reading>,
    /// The largest share that the model leaves of a coordinate with the log as it is, and so.
    shares: [f64; 2],
    /// What explains it as well.
    others: Vec<Vec<Reading>>,
}

impl Otherwise {
    fn faults(&self, model: &Model, log: (&Log, &ColumnMap), which: Which) -> Vec<DataFault> {
        let all = |readings: &[Reading]| {
            let said: Vec<String> = readings.iter().map(|r| words(r, model)).collect();
            said.join(", ")
        };
        let others: Vec<String> = self.others.iter().map(|other| all(other)).collect();
        let or = match others.is_empty() {
            true => String::new(),
            false => format!("; or else, as well: {}", others.join("; or ")),
        };
        let fault = |reading: &Reading| {
            let written = written(&mappings(reading, model, log));
            // The new model reads the logs that it was fitted to.
            let (whose, so) = match which {
                Which::Seen => ("", read_so(&written)),
                Which::HeldOut => (
                    "in what is held out ",
                    format!(
                        "it is read so here, and needs a model with [log.columns] of its own elsewhere: {written}"
                    ),
                ),
                Which::ReadAsTheyAre => (
                    "",
                    format!(
                        "it is read as it is here: if that is so, write {written} into [log.columns] of the model"
                    ),
                ),
            };
            let [before, after] = self.shares.map(|share| 100.0 * share);
            let as_it_is = match before.is_finite() {
                true => format!("and {before:.0} % as it is"),
                false => "and diverges from it as it is".into(),
            };
            DataFault {
                kind: CONVENTION.into(),
                column: name(reading, model),
                when: Vec::new(),
                detail: format!(
                    "{whose}{}: read as it is meant, the model leaves {after:.1} % of the motion in short windows at most, {as_it_is}{or}; {so}",
                    words(reading, model),
                ),
            }
        };
        self.readings.iter().map(fault).collect()
    }
}

/// What a model file says of where signals stand.
fn written(mappings: &[Mapping]) -> String {
    let written = mappings.iter();
    let written = written.map(|m| format!("`\"{}\" = {}`", m.signal, value(m)));
    let written: Vec<String> = written.collect();
    written.join(" and ")
}

/// That a log is read as its new model says.
fn read_so(written: &str) -> String {
    format!("it is read so here, by [log.columns] of the new model: {written}")
}

/// How the logs are to be read: otherwise where the model explains them far better so.
fn meant(model: &Model, logs: &[Log], report: &dyn Fn(&str)) -> Meant {
    let Some(windows) = Windows::of(model, logs) else {
        return Meant::Unclear;
    };
    let given = windows.shares(&[]);
    if windows.worst(&given) < WELL {
        return Meant::AsTheyAre;
    }
    report("asking whether the log counts as the model does");
    let mut singles = changes(model, logs);
    // What does not move says nothing of where it should stand, and leaves nothing wherever it is read.
    singles.retain(|change| {
        let moves = |r: &Reading| match r.signal {
            Signal::Coordinate(c) => r.from == c || (windows.moves(c) && windows.moves(r.from)),
            Signal::Time | Signal::Input(_) => true,
        };
        change.iter().all(moves)
    });
    // A model that falls over at once without the friction that it lacks runs away from a log that is read as it should be: the equations, moment by moment, do not.
    let left_as_it_is = LazyCell::new(|| signs::left_over(&windows, model, &[]));
    let are_for = |readings: &[Reading]| {
        let left = left_as_it_is.zip(signs::left_over(&windows, model, readings));
        left.is_none_or(|(as_it_is, so)| so < as_it_is + AGAINST.ln())
    };
    let (mut readings, mut left): (Vec<Reading>, Vec<f64>) = (Vec::new(), given.clone());
    let mut others = Vec::new();
    while windows.worst(&left) > WELL {
        let with = |change: &Change| -> Vec<Reading> { [&readings[..], change].concat() };
        let mut ways: Vec<Vec<Reading>> = singles.iter().map(with).collect();
        if readings.is_empty() {
            ways.extend(signs::likely(&windows, model));
        }
        let mut tried = tried_ways(&windows, ways);
        let helps = |tried: &[Tried]| tried.iter().any(|t| explains_more(&windows, &left, t));
        let pairs = singles.len() * singles.len() / 2;
        if readings.is_empty() && !helps(&tried) && pairs <= MOST_PAIRS {
            let pair = |(k, first): (usize, &Change)| {
                let rest = singles[..k].iter();
                let pair: Vec<Change> = rest.map(|second| [&first[..], second].concat()).collect();
                pair
            };
            let pairs = singles.iter().enumerate().flat_map(pair).collect();
            tried = tried_ways(&windows, pairs);
        }
        tried.retain(|t| explains_more(&windows, &left, t) && are_for(&t.readings));
        let score = |t: &Tried| windows.score(&t.left);
        let least = tried.iter().map(score).fold(f64::INFINITY, f64::min);
        tried.retain(|t| score(t) < least + AS_GOOD.ln());
        tried.sort_by_key(|t| t.readings.len());
        let Some(best) = tried.first().cloned() else {
            break;
        };
        others = tried.drain(1..).map(|t| t.readings).collect();
        (readings, left) = (best.readings, best.left);
    }
    // What is worse than straight lines explains nothing, however much worse another way is.
    if readings.is_empty() || windows.worst(&left) > 1.0 {
        return Meant::Unclear;
    }
    // In a mirror all signs are others, and many a mechanism moves as before.
    let in_mirror = mirrored(model, &readings);
    if readings.iter().any(|r| r.scale < 0.0)
        && !others.contains(&in_mirror)
        && windows.score(&windows.shares(&in_mirror)) < windows.score(&left) + AS_GOOD.ln()
    {
        others.push(in_mirror);
    }
    Meant::Otherwise(Otherwise {
        shares: [windows.worst(&given), windows.worst(&left)],
        readings,
        others,
    })
}

/// What the model leaves where the log is read in these ways, each signal in one only; of many ways, in the [`likeliest`].
fn tried_ways(windows: &Windows, mut ways: Vec<Vec<Reading>>) -> Vec<Tried> {
    ways.iter_mut()
        .for_each(|way| way.sort_by_key(|r| r.signal));
    let mut known: Vec<Vec<Reading>> = Vec::new();
    for way in ways {
        if !known.contains(&way) {
            known.push(way);
        }
    }
    let once = |readings: &Vec<Reading>| {
        let mut rest = readings.iter().enumerate();
        rest.all(|(k, r)| readings[..k].iter().all(|other| other.signal != r.signal))
    };
    known.retain(once);
    let ways = likeliest(windows, known).into_par_iter();
    let ways = ways.map(|readings| Tried {
        left: windows.shares(&readings),
        readings,
    });
    ways.collect()
}

/// At most [`MOST_FITTED`] of these ways, those that explain most where the initial states alone are fitted.
fn likeliest(windows: &Windows, ways: Vec<Vec<Reading>>) -> Vec<Vec<Reading>> {
    if ways.len() <= MOST_FITTED {
        return ways;
    }
    let ranked = ways.into_par_iter().map(|way| {
        let left = windows.shares_by_states(&way);
        (windows.score(&left), way)
    });
    let mut ranked: Vec<(f64, Vec<Reading>)> = ranked.collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let likeliest = ranked.into_iter().take(MOST_FITTED);
    likeliest.map(|(_, way)| way).collect()
}

/// Whether the log read in another way is explained far better.
fn explains_more(windows: &Windows, before: &[f64], tried: &Tried) -> bool {
    let mut moving = (0..before.len()).filter(|&c| windows.moves(c));
    let read = |r: &Reading| match r.signal {
        Signal::Coordinate(c) => !windows.moves(c) || tried.left[c] < MOST_LEFT,
        Signal::Time => true,
        Signal::Input(_) => {
            let most = match r.is_unit_of_input() {
                true => LEFT_BY_A_UNIT,
                false => MOST_LEFT,
            };
            windows.worst(&tried.left) < most
        }
    };
    windows.score(&tried.left) < windows.score(before) - LESS.ln()
        && moving.all(|c| tried.left[c] <= NO_MORE * before[c] + NONE)
        && tried.readings.iter().all(read)
}

/// What is left where a log is read so.
#[derive(Clone)]
struct Tried {
    readings: Vec<Reading>,
    left: Vec<f64>,
}
