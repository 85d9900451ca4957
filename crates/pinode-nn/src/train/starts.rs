//! The states that windows start from, where they are fitted: what the network gains is to be its own, not that of a start that fits an older one.
//!
//! For given weights the loss J of a window has its least over the start x₀ at some x₀(W), and there dJ(W, x₀(W))/dW = ∂J/∂W. So the starts
//! follow the weights: whenever a window is seen, it makes a step of Levenberg and Marquardt, x₀ ← x₀ − (H + μ diag H)⁻¹ ∂J/∂x₀. What effects with a
//! memory remember there is where the recording takes them: free, it would explain forces that are not there.

use super::adjoint::{CHUNK, Chunk};
use super::data::{Recordings, Side};
use super::loss::Loss;
use super::physics::STATE_STEPS;
use crate::hybrid::Hybrid;
use crate::network::Real;
use crate::shooting::{FitOptions, HiddenPrior, fit};

/// A window whose sum at a sample has grown by this factor, and by this many squares of the noise beside, has got worse.
const WORSE: f64 = 1.2;
const NEAR: f64 = 1.0;
/// Nothing is known of a start before.
const FARTHEST: f64 = 1e300;
/// μ at first, and at least; how it grows and falls; the most of it.
const LEAST: f64 = 1e-3;
const HARDER: f64 = 10.0;
const SOFTER: f64 = 0.3;
const MOST: f64 = 1e4;

impl Recordings {
    /// Fits the start of every window to its measurements, everything else as it is in `hybrid`.
    pub fn fit_starts(&mut self, hybrid: &Hybrid) {
        self.seen = self.fitted(&self.seen, hybrid);
        self.held_out = self.fitted(&self.held_out, hybrid);
    }

    fn fitted(&self, side: &Side, hybrid: &Hybrid) -> Side {
        let fitted = fit(
            hybrid,
            &self.observations,
            &side.windows,
            &[],
            self.theta.clone(),
            side.starts.clone(),
            self.noise(),
            &HiddenPrior::kept(&side.starts, side.visible),
            &FitOptions {
                substeps: self.substeps,
                iterations: 0,
                state_iterations: STATE_STEPS,
            },
        );
        let mut side = Side {
            windows: side.windows.clone(),
            starts: fitted.states,
            visible: side.visible,
            trust: Vec::new(),
        };
        side.trust_all();
        side
    }
}

impl Side {
    /// One step of the starts of a batch, from what its chunks know of them.
    pub fn improve<T: Real>(&mut self, loss: &Loss, batch: &[usize], chunks: &mut [Chunk<T>]) {
        for (chunk, batch) in chunks.iter_mut().zip(batch.chunks(CHUNK)) {
            for (k, &index) in batch.iter().enumerate() {
                self.improve_start(loss, index, chunk, k);
            }
        }
    }

    /// One step of the start of window `index`, number `k` of its chunk; back to the start of before, with more damping from there, where the step
    /// before has made the window much worse.
    fn improve_start<T: Real>(
        &mut self,
        loss: &Loss,
        index: usize,
        chunk: &mut Chunk<T>,
        k: usize,
    ) {
        let (start, trust) = (
            &mut self.starts[index][..self.visible],
            &mut self.trust[index],
        );
        let (known, before) = trust.split_at_mut(2);
        let [distance, damping] = [known[0], known[1]];
        let factor = chunk.factor(k);
        let now = loss.distance(factor);
        if factor == 0.0 || now > WORSE * distance + NEAR {
            start.copy_from_slice(before);
            // The network moves, too: what was reached with another one may be out of reach.
            known[0] = WORSE * distance + NEAR;
            known[1] = (HARDER * damping).min(MOST);
            return;
        }
        known[0] = now;
        known[1] = (SOFTER * damping).max(LEAST);
        before.copy_from_slice(start);
        chunk.move_start(k, damping, start);
    }

    /// Notes how far the windows of a batch are from their measurements, as their chunks have rolled them out.
    pub fn look<T: Real>(&mut self, loss: &Loss, batch: &[usize], chunks: &[Chunk<T>]) {
        for (chunk, batch) in chunks.iter().zip(batch.chunks(CHUNK)) {
            for (k, &index) in batch.iter().enumerate() {
                let distance = loss.distance(chunk.factor(k));
                self.trust[index][0] = if distance < FARTHEST {
                    distance
                } else {
                    FARTHEST
                };
            }
        }
    }

    /// How far windows are from their measurements, in the median.
    pub fn median_distance(&self) -> f64 {
        let mut all: Vec<f64> = self.trust.iter().map(|trust| trust[0]).collect();
        let middle = all.len() / 2;
        match all.is_empty() {
            true => 0.0,
            false => *all.select_nth_unstable_by(middle, f64::total_cmp).1,
        }
    }

    /// Nothing is known of the steps before.
    pub(super) fn trust_all(&mut self) {
        let of = |start: &Vec<f64>| [&[FARTHEST, LEAST], &start[..self.visible]].concat();
        self.trust = self.starts.iter().map(of).collect();
    }
}
