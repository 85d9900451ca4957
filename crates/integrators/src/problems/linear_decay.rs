use super::Problem;
use super::formula::{Formula, system_of_formula};
use crate::Flat;

/// ẋ = −rate · x; x(t) = start · exp(−rate · t). Its constant is the rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearDecay {
    /// 1/s.
    pub rate: f64,
    /// x(0).
    pub start: f64,
}

impl Formula<1, 1> for LinearDecay {
    fn rate(&self, _t: f64, x: &[f64]) -> [f64; 1] {
        [-self.rate * x[0]]
    }
    fn by_state(&self, _t: f64, _x: &[f64]) -> [[f64; 1]; 1] {
        [[-self.rate]]
    }
    fn by_constants(&self, _t: f64, x: &[f64]) -> [[f64; 1]; 1] {
        [[-x[0]]]
    }
}

system_of_formula!(LinearDecay, 1, 1, Flat = Flat::new(1));

impl Problem for LinearDecay {
    fn name(&self) -> &'static str {
        "linear decay"
    }
    fn initial(&self) -> Vec<f64> {
        vec![self.start]
    }
    fn span(&self) -> f64 {
        1.54 / self.rate
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        Some(vec![self.start * (-self.rate * t).exp()])
    }
}
