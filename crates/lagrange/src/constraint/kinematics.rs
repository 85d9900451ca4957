//! φ and its derivatives along motions, by dual numbers; and the memory for them.

use nalgebra::{DMatrix, DVector};
use num_dual::{Dual2, Dual64, HyperDual64, HyperHyperDual64};

use super::Constraint;
use crate::{Coordinate, ForwardDynamicsDerivatives, Scalar};

/// What is moved in a derivative of the dynamics.
#[derive(Clone, Copy)]
pub(super) enum Variable {
    /// Along the tangent of q.
    Position(usize),
    Velocity(usize),
    Constant(usize),
}

/// Scratch memory of the constraints for one thread; empty where there are none.
#[derive(Debug, Clone, Default)]
pub(crate) struct Room {
    pub(super) real: Lane<f64>,
    pub(super) dual: Lane<Dual64>,
    pub(super) hyper: Lane<HyperDual64>,
    third: Lane<HyperHyperDual64>,
    /// Time in the outer number, a variable in the inner one.
    pub(super) taylor: Lane<Dual2<Dual64>>,
    /// Along time.
    pub(super) second: Lane<Dual2<f64>>,
    /// φ, φ̇ = J v and J̇ v of the last [`Kinematics::along`].
    pub position: DVector<f64>,
    pub velocity: DVector<f64>,
    pub bias: DVector<f64>,
    /// J, one row an equation.
    pub jacobian: DMatrix<f64>,
    /// The Cholesky factor of M.
    pub mass: DMatrix<f64>,
    /// Where M depends on v: M⁻¹ is ∂v̇/∂Q of the free mechanism.
    pub free: Option<ForwardDynamicsDerivatives>,
    /// v̇.
    pub acceleration: DVector<f64>,
    /// Q + Jᵀ λ.
    pub force: DVector<f64>,
    /// ∂(Jᵀ λ)/∂x and M⁻¹ times a matrix.
    pub force_by: DMatrix<f64>,
    pub product: DMatrix<f64>,
    /// M⁻¹ Jᵀ.
    pub response: DMatrix<f64>,
    /// J M⁻¹ Jᵀ, then its Cholesky factor.
    pub coupling: DMatrix<f64>,
    /// λ.
    pub multipliers: DVector<f64>,
    /// Right-hand side of one equation for λ.
    pub rhs: DVector<f64>,
    /// Derivatives of φ̈ + 2 ω φ̇ + ω² φ at fixed v̇, one column a variable.
    pub by: DMatrix<f64>,
}

/// The arguments and the residuals on one number type.
#[derive(Debug, Clone)]
pub(super) struct Lane<D> {
    pub q: Vec<D>,
    pub v: Vec<D>,
    pub rate: Vec<D>,
    pub p: Vec<D>,
    /// Of all equations, the dropped ones too.
    pub out: Vec<D>,
}

impl<D> Default for Lane<D> {
    fn default() -> Self {
        Lane {
            q: Vec::new(),
            v: Vec::new(),
            rate: Vec::new(),
            p: Vec::new(),
            out: Vec::new(),
        }
    }
}

impl<D: Scalar> Lane<D> {
    fn new(nq: usize, nv: usize, np: usize, equations: usize) -> Self {
        Lane {
            q: vec![D::zero(); nq],
            v: vec![D::zero(); nv],
            rate: vec![D::zero(); nq],
            p: vec![D::zero(); np],
            out: vec![D::zero(); equations],
        }
    }

    pub fn set(&mut self, q: &[f64], v: &[f64], p: &[f64]) {
        for (to, from) in [(&mut self.q, q), (&mut self.v, v), (&mut self.p, p)] {
            for (d, &x) in to.iter_mut().zip(from) {
                *d = D::constant(x);
            }
        }
    }

    pub fn unit_velocity(&mut self, j: usize) {
        self.v.fill(D::zero());
        self.v[j] = D::constant(1.0);
    }
}

/// Of a mechanism with `nq`, `nv`, `np` numbers in q, v, p.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sizes {
    pub nq: usize,
    pub nv: usize,
    pub np: usize,
}

