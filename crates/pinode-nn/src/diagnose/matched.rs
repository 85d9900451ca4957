//! A network that begins with the forces that the accelerations of a log ask for.
//!
//! From no force at all roll-outs that are far from the log lead nowhere: where they tumble, no small change of a force brings them nearer. The forces F that are
//! [needed](super::needed) are not integrated, and a network is fitted to them first, by Gauss, Newton and Levenberg: least
//!
//! Σ |y(z) − F/s|²/η² + Σ (p − p₀)²/T²
//!
//! over its parameters p. It is where the fit of the roll-outs starts.

use nalgebra::{DMatrix, DVector};

use crate::network::{Mlp, Single};

/// η: what is left of the forces, in units of their scale.
const NOISE: f64 = 0.3;
/// Iterations, and the damping at first, in shares of the diagonal; it grows and falls by this factor.
const ITERATIONS: usize = 20;
const DAMPING: f64 = 1e-2;
const FACTOR: f64 = 10.0;
const MOST_DAMPING: f64 = 1e8;
/// It ends where a step gains less than this share.
const LEAST_GAIN: f64 = 1e-3;
/// Forces count up to so many times their scale: a blow is no law.
const MOST: f64 = 5.0;

/// The network, fitted to what its outputs `y` are to be where its inputs are `z`, one row a sample, with the tolerance T of its parameters about what they are.
pub fn matched(network: &Mlp<f64>, z: &[Vec<f64>], y: &[Vec<f64>], tolerance: f64) -> Mlp<f64> {
    let first = DVector::from_column_slice(network.parameters());
    let mut best = Linear::of(network, z, y, (&first, tolerance));
    let mut network = network.clone();
    let mut damping = DAMPING;
    for _ in 0..ITERATIONS {
        let Some(step) = best.step(damping) else {
            damping *= FACTOR;
            continue;
        };
        let mut next = network.clone();
        for (p, step) in next.parameters_mut().iter_mut().zip(&step) {
            *p += step;
        }
        let there = Linear::of(&next, z, y, (&first, tolerance));
        if there.sum < best.sum {
            let gain = 1.0 - there.sum / best.sum;
            (network, best) = (next, there);
            damping /= FACTOR;
            if gain < LEAST_GAIN {
                break;
            }
        } else {
            damping *= FACTOR;
            if damping > MOST_DAMPING {
                break;
            }
        }
    }
    network
}

/// The sum of squares about some parameters.
struct Linear {
    /// Half of it.
    sum: f64,
    gradient: DVector<f64>,
    information: DMatrix<f64>,
}

impl Linear {
    fn of(
        network: &Mlp<f64>,
        z: &[Vec<f64>],
        y: &[Vec<f64>],
        (first, tolerance): (&DVector<f64>, f64),
    ) -> Self {
        let count = network.parameters().len();
        let outputs = network.shape().outputs();
        let mut single = Single::default();
        // One column a residual.
        let mut slopes = DMatrix::zeros(count, z.len() * outputs);
        let mut residuals = DVector::zeros(z.len() * outputs);
        for (k, (z, y)) in z.iter().zip(y).enumerate() {
            let value = single.evaluate(network, z);
            for (o, (value, y)) in value.iter().zip(y).enumerate() {
                residuals[k * outputs + o] = (value - y.clamp(-MOST, MOST)) / NOISE;
            }
            for o in 0..outputs {
                let mut column = slopes.column_mut(k * outputs + o);
                single.gradients(network, o, |i, slope| column[i] = slope / NOISE);
            }
        }
        let moved = (DVector::from_column_slice(network.parameters()) - first) / tolerance;
        let mut information = &slopes * slopes.transpose();
        for i in 0..count {
            information[(i, i)] += tolerance.powi(-2);
        }
        Linear {
            sum: 0.5 * (residuals.norm_squared() + moved.norm_squared()),
            gradient: slopes * residuals + moved / tolerance,
            information,
        }
    }

    /// The step to the least of it, as far as this damping lets it go.
    fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let mut damped = self.information.clone();
        for i in 0..damped.nrows() {
            damped[(i, i)] *= 1.0 + damping;
        }
        Some(-damped.cholesky()?.solve(&self.gradient))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::network::{Activation, Shape};

    #[test]
    fn a_network_takes_a_force_of_two_signals_from_accelerations() {
        let shape = Shape::new(&[2, 16, 1], Activation::Tanh, Activation::Identity).unwrap();
        let network = Mlp::xavier(shape, &mut ChaCha8Rng::seed_from_u64(3));
        let force = |z: &[f64]| (1.5 * z[0] + 2.0 * z[1]).sin() - 0.4 * z[1];
        let at = |i: usize| vec![(0.37 * i as f64).sin() * 1.5, (0.53 * i as f64).cos() * 1.5];
        let z: Vec<Vec<f64>> = (0..800).map(at).collect();
        let y: Vec<Vec<f64>> = z.iter().map(|z| vec![force(z)]).collect();
        let matched = matched(&network, &z, &y, 3.0);
        let left = |network: &Mlp<f64>| -> f64 {
            let at = |i: usize| vec![(0.31 * i as f64).sin() * 1.4, (0.77 * i as f64).cos() * 1.4];
            let error = |i: usize| (network.evaluate(&at(i))[0] - force(&at(i))).powi(2);
            ((0..300).map(error).sum::<f64>() / 300.0).sqrt()
        };
        assert!(
            left(&network) > 0.5 && left(&matched) < 0.1,
            "{} {}",
            left(&network),
            left(&matched)
        );
    }
}
