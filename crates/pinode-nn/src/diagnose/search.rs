//! Forward search for what is missing: screen, refine, accept, prune, revisit.

use super::candidate::Candidate;
use super::found::{Found, prune, revisit};
use super::refine::{
    Contender, FIRST_LOOK, ITERATIONS, polish, rank, refine, refine_one, would_relieve,
};
use super::remainder::Remainder;
use super::score::samples_per_window;
use super::screen::{self, Screen, Screened, ScreenedPair};
use super::study::{Comparison, Fitted, RELIEF, Study};
use crate::effect::{Family, Kind};
use crate::hybrid::Placed;

/// At most so many effects are named.
const MOST_EFFECTS: usize = 4;
/// So many candidates of a screen are refined.
const REFINED: usize = 5;
/// So many times, while that explains less than it leaves.
const BATCHES: usize = 3;
/// So many candidates with states of their own, where others leave something to explain …
const SECOND_CHOICES: usize = 3;
/// … if the screen promises them this share of what it promises the best of the others.
const RIVALLING: f64 = 0.5;
/// A candidate is refined when the screen promises it so many nats a sample: a fifth of the least gain that counts, for what is far from
/// linear gains more than its linearisation promises; and that gain itself beside what was found, if that leaves nothing that follows from anything.
const PROMISED: (f64, f64) = (0.01, 0.05);
/// Least t² in the first screen, and in later ones.
pub const LEAST_T2: (f64, f64) = (4.0, 6.0);
/// So many candidates that stretched constants imitate are refined beside them.
const RELIEVING: usize = 4;
/// Candidates with 1 − ρ² below this look alike to the screen.
const ALIKE: f64 = 0.02;
/// A gain that loses more than this share when the numerics are refined is numerical. One that grows was held back by them.
const NUMERICAL: f64 = 0.3;

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
    /// What that leaves, where it follows from anything.
    pub left: Option<Remainder>,
}

/// Residual over sensor noise beyond which a model does not explain the data: on a displacement, on an angle.
pub const UNEXPLAINED: (f64, f64) = (1.6, 5.0);

/// What the search tells of its progress.
pub type Report<'a> = &'a dyn Fn(&str);

impl Search {
    /// Takes back what was found: the model is the one given.
    pub fn withdraw(&mut self, study: &Study) {
        self.found.clear();
        self.model = self.null.clone();
        self.left = self.model.left(study).cloned();
        for step in &mut self.steps {
            step.accepted = None;
        }
    }

    /// Whether what was found explains more than is left and follows from something.
    pub fn explains_most(&self) -> bool {
        let gain = Comparison::of(&self.model, &self.null).total();
        self.left.as_ref().is_none_or(|left| left.gain < gain)
    }
}

