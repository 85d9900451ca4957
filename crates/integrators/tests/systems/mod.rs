//! Differentiable systems for the tests and benches of gradients.
#![allow(dead_code)] // each test takes some of them

use std::convert::Infallible;

use integrators::gradient::DualRate;
use integrators::{Differentiable, Flat, Gradient, Jacobian, PhaseSpace, Rotation, System};
use num_dual::DualNum;

/// A damped pendulum with a torque: θ̈ = −p₀ sin θ − p₁ θ̇ + u, x = (θ, θ̇), derived by hand.
pub struct Pendulum {
    pub space: Flat,
    pub p: [f64; 2],
}

impl Pendulum {
    pub fn new() -> Self {
        Pendulum {
            space: Flat::new(2),
            p: [9.0, 0.3],
        }
    }
}

impl System for Pendulum {
    type Space = Flat;
    type Input = [f64; 1];
    type Memory = ();
    type Error = Infallible;
    fn space(&self) -> &Flat {
        &self.space
    }
    fn memory(&self) {}
    fn rate(
        &self,
        _t: f64,
        x: &[f64],
        u: &[f64; 1],
        (): &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        dx[0] = x[1];
        dx[1] = -(x[0].sin() * self.p[0]) - x[1] * self.p[1] + u[0];
        Ok(())
    }
}

impl Differentiable for Pendulum {
    fn input_count(&self) -> usize {
        1
    }
    fn parameter_count(&self) -> usize {
        2
    }
    fn linearize(
        &self,
        (t, x, u): (f64, &[f64], &[f64; 1]),
        memory: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        self.rate(t, x, u, memory, dx)?;
        by.state
            .copy_from_slice(&[0.0, -self.p[0] * x[0].cos(), 1.0, -self.p[1]]);
        by.input.copy_from_slice(&[0.0, 1.0]);
        by.parameters
            .copy_from_slice(&[0.0, -x[0].sin(), 0.0, -x[1]]);
        Ok(())
    }
    fn pull_back(
        &self,
        (_t, x, u): (f64, &[f64], &[f64; 1]),
        (): &mut (),
        w: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Infallible> {
        let (sin, cos) = x[0].sin_cos();
        dx[0] = x[1];
        dx[1] = -(sin * self.p[0]) - x[1] * self.p[1] + u[0];
        by.state[0] -= w[1] * self.p[0] * cos;
        by.state[1] += w[0] - w[1] * self.p[1];
        by.input[0] += w[1];
        by.parameters[0] -= w[1] * sin;
        by.parameters[1] -= w[1] * x[1];
        Ok(())
    }
}

/// The same pendulum, once for all numbers.
#[derive(Clone)]
pub struct DualPendulum;

impl DualRate for DualPendulum {
    type Error = Infallible;
    fn rate<D: DualNum<Primitive = f64> + Copy>(
        &self,
        _t: f64,
        x: &[D],
        u: &[D],
        p: &[D],
        dx: &mut [D],
    ) -> Result<(), Infallible> {
        dx[0] = x[1];
        dx[1] = -(x[0].sin() * p[0]) - x[1] * p[1] + u[0];
        Ok(())
    }
}

/// r̈ = −p r / |r|³ + u, x = (x, y, ẋ, ẏ).
#[derive(Clone)]
pub struct DualKepler;

impl DualRate for DualKepler {
    type Error = Infallible;
    fn rate<D: DualNum<Primitive = f64> + Copy>(
        &self,
        _t: f64,
        x: &[D],
        u: &[D],
        p: &[D],
        dx: &mut [D],
    ) -> Result<(), Infallible> {
        let r2 = x[0] * x[0] + x[1] * x[1];
        let pull = p[0] / (r2 * r2.sqrt());
        dx[0] = x[2];
        dx[1] = x[3];
        dx[2] = -(pull * x[0]) + u[0];
        dx[3] = -(pull * x[1]) + u[1];
        Ok(())
    }
}

/// [`DualKepler`] derived by hand.
pub struct Kepler {
    pub space: Flat,
    pub p: [f64; 1],
}

impl Kepler {
    pub fn new() -> Self {
        Kepler {
            space: Flat::new(4),
            p: [1.0],
        }
    }
}

impl System for Kepler {
    type Space = Flat;
    type Input = [f64; 2];
    type Memory = ();
    type Error = Infallible;
    fn space(&self) -> &Flat {
        &self.space
    }
    fn memory(&self) {}
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &[f64; 2],
        (): &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        DualKepler.rate(t, x, u, &self.p, dx)
    }
}

