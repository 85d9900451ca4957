//! One step of the search for what is missing: screen, refine, accept.

use rayon::prelude::*;

use super::accept::accept;
use super::candidate::Candidate;
use super::comparison::RELIEF;
use super::refine::{
    Contender, FIRST_LOOK, ITERATIONS, polish, polish_behind, rank, refine, refine_from,
    refine_one, would_relieve,
};
use super::released::in_place_of;
use super::remainder::Remainder;
use super::score::samples_per_window;
use super::screen::{self, Screen, Screened};
use super::several::{Several, several};
use super::study::{Fitted, Study};
use crate::effect::{Family, Kind};
use crate::hybrid::Placed;

/// Candidates of a screen are refined first that are promised this share of what the best is; at most so many at once …
const CLOSE: f64 = 0.2;
const REFINED: usize = 5;
/// … then as many of the others where what is accepted leaves a hint of more, and again, so many times in all, where it leaves more than it
/// explains.
const BATCHES: usize = 2;
/// So many candidates with states of their own, where others leave something to explain …
pub const SECOND_CHOICES: usize = 3;
/// … if the screen promises them this share of what it promises the best of the others.
const RIVALLING: f64 = 0.5;
/// A candidate is refined when the screen promises it so many nats a sample: a fifth of the least gain that counts, for what is far from
/// linear gains more than its linearisation promises; and that gain itself beside what was found, if that leaves nothing that follows from anything.
const PROMISED: (f64, f64) = (0.01, 0.05);
/// Least t² in the first screen, and in later ones.
pub const LEAST_T2: (f64, f64) = (4.0, 6.0);
/// … and of what promises this share of what the best is: blows are in few windows, and t² is at most their number.
const RARE: (f64, f64) = (2.0, 0.33);
/// So many candidates that stretched constants imitate are refined beside them.
const RELIEVING: usize = 4;
/// So many kinds are refined on all inputs at once.
const FLEETS: usize = 2;
/// So many pairs are refined, where nothing is accepted.
const PAIRS: usize = 4;
/// Candidates with 1 − ρ² below this look alike to the screen.
const ALIKE: f64 = 0.02;
/// Residuals of so many times the noise are no noise, whether they follow from anything or not …
pub const LOUD: f64 = 1.5;
/// … and a model with residuals of so many times is far from the log.
pub const FAR: f64 = 5.0;

/// One step of the search.
#[derive(Clone, Default)]
pub struct Step {
    /// The screen: what is simple, best first, then what has states of its own, where that was asked.
    pub screened: Vec<Screened>,
    /// What was refined, best first.
    pub contenders: Vec<Contender>,
    /// Which of them was accepted.
    pub accepted: Option<usize>,
}

/// What the search tells of its progress.
pub type Report<'a> = &'a dyn Fn(&str);

/// Friction that remembers does what friction without a memory does, and more.
pub fn is_second_choice(kind: &Kind) -> bool {
    kind.family == Family::Memory
}

/// Whether friction of any sort may be what a model is missing: what it leaves may be some. So may what follows from nothing and is loud, where the model has dry friction:
/// roll-outs that stick and slip by chance leave no shape.
pub fn may_rub(study: &Study, fitted: &Fitted, first: bool) -> bool {
    let is_dry = |e: &Placed| e.kind.dry().is_some();
    match fitted.hint(study, first) {
        Some(left) => left.may_be_friction(),
        None => is_loud(study, fitted) && fitted.hybrid.effects().iter().any(is_dry),
    }
}

/// Whether a model leaves residuals far above the noise.
fn is_loud(study: &Study, fitted: &Fitted) -> bool {
    fitted.most_excess(study) > LOUD
}

/// What has states of its own takes many times the time of what has none: it is tried where that leaves something to explain.
pub fn is_dear(kind: &Kind) -> bool {
    kind.states() > 0
}

/// Which step it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// The first look at the model as given.
    First,
    /// Another look at it, where the first has found nothing: then everything is asked.
    Again,
    /// A look for what is there beside what was found.
    Further,
    /// The same beside what a rival found, for what has no states of its own.
    Aside,
}

impl Turn {
    /// Whether nothing was found before.
    fn is_first(self) -> bool {
        matches!(self, Turn::First | Turn::Again)
    }
}

