//! The missing-physics workflow: find where model and measured data disagree, name what is missing, add it, show the gap shrink.
//!
//! 1. Audit: noise of the sensors and faults of the data, from the log alone; what the log can show at best.
//! 2. The model as given is fitted within its tolerances: that is the null model. Its residuals show more faults of the data; what is
//!    faulty takes no part in anything.
//! 3. Locate: the force it lacks, by coordinate and signal. This explains; it does not decide.
//! 4. Search: every candidate is screened from one linearisation; the best are refined by a fit; one is accepted
//!    when it explains the windows better, pair by pair, both on those the fit saw and on those held out. Where none is, the same again beside
//!    pushes that nobody measured; then what explains little is asked whether it is sure.
//!    Inputs that are written some rows late are asked for before, where they explain much of what the null model leaves, and where the search leaves
//!    something.
//! 5. Dry friction is fitted as sharp as the data see it: the known one with the null model, what is found at once and in the end; then names with fewer constants are asked for once more.
//! 6. The new model is written, read back, and run free over held-out data. What does not shrink the gap there is not added.
//! 7. What is left and no effect explains is taught to a small network on that coordinate, or on all that are off, which is described and added where it explains windows held out of its
//!    fits and shrinks the gap. What comes late or remembers is hidden by such a law: it is asked for beside the network.

mod accelerations;
mod accept;
mod advise;
mod at_rest;
pub(crate) mod audit;
mod beside;
mod blows;
mod bracket;
mod candidate;
mod cleaned;
mod clock;
mod comparison;
mod confidence;
mod constancy;
mod contained;
pub(crate) mod conventions;
pub mod curves;
mod duals;
mod elsewhere;
mod experiment;
mod found;
mod fresh_rows;
mod gap;
mod half_steps;
mod horizons;
mod idle;
pub(crate) mod kept;
mod last_resort;
mod late_or_slow;
mod late_rows;
mod layouts;
mod leftover;
mod linear;
mod locate;
mod longer;
mod matched;
mod misfit;
mod needed;
mod nuisance;
mod numerics;
pub(crate) mod pace;
mod particulars;
mod proof;
mod pushes;
mod refine;
mod regions;
mod released;
mod remainder;
mod remembering;
mod rests;
pub(crate) mod scales;
mod score;
mod screen;
mod search;
mod searched;
mod selection;
mod setup;
mod several;
mod shapes;
mod shown;
mod sight;
mod signals;
mod simplify;
pub mod sketch;
mod slight;
pub(crate) mod smooth;
mod start_errors;
mod starts;
mod step;
mod step_length;
mod stops;
mod study;
mod taught;
mod twins;
mod undoing;
mod unexplained;
mod unseen_spring;
mod unstretched;
mod valley;
pub mod verdict;
mod width;
mod write_up;

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use self::candidate::Candidate;
use self::cleaned::Cleaned;
use self::conventions::{as_meant, refuse_unmoved};
use self::curves::Curves;
use self::elsewhere::elsewhere;
use self::fresh_rows::fresh;
use self::kept::Kept;
use self::last_resort::Sitting;
use self::late_or_slow::late_or_slow;
use self::late_rows::searched;
use self::proof::{Proof, Proved};
use self::searched::{Ready, Searched};
use self::study::Study;
use self::verdict::{Diagnosis, LogProvenance, Numerics, Provenance, Verdict};
use crate::Error;
use crate::effect::Kind;
use crate::entries::refuse_poses;
use crate::log::{Log, Run, refuse_twice};
use crate::model::Model;

pub use conventions::counts_otherwise;
pub use pace::WINDOW_S;
pub use setup::FEWEST_WINDOWS;

/// Length of the free runs by which the gap is measured, s at the usual pace: where windows are longer or shorter than [`WINDOW_S`], so are these.
pub const HORIZON_S: f64 = 0.6;
/// Length of the stretch before a free run that its initial state is fitted to, s at the usual pace.
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
/// [`Error::Floating`] when a coordinate is the pose of a floating body; [`Error::SameLog`] when a log is given twice; [`Error::OtherModel`] when one was read for another model; [`Error::Unmoved`] when a coordinate never moves though the equations ask it to; [`Error::TooShort`] when the logs hold too few windows; [`Error::TooCoarse`] when their samples are too far apart for the length of the recordings; [`Error::Unfittable`] when the model as given cannot be simulated over
/// them; what [`Model::write_revision`] and [`Model::load`] return.
pub fn diagnose(
    model: &Model,
    logs: &[Log],
    held_out: &[Log],
    out: &Path,
    seed: u64,
    report: &dyn Fn(&str),
) -> Result<Outcome, Error> {
    let file = (out, "model.toml");
    let means = Means::default();
    diagnose_into(model, logs, held_out, file, seed, report, &means)
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
    let means = Means {
        without: without.to_vec(),
        ..Means::default()
    };
    diagnose_into(model, logs, held_out, file, seed, report, &means)
}

