//! Coloured noise.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// First-order autoregressive noise: zero mean, given standard deviation, correlation exp(−|Δt|/T).
#[derive(Debug, Clone)]
pub(super) struct Coloured {
    rng: ChaCha8Rng,
    keep: f64,
    fresh: f64,
    value: f64,
}

impl Coloured {
    /// Noise sampled every `interval` seconds, stationary from its first value on.
    pub fn new(mut rng: ChaCha8Rng, deviation: f64, time: f64, interval: f64) -> Self {
        let keep = (-interval / time).exp();
        let value = deviation * rng.sample::<f64, _>(StandardNormal);
        Coloured {
            rng,
            keep,
            fresh: deviation * (1.0 - keep * keep).sqrt(),
            value,
        }
    }

    /// The present value; the noise moves on.
    pub fn next(&mut self) -> f64 {
        let value = self.value;
        self.value = self.keep * value + self.fresh * self.rng.sample::<f64, _>(StandardNormal);
        value
    }
}