impl Differentiable for Kepler {
    fn input_count(&self) -> usize {
        2
    }
    fn parameter_count(&self) -> usize {
        1
    }
    fn linearize(
        &self,
        (t, x, u): (f64, &[f64], &[f64; 2]),
        memory: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        self.rate(t, x, u, memory, dx)?;
        let r2 = x[0] * x[0] + x[1] * x[1];
        let r3 = r2 * r2.sqrt();
        by.state.fill(0.0);
        by.state[(0, 2)] = 1.0;
        by.state[(1, 3)] = 1.0;
        for i in 0..2 {
            for j in 0..2 {
                by.state[(2 + i, j)] = 3.0 * self.p[0] * x[i] * x[j] / (r2 * r3);
            }
            by.state[(2 + i, i)] -= self.p[0] / r3;
            by.parameters[(2 + i, 0)] = -x[i] / r3;
            by.input[(2 + i, i)] = 1.0;
        }
        Ok(())
    }
    fn pull_back(
        &self,
        (_t, x, u): (f64, &[f64], &[f64; 2]),
        (): &mut (),
        w: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Infallible> {
        let r2 = x[0] * x[0] + x[1] * x[1];
        let one_over_r3 = 1.0 / (r2 * r2.sqrt());
        let pull = self.p[0] * one_over_r3;
        dx[0] = x[2];
        dx[1] = x[3];
        dx[2] = -(pull * x[0]) + u[0];
        dx[3] = -(pull * x[1]) + u[1];
        let along = w[2] * x[0] + w[3] * x[1];
        let radial = 3.0 * pull * along / r2;
        by.state[0] += radial * x[0] - pull * w[2];
        by.state[1] += radial * x[1] - pull * w[3];
        by.state[2] += w[0];
        by.state[3] += w[1];
        by.input[0] += w[2];
        by.input[1] += w[3];
        by.parameters[0] -= along * one_over_r3;
        Ok(())
    }
}

type Vector = [f64; 3];

fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// A body that turns about a fixed point: I ω̇ = (I ω) × ω + weight e × (Rᵀ z) + u in its axes; p = (I₁, I₂, I₃, weight), e the third axis.
/// x = (quaternion, ω). With no weight it is free.
pub struct Top {
    pub space: PhaseSpace<Rotation>,
    pub p: [f64; 4],
}

impl Top {
    pub fn new(weight: f64) -> Self {
        Top {
            space: PhaseSpace {
                positions: Rotation,
            },
            p: [0.7, 1.1, 1.6, weight],
        }
    }

    /// I ω, Rᵀ z and I ω̇.
    fn torque(&self, x: &[f64], u: &Vector) -> (Vector, Vector, Vector) {
        let [w, a, b, c] = [x[0], x[1], x[2], x[3]];
        let omega = [x[4], x[5], x[6]];
        let momentum = [
            self.p[0] * omega[0],
            self.p[1] * omega[1],
            self.p[2] * omega[2],
        ];
        let up = [
            2.0 * (a * c - w * b),
            2.0 * (b * c + w * a),
            1.0 - 2.0 * (a * a + b * b),
        ];
        let turning = cross(momentum, omega);
        let torque = [
            turning[0] - self.p[3] * up[1] + u[0],
            turning[1] + self.p[3] * up[0] + u[1],
            turning[2] + u[2],
        ];
        (momentum, up, torque)
    }
}

impl System for Top {
    type Space = PhaseSpace<Rotation>;
    type Input = [f64; 3];
    /// A row of the derivatives.
    type Memory = Gradient;
    type Error = Infallible;
    fn space(&self) -> &PhaseSpace<Rotation> {
        &self.space
    }
    fn memory(&self) -> Gradient {
        Gradient::zeros(self)
    }
    fn rate(
        &self,
        _t: f64,
        x: &[f64],
        u: &[f64; 3],
        _memory: &mut Gradient,
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        let (_, _, torque) = self.torque(x, u);
        for i in 0..3 {
            dx[i] = x[4 + i];
            dx[3 + i] = torque[i] / self.p[i];
        }
        Ok(())
    }
}

impl Differentiable for Top {
    fn input_count(&self) -> usize {
        3
    }
    fn parameter_count(&self) -> usize {
        4
    }
    fn linearize(
        &self,
        at: (f64, &[f64], &[f64; 3]),
        row: &mut Gradient,
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        // Row by row from the transposed product.
        let mut unused = Gradient::default();
        for i in 0..6 {
            let mut w = [0.0; 6];
            w[i] = 1.0;
            row.state.fill(0.0);
            row.input.fill(0.0);
            row.parameters.fill(0.0);
            self.pull_back(at, &mut unused, &w, dx, row)?;
            by.state.row_mut(i).copy_from_slice(&row.state);
            by.input.row_mut(i).copy_from_slice(&row.input);
            by.parameters.row_mut(i).copy_from_slice(&row.parameters);
        }
        Ok(())
    }
    fn pull_back(
        &self,
        (_t, x, u): (f64, &[f64], &[f64; 3]),
        _memory: &mut Gradient,
        w: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Infallible> {
        let (momentum, up, torque) = self.torque(x, u);
        let omega = [x[4], x[5], x[6]];
        let mut m = [0.0; 3];
        for i in 0..3 {
            dx[i] = omega[i];
            dx[3 + i] = torque[i] / self.p[i];
            m[i] = w[3 + i] / self.p[i];
            by.input[i] += m[i];
            by.parameters[i] -= m[i] * dx[3 + i];
        }
        // m · (L × ω): in L it is ω × m, in ω it is m × L.
        let of_momentum = cross(omega, m);
        let of_omega = cross(m, momentum);
        // weight m · (−up₁, up₀, 0), and up moves by up × ξ when the body turns by ξ: m · (up × ξ) = (m × up) · ξ.
        let of_up = [self.p[3] * m[1], -self.p[3] * m[0], 0.0];
        let of_turn = cross(of_up, up);
        for i in 0..3 {
            by.state[i] += of_turn[i];
            by.state[3 + i] += w[i] + of_omega[i] + self.p[i] * of_momentum[i];
            by.parameters[i] += of_momentum[i] * omega[i];
        }
        by.parameters[3] += m[1] * up[0] - m[0] * up[1];
        Ok(())
    }
}
