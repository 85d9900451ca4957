//! Accelerations of a model at the states of a log, as the smoothing of that log sees the true ones.
//!
//! The second derivative of a local polynomial is a weighted mean of the accelerations over its samples. The modelled ones under the same weights differ from it by
//! what is not modelled, and by noise, however far the smoothing reaches.

use std::ops::RangeInclusive;

use nalgebra::DVector;

use super::smooth::Smoothed;
use crate::hybrid::{Hybrid, State};
use crate::shooting::ObservedRun;

/// How the local polynomials of a recording see accelerations.
pub struct Seen {
    /// Mean time between two samples, s.
    pub interval: f64,
    /// Samples a quarter of a polynomial apart: closer ones say the same.
    pub stride: usize,
    /// Standard deviation of an acceleration under unit noise of the position, 1/s².
    pub noise: f64,
    /// Samples on either side.
    side: usize,
    /// See [`weights`].
    weights: Vec<f64>,
}

impl Seen {
    /// By polynomials over the samples within `half_width` s, and at least three on either side.
    pub fn of(t: &[f64], half_width: f64) -> Self {
        let duration = t.last().unwrap_or(&0.0) - t.first().unwrap_or(&0.0);
        let interval = (duration / t.len().saturating_sub(1).max(1) as f64).max(1e-12);
        let side = ((half_width / interval) as usize).max(3);
        let samples = (2 * side + 1) as f64;
        Seen {
            interval,
            stride: ((0.5 * half_width / interval) as usize).max(1),
            // That of a local quadratic's or cubic's second derivative.
            noise: (720.0 / samples.powi(5)).sqrt() / interval.powi(2),
            side,
            weights: weights(side),
        }
    }

    /// Whether the polynomial at sample `k` of `count` has all of its samples.
    pub fn reaches(&self, k: usize, count: usize) -> bool {
        k >= self.side && k + self.side < count
    }

    /// The samples of the polynomial at sample `k`, of one that it [reaches](Self::reaches).
    pub fn samples(&self, k: usize) -> RangeInclusive<usize> {
        k - self.side..=k + self.side
    }

    /// The modelled accelerations around sample `k` as the smoothing sees the true ones, of a sample that it [reaches](Self::reaches).
    pub fn averaged(&self, modelled: &[Vec<f64>], k: usize) -> Vec<f64> {
        let first = k - self.weights.len() / 2;
        let mut sum = vec![0.0; modelled[k].len()];
        for (weight, acceleration) in self.weights.iter().zip(&modelled[first..]) {
            for (sum, a) in sum.iter_mut().zip(acceleration) {
                *sum += weight * a;
            }
        }
        sum
    }
}

/// The states of a model at θ by sample: the smoothed ones, as its sensors read them.
pub fn states<'a>(
    (hybrid, theta): (&'a Hybrid, &'a [f64]),
    smooth: &'a Smoothed,
) -> impl Fn(usize) -> Vec<f64> + 'a {
    let nv = hybrid.nv();
    let readings = hybrid.readings(theta, &[]);
    move |sample| {
        let mut state = smooth.state(sample);
        for (c, reading) in readings.iter().enumerate() {
            state[c] = reading.position_of(state[c], state[nv + c]);
        }
        state
    }
}

/// v̇ of a model at θ over every sample interval of a recording: the mean of both ends, at the smoothed states and the input held; NaN where it has none.
pub fn modelled(
    (hybrid, theta): (&Hybrid, &[f64]),
    run: &ObservedRun,
    smooth: &Smoothed,
) -> Vec<Vec<f64>> {
    let nv = hybrid.nv();
    let inputs = hybrid.drive(&run.t, &run.u, 1, theta, &[]);
    let mut memory = hybrid.memory(&[]);
    let read = states((hybrid, theta), smooth);
    let path = hybrid.hidden_path(theta, &inputs, &read);
    let mut at = |sample: usize, step: usize| -> Vec<f64> {
        let state = read(sample);
        let (q, v) = state.split_at(nv);
        let h = path.at(sample);
        match hybrid.acceleration(State { q, v, h }, theta, &inputs, step, &mut memory) {
            Ok(()) => memory.acceleration.as_slice().to_vec(),
            Err(_) => vec![f64::NAN; nv],
        }
    };
    (0..run.t.len().saturating_sub(1))
        .map(|k| {
            let ends = at(k, k).into_iter().zip(at(k + 1, k));
            ends.map(|(a, b)| 0.5 * (a + b)).collect()
        })
        .collect()
}

/// v̇ − v̇_model at sample `k`, where the [averaged](Seen::averaged) accelerations of a model are these.
pub fn missing(smooth: &Smoothed, k: usize, model: &[f64]) -> DVector<f64> {
    let missing = smooth.a.iter().zip(model).map(|(a, model)| a[k] - model);
    DVector::from_iterator(model.len(), missing)
}

/// The weights with which the second derivative of a local quadratic or cubic over the samples −m … m sees the true acceleration over
/// each of the 2m intervals; their sum is 1.
///
/// That derivative is Σ c_i y_i with c_i ∝ i² − m(m + 1)/3 and Σ c_i i² = 2; an acceleration at time s counts K(s) = Σ_{i>s} c_i (i − s).
fn weights(m: usize) -> Vec<f64> {
    let m = m as i64;
    let middle = (m * (m + 1)) as f64 / 3.0;
    let raw = |i: i64| (i * i) as f64 - middle;
    let norm: f64 = (-m..=m).map(|i| raw(i) * (i * i) as f64).sum::<f64>() / 2.0;
    let k = |j: i64| (j..=m).map(|i| raw(i) * (i - j) as f64).sum::<f64>() / norm;
    (-m..m).map(|j| 0.5 * (k(j) + k(j + 1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_see_an_acceleration_as_the_local_fit_does() {
        for m in [3_usize, 5, 8] {
            // Positions under an acceleration that is constant over each interval.
            let accelerations: Vec<f64> =
                (0..2 * m).map(|j| (1.7 * j as f64).sin() + 0.3).collect();
            let (mut q, mut v) = (vec![0.4], -0.2);
            for a in &accelerations {
                q.push(q[q.len() - 1] + v + 0.5 * a);
                v += a;
            }
            // Second derivative of the quadratic fitted to them by least squares.
            let s: Vec<f64> = (0..=2 * m).map(|i| i as f64 - m as f64).collect();
            let mean = |f: &dyn Fn(usize) -> f64| (0..=2 * m).map(f).sum::<f64>() / s.len() as f64;
            let square = mean(&|i| s[i].powi(2));
            let covariance = mean(&|i| (s[i].powi(2) - square) * q[i]);
            let fitted = 2.0 * covariance / mean(&|i| (s[i].powi(2) - square).powi(2));
            let seen: f64 = weights(m)
                .iter()
                .zip(&accelerations)
                .map(|(w, a)| w * a)
                .sum();
            assert!((seen - fitted).abs() < 1e-12, "{seen} {fitted}");
        }
    }
}
