//! Candidates refined by fits: what each of them is worth beside the model before.

use integrators::event::Direction;
use rayon::prelude::*;

use super::candidate::Candidate;
use super::comparison::{Comparison, RELIEF, SURE};
use super::confidence::wins;
use super::contained::{instead, is_simpler};
use super::found::position;
use super::screen::Screened;
use super::shown::fit_shown;
use super::study::{Fitted, Study};
use super::unstretched::unstretched;
use super::valley::shows;
use crate::hybrid::{Hybrid, Placed};

/// A candidate with this share of its information spanned by free constants is one that they imitate.
const IMITATED: f64 = 0.9;
/// Iterations by which the starts of a candidate are compared, of the initial states and of all: of what is quickly fitted, and of what stands
/// between motor and joint, which may begin far from what it comes to.
const COMPARING: (usize, usize) = (1, 4);
const COMPARING_DRIVES: (usize, usize) = (1, 8);
/// … and one in so many of the windows.
pub const SHARE: usize = 4;
/// Iterations of a fit that refines: of a first look at what has no memory, and of all else.
pub const FIRST_LOOK: usize = 5;
pub const ITERATIONS: usize = 12;
/// Iterations of a fit that goes on, and how often it does: the leader's, a rival's.
const FURTHER: usize = 8;
const ROUNDS: [usize; 2] = [12, 4];
/// A rival goes on while it makes good this share of what it lacks in a round, the leader while one gains so many nats.
const CATCHING_UP: f64 = 0.25;
const WORTH_A_ROUND: f64 = 1.0;
/// Dry friction of which less than this share of what it is at rest is left at speed is another law, unless the rest is known exactly.
const RUBS: f64 = 0.1;
/// A rival that the leader contains and that is behind by so many nats may be held up on its way.
pub const FAR_BEHIND: f64 = 100.0;
/// A rival is fitted from where no tolerance is stretched where so many times its stretch would make good what it lacks.
const MORE_THAN_STRETCH: f64 = 2.0;

/// A candidate, or a pair of them, refined by a fit.
#[derive(Clone)]
pub struct Contender {
    /// What was added.
    pub added: Vec<Candidate>,
    /// The fitted model.
    pub fitted: Fitted,
    /// Whether it is one that the free constants imitate: then the relief of their tolerances speaks for it.
    pub imitated: bool,
    /// Against the model before.
    pub comparison: Comparison,
    /// Σ l_w − 4 k ln n.
    pub score: f64,
    /// Whether its parameters make it what it is called.
    pub is_sensible: bool,
    /// Whether a parameter of each that was added is [`SURE`] standard errors from where it does nothing.
    pub is_sure: bool,
    /// Share of 400 bootstraps over windows in which it has the best score of its step.
    pub wins: f64,
    /// Whether its gain stands under a finer integration and a narrower smoothing; `None`: not asked.
    pub numerically_sound: Option<bool>,
    /// What lets it in, or gives it a say, where it does not explain enough by itself.
    pub standing: Standing,
    /// Whether further iterations from where it is were tried and did not explain more.
    pub(super) is_spent: bool,
    /// Whether it was [fitted again](unstretched) from where no tolerance is stretched, where one was.
    pub(super) was_unstretched: bool,
}

/// What a contender has beside what it explains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// Nothing.
    Usual,
    /// The model before leaves something beyond doubt, and this one, which explains a little, nothing.
    TakesAll,
    /// It explains little, and is sure ([`slight`](super::slight)).
    Slight,
    /// It explains as little as one that is sure.
    BesideSlight,
}

impl Contender {
    /// Whether it would be accepted by itself, or is let in all the same.
    pub fn is_acceptable(&self) -> bool {
        let relieves = self.imitated && self.is_sure && self.comparison.relieves();
        let let_in = matches!(self.standing, Standing::TakesAll | Standing::Slight);
        self.is_sensible && (self.comparison.explains() || relieves || let_in)
    }

    /// Whether it has a say where another would be accepted: what is there may be the one that falls short by a little.
    pub fn is_rival(&self) -> bool {
        let beside = self.standing == Standing::BesideSlight;
        let nearly = self.is_sensible && (self.comparison.nearly_explains() || beside);
        (nearly || self.is_acceptable()) && self.numerically_sound != Some(false)
    }
}

