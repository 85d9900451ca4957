//! The forces that the inputs would have to make of a smoothed motion whose coordinates have the signs σ:
//!
//! τ = M(σ q) (σ q̈ − v̇₀(σ q, σ q̇)),  v̇₀ of the model without inputs.

use nalgebra::{DMatrix, DVector};

use super::windows::Sample;
use crate::hybrid::{Hybrid, State};

/// The forces that a motion needs.
pub struct Needed {
    /// τ of each coordinate, a sample an entry.
    pub forces: Vec<DVector<f64>>,
    /// Mean squares of M q̈ and of M v̇₀ together.
    pub squares: Vec<f64>,
}

impl Needed {
    /// Of the motion with these signs; none where the model has no acceleration.
    pub fn of(hybrid: &Hybrid, samples: &[Sample], signs: &[f64]) -> Option<Self> {
        let n = signs.len();
        let theta = hybrid.theta();
        let idle = vec![vec![0.0; 2]; hybrid.inputs()];
        let idle = hybrid.drive(&[0.0, 1.0], &idle, 1, &theta, &[]);
        let (mut memory, mut mass) = (hybrid.memory(&[]), DMatrix::zeros(n, n));
        let h = vec![0.0; hybrid.nh()];
        let sensors = hybrid.readings(&theta, &[]);
        let each = || signs.iter().zip(&sensors);
        let of_position = |y: &[f64]| -> Vec<f64> {
            let read = y.iter().zip(each());
            read.map(|(y, (s, sensor))| sensor.position_of(s * y, 0.0))
                .collect()
        };
        let of_rate = |y: &[f64]| -> Vec<f64> {
            let read = y.iter().zip(each());
            read.map(|(y, (s, sensor))| s * y / sensor.factor).collect()
        };
        let mut forces = vec![DVector::zeros(samples.len()); n];
        let mut squares = vec![f64::MIN_POSITIVE; n];
        for (k, sample) in samples.iter().enumerate() {
            let (q, v, a) = (
                of_position(&sample.q),
                of_rate(&sample.v),
                of_rate(&sample.a),
            );
            let state = State {
                q: &q,
                v: &v,
                h: &h,
            };
            let free = hybrid.acceleration(state, &theta, &idle, 0, &mut memory);
            free.ok()?;
            let free = memory.acceleration.clone();
            hybrid.mass_matrix_into(&q, &theta, &mut memory, &mut mass);
            let (made, own) = (&mass * DVector::from_vec(a), &mass * free);
            for c in 0..n {
                forces[c][k] = made[c] - own[c];
                squares[c] += (made[c].powi(2) + own[c].powi(2)) / samples.len() as f64;
            }
        }
        Some(Needed { forces, squares })
    }
}
