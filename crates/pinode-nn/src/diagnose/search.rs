//! Forward search for what is missing: screen, refine, accept, prune, revisit.

use super::candidate::Candidate;
use super::confidence::wins;
use super::screen::{Screened, ScreenedPair, screen};
use super::study::{Comparison, Fitted, RELIEF, Study};
use crate::effect::Kind;

/// At most so many effects are named.
const MOST_EFFECTS: usize = 4;
/// So many candidates of a screen are refined.
const REFINED: usize = 5;
/// Least t² in the first screen, and in later ones.
const LEAST_T2: (f64, f64) = (4.0, 6.0);
/// A candidate with this share of its information spanned by free constants is one that they imitate.
const IMITATED: f64 = 0.9;
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
///
/// When one effect does not suffice, the strongest rivals of the first are followed as well: a stand-in that is accepted first can
/// shut out a pair that explains more.
pub fn search(study: &Study, null: Fitted, seed: u64, report: Report) -> Search {
    let first = one_step(study, &null, true, seed, report);
    let mut path = Path::new(null.clone(), first.clone());
    if let Some(k) = first.accepted {
        path.follow(study, k, seed, report);
    }
    if path.added.len() > 1 {
        for k in rivals_of_the_first(&first, &null) {
            report(&format!(
                "following {} instead",
                first.contenders[k].added[0].kind.name
            ));
            let mut other = Path::new(null.clone(), first.clone());
            other.follow(study, k, seed, report);
            if other.beats(&path) {
                path = other;
            }
        }
    }
    let Path {
        mut current,
        mut added,
        steps,
    } = path;
    let found = revisit(study, &mut current, &mut added, &steps, seed, report);
    Search {
        null,
        steps,
        found,
        model: current,
    }
}

/// Contenders of the first step, of other kinds than the accepted one, that would have been accepted themselves and gain nearly half
/// as much; at most two. Of kinds that contain one another the simplest stands for all.
fn rivals_of_the_first(first: &Step, null: &Fitted) -> Vec<usize> {
    let Some(accepted) = first.accepted else {
        return Vec::new();
    };
    let base = null.score(0);
    let gain = first.contenders[accepted].score - base;
    let root = |k: usize| {
        let added = first.contenders[k].added[0];
        (
            added
                .kind
                .contains
                .first()
                .copied()
                .unwrap_or(added.kind.name),
            added.target,
        )
    };
    let mut rivals: Vec<usize> = Vec::new();
    for (k, rival) in first.contenders.iter().enumerate() {
        let strong = rival.comparison.accepts() && rival.score - base > 0.4 * gain;
        if !strong || root(k) == root(accepted) {
            continue;
        }
        match rivals.iter_mut().find(|other| root(**other) == root(k)) {
            Some(other) => {
                if rival.added[0].kind.contains.is_empty() {
                    *other = k;
                }
            }
            None => rivals.push(k),
        }
    }
    rivals.truncate(2);
    rivals
}

/// One way from the null model on.
struct Path {
    steps: Vec<Step>,
    added: Vec<Candidate>,
    current: Fitted,
}

impl Path {
    fn new(null: Fitted, first: Step) -> Self {
        Path {
            steps: vec![first],
            added: Vec::new(),
            current: null,
        }
    }

    /// Takes contender `k` of the first step and goes on until nothing is accepted.
    fn follow(&mut self, study: &Study, k: usize, seed: u64, report: Report) {
        let mut next = Some(k);
        while let Some(k) = next {
            if let Some(step) = self.steps.last_mut() {
                step.accepted = Some(k);
                let accepted = step.contenders[k].clone();
                self.take(study, accepted, report);
            }
            if self.added.len() >= MOST_EFFECTS {
                break;
            }
            let step = one_step(study, &self.current, false, seed, report);
            next = step.accepted;
            self.steps.push(step);
        }
    }

    fn take(&mut self, study: &Study, accepted: Contender, report: Report) {
        for candidate in &accepted.added {
            report(&format!(
                "accepted: {} (z {:.1}, held out {:.1})",
                candidate.kind.name, accepted.comparison.inside.z, accepted.comparison.outside.z
            ));
        }
        self.added.extend(accepted.added);
        self.current = accepted.fitted;
        prune(study, &mut self.current, &mut self.added, report);
    }

    /// Whether this model explains the windows better, or as well with fewer constants.
    fn beats(&self, other: &Path) -> bool {
        let comparison = Comparison::of(&self.current, &other.current);
        let (z_in, z_out) = (comparison.inside.z, comparison.outside.z);
        let simpler = self.current.inside.free.len() < other.current.inside.free.len();
        (z_in > 2.0 && z_out > -2.0) || (simpler && z_in > -2.0 && z_out > 0.0)
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
    let mut chosen: Vec<&Screened> = screen
        .ranked
        .iter()
        .filter(|s| s.t2 > least)
        .take(REFINED)
        .collect();
    // What stretched tolerances imitate leaves no residual for the screen to see.
    if current.inside.stretch > RELIEF {
        let mut imitated: Vec<&Screened> = screen
            .ranked
            .iter()
            .filter(|s| s.spanned > IMITATED && !chosen.contains(s))
            .collect();
        imitated.sort_by(|a, b| b.spanned.total_cmp(&a.spanned));
        chosen.extend(imitated.into_iter().take(2));
    }
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
            return Some(simpler(contenders, k).unwrap_or(k));
        }
    }
    None
}

/// The best accepted contender with fewer constants than the `k`th, unless the `k`th would be accepted beside it: a name with more
/// constants earns its place against one with fewer as it would against none.
fn simpler(contenders: &[Contender], k: usize) -> Option<usize> {
    let best = &contenders[k];
    let constants = |c: &Contender| c.fitted.inside.free.len();
    contenders.iter().position(|other| {
        constants(other) < constants(best)
            && other.comparison.accepts()
            && !Comparison::of(&best.fitted, &other.fitted).accepts()
    })
}

/// Whether the gain stands when both models are fitted with half the step and half the smoothing.
fn is_numerically_sound(study: &Study, current: &Fitted, contender: &Contender) -> bool {
    // A gain as large as this is not made of integration errors below a tenth of the noise.
    if contender.comparison.inside_gain > 0.5 || contender.comparison.relieves() {
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
        let explains = needed.inside.z > 3.0 && needed.outside.z > 1.5 && needed.inside_gain > 0.01;
        if !explains && !needed.relieves() {
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
            let own = rivals.iter().position(|r| r.added[0] == added[k]);
            if let Some(simple) = own.and_then(|own| simpler(&rivals, own)) {
                added[k] = rivals[simple].added[0];
                *current = rivals[simple].fitted.clone();
            } else if let Some(best) = rivals.first()
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
        // A kind that contains the found one always fits as well: the simpler name is meant, and its wins are this one's.
        let contains =
            other.target == candidate.target && other.kind.contains.contains(&candidate.kind.name);
        if other == candidate || twin || contains {
            confidence += rival.wins;
        } else if rival.wins > 0.0 {
            alternatives.push((other, rival.wins));
        }
        let tied = own.is_some_and(|own| {
            other != candidate
                && !contains
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
