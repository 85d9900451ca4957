//! Forward search for what is missing: screen, refine, accept, prune, revisit.

use super::candidate::Candidate;
use super::confidence::wins;
use super::screen::{Screened, ScreenedPair, screen};
use super::study::{Comparison, Fitted, Study};
use crate::effect::Kind;

/// At most so many effects are named.
const MOST_EFFECTS: usize = 4;
/// So many candidates of a screen are refined.
const REFINED: usize = 5;
/// Least t² in the first screen, and in later ones.
const LEAST_T2: (f64, f64) = (4.0, 6.0);
/// A gain that moves by more than this share when the numerics are refined is numerical.
const NUMERICAL: f64 = 0.3;

/// A candidate, or a pair of them, refined by a fit.
#[derive(Clone)]
pub struct Contender {
    /// What was added.
    pub added: Vec<Candidate>,
    /// The fitted model.
    pub fitted: Fitted,
    /// Against the model before.
    pub comparison: Comparison,
    /// Σ l_w − 4 k ln n.
    pub score: f64,
    /// Share of 400 bootstraps over windows in which it has the best score of its step.
    pub wins: f64,
    /// Whether its gain stands under a finer integration and a narrower smoothing; `None`: not asked.
    pub numerically_sound: Option<bool>,
}

/// One step of the search.
#[derive(Clone)]
pub struct Step {
    /// The screen, best first.
    pub screened: Vec<Screened>,
    /// What was refined, best first.
    pub contenders: Vec<Contender>,
    /// Which of them was accepted.
    pub accepted: Option<usize>,
}

/// The whole search.
#[derive(Clone)]
pub struct Search {
    /// The model as given, fitted within its tolerances.
    pub null: Fitted,
    /// The steps; the last one accepted nothing, unless the search was full.
    pub steps: Vec<Step>,
    /// What was found and stood the test at the end.
    pub found: Vec<Found>,
    /// The model with it.
    pub model: Fitted,
}

/// A found effect.
#[derive(Clone)]
pub struct Found {
    /// What it is.
    pub candidate: Candidate,
    /// Probability that it is this one, given that one of the contenders is.
    pub confidence: f64,
    /// Its rivals, with their probabilities.
    pub alternatives: Vec<(Candidate, f64)>,
    /// Rivals that the data do not tell from it.
    pub indistinguishable: Vec<Candidate>,
    /// The model with it against the model without.
    pub comparison: Comparison,
}

/// Residual over sensor noise beyond which a model does not explain the data: on a displacement, on an angle.
pub const UNEXPLAINED: (f64, f64) = (1.6, 5.0);

/// What the search tells of its progress.
pub type Report<'a> = &'a dyn Fn(&str);

/// Searches for what `null` is missing.
pub fn search(study: &Study, null: Fitted, seed: u64, report: Report) -> Search {
    let mut steps: Vec<Step> = Vec::new();
    let mut current = null.clone();
    let mut added: Vec<Candidate> = Vec::new();
    while added.len() < MOST_EFFECTS {
        let step = one_step(study, &current, added.is_empty(), seed, report);
        let accepted = step.accepted.map(|k| step.contenders[k].clone());
        steps.push(step);
        let Some(accepted) = accepted else {
            break;
        };
        for candidate in &accepted.added {
            report(&format!(
                "accepted: {} (z {:.1}, held out {:.1})",
                candidate.kind.name, accepted.comparison.inside.z, accepted.comparison.outside.z
            ));
        }
        added.extend(accepted.added.iter().copied());
        current = accepted.fitted;
        prune(study, &mut current, &mut added, report);
    }
    let found = revisit(study, &mut current, &mut added, &steps, seed, report);
    Search {
        null,
        steps,
        found,
        model: current,
    }
}

