//! The data under study, and models fitted to it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use super::kept::Kept;
use super::pace::Pace;
use super::pushes::is_push;
use super::remainder::{Remainder, remainder};
use super::scales::MotionScales;
use super::score::{Paired, paired, samples_per_window};
use super::smooth::Smoothed;
use crate::effect::Kind;
use crate::hybrid::{HiddenPath, Hybrid, Placed};
use crate::shooting::{Fit, FitOptions, HiddenPrior, Observations, Window, Windows, fit};

/// At most so many integration steps per sample.
pub const MOST_SUBSTEPS: usize = 64;
/// Longest integration step for effects with a memory, in units of their fastest rate, and for stops, in units of that of their blows: these have
/// to give back what they do however they lie to the steps.
const RESOLVED: f64 = 1.5;
pub const RESOLVED_BLOWS: f64 = 0.5;
/// So many times a fit with hidden states goes on along their new path, while that moves a constant by more than [`STILL`] of what the data would
/// determine it to if all others were known.
const FURTHER_PATHS: usize = 2;
const STILL: f64 = 0.1;
/// A way of so many times what a state may differ by makes it forget where it began.
const FORGOTTEN: f64 = 3.0;
/// Iterations of the initial states alone once the constants that they follow from are known better.
const STATES_ALONE: usize = 3;
/// At least so many windows speak for all of them.
const FEWEST_SOME: usize = 12;
/// Effects with a memory and stops may take so many times the integration steps of the other ones.
const MOST_REFINED: usize = 4;

/// The data under study.
#[derive(Debug, Clone)]
pub struct Study {
    /// What was measured.
    pub observations: Observations,
    /// The windows, seen and held out.
    pub windows: Windows,
    /// How fast the motion is.
    pub pace: Pace,
    /// The scales of the motion, one a coordinate.
    pub scales: MotionScales,
    /// The recordings, smoothed.
    pub smoothed: Arc<Vec<Smoothed>>,
    /// Typical time between two samples, s.
    pub interval: f64,
    /// Integration steps per log sample.
    pub substeps: usize,
    /// All steps are shorter by this factor: 2 to see whether a finding is numerical.
    pub finer: usize,
    /// Whether dry friction may be made sharper than the model says; who says how sharp it is, is taken at his word.
    pub may_sharpen: bool,
    /// Kinds of effects that are no candidates.
    pub without: Vec<&'static Kind>,
    /// Where finished fits are kept.
    pub kept: Option<Arc<Kept>>,
    /// What all fits might have cost so far, in integration steps of one state or constant: the same on any machine, and where they were kept.
    pub work: Arc<AtomicU64>,
}

/// A model fitted to the seen windows, and its initial states (only those) to the windows held out.
#[derive(Clone)]
pub struct Fitted {
    /// The model.
    pub hybrid: Hybrid,
    /// The fit to the seen windows.
    pub inside: Fit,
    /// The fit of initial states to the windows held out.
    pub outside: Fit,
    /// Score of each seen window.
    pub inside_scores: Vec<f64>,
    /// Score of each window held out.
    pub outside_scores: Vec<f64>,
    /// Integration steps per log sample that it was fitted with.
    pub substeps: usize,
    /// What it leaves, once that was asked.
    pub(super) left: OnceLock<Option<Remainder>>,
    /// Its standard errors, once these were asked.
    pub(super) errors: OnceLock<Vec<f64>>,
}

/// From where a fit starts.
#[derive(Debug, Clone)]
pub struct Start {
    /// θ.
    pub theta: Vec<f64>,
    /// The effects whose states, in this order, follow q and v in the initial states; those of others are found.
    pub hidden: Vec<Placed>,
    /// Initial states of the seen windows.
    pub inside: Vec<Vec<f64>>,
    /// Initial states of the windows held out.
    pub outside: Vec<Vec<f64>>,
    /// Standard deviations of the residuals, one a channel.
    pub sigma: Vec<f64>,
}

impl Fitted {
    /// A start from this fit with another θ.
    pub fn start(&self, theta: Vec<f64>) -> Start {
        Start {
            theta,
            hidden: self.hybrid.effects().to_vec(),
            inside: self.inside.states.clone(),
            outside: self.outside.states.clone(),
            sigma: self.inside.sigma.clone(),
        }
    }

    /// Σ l_w over the seen windows less what the fit stretches the tolerances, less 4 k ln n for `k` more constants than the model
    /// compared with.
    pub fn score(&self, more: usize) -> f64 {
        let sum: f64 = self.inside_scores.iter().sum();
        let penalty = 4.0 * more as f64 * (self.inside_scores.len() as f64).ln();
        sum - self.inside.stretch - penalty
    }

