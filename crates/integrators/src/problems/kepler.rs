use super::Problem;

/// Two bodies: r̈ = −r / |r|³, x = [x, y, ẋ, ẏ], started at the pericentre of an ellipse with half axis 1; the period is 2π.
///
/// x = cos E − e, y = √(1 − e²) sin E with E − e sin E = t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kepler {
    /// e, in [0, 1).
    pub eccentricity: f64,
}

impl Problem for Kepler {
    fn name(&self) -> &'static str {
        "Kepler"
    }
    fn initial(&self) -> Vec<f64> {
        let e = self.eccentricity;
        vec![1.0 - e, 0.0, 0.0, ((1.0 + e) / (1.0 - e)).sqrt()]
    }
    fn rate(&self, _t: f64, x: &[f64], dx: &mut [f64]) {
        let r3 = x[0].hypot(x[1]).powi(3);
        dx.copy_from_slice(&[x[2], x[3], -x[0] / r3, -x[1] / r3]);
    }
    fn jacobian(&self, _t: f64, x: &[f64], jacobian: &mut [f64]) {
        let r = x[0].hypot(x[1]);
        let entry = |i: usize, j: usize| {
            let delta = if i == j { 1.0 } else { 0.0 };
            3.0 * x[i] * x[j] / r.powi(5) - delta / r.powi(3)
        };
        jacobian.copy_from_slice(&[
            0.0,
            0.0,
            1.0,
            0.0, //
            0.0,
            0.0,
            0.0,
            1.0, //
            entry(0, 0),
            entry(0, 1),
            0.0,
            0.0, //
            entry(1, 0),
            entry(1, 1),
            0.0,
            0.0,
        ]);
    }
    fn solution(&self, t: f64) -> Vec<f64> {
        let e = self.eccentricity;
        // Newton on Kepler's equation. From E = M + e sign(sin M), its iterates approach the root from one side.
        let mut anomaly = t + e * t.sin().signum();
        for _ in 0..50 {
            anomaly -= (anomaly - e * anomaly.sin() - t) / (1.0 - e * anomaly.cos());
        }
        let (sin, cos) = anomaly.sin_cos();
        let anomaly_dot = 1.0 / (1.0 - e * cos);
        let b = (1.0 - e * e).sqrt();
        vec![cos - e, b * sin, -sin * anomaly_dot, b * cos * anomaly_dot]
    }
    fn span(&self) -> f64 {
        std::f64::consts::TAU
    }
}
