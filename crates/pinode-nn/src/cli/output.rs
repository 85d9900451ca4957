//! Where results and messages go.

use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use lagrange::Problems;
use lagrange::mechanism::PoseForm;
use serde::Serialize;

use crate::Error;
use crate::learnt::{Departure, Saw};
use crate::log::Log;
use crate::model::Model;
use crate::poses::by_angles;
use crate::report::words::{percent, short, with_unit};

/// The streams of a program.
#[derive(Debug, Clone, Copy)]
pub struct Output {
    /// One JSON document on stdout; people's text on stderr.
    pub json: bool,
    /// No text for people but errors.
    pub quiet: bool,
}

impl Output {
    /// A result: `document` as JSON with `--json`, else `text`.
    ///
    /// # Errors
    /// [`Error::Io`] when stdout cannot be written to.
    pub fn result(&self, document: &impl Serialize, text: &str) -> Result<(), Error> {
        if self.json {
            self.document(document)
        } else if self.quiet {
            Ok(())
        } else {
            to_stdout(text.as_bytes())
        }
    }

    /// A JSON document on stdout.
    ///
    /// # Errors
    /// [`Error::Io`] when stdout cannot be written to.
    pub fn document(&self, document: &impl Serialize) -> Result<(), Error> {
        let mut bytes = serde_json::to_vec_pretty(document)
            .map_err(|e| Error::io(Path::new("stdout"), e.into()))?;
        bytes.push(b'\n');
        to_stdout(&bytes)
    }

    /// Text for people: on stdout, or on stderr where stdout is for the document.
    ///
    /// # Errors
    /// [`Error::Io`] when stdout cannot be written to.
    pub fn say(&self, text: &str) -> Result<(), Error> {
        if self.json {
            self.note(text.trim_end_matches('\n'));
            Ok(())
        } else if self.quiet {
            Ok(())
        } else {
            to_stdout(text.as_bytes())
        }
    }

    /// A message on stderr.
    pub fn note(&self, text: &str) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr(), "{text}"); // nobody is left to tell when stderr is gone
        }
    }

    /// Warnings on stderr.
    pub fn warnings(&self, warnings: &[String]) {
        for warning in warnings {
            self.note(&format!("warning: {warning}"));
        }
    }

    /// Warns of networks that left what they were trained on.
    pub fn departures(&self, departures: &[Departure]) {
        for departure in departures {
            self.note(&format!("warning: {}", left_training(departure)));
        }
    }

    /// An error on stderr.
    pub fn error(&self, error: &Error) {
        match error {
            Error::Problems(problems) => self.problems(problems),
            other => self.failure(other),
        }
    }

    /// An error on stderr, all faults of a text.
    pub fn problems(&self, problems: &Problems) {
        let n = problems.list.len();
        let noun = if n == 1 { "problem" } else { "problems" };
        self.failure(&format_args!(
            "{n} {noun} in {}\n{problems}",
            problems.source
        ));
    }

    /// An error on stderr, in words.
    pub fn failure(&self, error: &dyn Display) {
        let _ = writeln!(std::io::stderr(), "error: {error}"); // nobody is left to tell when stderr is gone
    }

    /// Loads a model and tells its warnings.
    ///
    /// # Errors
    /// Those of [`Model::load`].
    pub fn load_model(&self, path: &Path) -> Result<Model, Error> {
        let model = Model::load(path)?;
        for warnings in &model.warnings {
            for line in warnings.to_string().lines() {
                self.note(&format!("warning: {line}"));
            }
        }
        Ok(model)
    }

    /// Reads a log and tells its warnings.
    ///
    /// # Errors
    /// Those of [`Log::read`].
    pub fn read_log(&self, path: &Path, model: &Model) -> Result<Log, Error> {
        Ok(self.told(Log::read(path, model)?))
    }

    /// A log, whose warnings are told.
    pub fn told(&self, log: Log) -> Log {
        self.warn(&log, 0);
        log
    }

    /// Reads logs to fit and logs to hold out, and tells their warnings. Poses are written by angles, in the model too.
    ///
    /// # Errors
    /// Those of [`Log::read`] and [`by_angles`].
    pub(super) fn read_logs(
        &self,
        (logs, held_out): (&[PathBuf], &[PathBuf]),
        model: Model,
    ) -> Result<(Model, Vec<Log>, Vec<Log>), Error> {
        let paths = logs.iter().chain(held_out);
        let read = paths.map(|path| self.read_log(path, &model));
        let mut seen = read.collect::<Result<Vec<_>, _>>()?;
        let mut model = model;
        if model.has_poses() {
            let known: Vec<usize> = seen.iter().map(|log| log.warnings.len()).collect();
            (model, seen) = by_angles(&model, &seen)?;
            if let PoseForm::Angles(angles) = model.pose {
                self.note(&format!(
                    "the pose of what floats is written by angles, roll about the {} axis of the body",
                    angles.roll_axis.name()
                ));
            }
            for (log, known) in seen.iter().zip(known) {
                self.warn(log, known);
            }
        }
        let held_out = seen.split_off(logs.len());
        Ok((model, seen, held_out))
    }

    /// The warnings of a log from the `first` on.
    fn warn(&self, log: &Log, first: usize) {
        for warning in log.warnings.iter().skip(first) {
            let separator = if warning.position.is_some() {
                ":"
            } else {
                ": "
            };
            let path = log.path.display();
            self.note(&format!("warning: {path}{separator}{warning}"));
        }
    }
}

/// Where and how far a network left what it was trained on.
fn left_training(departure: &Departure) -> String {
    let joints: Vec<String> = departure
        .joints
        .iter()
        .map(|joint| format!("`{joint}`"))
        .collect();
    let value = |saw: &Saw| {
        let value = with_unit(short(saw.value), &saw.unit);
        format!("{} = {value}", saw.name)
    };
    let what = match (departure.distance, departure.saw.first()) {
        (None, Some(saw)) => {
            let [low, high] = saw.trained.map(short);
            let range = with_unit(format!("{low} … {high}"), &saw.unit);
            format!("{}, trained within {range}", value(saw))
        }
        (distance, _) => {
            let all: Vec<String> = departure.saw.iter().map(value).collect();
            format!(
                "{}, each within its range, but together unlike the training: {} of a range from the nearest of its states that are kept, \
                 where all of them were within {}",
                all.join(", "),
                percent(distance.unwrap_or(f64::NAN)),
                percent(departure.reach.unwrap_or(f64::NAN)),
            )
        }
    };
    format!(
        "the network on {} left what it was trained on at t = {} s of run `{}`: {what}; {} of the samples are outside",
        joints.join(" and "),
        short(departure.t),
        departure.run,
        percent(departure.samples_outside as f64 / departure.samples.max(1) as f64)
    )
}

/// Whoever closed the pipe has read enough: no error.
fn to_stdout(bytes: &[u8]) -> Result<(), Error> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Error::io(Path::new("stdout"), e)),
        _ => Ok(()),
    }
}
