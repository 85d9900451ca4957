//! What the errors of its start do to a free run.
//!
//! The start x₀ of a free run is fitted to its leading samples. With h_k = ∂ŷ_k/∂x₀ in units of the sensor's noise and P what is known of x₀ beforehand its covariance is
//! Σ = (Σ_lead h_kᵀ h_k + P)⁻¹, and a right model errs at sample k by the noise and, as far as the start is near, by √(h_k Σ h_kᵀ) more. Of a robot that would fall over, and
//! of what tumbles, that is many times the noise.

use std::f64::consts::{PI, SQRT_2};

use nalgebra::{DMatrix, DVector};
use statrs::statistics::Statistics;

use crate::hybrid::Hybrid;
use crate::shooting::problem::{Problem, late};
use crate::shooting::{
    Accumulator, Channel, HiddenPrior, Observations, ObservedRun, Residual, Roller, Trajectory,
    Window,
};

/// Free runs over windows, from states that were fitted to their leads.
pub struct Started<'a> {
    pub windows: &'a [Window],
    pub leads: &'a [Window],
    pub states: &'a [Vec<f64>],
    /// What is known of what effects with a memory remember at the start.
    pub hidden: &'a HiddenPrior,
}

/// By how much a right model errs at each sample of each channel because of its start, in units of the channel's noise, for each window; 0 where nothing is read, and
/// no more than two moments of the motion differ by. None where the roll-out diverges.
pub fn start_errors(
    (hybrid, theta): (&Hybrid, &[f64]),
    observations: &Observations,
    started: &Started<'_>,
    substeps: usize,
) -> Vec<Option<Vec<Vec<f64>>>> {
    let late = late(hybrid, theta);
    let problem = Problem::new(
        hybrid,
        observations,
        started.windows,
        &[],
        started.hidden,
        substeps,
    );
    let problem = problem.read_late(&late);
    let (inputs, readings) = (problem.drive(theta), problem.readings(theta));
    let runs = observations.runs.iter();
    let most: Vec<Vec<f64>> = runs.map(|run| apart(observations, run)).collect();
    let mut roller = Roller::new(hybrid, &[]);
    let nx = hybrid.nx();
    let of_window = |index: usize| {
        let (window, state) = (&started.windows[index], &started.states[index]);
        let mut trajectory = Trajectory::default();
        let span = (window.first, window.count);
        roller
            .roll_with_sensitivities(theta, &inputs[window.run], span, state, &mut trajectory)
            .ok()?;
        let mut row = vec![0.0; nx];
        let fill = |r: &Residual, row: &mut [f64]| {
            let scale = 1.0 / observations.channels[r.channel].noise;
            problem.fill_row(row, r, &readings, scale, &trajectory);
        };
        let mut normal = Accumulator::new(nx, 0);
        let residuals = || problem.residuals(window, &readings, &trajectory.states);
        for r in residuals().filter(|r| r.sample < started.leads[index].count) {
            fill(&r, &mut row);
            normal.add(&row, 0.0);
        }
        problem.add_prior(index, state, &mut normal);
        let covariance = normal.finish().solve_a(&DMatrix::identity(nx, nx))?;
        let mut errors = vec![vec![0.0; window.count]; observations.channels.len()];
        for r in residuals() {
            fill(&r, &mut row);
            let row = DVector::from_column_slice(&row);
            let square = row.dot(&(&covariance * &row));
            // Of a start that its lead does not determine it is beyond all numbers.
            errors[r.channel][r.sample] = match square.is_nan() {
                true => f64::INFINITY,
                false => square.max(0.0).sqrt(),
            };
        }
        for (errors, most) in errors.iter_mut().zip(&most[window.run]) {
            for error in errors {
                *error = error.min(*most);
            }
        }
        Some(errors)
    };
    (0..started.windows.len()).map(of_window).collect()
}

/// By how much two moments of a recording differ, in units of the noise of each channel, root mean square.
fn apart(observations: &Observations, run: &ObservedRun) -> Vec<f64> {
    let of_channel = |(c, channel): (usize, &Channel)| {
        let pairs = run.y[c].iter().zip(&run.valid[c]);
        let valid = pairs.filter(|(_, valid)| **valid).map(|(y, _)| *y);
        let apart = SQRT_2 * valid.population_std_dev();
        // Two angles of which nothing is known.
        let most = if channel.wraps {
            PI / 3.0_f64.sqrt()
        } else {
            f64::INFINITY
        };
        apart.min(most) / channel.noise
    };
    observations
        .channels
        .iter()
        .enumerate()
        .map(of_channel)
        .collect()
}
