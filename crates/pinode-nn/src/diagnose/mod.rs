//! The missing-physics workflow: find where model and measured data disagree, name what is missing, add it, show the gap shrink.
//!
//! 1. Audit: noise of the sensors, outliers and gaps, from the log alone.
//! 2. The model as given is fitted within its tolerances: that is the null model.
//! 3. Locate: the force it lacks, by coordinate and signal. This explains; it does not decide.
//! 4. Search: every candidate is screened from one linearisation; the best are refined by a fit; one is accepted
//!    when it explains the windows better, pair by pair, both on those the fit saw and on those held out.
//! 5. The new model is written, read back, and run free over held-out data. What does not shrink the gap there is not added.

mod advise;
pub(crate) mod audit;
mod candidate;
mod confidence;
pub mod curves;
mod found;
mod gap;
mod locate;
mod numerics;
mod score;
mod screen;
mod search;
mod setup;
pub(crate) mod smooth;
mod study;
pub mod verdict;
mod write_up;

use std::path::{Path, PathBuf};

use self::curves::Curves;
use self::setup::prepare;
use self::verdict::{Diagnosis, LogProvenance, Numerics, Provenance, Verdict};
use crate::Error;
use crate::effect::Kind;
use crate::entries::refuse_poses;
use crate::hybrid::Hybrid;
use crate::log::Log;
use crate::model::Model;

pub use setup::{FEWEST_WINDOWS, WINDOW_S};

/// Length of the free runs by which the gap is measured, s.
pub const HORIZON_S: f64 = 0.6;
/// Length of the stretch before a free run that its initial state is fitted to, s.
pub const LEAD_S: f64 = 0.3;

/// What this is called in errors.
pub(crate) const WORK: &str = "a diagnosis";

/// What a diagnosis produced.
#[derive(Clone)]
pub struct Outcome {
    /// The document.
    pub diagnosis: Diagnosis,
    /// What the report draws.
    pub curves: Curves,
    /// The new model.
    pub model: PathBuf,
}

/// Diagnoses `model` on `logs`; `held_out` are further logs that no fit may see (none: the last quarter of the data). Writes the new
/// model to `out/model.toml`. `report` is told what is being done.
///
/// The same seed gives the same result, bit for bit, for any number of threads.
///
/// # Errors
/// [`Error::Floating`] when a coordinate is the pose of a floating body; [`Error::SameLog`] when a log is given twice; [`Error::TooShort`] when the logs hold too few windows; [`Error::Unfittable`] when the model as given cannot be simulated over
/// them; what [`Model::write_revision`] and [`Model::load`] return.
pub fn diagnose(
    model: &Model,
    logs: &[Log],
    held_out: &[Log],
    out: &Path,
    seed: u64,
    report: &dyn Fn(&str),
) -> Result<Outcome, Error> {
    diagnose_into(model, logs, held_out, (out, "model.toml"), seed, report)
}

/// [`diagnose`] as it would be if the library had not the kinds `without`: what is said where the missing effect is in no library?
///
/// # Errors
/// As [`diagnose`].
pub fn diagnose_without(
    model: &Model,
    logs: &[Log],
    held_out: &[Log],
    out: &Path,
    seed: u64,
    without: &[&'static Kind],
    report: &dyn Fn(&str),
) -> Result<Outcome, Error> {
    let file = (out, "model.toml");
    diagnose_among(model, logs, held_out, file, seed, without, report)
}

/// [`diagnose`], with another name for the new model.
pub(crate) fn diagnose_into(
    model: &Model,
    logs: &[Log],
    held_out: &[Log],
    file: (&Path, &str),
    seed: u64,
    report: &dyn Fn(&str),
) -> Result<Outcome, Error> {
    diagnose_among(model, logs, held_out, file, seed, &[], report)
}

fn diagnose_among(
    model: &Model,
    logs: &[Log],
    held_out: &[Log],
    (out, file_name): (&Path, &str),
    seed: u64,
    without: &[&'static Kind],
    report: &dyn Fn(&str),
) -> Result<Outcome, Error> {
    refuse_poses(model.mechanics.coordinates(), WORK)?;
    let all: Vec<&Log> = logs.iter().chain(held_out).collect();
    for (k, second) in all.iter().enumerate() {
        if let Some(first) = all[..k].iter().find(|first| first.sha256 == second.sha256) {
            return Err(Error::SameLog {
                first: first.path.clone(),
                second: second.path.clone(),
            });
        }
    }
    report("reading the log: noise, outliers, gaps");
    let (observations, data_faults) = audit::audit(model, logs, held_out);
    let fit_runs = logs.iter().map(|log| log.runs.len()).sum();
    report("fitting the model as given");
    let mut prepared = prepare(model, observations, fit_runs)?;
    prepared.study.without = without.to_vec();
    let names: Vec<String> = model
        .inputs
        .iter()
        .map(|input| input.name.clone())
        .collect();

    report("locating the disagreement");
    let (disagreement, residuals) = locate::locate(
        &prepared.study,
        &prepared.null,
        &prepared.smoothed,
        prepared.half_width,
        &names,
    );
    let study = &prepared.study;
    let mut search = search::search(study, prepared.null.clone(), seed, report);

    report("writing the new model and running it free over unseen data");
    let provenance = Provenance {
        version: env!("CARGO_PKG_VERSION").into(),
        model: model.path.display().to_string(),
        logs: logs
            .iter()
            .map(|log| (log, false))
            .chain(held_out.iter().map(|log| (log, true)))
            .map(|(log, held_out)| LogProvenance {
                path: log.path.display().to_string(),
                sha256: log.sha256.clone(),
                held_out,
            })
            .collect(),
        seed,
        windows: [study.windows.fit.len(), study.windows.held_out.len()],
        window_s: prepared.window,
        substeps: study.substeps,
    };
    let first_guess = |run: usize, k: usize| prepared.smoothed[run].state(k);
    let (path, gap, free_runs) = loop {
        let revision = write_up::revision(model, &search, &provenance);
        let path = model.write_revision(out, file_name, &revision)?;
        // What is measured is what was written: the file is read back.
        let written = Hybrid::of(&Model::load(&path)?);
        let given = &search.null.hybrid;
        let (gap, free_runs) = gap::gap(
            study,
            (given, &given.theta()),
            (&written, &written.theta()),
            &first_guess,
            (LEAD_S.min(0.5 * prepared.window), HORIZON_S),
        );
        // Windows without one in which both models stay finite count against what was found; no windows at all say nothing.
        let shrinks = gap.windows > 0 && gap.after < gap.before;
        if search.found.is_empty() || free_runs.is_empty() || shrinks {
            break (path, gap, free_runs);
        }
        report("what was found does not shrink the gap on unseen data: it is not added");
        search.withdraw();
    };

    let verdict = if !search.found.is_empty() {
        Verdict::EffectsFound
    } else if search::is_unexplained(study, &search.model, search::UNEXPLAINED) {
        Verdict::Unexplained
    } else {
        Verdict::NothingMissing
    };
    let effects = write_up::effects(&search, &names);
    let numerics = Numerics {
        set_valued: numerics::set_valued(study, &search.model),
    };
    let advice = advise::advise(study, &search, &effects, verdict, &numerics);
    let diagnosis = Diagnosis {
        verdict,
        disagreement,
        effects,
        gap,
        data_faults,
        advice,
        constants: write_up::constants(&search, &names),
        search: write_up::steps(&search, &names),
        numerics,
        provenance,
    };
    Ok(Outcome {
        diagnosis,
        curves: Curves {
            free_runs,
            residuals,
        },
        model: path,
    })
}
