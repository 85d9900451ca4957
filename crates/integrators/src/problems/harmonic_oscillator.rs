use super::Problem;

/// q̈ = −ω² q, x = [q, v], released at rest: q(t) = A cos ωt, v(t) = −A ω sin ωt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HarmonicOscillator {
    /// ω, rad/s.
    pub frequency: f64,
    /// A, m.
    pub amplitude: f64,
}

impl Problem for HarmonicOscillator {
    fn name(&self) -> &'static str {
        "harmonic oscillator"
    }
    fn initial(&self) -> Vec<f64> {
        vec![self.amplitude, 0.0]
    }
    fn rate(&self, _t: f64, x: &[f64], dx: &mut [f64]) {
        dx[0] = x[1];
        dx[1] = -self.frequency.powi(2) * x[0];
    }
    fn jacobian(&self, _t: f64, _x: &[f64], jacobian: &mut [f64]) {
        jacobian.copy_from_slice(&[0.0, 1.0, -self.frequency.powi(2), 0.0]);
    }
    fn solution(&self, t: f64) -> Vec<f64> {
        let (sin, cos) = (self.frequency * t).sin_cos();
        vec![self.amplitude * cos, -self.amplitude * self.frequency * sin]
    }
    fn span(&self) -> f64 {
        std::f64::consts::TAU / self.frequency
    }
}
