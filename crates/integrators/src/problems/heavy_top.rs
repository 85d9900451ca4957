use super::formula::{Formula, mechanical_of_turning_body, system_of_formula};
use super::rigid_body::{euler, euler_by_rate, spatial_momentum};
use super::{Conservative, Problem};
use crate::{PhaseSpace, Rotation};

/// A rigid body that turns about a fixed point, with its centre of mass on its third axis, in gravity: a spinning top. States as
/// those of the [free body](super::RigidBody). Its constant is the weight's moment.
///
/// With u the upward direction in the body's axes and W = m g l: I ω̇ = (I ω) × ω + W u × e₃, V = W u₃. It starts 0.5 rad off the
/// vertical with ω = (0.3, −0.2, 4) rad/s.
///
/// The solution of the [`default`](Default::default) top is known at 0 and at 2 s: by Gauss and Legendre's collocation of order 20 in
/// 40 digits on rotation matrices and angular momenta (`tests/references/collocation.py`), where steps of 1/60 s and of 1/120 s give the same 22
/// digits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeavyTop {
    /// I₁, I₂, I₃ about the fixed point, kg·m².
    pub moments: [f64; 3],
    /// W = m g l, N·m.
    pub weight: f64,
}

impl Default for HeavyTop {
    fn default() -> Self {
        HeavyTop {
            moments: [1.0, 1.5, 2.0],
            weight: 5.0,
        }
    }
}

const SPAN: f64 = 2.0;
const AT_SPAN: [f64; 7] = [
    0.506_608_701_212_583_5,
    0.263_213_814_931_459_3,
    0.112_218_811_005_261_43,
    0.813_309_934_736_747_4,
    0.072_029_151_281_442_6,
    0.163_612_281_781_381_93,
    4.032_243_508_918_389_5,
];

/// The upward direction in the body's axes.
fn up(q: &[f64]) -> [f64; 3] {
    [
        2.0 * (q[1] * q[3] - q[0] * q[2]),
        2.0 * (q[2] * q[3] + q[0] * q[1]),
        1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]),
    ]
}

impl HeavyTop {
    /// The angular momentum about the vertical, which is kept.
    pub fn vertical_momentum(&self, x: &[f64]) -> f64 {
        let [_, _, vertical] = spatial_momentum(&self.moments, x);
        vertical
    }

    fn torque(&self, q: &[f64]) -> [f64; 3] {
        let u = up(q);
        [self.weight * u[1], -self.weight * u[0], 0.0]
    }

    fn acceleration_of(&self, q: &[f64], v: &[f64]) -> [f64; 3] {
        euler(&self.moments, v, self.torque(q))
    }
}

impl Formula<6, 1> for HeavyTop {
    fn rate(&self, _t: f64, x: &[f64]) -> [f64; 6] {
        let (q, w) = x.split_at(4);
        let [a1, a2, a3] = self.acceleration_of(q, w);
        [w[0], w[1], w[2], a1, a2, a3]
    }
    fn by_state(&self, _t: f64, x: &[f64]) -> [[f64; 6]; 6] {
        let mut by = [[0.0; 6]; 6];
        for i in 0..3 {
            by[i][3 + i] = 1.0;
        }
        for (row, found) in by[3..]
            .iter_mut()
            .zip(euler_by_rate(&self.moments, &x[4..]))
        {
            row[3..].copy_from_slice(&found);
        }
        // A turn ξ of the body moves u by u × ξ.
        let u = up(x);
        let [i1, i2, _] = self.moments;
        let (a, b) = (self.weight / i1, self.weight / i2);
        by[3][0] = a * u[2];
        by[3][2] = -a * u[0];
        by[4][1] = b * u[2];
        by[4][2] = -b * u[1];
        by
    }
    fn by_constants(&self, _t: f64, x: &[f64]) -> [[f64; 1]; 6] {
        let u = up(x);
        let [i1, i2, _] = self.moments;
        [[0.0], [0.0], [0.0], [u[1] / i1], [-u[0] / i2], [0.0]]
    }
}

system_of_formula!(HeavyTop, 6, 1, PhaseSpace<Rotation> = PhaseSpace { positions: Rotation });
mechanical_of_turning_body!(HeavyTop);

impl Problem for HeavyTop {
    fn name(&self) -> &'static str {
        "heavy top"
    }
    fn initial(&self) -> Vec<f64> {
        let (sin, cos) = 0.25_f64.sin_cos();
        vec![cos, sin, 0.0, 0.0, 0.3, -0.2, 4.0]
    }
    fn span(&self) -> f64 {
        SPAN
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        if t == 0.0 {
            Some(self.initial())
        } else if t == SPAN && *self == Self::default() {
            Some(AT_SPAN.to_vec())
        } else {
            None
        }
    }
}

impl Conservative for HeavyTop {
    fn energy(&self, x: &[f64]) -> f64 {
        let squares = self.moments.iter().zip(&x[4..]).map(|(i, w)| i * w * w);
        0.5 * squares.sum::<f64>() + self.weight * up(x)[2]
    }
}
