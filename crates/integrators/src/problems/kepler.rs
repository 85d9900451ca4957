use super::formula::{Formula, mechanical_of_unit_mass, system_of_formula};
use super::{Conservative, Problem};
use crate::{Flat, PhaseSpace};

/// Two bodies: r̈ = −r / |r|³, x = [x, y, ẋ, ẏ], started at the pericentre of an ellipse with half axis 1; the period is 2π.
///
/// x = cos E − e, y = √(1 − e²) sin E with E − e sin E = t. No constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kepler {
    /// e, in [0, 1).
    pub eccentricity: f64,
}

impl Kepler {
    /// x ẏ − y ẋ, which is kept.
    pub fn angular_momentum(&self, x: &[f64]) -> f64 {
        x[0] * x[3] - x[1] * x[2]
    }

    fn force(&self, q: &[f64]) -> [f64; 2] {
        let r3 = q[0].hypot(q[1]).powi(3);
        [-q[0] / r3, -q[1] / r3]
    }
}

impl Formula<4, 0> for Kepler {
    fn rate(&self, _t: f64, x: &[f64]) -> [f64; 4] {
        let [fx, fy] = self.force(x);
        [x[2], x[3], fx, fy]
    }
    fn by_state(&self, _t: f64, x: &[f64]) -> [[f64; 4]; 4] {
        let r = x[0].hypot(x[1]);
        let entry = |a: f64, b: f64, delta: f64| 3.0 * a * b / r.powi(5) - delta / r.powi(3);
        let mixed = entry(x[0], x[1], 0.0);
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [entry(x[0], x[0], 1.0), mixed, 0.0, 0.0],
            [mixed, entry(x[1], x[1], 1.0), 0.0, 0.0],
        ]
    }
    fn by_constants(&self, _t: f64, _x: &[f64]) -> [[f64; 0]; 4] {
        [[]; 4]
    }
}

system_of_formula!(Kepler, 4, 0, PhaseSpace<Flat> = PhaseSpace { positions: Flat::new(2) });
mechanical_of_unit_mass!(Kepler, 4, 0);

impl Problem for Kepler {
    fn name(&self) -> &'static str {
        "Kepler"
    }
    fn initial(&self) -> Vec<f64> {
        let e = self.eccentricity;
        vec![1.0 - e, 0.0, 0.0, ((1.0 + e) / (1.0 - e)).sqrt()]
    }
    fn span(&self) -> f64 {
        0.77 * std::f64::consts::TAU
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        let e = self.eccentricity;
        // Newton on Kepler's equation. From E = M + e sign(sin M), its iterates approach the root from one side.
        let mut anomaly = t + e * t.sin().signum();
        for _ in 0..50 {
            anomaly -= (anomaly - e * anomaly.sin() - t) / (1.0 - e * anomaly.cos());
        }
        let (sin, cos) = anomaly.sin_cos();
        let anomaly_dot = 1.0 / (1.0 - e * cos);
        let b = (1.0 - e * e).sqrt();
        Some(vec![
            cos - e,
            b * sin,
            -sin * anomaly_dot,
            b * cos * anomaly_dot,
        ])
    }
}

impl Conservative for Kepler {
    fn energy(&self, x: &[f64]) -> f64 {
        0.5 * (x[2].powi(2) + x[3].powi(2)) - 1.0 / x[0].hypot(x[1])
    }
}
