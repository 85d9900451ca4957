//! The states that windows start from, where they are fitted: what the network gains is to be its own, not that of a start that fits an older one.
//!
//! For given weights the loss J of a window has its least over the start x₀ at some x₀(W), and there dJ(W, x₀(W))/dW = ∂J/∂W. So the starts
//! follow the weights: whenever a window is seen, x₀ ← x₀ − H⁻¹ ∂J/∂x₀, H = 2 Σ λ_i s_i s_iᵀ (Gauss and Newton), s_i the derivatives of the
//! compared numbers in x₀. H changes slowly: it is taken anew now and then.

use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;

use super::data::{Recordings, Side};
use super::physics::STATE_STEPS;
use crate::hybrid::Hybrid;
use crate::shooting::{FitOptions, HiddenPrior, Roller, Trajectory, fit};

/// H is greater by this share of its diagonal: what a window hardly determines moves slowly.
const DAMPING: f64 = 1e-3;
/// A window whose sum, in units of κ of the loss, has grown by this factor, and by this much beside, has got worse.
const WORSE: f64 = 1.5;
const NEAR: f64 = 0.01;
/// Nothing is known of a start before.
const FARTHEST: f64 = 1e300;
/// Steps get shorter by this factor then.
const SHORTER: f64 = 4.0;

impl Recordings {
    /// Fits the start of every window to its measurements, everything else as it is in `hybrid`, and takes H there.
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
            &HiddenPrior::none(side.windows.len()),
            &FitOptions {
                substeps: self.substeps,
                iterations: 0,
                state_iterations: STATE_STEPS,
            },
        );
        let mut side = Side {
            windows: side.windows.clone(),
            starts: fitted.states,
            curvatures: Vec::new(),
            trust: Vec::new(),
        };
        side.curvatures = (0..side.windows.len())
            .into_par_iter()
            .map_init(
                || (Roller::new(hybrid, &[]), Trajectory::default()),
                |(roller, trajectory), index| {
                    self.curvature(&side, index, hybrid, roller, trajectory)
                },
            )
            .collect();
        side.trust_all();
        side
    }

    /// H⁻¹ of a window, column after column; 0 where it has no motion: its start then stays.
    fn curvature(
        &self,
        side: &Side,
        index: usize,
        hybrid: &Hybrid,
        roller: &mut Roller<'_>,
        trajectory: &mut Trajectory,
    ) -> Vec<f64> {
        let nx = hybrid.nx();
        let member = self.member(side, index);
        let span = (member.first, self.horizon + 1);
        let rolled = roller.roll_with_sensitivities(
            &self.theta,
            member.inputs,
            span,
            member.start,
            trajectory,
        );
        let mut matrix = DMatrix::zeros(nx, nx);
        if rolled.is_ok() {
            for sample in self.loss.first..=self.horizon {
                let x = &trajectory.states[sample * nx..][..nx];
                let s = &trajectory.sensitivities[sample * nx * nx..][..nx * nx];
                let at = member.first + sample;
                self.loss.residuals(
                    member.target,
                    at,
                    |i| x[i],
                    |i, weight, _| {
                        let row = nalgebra::DVector::from_fn(nx, |k, _| s[k * nx + i]);
                        matrix.ger(2.0 * weight, &row, &row, 1.0);
                    },
                );
            }
        }
        for k in 0..nx {
            matrix[(k, k)] *= 1.0 + DAMPING;
        }
        match Cholesky::new(matrix) {
            Some(factor) => factor.inverse().as_slice().to_vec(),
            None => vec![0.0; nx * nx],
        }
    }
}

impl Side {
    /// One step of Gauss and Newton of the start of window `index`, where ∂J/∂x₀ is `gradient`, of the window's sum times `factor`; back to the start
    /// of before, and shorter from there, where the step before has made the window much worse (H is not that of where it stands any more).
    pub fn improve_start(&mut self, index: usize, gradient: &[f64], factor: f64) {
        let (start, trust) = (&mut self.starts[index], &mut self.trust[index]);
        let [distance, length] = [trust[0], trust[1]];
        let now = 1.0 / factor - 1.0;
        if factor == 0.0 || now > WORSE * distance + NEAR {
            start.copy_from_slice(&trust[2..]);
            // The network moves, too: what was reached with another one may be out of reach.
            trust[0] = WORSE * distance + NEAR;
            trust[1] = length / SHORTER;
            return;
        }
        trust[0] = now;
        trust[1] = (2.0 * length).min(1.0);
        trust[2..].copy_from_slice(start);
        let columns = self.curvatures[index].chunks_exact(gradient.len());
        for (column, gradient) in columns.zip(gradient) {
            for (x, entry) in start.iter_mut().zip(column) {
                *x -= length * entry * gradient / factor;
            }
        }
    }

    /// All steps are whole ones again, and nothing is known of those before.
    fn trust_all(&mut self) {
        let of = |start: &Vec<f64>| [&[FARTHEST, 1.0], start.as_slice()].concat();
        self.trust = self.starts.iter().map(of).collect();
    }
}
