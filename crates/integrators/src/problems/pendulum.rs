use std::f64::consts::PI;

use super::Problem;

/// The mathematical pendulum θ̈ = −ω² sin θ, x = [θ, θ̇], released at rest at θ(0) = amplitude (from hanging).
///
/// With k = sin(amplitude / 2): θ(t) = 2 asin(k cd(ωt, k)), period 4 K(k) / ω.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pendulum {
    /// ω = √(g/l), rad/s.
    pub frequency: f64,
    /// rad, in (0, π).
    pub amplitude: f64,
}

impl Pendulum {
    fn modulus(&self) -> f64 {
        (self.amplitude / 2.0).sin()
    }

    /// The period of the swing, s: 4 K(k) / ω with K = π / (2 agm(1, √(1 − k²))).
    pub fn period(&self) -> f64 {
        let (mut a, mut b) = (1.0, (self.amplitude / 2.0).cos());
        for _ in 0..STEPS {
            (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
        }
        2.0 * PI / (a * self.frequency)
    }
}

/// The arithmetic-geometric mean doubles its digits with every step: 8 are more than a double holds.
const STEPS: usize = 8;

/// Jacobi's sn, cn, dn at u for modulus k, by the arithmetic-geometric mean (Abramowitz and Stegun, 16.4).
fn jacobi(u: f64, k: f64) -> (f64, f64, f64) {
    let (mut a, mut b) = (1.0, (1.0 - k * k).sqrt());
    let mut ratios = [0.0; STEPS];
    for ratio in &mut ratios {
        let c = 0.5 * (a - b);
        (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
        *ratio = c / a;
    }
    let mut phi = a * u * f64::from(1_u32 << STEPS);
    for ratio in ratios.iter().rev() {
        phi = 0.5 * (phi + (ratio * phi.sin()).asin());
    }
    let (sn, cn) = phi.sin_cos();
    (sn, cn, (1.0 - k * k * sn * sn).sqrt())
}

impl Problem for Pendulum {
    fn name(&self) -> &'static str {
        "pendulum"
    }
    fn initial(&self) -> Vec<f64> {
        vec![self.amplitude, 0.0]
    }
    fn rate(&self, _t: f64, x: &[f64], dx: &mut [f64]) {
        dx[0] = x[1];
        dx[1] = -self.frequency.powi(2) * x[0].sin();
    }
    fn jacobian(&self, _t: f64, x: &[f64], jacobian: &mut [f64]) {
        jacobian.copy_from_slice(&[0.0, 1.0, -self.frequency.powi(2) * x[0].cos(), 0.0]);
    }
    fn solution(&self, t: f64) -> Vec<f64> {
        let k = self.modulus();
        let (sn, cn, dn) = jacobi(self.frequency * t, k);
        // s = sin(θ/2) = k cd(ωt), and d cd/du = −(1 − k²) sn / dn².
        let s = k * cn / dn;
        let s_dot = -self.frequency * k * (1.0 - k * k) * sn / (dn * dn);
        vec![2.0 * s.asin(), 2.0 * s_dot / (1.0 - s * s).sqrt()]
    }
    fn span(&self) -> f64 {
        self.period()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn period_has_the_known_series_for_small_swings() {
        let pendulum = Pendulum {
            frequency: 2.0,
            amplitude: 0.2,
        };
        let a2 = pendulum.amplitude.powi(2);
        let series = PI
            * (1.0
                + a2 / 16.0
                + 11.0 / 3072.0 * a2.powi(2)
                + 173.0 / 737_280.0 * a2.powi(3)
                + 22_931.0 / 1_321_205_760.0 * a2.powi(4));
        approx::assert_relative_eq!(pendulum.period(), series, max_relative = 1e-12);
    }

    #[test]
    fn solution_keeps_the_energy_and_returns_after_a_period() {
        let pendulum = Pendulum {
            frequency: 3.0,
            amplitude: 2.5,
        };
        let energy = |x: &[f64]| 0.5 * x[1] * x[1] - 9.0 * x[0].cos();
        let start = pendulum.initial();
        for i in 0..=40 {
            let x = pendulum.solution(pendulum.period() * f64::from(i) / 40.0);
            approx::assert_relative_eq!(energy(&x), energy(&start), max_relative = 1e-12);
        }
        let end = pendulum.solution(pendulum.period());
        approx::assert_abs_diff_eq!(end[0], start[0], epsilon = 1e-10);
        approx::assert_abs_diff_eq!(end[1], start[1], epsilon = 1e-10);
    }
}