/// Searches for what `null` is missing.
///
/// When one effect does not suffice, the strongest rivals of the first are followed as well: a stand-in that is accepted first can
/// shut out a pair that explains more.
pub fn search(study: &Study, null: Fitted, seed: u64, report: Report) -> Search {
    let first = one_step(study, &null, true, seed, report);
    let mut path = Path::new(null.clone(), first.clone());
    if let Some(k) = first.accepted {
        path.follow(study, &null, k, seed, report);
    }
    if path.added.len() > 1 {
        for k in rivals_of_the_first(&first, &null) {
            report(&format!(
                "following {} instead",
                first.contenders[k].added[0].kind.name
            ));
            let mut other = Path::new(null.clone(), first.clone());
            other.follow(study, &null, k, seed, report);
            if other.beats(&path) {
                path = other;
            }
        }
    }
    // What is found first may be a small part of what friction with a memory does.
    let simple = path.added.iter().all(|c| !is_second_choice(c.kind));
    let left = path.current.hint(study, false);
    let rubs = left.is_some_and(Remainder::may_be_friction);
    if !path.added.is_empty() && simple && rubs {
        report("asking for friction with a memory instead");
        let screened = screen::screen(study, &null, is_second_choice).ranked;
        let promising = screened.iter().filter(|s| s.t2 > LEAST_T2.0);
        let mut contenders = refine_dear(study, &null, promising, report);
        rank(&mut contenders, seed);
        if let Some(k) = accept(study, &null, &mut contenders, seed) {
            let step = Step {
                screened,
                contenders,
                accepted: Some(k),
            };
            let mut other = Path::new(null.clone(), step);
            other.follow(study, &null, k, seed, report);
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
    let mut found = revisit(study, &null, &mut current, &mut added, &steps, seed, report);
    report("asking whether what is left follows from anything");
    let left = current.left(study).cloned();
    let explained = explained(study, &null, &current);
    for found in &mut found {
        found.believe(explained.min(found.share_beside(left.as_ref())));
    }
    Search {
        null,
        steps,
        found,
        model: current,
        left,
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
        let strong = rival.is_acceptable() && rival.score - base > 0.4 * gain;
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
    fn follow(&mut self, study: &Study, null: &Fitted, k: usize, seed: u64, report: Report) {
        let mut next = Some(k);
        while let Some(k) = next {
            if let Some(step) = self.steps.last_mut() {
                step.accepted = Some(k);
                let accepted = step.contenders[k].clone();
                self.take(study, null, accepted, report);
            }
            if self.added.len() >= MOST_EFFECTS {
                break;
            }
            let step = one_step(study, &self.current, false, seed, report);
            next = step.accepted;
            self.steps.push(step);
        }
    }

    fn take(&mut self, study: &Study, null: &Fitted, accepted: Contender, report: Report) {
        for candidate in &accepted.added {
            report(&format!(
                "accepted: {} (z {:.1}, held out {:.1})",
                candidate.kind.name, accepted.comparison.inside.z, accepted.comparison.outside.z
            ));
        }
        self.added.extend(accepted.added);
        self.current = accepted.fitted;
        prune(study, null, &mut self.current, &mut self.added, report);
    }

    /// Whether this model explains the windows better, or as well with fewer constants.
    fn beats(&self, other: &Path) -> bool {
        let comparison = Comparison::of(&self.current, &other.current);
        let (z_in, z_out) = (comparison.inside.z, comparison.outside.z);
        let simpler = self.current.inside.free.len() < other.current.inside.free.len();
        (z_in > 2.0 && z_out > -2.0) || (simpler && z_in > -2.0 && z_out > 0.0)
    }
}

/// Friction that remembers does what friction without a memory does, and more.
pub fn is_second_choice(kind: &Kind) -> bool {
    kind.family == Family::Memory
}

/// What has states of its own takes many times the time of what has none: it is tried where that leaves something to explain.
fn is_dear(kind: &Kind) -> bool {
    kind.states() > 0
}

fn one_step(study: &Study, current: &Fitted, first: bool, seed: u64, report: Report) -> Step {
    let effects = current.hybrid.effects();
    // What contains a law with a memory that is there is the next thing to ask.
    let contains = |kind: &Kind| {
        let contained = |e: &Placed| is_dear(e.kind) && kind.contains.contains(&e.kind.name);
        effects.iter().any(contained)
    };
    let is_simple = |kind: &Kind| !is_dear(kind) || contains(kind);
    let mut screen = screen::screen(study, current, is_simple);
    let least = if first { LEAST_T2.0 } else { LEAST_T2.1 };
    let mut step = Step {
        screened: Vec::new(),
        contenders: Vec::new(),
        accepted: None,
    };
    let samples = current.inside_scores.len() as f64 * samples_per_window(&current.inside);
    let per_sample = |s: &Screened| s.gain / samples;
    let enough = match first || current.hint(study, first).is_some() {
        true => PROMISED.0,
        false => PROMISED.1,
    };
    let promising: Vec<&Screened> = screen
        .ranked
        .iter()
        .filter(|s| s.t2 > least && per_sample(s) > enough)
        .collect();
    for (batch, chosen) in batches(&promising).enumerate() {
        let mut chosen = chosen.to_vec();
        // What stretched tolerances imitate leaves no residual for the screen to see.
        if batch == 0 && current.inside.stretch > RELIEF {
            let mut imitated: Vec<&Screened> = screen
                .ranked
                .iter()
                .filter(|s| would_relieve(s) && !chosen.contains(s))
                .collect();
            imitated.sort_by(|a, b| b.relief.total_cmp(&a.relief));
            chosen.extend(imitated.into_iter().take(RELIEVING));
        }
        for s in &chosen {
            report(&format!("refining {}", s.candidate.kind.name));
            step.contenders
                .push(refine_one(study, current, s, FIRST_LOOK));
        }
        polish(study, current, &mut step.contenders);
        rank(&mut step.contenders, seed);
        let alike = lookalikes(study, current, &screen, &step.contenders, report);
        step.contenders.extend(alike);
        step.choose(study, current, seed);
        if step.explains_more_than(step.best(current).hint(study, first)) {
            break;
        }
    }
    if let Some(left) = step.best(current).hint(study, first).cloned() {
        // Friction explains what nothing else does: beside a law that is accepted for what it explains it is asked in the end.
        let firm = step.accepted().is_some_and(|c| c.comparison.explains());
        let friction = !firm && left.may_be_friction();
        let dear = screen::screen(study, current, |kind| {
            !is_simple(kind) && (friction || !is_second_choice(kind))
        })
        .ranked;
        let leading = step.accepted().and_then(|c| {
            let same = |s: &&Screened| s.candidate == c.added[0];
            screen.ranked.iter().find(same).map(|s| s.gain)
        });
        let enough = RIVALLING * leading.unwrap_or(0.0);
        let rivals = dear.iter().filter(|s| s.t2 > least && s.gain > enough);
        let refined = refine_dear(study, current, rivals, report);
        step.contenders.extend(refined);
        step.choose(study, current, seed);
        screen.ranked.extend(dear);
        if step.accepted.is_none() {
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
            if let Some(k) = accept(study, current, &mut joint, seed) {
                step.contenders = joint;
                step.accepted = Some(k);
            }
        }
    }
    step.screened = screen.ranked;
    step
}

/// What is refined at once, at least once: [`REFINED`] candidates, and as many again while they explain less than they leave.
fn batches<'a, T>(promising: &'a [T]) -> impl Iterator<Item = &'a [T]> {
    let first = promising.len().min(REFINED);
    let (first, rest) = promising.split_at(first);
    std::iter::once(first)
        .chain(rest.chunks(REFINED))
        .take(BATCHES)
}

impl Step {
    fn accepted(&self) -> Option<&Contender> {
        self.contenders.get(self.accepted?)
    }

    /// The model with what is accepted, else `current`.
    fn best<'a>(&'a self, current: &'a Fitted) -> &'a Fitted {
        self.accepted().map_or(current, |c| &c.fitted)
    }

    fn choose(&mut self, study: &Study, current: &Fitted, seed: u64) {
        rank(&mut self.contenders, seed);
        self.accepted = accept(study, current, &mut self.contenders, seed);
    }

    /// Whether what is accepted explains more than it leaves.
    fn explains_more_than(&self, left: Option<&Remainder>) -> bool {
        let explained = self.accepted().map_or(0.0, |c| c.comparison.total());
        left.is_none_or(|left| left.gain < explained)
    }
}

/// The best candidates with states of their own, refined.
fn refine_dear<'a>(
    study: &Study,
    current: &Fitted,
    promising: impl Iterator<Item = &'a Screened>,
    report: Report,
) -> Vec<Contender> {
    let refined = promising.take(SECOND_CHOICES).map(|s| {
        report(&format!("refining {}", s.candidate.kind.name));
        refine_one(study, current, s, ITERATIONS)
    });
    let mut refined: Vec<Contender> = refined.collect();
    polish(study, current, &mut refined);
    refined
}

