//! Derivatives of the inverse dynamics Q = M v̇ + C v + G in q, v and the constants, by third-order dual numbers.
//!
//! With ε₁ along time (q̇ = v, v̇ = a), ε₂ along v_i and ε₃ along the variable x,
//!
//! ∂Q_i/∂x = ∂³T/∂t∂v_i∂x − ∂²(T − V)/∂q_i∂x.
//!
//! ∂Q/∂v̇ is M.

use nalgebra::{DMatrix, DVector};

use super::Workspace;
use crate::{LANES, Lagrangian};

/// Which variable is moved.
#[derive(Clone, Copy)]
enum Variable {
    Position(usize),
    Velocity(usize),
    Constant(usize),
}

/// Derivatives of the inverse dynamics Q(q, v, v̇; p) at fixed v̇, one column a variable. Entries are numbers, or `[f64; LANES]` for
/// eight states: lane k is state k.
#[derive(Debug, Clone, PartialEq)]
pub struct InverseDynamicsDerivatives<T = f64> {
    /// ∂Q/∂q, n × n.
    pub by_q: DMatrix<T>,
    /// ∂Q/∂v, n × n.
    pub by_v: DMatrix<T>,
    /// ∂Q/∂p for the constants that were asked for, n × their number.
    pub by_p: DMatrix<T>,
}

impl InverseDynamicsDerivatives {
    /// Zeros, for `nv` coordinates and `np` constants.
    pub fn zeros(nv: usize, np: usize) -> Self {
        Self::filled(nv, np, 0.0)
    }
}

impl InverseDynamicsDerivatives<[f64; LANES]> {
    /// Zeros for eight states.
    pub fn lanes(nv: usize, np: usize) -> Self {
        Self::filled(nv, np, [0.0; LANES])
    }
}

impl<T: nalgebra::Scalar> InverseDynamicsDerivatives<T> {
    fn filled(nv: usize, np: usize, zero: T) -> Self {
        InverseDynamicsDerivatives {
            by_q: DMatrix::from_element(nv, nv, zero.clone()),
            by_v: DMatrix::from_element(nv, nv, zero.clone()),
            by_p: DMatrix::from_element(nv, np, zero.clone()),
        }
    }
}

/// The acceleration v̇(q, v, Q; p) of the forward dynamics and its derivatives, one column a variable. Entries are numbers, or
/// `[f64; LANES]` for eight states: lane k is state k.
#[derive(Debug, Clone, PartialEq)]
pub struct ForwardDynamicsDerivatives<T = f64> {
    /// v̇.
    pub acceleration: DVector<T>,
    /// ∂v̇/∂q at fixed v and Q, n × n; along the tangent of q where a joint floats.
    pub by_q: DMatrix<T>,
    /// ∂v̇/∂v at fixed q and Q, n × n.
    pub by_v: DMatrix<T>,
    /// ∂v̇/∂Q, n × n, symmetric: M⁻¹ where nothing is constrained.
    pub by_force: DMatrix<T>,
    /// ∂v̇/∂p for the constants that were asked for, n × their number.
    pub by_p: DMatrix<T>,
}

impl ForwardDynamicsDerivatives {
    /// Zeros, for `nv` degrees of freedom and `np` constants.
    pub fn zeros(nv: usize, np: usize) -> Self {
        Self::filled(nv, np, 0.0)
    }
}

impl ForwardDynamicsDerivatives<[f64; LANES]> {
    /// Zeros for eight states.
    pub fn lanes(nv: usize, np: usize) -> Self {
        Self::filled(nv, np, [0.0; LANES])
    }
}

impl<T: nalgebra::Scalar> ForwardDynamicsDerivatives<T> {
    fn filled(nv: usize, np: usize, zero: T) -> Self {
        ForwardDynamicsDerivatives {
            acceleration: DVector::from_element(nv, zero.clone()),
            by_q: DMatrix::from_element(nv, nv, zero.clone()),
            by_v: DMatrix::from_element(nv, nv, zero.clone()),
            by_force: DMatrix::from_element(nv, nv, zero.clone()),
            by_p: DMatrix::from_element(nv, np, zero.clone()),
        }
    }
}

/// Fills `out` at (q, v, v̇ = a); `constants` are the indices of the wanted constants.
pub(crate) fn inverse_dynamics_derivatives<L: Lagrangian>(
    lagrangian: &L,
    (q, v, a): (&[f64], &[f64], &[f64]),
    p: &[f64],
    constants: &[usize],
    work: &mut Workspace,
    out: &mut InverseDynamicsDerivatives,
) {
    let n = q.len();
    work.third.set(q, v, p);
    work.hyper.set(q, v, p);
    for i in 0..n {
        work.third.q[i].eps1 = v[i];
        work.third.v[i].eps1 = a[i];
    }
    for j in 0..n {
        column(lagrangian, Variable::Position(j), work, |i, x| {
            out.by_q[(i, j)] = x;
        });
        column(lagrangian, Variable::Velocity(j), work, |i, x| {
            out.by_v[(i, j)] = x;
        });
    }
    for (j, &constant) in constants.iter().enumerate() {
        column(lagrangian, Variable::Constant(constant), work, |i, x| {
            out.by_p[(i, j)] = x;
        });
    }
}

fn column<L: Lagrangian>(
    lagrangian: &L,
    variable: Variable,
    work: &mut Workspace,
    mut put: impl FnMut(usize, f64),
) {
    seed(work, variable, 1.0);
    for i in 0..work.third.q.len() {
        let third = &mut work.third;
        third.v[i].eps2 = 1.0;
        let momentum_rate = lagrangian
            .kinetic_with(&third.q, &third.v, &third.p)
            .eps1eps2eps3;
        third.v[i].eps2 = 0.0;

        let second = &mut work.hyper;
        second.q[i].eps1 = 1.0;
        let kinetic = lagrangian
            .kinetic_with(&second.q, &second.v, &second.p)
            .eps1eps2;
        // V does not depend on v.
        let potential = match variable {
            Variable::Velocity(_) => 0.0,
            _ => lagrangian.potential_with(&second.q, &second.p).eps1eps2,
        };
        second.q[i].eps1 = 0.0;
        put(i, momentum_rate - kinetic + potential);
    }
    seed(work, variable, 0.0);
}

fn seed(work: &mut Workspace, variable: Variable, one: f64) {
    match variable {
        Variable::Position(j) => {
            work.third.q[j].eps3 = one;
            work.hyper.q[j].eps2 = one;
        }
        Variable::Velocity(j) => {
            work.third.v[j].eps3 = one;
            // q̇ = v: moving v_j moves the time derivative of q_j.
            work.third.q[j].eps1eps3 = one;
            work.hyper.v[j].eps2 = one;
        }
        Variable::Constant(j) => {
            work.third.p[j].eps3 = one;
            work.hyper.p[j].eps2 = one;
        }
    }
}
