//! Cholesky's factors of M, and of W M⁻¹ Wᵀ, whose rows may depend on each other.

/// Row k counts as dependent on those before it where the square of the sine between it and their span is less than this.
pub(super) const DEPENDENT: f64 = 1e-12;

/// A = L Lᵀ in place for the symmetric n × n matrix A, L in the lower triangle (row i, column j at i n + j).
///
/// A row of which no more than the part `least` is independent of those before it is skipped: its column of L is 0, and
/// [`solve`] gives it 0. Returns the first such row and its pivot. NaN and pivots below 0 count as dependent.
pub(super) fn factorise(a: &mut [f64], n: usize, least: f64) -> Option<(usize, f64)> {
    let mut skipped = None;
    for j in 0..n {
        let whole = a[j * n + j];
        let mut pivot = whole;
        for k in 0..j {
            pivot -= a[j * n + k] * a[j * n + k];
        }
        if !(pivot > least * whole && pivot > 0.0 && pivot.is_finite()) {
            skipped = skipped.or(Some((j, pivot)));
            for i in j..n {
                a[i * n + j] = 0.0;
            }
            continue;
        }
        let root = pivot.sqrt();
        a[j * n + j] = root;
        for i in j + 1..n {
            let mut x = a[i * n + j];
            for k in 0..j {
                x -= a[i * n + k] * a[j * n + k];
            }
            a[i * n + j] = x / root;
        }
    }
    skipped
}

/// x with A x = b in place, 0 in the rows that were skipped.
pub(super) fn solve(l: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        let mut y = x[i];
        for k in 0..i {
            y -= l[i * n + k] * x[k];
        }
        let pivot = l[i * n + i];
        x[i] = if pivot > 0.0 { y / pivot } else { 0.0 };
    }
    for i in (0..n).rev() {
        let mut y = x[i];
        for k in i + 1..n {
            y -= l[k * n + i] * x[k];
        }
        let pivot = l[i * n + i];
        x[i] = if pivot > 0.0 { y / pivot } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_solves_and_names_the_row_that_depends_on_others() {
        // The third row is the sum of the first two.
        let a = [2.0, 1.0, 3.0, 1.0, 3.0, 4.0, 3.0, 4.0, 7.0];
        let mut l = a;
        let (row, pivot) = factorise(&mut l, 3, DEPENDENT).unwrap();
        assert_eq!(row, 2);
        assert!(pivot.abs() < 1e-14);
        let b = [1.0, -2.0, -1.0];
        let mut x = b;
        solve(&l, 3, &mut x);
        assert_eq!(x[2], 0.0);
        for i in 0..3 {
            let product: f64 = (0..3).map(|j| a[3 * i + j] * x[j]).sum();
            assert!((product - b[i]).abs() < 1e-14);
        }
    }

    #[test]
    fn a_pivot_that_is_no_number_is_skipped_and_named() {
        let mut a = [1.0, f64::NAN, f64::NAN, 1.0];
        let (row, pivot) = factorise(&mut a, 2, 0.0).unwrap();
        assert_eq!(row, 1);
        assert!(pivot.is_nan());
    }
}
