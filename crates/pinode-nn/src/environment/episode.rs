//! Whose turn it is in an episode, and how long it goes on: what every environment keeps.

use super::{Channel, EnvironmentError, Step, Verdict};

/// Where an episode is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Before,
    Running,
    Over,
}

/// The turns of an episode, for those who implement [`Environment`](super::Environment):
///
/// ```
/// use pinode_nn::environment::{Channel, EnvironmentError, Episode, Verdict};
///
/// let space = [Channel::new("u.motor", -1.0, 1.0)];
/// let mut episode = Episode::new(Some(1))?;
/// assert!(matches!(episode.turn(&space, &[0.5]), Err(EnvironmentError::NotReset)));
/// episode.begin(); // in `reset`
/// episode.turn(&space, &[0.5])?; // in `step`, before anything moves
/// let step = episode.close(Verdict { reward: 1.0, terminated: false }, vec![0.0])?; // and when it has moved
/// assert!(step.truncated);
/// assert!(matches!(episode.turn(&space, &[0.5]), Err(EnvironmentError::Over { steps: 1 })));
/// # Ok::<(), EnvironmentError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Episode {
    most: Option<usize>,
    phase: Phase,
    steps: usize,
}

impl Episode {
    /// Before the first one; each is cut off after `most` steps.
    ///
    /// # Errors
    /// [`EnvironmentError::Setting`] for 0 steps.
    pub fn new(most: Option<usize>) -> Result<Self, EnvironmentError> {
        match most {
            Some(0) => Err(EnvironmentError::Setting {
                name: "episode",
                value: 0.0,
                condition: "at least 1 step, or `None`",
            }),
            most => Ok(Episode {
                most,
                phase: Phase::Before,
                steps: 0,
            }),
        }
    }

    /// Steps that have been made.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Begins.
    pub fn begin(&mut self) {
        self.phase = Phase::Running;
        self.steps = 0;
    }

    /// No episode is under way.
    pub fn leave(&mut self) {
        self.phase = Phase::Before;
    }

    /// Begins a step. Unless it is [closed](Self::close) the episode is over.
    ///
    /// # Errors
    /// [`EnvironmentError::NotReset`], [`EnvironmentError::Over`], [`EnvironmentError::ActionLength`] and [`EnvironmentError::Action`]; all is
    /// then as it was.
    pub fn turn(&mut self, space: &[Channel], action: &[f64]) -> Result<(), EnvironmentError> {
        match self.phase {
            Phase::Before => return Err(EnvironmentError::NotReset),
            Phase::Over => return Err(EnvironmentError::Over { steps: self.steps }),
            Phase::Running => {}
        }
        if action.len() != space.len() {
            return Err(EnvironmentError::ActionLength {
                found: action.len(),
                channels: space.iter().map(|channel| channel.name.clone()).collect(),
            });
        }
        let mut pairs = space.iter().zip(action);
        if let Some((channel, &value)) = pairs.find(|(channel, value)| !channel.contains(**value)) {
            return Err(EnvironmentError::Action {
                channel: channel.name.clone(),
                value,
                lower: channel.lower,
                upper: channel.upper,
            });
        }
        self.phase = Phase::Over;
        Ok(())
    }

    /// Ends a step.
    ///
    /// # Errors
    /// [`EnvironmentError::Reward`].
    pub fn close(
        &mut self,
        Verdict { reward, terminated }: Verdict,
        observation: Vec<f64>,
    ) -> Result<Step, EnvironmentError> {
        self.steps += 1;
        let steps = self.steps;
        if !reward.is_finite() {
            return Err(EnvironmentError::Reward {
                step: steps,
                reward,
            });
        }
        let truncated = self.most.is_some_and(|most| steps >= most);
        if !(terminated || truncated) {
            self.phase = Phase::Running;
        }
        Ok(Step {
            observation,
            reward,
            terminated,
            truncated,
        })
    }
}
