//! Forward search for what is missing: screen, refine, accept, prune, revisit.

use std::sync::OnceLock;

use super::accept::accept;
use super::candidate::Candidate;
use super::clock::of_the_inputs;
use super::comparison::{Comparison, RELIEF};
use super::found::{Found, SAME, in_order_of_contribution, position, prune, revisit};
use super::layouts::{drives, laid_out_otherwise};
use super::misfit::explained;
use super::numerics::sharp;
use super::particulars::with_particulars;
use super::pushes::{is_push, stripped, with_pushes};
use super::refine::{Contender, ITERATIONS, does_more_by, is_sensible, polish, rank};
use super::remainder::Remainder;
use super::remembering::remembering;
use super::step::{LOUD, Report, Step, Turn, is_dear, is_second_choice, may_rub, step_from};
use super::study::{Fitted, Study};
use super::undoing::{drop_undone, share_not_undone};
use super::unseen_spring::unseen_spring;
use super::unstretched::unstretched;
use super::verdict::EVEN;
use super::width::respread;
use crate::shooting::Fit;
use crate::smoothing::VISIBLE;

/// At most so many effects are named, or so many a coordinate where that is more.
const MOST_EFFECTS: (usize, usize) = (6, 3);
/// A rival's way takes another step while it has cost no more than so many times the way that it rivals.
const GENEROUS: u64 = 1;
/// What follows from something may come of the integration steps where it explains no more nats a sample. These are chosen so that they move a
/// prediction by less than a third of the noise, 0.05 nats, before it is known that an input is late by a part of one.
const OF_STEPS: f64 = 0.5;
/// A drive that no screen has seen leaves next to no residual, or none as large as this part of what there was.
const ALL: f64 = 3.0;
/// Particulars of a drive are what it is rather than another layout where they explain more by so many nats.
const AHEAD: f64 = 10.0;
/// Iterations of the initial states where a model loses its pushes or a network.
pub const STATES_ALONE: usize = 5;

/// The whole search.
#[derive(Clone)]
pub struct Search {
    /// The model as given, fitted within its tolerances.
    pub null: Fitted,
    /// The same, with the constants of the mechanism free that the search set free at its start: where it began.
    pub base: Fitted,
    /// The steps; the last one accepted nothing, unless the search was full or had done its work.
    pub steps: Vec<Step>,
    /// What was found and stood the test at the end.
    pub found: Vec<Found>,
    /// The model with it.
    pub model: Fitted,
    /// The same with a network that has learnt what is left, fitted anew; what the network could have taken over is as it is in the model.
    pub taught: Option<Fitted>,
    /// The study that it was fitted in: with shorter steps where its friction needs them.
    pub study: Study,
    /// The same names with friction that is less sharp, where the search made it sharper, and the study of that.
    pub smooth: Option<(Study, Fitted)>,
    /// What the model explains that the one it began with does not, nats.
    pub gain: f64,
    /// What it leaves, where that follows from anything.
    pub left: Option<Remainder>,
    /// Whether it was found beside pushes: then the constants are those that the model has beside them.
    pub pushed: bool,
}

impl Search {
    /// Takes back what was found: the model is the one that the search began with, fitted in `study`.
    pub fn withdraw(&mut self, study: &Study) {
        self.study = study.clone();
        self.smooth = None;
        self.found.clear();
        self.model = self.base.clone();
        self.gain = 0.0;
        self.left = self.model.left(study).cloned();
        for step in &mut self.steps {
            step.accepted = None;
        }
    }

    /// Takes back what the fit moved: the constants are those of the model as given, and its dry friction is as sharp.
    pub fn put_back(&mut self) {
        self.model.hybrid.smooth_as(&self.null.hybrid);
        let theta = self.model.hybrid.theta();
        for fit in [&mut self.model.inside, &mut self.model.outside] {
            fit.theta.clone_from(&theta);
        }
    }

    /// Whether another fit of the model with what was found explains the windows better, and what was found is in it what it is called.
    pub fn improves(&self, study: &Study, model: &Fitted) -> bool {
        let found = self.found.iter().map(|found| &found.candidate);
        improves(study, (model, &self.model), found)
    }

