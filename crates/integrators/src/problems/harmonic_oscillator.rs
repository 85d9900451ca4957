use super::formula::{Formula, mechanical_of_unit_mass, system_of_formula};
use super::{Conservative, Problem};
use crate::{Flat, PhaseSpace};

/// q̈ = −ω² q, x = [q, v], released at rest: q(t) = A cos ωt, v(t) = −A ω sin ωt. Its constant is ω.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HarmonicOscillator {
    /// ω, rad/s.
    pub frequency: f64,
    /// A, m.
    pub amplitude: f64,
}

impl HarmonicOscillator {
    fn force(&self, q: &[f64]) -> [f64; 1] {
        [-self.frequency.powi(2) * q[0]]
    }
}

impl Formula<2, 1> for HarmonicOscillator {
    fn rate(&self, _t: f64, x: &[f64]) -> [f64; 2] {
        let [force] = self.force(x);
        [x[1], force]
    }
    fn by_state(&self, _t: f64, _x: &[f64]) -> [[f64; 2]; 2] {
        [[0.0, 1.0], [-self.frequency.powi(2), 0.0]]
    }
    fn by_constants(&self, _t: f64, x: &[f64]) -> [[f64; 1]; 2] {
        [[0.0], [-2.0 * self.frequency * x[0]]]
    }
}

system_of_formula!(HarmonicOscillator, 2, 1, PhaseSpace<Flat> = PhaseSpace { positions: Flat::new(1) });
mechanical_of_unit_mass!(HarmonicOscillator, 2, 1);

impl Problem for HarmonicOscillator {
    fn name(&self) -> &'static str {
        "harmonic oscillator"
    }
    fn initial(&self) -> Vec<f64> {
        vec![self.amplitude, 0.0]
    }
    fn span(&self) -> f64 {
        0.77 * std::f64::consts::TAU / self.frequency
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        let (sin, cos) = (self.frequency * t).sin_cos();
        Some(vec![
            self.amplitude * cos,
            -self.amplitude * self.frequency * sin,
        ])
    }
}

impl Conservative for HarmonicOscillator {
    fn energy(&self, x: &[f64]) -> f64 {
        0.5 * (x[1].powi(2) + (self.frequency * x[0]).powi(2))
    }
}
