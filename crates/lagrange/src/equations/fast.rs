//! The fast route for T quadratic in v: T = ½ vᵀ M(q) v.

use nalgebra::{DMatrix, DVector};

use super::Workspace;
use crate::Lagrangian;

/// M by polarisation, n(n+1)/2 plain evaluations of T:
///
/// M_ii = 2 T(q, e_i),  M_ij = T(q, e_i + e_j) − T(q, e_i) − T(q, e_j).
pub(crate) fn mass_matrix<L: Lagrangian>(
    lagrangian: &L,
    q: &[f64],
    p: &[f64],
    work: &mut Workspace,
    mass: &mut DMatrix<f64>,
) {
    let n = q.len();
    let at = &mut work.real;
    at.q.copy_from_slice(q);
    at.p.copy_from_slice(p);
    at.v.fill(0.0);
    for i in 0..n {
        at.v[i] = 1.0;
        work.diagonal[i] = lagrangian.kinetic_with(&at.q, &at.v, &at.p);
        mass[(i, i)] = 2.0 * work.diagonal[i];
        for j in 0..i {
            at.v[j] = 1.0;
            let both = lagrangian.kinetic_with(&at.q, &at.v, &at.p);
            let m = both - work.diagonal[i] - work.diagonal[j];
            mass[(i, j)] = m;
            mass[(j, i)] = m;
            at.v[j] = 0.0;
        }
        at.v[i] = 0.0;
    }
}

/// G = +∂V/∂q, by n dual evaluations of V; on the left-hand side.
pub(crate) fn gravity_force<L: Lagrangian>(
    lagrangian: &L,
    q: &[f64],
    p: &[f64],
    work: &mut Workspace,
    gravity: &mut DVector<f64>,
) {
    let at = &mut work.dual;
    at.set(q, &[], p);
    for i in 0..q.len() {
        at.q[i].eps = 1.0;
        gravity[i] = lagrangian.potential_with(&at.q, &at.p).eps;
        at.q[i].eps = 0.0;
    }
}

/// ∂T/∂v, by n dual evaluations of T; for T quadratic in v or not.
pub(crate) fn momentum<L: Lagrangian>(
    lagrangian: &L,
    q: &[f64],
    v: &[f64],
    p: &[f64],
    work: &mut Workspace,
    momentum: &mut DVector<f64>,
) {
    let at = &mut work.dual;
    at.set(q, v, p);
    for i in 0..q.len() {
        at.v[i].eps = 1.0;
        momentum[i] = lagrangian.kinetic_with(&at.q, &at.v, &at.p).eps;
        at.v[i].eps = 0.0;
    }
}

/// C v + G, on the left-hand side, by n hyper-dual and n dual evaluations:
///
/// (C v + G)_i = d/ds ∂T/∂v_i (q + s v, v) − ∂T/∂q_i + ∂V/∂q_i.
pub(crate) fn bias_force<L: Lagrangian>(
    lagrangian: &L,
    q: &[f64],
    v: &[f64],
    p: &[f64],
    work: &mut Workspace,
    bias: &mut DVector<f64>,
) {
    inverse_dynamics(lagrangian, (q, v, None), p, work, bias);
}

/// Q = M v̇ + C v + G for the acceleration `a`; without one, C v + G:
///
/// Q_i = d/dt ∂T/∂v_i (q, v) − ∂T/∂q_i + ∂V/∂q_i along q̇ = v, v̇ = a.
pub(crate) fn inverse_dynamics<L: Lagrangian>(
    lagrangian: &L,
    (q, v, a): (&[f64], &[f64], Option<&[f64]>),
    p: &[f64],
    work: &mut Workspace,
    force: &mut DVector<f64>,
) {
    let n = q.len();
    // ε₁ is time, ε₂ the velocity whose momentum is taken.
    let along = &mut work.hyper;
    along.set(q, v, p);
    for i in 0..n {
        along.q[i].eps1 = v[i];
        along.v[i].eps1 = a.map_or(0.0, |a| a[i]);
    }
    let at = &mut work.dual;
    at.set(q, v, p);
    for i in 0..n {
        along.v[i].eps2 = 1.0;
        let momentum_rate = lagrangian
            .kinetic_with(&along.q, &along.v, &along.p)
            .eps1eps2;
        along.v[i].eps2 = 0.0;

        at.q[i].eps = 1.0;
        let kinetic = lagrangian.kinetic_with(&at.q, &at.v, &at.p).eps;
        let potential = lagrangian.potential_with(&at.q, &at.p).eps;
        at.q[i].eps = 0.0;
        force[i] = momentum_rate - kinetic + potential;
    }
}
