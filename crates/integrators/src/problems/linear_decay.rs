use super::Problem;

/// ẋ = −rate · x; x(t) = start · exp(−rate · t).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearDecay {
    /// 1/s.
    pub rate: f64,
    /// x(0).
    pub start: f64,
}

impl Problem for LinearDecay {
    fn name(&self) -> &'static str {
        "linear decay"
    }
    fn initial(&self) -> Vec<f64> {
        vec![self.start]
    }
    fn rate(&self, _t: f64, x: &[f64], dx: &mut [f64]) {
        dx[0] = -self.rate * x[0];
    }
    fn jacobian(&self, _t: f64, _x: &[f64], jacobian: &mut [f64]) {
        jacobian[0] = -self.rate;
    }
    fn solution(&self, t: f64) -> Vec<f64> {
        vec![self.start * (-self.rate * t).exp()]
    }
    fn span(&self) -> f64 {
        2.0 / self.rate
    }
}
