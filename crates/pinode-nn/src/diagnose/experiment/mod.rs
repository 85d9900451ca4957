//! The experiment that would tell two names apart, computed.
//!
//! The found model and the model with the rival name, each with its own fitted constants, are simulated through a [menu](menu) of
//! experiments that the rig can do: inputs no larger than the log's, positions within the logged reach. What counts of an experiment is
//! the root mean square of the difference of the two sensor readings over the sensor's noise, after [what the log leaves
//! open](apart::least) of the constants of both has been used to bring the two together: a difference that a slightly other mass takes
//! away tells no names apart. Dry friction sticks in these simulations: smoothed, it would creep, and creep tells apart what is one law.

mod apart;
mod menu;
mod rival;
mod simulate;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use rayon::prelude::*;

use self::menu::Trial;
pub use self::menu::short;
use self::simulate::{Simulated, Simulator};
use super::candidate::Candidate;
use super::found::Found;
use super::search::Search;
use super::step::Report;
use super::study::{Fitted, Study};
use super::verdict::{Experiment, Name};

/// Rivals with a smaller confidence are no tie.
pub const CLOSE: f64 = 0.05;
/// An experiment splits two names when they differ by so many times the noise.
const SPLITS: f64 = 3.0;
/// So many experiments are listed, the best ones.
const LISTED: usize = 3;
/// So many sizes of one experiment are compared: the largest within the logged reach.
const SIZES_KEPT: usize = 2;
/// So many rivals of one effect are simulated, ties first.
const MOST_RIVALS: usize = 3;

/// A found effect beside one of its rivals.
pub struct Split {
    /// The found effect.
    pub own: Name,
    /// The rival.
    pub against: Name,
    /// Confidence in the rival; `None`: the log does not tell the two apart.
    pub confidence: Option<f64>,
    /// What the menu promises.
    pub outcome: Outcome,
}

/// What the menu has for two names.
pub enum Outcome {
    /// Experiments that split them, the best first.
    Splits(Vec<Experiment>),
    /// None of them does.
    OneEffect,
    /// Neither the rival's fit nor an experiment within the logged reach can be simulated.
    NotSimulated,
}

/// Every found effect beside its ties and close rivals.
pub fn splits(study: &Study, search: &Search, inputs: &[String], report: Report) -> Vec<Split> {
    let mut splits = Vec::new();
    for found in &search.found {
        let ties = found.indistinguishable.iter().map(|c| (*c, None));
        let close = found
            .alternatives
            .iter()
            .filter(|(c, confidence)| *confidence > CLOSE && !found.indistinguishable.contains(c))
            .map(|(c, confidence)| (*c, Some(*confidence)));
        for (other, confidence) in ties.chain(close).take(MOST_RIVALS) {
            report(&format!(
                "simulating experiments that tell {} from {}",
                found.candidate.kind.name, other.kind.name
            ));
            let name = |c: &Candidate| Name {
                kind: c.kind.name.into(),
                target: c.target_name(&search.model.hybrid, inputs).into(),
            };
            splits.push(Split {
                own: name(&found.candidate),
                against: name(&other),
                confidence,
                outcome: outcome(study, search, (found, other), &name(&other), inputs),
            });
        }
    }
    splits
}

fn outcome(
    study: &Study,
    search: &Search,
    (found, other): (&Found, Candidate),
    against: &Name,
    inputs: &[String],
) -> Outcome {
    let Some(rival) = rival::fitted(study, search, found, other) else {
        return Outcome::NotSimulated;
    };
    let trials = menu::menu(study, &search.model, (found.candidate, other), &rival);
    best(study, &search.model, &rival, trials, against, inputs)
}

