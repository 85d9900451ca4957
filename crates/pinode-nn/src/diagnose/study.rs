//! The data under study, and models fitted to it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use super::kept::Kept;
use super::pace::Pace;
use super::pushes::is_push;
use super::remainder::{Remainder, remainder};
use super::scales::MotionScales;
use super::smooth::Smoothed;
use super::step_length::StepLength;
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
/// Effects with a memory and stops may take so many times the integration steps of the other ones, or steps of this part of the coarsest.
const MOST_REFINED: usize = 4;
const MOST_REFINED_OF_COARSEST: f64 = 8.0;

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
    pub steps: StepLength,
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

    /// θ as the model says it is; as it was fitted where that says nothing.
    pub fn as_said(&self) -> Vec<f64> {
        let constants = self.hybrid.constants().iter();
        let both = constants.zip(&self.inside.theta);
        both.map(|(constant, &fitted)| match constant.tolerance.is_finite() {
            true => constant.value,
            false => fitted,
        })
        .collect()
    }

    /// The model with θ as it was fitted.
    pub fn as_fitted(&self) -> Hybrid {
        let mut hybrid = self.hybrid.clone();
        hybrid.set_theta(&self.inside.theta);
        hybrid
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

    /// The largest of them.
    pub fn most_excess(&self, study: &Study) -> f64 {
        let excess = self.excess(&study.observations);
        excess.into_iter().fold(0.0, f64::max)
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
        let work = self.work_of_one(hybrid, substeps) * iterations as u64;
        self.work.fetch_add(work, Ordering::Relaxed);
    }

    /// What one iteration of a fit might cost.
    pub(super) fn work_of_one(&self, hybrid: &Hybrid, substeps: usize) -> u64 {
        let samples: usize = self.windows.fit.iter().map(|w| w.count).sum();
        let columns = hybrid.nx() + hybrid.free().len();
        (samples * substeps * columns) as u64
    }

    /// Integration steps per log sample for a model at θ: more than else where an effect with a memory is fast, or a stop hard.
    pub fn substeps_for(&self, hybrid: &Hybrid, theta: &[f64]) -> usize {
        let memory = self.interval * hybrid.fastest_memory(theta, &self.scales);
        let blows = self.interval * hybrid.fastest_blow(theta, &self.scales);
        let of_coarsest = MOST_REFINED_OF_COARSEST * self.interval / self.pace.coarsest_step(false);
        let each = self.steps.substeps;
        let most = (MOST_REFINED * each).max(of_coarsest.ceil() as usize);
        let most = most.min(MOST_SUBSTEPS);
        // Of a blow there are more of them already.
        let of_blow = self.steps_of_blows(hybrid);
        let follows = |steps: usize, rate: f64, resolved: f64| {
            steps >= most || rate <= resolved * steps as f64
        };
        let mut substeps = each;
        while !(follows(substeps, memory, RESOLVED)
            && follows(substeps * of_blow, blows, RESOLVED_BLOWS))
        {
            substeps *= 2;
        }
        substeps * self.finer
    }

    /// The same in a simulation, of which nobody knows beforehand where it rests or is struck.
    pub fn substeps_anywhere(&self, hybrid: &Hybrid, theta: &[f64]) -> usize {
        let finest = self.steps.about_rests.max(self.steps_of_blows(hybrid));
        self.substeps_for(hybrid, theta) * finest
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

    /// One in so many of the seen windows and of those held out, and a fitted model there.
    pub fn some_of_both(&self, fitted: &Fitted, share: usize) -> (Study, Fitted) {
        let (mut study, mut there) = self.some_windows(fitted, share);
        study.windows.held_out = self
            .windows
            .held_out
            .iter()
            .step_by(share)
            .cloned()
            .collect();
        there.outside.states = fitted
            .outside
            .states
            .iter()
            .step_by(share)
            .cloned()
            .collect();
        (study, there)
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
                let inputs = run.drive(hybrid, substeps, theta, &[]);
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
