//! A model as an environment.

use std::fmt;

use integrators::Rk4;
use lagrange::state::neutral;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{Channel, Environment, EnvironmentError, Episode, Step, Task, Transition};
use crate::entries::{q_names, v_names};
use crate::free_run::{LONGEST_STEP, substeps};
use crate::hybrid::{DrivenInputs, Hybrid, HybridMotion, Memory};
use crate::model::Model;
use crate::shooting::over_samples;

/// So many inputs of before are kept at most.
const MOST_PAST: usize = 100_000;

/// How a model becomes an environment.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The time that an action is held, s.
    pub interval: f64,
    /// Integration steps are not longer than this, s.
    pub longest_step: f64,
    /// Bounds of the inputs, one channel each, in the model's order and the units of its log; empty: without bounds.
    pub actions: Vec<Channel>,
    /// The inputs that were held before the episode, which a delay still lets through; empty: zeros.
    pub idle: Vec<f64>,
    /// Steps after which an episode is cut off.
    pub episode: Option<usize>,
}

impl Settings {
    /// Actions held for `interval` s, steps of a millisecond, no bounds, inputs of 0 before, episodes without end.
    pub fn new(interval: f64) -> Self {
        Settings {
            interval,
            longest_step: LONGEST_STEP,
            actions: Vec::new(),
            idle: Vec::new(),
            episode: None,
        }
    }
}

/// Any [`Model`] as an [`Environment`]: M v̇ + C v + G = Q with its effects and networks, inputs held over each interval, integrated by classical
/// Runge-Kutta as in [`simulate`](crate::free_run::simulate).
///
/// It shows the state (q, v) itself, nq + nv numbers, m, rad, m/s, rad/s; angles are not wrapped, and nothing of what the model says of
/// sensors is applied. Inputs that are under way in a delay or a lag and states of effects with a memory are kept, and are not shown.
pub struct ModelEnvironment<T> {
    name: String,
    hybrid: Hybrid,
    theta: Vec<f64>,
    memory: Memory,
    rk4: Rk4<f64>,
    settings: Settings,
    observations: Vec<Channel>,
    task: T,
    random: ChaCha8Rng,
    /// Bounds of the intervals that are kept, s, the present one last and its begin at 0.
    times: Vec<f64>,
    /// The inputs of these intervals, one column each.
    inputs: Vec<Vec<f64>>,
    substeps: usize,
    /// (q, v, h).
    state: Vec<f64>,
    before: Vec<f64>,
    episode: Episode,
}

impl<T> fmt::Debug for ModelEnvironment<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ModelEnvironment")
            .field("model", &self.name)
            .field("settings", &self.settings)
            .field("state", &self.state)
            .field("episode", &self.episode)
            .finish_non_exhaustive()
    }
}

impl<T: Task> ModelEnvironment<T> {
    /// An environment of `model` for `task`.
    ///
    /// # Errors
    /// [`EnvironmentError::Setting`], [`EnvironmentError::Length`] and [`EnvironmentError::Bounds`] for settings that do not fit;
    /// [`EnvironmentError::Memory`] and [`EnvironmentError::Past`] where too much of the past matters.
    pub fn new(model: &Model, settings: Settings, task: T) -> Result<Self, EnvironmentError> {
        let hybrid = Hybrid::explicit(model).held();
        let theta = hybrid.theta();
        let settings = checked(model, settings)?;
        let Settings {
            interval,
            longest_step,
            ..
        } = settings;
        let name = model.name.clone();
        let Some(past) = hybrid.past(interval, &theta) else {
            return Err(EnvironmentError::Memory { model: name });
        };
        let samples = (past / interval).ceil();
        if samples.is_nan() || samples > MOST_PAST as f64 {
            return Err(EnvironmentError::Past {
                model: name,
                samples,
                most: MOST_PAST,
            });
        }
        let past = samples as usize;
        let times: Vec<f64> = (0..past + 2)
            .map(|k| (k as f64 - past as f64) * interval)
            .collect();
        let coordinates = model.mechanics.coordinates();
        let names = q_names(coordinates).into_iter().chain(v_names(coordinates));
        Ok(ModelEnvironment {
            name,
            memory: hybrid.memory(&[]),
            rk4: Rk4::new(hybrid.nx()),
            observations: names.map(Channel::unbounded).collect(),
            random: ChaCha8Rng::seed_from_u64(0),
            inputs: vec![vec![0.0; past + 1]; hybrid.inputs()],
            substeps: substeps(&[0.0, interval], longest_step),
            state: vec![0.0; hybrid.nx()],
            before: Vec::with_capacity(hybrid.nx()),
            episode: Episode::new(settings.episode)?,
            times,
            hybrid,
            theta,
            settings,
            task,
        })
    }

    /// The state (q, v), nq + nv numbers.
    pub fn state(&self) -> &[f64] {
        &self.state[..self.visible()]
    }

    /// The task.
    pub fn task(&self) -> &T {
        &self.task
    }

    /// How many inputs before the present one still matter: those that a delay or a lag has under way, and those that a network sees.
    pub fn past(&self) -> usize {
        self.times.len() - 2
    }

