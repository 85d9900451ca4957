//! Initial states alone, while θ stays: no window knows of the others, and each is done when its own steps gain nothing.

use super::Window;
use super::fit::{Ended, Going, WORTH_GOING_ON};
use super::problem::{Problem, Rolled};

/// A window is done when a step of its initial state gains no more, nats.
const DONE: f64 = 1e-2;

impl Going {
    /// Steps of the initial states of the windows that are not done.
    pub(super) fn settle(&mut self, problem: &Problem, iterations: usize) -> Ended {
        let all = 0..self.now.len();
        let mut moving: Vec<usize> = all.clone().collect();
        let mut gains = [f64::INFINITY; 2];
        let mut looked = false;
        for _ in 0..iterations {
            let gained = self.step_of(problem, &mut moving);
            gains = [gains[1], gained];
            self.take_spread(problem);
            if moving.is_empty() {
                let more = match looked {
                    false => self.look(problem),
                    true => 0.0,
                };
                looked = true;
                self.take_spread(problem);
                if more < WORTH_GOING_ON {
                    break;
                }
                moving = all.clone().collect();
            }
        }
        Ended {
            converged: moving.is_empty(),
            gained: gains[0].max(gains[1]),
            looked,
        }
    }

    /// One step of the windows that are `moving`, of which those that are done are left out from then on; what it gains, nats.
    fn step_of(&mut self, problem: &Problem, moving: &mut Vec<usize>) -> f64 {
        let windows: Vec<Window> = moving.iter().map(|&k| problem.windows[k]).collect();
        let hidden = problem.hidden.some(moving);
        let few = Problem {
            windows: &windows,
            hidden: &hidden,
            ..*problem
        };
        let take = |&k: &usize| {
            let own = &mut self.now[k];
            let trajectory = own.trajectory.take();
            Rolled {
                trajectory,
                ..own.clone()
            }
        };
        let mut present: Vec<Rolled> = moving.iter().map(take).collect();
        let reduced = few.reduced(&self.theta, &mut present, &self.sigma);
        let stepped = few.stepped_alone(&self.theta, &present, reduced, &self.sigma);
        let mut gained = 0.0;
        let mut own = present.iter().zip(stepped);
        moving.retain(|&k| {
            let Some((before, after)) = own.next() else {
                return false;
            };
            let gain = before.loss(&self.sigma) - after.loss(&self.sigma);
            gained += gain;
            self.now[k] = after;
            gain > DONE
        });
        gained
    }
}
