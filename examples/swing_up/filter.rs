//! Where the rig is: an extended Kalman filter on the learnt model, from the two positions that are measured.
//!
//! With F = ∂f/∂x of the model's step f and b what a force does that nobody knows of, held over an interval,
//!
//! x⁻ = f(x, u),  P⁻ = F P Fᵀ + σ² b bᵀ + ε;  K = P⁻ Cᵀ (C P⁻ Cᵀ + R)⁻¹,  x = x⁻ + K (y − C x⁻),  P = (1 − K C) P⁻.

use std::error::Error;
use std::f64::consts::TAU;

use nalgebra::{Matrix2, Matrix2x4, Matrix4, Vector2};
use pinode_nn::model::Model;

use super::plant::{Plant, State};

/// Of the force on the cart that the model does not know, N: what is left of friction, and the string's.
const UNKNOWN_FORCE: f64 = 0.7;
/// Beside it in one step: m, rad, m/s, rad/s.
const UNKNOWN: [f64; 4] = [1e-4, 5e-4, 5e-3, 0.05];
/// A reading of the cart further away than so many standard deviations is a glitch, unless the one before was: then the cart has struck something.
const GLITCH: f64 = 5.0;
/// What a blow leaves of what was known: m and m/s.
const BLOW: [f64; 2] = [0.02, 1.0];

/// The estimate.
pub struct Filter {
    state: State,
    covariance: Matrix4<f64>,
    noise: Matrix2<f64>,
    /// What the sensors read at 0.
    zeros: [f64; 2],
    glitch: bool,
}

impl Filter {
    /// At the first reading, at rest.
    pub fn new(model: &Model, observation: &[f64]) -> Result<Self, Box<dyn Error>> {
        let [slider, pole] = &model.sensors[..] else {
            return Err("the model has other sensors than those of a cart and a pole".into());
        };
        // An encoder that rounds down reads half a step less than there is.
        let step = pole.resolution.unwrap_or(0.0);
        let rounded = step * step / 12.0;
        let noise = |own: Option<f64>| own.unwrap_or(1e-3).powi(2);
        let zeros = [slider.zero, pole.zero];
        let (x, phi) = (observation[0] - zeros[0], observation[1] - zeros[1]);
        Ok(Filter {
            state: State::new(x, phi, 0.0, 0.0),
            covariance: Matrix4::from_diagonal(&State::new(1e-6, 1e-4, 1e-2, 1e-2)),
            noise: Matrix2::from_diagonal(&Vector2::new(
                noise(slider.position_noise),
                rounded.max(1e-8),
            )),
            zeros,
            glitch: false,
        })
    }

    /// The state, φ from −π to π.
    pub fn state(&self) -> State {
        self.state
    }

    /// Takes a reading of x and φ into account.
    pub fn read(&mut self, observation: &[f64]) -> Result<(), Box<dyn Error>> {
        let c = Matrix2x4::identity();
        let turn = observation[1] - self.zeros[1] - self.state[1];
        let surprise = Vector2::new(
            observation[0] - self.zeros[0] - self.state[0],
            turn - TAU * (turn / TAU).round(),
        );
        let mut noise = self.noise;
        let expected: Matrix2<f64> = c * self.covariance * c.transpose() + noise;
        let odd = surprise[0].abs() > GLITCH * expected[(0, 0)].sqrt();
        if odd && self.glitch {
            self.covariance[(0, 0)] += BLOW[0].powi(2);
            self.covariance[(2, 2)] += BLOW[1].powi(2);
        } else if odd {
            noise[(0, 0)] += surprise[0].powi(2);
        }
        self.glitch = odd && !self.glitch;
        let spread: Matrix2<f64> = c * self.covariance * c.transpose() + noise;
        let inverse = spread.try_inverse().ok_or("the filter has lost the rig")?;
        let gain = self.covariance * c.transpose() * inverse;
        self.state += gain * surprise;
        let left = Matrix4::identity() - gain * c;
        self.covariance =
            left * self.covariance * left.transpose() + gain * noise * gain.transpose();
        self.state[1] -= TAU * (self.state[1] / TAU).round();
        Ok(())
    }

    /// Goes on by an interval under the input `u`, N, after those under way.
    pub fn advance(
        &mut self,
        plant: &mut Plant,
        past: &[f64],
        u: f64,
    ) -> Result<(), Box<dyn Error>> {
        let slopes = plant.by_state(&self.state, past, u)?;
        let next = plant.after(&self.state, past, &[u])?;
        // A force that nobody knows of comes without delay: as if all that is under way were larger.
        let push = 1.0;
        let pushed: Vec<f64> = past.iter().map(|u| u + push).collect();
        let by_force = (plant.after(&self.state, &pushed, &[u + push])? - next) / push;
        let unknown = State::from(UNKNOWN);
        self.covariance = slopes * self.covariance * slopes.transpose()
            + by_force * by_force.transpose() * UNKNOWN_FORCE.powi(2)
            + Matrix4::from_diagonal(&unknown.component_mul(&unknown));
        self.state = next;
        Ok(())
    }
}
