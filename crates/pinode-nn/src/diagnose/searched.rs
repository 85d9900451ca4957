//! The search, on logs that are read as they are meant.

use super::Means;
use super::audit::audit;
use super::cleaned::Cleaned;
use super::conventions::AsMeant;
use super::misfit;
use super::search::Search;
use crate::Error;

/// Logs that are ready to be searched.
pub struct Ready<'a> {
    /// The model and its logs.
    pub meant: AsMeant<'a>,
    /// The data without their faults, and the model as given, fitted to them.
    pub cleaned: Cleaned,
    /// Typical time between two samples of the logs, s.
    pub interval: f64,
}

/// What was found in them.
pub struct Searched<'a> {
    pub ready: Ready<'a>,
    pub search: Search,
}

impl<'a> Ready<'a> {
    /// Audits the logs and fits the model as given.
    ///
    /// # Errors
    /// Those of [`Cleaned::new`].
    pub fn new(meant: AsMeant<'a>, report: &dyn Fn(&str), means: &Means) -> Result<Self, Error> {
        let (model, logs) = (&*meant.model, &*meant.logs);
        let mut audited = audit(model, logs, &meant.held_out);
        audited.faults.splice(..0, meant.faults.iter().cloned());
        let fit_runs = logs.iter().map(|log| log.runs.len()).sum();
        let interval = audited.observations.typical_interval();
        report("fitting the model as given");
        Ok(Ready {
            cleaned: Cleaned::new(model, audited, fit_runs, report, means)?,
            interval,
            meant,
        })
    }

    /// Searches for what the model misses.
    pub fn searched(mut self, seed: u64, report: &dyn Fn(&str)) -> Searched<'a> {
        let search = self.cleaned.searched(&self.meant.model, seed, report);
        Searched {
            ready: self,
            search,
        }
    }
}

impl Searched<'_> {
    /// Whether what was found leaves something that follows from anything, or more than the noise.
    pub fn leaves_something(&self) -> bool {
        let Search { left, model, .. } = &self.search;
        left.is_some() || misfit::is_unexplained(&self.ready.cleaned.prepared.study, model)
    }
}