/// Whether stretched constants imitate the candidate.
pub fn is_imitated(screened: &Screened) -> bool {
    screened.spanned > IMITATED
}

/// Whether it is imitated by constants that are stretched so far that it would be accepted in their place.
pub fn would_relieve(screened: &Screened) -> bool {
    is_imitated(screened) && screened.relief > RELIEF && screened.relieving.is_some()
}

/// The screen's candidate as a fit has it, of what has no memory after a first look of so many iterations.
pub fn refine_one(
    study: &Study,
    current: &Fitted,
    screened: &Screened,
    iterations: usize,
) -> Contender {
    let candidate = screened.candidate;
    let fitted = match screened.shown {
        true => fit_shown(study, current, candidate, &screened.starts, iterations),
        false => fit_screened(study, current, screened, iterations),
    };
    let fitted = fitted.unwrap_or_else(|| current.clone());
    Contender {
        imitated: is_imitated(screened),
        ..contender(study, vec![candidate], fitted, current)
    }
}

/// One that stretched constants imitate starts where it takes over from them: along the valley
/// between the two a fit would creep. Of several starts the one whose first iterations explain most is taken: laws with a memory are far
/// from linear in their parameters, and get no fewer than [`ITERATIONS`]. `None` without a start.
fn fit_screened(
    study: &Study,
    current: &Fitted,
    screened: &Screened,
    iterations: usize,
) -> Option<Fitted> {
    let (candidate, kind) = (screened.candidate, screened.candidate.kind);
    let iterations = match kind.states() {
        0 => iterations,
        _ => iterations.max(ITERATIONS),
    };
    let mut theta = current.inside.theta.clone();
    let mut starts = screened.starts.as_slice();
    if let Some(step) = &screened.relieving
        && ((is_imitated(screened) && !kind.starts_at_probes()) || starts.is_empty())
    {
        for (&i, shift) in current.inside.free.iter().zip(&step.shift) {
            let constant = &current.hybrid.constants()[i];
            theta[i] = (theta[i] + shift).clamp(constant.lower, constant.upper);
        }
        starts = std::slice::from_ref(&step.start);
    }
    if let [only] = starts {
        let members = [(candidate, only.clone())];
        return Some(fit_with(study, current, &theta, &members, (1, iterations)));
    }
    let (some, there) = study.some_windows(current, SHARE);
    let tried = (&there, &current.hybrid, theta.as_slice());
    let best = best_of_starts(&some, tried, candidate, starts)?;
    let start = current.start(best.inside.theta);
    Some(study.fit(best.hybrid, start, 1, iterations))
}

/// A candidate that is added to `hybrid`, with `theta` for what that has and the initial states of `current`, after the first iterations from the one of its `starts` by which they
/// explain most. `None` without a start.
pub fn best_of_starts(
    study: &Study,
    (current, hybrid, theta): (&Fitted, &Hybrid, &[f64]),
    candidate: Candidate,
    starts: &[Vec<f64>],
) -> Option<Fitted> {
    let comparing = match candidate.kind.is_transmission() {
        true => COMPARING_DRIVES,
        false => COMPARING,
    };
    let tried = starts.par_iter().map(|start| {
        let (hybrid, theta) = candidate.place(hybrid, theta, start);
        study.fit(hybrid, current.start(theta), comparing.0, comparing.1)
    });
    best(tried.collect())
}

/// The one that explains most.
pub fn best(fits: Vec<Fitted>) -> Option<Fitted> {
    let fits = fits.into_iter();
    fits.max_by(|a, b| a.score(0).total_cmp(&b.score(0)))
}

/// The model with `members`, fitted from their values, `theta` for all else and the initial states of `current`: `iterations` of the
/// states alone, then of all.
fn fit_with(
    study: &Study,
    current: &Fitted,
    theta: &[f64],
    members: &[(Candidate, Vec<f64>)],
    iterations: (usize, usize),
) -> Fitted {
    let mut hybrid = current.hybrid.clone();
    let mut theta = theta.to_vec();
    for (candidate, start) in members {
        (hybrid, theta) = candidate.place(&hybrid, &theta, start);
    }
    study.fit(hybrid, current.start(theta), iterations.0, iterations.1)
}

