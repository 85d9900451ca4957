//! What is named beside a network that has learnt the rest.
//!
//! A network sees what is measured at one moment. What comes late, or remembers, is hidden by a law that is missing as long as that is, and shows in what the network leaves. The network
//! made up for it as far as it could: it is taught anew beside every name that explains what it leaves, and the best of these is told.

use rayon::prelude::*;

use super::accept::accept;
use super::candidate::Candidate;
use super::found::{Found, position, weigh};
use super::misfit::explained;
use super::refine::{Contender, ITERATIONS, contender, polish, rank, refine_one};
use super::score::samples_per_window;
use super::screen::screen;
use super::search::{STATES_ALONE, Search};
use super::step::{LEAST_T2, Report};
use super::study::{Fitted, Study};

/// At most so many are refined …
const REFINED: usize = 3;
/// … that are promised so many nats a sample.
const PROMISED: f64 = 0.01;
/// A network is taught beside so many of them.
const TAUGHT: usize = 2;

/// Names that may explain what a network leaves that the model with what was found was `taught`, refined beside it, the one that is accepted first; none where none is.
pub fn names_beside(study: &Study, taught: &Fitted, seed: u64, report: Report) -> Vec<Contender> {
    let screen = screen(study, taught, |kind| kind.remembers());
    let samples = taught.inside_scores.len() as f64 * samples_per_window(&taught.inside);
    let promising = screen.ranked.iter();
    let promising = promising.filter(|s| s.t2 > LEAST_T2.1 && s.gain > PROMISED * samples);
    let chosen: Vec<_> = promising.take(REFINED).collect();
    if chosen.is_empty() {
        return Vec::new();
    }
    let names: Vec<&str> = chosen.iter().map(|s| s.candidate.kind.name).collect();
    report(&format!("refining {} beside the network", names.join(", ")));
    let refined = chosen.par_iter();
    let mut contenders: Vec<Contender> = refined
        .map(|s| refine_one(study, taught, s, ITERATIONS))
        .collect();
    polish(study, taught, &mut contenders);
    rank(&mut contenders, seed);
    let Some(accepted) = accept(study, taught, &mut contenders, (false, seed)) else {
        return Vec::new();
    };
    let first = contenders.remove(accepted);
    let others = contenders.into_iter().filter(Contender::is_rival);
    [first].into_iter().chain(others).take(TAUGHT).collect()
}

/// The search with a name that has no say yet, the constants of which are as they are beside a network.
pub fn with_name(study: &Study, search: &Search, name: &Contender) -> Option<Search> {
    let [candidate] = name.added[..] else {
        return None;
    };
    let beside = &name.fitted;
    let range = beside.hybrid.range(position(beside, &candidate)?);
    let values = &beside.inside.theta[range];
    let given = &search.model;
    let (hybrid, theta) = candidate.place(&given.hybrid, &given.inside.theta, values);
    let model = study.fit(hybrid, given.start(theta), STATES_ALONE, 0);
    let mut search = search.clone();
    drop(search.refitted(study, model));
    // It may contain one of them.
    let Search { found, model, .. } = &mut search;
    found.retain(|f| position(model, &f.candidate).is_some());
    Some(search)
}

/// The names beside each of which a network was taught anew, `taught` with it, as what they explain of what one leaves without them, `before`; the best first.
pub fn weighed(
    study: &Study,
    taught: &[(Candidate, &Fitted)],
    before: &Fitted,
    seed: u64,
) -> Vec<Contender> {
    let of_name = |&(candidate, fitted): &(Candidate, &Fitted)| Contender {
        // How much the network sees is not what the name costs.
        score: fitted.score(candidate.kind.parameters.len()),
        ..contender(study, vec![candidate], fitted.clone(), before)
    };
    let mut contenders: Vec<Contender> = taught.iter().map(of_name).collect();
    contenders.retain(|c| c.is_sensible);
    rank(&mut contenders, seed);
    contenders
}

/// The best of them, as it is found.
pub fn found_beside(
    study: &Study,
    contenders: &[Contender],
    base: &Fitted,
    before: &Fitted,
) -> Option<Found> {
    let best = contenders.iter().find(|c| c.is_acceptable())?;
    let mut found = weigh(study, (&best.added, 0), contenders, (&best.fitted, before));
    let left = best.fitted.left(study);
    found.believe(explained(study, base, &best.fitted).min(found.share_beside(left)));
    Some(found)
}