/// One step: what is missing in `current`, after the steps `before`.
fn one_step(
    study: &Study,
    current: &Fitted,
    before: &[&Step],
    turn: Turn,
    seed: u64,
    report: Report,
) -> Step {
    let looking = Looking {
        study,
        current,
        before,
        first: turn.is_first(),
        seed,
        report,
    };
    let effects = current.hybrid.effects();
    // What contains a law with a memory that is there is the next thing to ask.
    let contains = |kind: &Kind| {
        let contained = |e: &Placed| is_dear(e.kind) && kind.contains.contains(&e.kind.name);
        effects.iter().any(contained)
    };
    let is_simple = |kind: &Kind| !is_dear(kind) || contains(kind);
    let mut screen = screen::screen(study, current, is_simple);
    let mut step = Step::default();
    looking.ask_the_simple(&screen, &mut step);
    let left = looking.hint(&step);
    // What is there beyond doubt shows without pushes; all else is asked once, beside them.
    let shows = left.as_ref().is_some_and(Remainder::is_significant);
    if turn == Turn::First && step.accepted.is_none() && !shows {
        step.screened = screen.ranked;
        return step;
    }
    // The blows of a play look like no law of what was measured.
    let is_worth = left.is_some()
        || looking.is_loud(&step)
        || (turn == Turn::Again && step.accepted.is_none());
    if is_worth && turn != Turn::Aside {
        // Friction explains what nothing else does: beside a law that is accepted for what it explains it is asked in the end.
        let firm = step.accepted().is_some_and(|c| c.comparison.explains());
        let friction = !firm && may_rub(study, looking.best(&step), looking.first);
        let is_asked = |kind: &Kind| !is_simple(kind) && (friction || !is_second_choice(kind));
        let dear = screen::screen(study, current, is_asked).ranked;
        looking.ask_the_dear(&screen, &dear, &mut step);
        screen.ranked.extend(dear);
    }
    // What two laws on two coordinates do together may follow from a force on neither of them. Beside what was found, what is loud and follows from nothing is
    // a push that nobody measured more often than that.
    let may_hide = left.is_some() || (turn.is_first() && looking.is_loud(&step));
    if step.accepted.is_none() && may_hide {
        looking.ask_pairs(&screen, &mut step);
    }
    step.screened = screen.ranked;
    step
}

/// Steps from `current`, to which the steps `before` led; where one constant that is not what the model says explains more than what a step accepts, or
/// where it accepts nothing, again from there. The last step, and from where it was made.
pub fn step_from(
    study: &Study,
    mut current: Fitted,
    before: &[Step],
    turn: Turn,
    seed: u64,
    report: Report,
) -> (Fitted, Step) {
    let mut passed: Vec<Step> = Vec::new();
    loop {
        let all: Vec<&Step> = before.iter().chain(&passed).collect();
        let step = one_step(study, &current, &all, turn, seed, report);
        let Some((index, released)) = in_place_of(study, &current, step.accepted()) else {
            return (current, step);
        };
        report(match current.hybrid.constants()[index].is_said {
            true => "a constant of the mechanism is not what its tolerance allows",
            false => "a constant of the energies is not what the model says",
        });
        current = released;
        passed.push(step);
    }
}

/// What one step is about.
struct Looking<'a> {
    study: &'a Study,
    current: &'a Fitted,
    /// The steps that led there.
    before: &'a [&'a Step],
    /// Whether nothing was found before.
    first: bool,
    seed: u64,
    report: Report<'a>,
}

