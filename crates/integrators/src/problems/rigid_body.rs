use super::elliptic::{complete_integral, jacobi};
use super::formula::{Formula, mechanical_of_turning_body, system_of_formula};
use super::{Conservative, Problem};
use crate::{PhaseSpace, Rotation};

/// A free rigid body, x = [w, x, y, z, ω₁, ω₂, ω₃]: the unit quaternion turns the body's axes, which are its principal ones, into
/// those of space, and ω is in the body's axes. Its constants are the moments of inertia.
///
/// I ω̇ = (I ω) × ω. For I₁ ≤ I₂ < I₃ and a start with ω₂ = 0 that turns fast enough about the third axis, with Jacobi's functions of
/// τ = λ t,
///
/// - ω = (ω₁(0) cn τ, b sn τ, ω₃(0) dn τ), b² = ω₁(0)² I₁ (I₃ − I₁) / (I₂ (I₃ − I₂))
/// - λ² = ω₃(0)² (I₃ − I₂) (I₃ − I₁) / (I₁ I₂), k² = ω₁(0) b (I₂ − I₁) / (I₃ ω₃(0) λ)
///
/// (Landau and Lifshitz, "Mechanics", § 37). The angular momentum L stands on the z axis of space; Euler's angles z-x-z about it are
/// cos θ = I₃ ω₃ / L, tan ψ = I₁ ω₁ / (I₂ ω₂) and φ(t) = L ∫ (I₁ ω₁² + I₂ ω₂²) / (I₁² ω₁² + I₂² ω₂²) dt, an analytic integrand, by
/// Gauss's quadrature to rounding. A symmetric top has I₁ = I₂: then k = 0 and φ = L t / I₁.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBody {
    /// I₁ ≤ I₂ < I₃, kg·m².
    pub moments: [f64; 3],
    /// ω₁(0) > 0, rad/s.
    pub across: f64,
    /// ω₃(0) > 0, rad/s, so large that k < 1: more than ω₁(0) √(I₁ (I₂ − I₁) / (I₃ (I₃ − I₂))).
    pub along: f64,
}

/// ω̇ = I⁻¹ ((I ω) × ω + torque).
pub(super) fn euler(moments: &[f64; 3], w: &[f64], torque: [f64; 3]) -> [f64; 3] {
    let [i1, i2, i3] = *moments;
    [
        ((i2 - i3) * w[1] * w[2] + torque[0]) / i1,
        ((i3 - i1) * w[2] * w[0] + torque[1]) / i2,
        ((i1 - i2) * w[0] * w[1] + torque[2]) / i3,
    ]
}

/// ∂ω̇/∂ω.
pub(super) fn euler_by_rate(moments: &[f64; 3], w: &[f64]) -> [[f64; 3]; 3] {
    let [i1, i2, i3] = *moments;
    let (a, b, c) = ((i2 - i3) / i1, (i3 - i1) / i2, (i1 - i2) / i3);
    [
        [0.0, a * w[2], a * w[1]],
        [b * w[2], 0.0, b * w[0]],
        [c * w[1], c * w[0], 0.0],
    ]
}

/// The angular momentum I ω in the axes of space.
pub(super) fn spatial_momentum(moments: &[f64; 3], x: &[f64]) -> [f64; 3] {
    let m = [moments[0] * x[4], moments[1] * x[5], moments[2] * x[6]];
    // v + 2 w (u × v) + 2 u × (u × v) for the quaternion (w, u).
    let u = [x[1], x[2], x[3]];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let once = cross(u, m);
    let twice = cross(u, once);
    [0, 1, 2].map(|i| m[i] + 2.0 * (x[0] * once[i] + twice[i]))
}

/// Widest panel of the quadrature of φ, in τ.
const PANEL: f64 = 0.02;

impl RigidBody {
    /// The angular momentum in the axes of space, which is kept.
    pub fn angular_momentum(&self, x: &[f64]) -> [f64; 3] {
        spatial_momentum(&self.moments, x)
    }

    fn torque(&self, _q: &[f64]) -> [f64; 3] {
        [0.0; 3]
    }

    fn acceleration_of(&self, q: &[f64], v: &[f64]) -> [f64; 3] {
        euler(&self.moments, v, self.torque(q))
    }
}

impl Formula<6, 3> for RigidBody {
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
        by
    }
    fn by_constants(&self, _t: f64, x: &[f64]) -> [[f64; 3]; 6] {
        let [i1, i2, i3] = self.moments;
        let w = &x[4..];
        let [a1, a2, a3] = euler(&self.moments, w, [0.0; 3]);
        let (p1, p2, p3) = (w[1] * w[2] / i1, w[2] * w[0] / i2, w[0] * w[1] / i3);
        [
            [0.0; 3],
            [0.0; 3],
            [0.0; 3],
            [-a1 / i1, p1, -p1],
            [-p2, -a2 / i2, p2],
            [p3, -p3, -a3 / i3],
        ]
    }
}

system_of_formula!(RigidBody, 6, 3, PhaseSpace<Rotation> = PhaseSpace { positions: Rotation });
mechanical_of_turning_body!(RigidBody);