fn one_step(study: &Study, current: &Fitted, first: bool, seed: u64, report: Report) -> Step {
    let screen = screen(
        &current.hybrid,
        &current.inside,
        &study.observations,
        &study.windows.fit,
        &study.scales,
        study.substeps,
    );
    let least = if first { LEAST_T2.0 } else { LEAST_T2.1 };
    let chosen: Vec<&Screened> = screen
        .ranked
        .iter()
        .filter(|s| s.t2 > least)
        .take(REFINED)
        .collect();
    let mut contenders: Vec<Contender> = Vec::new();
    for s in &chosen {
        report(&format!("refining {}", s.candidate.kind.name));
        contenders.push(refine(study, current, &[(s.candidate, s.start.clone())]));
    }
    polish(study, current, &mut contenders);
    rank(&mut contenders, seed);
    let mut accepted = accept(study, current, &mut contenders);
    if accepted.is_none() && is_unexplained(study, current, (1.25, 2.6)) {
        let pairs: Vec<ScreenedPair> = screen.pairs(4);
        let mut joint: Vec<Contender> = Vec::new();
        for pair in &pairs {
            report(&format!(
                "refining {} with {}",
                pair.members[0].0.kind.name, pair.members[1].0.kind.name
            ));
            joint.push(refine(study, current, &pair.members));
        }
        rank(&mut joint, seed);
        if let Some(k) = accept(study, current, &mut joint) {
            contenders = joint;
            accepted = Some(k);
        }
    }
    Step {
        screened: screen.ranked,
        contenders,
        accepted,
    }
}

/// Whether the residual of a position is so many times the sensor's noise: on a displacement, on an angle.
pub fn is_unexplained(study: &Study, fitted: &Fitted, (linear, angular): (f64, f64)) -> bool {
    let coordinates = fitted.hybrid.mechanics().coordinates();
    fitted
        .excess(&study.observations)
        .iter()
        .zip(&study.observations.channels)
        .any(|(&excess, channel)| {
            let limit = if coordinates[channel.coordinate].angular {
                angular
            } else {
                linear
            };
            excess > limit
        })
}

fn refine(study: &Study, current: &Fitted, members: &[(Candidate, Vec<f64>)]) -> Contender {
    let mut hybrid = current.hybrid.clone();
    let mut theta = current.inside.theta.clone();
    for (candidate, start) in members {
        (hybrid, theta) = candidate.place(&hybrid, &theta, start);
    }
    let fitted = study.fit(hybrid, current.start(theta), 1, 12);
    contender(members.iter().map(|m| m.0).collect(), fitted, current)
}

fn contender(added: Vec<Candidate>, fitted: Fitted, current: &Fitted) -> Contender {
    let more = fitted
        .hybrid
        .free()
        .len()
        .saturating_sub(current.inside.free.len());
    Contender {
        added,
        comparison: Comparison::of(&fitted, current),
        score: fitted.score(more),
        fitted,
        wins: 0.0,
        numerically_sound: None,
    }
}

/// Contenders within half of the leader's gain are fitted again from the leader's initial states, so that none loses by a poor start.
fn polish(study: &Study, current: &Fitted, contenders: &mut [Contender]) {
    let base = current.score(0);
    let Some(leader) = contenders
        .iter()
        .max_by(|a, b| a.score.total_cmp(&b.score))
        .cloned()
    else {
        return;
    };
    for rival in contenders.iter_mut() {
        if rival.added == leader.added || rival.score - base < 0.5 * (leader.score - base) {
            continue;
        }
        let start = leader.fitted.start(rival.fitted.inside.theta.clone());
        let again = study.fit(rival.fitted.hybrid.clone(), start, 1, 8);
        let again = contender(rival.added.clone(), again, current);
        if again.score > rival.score {
            *rival = again;
        }
    }
}