impl Looking<'_> {
    /// The best model so far.
    fn best<'a>(&'a self, step: &'a Step) -> &'a Fitted {
        step.accepted().map_or(self.current, |c| &c.fitted)
    }

    /// What the best model so far leaves, where that is worth a search.
    fn hint(&self, step: &Step) -> Option<Remainder> {
        self.best(step).hint(self.study, self.first).cloned()
    }

    /// Whether the best model so far leaves residuals far above the noise.
    fn is_loud(&self, step: &Step) -> bool {
        is_loud(self.study, self.best(step))
    }

    /// The number of samples in the seen windows.
    fn samples(&self) -> f64 {
        let seen = &self.current.inside;
        self.current.inside_scores.len() as f64 * samples_per_window(seen)
    }

    fn least_t2(&self) -> f64 {
        if self.first { LEAST_T2.0 } else { LEAST_T2.1 }
    }

    /// Refines candidates without states of their own: those closest to the best, those that stretched constants imitate, several together, then others
    /// as long as something is left.
    fn ask_the_simple(&self, screen: &Screen, step: &mut Step) {
        let (study, current) = (self.study, self.current);
        let something_is_left = self.first || current.hint(study, self.first).is_some();
        // What contains a law with a memory is as far from linear as that.
        let [little, enough] = [PROMISED.0, PROMISED.1].map(|share| share * self.samples());
        let enough = if something_is_left { little } else { enough };
        let least = |s: &Screened| {
            if is_dear(s.candidate.kind) {
                little
            } else {
                enough
            }
        };
        let promising = screen.ranked.iter().filter(|s| s.gain > least(s));
        let best = promising.clone().next().map_or(0.0, |s| s.gain);
        let is_rare = |s: &Screened| s.t2 > RARE.0 && s.gain > RARE.1 * best;
        let promising: Vec<&Screened> = promising
            .filter(|s| s.t2 > self.least_t2() || is_rare(s))
            .collect();
        let leading = promising.first().map_or(0.0, |s| s.gain);
        let close = promising.iter().take(REFINED);
        let close = close.take_while(|s| s.gain > CLOSE * leading).count();
        let (close, others) = promising.split_at(close);
        let mut chosen = close.to_vec();
        // What stretched tolerances imitate leaves no residual for the screen to see.
        if current.inside.stretch > RELIEF {
            let mut imitated: Vec<&Screened> = screen
                .ranked
                .iter()
                .filter(|s| would_relieve(s) && !chosen.contains(s))
                .collect();
            imitated.sort_by(|a, b| b.relief.total_cmp(&a.relief));
            chosen.extend(imitated.into_iter().take(RELIEVING));
        }
        // Blows that a model does not have take its roll-outs so far away that their linearisation says nothing of them.
        let shown = screen.ranked.iter().filter(|s| s.shown);
        let new: Vec<&Screened> = shown.filter(|s| !chosen.contains(s)).collect();
        chosen.extend(new);
        self.refine_all(screen, &chosen, step);
        self.ask_several(step);
        self.ask_every_input(screen, enough, step);
        for (batch, others) in others.chunks(REFINED).take(BATCHES).enumerate() {
            match self.hint(step) {
                None => break,
                Some(left) if batch > 0 && step.explained() > left.gain => break,
                Some(_) => self.refine_all(screen, others, step),
            }
        }
    }

    /// Refines what all inputs may have in common, where that promises more than anything by itself.
    fn ask_every_input(&self, screen: &Screen, enough: f64, step: &mut Step) {
        let (study, current) = (self.study, self.current);
        let fleets = screen.fleets().into_iter();
        for fleet in fleets.filter(|fleet| fleet.gain > enough).take(FLEETS) {
            let kind = fleet.members.first().map_or("", |(c, _)| c.kind.name);
            (self.report)(&format!("refining {kind} on every input"));
            step.contenders.push(refine(study, current, &fleet.members));
            polish(study, current, &mut step.contenders);
            step.choose(study, current, (self.first, self.seed));
        }
    }

    fn refine_all(&self, screen: &Screen, chosen: &[&Screened], step: &mut Step) {
        let (study, current) = (self.study, self.current);
        let new = |s: &&&Screened| {
            let refined = &step.contenders;
            !refined.iter().any(|c| c.added[..] == [s.candidate])
        };
        let chosen: Vec<&Screened> = chosen.iter().filter(new).copied().collect();
        if !chosen.is_empty() {
            let names: Vec<&str> = chosen.iter().map(|s| s.candidate.kind.name).collect();
            (self.report)(&format!("refining {}", names.join(", ")));
        }
        let refined = chosen.par_iter();
        let refined = refined.map(|s| refine_one(study, current, s, FIRST_LOOK));
        step.contenders.par_extend(refined);
        polish(study, current, &mut step.contenders);
        rank(&mut step.contenders, self.seed);
        let alike = lookalikes(study, current, screen, &step.contenders, self.report);
        step.contenders.extend(alike);
        step.choose(study, current, (self.first, self.seed));
    }

    /// Refines what the forces that are needed say is missing together, where the model stays far from the log: there a linearisation promises more to stand-ins than
    /// to any part of it. It is accepted only where it is all that is missing: of a stand-in in parts some would stay.
    fn ask_several(&self, step: &mut Step) {
        let (study, current) = (self.study, self.current);
        if !self.first || self.best(step).most_excess(study) < FAR {
            return;
        }
        let Some(Several { theta, laws }) = several(study, current) else {
            return;
        };
        let names: Vec<&str> = laws.iter().map(|(c, _)| c.kind.name).collect();
        (self.report)(&format!("refining {} together", names.join(", ")));
        let mut together = [refine_from(study, current, &theta, &laws)];
        polish(study, current, &mut together);
        let [together] = together;
        if together.fitted.most_excess(study) < LOUD {
            step.contenders.push(together);
            step.choose(study, current, (self.first, self.seed));
        }
    }

    /// Refines candidates with states of their own, `dear`, that rival what is accepted.
    fn ask_the_dear(&self, screen: &Screen, dear: &[Screened], step: &mut Step) {
        let leading = step.accepted().and_then(|c| {
            let added = screen.ranked.iter();
            let gains = added.filter(|s| c.added.contains(&s.candidate));
            gains.map(|s| s.gain).max_by(f64::total_cmp)
        });
        let enough = (RIVALLING * leading.unwrap_or(0.0)).max(PROMISED.0 * self.samples());
        let rivals = dear.iter();
        let rivals = rivals.filter(|s| s.t2 > self.least_t2() && s.gain > enough);
        let in_vain = |s: &&Screened| self.before.iter().any(|step| step.was_in_vain(s));
        let rivals = rivals.filter(|s| !in_vain(s));
        let refined = refine_dear(
            self.study,
            self.current,
            rivals,
            f64::NEG_INFINITY,
            self.report,
        );
        step.contenders.extend(refined);
        step.choose(self.study, self.current, (self.first, self.seed));
    }

    /// Refines pairs of candidates that mask one another.
    fn ask_pairs(&self, screen: &Screen, step: &mut Step) {
        let (study, current) = (self.study, self.current);
        let mut joint: Vec<Contender> = Vec::new();
        for pair in screen.pairs(PAIRS) {
            let [(one, _), (other, _)] = &pair.members;
            let names = (one.kind.name, other.kind.name);
            (self.report)(&format!("refining {} with {}", names.0, names.1));
            joint.push(refine(study, current, &pair.members));
        }
        rank(&mut joint, self.seed);
        if let Some(k) = accept(study, current, &mut joint, (self.first, self.seed)) {
            step.contenders = joint;
            step.accepted = Some(k);
        }
    }
}

