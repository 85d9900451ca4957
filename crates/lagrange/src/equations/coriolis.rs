//! The Coriolis matrix that makes Ṁ − 2C skew: Christoffel's.

use nalgebra::DMatrix;

use super::Workspace;
use crate::Lagrangian;

/// C_ij = Σ_k ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i) v_k, from ∂M/∂q by polarised dual evaluations of T.
pub(crate) fn coriolis_matrix<L: Lagrangian>(
    lagrangian: &L,
    q: &[f64],
    v: &[f64],
    p: &[f64],
    work: &mut Workspace,
    coriolis: &mut DMatrix<f64>,
) {
    let n = q.len();
    let Workspace {
        dual: at,
        diagonal,
        mass_by_q,
        ..
    } = work;
    at.set(q, v, p);
    at.v.fill(0.0.into());
    for (k, by_q_k) in mass_by_q.iter_mut().enumerate() {
        at.q[k].eps = 1.0;
        for i in 0..n {
            at.v[i].re = 1.0;
            diagonal[i] = lagrangian.kinetic_with(&at.q, &at.v, &at.p).eps;
            by_q_k[(i, i)] = 2.0 * diagonal[i];
            for j in 0..i {
                at.v[j].re = 1.0;
                let both = lagrangian.kinetic_with(&at.q, &at.v, &at.p).eps;
                let m = both - diagonal[i] - diagonal[j];
                by_q_k[(i, j)] = m;
                by_q_k[(j, i)] = m;
                at.v[j].re = 0.0;
            }
            at.v[i].re = 0.0;
        }
        at.q[k].eps = 0.0;
    }
    for i in 0..n {
        for j in 0..n {
            coriolis[(i, j)] = (0..n)
                .map(|k| {
                    let christoffel =
                        mass_by_q[k][(i, j)] + mass_by_q[j][(i, k)] - mass_by_q[i][(j, k)];
                    0.5 * christoffel * v[k]
                })
                .sum();
        }
    }
}