fn rank(contenders: &mut [Contender], seed: u64) {
    contenders.sort_by(|a, b| b.score.total_cmp(&a.score));
    let scores: Vec<(&[f64], f64)> = contenders
        .iter()
        .map(|c| {
            let sum: f64 = c.fitted.inside_scores.iter().sum();
            (c.fitted.inside_scores.as_slice(), sum - c.score)
        })
        .collect();
    let wins = wins(&scores, seed);
    for (contender, wins) in contenders.iter_mut().zip(wins) {
        contender.wins = wins;
    }
}

/// The best contender whose gain is significant on both sides and not numerical.
fn accept(study: &Study, current: &Fitted, contenders: &mut [Contender]) -> Option<usize> {
    for (k, contender) in contenders.iter_mut().enumerate() {
        if !contender.comparison.accepts() {
            continue;
        }
        let sound = is_numerically_sound(study, current, contender);
        contender.numerically_sound = Some(sound);
        if sound {
            return Some(k);
        }
    }
    None
}

/// Whether the gain stands when both models are fitted with half the step and half the smoothing.
fn is_numerically_sound(study: &Study, current: &Fitted, contender: &Contender) -> bool {
    // A gain as large as this is not made of integration errors below a tenth of the noise.
    if contender.comparison.inside_gain > 0.5 {
        return true;
    }
    let fine = Study {
        substeps: 2 * study.substeps,
        ..study.clone()
    };
    let again = |fitted: &Fitted| {
        let hybrid = fitted.hybrid.with_smoothing_scale(0.5);
        let start = fitted.start(fitted.inside.theta.clone());
        fine.fit(hybrid, start, 1, 6)
    };
    let comparison = Comparison::of(&again(&contender.fitted), &again(current));
    comparison.accepts()
        && (comparison.inside_gain / contender.comparison.inside_gain - 1.0).abs() < NUMERICAL
}

/// The effect of a model that is `candidate`.
fn position(fitted: &Fitted, candidate: &Candidate) -> Option<usize> {
    fitted
        .hybrid
        .effects()
        .iter()
        .position(|e| e.kind == candidate.kind && e.target == candidate.target)
}

/// The model fitted anew without one of its effects.
fn without(study: &Study, current: &Fitted, index: usize) -> Fitted {
    let range = current.hybrid.range(index);
    let theta = &current.inside.theta;
    let rest = [&theta[..range.start], &theta[range.end..]].concat();
    study.fit(current.hybrid.without(index), current.start(rest), 1, 10)
}

/// Drops what later effects have made superfluous.
fn prune(study: &Study, current: &mut Fitted, added: &mut Vec<Candidate>, report: Report) {
    added.retain(|candidate| position(current, candidate).is_some());
    let mut k = 0;
    while added.len() > 1 && k < added.len() {
        let Some(index) = position(current, &added[k]) else {
            break;
        };
        let reduced = without(study, current, index);
        let needed = Comparison::of(current, &reduced);
        if needed.inside.z < 3.0 || needed.outside.z < 1.5 || needed.inside_gain < 0.01 {
            report(&format!("dropped: {}", added[k].kind.name));
            *current = reduced;
            added.remove(k);
            k = 0;
        } else {
            k += 1;
        }
    }
}

/// Looks at every found effect once more, with all others in place: a stand-in that was accepted early gives way to what explains
/// more, and the rivals give the confidence.
fn revisit(
    study: &Study,
    current: &mut Fitted,
    added: &mut [Candidate],
    steps: &[Step],
    seed: u64,
    report: Report,
) -> Vec<Found> {
    let mut found: Vec<Found> = Vec::new();
    for k in 0..added.len() {
        let Some(index) = position(current, &added[k]) else {
            continue;
        };
        let reduced = without(study, current, index);
        let single = steps.iter().filter(|s| s.accepted.is_some()).count() == 1 && added.len() == 1;
        let rivals = if single {
            steps[0].contenders.clone()
        } else {
            report(&format!("revisiting {}", added[k].kind.name));
            let mut rivals = rivals(study, current, &reduced, added, k);
            rank(&mut rivals, seed);
            if let Some(best) = rivals.first()
                && best.added[0] != added[k]
                && best.wins > 0.9
                && Comparison::of(&best.fitted, current).inside.z > 2.0
            {
                report(&format!(
                    "{} gives way to {}",
                    added[k].kind.name, best.added[0].kind.name
                ));
                added[k] = best.added[0];
                *current = best.fitted.clone();
            }
            rivals
        };
        found.push(weigh(
            added[k],
            &rivals,
            Comparison::of(current, &reduced),
            current,
        ));
    }
    found
}