/// Several candidates at once.
pub fn refine(study: &Study, current: &Fitted, members: &[(Candidate, Vec<f64>)]) -> Contender {
    refine_from(study, current, &current.inside.theta, members)
}

/// The same from another θ of what was there before.
pub fn refine_from(
    study: &Study,
    current: &Fitted,
    theta: &[f64],
    members: &[(Candidate, Vec<f64>)],
) -> Contender {
    let fitted = fit_with(study, current, theta, members, (1, ITERATIONS));
    let added = members.iter().map(|m| m.0).collect();
    contender(study, added, fitted, current)
}

/// What a model fitted with `added` is worth beside `current`.
pub fn contender(
    study: &Study,
    added: Vec<Candidate>,
    fitted: Fitted,
    current: &Fitted,
) -> Contender {
    let more = fitted
        .hybrid
        .free()
        .len()
        .saturating_sub(current.inside.free.len());
    Contender {
        is_sensible: added.iter().all(|c| is_sensible(study, c, &fitted)),
        is_sure: added.iter().all(|c| is_sure(study, c, current, &fitted)),
        added,
        imitated: false,
        comparison: Comparison::of(&fitted, current),
        score: fitted.score(more),
        fitted,
        wins: 0.0,
        numerically_sound: None,
        standing: Standing::Usual,
        is_spent: false,
        was_unstretched: false,
    }
}

/// Whether a fitted effect is what it is called.
pub fn is_sensible(study: &Study, candidate: &Candidate, fitted: &Fitted) -> bool {
    let hybrid = &fitted.hybrid;
    let scales = candidate.scales(hybrid, &study.scales);
    position(fitted, candidate).is_some_and(|index| {
        let p = &fitted.inside.theta[hybrid.range(index)];
        let is_fixed =
            |e: &Placed| e.fixed && e.target == candidate.target && e.kind.dry().is_some();
        let rubs = candidate.kind.dry().is_none_or(|law| {
            let size = |speed: f64| law.size(Direction::Positive, scales.centre, speed, p);
            size(f64::INFINITY) >= RUBS * size(0.0)
        });
        let is_dry = rubs || hybrid.effects().iter().any(is_fixed);
        candidate.kind.is_itself(&scales, p) && is_dry && shows(study, fitted, candidate)
    })
}

/// Whether a fitted effect surely changes something of `current`.
fn is_sure(study: &Study, candidate: &Candidate, current: &Fitted, fitted: &Fitted) -> bool {
    let contained = candidate.contained(&current.hybrid, &current.inside.theta);
    does_more(study, candidate, fitted, &contained)
}

/// Whether a parameter of a fitted effect is surely not what it is where the effect does no more than the one that it contains, with the parameters
/// `contained`, or nothing: of those that a probe moves from there. Residuals that hang together stretch tolerances by more than their number says;
/// these errors, by the jackknife over windows, know.
pub fn does_more(study: &Study, candidate: &Candidate, fitted: &Fitted, contained: &[f64]) -> bool {
    let errors = fitted.inside.standard_errors();
    does_more_by(&errors, study, candidate, fitted, contained)
}

/// The same by standard errors in the order of `inside.free`.
pub fn does_more_by(
    errors: &[f64],
    study: &Study,
    candidate: &Candidate,
    fitted: &Fitted,
    contained: &[f64],
) -> bool {
    let Some(index) = position(fitted, candidate) else {
        return false;
    };
    let fit = &fitted.inside;
    let scales = candidate.scales(&fitted.hybrid, &study.scales);
    let probes = (candidate.kind.probes)(&scales, contained);
    let is_off = |i: usize, k: usize| {
        let error = fit
            .free
            .iter()
            .position(|&free| free == i)
            .map(|k| errors[k]);
        let far = |neutral: f64| error.is_some_and(|e| (fit.theta[i] - neutral).abs() > SURE * e);
        let mut moved = probes.iter().filter(|p| p.neutral[k] != p.perturbed[k]);
        moved.any(|probe| far(probe.neutral[k]))
    };
    let mut own = fitted.hybrid.range(index).enumerate();
    own.any(|(k, i)| is_off(i, k))
}