    /// Takes another fit of the model with what was found, in place of the one that it returns.
    pub fn refitted(&mut self, study: &Study, model: Fitted) -> Fitted {
        self.gain = Comparison::of(&model, &self.base).total();
        self.left = model.left(study).cloned();
        self.study = study.clone();
        let before = std::mem::replace(&mut self.model, model);
        self.normalise();
        before
    }

    /// The model with all that explains the windows: what was found, and a network where it was taught one.
    pub fn whole(&self) -> &Fitted {
        self.taught.as_ref().unwrap_or(&self.model)
    }

    /// Gives the parameters of what was found as people write them.
    pub fn normalise(&mut self) {
        let Fitted {
            hybrid,
            inside,
            outside,
            ..
        } = &mut self.model;
        for (index, effect) in hybrid.effects().iter().enumerate() {
            let is_found = |found: &Found| found.candidate.is(effect);
            if self.found.iter().any(is_found) {
                for theta in [&mut inside.theta, &mut outside.theta] {
                    effect.kind.normalise(&mut theta[hybrid.range(index)]);
                }
            }
        }
    }

    /// What was found beside pushes, as it is without them: constants and errors stay, residuals are those of the model itself. `base` is
    /// where the search began, fitted without pushes.
    fn without_pushes(mut self, study: &Study, base: Fitted) -> Self {
        let errors = OnceLock::from(self.model.standard_errors(study).to_vec());
        let plain = stripped(&self.model);
        let start = base.start(plain.inside.theta.clone());
        let alone = study.fit(plain.hybrid.clone(), start, STATES_ALONE, 0);
        self.model = Fitted {
            inside: Fit {
                information: plain.inside.information,
                gradients: plain.inside.gradients,
                ..alone.inside
            },
            left: self.model.left,
            errors,
            ..alone
        };
        for found in &mut self.found {
            for (_, rival) in &mut found.rivals {
                *rival = stripped(rival);
            }
        }
        self.base = base;
        self.pushed = true;
        self
    }

    /// What by its standard errors may as well do nothing is as likely as not, however much it relieves.
    pub fn doubt_what_may_do_nothing(&mut self, study: &Study) {
        let (base, model) = (&self.base, &self.model);
        let errors = model.standard_errors(study);
        for found in &mut self.found {
            let candidate = found.candidate;
            let contained = candidate.contained(&base.hybrid, &base.inside.theta);
            if !does_more_by(errors, study, &candidate, model, &contained) {
                found.believe((EVEN / found.confidence).min(1.0));
            }
        }
    }

    /// Whether what was found explains more than is left and follows from something.
    pub fn explains_most(&self) -> bool {
        let left = self.left.as_ref();
        left.is_none_or(|left| left.gain < self.gain)
    }
}

/// Whether a fit explains the windows better than an old one, and what was `added` is in it what it is called.
fn improves<'a>(
    study: &Study,
    (new, old): (&Fitted, &Fitted),
    mut added: impl Iterator<Item = &'a Candidate>,
) -> bool {
    let gain = Comparison::of(new, old);
    let better = gain.total() > 0.0 && gain.outside.z > -2.0;
    better && added.all(|candidate| is_sensible(study, candidate, new))
}

/// Whether a model has these effects.
pub fn has_names(model: &Fitted, names: &[Candidate]) -> bool {
    names.iter().all(|name| position(model, name).is_some())
}

/// Searches for what `null` is missing.
///
/// When one effect does not suffice and what joins it leaves something, the strongest rivals of the first are followed as well: a stand-in that is accepted
/// first can shut out a pair that explains more. So is friction that the log's rests show, which does better as soon as it is sharp.
///
/// Where nothing is found, it is looked for again beside pushes from outside, if there are any.
pub fn search(study: &Study, null: Fitted, seed: u64, report: Report) -> Search {
    let (base, first) = step_from(study, null.clone(), &[], Turn::First, seed, report);
    let found = if first.accepted.is_some() {
        search_from(study, base, first, seed, report)
    } else if let Some((fine, base)) = with_shorter_steps(study, &base, &[], report) {
        search(&fine, base, seed, report)
    } else if let Some(step) = laid_out(study, &base, (&first, None), seed, report) {
        search_from(study, base, step, seed, report)
    } else {
        search_again(study, base, first, seed, report)
    };
    Search { null, ..found }
}

