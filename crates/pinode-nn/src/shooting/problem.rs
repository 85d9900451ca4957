//! What every part of a fit needs: the model, the windows, and the loss over them.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::normal::{Accumulator, Residual, fill_row, huber_loss, residuals};
use super::{Observations, Reduced, Roller, Trajectory, Window};
use crate::hybrid::{DrivenInputs, Hybrid};

/// The loss of a window whose roll-out diverges.
const DIVERGED_LOSS: f64 = 1e9;

/// A window's initial state and the roll-out from it.
#[derive(Debug, Clone)]
pub(crate) struct Rolled {
    pub state: Vec<f64>,
    /// Channel and y − ŷ of every valid measurement; none where the roll-out diverges.
    pub residuals: Option<Vec<(usize, f64)>>,
}

impl Rolled {
    pub fn loss(&self, sigma: &[f64]) -> f64 {
        match &self.residuals {
            Some(residuals) => residuals
                .iter()
                .map(|&(c, r)| huber_loss(r / sigma[c]))
                .sum(),
            None => DIVERGED_LOSS,
        }
    }

    /// Sum of squared residuals and their number, one a channel; infinite where the roll-out diverges.
    pub fn squares(&self, channels: usize) -> Vec<(f64, usize)> {
        let Some(residuals) = &self.residuals else {
            return vec![(f64::INFINITY, 0); channels];
        };
        let mut squares = vec![(0.0, 0); channels];
        for &(c, r) in residuals {
            squares[c].0 += r * r;
            squares[c].1 += 1;
        }
        squares
    }
}

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

    /// Reduced equations of all windows at (θ, states); `None` where they fail.
    pub fn reduced(
        &self,
        theta: &[f64],
        present: &[Rolled],
        sigma: &[f64],
    ) -> Vec<Option<Reduced>> {
        let inputs = self.drive(theta);
        let zeros = self.zeros(theta);
        let nx = 2 * self.hybrid.nv();
        self.windows
            .par_iter()
            .zip(present)
            .map_init(
                || {
                    let row = vec![0.0; nx + self.free.len()];
                    (
                        Roller::new(self.hybrid, self.free),
                        Trajectory::default(),
                        row,
                    )
                },
                |(roller, trajectory, row), (window, present)| {
                    roller
                        .roll_with_sensitivities(
                            theta,
                            &inputs[window.run],
                            (window.first, window.count),
                            &present.state,
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

    /// The roll-outs from the given initial states.
    pub fn rolled(&self, theta: &[f64], states: Vec<Vec<f64>>) -> Vec<Rolled> {
        let inputs = self.drive(theta);
        let zeros = self.zeros(theta);
        self.windows
            .par_iter()
            .zip(states)
            .map_init(
                || (Roller::new(self.hybrid, &[]), Trajectory::default()),
                |(roller, trajectory), (window, state)| {
                    self.roll(roller, trajectory, theta, &inputs, &zeros, window, state)
                },
            )
            .collect()
    }

    /// The roll-outs after a step of every initial state: the full one where it does not raise the loss above the present one, else
    /// the best of full, short and none.
    pub fn stepped(
        &self,
        theta: &[f64],
        present: &[Rolled],
        steps: &[Option<DVector<f64>>],
        sigma: &[f64],
    ) -> Vec<Rolled> {
        let inputs = self.drive(theta);
        let zeros = self.zeros(theta);
        self.windows
            .par_iter()
            .zip(present)
            .zip(steps)
            .map_init(
                || (Roller::new(self.hybrid, &[]), Trajectory::default()),
                |(roller, trajectory), ((window, present), step)| {
                    let limit = present.loss(sigma);
                    let fractions: &[f64] = match step {
                        Some(_) => &[1.0, 0.3, 0.0],
                        None => &[0.0],
                    };
                    let mut best: Option<(f64, Rolled)> = None;
                    for fraction in fractions {
                        let mut state = present.state.clone();
                        for (x, d) in state.iter_mut().zip(step.iter().flat_map(|d| d.iter())) {
                            *x += fraction * d;
                        }
                        let rolled =
                            self.roll(roller, trajectory, theta, &inputs, &zeros, window, state);
                        let loss = rolled.loss(sigma);
                        if best.as_ref().is_none_or(|(least, _)| loss < *least) {
                            best = Some((loss, rolled));
                        }
                        if loss <= limit {
                            break;
                        }
                    }
                    best.map_or_else(|| present.clone(), |(_, rolled)| rolled)
                },
            )
            .collect()
    }

    #[allow(clippy::too_many_arguments)]
    fn roll(
        &self,
        roller: &mut Roller,
        trajectory: &mut Trajectory,
        theta: &[f64],
        inputs: &[DrivenInputs],
        zeros: &[f64],
        window: &Window,
        state: Vec<f64>,
    ) -> Rolled {
        let span = (window.first, window.count);
        let residuals = roller
            .roll(theta, &inputs[window.run], span, &state, trajectory)
            .is_ok()
            .then(|| {
                self.residuals(window, zeros, &trajectory.states)
                    .map(|r| (r.channel, r.value))
                    .collect()
            });
        Rolled { state, residuals }
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
