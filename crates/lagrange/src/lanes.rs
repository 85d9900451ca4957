//! Numbers for the hardware: one, or eight at once.
//!
//! `FUSED` says that a·b + c is one instruction; such numbers belong into code that [`crate::processor`] has compiled for a
//! processor that has it. Without it the type is right everywhere, and slower.

use std::array::from_fn;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::Scalar;
use crate::elementary::{exp, sin_cos, tanh};

/// How many states are evaluated at once.
pub const LANES: usize = 8;

/// One number.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(transparent)]
pub struct Single<const FUSED: bool>(pub f64);

/// Eight numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Lanes<const FUSED: bool>(pub [f64; LANES]);

/// The same number eight times.
impl<const FUSED: bool> From<Single<FUSED>> for Lanes<FUSED> {
    #[inline(always)]
    fn from(x: Single<FUSED>) -> Self {
        Lanes([x.0; LANES])
    }
}

/// x · y + z.
#[inline(always)]
pub(crate) fn fuse<const FUSED: bool>(x: f64, y: f64, z: f64) -> f64 {
    if FUSED { x.mul_add(y, z) } else { x * y + z }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $symbol:tt) => {
        impl<const F: bool> $trait for Single<F> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Single(self.0 $symbol other.0)
            }
        }
        impl<const F: bool> $trait<f64> for Single<F> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                Single(self.0 $symbol other)
            }
        }
        impl<const F: bool> $trait for Lanes<F> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Lanes(from_fn(|i| self.0[i] $symbol other.0[i]))
            }
        }
        impl<const F: bool> $trait<f64> for Lanes<F> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                Lanes(from_fn(|i| self.0[i] $symbol other))
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl<const F: bool> Neg for Single<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Single(-self.0)
    }
}

impl<const F: bool> Neg for Lanes<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let mut x = self.0;
        for x in &mut x {
            *x = -*x;
        }
        Lanes(x)
    }
}

macro_rules! functions {
    ($($method:ident),*) => {
        $(
            #[inline(always)]
            fn $method(self) -> Self {
                self.each(f64::$method)
            }
        )*
    };
}

impl<const F: bool> Single<F> {
    #[inline(always)]
    fn each(self, f: impl Fn(f64) -> f64) -> Self {
        Single(f(self.0))
    }
}

impl<const F: bool> Lanes<F> {
    #[inline(always)]
    fn each(self, f: impl Fn(f64) -> f64) -> Self {
        let mut x = self.0;
        for x in &mut x {
            *x = f(*x);
        }
        Lanes(x)
    }

    /// A call of its own: inlined, a loop over eight angles or more is vectorised with both ways taken for all of them.
    #[cold]
    #[inline(never)]
    fn sin_cos_by_library(self) -> (Self, Self) {
        (self.each(f64::sin), self.each(f64::cos))
    }
}

impl<const F: bool> Scalar for Single<F> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Single(x)
    }
    #[inline(always)]
    fn re(self) -> f64 {
        self.0
    }
    functions!(
        sin, cos, tan, asin, acos, atan, sinh, cosh, tanh, exp, ln, sqrt, abs
    );
    fn atan2(self, x: Self) -> Self {
        Single(self.0.atan2(x.0))
    }
    fn powi(self, n: i32) -> Self {
        Single(self.0.powi(n))
    }
    fn powf(self, n: f64) -> Self {
        Single(self.0.powf(n))
    }
    #[inline(always)]
    fn times_plus(self, factor: Self, term: Self) -> Self {
        Single(fuse::<F>(self.0, factor.0, term.0))
    }
    #[inline(always)]
    fn sin_cos_of(angles: &[Self], sines: &mut [Self], cosines: &mut [Self]) {
        let outputs = sines.chunks_mut(LANES).zip(cosines.chunks_mut(LANES));
        for (angles, (sines, cosines)) in angles.chunks(LANES).zip(outputs) {
            let mut block = [0.0; LANES];
            for (x, angle) in block.iter_mut().zip(angles) {
                *x = angle.0;
            }
            let (sin, cos) = Lanes::<F>(block).sin_cos();
            for (to, from) in sines.iter_mut().zip(sin.0) {
                to.0 = from;
            }
            for (to, from) in cosines.iter_mut().zip(cos.0) {
                to.0 = from;
            }
        }
    }
}