/// The found effect and its best rivals, refined beside all others.
fn rivals(
    study: &Study,
    current: &Fitted,
    reduced: &Fitted,
    added: &[Candidate],
    k: usize,
) -> Vec<Contender> {
    let screen = screen(
        &reduced.hybrid,
        &reduced.inside,
        &study.observations,
        &study.windows.fit,
        &study.scales,
        study.substeps,
    );
    let mut rivals = vec![contender(vec![added[k]], current.clone(), reduced)];
    for s in screen
        .ranked
        .iter()
        .filter(|s| s.t2 > LEAST_T2.1 && s.candidate != added[k])
        .take(3)
    {
        rivals.push(refine(study, reduced, &[(s.candidate, s.start.clone())]));
    }
    polish(study, reduced, &mut rivals);
    rivals
}

/// The confidence in a found effect among its rivals; members of one equivalence class count together.
fn weigh(
    candidate: Candidate,
    rivals: &[Contender],
    comparison: Comparison,
    model: &Fitted,
) -> Found {
    let own = rivals.iter().find(|c| c.added.contains(&candidate));
    let mut confidence = 0.0;
    let mut alternatives = Vec::new();
    let mut indistinguishable: Vec<Candidate> = Vec::new();
    for rival in rivals {
        let [other] = rival.added[..] else {
            if rival.added.contains(&candidate) {
                confidence += rival.wins;
            }
            continue;
        };
        let twin = are_twins(&candidate, &other);
        if other == candidate || twin {
            confidence += rival.wins;
        } else if rival.wins > 0.0 {
            alternatives.push((other, rival.wins));
        }
        let tied = own.is_some_and(|own| {
            other != candidate
                && Comparison::of(&own.fitted, &rival.fitted).inside.z.abs() < 2.0
                && rival.comparison.accepts()
        });
        if (twin && other != candidate) || tied {
            indistinguishable.push(other);
        }
    }
    for twin in twins_of(&candidate, model) {
        if !indistinguishable.contains(&twin) {
            indistinguishable.push(twin);
        }
    }
    Found {
        candidate,
        confidence,
        alternatives,
        indistinguishable,
        comparison,
    }
}

/// The offset class: while sliding, a constant force and a difference of Coulomb friction between the directions are one equation.
const OFFSET_CLASS: [&str; 2] = ["constant_force", "asymmetric_coulomb_friction"];

fn in_offset_class(kind: &Kind) -> bool {
    OFFSET_CLASS.contains(&kind.name)
}

fn are_twins(a: &Candidate, b: &Candidate) -> bool {
    a.target == b.target && in_offset_class(a.kind) && in_offset_class(b.kind)
}

/// The twins of a found effect in a model with Coulomb friction on the same coordinate.
fn twins_of(candidate: &Candidate, model: &Fitted) -> Vec<Candidate> {
    let rubs = model.hybrid.effects().iter().any(|e| {
        e.target == candidate.target
            && (e.kind.name == "coulomb_friction" || e.kind.name == "asymmetric_coulomb_friction")
    });
    if !in_offset_class(candidate.kind) || !rubs {
        return Vec::new();
    }
    OFFSET_CLASS
        .iter()
        .filter_map(|name| crate::effect::registry::find(name))
        .filter(|kind| *kind != candidate.kind)
        .map(|kind| Candidate {
            kind,
            target: candidate.target,
        })
        .collect()
}
