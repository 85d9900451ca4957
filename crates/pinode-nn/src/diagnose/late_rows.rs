//! Inputs that are written some rows late: a log in which a row holds what was put out until its state was measured, or whose inputs have a clock that is
//! behind.
//!
//! Such an input acts *before* it is logged, which no effect does: what is left of it is unexplained. The model as given is fitted once more with every
//! input from rows further down and as late as it likes, and where this explains most of what it leaves, the log is searched so; else it is asked again
//! beside what was found, where that leaves something. It is told only where so nothing is left. What is late by a part of a row then has an `input_delay`.

use super::Means;
use super::audit::audit;
use super::candidate::Candidate;
use super::clock::LATE;
use super::comparison::Comparison;
use super::conventions::AsMeant;
use super::found::position;
use super::misfit::{explained, is_unexplained};
use super::refine::{FIRST_LOOK, SHARE, refine_one};
use super::screen::screen;
use super::searched::{Ready, Searched};
use super::setup::thinned;
use super::step::is_dear;
use super::study::{Fitted, Study};
use crate::Error;
use crate::effect::{Between, Kind, registry};

/// Inputs are looked for in rows that were written so much later at most, s at the usual pace.
const LATEST_S: f64 = 0.1;
/// An input that is late by less than this part of a row is not.
const NO_DELAY: f64 = 0.03;
/// Iterations of the initial states alone, and of all.
const ITERATIONS: (usize, usize) = (3, 8);
/// One row has to explain the windows better by so many standard errors.
const LEAST_Z: f64 = 3.0;
/// It is searched first with inputs from further down that explain this share of the misfit, on a logarithmic scale: beside one missing effect they
/// explain 0.3 to 1, but for lags, delays and stops; and not where one of the so many most promising laws explains more.
const MOST: f64 = 0.25;
const LAWS: usize = 3;

/// What is found in logs: with every input from rows further down where that leaves nothing, and they as they are something.
///
/// # Errors
/// Those of [`Ready::new`].
pub fn searched<'a>(
    meant: AsMeant<'a>,
    seed: u64,
    report: &dyn Fn(&str),
    means: &Means,
) -> Result<Searched<'a>, Error> {
    let ready = Ready::new(meant, report, means)?;
    if ready.meant.is_thinned {
        return Ok(ready.searched(seed, report));
    }
    let again = |late: Option<Late>, ready: &Ready<'a>| {
        late.and_then(|late| late.searched(ready, seed, report, means))
    };
    let (study, null) = (&ready.cleaned.prepared.study, &ready.cleaned.prepared.null);
    let (few, given) = study.some_windows(null, SHARE);
    let is_likely = |late: &Late| {
        explained(&few, &given, &late.model) > MOST && !a_law_explains_more(&few, &given, late)
    };
    let late = is_unexplained(&few, &given).then(|| Late::beside(&ready, &few, &given));
    let late = late.flatten().filter(is_likely);
    let tried = late.as_ref().map(|late| late.rows);
    if let Some(found) = again(late, &ready) {
        return Ok(found);
    }
    let found = ready.searched(seed, report);
    if !found.leaves_something() {
        return Ok(found);
    }
    report("asking whether the inputs are written some rows late");
    let late = Late::beside(&found.ready, &found.search.study, &found.search.model);
    let new = late.filter(|late| Some(late.rows) != tried);
    Ok(again(new, &found.ready).unwrap_or(found))
}

/// Whether one of the laws that a screen promises most to explains more than late inputs do: strong friction looks like these.
fn a_law_explains_more(study: &Study, given: &Fitted, late: &Late) -> bool {
    let ranked = screen(study, given, |kind| !is_dear(kind)).ranked;
    ranked.iter().take(LAWS).any(|law| {
        let refined = refine_one(study, given, law, FIRST_LOOK);
        Comparison::of(&refined.fitted, &late.model).total() > 0.0
    })
}

/// Inputs that are written so many rows late.
struct Late {
    rows: usize,
    /// What is fitted with them from there.
    model: Fitted,
    /// How many noises it leaves with the inputs as they are, and from there.
    excess: [f64; 2],
}