/// What a diagnosis has at its disposal beside model and data.
#[derive(Debug, Clone, Default)]
pub(crate) struct Means {
    /// Kinds of effects that are no candidates.
    pub without: Vec<&'static Kind>,
    /// Where finished fits are kept.
    pub kept: Option<Arc<Kept>>,
}

/// [`diagnose`], with another name for the new model, by other means.
pub(crate) fn diagnose_into(
    model: &Model,
    logs: &[Log],
    held_out: &[Log],
    file: (&Path, &str),
    seed: u64,
    report: &dyn Fn(&str),
    means: &Means,
) -> Result<Outcome, Error> {
    refuse_poses(model.mechanics.coordinates(), WORK)?;
    refuse_twice(logs, held_out)?;
    let mut all = logs.iter().chain(held_out);
    all.try_for_each(|log| log.check(model))?;
    report("reading the log: noise, outliers, gaps");
    refuse_unmoved(model, logs)?;
    let (logs, mut repeated) = fresh(model, logs);
    let (held_out, repeated_there) = fresh(model, held_out);
    if repeated.is_empty() {
        repeated = repeated_there;
    }
    let mut meant = as_meant(model, &logs, &held_out, report)?;
    meant.is_thinned = [&logs, &held_out]
        .iter()
        .any(|logs| matches!(logs, Cow::Owned(_)));
    meant.faults.splice(..0, repeated);
    let Searched { ready, mut search } = searched(meant, seed, report, means)?;
    let Ready {
        meant,
        cleaned,
        interval,
    } = ready;
    let (model, logs, held_out) = (&*meant.model, &*meant.logs, &*meant.held_out);
    let names: Vec<String> = model
        .inputs
        .iter()
        .map(|input| input.name.clone())
        .collect();
    let Cleaned {
        prepared,
        faults: data_faults,
        masked,
        disagreement,
        residuals,
        ..
    } = cleaned;
    let mut splits = experiment::splits(&search.study, &search, &names, report);
    let (mut study, mut coarse) = numerics::finer(&mut search, report);
    let simple = simplify::simplify(&study, &mut search, !coarse.is_empty(), report);
    let told = late_or_slow(simple.as_ref().unwrap_or(&study), &mut search, report);
    if let Some(finer) = told.or(simple) {
        study = finer;
        let found = search.found.iter().map(|f| f.candidate);
        let found: Vec<Candidate> = found.collect();
        coarse.retain(|(_, model)| search::has_names(model, &found));
        splits = experiment::splits(&study, &search, &names, report);
    }

    report("writing the new model and running it free over unseen data");
    let mut provenance = provenance(model, (logs, held_out), seed, &study);
    let proof = Proof {
        model,
        given: search.null.hybrid.clone(),
        prepared: &prepared,
        masked: &masked,
        file,
    };
    let (mut study, mut proved) =
        proof.shrinking(study, coarse, &mut search, &provenance, report)?;
    search.doubt_what_may_do_nothing(&study);
    let at_fault = data_faults.iter().any(audit::contradicts);
    let is_found = !search.found.is_empty();
    let contradicted = match is_found {
        true => {
            let windows_leave = misfit::leaves(&study, &search.null, &search.model);
            misfit::is_not_all(&proved.gap, windows_leave)
                || misfit::is_far_from_expected(&proved.gap, &search.model.hybrid)
        }
        false => !at_fault && misfit::is_contradicted(&proved.gap),
    };
    let something_is_left =
        search.left.is_some() || misfit::is_unexplained(&study, &search.model) || contradicted;
    if contradicted {
        // States of its own explain windows of nearly anything; free runs that they leave far off are not what a drive or a friction with a memory leaves.
        let with_states = |f: &&mut found::Found| f.candidate.kind.states() > 0;
        for found in search.found.iter_mut().filter(with_states) {
            found.believe(misfit::explained_of(&proved.gap));
        }
    }
    let believed = search.found.iter().any(found::Found::is_believed);
    let is_named = is_found && !contradicted && (believed || !something_is_left);
    let verdict = if is_named && search.explains_most() {
        Verdict::EffectsFound
    } else if something_is_left {
        Verdict::Unexplained
    } else if at_fault {
        Verdict::DataFault
    } else {
        Verdict::NothingMissing
    };
    let mut unexplained = None;
    if something_is_left {
        report("teaching a network what no effect explains");
        let sitting = Sitting {
            interval,
            inputs: &names,
            seed,
            provenance: &provenance,
        };
        (study, unexplained) = proof.teach(study, &mut search, sitting, &mut proved, report)?;
    }
    provenance.substeps = study.steps.substeps * study.finer;
    let study = &study;
    proof.add_horizons(study, &mut proved);
    let Proved {
        path,
        mut gap,
        free_runs,
        ..
    } = proved;
    gap.regions = regions::regions(&residuals, &free_runs, &gap.coordinates);

    let effects = write_up::effects((study, &search), &splits, &names);
    let numerics = Numerics {
        set_valued: numerics::set_valued(study, search.whole()),
    };
    let constants = write_up::constants((study, &search), &names);
    let mut advice = advise::advise(
        study,
        &search,
        &effects,
        &splits,
        verdict,
        unexplained.as_ref(),
        &numerics,
    );
    if something_is_left && let Some(unborne) = at_rest::unborne(study, &search) {
        let name = write_up::name(&unborne.candidate, &search.model.hybrid, &names);
        advice.insert(0, advise::at_rest(&unborne, &name, &search.model.hybrid));
    } else if something_is_left && let Some(other) = elsewhere(study, &search) {
        let name = write_up::name(&other.candidate, &search.model.hybrid, &names);
        advice.insert(0, advise::elsewhere(&other, &name, &search.model.hybrid));
    }
    let is_in_doubt = |found: &found::Found| found.confidence < advise::IN_DOUBT;
    if something_is_left || search.found.iter().any(is_in_doubt) {
        advice.extend(advise::exact_constants(model));
    }
    if contradicted {
        advice.push(advise::contradicted(&gap));
    }
    if something_is_left {
        advice.extend(advise::smooth_inputs(study, &model.inputs));
        advice.extend(advise::silent_inputs(&prepared.excitation.inputs));
    }
    advice.extend(constants.iter().filter_map(advise::moved));
    let springs = search.found.iter().filter_map(|f| f.unseen_spring.as_ref());
    let hybrid = &search.model.hybrid;
    advice.extend(springs.filter_map(|s| advise::unseen_spring(s, hybrid, &model.inputs)));
    advice.extend(search.found.iter().filter_map(|found| {
        let swing = valley::swing(study, &search.model, &found.candidate)?;
        advise::swings(&swing, &found.candidate, &model.inputs)
    }));
    let change = constancy::change(study, &search, &names);
    let recordings = recordings(logs.iter().chain(held_out));
    advice.extend(change.as_ref().map(|c| advise::changing(c, &recordings)));
    advice.extend(model.has_learnt_from(logs.iter().chain(held_out)));
    let diagnosis = Diagnosis {
        verdict,
        disagreement,
        effects,
        gap,
        residuals: write_up::residuals(study, &search),
        data_faults,
        excitation: prepared.excitation,
        unexplained,
        advice,
        constants,
        change,
        search: write_up::steps(&search, &names),
        numerics,
        provenance,
    };
    let sketch = model.tree.as_ref().and_then(|tree| {
        let runs = &study.observations.runs;
        let times: Vec<&[f64]> = runs.iter().map(|run| run.t.as_slice()).collect();
        let null = &search.null;
        let readings = null.hybrid.readings(&null.inside.theta, &[]);
        sketch::sketch(tree, &prepared.smoothed, &times, &readings)
    });
    Ok(Outcome {
        diagnosis,
        curves: Curves {
            sketch,
            free_runs,
            residuals,
        },
        model: path,
    })
}