    /// What it leaves in the windows of `study`, if that follows from anything; computed once.
    fn remainder(&self, study: &Study) -> Option<&Remainder> {
        self.left.get_or_init(|| remainder(study, self)).as_ref()
    }

    /// What it leaves where that follows from something beyond doubt.
    pub fn left(&self, study: &Study) -> Option<&Remainder> {
        self.remainder(study).filter(|left| left.is_significant())
    }

    /// What it leaves where that is worth a search, the `first` one or one beside what was found.
    pub fn hint(&self, study: &Study, first: bool) -> Option<&Remainder> {
        self.remainder(study).filter(|left| left.is_hint(first))
    }

    /// Residual over sensor noise, one a channel: 1 where the model explains all.
    pub fn excess(&self, observations: &Observations) -> Vec<f64> {
        self.inside
            .sigma
            .iter()
            .zip(&observations.channels)
            .map(|(sigma, channel)| sigma / channel.noise)
            .collect()
    }
}

/// How much better one fitted model explains the windows than another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Over the seen windows.
    pub inside: Paired,
    /// Over the windows held out.
    pub outside: Paired,
    /// Gain per sample over the seen windows, nats.
    pub inside_gain: f64,
    /// Gain per sample over the windows held out, nats.
    pub outside_gain: f64,
    /// By how much less the tolerances are stretched, nats.
    pub relief: f64,
}

/// So many standard deviations say that a constant is not what it is taken for: one in two thousand is as far off.
pub const SURE: f64 = 3.5;
/// A relief of the tolerances by so many nats, as of one of them that was stretched by [`SURE`], speaks for an effect by itself.
pub const RELIEF: f64 = 0.5 * SURE * SURE;

/// A loss of less than this, nats a sample, does not count against a relief: a tenth of the least gain held out that counts for an effect.
const HARMLESS: f64 = 2.5e-3;
/// Nor does this share of what it relieves: a fit that is freed of large tolerances gives up something for them.
const PART: f64 = 0.5;

/// What is accepted explains the seen windows by so many standard errors and those held out by so many, or both by as much as is the least of each.
const LEAST_Z: (f64, f64) = (4.0, 2.0);
const LEAST_Z_OF_BOTH: f64 = 3.0;
/// … and so many nats a sample of the one and of the other.
const LEAST_GAIN: (f64, f64) = (0.05, 0.025);
/// What takes away all that follows from anything may explain less by this factor.
const LITTLE: f64 = 0.6;

/// What is slight explains the seen windows by so many standard errors and so many nats a sample.
pub const SLIGHT: (f64, f64) = (1.5, 0.01);
/// … and those held out by this share of that at least.
const BORNE_OUT: f64 = 0.1;
/// Ahead by so many standard errors in the seen windows and in those held out it earns more constants.
const SLIGHT_LEAD: (f64, f64) = (2.0, 1.0);

/// What an effect lacks of an explanation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lack {
    /// A gain on the windows that the fit saw.
    Gain,
    /// A gain on the windows held out, though there is one on the others.
    GainHeldOut,
}

/// What an effect lacks that explains the seen windows, and those held out, by so many standard errors and so many nats a sample. Nothing where
/// both gains are large enough and significant: the seen windows chose the effect and its parameters, which those held out did not.
pub fn lacks(z: (f64, f64), gain: (f64, f64)) -> Option<Lack> {
    let on_both = z.0 > LEAST_Z_OF_BOTH && z.1 > LEAST_Z_OF_BOTH;
    if !(gain.0 > LEAST_GAIN.0 && (z.0 > LEAST_Z.0 || on_both)) {
        Some(Lack::Gain)
    } else if !(gain.1 > LEAST_GAIN.1 && z.1 > LEAST_Z.1) {
        Some(Lack::GainHeldOut)
    } else {
        None
    }
}

impl Comparison {
    /// Of `new` over `old`.
    pub fn of(new: &Fitted, old: &Fitted) -> Self {
        let inside = paired(&new.inside_scores, &old.inside_scores);
        let outside = paired(&new.outside_scores, &old.outside_scores);
        let per_sample =
            |p: Paired, fit: &Fit| p.gain / (p.windows.max(1) as f64 * samples_per_window(fit));
        Comparison {
            inside,
            outside,
            inside_gain: per_sample(inside, &new.inside),
            outside_gain: per_sample(outside, &new.outside),
            relief: old.inside.stretch - new.inside.stretch,
        }
    }

    /// Whether the gain is significant and large enough on both sides.
    pub fn explains(&self) -> bool {
        let z = (self.inside.z, self.outside.z);
        lacks(z, (self.inside_gain, self.outside_gain)).is_none()
    }

