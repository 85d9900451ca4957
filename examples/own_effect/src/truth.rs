//! The laboratory: a carriage between springs with a magnet over a copper rail. Shares no code with the model that is diagnosed.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Of the carriage, kg.
pub const MASS: f64 = 2.0;
/// Of both springs, N/m.
pub const STIFFNESS: f64 = 15.0;
/// The largest force of the brake, N, and the speed at which it acts, m/s.
pub const PEAK: (f64, f64) = (1.2, 0.25);
/// Standard deviation of the position's sensor, m.
pub const NOISE: f64 = 5e-4;

/// Time between samples, s; the equations are solved in steps of a tenth of it.
const SAMPLE: f64 = 0.02;
const STEPS: usize = 10;

/// Acceleration at x, v under the force u: m a = u − k x − 2 F v v* / (v² + v*²).
fn acceleration(x: f64, v: f64, u: f64) -> f64 {
    let (force, speed) = PEAK;
    let brake = 2.0 * force * v * speed / (v * v + speed * speed);
    (u - STIFFNESS * x - brake) / MASS
}

/// One step of the classical Runge–Kutta method.
fn step(x: f64, v: f64, u: f64, h: f64) -> (f64, f64) {
    let a1 = acceleration(x, v, u);
    let (v2, a2) = (
        v + 0.5 * h * a1,
        acceleration(x + 0.5 * h * v, v + 0.5 * h * a1, u),
    );
    let (v3, a3) = (
        v + 0.5 * h * a2,
        acceleration(x + 0.5 * h * v2, v + 0.5 * h * a2, u),
    );
    let (v4, a4) = (v + h * a3, acceleration(x + h * v3, v + h * a3, u));
    (
        x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4),
        v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
    )
}

/// A log of so many seconds, as CSV.
pub fn log(seconds: f64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut x, mut v, mut u) = (0.0, 0.0, 0.0);
    let mut text = "t,q.x,u.coil\n".to_owned();
    for k in 0..(seconds / SAMPLE) as usize {
        if k % 25 == 0 {
            u = rng.random_range(-6.0..6.0);
        }
        let noise: f64 = rng.sample(StandardNormal);
        text += &format!("{:.3},{},{u}\n", SAMPLE * k as f64, x + NOISE * noise);
        for _ in 0..STEPS {
            (x, v) = step(x, v, u, SAMPLE / STEPS as f64);
        }
    }
    text
}
