//! Names that the final fit does not bear out: numerics that are too coarse for a law are explained by another's additional constants.

use super::candidate::Candidate;
use super::comparison::Comparison;
use super::contained::{instead, is_simpler, size};
use super::found::{in_order_of_contribution, position, prune, without};
use super::numerics::{COUNTS, sharp, shows};
use super::refine::{does_more, is_sensible};
use super::search::Search;
use super::step::Report;
use super::study::{Fitted, Study};
use super::width::respread;
use crate::effect::registry;

/// Gives what was found, as fitted in `study`, the names with the fewest constants: a law whose fitted constants may be those of a simpler one that it
/// contains is called by that one's name, unless it explains what that leaves or spares tolerances that that stretches; so is one that owes them to friction that
/// is not sharp enough, where the simpler one does as well with sharper friction. One that may as well do nothing, and any of several where the numerics of `study` are `refined`
/// beyond those that it was found with, is asked for once more beside the others. The study with the steps that this takes, where a name changed.
///
/// What was found beside pushes stays: without them its constants mean nothing.
pub fn simplify(
    study: &Study,
    search: &mut Search,
    refined: bool,
    report: Report,
) -> Option<Study> {
    if search.pushed {
        return None;
    }
    let mut study = study.clone();
    let mut changed = false;
    for k in 0..search.found.len() {
        if let Some((simple, finer, fitted)) = simpler(&study, search, k) {
            let rich = search.found[k].candidate;
            report(&format!(
                "{} does no more than {}",
                rich.kind.name, simple.kind.name
            ));
            study = finer;
            let index = position(&fitted, &simple);
            let reduced = index.map(|index| without(&study, &search.null, &fitted, index));
            let found = &mut search.found[k];
            if let Some(reduced) = &reduced {
                found.comparison = Comparison::of(&fitted, reduced);
            }
            found.rename(simple, rich);
            if Comparison::of(&search.model, &fitted).nearly_explains() {
                found.indistinguishable.push(rich);
                found.rivals.push((rich, search.model.clone()));
            }
            search.refitted(&study, fitted);
            changed = true;
        }
    }
    let unsure = |c: &Candidate| !does_more(&study, c, &search.model, &[]);
    let mut kept: Vec<Candidate> = search.found.iter().map(|f| f.candidate).collect();
    if kept.len() > 1 && (refined || kept.iter().any(unsure)) {
        let mut model = search.model.clone();
        prune(&study, &search.null, &mut model, &mut kept, report);
        if kept.len() < search.found.len() {
            search.found.retain(|f| kept.contains(&f.candidate));
            search.refitted(&study, model);
            changed = true;
        }
    }
    in_order_of_contribution(&mut search.found);
    changed.then_some(study)
}

/// The law with one constant that the `k`th of what was found contains and does not exceed, and the model with it instead, in the study that it was
/// fitted in.
fn simpler(study: &Study, search: &Search, k: usize) -> Option<(Candidate, Study, Fitted)> {
    let (rich, model) = (search.found[k].candidate, &search.model);
    let size = size(study, model, &rich)?;
    let contained = rich.kind.contains.iter();
    let mut contained = contained
        .filter_map(|name| registry::find(name))
        .map(|kind| Candidate { kind, ..rich })
        .filter(|simple| is_simpler(simple, &rich, &search.null.hybrid))
        .filter(|simple| !study.without.contains(&simple.kind))
        .peekable();
    contained.peek()?;
    // Constants that make up for friction that is not sharp enough are as sure as others.
    let owes =
        study.may_sharpen && rich.kind.dry().is_some() && shows(study, model, COUNTS).is_some();
    if !owes && does_more(study, &rich, model, &[size]) {
        return None;
    }
    contained.find_map(|simple| {
        let fitted = instead(study, &search.null, (model, &rich), &simple)?;
        let sharper = || sharp(study, &fitted, COUNTS);
        let sharper = study.may_sharpen.then(sharper).flatten();
        let fits = [Some((study.clone(), fitted)), sharper];
        fits.into_iter().flatten().find_map(|(study, fitted)| {
            // What the other constants may have made up for.
            let fitted = respread(&study, &fitted, &[simple]).unwrap_or(fitted);
            let at_rest = study.at_rest(&fitted.hybrid, &fitted.inside.theta);
            let study = at_rest.unwrap_or(study);
            let lead = Comparison::of(model, &fitted);
            let earns = lead.explains() || lead.explains_more() || lead.relieves();
            let does = is_sensible(&study, &simple, &fitted) && !earns;
            does.then_some((simple, study, fitted))
        })
    })
}
