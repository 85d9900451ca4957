//! What was tried and not added, with the reason; and what these data cannot tell apart.

use super::page::name;
use super::words::{number, percent, plain};
use crate::diagnose::verdict::{Diagnosis, Lack, Name, SearchStep};

/// A name that was refined and not added.
pub struct RuledOut {
    pub name: String,
    pub reason: String,
}

/// What was refined and never added: the reason of the last step in which it was tried, in the order of first trial.
pub fn ruled_out(diagnosis: &Diagnosis) -> Vec<RuledOut> {
    let mut all: Vec<(&[Name], String)> = Vec::new();
    for (number, step) in diagnosis.search.iter().enumerate() {
        for (k, refined) in step.refined.iter().enumerate() {
            let reason = format!("step {}: {}", number + 1, reason(step, k));
            match all.iter_mut().find(|tried| tried.0 == refined.names) {
                Some(tried) => tried.1 = reason,
                None => all.push((&refined.names, reason)),
            }
        }
    }
    let named = |name: &Name| {
        let is = |e: &crate::diagnose::verdict::NamedEffect| {
            e.kind == name.kind && e.target == name.target
        };
        diagnosis.effects.iter().any(is)
    };
    all.into_iter()
        .filter(|(names, _)| !names.iter().all(named))
        .map(|(names, reason)| RuledOut {
            name: joined(names),
            reason,
        })
        .collect()
}

/// Why the `k`th of the refined names was not added.
pub fn reason(step: &SearchStep, k: usize) -> String {
    let Some(refined) = step.refined.get(k) else {
        return String::new();
    };
    let evidence = refined.evidence;
    if refined.numerical {
        return "its gain is numerical: it goes when the integration steps are halved".to_owned();
    }
    match evidence.lacks() {
        Some(Lack::Gain) => {
            return format!(
                "no gain that counts: {} nats per sample, z {}",
                number(evidence.gain_fit),
                number(evidence.z_fit)
            );
        }
        Some(Lack::GainHeldOut) => {
            return format!(
                "no gain out of sample: {} nats per sample on windows held out, z {}",
                number(evidence.gain_held_out),
                number(evidence.z_held_out)
            );
        }
        None => {}
    }
    // Refined names stand in the order of their scores.
    let accepted = step.refined.iter().position(|r| r.accepted);
    match accepted.and_then(|a| Some((a, step.refined.get(a)?))) {
        Some((a, better)) if a > k => {
            format!(
                "{} does as well, with fewer constants or with what was added after it",
                joined(&better.names)
            )
        }
        Some((_, better)) => format!(
            "{} explains the windows better; it wins in {} of the resamplings",
            joined(&better.names),
            percent(better.wins)
        ),
        None => "it was not kept: another way through the search ended better".to_owned(),
    }
}

/// Effects that would move a coordinate nearly alike under these inputs.
pub fn alike(diagnosis: &Diagnosis) -> Vec<String> {
    let said = |a: &crate::diagnose::verdict::Alike| {
        let [first, second] = &a.kinds;
        format!(
            "{} and {} on {} (correlation of what they move: {})",
            plain(first),
            plain(second),
            a.target,
            number(a.correlation)
        )
    };
    diagnosis.excitation.alike.iter().map(said).collect()
}

fn joined(names: &[Name]) -> String {
    let names: Vec<String> = names.iter().map(name).collect();
    names.join(" and ")
}
