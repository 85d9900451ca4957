//! The way in which some logs are read that a model explains far better than as they are, where there is one.

use std::cell::LazyCell;

use rayon::prelude::*;

use super::reading::{Change, Reading, Signal, changes, mirrored};
use super::signs;
use super::windows::{NONE, Windows};
use crate::log::Log;
use crate::model::Model;

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

/// How logs are to be read.
#[derive(Clone)]
pub enum Meant {
    /// As they are: so the model explains them well.
    AsTheyAre,
    Otherwise(Otherwise),
    /// There is too little to look at, or the model explains them well in no way.
    Unclear,
}

/// Another way to read a log.
#[derive(Clone)]
pub struct Otherwise {
    pub readings: Vec<Reading>,
    /// The largest share that the model leaves of a coordinate with the log as it is, and so.
    pub shares: [f64; 2],
    /// What explains it as well.
    pub others: Vec<Vec<Reading>>,
}

/// How the logs are to be read: otherwise where the model explains them far better so.
pub fn meant(model: &Model, logs: &[Log], report: &dyn Fn(&str)) -> Meant {
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
    // A model that falls over at once without the friction that it lacks runs away from a log that is read as it should be: the equations, moment by moment, do not. Of
    // the unit of time they say nothing: in a motion a thousand times too slow there is damping alone, which friction of either sign makes up for.
    let left_as_it_is = LazyCell::new(|| signs::left_over(&windows, model, &[]));
    let are_for = |readings: &[Reading]| {
        if readings.iter().any(|r| r.signal == Signal::Time) {
            return true;
        }
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