/// A step that asks for drives in layouts that no screen has seen, where it accepts one.
fn laid_out(
    study: &Study,
    base: &Fitted,
    (first, left): (&Step, Option<&Fitted>),
    seed: u64,
    report: Report,
) -> Option<Step> {
    let mut contenders = drives(study, base, left, report);
    if contenders.is_empty() {
        return None;
    }
    polish(study, base, &mut contenders);
    let drives: Vec<Vec<Candidate>> = contenders.iter().map(|c| c.added.clone()).collect();
    // What explains as much by another name has a say.
    let others = first.contenders.iter();
    let others = others.filter(|c| !drives.contains(&c.added));
    contenders.extend(others.cloned());
    rank(&mut contenders, seed);
    let accepted = accept(study, base, &mut contenders, (true, seed))?;
    let drive = &contenders[accepted];
    let is_drive = drives.contains(&drive.added);
    // A law between two coordinates is a drive's on one of them.
    let leaves = drive.fitted.most_excess(study);
    let explains_all = leaves < LOUD || ALL * leaves < base.most_excess(study);
    (is_drive && explains_all).then(|| Step {
        screened: first.screened.clone(),
        contenders,
        accepted: Some(accepted),
    })
}

/// The search where the `first` step has accepted nothing.
fn search_again(study: &Study, base: Fitted, first: Step, seed: u64, report: Report) -> Search {
    report("asking whether pushes from outside hide anything");
    let pushed = with_pushes(study, &base);
    let start = pushed.as_ref().unwrap_or(&base);
    let (start, again) = step_from(study, start.clone(), &[], Turn::Again, seed, report);
    let again = again.or_slight(study, &start, seed);
    match pushed {
        None => search_from(study, start, again, seed, report),
        Some(_) if again.accepted.is_some() => {
            search_from(study, start, again, seed, report).without_pushes(study, base)
        }
        // What was tried on the model as given is what is told.
        Some(_) => {
            let first = first.or_slight(study, &base, seed);
            search_from(study, base, first, seed, report)
        }
    }
}

