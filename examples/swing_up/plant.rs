//! The learnt model, asked for one step from any state under any inputs.

use std::error::Error;

use nalgebra::Vector4;
use pinode_nn::environment::{
    Channel, Closures, Environment, ModelEnvironment, Settings, Task, Transition, Verdict,
};
use pinode_nn::model::Model;

/// x, m, φ, rad, ẋ, m/s, φ̇, rad/s.
pub type State = Vector4<f64>;

/// Integration steps of the learnt model are not longer than this, s.
const LONGEST_STEP: f64 = 5e-3;

/// Distances over which derivatives are differences: those of a cart that moves, so that dry friction counts as what it takes on the whole.
const AROUND: [f64; 4] = [0.02, 0.05, 0.2, 0.5];

/// How a model becomes an environment here.
pub fn settings(actions: &[Channel], interval: f64, episode: Option<usize>) -> Settings {
    Settings {
        actions: actions.to_vec(),
        longest_step: LONGEST_STEP,
        episode,
        ..Settings::new(interval)
    }
}

/// The model as a map from a state, the inputs under way and an input to the state an interval later.
pub struct Plant {
    environment: ModelEnvironment<Box<dyn Task>>,
}

impl Plant {
    /// Of `model`, which has one input.
    pub fn new(model: &Model, interval: f64) -> Result<Self, Box<dyn Error>> {
        let task: Box<dyn Task> = Box::new(Closures::new(
            |_: &mut dyn rand::Rng, _: &mut [f64]| {},
            |_: &Transition<'_>| Verdict {
                reward: 0.0,
                terminated: false,
            },
        ));
        let settings = settings(&[], interval, None);
        let environment = ModelEnvironment::new(model, settings, task)?;
        Ok(Plant { environment })
    }

    /// How many inputs before the present one are still under way.
    pub fn past(&self) -> usize {
        self.environment.past()
    }

    /// The state after the inputs `u`, N, of the intervals to come, where `past` are those before, the last one last.
    pub fn after(
        &mut self,
        state: &State,
        past: &[f64],
        u: &[f64],
    ) -> Result<State, Box<dyn Error>> {
        let past: Vec<&[f64]> = past.chunks(1).collect();
        self.environment.reset_to(state.as_slice(), &past)?;
        for &u in u {
            self.environment.step(&[u])?;
        }
        Ok(State::from_row_slice(self.environment.state()))
    }

    /// The state when all has arrived that is under way, and nothing after it.
    pub fn arrived(&mut self, state: &State, past: &[f64]) -> Result<State, Box<dyn Error>> {
        self.after(state, past, &vec![0.0; self.past()])
    }

    /// ∂(the state an interval later)/∂state, by central differences.
    pub fn by_state(
        &mut self,
        state: &State,
        past: &[f64],
        u: f64,
    ) -> Result<nalgebra::Matrix4<f64>, Box<dyn Error>> {
        let mut slopes = nalgebra::Matrix4::zeros();
        for (i, d) in AROUND.into_iter().enumerate() {
            let mut ends = [*state; 2];
            ends[0][i] += d;
            ends[1][i] -= d;
            let [up, down] = [
                self.after(&ends[0], past, &[u])?,
                self.after(&ends[1], past, &[u])?,
            ];
            slopes.set_column(i, &((up - down) / (2.0 * d)));
        }
        Ok(slopes)
    }
}
