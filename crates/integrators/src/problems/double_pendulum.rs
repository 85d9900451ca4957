use super::formula::{Formula, system_of_formula};
use super::{Conservative, Problem};
use crate::{Flat, Mechanical, PhaseSpace};

use std::convert::Infallible;

/// Two point masses of 1 kg on two massless rods of 1 m in the gravity 9.81 m/s², x = [θ₁, θ₂, θ̇₁, θ̇₂] with both angles from
/// hanging, released at rest at (1, 1.5) rad.
///
/// L = θ̇₁² + θ̇₂²/2 + θ̇₁ θ̇₂ cos(θ₁ − θ₂) + 2 g cos θ₁ + g cos θ₂: the mass matrix depends on the positions. Its constant is g.
///
/// The solution is known at 0 and at 3 s, for the gravity above: by Gauss and Legendre's collocation of order 20 in 40 digits on
/// Hamilton's equations (`tests/references/collocation.py`), where steps of 1/40 s and of 1/80 s give the same 22 digits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DoublePendulum {
    /// g, m/s².
    pub gravity: f64,
}

impl Default for DoublePendulum {
    fn default() -> Self {
        DoublePendulum { gravity: GRAVITY }
    }
}

const GRAVITY: f64 = 9.81;
const SPAN: f64 = 3.0;
const AT_SPAN: [f64; 4] = [
    1.211_196_787_357_102,
    0.801_051_958_982_983,
    -1.351_755_811_888_192,
    -0.420_478_732_695_813_4,
];

impl DoublePendulum {
    /// M⁻¹ r with M = [2 c; c 1], c = cos(θ₁ − θ₂).
    fn solve(q: &[f64], r: [f64; 2]) -> [f64; 2] {
        let c = (q[0] - q[1]).cos();
        let determinant = 2.0 - c * c;
        [
            (r[0] - c * r[1]) / determinant,
            (2.0 * r[1] - c * r[0]) / determinant,
        ]
    }

    /// v̇ = M⁻¹ (∂L/∂q − Ṁ v).
    fn acceleration_of(&self, q: &[f64], v: &[f64]) -> [f64; 2] {
        let s = (q[0] - q[1]).sin();
        let r = [
            -s * v[1] * v[1] - 2.0 * self.gravity * q[0].sin(),
            s * v[0] * v[0] - self.gravity * q[1].sin(),
        ];
        Self::solve(q, r)
    }
}

impl Formula<4, 1> for DoublePendulum {
    fn rate(&self, _t: f64, x: &[f64]) -> [f64; 4] {
        let (q, v) = x.split_at(2);
        let [a1, a2] = self.acceleration_of(q, v);
        [v[0], v[1], a1, a2]
    }
    fn by_state(&self, _t: f64, x: &[f64]) -> [[f64; 4]; 4] {
        let (q, v) = x.split_at(2);
        let [a1, a2] = self.acceleration_of(q, v);
        let (s, c) = (q[0] - q[1]).sin_cos();
        // By θ₁ − θ₂, gravity apart: ∂r/∂ − ∂M/∂ a.
        let apart = [-c * v[1] * v[1] + s * a2, c * v[0] * v[0] + s * a1];
        let by_q1 = Self::solve(q, [apart[0] - 2.0 * self.gravity * q[0].cos(), apart[1]]);
        let by_q2 = Self::solve(q, [-apart[0], -apart[1] - self.gravity * q[1].cos()]);
        let by_v1 = Self::solve(q, [0.0, 2.0 * s * v[0]]);
        let by_v2 = Self::solve(q, [-2.0 * s * v[1], 0.0]);
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [by_q1[0], by_q2[0], by_v1[0], by_v2[0]],
            [by_q1[1], by_q2[1], by_v1[1], by_v2[1]],
        ]
    }
    fn by_constants(&self, _t: f64, x: &[f64]) -> [[f64; 1]; 4] {
        let [a1, a2] = Self::solve(x, [-2.0 * x[0].sin(), -x[1].sin()]);
        [[0.0], [0.0], [a1], [a2]]
    }
}

system_of_formula!(DoublePendulum, 4, 1, PhaseSpace<Flat> = PhaseSpace { positions: Flat::new(2) });

impl Mechanical for DoublePendulum {
    type Positions = Flat;

    fn positions(&self) -> &Flat {
        const POSITIONS: Flat = Flat::new(2);
        &POSITIONS
    }

    fn acceleration(
        &self,
        _t: f64,
        (q, v): (&[f64], &[f64]),
        _u: &(),
        _memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        out.copy_from_slice(&self.acceleration_of(q, v));
        Ok(())
    }

    fn momentum(
        &self,
        (q, v): (&[f64], &[f64]),
        _memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        let c = (q[0] - q[1]).cos();
        out.copy_from_slice(&[2.0 * v[0] + c * v[1], c * v[0] + v[1]]);
        Ok(())
    }

    fn velocity(&self, q: &[f64], _memory: &mut (), out: &mut [f64]) -> Result<(), Infallible> {
        let v = Self::solve(q, [out[0], out[1]]);
        out.copy_from_slice(&v);
        Ok(())
    }

    fn position_force(
        &self,
        _t: f64,
        (q, v): (&[f64], &[f64]),
        _u: &(),
        _memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        let coupling = (q[0] - q[1]).sin() * v[0] * v[1];
        out.copy_from_slice(&[
            -coupling - 2.0 * self.gravity * q[0].sin(),
            coupling - self.gravity * q[1].sin(),
        ]);
        Ok(())
    }

    fn not_separable(&self) -> Option<String> {
        Some("the mass matrix depends on θ₁ − θ₂".into())
    }
}

impl Problem for DoublePendulum {
    fn name(&self) -> &'static str {
        "double pendulum"
    }
    fn initial(&self) -> Vec<f64> {
        vec![1.0, 1.5, 0.0, 0.0]
    }
    fn span(&self) -> f64 {
        SPAN
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        if t == 0.0 {
            Some(self.initial())
        } else if t == SPAN && self.gravity == GRAVITY {
            Some(AT_SPAN.to_vec())
        } else {
            None
        }
    }
}

impl Conservative for DoublePendulum {
    fn energy(&self, x: &[f64]) -> f64 {
        let kinetic = x[2].powi(2) + 0.5 * x[3].powi(2) + x[2] * x[3] * (x[0] - x[1]).cos();
        kinetic + self.gravity * (2.0 * (1.0 - x[0].cos()) + 1.0 - x[1].cos())
    }
}