impl Problem for RigidBody {
    fn name(&self) -> &'static str {
        "free rigid body"
    }
    fn initial(&self) -> Vec<f64> {
        let [i1, _, i3] = self.moments;
        let half = 0.5 * (i1 * self.across).atan2(i3 * self.along);
        let (sin, cos) = half.sin_cos();
        let r = 0.5_f64.sqrt();
        vec![
            cos * r,
            sin * r,
            -sin * r,
            cos * r,
            self.across,
            0.0,
            self.along,
        ]
    }
    fn span(&self) -> f64 {
        5.0 / self.along
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        let [i1, i2, i3] = self.moments;
        let b = self.across * (i1 * (i3 - i1) / (i2 * (i3 - i2))).sqrt();
        let fast = self.along * ((i3 - i2) * (i3 - i1) / (i1 * i2)).sqrt();
        let modulus = (self.across * b * (i2 - i1) / (i3 * self.along * fast)).sqrt();
        if !(modulus < 1.0 && self.across > 0.0) {
            return None;
        }
        let rate = |t: f64| {
            let (sn, cn, dn) = jacobi(fast * t, modulus);
            [self.across * cn, b * sn, self.along * dn]
        };
        let momentum = (i1 * self.across).hypot(i3 * self.along);
        let turn = |t: f64| {
            let [w1, w2, _] = rate(t);
            let (a, b) = (i1 * w1 * w1, i2 * w2 * w2);
            momentum * (a + b) / (i1 * a + i2 * b)
        };
        // The quadrature is of what changes: the rounding of a long sum then is small.
        let mean = turn(0.0);
        let change = |t: f64| turn(t) - mean;
        let panels = (fast * t.abs() / PANEL).ceil().max(1.0);
        let width = t / panels;
        let node = 0.5 * 0.6_f64.sqrt() * width;
        let changes: f64 = (0..panels as usize)
            .map(|i| {
                let middle = (i as f64 + 0.5) * width;
                5.0 * change(middle - node) + 8.0 * change(middle) + 5.0 * change(middle + node)
            })
            .sum();
        let phi = mean * t + width / 18.0 * changes;
        let [w1, w2, w3] = rate(t);
        let half = 0.5 * (i1 * w1).hypot(i2 * w2).atan2(i3 * w3);
        // ψ falls by 2π while τ grows by 4 K; it is continued, so that the quaternion does not change its sign.
        let psi = (i1 * w1).atan2(i2 * w2);
        let quarter = complete_integral((1.0 - modulus * modulus).sqrt());
        let near = std::f64::consts::FRAC_PI_2 * (1.0 - fast * t / quarter);
        let psi = psi + std::f64::consts::TAU * ((near - psi) / std::f64::consts::TAU).round();
        let (sin, cos) = half.sin_cos();
        let (sum, difference) = (0.5 * (phi + psi), 0.5 * (phi - psi));
        Some(vec![
            cos * sum.cos(),
            sin * difference.cos(),
            sin * difference.sin(),
            cos * sum.sin(),
            w1,
            w2,
            w3,
        ])
    }
}

impl Conservative for RigidBody {
    fn energy(&self, x: &[f64]) -> f64 {
        let squares = self.moments.iter().zip(&x[4..]).map(|(i, w)| i * w * w);
        0.5 * squares.sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Space;

    #[test]
    fn attitude_and_rates_are_those_of_a_collocation_in_rotation_matrices() {
        // tests/references/collocation.py: steps of 1/32 and of 1/64 give the same 22 digits.
        let body = RigidBody {
            moments: [1.0, 2.0, 3.0],
            across: 1.0,
            along: 1.2,
        };
        let found = body.solution(5.0).unwrap();
        let reference = [
            0.535_120_431_227_608,
            -0.007_075_050_241_685_423,
            -0.203_504_893_567_081_46,
            0.819_866_956_305_172_4,
            0.770_419_504_760_899_3,
            -0.637_537_282_583_513_5,
            1.142_153_844_470_470_9,
        ];
        // The reference's sign of the quaternion is that of w > 0.
        let sign = found[0].signum();
        for (i, (a, b)) in found.iter().zip(reference).enumerate() {
            let a = if i < 4 { sign * a } else { *a };
            approx::assert_abs_diff_eq!(a, b, epsilon = 1e-14);
        }
    }

    #[test]
    fn a_symmetric_top_turns_about_its_axis_and_about_its_angular_momentum() {
        let body = RigidBody {
            moments: [1.0, 1.0, 1.7],
            across: 0.8,
            along: 2.0,
        };
        let start = body.initial();
        let momentum = 0.8_f64.hypot(1.7 * 2.0);
        for t in [0.3, 2.0, 11.0] {
            // exp(t L / I₁) in space, then the start, then exp((1 − I₃/I₁) ω₃ t e₃) in the body.
            let angle = 0.5 * momentum * t;
            let (sin, cos) = angle.sin_cos();
            let s = &start;
            let precessed = [
                cos * s[0] - sin * s[3],
                cos * s[1] - sin * s[2],
                cos * s[2] + sin * s[1],
                cos * s[3] + sin * s[0],
            ];
            let mut expected = [0.0; 4];
            Rotation.move_into(
                &precessed,
                &[0.0, 0.0, (1.0 - 1.7) * 2.0 * t],
                &mut expected,
            );
            let found = body.solution(t).unwrap();
            for (a, b) in found.iter().zip(expected) {
                approx::assert_abs_diff_eq!(a, &b, epsilon = 3e-14);
            }
        }
    }

    #[test]
    fn the_angular_momentum_of_the_solution_stands_on_z() {
        let body = RigidBody {
            moments: [1.0, 2.0, 3.0],
            across: 1.0,
            along: 1.2,
        };
        let size = 1.0_f64.hypot(3.6);
        for t in [0.0, 0.7, 3.0, 20.0] {
            let x = body.solution(t).unwrap();
            let found = body.angular_momentum(&x);
            for (a, b) in found.iter().zip([0.0, 0.0, size]) {
                approx::assert_abs_diff_eq!(*a, b, epsilon = 3e-14);
            }
        }
    }
}