impl<const F: bool> Scalar for Lanes<F> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Lanes([x; LANES])
    }
    /// The first lane's. Code that asks must not be run on lanes.
    fn re(self) -> f64 {
        self.0[0]
    }
    functions!(sin, cos, tan, asin, acos, atan, sinh, cosh, ln, sqrt, abs);
    #[inline(always)]
    fn exp(self) -> Self {
        match F {
            true => Lanes(exp::<F>(&self.0)),
            false => self.each(f64::exp),
        }
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        match F {
            true => Lanes(tanh::<F>(&self.0)),
            false => self.each(f64::tanh),
        }
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        // The reduction is exact enough below 1e5 and needs the fused product; NaN takes the other way, too.
        if F && self.0.iter().fold(true, |small, x| small & (x.abs() < 1e5)) {
            let (sin, cos) = sin_cos::<F>(&self.0);
            (Lanes(sin), Lanes(cos))
        } else {
            self.sin_cos_by_library()
        }
    }
    fn atan2(self, x: Self) -> Self {
        Lanes(from_fn(|i| self.0[i].atan2(x.0[i])))
    }
    /// By squares, as `f64::powi`.
    #[inline(always)]
    fn powi(self, n: i32) -> Self {
        let (mut square, mut power) = (self, Self::constant(1.0));
        let mut left = n.unsigned_abs();
        while left > 0 {
            if left & 1 == 1 {
                power = power * square;
            }
            square = square * square;
            left >>= 1;
        }
        if n < 0 {
            power = Self::constant(1.0) / power;
        }
        power
    }
    // The choices of `Scalar`, lane by lane.
    #[inline(always)]
    fn sign(self) -> Self {
        self.each(Scalar::sign)
    }
    fn min(self, other: Self) -> Self {
        Lanes(from_fn(|i| Scalar::min(self.0[i], other.0[i])))
    }
    fn max(self, other: Self) -> Self {
        Lanes(from_fn(|i| Scalar::max(self.0[i], other.0[i])))
    }
    fn pow(self, exponent: Self) -> Self {
        Lanes(from_fn(|i| Scalar::pow(self.0[i], exponent.0[i])))
    }
    fn powf(self, n: f64) -> Self {
        self.each(|x| x.powf(n))
    }
    #[inline(always)]
    fn inverse_above(self, floor: Self) -> Self {
        let mut out = [f64::NAN; LANES];
        for (out, (x, floor)) in out.iter_mut().zip(self.0.iter().zip(&floor.0)) {
            let inverse = 1.0 / x;
            *out = if x > floor { inverse } else { f64::NAN };
        }
        Lanes(out)
    }
    #[inline(always)]
    fn times_plus(self, factor: Self, term: Self) -> Self {
        Lanes(from_fn(|i| fuse::<F>(self.0[i], factor.0[i], term.0[i])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_of_sines_are_those_of_the_library_to_rounding() {
        let mut worst = 0.0_f64;
        for k in 0..200_000 {
            let x: [f64; LANES] = from_fn(|i| {
                let n = f64::from(k) * 8.0 + i as f64;
                match k % 4 {
                    0 => 3.0 * (n * 0.618).sin(),
                    1 => std::f64::consts::FRAC_PI_2 * n.rem_euclid(60_000.0).floor(),
                    2 => 9.9e4 * (n * 0.37).cos(),
                    _ => 1e-5 * (n * 0.11).sin(),
                }
            });
            let (sin, cos) = Lanes::<true>(x).sin_cos();
            let error = |found: f64, exact: f64| (found - exact).abs() / exact.abs().max(1e-300);
            for (x, (sin, cos)) in x.iter().zip(sin.0.into_iter().zip(cos.0)) {
                worst = worst.max(error(sin, x.sin())).max(error(cos, x.cos()));
            }
        }
        assert!(worst < 4.0 * f64::EPSILON, "{worst:e}");
    }

    #[test]
    fn lanes_of_exponentials_are_those_of_the_library_to_rounding() {
        let (mut worst, mut worst_of_tanh) = (0.0_f64, 0.0_f64);
        for k in 0..200_000 {
            let x: [f64; LANES] = from_fn(|i| {
                let n = (f64::from(k) * 8.0 + i as f64) * 0.618;
                match k % 4 {
                    0 => 3.0 * n.sin(),
                    1 => 700.0 * n.sin(),
                    2 => 1e-6 * n.sin(),
                    _ => 25.0 * n.sin(),
                }
            });
            let (exp, tanh) = (Lanes::<true>(x).exp(), Lanes::<true>(x).tanh());
            let error = |found: f64, exact: f64| (found - exact).abs() / exact.abs().max(1e-300);
            for (x, (exp, tanh)) in x.iter().zip(exp.0.into_iter().zip(tanh.0)) {
                worst = worst.max(error(exp, x.exp()));
                worst_of_tanh = worst_of_tanh.max(error(tanh, x.tanh()));
            }
        }
        assert!(worst < 2.0 * f64::EPSILON, "{worst:e}");
        assert!(worst_of_tanh < 3.0 * f64::EPSILON, "{worst_of_tanh:e}");
    }

    #[test]
    fn exponentials_of_large_numbers_and_of_no_numbers_are_those_of_the_library() {
        let x = [-1e9, -709.0, 0.0, -0.0, f64::NEG_INFINITY, 1.0, 20.0, 21.0];
        let (exp, tanh) = (Lanes::<true>(x).exp().0, Lanes::<true>(x).tanh().0);
        assert_eq!([exp[0], exp[2], exp[3], exp[4]], [0.0, 1.0, 1.0, 0.0]);
        assert!(exp[1] < 1e-300);
        assert_eq!([tanh[0], tanh[4], tanh[6], tanh[7]], [-1.0, -1.0, 1.0, 1.0]);
        assert!(tanh[2].is_sign_positive() && tanh[3].is_sign_negative() && tanh[3] == 0.0);
        let mut large = x;
        (large[4], large[5], large[6], large[7]) = (709.7, f64::NAN, f64::INFINITY, 709.8);
        let (exp, tanh) = (Lanes::<true>(large).exp().0, Lanes::<true>(large).tanh().0);
        assert!((exp[4] / 709.7_f64.exp() - 1.0).abs() < 2.0 * f64::EPSILON);
        assert!(exp[5].is_nan() && exp[6] == f64::INFINITY && exp[7] == f64::INFINITY);
        assert!(tanh[5].is_nan() && tanh[6] == 1.0 && tanh[7] == 1.0);
    }

    #[test]
    fn angles_that_are_large_or_no_numbers_take_the_library_way() {
        let mut x = [0.5; LANES];
        (x[3], x[5]) = (1e9, f64::NAN);
        let (sin, cos) = Lanes::<true>(x).sin_cos();
        assert_eq!((sin.0[3], cos.0[3]), (1e9_f64.sin(), 1e9_f64.cos()));
        assert!(sin.0[5].is_nan() && cos.0[5].is_nan());
        assert_eq!(sin.0[0], 0.5_f64.sin());
    }
}
