//! The paper's rig as an environment: a controller at its input, instead of the hand.

use std::f64::consts::TAU;
use std::fmt;

use pinode_nn::environment::{
    Channel, Environment, EnvironmentError, Episode, Step, Task, Transition,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Error, PaperRig};
use crate::rig::effects::Effects;
use crate::rig::plant::Mechanism;
use crate::rig::truth::State;
use crate::rig::{Bench, Run};

/// The paper's rig as an [`Environment`].
///
/// What it shows is what its sensors read: x, m, with noise and glitches, φ, rad in [0, 2π), in steps of the encoder, and their differences to
/// the reading before, m/s and rad/s. What it takes is the motor's force, N, up to the operator's limit. The delay, the string, the
/// friction and the ends of the rail are those of its recordings. A [`Task`] judges the true state (x, φ, ẋ, φ̇), φ not wrapped.
///
/// ```
/// use cartpole::paper::{PaperRig, RigEnvironment};
/// use pinode_nn::environment::{Closures, Environment, Transition, Verdict, uniform};
///
/// let settings = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/cartpole/paper.toml");
/// let hanging = uniform(vec![0.0, std::f64::consts::PI], vec![]);
/// let task = Closures::new(hanging, |step: &Transition<'_>| Verdict { reward: step.next[1].cos(), terminated: false });
/// let mut rig = RigEnvironment::new(PaperRig::read(settings.as_ref())?, Some(50), task)?;
/// rig.reset(Some(1))?;
/// while !rig.step(&[0.5])?.truncated {}
/// assert!(rig.truth().is_some_and(|state| state.q[0] > 0.05));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct RigEnvironment<T> {
    rig: PaperRig,
    effects: Effects,
    actions: [Channel; 1],
    observations: [Channel; 4],
    task: T,
    random: ChaCha8Rng,
    episode: Episode,
    bench: Option<Bench<Mechanism>>,
}

impl<T> fmt::Debug for RigEnvironment<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RigEnvironment")
            .field("settings", &self.rig.settings)
            .field("friction", &self.rig.friction)
            .field("truth", &self.truth())
            .field("episode", &self.episode)
            .finish_non_exhaustive()
    }
}

impl<T> RigEnvironment<T> {
    /// The rig for `task`, its episodes cut off after so many steps.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that have been changed to what no rig has; [`Error::Environment`] for episodes of no step.
    pub fn new(rig: PaperRig, episode: Option<usize>, task: T) -> Result<Self, Error> {
        let limit = rig.settings.operator.limit;
        Ok(RigEnvironment {
            effects: rig.effects()?,
            actions: [Channel::new("u.motor", -limit, limit)],
            observations: [
                Channel::unbounded("q.slider"),
                Channel::new("q.pole", 0.0, TAU),
                Channel::unbounded("v.slider"),
                Channel::unbounded("v.pole"),
            ],
            task,
            random: ChaCha8Rng::seed_from_u64(0),
            episode: Episode::new(episode)?,
            bench: None,
            rig,
        })
    }

    /// What no sensor tells: x, m, φ, rad, not wrapped, ẋ, m/s, φ̇, rad/s; none before the first episode.
    pub fn truth(&self) -> Option<State> {
        let bench = self.bench.as_ref()?;
        Some(self.rig.shifted(bench.truth().state(), self.rig.middle()))
    }

    /// When the cart struck an end of its rail in this episode, s.
    pub fn blows(&self) -> &[f64] {
        self.bench
            .as_ref()
            .map_or(&[], |bench| bench.truth().blows())
    }

    /// Refuses states that the rig cannot be in.
    fn check(&self, state: &[f64; 4]) -> Result<(), EnvironmentError> {
        let refused = |name: &str, value, condition| EnvironmentError::Begin {
            name: name.to_owned(),
            value,
            condition,
        };
        let mut named = self.observations.iter().zip(state);
        if let Some((channel, &value)) = named.find(|(_, x)| !x.is_finite()) {
            return Err(refused(&channel.name, value, "finite numbers".to_owned()));
        }
        match self.rig.settings.rail {
            Some(ends) if !(ends.left..=ends.right).contains(&state[0]) => {
                let on_rail = format!("a cart on its rail, {} to {} m", ends.left, ends.right);
                Err(refused("q.slider", state[0], on_rail))
            }
            _ => Ok(()),
        }
    }
}

/// (q, v) of a cart and its pole.
fn numbers(State { q, v }: State) -> [f64; 4] {
    [q[0], q[1], v[0], v[1]]
}

/// There is no episode without a bench.
fn truth_of<T>(environment: &RigEnvironment<T>) -> Result<[f64; 4], EnvironmentError> {
    let truth = environment.truth().ok_or(EnvironmentError::NotReset)?;
    Ok(numbers(truth))
}

impl<T: Task> Environment for RigEnvironment<T> {
    fn action_space(&self) -> &[Channel] {
        &self.actions
    }

    fn observation_space(&self) -> &[Channel] {
        &self.observations
    }

    fn interval(&self) -> f64 {
        self.rig.interval()
    }

    fn reset(&mut self, seed: Option<u64>) -> Result<Vec<f64>, EnvironmentError> {
        self.episode.leave();
        if let Some(seed) = seed {
            self.random = ChaCha8Rng::seed_from_u64(seed);
        }
        let noise: u64 = self.random.random();
        let mut state = [0.0; 4];
        self.task.begin(&mut self.random, &mut state);
        self.check(&state)?;
        let [x, phi, x_rate, phi_rate] = state;
        let start = State {
            q: [x, phi],
            v: [x_rate, phi_rate],
        };
        let run = Run {
            effects: self.effects,
            noise: &self.rig.settings.sensors,
            rate: self.rig.settings.rate,
            truth_step: self.rig.settings.truth_step,
            rows: 0,
            sampling: None,
            seed: noise,
        };
        let from_middle = self.rig.shifted(start, -self.rig.middle());
        let bench = self
            .bench
            .insert(run.start(self.rig.plant.clone(), from_middle));
        self.episode.begin();
        Ok(bench.measure().concat())
    }

    fn step(&mut self, action: &[f64]) -> Result<Step, EnvironmentError> {
        self.episode.turn(&self.actions, action)?;
        let (steps, interval) = (self.episode.steps(), self.rig.interval());
        let state = truth_of(self)?;
        let bench = self.bench.as_mut().ok_or(EnvironmentError::NotReset)?;
        let force = action.first().copied().unwrap_or_default();
        bench
            .hold(force)
            .map_err(|cause| EnvironmentError::Stopped {
                step: steps + 1,
                time: steps as f64 * interval,
                cause: cause.into(),
            })?;
        let observation = bench.measure().concat();
        let next = truth_of(self)?;
        let verdict = self.task.judge(&Transition {
            state: &state,
            action,
            next: &next,
            time: (steps + 1) as f64 * interval,
        });
        self.episode.close(verdict, observation)
    }
}
