//! Elliptic functions by the arithmetic-geometric mean (Abramowitz and Stegun, 16.4 and 17.6).

use std::f64::consts::FRAC_PI_2;

/// The arithmetic-geometric mean doubles its digits with every step: 8 are more than a double holds.
const STEPS: usize = 8;

/// The complete integral of the first kind, K = π / (2 agm(1, k')), for the complementary modulus k' = √(1 − k²) in (0, 1].
pub(super) fn complete_integral(complement: f64) -> f64 {
    let (mut a, mut b) = (1.0, complement);
    for _ in 0..STEPS {
        (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
    }
    FRAC_PI_2 / a
}

/// Jacobi's sn, cn, dn at u for the modulus k.
pub(super) fn jacobi(u: f64, k: f64) -> (f64, f64, f64) {
    let (mut a, mut b) = (1.0, (1.0 - k * k).sqrt());
    let mut ratios = [0.0; STEPS];
    for ratio in &mut ratios {
        let c = 0.5 * (a - b);
        (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
        *ratio = c / a;
    }
    let mut phi = a * u * f64::from(1_u32 << STEPS);
    for ratio in ratios.iter().rev() {
        phi = 0.5 * (phi + (ratio * phi.sin()).asin());
    }
    let (sn, cn) = phi.sin_cos();
    (sn, cn, (1.0 - k * k * sn * sn).sqrt())
}