    /// Begins an episode at `state` (q, v) with the inputs `past` of the intervals before, the last one last, one number an input each; those that are not
    /// given were [idle](Settings::idle). States of effects with a memory begin where nothing of before is known.
    ///
    /// With it an environment predicts: from a state that was measured, under inputs that are under way, on through its [steps](Environment::step).
    ///
    /// # Errors
    /// [`EnvironmentError::Length`] and [`EnvironmentError::Begin`].
    pub fn reset_to(&mut self, state: &[f64], past: &[&[f64]]) -> Result<(), EnvironmentError> {
        let length = |what, found, expected| match found == expected {
            true => Ok(()),
            false => Err(EnvironmentError::Length {
                what,
                found,
                model: self.name.clone(),
                expected,
            }),
        };
        length(
            "the state that an episode begins in",
            state.len(),
            self.visible(),
        )?;
        for input in past {
            length("an input of before", input.len(), self.inputs.len())?;
        }
        let known = self.settings.idle.iter().copied();
        let idle = known.chain(std::iter::repeat(0.0));
        for (i, (column, idle)) in self.inputs.iter_mut().zip(idle).enumerate() {
            column.fill(idle);
            let given = past.iter().rev().filter_map(|input| input.get(i));
            for (kept, &given) in column.iter_mut().rev().zip(given) {
                *kept = given;
            }
        }
        self.begin(state)
    }

    /// Begins an episode at (q, v), the inputs that were before in place, the last of them where the present one will be.
    fn begin(&mut self, state: &[f64]) -> Result<(), EnvironmentError> {
        self.episode.leave();
        let named = self.observations.iter().zip(state);
        if let Some((channel, &value)) = named.into_iter().find(|(_, x)| !x.is_finite()) {
            return Err(EnvironmentError::Begin {
                name: channel.name.clone(),
                value,
                condition: "finite numbers".to_owned(),
            });
        }
        let visible = self.visible();
        self.state[..visible].copy_from_slice(state);
        if self.hybrid.nh() > 0 {
            let inputs = self.driven();
            let v = &state[self.hybrid.nq()..];
            let last = inputs.grid.steps() - 1;
            let hidden = self.hybrid.hidden_start(v, &self.theta, &inputs, last);
            self.state[visible..].copy_from_slice(&hidden);
        }
        self.episode.begin();
        Ok(())
    }

    /// Length of (q, v).
    fn visible(&self) -> usize {
        self.hybrid.nq() + self.hybrid.nv()
    }

    /// What arrives of the inputs in the intervals that are kept.
    fn driven(&self) -> DrivenInputs {
        let (t, u) = (&self.times, &self.inputs);
        self.hybrid.drive(t, u, self.substeps, &self.theta, &[])
    }

    /// Lets one interval pass under the inputs in place.
    fn advance(&mut self) -> Result<(), EnvironmentError> {
        let inputs = self.driven();
        let present = (self.past(), 2);
        let motion = HybridMotion::new(&self.hybrid, &self.theta, &[], &inputs);
        let (rk4, memory, state) = (&mut self.rk4, &mut self.memory, &mut self.state);
        let rolled = over_samples(&motion, rk4, memory, &inputs, present, state, |_| {});
        rolled.map_err(|cause| EnvironmentError::Stopped {
            step: self.episode.steps() + 1,
            time: self.episode.steps() as f64 * self.settings.interval,
            cause: cause.into(),
        })
    }
}

impl<T: Task> Environment for ModelEnvironment<T> {
    fn action_space(&self) -> &[Channel] {
        &self.settings.actions
    }

    fn observation_space(&self) -> &[Channel] {
        &self.observations
    }

    fn interval(&self) -> f64 {
        self.settings.interval
    }

    fn reset(&mut self, seed: Option<u64>) -> Result<Vec<f64>, EnvironmentError> {
        if let Some(seed) = seed {
            self.random = ChaCha8Rng::seed_from_u64(seed);
        }
        let mut state = neutral(self.hybrid.mechanics().coordinates());
        state.resize(self.visible(), 0.0);
        self.task.begin(&mut self.random, &mut state);
        self.reset_to(&state, &[])?;
        Ok(state)
    }

    fn step(&mut self, action: &[f64]) -> Result<Step, EnvironmentError> {
        self.episode.turn(&self.settings.actions, action)?;
        for (column, &value) in self.inputs.iter_mut().zip(action) {
            column.rotate_left(1);
            if let Some(present) = column.last_mut() {
                *present = value;
            }
        }
        let visible = self.visible();
        self.before.clear();
        self.before.extend_from_slice(&self.state[..visible]);
        self.advance()?;
        let next = &self.state[..visible];
        let verdict = self.task.judge(&Transition {
            state: &self.before,
            action,
            next,
            time: (self.episode.steps() + 1) as f64 * self.settings.interval,
        });
        self.episode.close(verdict, next.to_vec())
    }
}

/// Settings that fit the model, with one channel an input.
fn checked(model: &Model, mut settings: Settings) -> Result<Settings, EnvironmentError> {
    let positive = |name, value: f64| match value > 0.0 && value.is_finite() {
        true => Ok(()),
        false => Err(EnvironmentError::Setting {
            name,
            value,
            condition: "a finite time above 0 s",
        }),
    };
    positive("interval", settings.interval)?;
    positive("longest_step", settings.longest_step)?;
    if settings.actions.is_empty() {
        let names = model.inputs.iter().map(|input| format!("u.{}", input.name));
        settings.actions = names.map(Channel::unbounded).collect();
    }
    let lists = [
        ("the action space", settings.actions.len()),
        ("what the inputs are before an episode", settings.idle.len()),
    ];
    for (what, found) in lists {
        let left_out = found == 0 && what != lists[0].0;
        if found != model.inputs.len() && !left_out {
            return Err(EnvironmentError::Length {
                what,
                found,
                model: model.name.clone(),
                expected: model.inputs.len(),
            });
        }
    }
    settings.actions.iter().try_for_each(Channel::check)?;
    match settings.idle.iter().find(|u| !u.is_finite()) {
        None => Ok(settings),
        Some(&value) => Err(EnvironmentError::Setting {
            name: "idle",
            value,
            condition: "finite inputs",
        }),
    }
}