    /// Whether the gain is significant on both sides, and large enough for what leaves nothing.
    pub fn explains_a_little(&self) -> bool {
        let z = (self.inside.z, self.outside.z);
        lacks(z, (self.inside_gain / LITTLE, self.outside_gain / LITTLE)).is_none()
    }

    /// Whether both sides gain, the seen windows by enough for what is [`slight`](super::slight), and those held out by more than next to
    /// nothing of that, which would not bear it out.
    pub fn explains_slightly(&self) -> bool {
        self.inside.z > SLIGHT.0
            && self.inside_gain > SLIGHT.1
            && self.outside_gain > BORNE_OUT * self.inside_gain
    }

    /// Whether one that is slight is ahead of another by enough for its additional constants.
    pub fn leads_slightly(&self) -> bool {
        let (z_in, z_out) = SLIGHT_LEAD;
        self.explains_slightly() && self.inside.z > z_in && self.outside.z > z_out
    }

    /// Whether it is as good on the seen windows, or nearly, and half as good on those held out, of which there are fewer.
    pub fn nearly_explains(&self) -> bool {
        self.inside.z > 3.0
            && self.outside.z > 1.0
            && self.inside_gain > 0.05
            && self.outside_gain > 0.0125
    }

    /// All that speaks for it on the seen windows, nats: what it explains better, and the tolerances that it stretches less.
    pub fn total(&self) -> f64 {
        self.inside.gain + self.relief
    }

    /// Whether the old model explains the windows as well only by stretching what is known of masses and gains beyond belief.
    pub fn relieves(&self) -> bool {
        let relief_of = |of: Paired| {
            let share = of.windows as f64 / self.inside.windows.max(1) as f64;
            self.relief * share
        };
        // Where both models do the same, a loss of next to nothing may be a steady one.
        let harmless = |of: Paired, per_sample: f64| {
            of.z > -2.0 || per_sample > -HARMLESS || of.gain > -PART * relief_of(of)
        };
        self.relief > RELIEF
            && harmless(self.inside, self.inside_gain)
            && harmless(self.outside, self.outside_gain)
    }
}

impl Study {
    /// The same with half the integration steps.
    pub fn with_half_the_steps(&self) -> Self {
        Study {
            finer: 2 * self.finer,
            ..self.clone()
        }
    }

    /// What all fits might have cost so far.
    pub fn work(&self) -> u64 {
        self.work.load(Ordering::Relaxed)
    }

    /// Counts a fit of so many iterations.
    pub(super) fn count(&self, hybrid: &Hybrid, substeps: usize, iterations: usize) {
        let samples: usize = self.windows.fit.iter().map(|w| w.count).sum();
        let columns = hybrid.nx() + hybrid.free().len();
        let steps = samples * substeps * columns * iterations;
        self.work.fetch_add(steps as u64, Ordering::Relaxed);
    }

    /// Integration steps per log sample for a model at θ: more than else where an effect with a memory is fast, or a stop hard.
    pub fn substeps_for(&self, hybrid: &Hybrid, theta: &[f64]) -> usize {
        let memory = hybrid.fastest_memory(theta, &self.scales);
        let blows = hybrid.fastest_blow(theta, &self.scales);
        let rate = memory.max(RESOLVED / RESOLVED_BLOWS * blows);
        let most = MOST_SUBSTEPS.min(MOST_REFINED * self.substeps);
        let mut substeps = self.substeps;
        while substeps < most && self.interval * rate > RESOLVED * substeps as f64 {
            substeps *= 2;
        }
        substeps * self.finer
    }

    /// Whether these steps follow the effects with a memory of a model at θ: what is much faster than the samples is not in the data.
    pub fn resolves(&self, hybrid: &Hybrid, theta: &[f64]) -> bool {
        let steps = self.substeps_for(hybrid, theta) as f64;
        self.interval * hybrid.fastest_memory(theta, &self.scales) <= RESOLVED * steps
    }

    /// One in `share` of the seen windows, or as many as make [`FEWEST_SOME`], none of those held out, and what a fitted model starts from there.
    pub fn some_windows(&self, fitted: &Fitted, share: usize) -> (Study, Fitted) {
        let share = share.min(self.windows.fit.len() / FEWEST_SOME).max(1);
        let windows = self.windows.fit.iter().step_by(share).cloned();
        let states = fitted.inside.states.iter().step_by(share).cloned();
        self.over(fitted, windows.collect(), states.collect())
    }

