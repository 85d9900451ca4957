//! The Cholesky factors of M and of J M⁻¹ Jᵀ, which say what row depends on those before it: a velocity that moves no mass of its
//! own, an equation that constrains nothing new.

use nalgebra::{DMatrix, DVector};

/// An equation counts as dependent on the others where the square of the sine between its row of J and their span, in the metric
/// of M⁻¹, is less than this: an angle of 1e-6 rad. λ then has no digit that could be trusted by half of them.
pub(crate) const DEPENDENT: f64 = 1e-12;

/// A = L Lᵀ in place, L in the lower triangle.
///
/// # Errors
/// The first row of which a part of at most `least` is independent of those before it, and that part: the square of the sine
/// between them, in the metric that makes A of rows.
pub(crate) fn factorise(a: &mut DMatrix<f64>, least: f64) -> Result<(), (usize, f64)> {
    for j in 0..a.nrows() {
        let whole = a[(j, j)];
        let mut pivot = whole;
        for k in 0..j {
            pivot -= a[(j, k)] * a[(j, k)];
        }
        let part = pivot / whole;
        // A row of zeros (0/0), a negative diagonal and numbers that are not finite fail as well.
        if !(part > least && pivot > 0.0 && pivot.is_finite()) {
            return Err((j, if part.is_finite() { part.max(0.0) } else { 0.0 }));
        }
        let root = pivot.sqrt();
        a[(j, j)] = root;
        for i in j + 1..a.nrows() {
            let mut x = a[(i, j)];
            for k in 0..j {
                x -= a[(i, k)] * a[(j, k)];
            }
            a[(i, j)] = x / root;
        }
    }
    Ok(())
}

/// x with A x = b, in place.
pub(crate) fn solve(factor: &DMatrix<f64>, b: &mut DVector<f64>) {
    // The diagonal is positive, so both solves succeed.
    factor.solve_lower_triangular_mut(b);
    factor.tr_solve_lower_triangular_mut(b);
}

#[cfg(test)]
mod tests {
    use super::{DEPENDENT, factorise, solve};
    use nalgebra::{dmatrix, dvector};

    #[test]
    fn the_factor_solves() {
        let a = dmatrix![4.0, 2.0, 0.4; 2.0, 3.0, -0.5; 0.4, -0.5, 1.0];
        let mut factor = a.clone();
        factorise(&mut factor, DEPENDENT).unwrap();
        let mut x = dvector![1.0, -2.0, 0.3];
        let b = x.clone();
        solve(&factor, &mut x);
        assert!((a * x - b).amax() < 1e-14);
    }

    #[test]
    fn the_row_that_depends_on_those_before_is_named() {
        // Rows (1, 0), (1, 1), (2, 1).
        let mut a = dmatrix![1.0, 1.0, 2.0; 1.0, 2.0, 3.0; 2.0, 3.0, 5.0];
        let (row, part) = factorise(&mut a, DEPENDENT).unwrap_err();
        assert_eq!(row, 2);
        assert!(part < 1e-15);
        let mut zero = dmatrix![0.0];
        assert_eq!(factorise(&mut zero, DEPENDENT), Err((0, 0.0)));
    }
}
