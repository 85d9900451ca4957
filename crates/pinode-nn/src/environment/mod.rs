//! Environments for controllers to be found in, and to run on: [`Environment::reset`] and [`Environment::step`] as in Gymnasium.
//!
//! A [`ModelEnvironment`] is one of any [`Model`](crate::model::Model), with its effects, its delays and its networks: it shows the state (q, v), takes
//! the inputs u, one number each in the units of the log, and holds them over a step. What is wanted, a [`Task`], is the user's. A test rig
//! can be an [`Environment`] too: what is found on a model then runs there as it is.
//!
//! ```
//! use pinode_nn::environment::{Channel, Closures, Environment, ModelEnvironment, Settings, Transition, Verdict, uniform};
//! use pinode_nn::model::Model;
//!
//! let model = Model::parse("pendulum.toml".as_ref(), r#"
//!     [lagrangian]
//!     coordinates = ["phi"]
//!     kinetic     = "0.5*m*l^2*phi_dot^2"
//!     potential   = "m*g*l*cos(phi)"
//!     parameters  = { m = 0.2, l = 0.5, g = 9.81 }
//!
//!     [[input]]
//!     name  = "motor"
//!     joint = "phi"
//!
//!     [[effect]]
//!     kind  = "input_delay"
//!     input = "motor"
//!     delay = 0.03
//! "#)?;
//! let task = Closures::new(
//!     uniform(vec![0.0, 0.0], vec![0.05, 0.0]),
//!     |step: &Transition<'_>| Verdict { reward: step.next[0].cos(), terminated: step.next[0].abs() > 0.5 },
//! );
//! let settings = Settings {
//!     actions: vec![Channel::new("u.motor", -2.0, 2.0)], // N·m
//!     episode: Some(200),
//!     ..Settings::new(0.02) // s
//! };
//! let mut environment = ModelEnvironment::new(&model, settings, task)?;
//!
//! let mut observation = environment.reset(Some(1))?; // phi, phi_dot
//! let mut steps = 0;
//! loop {
//!     let torque = -4.0 * observation[0] - 0.8 * observation[1];
//!     let action = environment.action_space()[0].clip(torque);
//!     let step = environment.step(&[action])?;
//!     observation = step.observation;
//!     steps += 1;
//!     if step.terminated || step.truncated {
//!         break;
//!     }
//! }
//! assert_eq!(steps, 200); // it stands, though its motor is late
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
mod episode;
mod error;
mod model;
mod space;
mod task;
#[cfg(test)]
mod tests;

pub use episode::Episode;
pub use error::EnvironmentError;
pub use model::{ModelEnvironment, Settings};
pub use space::Channel;
pub use task::{Closures, Task, Transition, Verdict, uniform};

/// What came of an action.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// What is seen at the end of the step: as long as [`Environment::observation_space`].
    pub observation: Vec<f64>,
    /// What the step was worth.
    pub reward: f64,
    /// Whether the episode ended by itself: nothing comes after this state.
    pub terminated: bool,
    /// Whether it was cut off here because its time is up: the state has a future that is worth something.
    pub truncated: bool,
}

/// Something that is observed and acted upon in turn, in episodes, with the semantics of Gymnasium's `Env`.
///
/// Deterministic: the same seed and the same actions give the same bits.
pub trait Environment {
    /// One channel a number of an action. Its bounds are what [`step`](Self::step) takes.
    fn action_space(&self) -> &[Channel];

    /// One channel a number of an observation.
    fn observation_space(&self) -> &[Channel];

    /// The time that an action is held, s.
    fn interval(&self) -> f64;

    /// Begins an episode and returns what is seen. `None` goes on with the random numbers of the episodes before, those of seed 0 at first.
    ///
    /// # Errors
    /// [`EnvironmentError::Begin`] for a state that is none, and what a rig cannot do.
    fn reset(&mut self, seed: Option<u64>) -> Result<Vec<f64>, EnvironmentError>;

    /// Holds `action`, one number a channel, for one interval.
    ///
    /// # Errors
    /// [`EnvironmentError::NotReset`] and [`EnvironmentError::Over`] out of turn, [`EnvironmentError::ActionLength`] and [`EnvironmentError::Action`]
    /// for an action that is not in the action space: nothing has happened then. [`EnvironmentError::Reward`] and
    /// [`EnvironmentError::Stopped`] end the episode.
    fn step(&mut self, action: &[f64]) -> Result<Step, EnvironmentError>;
}