    /// The windows held out as if they were the seen ones, and a fitted model there.
    pub fn of_held_out(&self, fitted: &Fitted) -> (Study, Fitted) {
        let states = fitted.outside.states.clone();
        self.over(fitted, self.windows.held_out.clone(), states)
    }

    /// The same with these windows alone, none held out, and a fitted model that starts from `states` there.
    pub fn over(
        &self,
        fitted: &Fitted,
        windows: Vec<Window>,
        states: Vec<Vec<f64>>,
    ) -> (Study, Fitted) {
        let study = Study {
            windows: Windows {
                fit: windows,
                held_out: Vec::new(),
            },
            ..self.clone()
        };
        let mut fitted = Fitted {
            left: OnceLock::new(),
            errors: OnceLock::new(),
            ..fitted.clone()
        };
        fitted.inside.states = states;
        fitted.outside.states.clear();
        (study, fitted)
    }

    /// Where each recording takes the hidden states of a model.
    pub fn hidden_paths(&self, hybrid: &Hybrid, theta: &[f64], substeps: usize) -> Vec<HiddenPath> {
        if hybrid.nh() == 0 {
            return vec![HiddenPath::default(); self.observations.runs.len()];
        }
        let readings = hybrid.readings(theta, &[]);
        self.observations
            .runs
            .iter()
            .zip(self.smoothed.iter())
            .map(|(run, smoothed)| {
                let inputs = hybrid.drive(&run.t, &run.u, substeps, theta, &[]);
                hybrid.hidden_path(theta, &inputs, &|k| smoothed.behind(&readings, &run.t, k))
            })
            .collect()
    }

    /// What is known of hidden states at the start of windows, by θ that is `fitted` or still to be.
    pub fn hidden_prior(
        &self,
        hybrid: &Hybrid,
        (theta, fitted): (&[f64], bool),
        windows: &[Window],
        paths: &[HiddenPath],
    ) -> HiddenPrior {
        if hybrid.nh() == 0 {
            return HiddenPrior::none(windows.len());
        }
        let mean = |w: &Window| paths[w.run].at(w.first).to_vec();
        let wide = hybrid.hidden_spread(theta, &self.scales, false);
        let close = hybrid.hidden_spread(theta, &self.scales, fitted);
        let spreads = windows.iter().map(|w| {
            let mut spread = wide.clone();
            for (index, effect) in hybrid.effects().iter().enumerate() {
                let own = hybrid.state_range(index);
                let c = hybrid.coordinate_of(effect.kind, effect.target);
                // With what they began, states of the past know until the motion has made them forget it.
                let forgets = |i: usize| self.has_gone(w, c, FORGOTTEN * wide[i]);
                if close[own.clone()] != wide[own.clone()] && own.clone().all(forgets) {
                    spread[own.clone()].copy_from_slice(&close[own]);
                }
            }
            spread
        });
        HiddenPrior {
            means: windows.iter().map(mean).collect(),
            spreads: spreads.collect(),
        }
    }

    /// Whether a coordinate has gone a `way` in its recording before a window.
    fn has_gone(&self, window: &Window, c: usize, way: f64) -> bool {
        let q = &self.smoothed[window.run].q[c][..=window.first];
        let mut gone = 0.0;
        q.windows(2).rev().any(|pair| {
            gone += (pair[1] - pair[0]).abs();
            gone > way
        })
    }