/// The best of `trials`, of each list no more than two, at telling two fitted models apart.
fn best(
    study: &Study,
    own: &Fitted,
    rival: &Fitted,
    trials: Vec<Vec<Trial>>,
    against: &Name,
    inputs: &[String],
) -> Outcome {
    // Both take the same steps.
    let substeps = [own, rival].map(|m| study.substeps_anywhere(&m.hybrid, &m.inside.theta));
    let substeps = substeps[0].max(substeps[1]);
    // One answer a list, in their order: the same bits for any number of threads.
    let tried: Vec<Vec<Tried>> = trials
        .into_par_iter()
        .map(|sizes| {
            let sizes = sizes.into_iter();
            let tried = sizes.filter_map(|t| Tried::new(study, [own, rival], t, substeps));
            tried.take(SIZES_KEPT).collect()
        })
        .collect();
    let mut tried: Vec<Tried> = tried.into_iter().flatten().collect();
    if tried.is_empty() {
        return Outcome::NotSimulated;
    }
    tried.sort_by(|a, b| b.largest().total_cmp(&a.largest()));
    let mut listed: Vec<Tried> = Vec::new();
    for mut next in tried {
        let enough = listed.get(LISTED - 1);
        if next.largest() < SPLITS || enough.is_some_and(|l| l.largest() >= next.largest()) {
            break;
        }
        next.differences = apart::least(
            study,
            [own, rival],
            &next.trial,
            substeps,
            &next.simulated,
            next.count,
        );
        let rank = listed.iter().filter(|l| l.largest() >= next.largest());
        listed.insert(rank.count(), next);
    }
    listed.retain(|l| l.largest() >= SPLITS);
    listed.truncate(LISTED);
    if listed.is_empty() {
        return Outcome::OneEffect;
    }
    let hybrid = &own.hybrid;
    let written = listed.iter().map(|tried| {
        let Trial {
            setup,
            shape,
            input,
            amplitude,
            ..
        } = &tried.trial;
        let duration_s = (tried.count - 1) as f64 * study.interval;
        let coordinates = hybrid.mechanics().coordinates().iter();
        let named = coordinates.zip(&tried.differences);
        let differences: BTreeMap<String, f64> = named.map(|(c, d)| (c.name.clone(), *d)).collect();
        Experiment {
            against: against.clone(),
            experiment: shape.name().into(),
            input: input.and_then(|i| inputs.get(i).cloned()),
            amplitude: input.map(|_| *amplitude),
            turned: setup.is_turned(),
            payload: setup.payload(hybrid),
            duration_s,
            differences,
            sentence: tried.trial.words(hybrid, inputs, duration_s),
        }
    });
    Outcome::Splits(written.collect())
}

/// The best experiments of one found effect against all its rivals: of each rival's best first, then the next ones.
pub fn listed<'a>(splits: impl Iterator<Item = &'a Split>) -> Vec<Experiment> {
    let mut ranked: Vec<(usize, &Experiment)> = Vec::new();
    for split in splits {
        if let Outcome::Splits(experiments) = &split.outcome {
            ranked.extend(experiments.iter().enumerate());
        }
    }
    let (mut first, rest): (Vec<_>, Vec<_>) = ranked.into_iter().partition(|(rank, _)| *rank == 0);
    let descending = |a: &(usize, &Experiment), b: &(usize, &Experiment)| {
        b.1.largest().1.total_cmp(&a.1.largest().1)
    };
    let mut rest = rest;
    rest.sort_by(descending);
    first.extend(rest);
    first.truncate(LISTED);
    first.sort_by(descending);
    first.into_iter().map(|(_, e)| e.clone()).collect()
}

impl Experiment {
    /// The coordinate that tells most, and by how many times its noise.
    pub fn largest(&self) -> (&str, f64) {
        let mut largest = ("", 0.0);
        for (name, &times) in &self.differences {
            if times > largest.1 {
                largest = (name, times);
            }
        }
        largest
    }
}

/// A trial that both models go through.
struct Tried {
    trial: Trial,
    simulated: [Simulated; 2],
    /// Samples over which both stay within the logged reach.
    count: usize,
    /// Root mean square of the difference of the readings over the noise, one a coordinate.
    differences: Vec<f64>,
}

impl Tried {
    fn new(study: &Study, models: [&Fitted; 2], trial: Trial, substeps: usize) -> Option<Self> {
        let run = |model: &Fitted| {
            let theta = &model.inside.theta;
            Simulator::new(study, &model.hybrid, &trial, substeps).run(theta)
        };
        let simulated = [run(models[0])?, run(models[1])?];
        let count = simulated[0].within.min(simulated[1].within);
        let least = trial.shape.least_share() * trial.samples as f64;
        if count < 3 || (count as f64) < least {
            return None;
        }
        let differences = apart::root_mean_squares(&apart::difference(
            study,
            &simulated[0],
            &simulated[1],
            count,
        ));
        Some(Tried {
            trial,
            simulated,
            count,
            differences,
        })
    }

    /// Of the coordinate that tells most.
    fn largest(&self) -> f64 {
        self.differences.iter().copied().fold(0.0, f64::max)
    }
}
