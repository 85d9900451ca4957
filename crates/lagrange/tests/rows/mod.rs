//! Rows times derivatives.

use lagrange::{ForwardDynamicsDerivatives, ForwardDynamicsGradient, Mechanics};
use nalgebra::{DMatrix, DVector};

/// That wᵀ ∂v̇/∂(q, v, Q, p) is the row w times the derivatives, to 1e-11 of |wᵀ| |∂v̇/∂x|, for two rows; and v̇ the same.
pub fn assert_product<M: Mechanics>(mechanism: &M, (q, v, force): (&[f64], &[f64], &[f64])) {
    let (p, n) = (mechanism.nominal(), v.len());
    let constants: Vec<usize> = (0..p.len()).collect();
    let mut work = mechanism.workspace();
    let mut whole = ForwardDynamicsDerivatives::zeros(n, p.len());
    mechanism
        .forward_dynamics_derivatives_into(q, v, force, &p, &constants, &mut work, &mut whole)
        .unwrap();
    for shift in [0.3, 2.1] {
        let weight = DVector::from_fn(n, |i, _| (1.9 * i as f64 + shift).sin());
        // What an earlier call has left is not seen.
        let mut row = ForwardDynamicsGradient::zeros(n, p.len());
        row.by_q.fill(7.0);
        row.by_p.fill(f64::NAN);
        let w = weight.as_slice();
        mechanism
            .forward_dynamics_gradient_into(q, v, force, &p, w, &mut work, &mut row)
            .unwrap();
        assert_eq!(row.acceleration, whole.acceleration);
        let compare = |name: &str, row: &DVector<f64>, by: &DMatrix<f64>| {
            let error = (row - by.tr_mul(&weight)).amax();
            let size = weight.norm() * (1.0 + by.norm());
            assert!(error <= 1e-11 * size, "{name}: {error:e} of {size:e}");
            assert_eq!(row.len(), by.ncols());
        };
        compare("q", &row.by_q, &whole.by_q);
        compare("v", &row.by_v, &whole.by_v);
        compare("Q", &row.by_force, &whole.by_force);
        compare("p", &row.by_p, &whole.by_p);
    }
}
