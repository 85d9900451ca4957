//! What every part of a fit needs: the model, the windows, and the loss over them.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::normal::{Accumulator, Residual, fill_row, huber_loss, residuals};
use super::{Observations, Reduced, Roller, Trajectory, Window};
use crate::hybrid::{DrivenInputs, Hybrid};

/// The loss of a window whose roll-out diverges.
const DIVERGED_LOSS: f64 = 1e9;

/// One fit's fixed surroundings.
pub(crate) struct Problem<'a> {
    pub hybrid: &'a Hybrid,
    pub observations: &'a Observations,
    pub windows: &'a [Window],
    pub free: &'a [usize],
    /// For each channel the column of θ_free that is its zero.
    pub zero_column: Vec<Option<usize>>,
    pub substeps: usize,
}

impl<'a> Problem<'a> {
    pub fn new(
        hybrid: &'a Hybrid,
        observations: &'a Observations,
        windows: &'a [Window],
        free: &'a [usize],
        substeps: usize,
    ) -> Self {
        Problem {
            hybrid,
            observations,
            windows,
            free,
            zero_column: zero_columns(hybrid, observations, free),
            substeps,
        }
    }

    pub fn drive(&self, theta: &[f64]) -> Vec<DrivenInputs> {
        self.observations
            .runs
            .iter()
            .map(|run| {
                self.hybrid
                    .drive(&run.t, &run.u, self.substeps, theta, self.free)
            })
            .collect()
    }

    pub fn zeros(&self, theta: &[f64]) -> Vec<f64> {
        self.observations
            .channels
            .iter()
            .map(|channel| {
                if channel.velocity {
                    0.0
                } else {
                    theta[self.hybrid.zero_index(channel.coordinate)]
                }
            })
            .collect()
    }