    /// The fits of a model to the seen windows and to those held out; [`fit`](Self::fit) makes them unless they are kept already.
    pub(super) fn fit_anew(
        &self,
        hybrid: &Hybrid,
        start: Start,
        state_iterations: usize,
        iterations: usize,
    ) -> (Fit, Fit) {
        let free = hybrid.free();
        let substeps = self.substeps_for(hybrid, &start.theta);
        let options = FitOptions {
            substeps,
            iterations,
            state_iterations,
        };
        let mut paths = self.hidden_paths(hybrid, &start.theta, substeps);
        let windows = &self.windows.fit;
        // The constants of what is new are still to be found, and with them the path of its states.
        let knows = |effect: &Placed| start.hidden.iter().any(|old| old.is_same(effect));
        let effects = hybrid.effects().iter();
        let mut following = effects
            .filter(|e| e.kind.states() > 0 && !is_push(e))
            .peekable();
        let follows = following.peek().is_some();
        let goes_on = following.all(knows);
        let known = self.hidden_prior(hybrid, (&start.theta, goes_on), windows, &paths);
        let states = with_hidden(hybrid, &start.hidden, start.inside, &known);
        let go_on = |theta, states, sigma, known: &HiddenPrior, options: &FitOptions| {
            fit(
                hybrid,
                &self.observations,
                windows,
                &free,
                theta,
                states,
                sigma,
                known,
                options,
            )
        };
        let mut inside = go_on(start.theta, states, start.sigma, &known, &options);
        // The path that the hidden states are taken to follow is that of the constants with which the fit began.
        for round in 0..FURTHER_PATHS {
            if !follows || (!inside.converged && (goes_on || round > 0)) {
                break;
            }
            paths = self.hidden_paths(hybrid, &inside.theta, substeps);
            let known = self.hidden_prior(hybrid, (&inside.theta, true), windows, &paths);
            let options = match inside.converged {
                true => FitOptions {
                    state_iterations: 0,
                    ..options
                },
                false => FitOptions {
                    state_iterations: STATES_ALONE,
                    iterations: 0,
                    ..options
                },
            };
            let (before, gained) = (inside.theta.clone(), inside.gained);
            inside = go_on(inside.theta, inside.states, inside.sigma, &known, &options);
            if options.iterations == 0 {
                inside.gained = gained;
            }
            let moved = |(k, &i): (usize, &usize)| {
                (inside.theta[i] - before[i]).powi(2) * inside.information[(k, k)] > STILL.powi(2)
            };
            if !free.iter().enumerate().any(moved) {
                break;
            }
        }
        let known = self.hidden_prior(
            hybrid,
            (&inside.theta, true),
            &self.windows.held_out,
            &paths,
        );
        let outside = fit(
            hybrid,
            &self.observations,
            &self.windows.held_out,
            &[],
            inside.theta.clone(),
            with_hidden(hybrid, &start.hidden, start.outside, &known),
            inside.sigma.clone(),
            &known,
            &FitOptions {
                iterations: iterations.min(10),
                ..options
            },
        );
        (inside, outside)
    }
}

/// Initial states (q, v, h) for `hybrid` from those of a model with the effects `before`: what is new of h is taken from `known`.
fn with_hidden(
    hybrid: &Hybrid,
    before: &[Placed],
    states: Vec<Vec<f64>>,
    known: &HiddenPrior,
) -> Vec<Vec<f64>> {
    if hybrid.nh() == 0 && before.iter().all(|effect| effect.kind.states() == 0) {
        return states;
    }
    let visible = hybrid.nx() - hybrid.nh();
    let old_place = |wanted: &Placed| -> Option<usize> {
        let place = before.iter().position(|e| e.is_same(wanted))?;
        let states = before[..place].iter().map(|e| e.kind.states());
        Some(visible + states.sum::<usize>())
    };
    states
        .into_iter()
        .zip(&known.means)
        .map(|(state, mean)| {
            let mut new = state[..visible].to_vec();
            for (index, effect) in hybrid.effects().iter().enumerate() {
                let own = hybrid.state_range(index);
                let old = old_place(effect).and_then(|at| state.get(at..at + own.len()));
                new.extend_from_slice(old.unwrap_or(&mean[own]));
            }
            new
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_slight_is_borne_out_by_the_windows_held_out() {
        let paired = |z: f64, gain: f64| Paired {
            z,
            gain,
            windows: 25,
        };
        let slight = |gain: f64, held_out: f64| Comparison {
            inside: paired(2.1, 40.0),
            outside: paired(1.1, 5.0),
            inside_gain: gain,
            outside_gain: held_out,
            relief: 0.0,
        };
        assert!(slight(0.02, 0.003).explains_slightly());
        assert!(!slight(0.009, 0.02).explains_slightly(), "too little");
        assert!(!slight(1.43, 0.001).explains_slightly(), "they hardly move");
        assert!(!slight(0.02, f64::NAN).explains_slightly());
        assert!(slight(0.02, 0.003).leads_slightly());
    }

    #[test]
    fn an_explanation_is_large_enough_and_sure_on_the_windows_that_the_fit_saw_and_on_those_held_out()
     {
        let large = (0.051, 0.026);
        assert_eq!(lacks((4.1, 2.1), large), None);
        assert_eq!(lacks((3.9, 2.1), large), Some(Lack::Gain));
        assert_eq!(lacks((3.1, 3.1), large), None, "as sure on both");
        assert_eq!(lacks((2.9, 9.0), large), Some(Lack::Gain));
        assert_eq!(lacks((4.1, 1.9), large), Some(Lack::GainHeldOut));
        assert_eq!(lacks((9.0, 9.0), (0.049, 0.026)), Some(Lack::Gain));
        assert_eq!(lacks((9.0, 9.0), (0.051, 0.024)), Some(Lack::GainHeldOut));
        let nan = f64::NAN;
        assert_eq!(lacks((nan, 9.0), large), Some(Lack::Gain));
    }
}
