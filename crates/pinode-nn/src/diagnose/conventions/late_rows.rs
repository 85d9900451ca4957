//! Inputs that stand further down in a log than the model takes them to.

use std::borrow::Cow;

use super::reading::{Reading, Signal, mappings, name, read_log, words};
use super::told::{read_so, written};
use super::{AsMeant, CONVENTION, DataFault};
use crate::Error;
use crate::log::Log;

impl AsMeant<'_> {
    /// The logs, and those held out, with every input read from so many rows further down.
    pub fn logs_with_inputs_later(&self, rows: usize) -> [Vec<Log>; 2] {
        let readings = self.late(rows);
        [&self.logs, &self.held_out]
            .map(|logs| logs.iter().map(|log| read_log(&readings, log)).collect())
    }

    /// The same, its model too, with every input read from so many rows further down.
    ///
    /// # Errors
    /// Those of [`Model::with_columns`](crate::model::Model::with_columns).
    pub fn with_inputs_later(&self, rows: usize) -> Result<AsMeant<'static>, Error> {
        let readings = self.late(rows);
        let columns = self.logs.first().map(|log| {
            let own = log.columns(&self.model);
            let of = |reading| mappings(reading, &self.model, (log, &own));
            readings.iter().flat_map(of).collect()
        });
        let columns: Vec<_> = columns.unwrap_or_default();
        let [logs, held_out] = self.logs_with_inputs_later(rows).map(Cow::Owned);
        Ok(AsMeant {
            is_thinned: self.is_thinned,
            logs,
            held_out,
            model: Cow::Owned(self.model.with_columns(&columns)?),
            faults: self.faults.clone(),
        })
    }

    /// That the inputs, which are read so here, stood so many rows further down: `excess` is how many noises of the sensors a model leaves as they stood, and
    /// so.
    pub fn inputs_stood_late(&self, rows: usize, excess: [f64; 2]) -> Vec<DataFault> {
        let [before, after] = excess;
        let columns = &self.model.columns;
        let fault = |reading: &Reading| {
            let column = name(reading, &self.model);
            let so = read_so(&written(&[columns.of(&column)]));
            DataFault {
                kind: CONVENTION.into(),
                when: Vec::new(),
                detail: format!(
                    "{}: read as it is meant, the same model leaves {after:.1} times the noise at most, and {before:.1} times as it is; {so}",
                    words(reading, &self.model),
                ),
                column,
            }
        };
        self.late(rows).iter().map(fault).collect()
    }

    fn late(&self, rows_late: usize) -> Vec<Reading> {
        let late = |i| Reading {
            rows_late,
            ..Reading::of(Signal::Input(i), 1.0, 0.0)
        };
        (0..self.model.inputs.len()).map(late).collect()
    }
}