    pub fn residuals<'b>(
        &'b self,
        window: &'b Window,
        zeros: &'b [f64],
        states: &'b [f64],
    ) -> impl Iterator<Item = Residual> + 'b {
        let run = &self.observations.runs[window.run];
        residuals(
            &self.observations.channels,
            self.hybrid.nv(),
            window.count,
            zeros,
            states,
            move |channel, sample| {
                let k = window.first + sample;
                run.valid[channel][k].then(|| run.y[channel][k])
            },
        )
    }

    pub fn loss_of(&self, window: &Window, zeros: &[f64], sigma: &[f64], states: &[f64]) -> f64 {
        self.residuals(window, zeros, states)
            .map(|r| huber_loss(r.value / sigma[r.channel]))
            .sum()
    }

    /// Reduced equations of all windows at (θ, states); `None` where they fail.
    pub fn reduced(
        &self,
        theta: &[f64],
        states: &[Vec<f64>],
        sigma: &[f64],
    ) -> Vec<Option<Reduced>> {
        let inputs = self.drive(theta);
        let zeros = self.zeros(theta);
        let nx = 2 * self.hybrid.nv();
        self.windows
            .par_iter()
            .zip(states)
            .map_init(
                || {
                    let row = vec![0.0; nx + self.free.len()];
                    (
                        Roller::new(self.hybrid, self.free),
                        Trajectory::default(),
                        row,
                    )
                },
                |(roller, trajectory, row), (window, state)| {
                    roller
                        .roll_with_sensitivities(
                            theta,
                            &inputs[window.run],
                            (window.first, window.count),
                            state,
                            trajectory,
                        )
                        .ok()?;
                    let mut normal = Accumulator::new(nx, self.free.len());
                    for r in self.residuals(window, &zeros, &trajectory.states) {
                        let scale = 1.0 / sigma[r.channel];
                        let state = self.observations.channels[r.channel].state(nx / 2);
                        let zero = self.zero_column[r.channel];
                        fill_row(row, &r, state, nx, scale, zero, trajectory);
                        normal.add(row, r.value * scale);
                    }
                    normal.finish().reduce()
                },
            )
            .collect()
    }

    /// The best state of every window near `states`, among full, short and no step, and its loss.
    pub fn step_states(
        &self,
        theta: &[f64],
        states: &[Vec<f64>],
        steps: &[Option<DVector<f64>>],
        sigma: &[f64],
    ) -> Vec<(Vec<f64>, f64)> {
        let inputs = self.drive(theta);
        let zeros = self.zeros(theta);
        self.windows
            .par_iter()
            .zip(states)
            .zip(steps)
            .map_init(
                || (Roller::new(self.hybrid, &[]), Trajectory::default()),
                |(roller, trajectory), ((window, state), step)| {
                    let mut loss_at = |x: &[f64]| {
                        let window_inputs = &inputs[window.run];
                        match roller.roll(
                            theta,
                            window_inputs,
                            (window.first, window.count),
                            x,
                            trajectory,
                        ) {
                            Ok(()) => self.loss_of(window, &zeros, sigma, &trajectory.states),
                            Err(_) => DIVERGED_LOSS,
                        }
                    };
                    let mut best = (state.clone(), loss_at(state));
                    if let Some(step) = step {
                        for fraction in [1.0, 0.3] {
                            let x: Vec<f64> = state
                                .iter()
                                .zip(step.iter())
                                .map(|(x, d)| x + fraction * d)
                                .collect();
                            let loss = loss_at(&x);
                            if loss < best.1 {
                                best = (x, loss);
                                break;
                            }
                        }
                    }
                    best
                },
            )
            .collect()
    }

    /// Sums of squared residuals and their numbers, per window and channel, and all residuals by channel.
    #[allow(clippy::type_complexity)]
    pub fn squares(
        &self,
        theta: &[f64],
        states: &[Vec<f64>],
    ) -> (Vec<Vec<(f64, usize)>>, Vec<Vec<f64>>) {
        let inputs = self.drive(theta);
        let zeros = self.zeros(theta);
        let channels = self.observations.channels.len();
        let per_window: Vec<Option<Vec<Vec<f64>>>> = self
            .windows
            .par_iter()
            .zip(states)
            .map_init(
                || (Roller::new(self.hybrid, &[]), Trajectory::default()),
                |(roller, trajectory), (window, state)| {
                    let span = (window.first, window.count);
                    roller
                        .roll(theta, &inputs[window.run], span, state, trajectory)
                        .ok()?;
                    let mut all = vec![Vec::new(); channels];
                    for r in self.residuals(window, &zeros, &trajectory.states) {
                        all[r.channel].push(r.value);
                    }
                    Some(all)
                },
            )
            .collect();
        let mut by_channel = vec![Vec::new(); channels];
        let squares = per_window
            .into_iter()
            .map(|window| match window {
                None => vec![(f64::INFINITY, 0); channels],
                Some(all) => all
                    .into_iter()
                    .enumerate()
                    .map(|(c, values)| {
                        let sum = (values.iter().map(|r| r * r).sum(), values.len());
                        by_channel[c].extend(values);
                        sum
                    })
                    .collect(),
            })
            .collect();
        (squares, by_channel)
    }

    /// Loss of the priors: Σ ½ ((θ − θ₀)/tolerance)².
    pub fn prior_loss(&self, theta: &[f64]) -> f64 {
        self.free
            .iter()
            .map(|&i| {
                let constant = &self.hybrid.constants()[i];
                0.5 * ((theta[i] - constant.value) / constant.tolerance).powi(2)
            })
            .sum()
    }

    /// Information and gradient in θ_free over all windows, priors included.
    pub fn assemble(
        &self,
        theta: &[f64],
        reduced: &[Option<Reduced>],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.free.len();
        let mut s = DMatrix::zeros(n, n);
        let mut g = DVector::zeros(n);
        for window in reduced.iter().flatten() {
            s += &window.s;
            g += &window.g;
        }
        for (k, &i) in self.free.iter().enumerate() {
            let constant = &self.hybrid.constants()[i];
            if constant.tolerance.is_finite() {
                let weight = 1.0 / constant.tolerance.powi(2);
                s[(k, k)] += weight;
                g[k] -= weight * (theta[i] - constant.value);
            }
        }
        (s, g)
    }
}

/// For each channel the column of θ_free that is its zero.
fn zero_columns(
    hybrid: &Hybrid,
    observations: &Observations,
    free: &[usize],
) -> Vec<Option<usize>> {
    observations
        .channels
        .iter()
        .map(|channel| {
            let index = hybrid.zero_index(channel.coordinate);
            free.iter().position(|&i| i == index && !channel.velocity)
        })
        .collect()
}
