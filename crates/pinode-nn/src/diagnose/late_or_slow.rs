//! Whether an input is late or slow.
//!
//! Within a sample u(t − T) and τ ẏ = u − y, τ = T, differ by how what arrives is spread over time, of which integration steps take the mean alone: over steps as long as the
//! samples what that leaves out is more than what tells the two apart. With a quarter of the steps it is a sixteenth.

use std::cell::LazyCell;

use super::candidate::Candidate;
use super::clock::LATE;
use super::comparison::Comparison;
use super::found::{SAME, in_order_of_contribution, position, stripped, without};
use super::refine::is_sensible;
use super::search::Search;
use super::step::Report;
use super::study::{Fitted, MOST_SUBSTEPS, Study};
use super::twins::twins_of;
use crate::effect::registry;
use crate::hybrid::Placed;

/// An input that is late and one that is slow.
const NAMES: [&str; 2] = ["input_delay", "actuator_lag"];
/// What is late by more samples than this is told from what is slow by any steps.
const WITHIN: f64 = 1.5;
/// So many times as many steps.
const FINER: usize = 4;
/// Iterations of a fit: of the name that was found, and of the other.
const ITERATIONS: [usize; 2] = [6, 12];
/// A lead of fewer standard errors on the seen windows is none.
const SURE: f64 = 2.0;

/// Asks of every input that was found to be late or slow, by less than [`WITHIN`] samples, which of them it is, with a quarter of the steps: the name that explains more there is
/// its name, and the other one may be as well where the lead is none. The study with these steps; `None` where nothing changes.
pub fn late_or_slow(study: &Study, search: &mut Search, report: Report) -> Option<Study> {
    // Without the pushes that it was found beside its constants mean nothing.
    let finest = FINER * search.model.substeps * study.steps.about_rests;
    if search.pushed || finest > MOST_SUBSTEPS {
        return None;
    }
    let mut changed = false;
    let fine = LazyCell::new(|| study.with_half_the_steps().with_half_the_steps());
    for k in 0..search.found.len() {
        let own = search.found[k].candidate;
        let Some((other, models)) = both(study, &fine, search, &own) else {
            continue;
        };
        let [as_found, as_other] = models;
        let lead = Comparison::of(&as_other, &as_found);
        let is_itself = is_sensible(&fine, &other, &as_other);
        let is_other = is_itself && lead.total() > 0.0;
        let is_none = is_itself && (lead.total().abs() < SAME || lead.inside.z.abs() < SURE);
        let found = &mut search.found[k];
        if !is_other && !is_none && !found.indistinguishable.contains(&other) {
            continue;
        }
        changed = true;
        let (name, model, rival, rivals_model) = match is_other {
            true => (other, as_other, own, as_found),
            false => (own, as_found, other, as_other),
        };
        if is_other {
            report(&format!(
                "with shorter steps {} does more than {}",
                other.kind.name, own.kind.name
            ));
        }
        found.rename(name, rival);
        if is_other {
            (found.instead, found.unseen_spring) = (None, None);
        }
        if is_none {
            found.indistinguishable.push(rival);
            found.rivals.push((rival, rivals_model));
        } else if !LATE.contains(&name.kind.name) {
            // A sensor that is late does what an input that is late does, and not what a slow one does.
            let is_late = |c: &Candidate| LATE.contains(&c.kind.name);
            found.indistinguishable.retain(|c| !is_late(c));
            found.rivals.retain(|(c, _)| !is_late(c));
        }
        if let Some(index) = position(&model, &name) {
            let reduced = without(&fine, &search.null, &model, index);
            found.comparison = Comparison::of(&model, &reduced);
            let names: Vec<Candidate> = search.found.iter().map(|f| f.candidate).collect();
            let twins = twins_of(&fine, &name, &names, (&model, &reduced));
            let listed = &mut search.found[k].indistinguishable;
            let new = twins.into_iter().filter(|twin| !listed.contains(twin));
            let new: Vec<Candidate> = new.collect();
            listed.extend(new);
        }
        search.refitted(&fine, model);
    }
    if !changed {
        return None;
    }
    in_order_of_contribution(&mut search.found);
    Some(fine.clone())
}

/// The other name of what was found, and the model with either, fitted with the shorter steps; `None` of what has no other, or is told from it by any steps.
fn both(
    study: &Study,
    fine: &Study,
    search: &Search,
    own: &Candidate,
) -> Option<(Candidate, [Fitted; 2])> {
    let name = NAMES.iter().position(|name| *name == own.kind.name)?;
    let kind = registry::find(NAMES[1 - name])?;
    let other = Candidate { kind, ..*own };
    let model = &search.model;
    let index = position(model, own)?;
    let has_both = position(model, &other).is_some();
    let &late = model.inside.theta[model.hybrid.range(index)].first()?;
    if has_both || late > WITHIN * study.interval || study.without.contains(&kind) {
        return None;
    }
    let start = model.start(model.inside.theta.clone());
    let as_found = fine.fit(model.hybrid.clone(), start, 1, ITERATIONS[0]);
    let placed = Placed {
        kind,
        ..model.hybrid.effects()[index]
    };
    let (mut hybrid, mut theta) = stripped(&search.null, model, index);
    hybrid.add(placed, &[late]);
    theta.push(late);
    let as_other = fine.fit(hybrid, model.start(theta), 1, ITERATIONS[1]);
    Some((other, [as_found, as_other]))
}