/// What looks like the best contender and was not refined: the data may not tell them apart, which has to be said.
pub fn lookalikes(
    study: &Study,
    current: &Fitted,
    screen: &Screen,
    contenders: &[Contender],
    report: Report,
) -> Vec<Contender> {
    let Some(best) = contenders.iter().find(|c| c.is_acceptable()) else {
        return Vec::new();
    };
    let refined = |c: &Candidate| contenders.iter().any(|other| other.added[..] == [*c]);
    let alike = screen.lookalikes(&best.added[0], ALIKE);
    let new = alike.into_iter().filter(|s| !refined(&s.candidate));
    new.take(2)
        .map(|s| {
            report(&format!("refining {}", s.candidate.kind.name));
            refine_one(study, current, s, ITERATIONS)
        })
        .collect()
}

/// The largest residual of a channel over its limit, in units of the sensor's noise: on a displacement, on an angle.
fn misfit(study: &Study, fitted: &Fitted, (linear, angular): (f64, f64)) -> f64 {
    let coordinates = fitted.hybrid.mechanics().coordinates();
    let excess = fitted.excess(&study.observations);
    let channels = excess.into_iter().zip(&study.observations.channels);
    channels
        .map(
            |(excess, channel)| match coordinates[channel.coordinate].angular {
                true => excess / angular,
                false => excess / linear,
            },
        )
        .fold(0.0, f64::max)
}

