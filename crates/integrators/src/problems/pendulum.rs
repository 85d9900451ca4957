use super::elliptic::{complete_integral, jacobi};
use super::formula::{Formula, mechanical_of_unit_mass, system_of_formula};
use super::{Conservative, Problem};
use crate::{Flat, PhaseSpace};

/// The mathematical pendulum θ̈ = −ω² sin θ, x = [θ, θ̇], released at rest at θ(0) = amplitude (from hanging). Its constant is ω.
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
    /// The period of the swing, s: 4 K(k) / ω.
    pub fn period(&self) -> f64 {
        4.0 * complete_integral((self.amplitude / 2.0).cos()) / self.frequency
    }

    fn force(&self, q: &[f64]) -> [f64; 1] {
        [-self.frequency.powi(2) * q[0].sin()]
    }
}

impl Formula<2, 1> for Pendulum {
    fn rate(&self, _t: f64, x: &[f64]) -> [f64; 2] {
        let [force] = self.force(x);
        [x[1], force]
    }
    fn by_state(&self, _t: f64, x: &[f64]) -> [[f64; 2]; 2] {
        [[0.0, 1.0], [-self.frequency.powi(2) * x[0].cos(), 0.0]]
    }
    fn by_constants(&self, _t: f64, x: &[f64]) -> [[f64; 1]; 2] {
        [[0.0], [-2.0 * self.frequency * x[0].sin()]]
    }
}

system_of_formula!(Pendulum, 2, 1, PhaseSpace<Flat> = PhaseSpace { positions: Flat::new(1) });
mechanical_of_unit_mass!(Pendulum, 2, 1);

impl Problem for Pendulum {
    fn name(&self) -> &'static str {
        "pendulum"
    }
    fn initial(&self) -> Vec<f64> {
        vec![self.amplitude, 0.0]
    }
    fn span(&self) -> f64 {
        0.77 * self.period()
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        let k = (self.amplitude / 2.0).sin();
        let (sn, cn, dn) = jacobi(self.frequency * t, k);
        // s = sin(θ/2) = k cd(ωt), and d cd/du = −(1 − k²) sn / dn².
        let s = k * cn / dn;
        let s_dot = -self.frequency * k * (1.0 - k * k) * sn / (dn * dn);
        Some(vec![2.0 * s.asin(), 2.0 * s_dot / (1.0 - s * s).sqrt()])
    }
}

impl Conservative for Pendulum {
    fn energy(&self, x: &[f64]) -> f64 {
        0.5 * x[1].powi(2) + self.frequency.powi(2) * (1.0 - x[0].cos())
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

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
    fn period_is_the_elliptic_integral() {
        // 4 K, by quadrature in 30 digits of ∫ dφ/√(1 − k² sin² φ) from 0 to π/2.
        for (degrees, period) in [
            (5.0_f64, 6.286_177_187_147_222),
            (90.0, 7.416_298_709_205_487),
            (150.0, 11.072_252_581_475_07),
        ] {
            let pendulum = Pendulum {
                frequency: 1.0,
                amplitude: degrees.to_radians(),
            };
            approx::assert_relative_eq!(pendulum.period(), period, max_relative = 1e-15);
        }
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
            let x = pendulum
                .solution(pendulum.period() * f64::from(i) / 40.0)
                .unwrap();
            approx::assert_relative_eq!(energy(&x), energy(&start), max_relative = 1e-12);
        }
        let end = pendulum.solution(pendulum.period()).unwrap();
        approx::assert_abs_diff_eq!(end[0], start[0], epsilon = 1e-10);
        approx::assert_abs_diff_eq!(end[1], start[1], epsilon = 1e-10);
    }
}
