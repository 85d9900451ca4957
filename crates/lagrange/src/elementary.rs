//! Sines, exponentials and hyperbolic tangents of eight numbers, without a branch.
//!
//! They need the fused product: without it they are not exact enough.

use std::array::from_fn;

use crate::lanes::{LANES, fuse};

/// π/2 as a sum of three numbers.
const HALF_PI: [f64; 3] = [
    std::f64::consts::FRAC_PI_2,
    6.123_233_995_736_766e-17,
    -1.497_384_904_859_17e-33,
];
/// Minimax coefficients of (sin r − r)/r³ in r², on |r| ≤ π/4 (those of FDLIBM).
const SINE: [f64; 6] = [
    -0.166_666_666_666_666_32,
    0.008_333_333_333_322_49,
    -0.000_198_412_698_298_579_5,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
/// Minimax coefficients of (cos r − 1 + r²/2)/r⁴ in r², on |r| ≤ π/4 (those of FDLIBM).
const COSINE: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Sines and cosines of |x| < 1e5, to 1.5 units in the last place.
///
/// x = k π/2 + r with |r| ≤ π/4 (Cody and Waite, with fused products), then polynomials in r², chosen and signed by k mod 4.
#[inline(always)]
pub(crate) fn sin_cos<const F: bool>(x: &[f64; LANES]) -> ([f64; LANES], [f64; LANES]) {
    /// Adding this to |y| < 2⁵¹ leaves y, rounded, in the last bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let shifted: [f64; LANES] = from_fn(|i| fuse::<F>(x[i], std::f64::consts::FRAC_2_PI, ROUND));
    let k: [f64; LANES] = from_fn(|i| shifted[i] - ROUND);
    let r: [f64; LANES] = from_fn(|i| fuse::<F>(-k[i], HALF_PI[0], x[i]));
    let r: [f64; LANES] = from_fn(|i| fuse::<F>(-k[i], HALF_PI[1], r[i]));
    let r: [f64; LANES] = from_fn(|i| fuse::<F>(-k[i], HALF_PI[2], r[i]));
    let z: [f64; LANES] = from_fn(|i| r[i] * r[i]);
    let polynomial = |c: &[f64; 6]| -> [f64; LANES] {
        from_fn(|i| {
            let high = fuse::<F>(z[i], fuse::<F>(z[i], c[5], c[4]), c[3]);
            fuse::<F>(
                z[i],
                fuse::<F>(z[i], fuse::<F>(z[i], high, c[2]), c[1]),
                c[0],
            )
        })
    };
    let (p, c) = (polynomial(&SINE), polynomial(&COSINE));
    let sine: [f64; LANES] = from_fn(|i| fuse::<F>(r[i] * z[i], p[i], r[i]));
    let cosine: [f64; LANES] = from_fn(|i| {
        let half = 0.5 * z[i];
        let w = 1.0 - half;
        w + fuse::<F>(z[i] * z[i], c[i], (1.0 - w) - half)
    });
    let quadrant = |i: usize| shifted[i].to_bits();
    let flip = |x: f64, by: u64| f64::from_bits(x.to_bits() ^ (by << 63));
    let sin = from_fn(|i| {
        let odd = quadrant(i) & 1 == 1;
        flip(if odd { cosine[i] } else { sine[i] }, quadrant(i) >> 1 & 1)
    });
    let cos = from_fn(|i| {
        let odd = quadrant(i) & 1 == 1;
        let negative = (quadrant(i) + 1) >> 1 & 1;
        flip(if odd { sine[i] } else { cosine[i] }, negative)
    });
    (sin, cos)
}

/// ln 2 as a sum of two numbers.
const LN_2: [f64; 2] = [std::f64::consts::LN_2, 2.319_046_813_846_299_6e-17];
/// 1/n!, from the last to 1/2!.
const FACTORIALS: [f64; 13] = [
    1.0 / 87_178_291_200.0,
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
];

/// y = k ln 2 + r with |r| ≤ ln 2/2: 2^k times the power of two `unit`, which must be a normal number; r; and r²/2! + r³/3! + ….
#[inline(always)]
fn reduced<const F: bool>(y: &[f64; LANES], unit: f64) -> [[f64; LANES]; 3] {
    /// Adding this leaves k in the last bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let shifted: [f64; LANES] = from_fn(|i| fuse::<F>(y[i], std::f64::consts::LOG2_E, ROUND));
    let k: [f64; LANES] = from_fn(|i| shifted[i] - ROUND);
    let r: [f64; LANES] = from_fn(|i| fuse::<F>(-k[i], LN_2[0], y[i]));
    let r: [f64; LANES] = from_fn(|i| fuse::<F>(-k[i], LN_2[1], r[i]));
    let scale = from_fn(|i| {
        let exponent = shifted[i].to_bits().wrapping_shl(52);
        f64::from_bits(exponent.wrapping_add(unit.to_bits()))
    });
    let mut series = [0.0; LANES];
    for factorial in FACTORIALS {
        series = from_fn(|i| fuse::<F>(series[i], r[i], factorial));
    }
    [scale, r, from_fn(|i| series[i] * (r[i] * r[i]))]
}

/// exp x, to a unit in the last place; 0 below −708. NaN stays.
#[inline(always)]
pub(crate) fn exp<const F: bool>(x: &[f64; LANES]) -> [f64; LANES] {
    const LEAST: f64 = -708.0;
    /// ln of the largest number.
    const MOST: f64 = 709.782_712_893_384;
    let y = from_fn(|i| {
        let low = if x[i] < LEAST { LEAST } else { x[i] };
        if low > MOST { MOST } else { low }
    });
    // Half of it: 2¹⁰²⁴ is no number.
    let [half, r, series] = reduced::<F>(&y, 0.5);
    from_fn(|i| {
        let exp = 2.0 * fuse::<F>(half[i], r[i] + series[i], half[i]);
        let exp = if x[i] < LEAST { 0.0 } else { exp };
        if x[i] > MOST { f64::INFINITY } else { exp }
    })
}

/// tanh x, to 2 units in the last place; NaN stays.
///
/// tanh |x| = t/(t + 2), t = exp(2|x|) − 1 = (2^k − 1) + 2^k (r + …), which is kept as a sum of two numbers, and so are the denominator and the remainder
/// of the division: only the last sum rounds.
#[inline(always)]
pub(crate) fn tanh<const F: bool>(x: &[f64; LANES]) -> [f64; LANES] {
    /// That of larger arguments rounds to 1.
    const LARGEST: f64 = 20.0;
    let y = from_fn(|i| {
        let size = x[i].abs();
        2.0 * if size > LARGEST { LARGEST } else { size }
    });
    let [scale, r, series] = reduced::<F>(&y, 1.0);
    from_fn(|i| {
        // t = high + low.
        let (whole, scaled) = (scale[i] - 1.0, scale[i] * r[i]);
        let sum = whole + scaled;
        let low = fuse::<F>(scale[i], series[i], scaled - (sum - whole));
        let high = sum + low;
        let low = low - (high - sum);
        // t + 2 = bottom + rest.
        let bottom = high + 2.0;
        let part = bottom - high;
        let rest = (high - (bottom - part)) + (2.0 - part) + low;
        let inverse = 1.0 / bottom;
        let quotient = high * inverse;
        let remainder = fuse::<F>(-quotient, bottom, high) + fuse::<F>(-quotient, rest, low);
        fuse::<F>(remainder, inverse, quotient).copysign(x[i])
    })
}
