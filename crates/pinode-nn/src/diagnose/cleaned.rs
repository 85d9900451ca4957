//! The model as given, fitted to data of which what is faulty is left out.

use super::Means;
use super::audit::{self, Audited, Masked, second_look};
use super::curves::ResidualForce;
use super::locate;
use super::misfit;
use super::search::{self, Search};
use super::setup::{Prepared, prepare};
use super::study::Fitted;
use super::verdict::{DataFault, Disagreement};
use crate::Error;
use crate::model::Model;

/// So many times less noise is taken than readings seemed to have.
const QUIETER: usize = 2;

/// The null model on data without their faults.
pub struct Cleaned {
    pub prepared: Prepared,
    fit_runs: usize,
    pub faults: Vec<DataFault>,
    pub masked: Masked,
    pub disagreement: Vec<Disagreement>,
    pub residuals: Vec<ResidualForce>,
    /// All this before stretches were left out in which something seemed to push.
    before: Option<Box<Cleaned>>,
}

impl Cleaned {
    /// Fits the model as given, and once more where its residuals show a fault of the data.
    pub fn new(
        model: &Model,
        audited: Audited,
        fit_runs: usize,
        report: &dyn Fn(&str),
        means: &Means,
    ) -> Result<Self, Error> {
        let Audited {
            observations,
            faults,
            masked,
            ..
        } = audited;
        let prepared = prepare(model, observations, fit_runs, &masked, means)?;
        let mut cleaned = Cleaned {
            prepared,
            fit_runs,
            faults,
            masked,
            disagreement: Vec::new(),
            residuals: Vec::new(),
            before: None,
        };
        report("locating the disagreement");
        let null = cleaned.prepared.null.clone();
        if !cleaned.takes_less_noise(model, &null, report) {
            cleaned.locate_null(model);
        }
        let (null, residuals) = (cleaned.prepared.null.clone(), cleaned.residuals.clone());
        cleaned.look(model, &null, &residuals, report);
        Ok(cleaned)
    }

    fn locate_null(&mut self, model: &Model) {
        (self.disagreement, self.residuals) = self.locate(model, &self.prepared.null);
    }

    fn locate(&self, model: &Model, fitted: &Fitted) -> (Vec<Disagreement>, Vec<ResidualForce>) {
        let names: Vec<String> = model.inputs.iter().map(|i| i.name.clone()).collect();
        let Prepared {
            study, smoothed, ..
        } = &self.prepared;
        let half_width = study.pace.half_width();
        locate::locate(study, fitted, smoothed, half_width, &names, &self.masked)
    }

    /// The search, and again where what it finds shows the data in another light.
    pub fn searched(&mut self, model: &Model, seed: u64, report: &dyn Fn(&str)) -> Search {
        let mut search = self.search(seed, report);
        // What looked like a push beside a wrong model may be none beside the found one.
        if !search.found.is_empty() && self.takes_back(&search) {
            report("fitting what seemed to be pushed too: what was found explains it");
            search = self.search(seed, report);
        }
        // What a wrong model hides among its own errors may show beside the found one.
        if misfit::is_unexplained(&self.prepared.study, &search.model)
            && self.look_again(model, &search, report)
        {
            search = self.search(seed, report);
        }
        // What a right model leaves is the noise, however much the readings seemed to scatter.
        for _ in 0..QUIETER {
            if !self.takes_less_noise(model, &search.model, report) {
                break;
            }
            search = self.search(seed, report);
        }
        search
    }

    fn search(&self, seed: u64, report: &dyn Fn(&str)) -> Search {
        let Prepared { study, null, .. } = &self.prepared;
        let mut search = search::search(study, null.clone(), seed, report);
        search.normalise();
        search
    }

    /// Goes back to before stretches were left out in which something seemed to push, where what was found explains them. Whether it did.
    fn takes_back(&mut self, search: &Search) -> bool {
        let Some(before) = self.before.take() else {
            return false;
        };
        let explained = audit::is_explained(&before.prepared.study, &search.model, &self.masked);
        if explained {
            *self = *before;
        }
        explained
    }

    /// Takes what a fitted model leaves for the noise of sensors that seemed to scatter far more, and fits the model as given anew. Whether it did.
    fn takes_less_noise(&mut self, model: &Model, fitted: &Fitted, report: &dyn Fn(&str)) -> bool {
        let Some(overstated) = audit::overstated(model, &self.prepared.study, fitted) else {
            return false;
        };
        report("fitting the model as given beside less noise than the readings seemed to have");
        let means = self.means();
        let observations = overstated.observations.clone();
        let prepared = prepare(model, observations, self.fit_runs, &self.masked, &means);
        let quieter = prepared.is_ok();
        if let Ok(prepared) = prepared {
            self.prepared = prepared;
            overstated.correct(&mut self.faults);
            self.locate_null(model);
        }
        quieter
    }

    fn means(&self) -> Means {
        Means {
            without: self.prepared.study.without.clone(),
            kept: self.prepared.study.kept.clone(),
        }
    }

    /// Looks at the residuals of what was found. Whether a fault of the data was seen.
    fn look_again(&mut self, model: &Model, search: &Search, report: &dyn Fn(&str)) -> bool {
        let (_, residuals) = self.locate(model, &search.model);
        self.look(model, &search.model, &residuals, report)
    }

    /// Masks what the residuals of a fitted model show to be faulty and fits the model as given anew. Whether there was such a fault.
    fn look(
        &mut self,
        model: &Model,
        fitted: &Fitted,
        residuals: &[ResidualForce],
        report: &dyn Fn(&str),
    ) -> bool {
        let Some(look) = second_look(&self.prepared.study, fitted, residuals, &self.masked) else {
            return false;
        };
        report("fitting the model as given without what is faulty in the data");
        let mut faults = look.faults;
        let means = self.means();
        let again = prepare(
            model,
            look.observations,
            self.fit_runs,
            &look.masked,
            &means,
        );
        let cleaned = again.is_ok();
        match again {
            Ok(prepared) => {
                let pushed = faults.iter().any(|f| f.kind == audit::UNLOGGED_FORCE);
                let before = Cleaned {
                    prepared: std::mem::replace(&mut self.prepared, prepared),
                    masked: std::mem::replace(&mut self.masked, look.masked),
                    faults: self.faults.clone(),
                    disagreement: self.disagreement.clone(),
                    residuals: self.residuals.clone(),
                    fit_runs: self.fit_runs,
                    before: None,
                };
                self.before = pushed.then(|| Box::new(before));
                self.locate_null(model);
            }
            // Too little is left without it.
            Err(e) => {
                for fault in &mut faults {
                    fault.detail += &format!("; yet it stays in all fits, since without it {e}");
                }
            }
        }
        self.faults.extend(faults);
        cleaned
    }
}
