//! The proof: the new model is written, read back, and run free over data that no fit has seen. What does not shrink the gap there is not added.

use std::path::{Path, PathBuf};

use super::audit::Masked;
use super::curves::FreeRun;
use super::gap;
use super::search::Search;
use super::setup::Prepared;
use super::study::{Fitted, Study};
use super::verdict::{Gap, Provenance};
use super::{HORIZON_S, LEAD_S, horizons, write_up};
use crate::Error;
use crate::hybrid::Hybrid;
use crate::model::{Model, NewNetwork};

/// The given constants are taken back where those of a fit make the errors so many times as large.
const WORSE: f64 = 1.5;

/// What a new model is proved by.
pub struct Proof<'a> {
    /// The model as given.
    pub model: &'a Model,
    /// The same, fitted within its tolerances.
    pub given: Hybrid,
    /// The recordings, and the windows of the fits.
    pub prepared: &'a Prepared,
    /// What of them is faulty.
    pub masked: &'a Masked,
    /// The folder of the new model, and its name there.
    pub file: (&'a Path, &'a str),
}

/// A new model on disk.
pub struct Proved {
    /// Its file.
    pub path: PathBuf,
    /// The model, read back from there.
    pub hybrid: Hybrid,
    /// How far the model as given and this one are from what was measured.
    pub gap: Gap,
    /// The runs that say so.
    pub free_runs: Vec<FreeRun>,
}

impl Proof<'_> {
    /// Both models run free over what no fit has seen, each from states that it is fitted to the moment before.
    pub fn runs(
        &self,
        study: &Study,
        (old, new): (&Hybrid, &Hybrid),
        usual_horizon: f64,
        shorter: bool,
    ) -> Vec<FreeRun> {
        let (old, new) = ((old, &old.theta()[..]), (new, &new.theta()[..]));
        let lead = study.pace.long(LEAD_S);
        let spans = (lead, study.pace.long(usual_horizon), shorter);
        gap::free_runs(study, old, new, spans, self.masked)
    }

    /// Writes the model with what was found, reads it back and runs it free: what is measured is what was written.
    pub fn write(
        &self,
        (study, search): (&Study, &Search),
        provenance: &Provenance,
        network: Option<NewNetwork>,
    ) -> Result<Proved, Error> {
        let (model, (out, name)) = (self.model, self.file);
        let mut revision = write_up::revision(model, (study, search), provenance);
        revision.network = network;
        let path = model.write_revision(out, name, &revision)?;
        let read_back = || -> Result<Hybrid, Error> {
            let written = Model::load(&path)?;
            Ok(Hybrid::at_pace(
                &written,
                study.pace.times(),
                study.pace.speeds(),
            ))
        };
        let mut hybrid = read_back()?;
        if hybrid.is_stiff() != search.whole().hybrid.is_stiff() {
            // With what was found the default is another than that of the fit.
            write_up::say_smoothing(&mut revision, &search.whole().hybrid);
            model.write_revision(out, name, &revision)?;
            hybrid = read_back()?;
        }
        let free_runs = self.runs(study, (&self.given, &hybrid), HORIZON_S, true);
        Ok(Proved {
            gap: gap::gap(study, &self.given, &free_runs, study.pace.long(HORIZON_S)),
            path,
            hybrid,
            free_runs,
        })
    }

    /// The model with what of the search shrinks the gap: all of it; with stops less hard and friction less sharp, as in `coarse`, the last one first; or nothing, with the
    /// constants as they were where the fit's make it larger. With the study that it was fitted in.
    ///
    /// # Errors
    /// As [`Model::write_revision`] and [`Model::load`].
    pub fn shrinking(
        &self,
        mut study: Study,
        mut coarse: Vec<(Study, Fitted)>,
        search: &mut Search,
        provenance: &Provenance,
        report: &dyn Fn(&str),
    ) -> Result<(Study, Proved), Error> {
        let mut put_back = false;
        loop {
            let proved = self.write((&study, search), provenance, None)?;
            // Constants that make up for what was not found may do so in what the fit has seen alone.
            if search.found.is_empty() && !put_back && is_worse(&proved.gap) {
                report(
                    "what the fit moved makes unseen data worse: the constants stay as they were",
                );
                search.put_back();
                put_back = true;
                continue;
            }
            // No windows at all say nothing.
            if search.found.is_empty() || proved.free_runs.is_empty() || shrinks(&proved.gap) {
                return Ok((study, proved));
            }
            // Friction that is less sharp may, or a stop that is less hard.
            if let Some((plain, model)) = coarse.pop() {
                study = plain;
                search.refitted(&study, model);
                continue;
            }
            report("what was found does not shrink the gap on unseen data: it is not added");
            study = self.prepared.study.clone();
            search.withdraw(&study);
        }
    }

    /// How far the model as given and a fitted one are from what was measured.
    pub fn gap(&self, study: &Study, fitted: &Fitted) -> Gap {
        let model = fitted.as_fitted();
        let free_runs = self.runs(study, (&self.given, &model), HORIZON_S, true);
        gap::gap(study, &self.given, &free_runs, study.pace.long(HORIZON_S))
    }

    /// The gap over shorter and longer free runs too.
    pub fn add_horizons(&self, study: &Study, proved: &mut Proved) {
        let models = (&self.given, &proved.hybrid);
        let longer = self.runs(study, models, horizons::LONG_S, false);
        let coordinates = &proved.gap.coordinates;
        let all = [
            (&proved.free_runs, horizons::SHORT_S),
            (&proved.free_runs, HORIZON_S),
            (&longer, horizons::LONG_S),
        ];
        let found = all.into_iter().filter_map(|(runs, usual)| {
            horizons::horizon(runs, coordinates, study.pace.long(usual))
        });
        proved.gap.horizons = found.collect();
    }
}

/// Whether the errors are larger afterwards, beyond what another start of each run makes.
fn is_worse(gap: &Gap) -> bool {
    gap.windows > 0 && gap.after > WORSE * gap.before
}

/// Whether the errors are smaller afterwards. Windows without one in which both models stay finite count against what was found.
pub fn shrinks(gap: &Gap) -> bool {
    gap.windows > 0 && gap.after < gap.before
}
