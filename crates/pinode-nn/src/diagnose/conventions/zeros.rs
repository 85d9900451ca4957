//! Recordings in which a sensor counts from different zeros: an incremental encoder is at 0 wherever it was switched on.
//!
//! Some windows of each recording are fitted with a zero of each sensor, y = q + b. Where the b of two recordings are many standard errors apart, which hold for whatever
//! else the model lacks as long as it lacks it in both, the sensor counts from another zero, unless a force that differs explains the windows better: a table that
//! was tilted moves the equilibrium as well. The recording whose zero is nearest to the model's stays as it is, and what it has in common with the others is no matter of
//! theirs: a `sensor_offset`, for the search to find.

use rayon::prelude::*;

use super::reading::{Reading, Signal, name, read};
use super::told::For;
use super::windows::Windows;
use super::{CONVENTION, DataFault};
use crate::diagnose::recording;
use crate::digits::uncertain;
use crate::log::{Log, Run};
use crate::model::Model;

/// So many windows of a recording are looked at: what they said of the zeros of a pendulum and of a cart-pole was exact to a quarter of the noise.
const WINDOWS: usize = 48;
/// Zeros that are so many standard errors apart are two.
const APART: f64 = 5.0;
/// A force explains windows better that leaves less than this part of what zeros leave.
const BETTER: f64 = 0.9;

/// Recordings in which sensors count from other zeros than in the one that is nearest to the model.
pub struct Zeros<'a> {
    model: &'a Model,
    recordings: Vec<Recording<'a>>,
    what_for: For,
}

/// One of them.
struct Recording<'a> {
    log: &'a Log,
    run: &'a Run,
    is_held_out: bool,
    windows: Option<Windows>,
    /// b of each coordinate and its standard error, which is infinite where it moves too little to tell.
    zeros: Vec<(f64, f64)>,
    /// How it is read for its sensors to count from the zeros of the nearest one.
    readings: Vec<Reading>,
}

impl<'a> Zeros<'a> {
    /// Of logs that are read for this, and others that no fit may see.
    pub fn of(model: &'a Model, logs: &'a [Log], held_out: &'a [Log], what_for: For) -> Self {
        let all = logs.iter().map(|log| (log, false));
        let all = all.chain(held_out.iter().map(|log| (log, true)));
        let runs = all
            .flat_map(|(log, is_held_out)| log.runs.iter().map(move |run| (log, run, is_held_out)));
        let runs: Vec<_> = runs.collect();
        let is_one = runs.len() < 2;
        let recordings = runs.into_par_iter().map(|(log, run, is_held_out)| {
            let alone = || Log {
                runs: vec![run.clone()],
                ..log.clone()
            };
            let windows = (!is_one).then(|| Windows::at_most(WINDOWS, model, &[alone()]));
            let windows = windows.flatten();
            Recording {
                zeros: windows.as_ref().map_or(Vec::new(), Windows::zeros),
                windows,
                log,
                run,
                is_held_out,
                readings: Vec::new(),
            }
        });
        let mut zeros = Zeros {
            model,
            recordings: recordings.collect(),
            what_for,
        };
        zeros.compare();
        zeros
    }

    /// Compares all with the nearest.
    fn compare(&mut self) {
        let coordinates = 0..self.model.mechanics.coordinates().len();
        let nearest: Vec<_> = coordinates.map(|c| self.nearest(c)).collect();
        self.recordings.par_iter_mut().for_each(|recording| {
            let apart = |c: usize| {
                let (own, its) = (*recording.zeros.get(c)?, *nearest[c].as_ref()?);
                let by = own.0 - its.0;
                let is_apart = by.abs() > APART * own.1.hypot(its.1);
                is_apart.then(|| Reading::of(Signal::Coordinate(c), 1.0, -by))
            };
            let readings: Vec<Reading> = (0..nearest.len()).filter_map(apart).collect();
            let is_zeros = !readings.is_empty()
                && recording.windows.as_ref().is_some_and(|windows| {
                    let [by_zeros, by_forces] = windows.by_zeros_or_forces();
                    by_forces > by_zeros + BETTER.ln()
                });
            if is_zeros {
                recording.readings = readings;
            }
        });
    }

    /// The zero of a coordinate, and its standard error, that is nearest to the model's, of those that fits see.
    fn nearest(&self, c: usize) -> Option<(f64, f64)> {
        let of_seen = self.recordings.iter().filter(|r| !r.is_held_out);
        let told = of_seen.filter_map(|r| r.zeros.get(c).filter(|(_, error)| error.is_finite()));
        told.min_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).copied()
    }

    /// The logs, and those held out, with one zero for all recordings; none where they have one as they are.
    pub fn read(&self) -> Option<[Vec<Log>; 2]> {
        let is_other = |r: &Recording| !r.readings.is_empty();
        self.recordings.iter().any(is_other).then(|| {
            let mut logs: [Vec<Log>; 2] = Default::default();
            for (k, recording) in self.recordings.iter().enumerate() {
                let logs = &mut logs[usize::from(recording.is_held_out)];
                let is_first = k
                    .checked_sub(1)
                    .is_none_or(|before| !std::ptr::eq(self.recordings[before].log, recording.log));
                if is_first {
                    logs.push(Log {
                        runs: Vec::new(),
                        ..recording.log.clone()
                    });
                }
                if let Some(log) = logs.last_mut() {
                    log.runs.push(read(&recording.readings, recording.run));
                }
            }
            logs
        })
    }

    /// What is said of them, one a signal.
    pub fn faults(&self) -> Vec<DataFault> {
        let coordinates = self.model.mechanics.coordinates().iter().enumerate();
        let of_coordinate = |(c, coordinate): (usize, &lagrange::Coordinate)| {
            let nearest = self.nearest(c)?;
            let other = |recording: &Recording| {
                let reading = recording.readings.iter();
                let reading = reading
                    .copied()
                    .find(|r| r.signal == Signal::Coordinate(c))?;
                let error = recording.zeros.get(c)?.1.hypot(nearest.1);
                let held_out = if recording.is_held_out {
                    " (held out)"
                } else {
                    ""
                };
                let by = uncertain(-reading.offset, Some(error));
                let named = recording.named();
                Some((
                    reading,
                    format!("by {by} {} in {named}{held_out}", coordinate.unit()),
                ))
            };
            let others: Vec<(Reading, String)> = self.recordings.iter().filter_map(other).collect();
            let column = name(&others.first()?.0, self.model);
            let others: Vec<String> = others.into_iter().map(|(_, said)| said).collect();
            let is_it = |r: &&Recording| r.zeros.get(c) == Some(&nearest);
            let nearest = self.recordings.iter().find(is_it)?.named();
            let so = match self.what_for {
                For::ReadAsTheyAre => {
                    "it is read as it is here: give each log a model whose [log.columns] has its own `offset`"
                }
                _ => {
                    "these are taken off here; what the recordings have in common is left to the search, and a new recording has a zero of its own"
                }
            };
            Some(DataFault {
                kind: CONVENTION.into(),
                when: Vec::new(),
                detail: format!(
                    "`{column}` counts from another zero than in {nearest}, {}, as an encoder does that is at 0 wherever it is switched on: {so}",
                    others.join(", "),
                ),
                column,
            })
        };
        coordinates.filter_map(of_coordinate).collect()
    }
}

impl Recording<'_> {
    fn named(&self) -> String {
        recording(self.log, self.run)
    }
}
