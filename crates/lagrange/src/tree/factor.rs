//! The factors of the mass matrix that keep its zeros.

use super::plan::Plan;
use crate::Scalar;

/// M = Lᵀ D L with a unit lower triangle L in the order of [`Plan::dofs`], in place: D on the diagonal of `m` (row after row), L below
/// it. The zeros of M, between joints of which none carries the other, are zeros of L. (Featherstone 2008, §6.5.)
///
/// For joints of which none follows another.
#[inline(always)]
pub fn factor<D: Scalar>(plan: &Plan, m: &mut [D]) {
    let n = plan.dofs.len();
    for k in (0..n).rev() {
        let (rest, row) = m.split_at_mut(k * n);
        let pivot = D::constant(1.0) / row[k];
        let mut at = plan.dofs[k].above;
        while let Some(i) = at {
            let ratio = row[i] * pivot;
            let target = &mut rest[i * n..(i + 1) * n];
            let mut across = Some(i);
            while let Some(j) = across {
                target[j] = (-ratio).times_plus(row[j], target[j]);
                across = plan.dofs[j].above;
            }
            row[i] = ratio;
            at = plan.dofs[i].above;
        }
    }
}

/// Solves M X = B in place; row k of B, for degree of freedom k, is `rows[k * width ..][.. width]`.
#[inline(always)]
pub fn solve<D: Scalar>(plan: &Plan, m: &[D], rows: &mut [D], width: usize) {
    let n = plan.dofs.len();
    // Lᵀ Y = B
    for k in (0..n).rev() {
        let (before, here) = rows.split_at_mut(k * width);
        let row = &here[..width];
        let mut at = plan.dofs[k].above;
        while let Some(i) = at {
            subtract(&mut before[i * width..(i + 1) * width], row, m[k * n + i]);
            at = plan.dofs[i].above;
        }
    }
    // L X = D⁻¹ Y
    for k in 0..n {
        let (before, here) = rows.split_at_mut(k * width);
        let row = &mut here[..width];
        let pivot = D::constant(1.0) / m[k * n + k];
        for x in row.iter_mut() {
            *x = *x * pivot;
        }
        let mut at = plan.dofs[k].above;
        while let Some(i) = at {
            subtract(row, &before[i * width..(i + 1) * width], m[k * n + i]);
            at = plan.dofs[i].above;
        }
    }
}

/// row −= factor · other.
#[inline(always)]
fn subtract<D: Scalar>(row: &mut [D], other: &[D], factor: D) {
    let factor = -factor;
    for (x, y) in row.iter_mut().zip(other) {
        *x = factor.times_plus(*y, *x);
    }
}