/// What the recordings of some logs are called, in their order.
fn recordings<'a>(logs: impl Iterator<Item = &'a Log>) -> Vec<String> {
    logs.flat_map(|log| log.runs.iter().map(move |run| recording(log, run)))
        .collect()
}

/// What a recording of a log is called.
fn recording(log: &Log, run: &Run) -> String {
    match log.runs.len() {
        1 => format!("`{}`", log.path.display()),
        _ => format!("run `{}` of `{}`", run.id, log.path.display()),
    }
}

/// From what all this was found.
fn provenance(
    model: &Model,
    (logs, held_out): (&[Log], &[Log]),
    seed: u64,
    study: &Study,
) -> Provenance {
    let seen = logs.iter().map(|log| (log, false));
    let unseen = held_out.iter().map(|log| (log, true));
    let of_log = |(log, held_out): (&Log, bool)| LogProvenance {
        path: log.path.display().to_string(),
        sha256: log.sha256.clone(),
        held_out,
    };
    Provenance {
        version: env!("CARGO_PKG_VERSION").into(),
        model: model.path.display().to_string(),
        logs: seen.chain(unseen).map(of_log).collect(),
        seed,
        windows: [study.windows.fit.len(), study.windows.held_out.len()],
        window_s: study.pace.window(),
        substeps: study.steps.substeps,
    }
}
