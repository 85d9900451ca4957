//! What is said of logs that count otherwise than their model.

use super::meant::Otherwise;
use super::reading::{Reading, mappings, name, words};
use super::{CONVENTION, DataFault};
use crate::log::{Log, Mapping};
use crate::model::Model;
use crate::model::log_columns::value;
use crate::naming::quoted;

/// The logs that something is said of.
pub struct Whose<'a> {
    /// They themselves: some of `of`.
    pub logs: Vec<&'a Log>,
    /// How many there are beside each other, read for the same purpose.
    pub of: usize,
    pub what_for: For,
}

/// What logs are read for.
#[derive(Clone, Copy, PartialEq)]
pub enum For {
    /// A diagnosis.
    Fits,
    /// To show a gap.
    HeldOut,
    /// Work that reads them as they are.
    ReadAsTheyAre,
}

impl Whose<'_> {
    /// Such as “in `a.csv` ”; nothing where these are all of them.
    fn named(&self) -> String {
        let paths = self
            .logs
            .iter()
            .map(|log| format!("`{}`", log.path.display()));
        let names = paths.collect::<Vec<_>>().join(" and ");
        match (self.is_all(), self.what_for) {
            (true, For::HeldOut) => "in what is held out ".into(),
            (true, _) => String::new(),
            (false, For::HeldOut) => format!("in {names}, held out, "),
            (false, _) => format!("in {names} "),
        }
    }

    fn is_all(&self) -> bool {
        self.logs.len() == self.of
    }

    /// What becomes of signals that stand there as `written`.
    fn read(&self, written: &str) -> String {
        match (self.what_for, self.is_all()) {
            // The new model reads the logs that it was fitted to.
            (For::Fits, true) => read_so(written),
            (For::ReadAsTheyAre, all) => format!(
                "it is read as it is here: if that is so, write {written} into [log.columns] of {}",
                if all {
                    "the model"
                } else {
                    "a model for that log"
                },
            ),
            _ => format!(
                "it is read so here, and needs a model with [log.columns] of its own elsewhere: {written}"
            ),
        }
    }

    /// That they count as the given model does, where the others count in a `usual` way.
    pub fn count_as_the_model(&self, usual: &Otherwise, model: &Model) -> Vec<DataFault> {
        let fault = |reading: &Reading| {
            let column = name(reading, model);
            DataFault {
                kind: CONVENTION.into(),
                when: Vec::new(),
                detail: format!(
                    "{}{} counts as the model as given says, and not as in the other logs: it is read so here, and needs [log.columns] of that model elsewhere",
                    self.named(),
                    quoted(&column),
                ),
                column,
            }
        };
        usual.readings.iter().map(fault).collect()
    }
}

impl Otherwise {
    /// How these logs count.
    pub fn faults(&self, model: &Model, whose: &Whose) -> Vec<DataFault> {
        let Some(log) = whose.logs.first() else {
            return Vec::new();
        };
        let columns = log.columns(model);
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
            let so = whose.read(&written(&mappings(reading, model, (log, &columns))));
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
                    "{}{}: read as it is meant, the model leaves {after:.1} % of the motion in short windows at most, {as_it_is}{or}; {so}",
                    whose.named(),
                    words(reading, model),
                ),
            }
        };
        self.readings.iter().map(fault).collect()
    }
}

/// What a model file says of where signals stand.
pub fn written(mappings: &[Mapping]) -> String {
    let written = mappings.iter();
    let written = written.map(|m| format!("`\"{}\" = {}`", m.signal, value(m)));
    let written: Vec<String> = written.collect();
    written.join(" and ")
}

/// That a log is read as its new model says.
pub fn read_so(written: &str) -> String {
    format!("it is read so here, by [log.columns] of the new model: {written}")
}