impl Late {
    /// By how many rows all inputs are written late that a `model` explains most with, each delayed by what it likes beside what the model has: these are
    /// doubled as long as an input would be read earlier still, and are no more in the end than the delays leave. Nothing where they are in their rows or
    /// the windows are not explained better.
    fn beside(ready: &Ready, study: &Study, model: &Fitted) -> Option<Late> {
        let inputs = &ready.meant.model.inputs;
        let are_held = inputs.iter().all(|input| input.between == Between::Held);
        let kind = registry::find(LATE[0]).filter(|_| are_held)?;
        let delays = on_all(kind, inputs.len());
        let row = ready.interval;
        let latest = (LATEST_S * study.pace.times() / row).max(1.0);
        let read = |rows: usize, delay: f64| -> Option<Fitted> {
            let study = with_inputs_from(ready, study, rows).filter(|_| rows as f64 <= latest)?;
            let (mut hybrid, mut theta) = (model.hybrid.clone(), model.inside.theta.clone());
            for new in delays.iter().filter(|d| position(model, d).is_none()) {
                (hybrid, theta) = new.place(&hybrid, &theta, &[delay]);
            }
            Some(study.fit(hybrid, model.start(theta), ITERATIONS.0, ITERATIONS.1))
        };
        let delayed = |fitted: &Fitted| least(&delays, fitted) / row;
        let (mut rows, mut best) = (1, read(1, 0.5 * row)?);
        let gain = Comparison::of(&best, model);
        if !(gain.total() > 0.0 && gain.inside.z > LEAST_Z) {
            return None;
        }
        while delayed(&best) < NO_DELAY {
            match read(2 * rows, 0.5 * row * rows as f64) {
                Some(further) if Comparison::of(&further, &best).explains() => {
                    (rows, best) = (2 * rows, further);
                }
                _ => break,
            }
        }
        let too_far = (delayed(&best) + NO_DELAY).floor();
        let rows = rows
            .checked_sub(too_far as usize)
            .filter(|&rows| rows > 0)?;
        Some(Late {
            rows,
            excess: [model, &best].map(|model| model.most_excess(study)),
            model: best,
        })
    }

    /// What is found with the inputs from there, where that leaves nothing.
    fn searched<'a>(
        &self,
        ready: &Ready<'a>,
        seed: u64,
        report: &dyn Fn(&str),
        means: &Means,
    ) -> Option<Searched<'a>> {
        let rows = self.rows;
        report(&format!(
            "searching with every input from {rows} rows further down"
        ));
        let mut meant = ready.meant.with_inputs_later(rows).ok()?;
        let told = meant.inputs_stood_late(rows, self.excess);
        meant.faults.extend(told);
        let ready = Ready::new(meant, report, means).ok()?;
        let found = ready.searched(seed, report);
        // Inputs that are a row late again where they are read from were not late.
        let delays = on_all(
            registry::find(LATE[0])?,
            found.ready.meant.model.inputs.len(),
        );
        let is_in_place =
            least(&delays, &found.search.model) > (1.0 - NO_DELAY) * found.ready.interval;
        (!found.leaves_something() && !is_in_place).then_some(found)
    }
}

/// A kind on every input.
fn on_all(kind: &'static Kind, inputs: usize) -> Vec<Candidate> {
    (0..inputs)
        .map(|target| Candidate { kind, target })
        .collect()
}

/// The least of the delays in a model, s; 0 where it has not all of them.
fn least(delays: &[Candidate], fitted: &Fitted) -> f64 {
    let place = |d: &Candidate| Some(fitted.hybrid.range(position(fitted, d)?).start);
    let value = |d: &Candidate| place(d).map_or(0.0, |i| fitted.inside.theta[i]);
    delays.iter().map(value).fold(f64::INFINITY, f64::min)
}

/// A study with every input from so many rows further down in the logs.
fn with_inputs_from(ready: &Ready, study: &Study, rows: usize) -> Option<Study> {
    let model = &ready.meant.model;
    let [logs, held_out] = ready.meant.logs_with_inputs_later(rows);
    let later = audit(model, &logs, &held_out).observations;
    let later = thinned(model, later, &study.pace);
    let mut study = study.clone();
    for (run, later) in study.observations.runs.iter_mut().zip(later.runs) {
        if run.t.len() != later.t.len() {
            return None;
        }
        run.u = later.u;
    }
    Some(study)
}