impl Step {
    /// Whether what is promised to a candidate again was promised to it here, and a fit explained nothing by it.
    fn was_in_vain(&self, again: &Screened) -> bool {
        let promised = |s: &Screened| s.candidate == again.candidate && again.gain <= s.gain;
        let failed = |c: &Contender| c.added[..] == [again.candidate] && !c.is_rival();
        self.screened.iter().any(promised) && self.contenders.iter().any(failed)
    }

    /// What was accepted.
    pub fn accepted(&self) -> Option<&Contender> {
        self.contenders.get(self.accepted?)
    }

    fn choose(&mut self, study: &Study, current: &Fitted, (first, seed): (bool, u64)) {
        rank(&mut self.contenders, seed);
        self.accepted = accept(study, current, &mut self.contenders, (first, seed));
    }

    /// What speaks for what is accepted, nats.
    fn explained(&self) -> f64 {
        self.accepted().map_or(0.0, |c| c.comparison.total())
    }
}

/// The best candidates with states of their own, refined, where something else has the score `ahead`.
pub fn refine_dear<'a>(
    study: &Study,
    current: &Fitted,
    promising: impl Iterator<Item = &'a Screened>,
    ahead: f64,
    report: Report,
) -> Vec<Contender> {
    let refined = promising.take(SECOND_CHOICES).map(|s| {
        report(&format!("refining {}", s.candidate.kind.name));
        refine_one(study, current, s, ITERATIONS)
    });
    let mut refined: Vec<Contender> = refined.collect();
    polish_behind(study, current, &mut refined, ahead);
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
    let is_there = contenders.iter().any(Contender::is_acceptable);
    let Some(best) = contenders.iter().find(|c| is_there && c.is_rival()) else {
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

#[cfg(test)]
mod tests {
    #![allow(clippy::panic)]

    use super::super::pushes::tests::prepared_with;
    use super::super::refine::contender;
    use super::super::setup::Prepared;
    use super::*;

    #[test]
    fn what_explained_nothing_is_asked_again_where_it_is_promised_more() {
        let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, 0.8);
        let ranked = screen::screen(&study, &null, |_| true).ranked;
        let [asked, another] = &ranked[..2] else {
            panic!("a brake promises something to several laws")
        };
        // A fit that changed nothing, and one that explains.
        let failed = contender(&study, vec![asked.candidate], null.clone(), &null);
        let mut rival = failed.clone();
        rival.is_sensible = true;
        for paired in [&mut rival.comparison.inside, &mut rival.comparison.outside] {
            paired.z = 9.0;
        }
        (rival.comparison.inside_gain, rival.comparison.outside_gain) = (1.0, 1.0);
        let step = |contender: &Contender| Step {
            screened: vec![asked.clone()],
            contenders: vec![contender.clone()],
            accepted: None,
        };
        let promised = |gain: f64| Screened {
            gain,
            ..asked.clone()
        };
        let (before, in_vain) = (asked.gain, step(&failed));
        assert!(in_vain.was_in_vain(&promised(before)));
        assert!(in_vain.was_in_vain(&promised(0.5 * before)));
        assert!(!in_vain.was_in_vain(&promised(1.01 * before)));
        assert!(!in_vain.was_in_vain(another), "another law");
        assert!(!step(&rival).was_in_vain(&promised(before)));
    }
}