/// Whether a residual is larger than its limit.
pub fn is_unexplained(study: &Study, fitted: &Fitted, limits: (f64, f64)) -> bool {
    misfit(study, fitted, limits) > 1.0
}

/// The share of the misfit of `null` that `model` explains, on a logarithmic scale: 1 where what is left does not exceed
/// [`UNEXPLAINED`], 0 where nothing is explained. A name for a small part of a large misfit may stand in for what is really missing.
pub fn explained(study: &Study, null: &Fitted, model: &Fitted) -> f64 {
    let of = |fitted| misfit(study, fitted, UNEXPLAINED);
    let (before, after) = (of(null), of(model));
    if after <= 1.0 {
        1.0
    } else if after < before {
        (before / after).ln() / before.ln()
    } else {
        0.0
    }
}

/// The best contender whose gain is significant on both sides and not numerical.
fn accept(
    study: &Study,
    current: &Fitted,
    contenders: &mut [Contender],
    seed: u64,
) -> Option<usize> {
    let mut accepted = None;
    for k in 0..contenders.len() {
        let contender = &mut contenders[k];
        if !contender.is_acceptable() {
            continue;
        }
        let sound = is_numerically_sound(study, current, contender);
        contender.numerically_sound = Some(sound);
        if sound {
            accepted = Some(simpler(contenders, k).unwrap_or(k));
            break;
        }
    }
    // Without those that were found to be numerical; the order stays.
    rank(contenders, seed);
    accepted
}

/// The best accepted contender with fewer constants than the `k`th, unless the `k`th would be accepted beside it: a name with more
/// constants earns its place against one with fewer as it would against none.
pub fn simpler(contenders: &[Contender], k: usize) -> Option<usize> {
    let best = &contenders[k];
    let constants = |c: &Contender| c.fitted.inside.free.len();
    contenders.iter().position(|other| {
        constants(other) < constants(best)
            && other.is_acceptable()
            && !Comparison::of(&best.fitted, &other.fitted).explains()
    })
}

/// Whether the gain stands when both models are fitted with half the step and half the smoothing.
fn is_numerically_sound(study: &Study, current: &Fitted, contender: &Contender) -> bool {
    // A gain as large as this is not made of integration errors below a tenth of the noise.
    if contender.comparison.inside_gain > 0.5 || contender.imitated {
        return true;
    }
    let fine = Study {
        finer: 2,
        ..study.clone()
    };
    let again = |fitted: &Fitted| {
        let hybrid = fitted.hybrid.with_smoothing_scale(0.5);
        let start = fitted.start(fitted.inside.theta.clone());
        fine.fit(hybrid, start, 1, 6)
    };
    let finer = Comparison::of(&again(&contender.fitted), &again(current));
    (finer.explains() || (contender.comparison.relieves() && finer.relieves()))
        && finer.total() > (1.0 - NUMERICAL) * contender.comparison.total()
}
