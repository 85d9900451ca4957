//! What the rig's sensors say of the true state.
//!
//! An ultrasonic sensor gives x with white noise and now and then a glitch; a shaft encoder gives φ rounded down to its counts,
//! within one turn [0, 2π). Velocities are not measured: they are differences of two measured positions, the angle's on the circle.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::config::Noise;

/// The two position sensors.
#[derive(Debug, Clone)]
pub struct Sensors {
    noise: Noise,
    rng: ChaCha8Rng,
}

impl Sensors {
    /// Sensors with the given noise.
    pub fn new(noise: Noise, rng: ChaCha8Rng) -> Self {
        Sensors { noise, rng }
    }

    /// The measured x, m, and φ, rad in [0, 2π), at the true positions `q`.
    pub fn measure(&mut self, q: [f64; 2]) -> [f64; 2] {
        let Noise {
            ultrasonic,
            outlier_share,
            outlier_size,
            encoder_counts,
            ..
        } = self.noise;
        // Always the same draws, so that one setting does not shift the others' noise.
        let white: f64 = self.rng.sample(StandardNormal);
        let glitch = self.rng.random::<f64>() < outlier_share;
        let jump = (2.0 * self.rng.random::<f64>() - 1.0) * outlier_size;
        let x = q[0] + ultrasonic * white + if glitch { jump } else { 0.0 };
        let counts = f64::from(encoder_counts);
        let count = (q[1] / TAU * counts).floor().rem_euclid(counts);
        [x, count * TAU / counts]
    }
}

/// (y − before)/interval for the position, on the circle for the angle.
pub fn backward_difference(before: [f64; 2], y: [f64; 2], interval: f64) -> [f64; 2] {
    let turn = y[1] - before[1];
    let turn = turn - TAU * (turn / TAU).round();
    [(y[0] - before[0]) / interval, turn / interval]
}