/// Contenders within half of the leader's gain are fitted again from the leader's initial states, so that none loses by a poor start;
/// and whoever has not converged goes on, the leader to its end, its rivals while they would catch up with it.
pub fn polish(study: &Study, current: &Fitted, contenders: &mut [Contender]) {
    polish_behind(study, current, contenders, f64::NEG_INFINITY);
}

/// The same where something else has the score `ahead_of_all`: of what is behind that the leader goes on only while it would catch up, too.
pub fn polish_behind(
    study: &Study,
    current: &Fitted,
    contenders: &mut [Contender],
    ahead_of_all: f64,
) {
    let base = current.score(0);
    let Some(ahead) = leader(contenders) else {
        return;
    };
    hand_down(study, current, &ahead, contenders);
    let leader = leader(contenders).unwrap_or(ahead);
    for rival in contenders.iter_mut() {
        // What takes over from constants that are stretched far begins far from where it ends.
        let takes_over = rival.imitated && rival.comparison.relief > leader.comparison.total();
        if !takes_over && rival.score - base < 0.5 * (leader.score - base) {
            continue;
        }
        let leads = rival.added == leader.added;
        if rival.fitted.inside.converged && !leads {
            let fitted = &rival.fitted;
            let start = leader.fitted.start(fitted.inside.theta.clone());
            let again = study.fit(fitted.hybrid.clone(), start, 1, FURTHER);
            rival.improve(study, current, again);
            continue;
        }
        let goal = leader.score.max(ahead_of_all);
        for _ in 0..ROUNDS[usize::from(!leads)] {
            let behind = goal - rival.score;
            let wanted = match leads && behind <= 0.0 {
                true => WORTH_A_ROUND,
                false => CATCHING_UP * behind,
            };
            if rival.is_spent || !rival.promises(wanted) {
                break;
            }
            let (before, fitted) = (rival.score, &rival.fitted);
            let start = fitted.start(fitted.inside.theta.clone());
            let again = study.fit(fitted.hybrid.clone(), start, 0, FURTHER);
            rival.is_spent = !rival.improve(study, current, again);
            if rival.score - before < CATCHING_UP * (goal - rival.score) {
                break;
            }
        }
    }
    unstretch(study, current, contenders);
}

/// The one with the best score.
fn leader(contenders: &[Contender]) -> Option<Contender> {
    let best = contenders.iter().max_by(|a, b| a.score.total_cmp(&b.score));
    best.cloned()
}

/// A law with one constant that the leader contains and is far behind is fitted from where that came to: with more constants a fit goes round what holds up one with
/// fewer, and where these come to nothing the leader is not what it is called, but that.
fn hand_down(study: &Study, current: &Fitted, leader: &Contender, contenders: &mut [Contender]) {
    let [rich] = leader.added[..] else {
        return;
    };
    let simpler = contenders.iter_mut().filter(|rival| match rival.added[..] {
        [simple] => {
            is_simpler(&simple, &rich, &current.hybrid) && leader.score - rival.score > FAR_BEHIND
        }
        _ => false,
    });
    for rival in simpler {
        let again = instead(study, current, (&leader.fitted, &rich), &rival.added[0]);
        if let Some(again) = again {
            rival.improve(study, current, again);
        }
    }
}

impl Contender {
    /// Whether a round of further iterations may gain so many nats: it is known what the last ones gained. Of what has states of its own nobody
    /// knows, for each round has another path of them.
    fn promises(&self, wanted: f64) -> bool {
        let fit = &self.fitted.inside;
        let moves = self.added.iter().any(|c| c.kind.states() > 0);
        !fit.converged && (moves || FURTHER as f64 * fit.gained > wanted)
    }

    /// Takes a further fit where it explains more, and says whether it does.
    fn improve(&mut self, study: &Study, current: &Fitted, again: Fitted) -> bool {
        let again = contender(study, self.added.clone(), again, current);
        let explains_more = again.score > self.score;
        if explains_more {
            *self = Contender {
                imitated: self.imitated,
                was_unstretched: self.was_unstretched,
                ..again
            };
        }
        explains_more
    }
}

