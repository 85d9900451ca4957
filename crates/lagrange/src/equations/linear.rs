//! The equations of motion, linear around one state.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6};

use super::Workspace;
use crate::{Error, Mechanics};

/// The linear system ẋ = A x + B Q for x = (δq, δv), around one state.
#[derive(Debug, Clone, PartialEq)]
pub struct Linear {
    /// 2 nv × 2 nv.
    pub a: DMatrix<f64>,
    /// 2 nv × nv.
    pub b: DMatrix<f64>,
    /// v̇ at the state itself.
    pub acceleration: DVector<f64>,
}

impl Linear {
    /// Zeros, for `nv` degrees of freedom.
    pub fn zeros(nv: usize) -> Self {
        Linear {
            a: DMatrix::zeros(2 * nv, 2 * nv),
            b: DMatrix::zeros(2 * nv, nv),
            acceleration: DVector::zeros(nv),
        }
    }
}

/// Fills `out` from the derivatives of the forward dynamics.
pub(crate) fn linearize<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, force): (&[f64], &[f64], &[f64]),
    p: &[f64],
    work: &mut Workspace,
    out: &mut Linear,
) -> Result<(), Error> {
    let n = mechanics.nv();
    let mut derivatives = work.take_derivatives(n, p.len());
    let by = &mut derivatives.forward;
    // No columns for the constants, which are not asked for.
    let by_p = std::mem::take(&mut by.by_p);
    by.by_p = DMatrix::zeros(n, 0);
    let solved = mechanics.forward_dynamics_derivatives_into(q, v, force, p, &[], work, by);
    by.by_p = by_p;
    out.a.fill(0.0);
    out.a.view_mut((0, n), (n, n)).fill_with_identity();
    let mut first = 0;
    for coordinate in mechanics.coordinates() {
        if coordinate.floating {
            let mut block = out.a.fixed_view_mut::<6, 6>(first, first);
            block.copy_from(&carried(&v[first..first + 6]));
        }
        first += coordinate.nv();
    }
    out.a.view_mut((n, 0), (n, n)).copy_from(&by.by_q);
    out.a.view_mut((n, n), (n, n)).copy_from(&by.by_v);
    out.b.fill(0.0);
    out.b.view_mut((n, 0), (n, n)).copy_from(&by.by_force);
    out.acceleration.copy_from(&by.acceleration);
    work.derivatives = Some(derivatives);
    solved
}

/// −ad of a velocity (linear, angular): how a small displacement in turning axes changes while the body moves with `v`.
fn carried(v: &[f64]) -> Matrix6<f64> {
    let cross = |x: &[f64]| Matrix3::new(0.0, -x[2], x[1], x[2], 0.0, -x[0], -x[1], x[0], 0.0);
    let (linear, angular) = (cross(&v[..3]), cross(&v[3..]));
    let mut out = Matrix6::zeros();
    out.fixed_view_mut::<3, 3>(0, 0).copy_from(&-angular);
    out.fixed_view_mut::<3, 3>(0, 3).copy_from(&-linear);
    out.fixed_view_mut::<3, 3>(3, 3).copy_from(&-angular);
    out
}
