//! The factors of the mass matrix that keep its zeros.

use super::plan::Plan;
use crate::Scalar;

/// What is left of a diagonal entry of M when all that it carries may give way: less than this part of it is rounding.
pub const LEAST_PIVOT: f64 = 1e-13;

/// M = Lᵀ D L with a unit lower triangle L in the order of [`Plan::dofs`], in place: D⁻¹ on the diagonal of `m` (row after row), L below
/// it; NaN on the diagonal where M has no inverse. The zeros of M, between joints of which none carries the other, are zeros of L. (Featherstone 2008, §6.5.)
///
/// For joints of which none follows another. `whole` is memory for as many numbers as there are degrees of freedom.
#[inline(always)]
pub fn factor<D: Scalar>(plan: &Plan, m: &mut [D], whole: &mut [D]) {
    let n = plan.dofs.len();
    for (k, entry) in whole.iter_mut().enumerate() {
        *entry = m[k * n + k];
    }
    for k in (0..n).rev() {
        let (rest, row) = m.split_at_mut(k * n);
        let pivot = row[k].inverse_above(whole[k] * LEAST_PIVOT);
        row[k] = pivot;
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

/// Numbers of a row that are solved at once: independent sums, so that no fused product waits for the one before.
const BLOCK: usize = 4;

/// Solves M X = B in place; row k of B, for degree of freedom k, is `rows[k * width ..][.. width]`, of numbers or of eight at once.
#[inline(always)]
pub fn solve<D: Scalar, R: Scalar + From<D>>(plan: &Plan, m: &[D], rows: &mut [R], width: usize) {
    let mut first = 0;
    while first + BLOCK <= width {
        solve_columns::<D, R, BLOCK>(plan, m, rows, width, first);
        first += BLOCK;
    }
    while first < width {
        solve_columns::<D, R, 1>(plan, m, rows, width, first);
        first += 1;
    }
}

/// [`solve`] for `COUNT` numbers of each row, from `first` on. What a joint carries follows it in [`Plan::dofs`] without a gap.
#[inline(always)]
fn solve_columns<D: Scalar, R: Scalar + From<D>, const COUNT: usize>(
    plan: &Plan,
    m: &[D],
    rows: &mut [R],
    width: usize,
    first: usize,
) {
    let n = plan.dofs.len();
    // Lᵀ Y = B: y_i = b_i − Σ L_ki y_k over all k that i carries.
    for i in (0..n).rev() {
        let mut sum = [R::zero(); COUNT];
        sum.copy_from_slice(&rows[i * width + first..][..COUNT]);
        for k in i + 1..plan.dofs[i].end {
            let other = &rows[k * width + first..][..COUNT];
            add(&mut sum, other, R::from(-m[k * n + i]));
        }
        rows[i * width + first..][..COUNT].copy_from_slice(&sum);
    }
    // L X = D⁻¹ Y: x_k = y_k / D_k − Σ L_ki x_i over all i that carry k.
    for k in 0..n {
        let pivot = R::from(m[k * n + k]);
        let mut sum = [R::zero(); COUNT];
        sum.copy_from_slice(&rows[k * width + first..][..COUNT]);
        for x in &mut sum {
            *x = *x * pivot;
        }
        let mut at = plan.dofs[k].above;
        while let Some(i) = at {
            let other = &rows[i * width + first..][..COUNT];
            add(&mut sum, other, R::from(-m[k * n + i]));
            at = plan.dofs[i].above;
        }
        rows[k * width + first..][..COUNT].copy_from_slice(&sum);
    }
}

/// sum += factor · other.
#[inline(always)]
fn add<R: Scalar, const COUNT: usize>(sum: &mut [R; COUNT], other: &[R], factor: R) {
    for k in 0..COUNT {
        sum[k] = factor.times_plus(other[k], sum[k]);
    }
}
