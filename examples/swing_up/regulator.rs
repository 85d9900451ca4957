//! Holds the pole upright: a linear-quadratic regulator of the learnt model.
//!
//! It acts on p, the state when all has arrived that is under way: p_{k+1} = Φ p_k + Γ u_k, without a delay, with Φ and Γ differences of the model's
//! steps about upright. u = −K p, K = (R + Γᵀ S Γ)⁻¹ Γᵀ S Φ, where S = Q + Φᵀ S (Φ − Γ K) comes from iterating.

use std::error::Error;

use nalgebra::{Matrix4, RowVector4};

use super::plant::{Plant, State};

/// An error of this size in x, φ, ẋ, φ̇ or u weighs as much as another: m, rad, m/s, rad/s, N.
const SIZES: [f64; 5] = [0.05, 0.05, 0.5, 0.5, 4.0];
/// The force of the difference for Γ, N: much more than what dry friction takes.
const PUSH: f64 = 4.0;
const ITERATIONS: usize = 2000;

/// u = −K (p − p₀).
pub struct Regulator {
    pub gain: RowVector4<f64>,
    upright: State,
}

impl Regulator {
    /// About the upright pole with the cart at `centre`, m.
    pub fn new(plant: &mut Plant, centre: f64) -> Result<Self, Box<dyn Error>> {
        let upright = State::new(centre, 0.0, 0.0, 0.0);
        let under_way = plant.past();
        let phi = plant.by_state(&upright, &[], 0.0)?;
        let mut pushes = vec![0.0; under_way + 1];
        let mut answer = |push: f64| {
            pushes[0] = push;
            plant.after(&upright, &[], &pushes)
        };
        let gamma = (answer(PUSH)? - answer(-PUSH)?) / (2.0 * PUSH);
        let weight = |i: usize| SIZES[i].powi(-2);
        let q = Matrix4::from_diagonal(&State::from_fn(|i, _| weight(i)));
        let (mut s, mut gain) = (q, RowVector4::zeros());
        for _ in 0..ITERATIONS {
            let through = gamma.transpose() * s;
            gain = through * phi / (weight(4) + (through * gamma)[0]);
            s = q + phi.transpose() * s * (phi - gamma * gain);
        }
        match gain.iter().all(|k| k.is_finite()) {
            true => Ok(Regulator { gain, upright }),
            false => Err("the learnt model cannot be held upright".into()),
        }
    }

    /// The force at the state p, N.
    pub fn force(&self, p: &State) -> f64 {
        -(self.gain * (p - self.upright))[0]
    }
}