/// Those without states of their own within half of the leader's gain are fitted again from where no tolerance is stretched, once: what the model without them
/// stretched is still stretched beside what could do without that. Who would not catch up with the leader by [that much](MORE_THAN_STRETCH) is left alone.
fn unstretch(study: &Study, current: &Fitted, contenders: &mut [Contender]) {
    let base = current.score(0);
    let scores = contenders.iter().map(|c| c.score - base);
    let best = scores.fold(0.0, f64::max);
    let is_simple = |c: &Contender| c.added.iter().all(|c| c.kind.states() == 0);
    let is_near = |c: &Contender| {
        let gain = c.score - base;
        gain > 0.5 * best && gain + MORE_THAN_STRETCH * c.fitted.inside.stretch > best
    };
    contenders
        .par_iter_mut()
        .filter(|c| !c.was_unstretched && is_near(c) && is_simple(c))
        .for_each(|rival| {
            rival.was_unstretched = true;
            if let Some(again) = unstretched(study, &rival.fitted) {
                rival.improve(study, current, again);
            }
        });
}

/// Orders contenders by their score, and gives the wins among those that have a say.
pub fn rank(contenders: &mut [Contender], seed: u64) {
    contenders.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut playing: Vec<&mut Contender> = Vec::new();
    for contender in contenders {
        contender.wins = 0.0;
        if contender.is_rival() {
            playing.push(contender);
        }
    }
    let scores: Vec<(&[f64], f64)> = playing
        .iter()
        .map(|c| {
            let sum: f64 = c.fitted.inside_scores.iter().sum();
            (c.fitted.inside_scores.as_slice(), sum - c.score)
        })
        .collect();
    let wins = wins(&scores, seed);
    for (contender, wins) in playing.iter_mut().zip(wins) {
        contender.wins = wins;
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::pushes::tests::prepared_with;
    use super::super::setup::Prepared;
    use super::*;
    use crate::hybrid::Hybrid;

    /// The simpler law had been left where its fit was held up, and a law that was not what it is called stood in its way.
    #[test]
    fn a_law_that_the_leader_contains_is_fitted_from_where_that_came_to() {
        let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, 0.8);
        let fitted = |kind: &'static str, start: &[f64], iterations: usize| {
            let candidate = Candidate::named(kind, 0);
            let (hybrid, theta) = candidate.place(&null.hybrid, &null.inside.theta, start);
            let fitted = study.fit(hybrid, null.start(theta), 1, iterations);
            contender(&study, vec![candidate], fitted, &null)
        };
        let rich = fitted("asymmetric_viscous_friction", &[0.5, 0.5], 12);
        let held_up = fitted("viscous_friction", &[0.05], 0);
        assert!(rich.score - held_up.score > FAR_BEHIND);
        let mut contenders = [rich, held_up];
        polish(&study, &null, &mut contenders);
        let found = &contenders[1].fitted;
        let index = position(found, &contenders[1].added[0]).unwrap();
        let size = found.inside.theta[found.hybrid.range(index)][0];
        assert!((size - 0.8).abs() < 0.004, "{size}");
        assert!(
            contenders[0].score - contenders[1].score < 0.0,
            "with one constant less"
        );
    }

    #[test]
    fn friction_that_is_gone_at_speed_is_no_stribeck_friction_unless_the_rest_is_fixed() {
        let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, 0.8);
        let stribeck = Candidate::named("stribeck_friction", 0);
        let is = |given: &Hybrid, law: [f64; 3]| {
            let (hybrid, theta) = stribeck.place(given, &given.theta(), &law);
            is_sensible(
                &study,
                &stribeck,
                &study.fit(hybrid, null.start(theta), 0, 0),
            )
        };
        assert!(is(&null.hybrid, [0.2, 0.5, 0.3]));
        assert!(!is(&null.hybrid, [0.0, 0.5, 0.3]));
        let coulomb = Candidate::named("coulomb_friction", 0);
        let (placed, _) = coulomb.place(&null.hybrid, &null.inside.theta, &[0.4]);
        let mut beside = null.hybrid.clone();
        let known = Placed {
            fixed: true,
            ..placed.effects()[0]
        };
        beside.add(known, &[0.4]);
        assert!(is(&beside, [0.0, 0.5, 0.3]));
    }
}