impl Room {
    /// For `equations` of which `kept` are in force.
    pub fn new(size: Sizes, equations: usize, kept: usize) -> Self {
        let Sizes { nq, nv, np } = size;
        Room {
            real: Lane::new(nq, nv, np, equations),
            dual: Lane::new(nq, nv, np, equations),
            hyper: Lane::new(nq, nv, np, equations),
            third: Lane::new(nq, nv, np, equations),
            taylor: Lane::new(nq, nv, np, equations),
            second: Lane::new(nq, nv, np, equations),
            position: DVector::zeros(kept),
            velocity: DVector::zeros(kept),
            bias: DVector::zeros(kept),
            jacobian: DMatrix::zeros(kept, nv),
            mass: DMatrix::zeros(nv, nv),
            free: None,
            acceleration: DVector::zeros(nv),
            force: DVector::zeros(nv),
            force_by: DMatrix::zeros(nv, nv),
            product: DMatrix::zeros(nv, nv),
            response: DMatrix::zeros(nv, kept),
            coupling: DMatrix::zeros(kept, kept),
            multipliers: DVector::zeros(kept),
            rhs: DVector::zeros(kept),
            by: DMatrix::zeros(kept, nv),
        }
    }
}

/// q̇ of the velocity v: v itself, but for floating joints. There q holds the position x and the unit quaternion u = (w, u⃗), v the
/// linear and angular velocity in the axes of the body, and ẋ = R(u) v_lin, u̇ = ½ u (0, ω).
pub(super) fn position_rate<D: Scalar>(
    coordinates: &[Coordinate],
    q: &[D],
    v: &[D],
    rate: &mut [D],
) {
    let (mut iq, mut iv) = (0, 0);
    for coordinate in coordinates {
        if coordinate.floating {
            let [w, x, y, z] = [q[iq + 3], q[iq + 4], q[iq + 5], q[iq + 6]];
            let [a, b, c] = [v[iv], v[iv + 1], v[iv + 2]];
            let [r, s, t] = [v[iv + 3], v[iv + 4], v[iv + 5]];
            // R(u) a = a + 2 u⃗ × (u⃗ × a + w a)
            let inner = [
                y * c - z * b + w * a,
                z * a - x * c + w * b,
                x * b - y * a + w * c,
            ];
            rate[iq] = a + (y * inner[2] - z * inner[1]) * 2.0;
            rate[iq + 1] = b + (z * inner[0] - x * inner[2]) * 2.0;
            rate[iq + 2] = c + (x * inner[1] - y * inner[0]) * 2.0;
            rate[iq + 3] = (x * r + y * s + z * t) * -0.5;
            rate[iq + 4] = (w * r + y * t - z * s) * 0.5;
            rate[iq + 5] = (w * s + z * r - x * t) * 0.5;
            rate[iq + 6] = (w * t + x * s - y * r) * 0.5;
        } else {
            rate[iq] = v[iv];
        }
        iq += coordinate.nq();
        iv += coordinate.nv();
    }
}

/// φ of a mechanism with these coordinates: of the equations `kept`.
pub(super) struct Kinematics<'a, C> {
    pub constraint: &'a C,
    pub coordinates: &'a [Coordinate],
    pub kept: &'a [usize],
}

