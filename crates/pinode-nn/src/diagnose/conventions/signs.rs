//! Signs of many signals at once, by the equations and without a fit. Where each wrong sign hides the others no single one helps, and of n coordinates and as
//! many inputs there are 4ⁿ ways to count.
//!
//! For each choice σ of the signs of the coordinates the forces that the inputs would have to make of the smoothed motion,
//!
//! τ = M(σ q) (σ q̈ − v̇₀(σ q, σ q̇)),
//!
//! with v̇₀ of the model without inputs, are those of the inputs on each coordinate, times what makes them so, beside a friction:
//!
//! τᵢ ≈ Σⱼ βⱼ uⱼ + dᵢ q̇ᵢ + cᵢ sgn q̇ᵢ + oᵢ.
//!
//! The signs and units of the inputs are those of βⱼ over the gain. What is left over of τᵢ, over the size of M q̈ and of the rest together, ranks the choices.

use nalgebra::{DMatrix, DVector};

use super::reading::{Reading, Signal, unit_of_input};
use super::windows::Windows;
use crate::hybrid::{Hybrid, State};
use crate::model::Model;

/// So many coordinates have 1024 choices.
const MOST_COORDINATES: usize = 10;
/// So many of the choices are worth a fit.
const LIKELY: usize = 4;
/// What is left over is not told from less than this part.
const FLOOR: f64 = 0.02;
/// Singular values below this part of the largest one are none.
const ALIKE: f64 = 1e-9;

/// The ways to count that the equations speak for, the likeliest first: choices of signs, with the signs and units that the inputs have beside them. None where
/// an input acts on a link.
pub fn likely(windows: &Windows, model: &Model) -> Vec<Vec<Reading>> {
    let on: Option<Vec<usize>> = model.inputs.iter().map(|i| i.coordinate()).collect();
    let n = model.mechanics.coordinates().len();
    let (Some(on), true) = (on, n <= MOST_COORDINATES) else {
        return Vec::new();
    };
    let samples = windows.smoothed();
    let makes: Vec<Makes> = (0..n).map(|c| Makes::on(c, &on, &samples)).collect();
    let choices = (0..1_usize << n).map(|choice| -> Vec<f64> {
        let sign = |c: usize| if choice >> c & 1 == 1 { -1.0 } else { 1.0 };
        (0..n).map(sign).collect()
    });
    let mut ranked: Vec<(f64, Vec<Reading>)> = choices
        .filter_map(|signs| {
            let needed = Needed::of(windows.hybrid(), &samples, &signs)?;
            let (mut left, mut readings) = (0.0, Vec::new());
            for (c, sign) in signs.into_iter().enumerate() {
                readings.push(Reading::of(Signal::Coordinate(c), sign, 0.0));
                let (part, factors) = makes[c].explain(&needed.forces[c]);
                left += (part / needed.squares[c] + FLOOR * FLOOR).ln();
                let inputs = makes[c].inputs.iter().zip(factors);
                readings.extend(inputs.map(|(&input, factor)| {
                    let scale = unit_of_input(factor / model.inputs[input].gain);
                    Reading::of(Signal::Input(input), scale, 0.0)
                }));
            }
            readings.retain(Reading::is_other);
            Some((left, readings))
        })
        .filter(|(left, readings)| left.is_finite() && !readings.is_empty())
        .collect();
    ranked.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let likely = ranked.into_iter().take(LIKELY);
    likely.map(|(_, readings)| readings).collect()
}

/// A sample of a smoothed recording.
pub struct Sample {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub a: Vec<f64>,
    /// The inputs, smoothed as the accelerations are.
    pub u: Vec<f64>,
}

/// What makes the force on a coordinate.
struct Makes {
    /// The inputs on it.
    inputs: Vec<usize>,
    /// A row a sample: these inputs, and a friction.
    columns: DMatrix<f64>,
    /// Its pseudo-inverse.
    inverse: DMatrix<f64>,
}

impl Makes {
    fn on(coordinate: usize, on: &[usize], samples: &[Sample]) -> Self {
        let inputs: Vec<usize> = (0..on.len()).filter(|i| on[*i] == coordinate).collect();
        let row = |s: &Sample| {
            let driven = inputs.iter().map(|i| s.u[*i]);
            let v = s.v[coordinate];
            let rubs = [v, if v < 0.0 { -1.0 } else { 1.0 }, 1.0];
            driven.chain(rubs).collect::<Vec<f64>>()
        };
        let rows: Vec<f64> = samples.iter().flat_map(row).collect();
        let columns = DMatrix::from_row_slice(samples.len(), inputs.len() + 3, &rows);
        let inverse = columns.clone().pseudo_inverse(ALIKE);
        Makes {
            inverse: inverse.unwrap_or_else(|_| columns.transpose() * 0.0),
            inputs,
            columns,
        }
    }

    /// Mean square of what is left of a force, and the factors of the inputs.
    fn explain(&self, force: &DVector<f64>) -> (f64, Vec<f64>) {
        let factors = &self.inverse * force;
        let left = force - &self.columns * &factors;
        let factors = factors.iter().take(self.inputs.len());
        (
            left.norm_squared() / force.len().max(1) as f64,
            factors.copied().collect(),
        )
    }
}

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
        let turned = |x: &[f64]| -> Vec<f64> { x.iter().zip(signs).map(|(x, s)| s * x).collect() };
        let mut forces = vec![DVector::zeros(samples.len()); n];
        let mut squares = vec![f64::MIN_POSITIVE; n];
        for (k, sample) in samples.iter().enumerate() {
            let (q, v, a) = (turned(&sample.q), turned(&sample.v), turned(&sample.a));
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