/// The search after its `first` step.
fn search_from(study: &Study, base: Fitted, first: Step, seed: u64, report: Report) -> Search {
    let mut path = Path::new(study, base.clone(), first.clone());
    let begun = study.work();
    let mut been = Vec::new();
    if let Some(k) = first.accepted {
        been = path.follow(&base, k, (Turn::Further, u64::MAX), &[], seed, report);
    }
    let most = GENEROUS * (study.work() - begun);
    // What leaves nothing that follows from anything has hardly shut out what explains more.
    let leaves = path.at.current.hint(&path.at.study, false).is_some();
    let is_unfinished = path.at.added.len() > 1 && leaves;
    let has_states = |added: &[Candidate]| added.iter().any(|c| is_dear(c.kind));
    // What has states of its own and did not stay beside the first would not beside its rivals.
    let stayed = has_states(&path.at.added);
    let shown = |k: &usize| holds(study, &base, &first.contenders[*k]);
    let rivals = rivals_of_the_first(&first, &base).into_iter();
    for k in rivals.filter(|k| is_unfinished || shown(k)) {
        let turn = match stayed || has_states(&first.contenders[k].added) {
            true => Turn::Further,
            false => Turn::Aside,
        };
        report(&format!(
            "following {} instead",
            first.contenders[k].added[0].kind.name
        ));
        let mut other = Path::new(study, base.clone(), first.clone());
        let been_by = other.follow(&base, k, (turn, most), &been, seed, report);
        if turn == Turn::Further {
            been.extend(been_by);
        }
        if other.beats(&path) {
            path = other;
        }
    }
    let simple = path.at.added.iter().all(|c| !is_second_choice(c.kind));
    let rubs = may_rub(&path.at.study, &path.at.current, false);
    if !path.at.added.is_empty() && simple && rubs {
        let alone = path.at.added.len() == 1;
        let ahead = alone.then_some((&path.at.study, &path.at.current));
        if let Some(step) = remembering(study, &base, ahead, seed, report) {
            let k = step.accepted.unwrap_or_default();
            let mut other = Path::new(study, base.clone(), step);
            other.follow(&base, k, (Turn::Further, most), &been, seed, report);
            if other.beats(&path) {
                path = other;
            }
        }
    }
    // What a drive does whose joint is read on the motor looks like many a law.
    let left = Some(&path.at.current).filter(|_| !path.at.added.is_empty());
    let unseen = left.and_then(|left| laid_out(study, &base, (&first, Some(left)), seed, report));
    if let Some(step) = unseen {
        let k = step.accepted.unwrap_or_default();
        let mut other = Path::new(study, base.clone(), step);
        other.follow(&base, k, (Turn::Further, most), &been, seed, report);
        if other.beats(&path) {
            path = other;
        }
    }
    let steps = path.steps;
    let Place {
        mut current,
        mut added,
        study,
        smooth,
    } = path.at;
    if let Some(pushed) = of_the_inputs(&study, &current, &added) {
        report("what is read late by the same everywhere is told as inputs that are late");
        (current, added) = pushed;
    }
    drop_undone(&study, &base, &mut current, &mut added, report);
    let mut found = revisit(
        &study,
        &base,
        &mut current,
        &mut added,
        &steps,
        seed,
        report,
    );
    for found in &mut found {
        if let Some((spring, model)) = unseen_spring(&study, &base, &current, found) {
            found.may_be_elastic(spring, model);
        }
    }
    report("asking whether what is left follows from anything");
    let left = current.left(&study).cloned();
    let explained = explained(&study, &base, &current);
    for found in &mut found {
        let undone = share_not_undone(&current, &found.candidate, &added);
        found.believe(explained.min(found.share_beside(left.as_ref())).min(undone));
    }
    in_order_of_contribution(&mut found);
    Search {
        gain: Comparison::of(&current, &base).total(),
        null: base.clone(),
        base,
        steps,
        found,
        smooth: smooth.filter(|(_, model)| has_names(model, &added)),
        model: current,
        taught: None,
        study,
        left,
        pushed: false,
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
        let sound = rival.is_acceptable() && rival.numerically_sound != Some(false);
        let strong = sound && rival.score - base > 0.4 * gain;
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

/// Whether it is dry friction that the rests in the log show.
fn holds(study: &Study, null: &Fitted, contender: &Contender) -> bool {
    contender.added.iter().all(|c| {
        let scales = c.scales(&null.hybrid, &study.scales);
        c.kind.dry().is_some() && !c.kind.suggested(&scales).is_empty()
    })
}

/// A set of names that a path has come to, with the score of the model that has them.
struct Been {
    added: Vec<Candidate>,
    score: f64,
}

impl Been {
    /// Whether these are the names, in whatever order.
    fn has(&self, added: &[Candidate]) -> bool {
        self.added.len() == added.len() && self.added.iter().all(|c| added.contains(c))
    }
}

/// One way from the null model on.
struct Path {
    steps: Vec<Step>,
    at: Place,
}

/// Where a path has come to.
#[derive(Clone)]
struct Place {
    added: Vec<Candidate>,
    current: Fitted,
    /// The study that the current model was fitted in.
    study: Study,
    /// Both before the friction of the current one was made sharper.
    smooth: Option<(Study, Fitted)>,
}

impl Path {
    fn new(study: &Study, null: Fitted, first: Step) -> Self {
        Path {
            steps: vec![first],
            at: Place {
                added: Vec::new(),
                current: null,
                study: study.clone(),
                smooth: None,
            },
        }
    }

    /// Takes contender `k` of the first step and goes on, by steps of this sort, until nothing is accepted, more work than `most` is done, or it comes to
    /// where `others` have been with as good a fit, from where it would go their way. Returns where it has been.
    fn follow(
        &mut self,
        null: &Fitted,
        k: usize,
        (turn, most): (Turn, u64),
        others: &[Been],
        seed: u64,
        report: Report,
    ) -> Vec<Been> {
        let begun = self.at.study.work();
        let mut next = Some(k);
        let mut been = vec![self.at.been()];
        while let Some(k) = next {
            let place = self.at.clone();
            if let Some(step) = self.steps.last_mut() {
                step.accepted = Some(k);
                let accepted = step.contenders[k].clone();
                self.at.take(null, accepted, report);
            }
            // What is taken and dropped at once would be taken again, and so on; and what it pushed out before it went was there for a reason.
            let here = self.at.been();
            if been.iter().any(|old| old.has(&here.added)) {
                if place.added.len() > here.added.len() {
                    self.at = place;
                }
                if let Some(step) = self.steps.last_mut() {
                    step.accepted = None;
                }
                break;
            }
            let as_good = |old: &Been| old.has(&here.added) && here.score < old.score + SAME;
            let known = others.iter().any(as_good);
            let (least, each) = MOST_EFFECTS;
            let full = here.added.len() >= least.max(each * null.hybrid.nv());
            been.push(here);
            if known || full || self.at.study.work() - begun > most {
                break;
            }
            let at = self.at.current.clone();
            let (study, steps) = (&self.at.study, &self.steps);
            let (current, step) = step_from(study, at, steps, turn, seed, report);
            self.at.current = current;
            next = step.accepted;
            self.steps.push(step);
        }
        been
    }

    /// Whether this model explains the windows better, or as well with fewer constants or with those given less stretched.
    fn beats(&self, other: &Path) -> bool {
        let (own, other) = (&self.at.current, &other.at.current);
        let comparison = Comparison::of(own, other);
        let (z_in, z_out) = (comparison.inside.z, comparison.outside.z);
        // Of as many constants those of fewer effects.
        let size = |model: &Fitted| (model.inside.free.len(), model.hybrid.effects().len());
        let simpler = size(own) < size(other);
        let better = z_in > 2.0 && z_out > -2.0 && comparison.total() > 0.0;
        let as_well = z_in > -2.0 && comparison.is_borne_out() && comparison.relief > -RELIEF;
        let less_stretched = comparison.relieves() && comparison.total() > 0.0;
        better || less_stretched || (simpler && as_well)
    }
}

impl Place {
    fn been(&self) -> Been {
        Been {
            added: self.added.clone(),
            score: self.current.score(0),
        }
    }

    fn take(&mut self, null: &Fitted, accepted: Contender, report: Report) {
        let added = accepted.added.clone();
        for candidate in &added {
            report(&format!(
                "accepted: {} (z {:.1}, held out {:.1})",
                candidate.kind.name, accepted.comparison.inside.z, accepted.comparison.outside.z
            ));
        }
        self.added.extend(accepted.added);
        self.current = accepted.fitted;
        self.smooth = None;
        prune(
            &self.study,
            null,
            &mut self.current,
            &mut self.added,
            report,
        );
        for candidate in &added {
            self.lay_out(null, candidate, report);
        }
        self.unstretch();
        self.sharpen();
        self.respread();
        self.settle();
        let shorter = with_shorter_steps(&self.study, &self.current, &self.added, report);
        if let Some(shorter) = shorter {
            (self.study, self.current) = shorter;
        }
    }

    /// What a drive leaves that is laid out in another way than it is named, or has particulars, is not missing.
    fn lay_out(&mut self, null: &Fitted, candidate: &Candidate, report: Report) {
        let (study, current) = (&self.study, &self.current);
        let particulars = |model: &Fitted| with_particulars(study, model, candidate);
        let laid_out = laid_out_otherwise(study, null, current, candidate);
        let laid_out = laid_out.map(|model| particulars(&model).unwrap_or(model));
        let particular = particulars(current);
        let score = |model: &Fitted| {
            let (new, old) = (model.inside.free.len(), current.inside.free.len());
            model.score(new.saturating_sub(old))
        };
        // Of a load alone a motor that is next to nothing, with friction, swings as one within the mass does: what is only as good is laid out otherwise.
        let is_laid_out = match (&laid_out, &particular) {
            (Some(laid_out), Some(particular)) => score(particular) < score(laid_out) + AHEAD,
            (laid_out, _) => laid_out.is_some(),
        };
        let Some(model) = (if is_laid_out { laid_out } else { particular }) else {
            return;
        };
        report(match is_laid_out {
            true => "the drive is laid out, or its motor is sized, in another way",
            false => "the drive has particulars: teeth, or friction of its motor",
        });
        self.current = model;
    }

    /// What explicit steps do to a joint that sticks, where they are too long for it, is chance.
    fn settle(&mut self) {
        let current = &self.current;
        if let Some(study) = self.study.at_rest(&current.hybrid, &current.inside.theta) {
            let start = current.start(current.inside.theta.clone());
            self.current = study.fit(current.hybrid.clone(), start, 1, ITERATIONS);
            self.study = study;
        }
    }

    /// What pulled at masses and gains before it was found need not do so beside it.
    fn unstretch(&mut self) {
        if let Some(model) = unstretched(&self.study, &self.current)
            && improves(&self.study, (&model, &self.current), self.added.iter())
        {
            self.current = model;
        }
    }

    /// What friction that sticks does and smoothed friction does not, is not missing.
    fn sharpen(&mut self) {
        let pushed = self.current.hybrid.effects().iter().any(is_push);
        if pushed || !self.study.may_sharpen {
            return;
        }
        if let Some((study, sharp)) = sharp(&self.study, &self.current, VISIBLE)
            && improves(&study, (&sharp, &self.current), self.added.iter())
        {
            let study = std::mem::replace(&mut self.study, study);
            let current = std::mem::replace(&mut self.current, sharp);
            self.smooth = Some((study, current));
        }
    }

    /// What friction leaves that changes its sign over another range of speeds than the model has it, or that does not stick at all, is not missing.
    fn respread(&mut self) {
        let pushed = self.current.hybrid.effects().iter().any(is_push);
        if !pushed
            && let Some(spread) = respread(&self.study, &self.current, &self.added)
            && improves(&self.study, (&spread, &self.current), self.added.iter())
        {
            self.current = spread;
            self.smooth = None;
        }
    }
}

/// Integration steps may be short enough for the noise, and what they miss still follow from something, as from an input that changes within one
/// of them: where half of them leave nothing beyond doubt, and what was `added` is what it is called, the study with those and the model fitted in it.
fn with_shorter_steps(
    study: &Study,
    current: &Fitted,
    added: &[Candidate],
    report: Report,
) -> Option<(Study, Fitted)> {
    let left = current.left(study)?;
    if left.gain_per_sample > OF_STEPS {
        return None;
    }
    let fine = study.with_half_the_steps();
    let start = current.start(current.inside.theta.clone());
    let again = fine.fit(current.hybrid.clone(), start, 1, ITERATIONS);
    let is_itself = |candidate: &Candidate| is_sensible(&fine, candidate, &again);
    if again.left(&fine).is_some() || !added.iter().all(is_itself) {
        return None;
    }
    report("what was left came of the length of the integration steps: half of it leaves nothing");
    Some((fine, again))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::pushes::tests::prepared_with;
    use super::super::setup::Prepared;
    use super::*;
    use crate::hybrid::Hybrid;

    #[test]
    fn two_ways_meet_where_they_have_the_same_names_in_any_order() {
        let on_the_first = |name| Candidate::named(name, 0);
        let [drag, delay, gain] =
            ["quadratic_drag", "input_delay", "input_gain_error"].map(on_the_first);
        let been = Been {
            added: vec![drag, delay],
            score: 0.0,
        };
        assert!(been.has(&[drag, delay]) && been.has(&[delay, drag]));
        let elsewhere = Candidate { target: 1, ..drag };
        for other in [
            &[drag][..],
            &[drag, gain],
            &[drag, delay, gain],
            &[elsewhere, delay],
        ] {
            assert!(!been.has(other), "{other:?}");
        }
    }

    #[test]
    fn what_by_its_errors_may_as_well_do_nothing_is_as_likely_as_not() {
        let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, 0.8);
        let [viscous, spring] =
            ["viscous_friction", "cubic_spring"].map(|name| Candidate::named(name, 0));
        let start = (null.hybrid.clone(), null.inside.theta.clone());
        let place = |(hybrid, theta): (Hybrid, Vec<f64>), candidate: &Candidate| {
            candidate.place(&hybrid, &theta, &[0.1])
        };
        let (hybrid, theta) = [viscous, spring].iter().fold(start, place);
        let model = study.fit(hybrid, null.start(theta), 1, 12);
        let found = |candidate: Candidate| Found {
            candidate,
            confidence: 0.99,
            alternatives: Vec::new(),
            indistinguishable: Vec::new(),
            rivals: Vec::new(),
            comparison: Comparison::of(&model, &null),
            unseen_spring: None,
            instead: None,
        };
        let mut search = Search {
            null: null.clone(),
            base: null.clone(),
            steps: Vec::new(),
            gain: 0.0,
            found: vec![found(viscous), found(spring)],
            model: model.clone(),
            taught: None,
            study: study.clone(),
            smooth: None,
            left: None,
            pushed: false,
        };
        search.doubt_what_may_do_nothing(&study);
        let believed: Vec<f64> = search.found.iter().map(|f| f.confidence).collect();
        assert_eq!(believed, [0.99, EVEN]);
    }
}