impl<C: Constraint> Kinematics<'_, C> {
    /// φ(q).
    pub fn residual(&self, q: &[f64], p: &[f64], room: &mut Room, out: &mut DVector<f64>) {
        let at = &mut room.real;
        self.constraint.residual_with(q, p, &mut at.out);
        for (row, &equation) in self.kept.iter().enumerate() {
            out[row] = at.out[equation];
        }
    }

    /// J: column j is dφ along the velocity e_j.
    pub fn jacobian(&self, q: &[f64], p: &[f64], room: &mut Room) {
        let at = &mut room.dual;
        at.set(q, &[], p);
        for j in 0..at.v.len() {
            at.unit_velocity(j);
            for (d, &x) in at.q.iter_mut().zip(q) {
                *d = x.into();
            }
            position_rate(self.coordinates, &at.q, &at.v, &mut at.rate);
            for (d, rate) in at.q.iter_mut().zip(&at.rate) {
                d.eps = rate.re;
            }
            self.constraint.residual_with(&at.q, &at.p, &mut at.out);
            for (row, &equation) in self.kept.iter().enumerate() {
                room.jacobian[(row, j)] = at.out[equation].eps;
            }
        }
    }

    /// φ, φ̇ and J̇ v = φ̈ at v̇ = 0. Both ε are time: q = q + (ε₁ + ε₂) q̇ + ε₁ε₂ q̈.
    pub fn along(&self, q: &[f64], v: &[f64], p: &[f64], room: &mut Room) {
        let at = &mut room.hyper;
        at.set(q, v, p);
        position_rate(self.coordinates, &at.q, &at.v, &mut at.rate);
        for (d, rate) in at.q.iter_mut().zip(&at.rate) {
            d.eps1 = rate.re;
        }
        position_rate(self.coordinates, &at.q, &at.v, &mut at.rate);
        for (d, rate) in at.q.iter_mut().zip(&at.rate) {
            d.eps2 = rate.re;
            d.eps1eps2 = rate.eps1;
        }
        self.constraint.residual_with(&at.q, &at.p, &mut at.out);
        for (row, &equation) in self.kept.iter().enumerate() {
            room.position[row] = at.out[equation].re;
            room.velocity[row] = at.out[equation].eps1;
            room.bias[row] = at.out[equation].eps1eps2;
        }
    }

    /// ∂(φ̈ + 2 ω φ̇ + ω² φ)/∂x at fixed v̇ = `a`, into column `column` of `room.by`. ε₁ and ε₂ are time, ε₃ is along the variable.
    pub fn by_variable(
        &self,
        (q, v, a): (&[f64], &[f64], &[f64]),
        p: &[f64],
        rate: f64,
        variable: Variable,
        column: usize,
        room: &mut Room,
    ) {
        let at = &mut room.third;
        match variable {
            Variable::Position(j) => {
                at.set(q, &[], p);
                at.unit_velocity(j);
                position_rate(self.coordinates, &at.q, &at.v, &mut at.rate);
                for (d, rate) in at.q.iter_mut().zip(&at.rate) {
                    d.eps3 = rate.re;
                }
                at.set(&[], v, &[]);
            }
            Variable::Velocity(j) => {
                at.set(q, v, p);
                at.v[j].eps3 = 1.0;
            }
            Variable::Constant(j) => {
                at.set(q, v, p);
                at.p[j].eps3 = 1.0;
            }
        }
        // q̇ and its change with the variable.
        position_rate(self.coordinates, &at.q, &at.v, &mut at.rate);
        for (d, rate) in at.q.iter_mut().zip(&at.rate) {
            d.eps1 = rate.re;
            d.eps1eps3 = rate.eps3;
        }
        for (d, &a) in at.v.iter_mut().zip(a) {
            d.eps1 = a;
        }
        // q̈ and its change with the variable.
        position_rate(self.coordinates, &at.q, &at.v, &mut at.rate);
        for (d, rate) in at.q.iter_mut().zip(&at.rate) {
            d.eps2 = rate.re;
            d.eps2eps3 = rate.eps3;
            d.eps1eps2 = rate.eps1;
            d.eps1eps2eps3 = rate.eps1eps3;
        }
        self.constraint.residual_with(&at.q, &at.p, &mut at.out);
        for (row, &equation) in self.kept.iter().enumerate() {
            let phi = at.out[equation];
            room.by[(row, column)] =
                phi.eps1eps2eps3 + 2.0 * rate * phi.eps1eps3 + rate * rate * phi.eps3;
        }
    }

    /// ∂(Jᵀ λ)/∂x at fixed λ = `room.multipliers`, into column `column` of `room.force_by`. ε₁ is along the velocity e_i that picks
    /// entry i of Jᵀ λ, ε₂ along the variable.
    pub fn force_by(
        &self,
        q: &[f64],
        p: &[f64],
        variable: Variable,
        column: usize,
        room: &mut Room,
    ) {
        let at = &mut room.hyper;
        at.set(q, &[], p);
        match variable {
            Variable::Position(j) => {
                at.unit_velocity(j);
                position_rate(self.coordinates, &at.q, &at.v, &mut at.rate);
                for (d, rate) in at.q.iter_mut().zip(&at.rate) {
                    d.eps2 = rate.re;
                }
            }
            Variable::Velocity(_) => {}
            Variable::Constant(j) => at.p[j].eps2 = 1.0,
        }
        for i in 0..at.v.len() {
            at.unit_velocity(i);
            position_rate(self.coordinates, &at.q, &at.v, &mut at.rate);
            for (d, rate) in at.q.iter_mut().zip(&at.rate) {
                d.eps1 = rate.re;
                d.eps1eps2 = rate.eps2;
            }
            self.constraint.residual_with(&at.q, &at.p, &mut at.out);
            // The next velocity finds q without its ε₁: position_rate must not see it.
            for d in &mut at.q {
                d.eps1 = 0.0;
                d.eps1eps2 = 0.0;
            }
            let terms = room.multipliers.iter().zip(self.kept);
            room.force_by[(i, column)] = terms
                .map(|(multiplier, &equation)| multiplier * at.out[equation].eps1eps2)
                .sum();
        }
    }
}
