//! The number type that energies are written over.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

use num_dual::{DualNum, DualStruct};

/// A real number, plain or carrying derivatives.
///
/// Energies written over `Scalar` can be evaluated on `f64`, on every dual number of `num-dual` (also nested), and so be
/// differentiated exactly. Comparisons are made on [`re`](Scalar::re): a branch is differentiated as taken.
///
/// `sqrt` at 0 and `abs` at 0 have no derivative; smooth them where the mechanism can reach that point.
///
/// ```
/// use lagrange::Scalar;
/// use num_dual::Dual64;
///
/// fn height<D: Scalar>(angle: D) -> D {
///     angle.cos() * 0.5
/// }
/// assert_eq!(height(0.0), 0.5);
/// let slope = height(Dual64::new(1.0, 1.0)).eps;
/// assert!((slope + 0.5 * 1.0_f64.sin()).abs() < 1e-15);
/// ```
pub trait Scalar:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// The constant `x`, with no derivative.
    fn constant(x: f64) -> Self;
    /// The value without its derivatives.
    fn re(self) -> f64;
    /// Sine.
    fn sin(self) -> Self;
    /// Cosine.
    fn cos(self) -> Self;
    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
    }
    /// Tangent.
    fn tan(self) -> Self;
    /// Arc sine.
    fn asin(self) -> Self;
    /// Arc cosine.
    fn acos(self) -> Self;
    /// Arc tangent.
    fn atan(self) -> Self;
    /// The angle of the point (`x`, `self`), in (−π, π].
    fn atan2(self, x: Self) -> Self;
    /// Hyperbolic sine.
    fn sinh(self) -> Self;
    /// Hyperbolic cosine.
    fn cosh(self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
    /// e to the power of `self`.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Integer power.
    fn powi(self, n: i32) -> Self;
    /// Real, constant power.
    fn powf(self, n: f64) -> Self;

    /// `self` · `factor` + `term`; one instruction with one rounding on types that have it.
    #[inline(always)]
    fn times_plus(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }
    /// 1 / `self` where `self` is above `floor`, else NaN.
    #[inline(always)]
    fn inverse_above(self, floor: Self) -> Self {
        if self.re() > floor.re() {
            Self::constant(1.0) / self
        } else {
            Self::constant(f64::NAN)
        }
    }
    /// Sines and cosines of many angles.
    #[inline(always)]
    fn sin_cos_of(angles: &[Self], sines: &mut [Self], cosines: &mut [Self]) {
        for ((&angle, sin), cos) in angles.iter().zip(sines).zip(cosines) {
            (*sin, *cos) = angle.sin_cos();
        }
    }

    /// Zero.
    fn zero() -> Self {
        Self::constant(0.0)
    }
    /// Absolute value; its derivative at 0 is that of the branch `self ≥ 0`.
    fn abs(self) -> Self {
        if self.re() < 0.0 { -self } else { self }
    }
    /// −1 below zero, else 1; flat.
    fn sign(self) -> Self {
        Self::constant(if self.re() < 0.0 { -1.0 } else { 1.0 })
    }
    /// The smaller one, `self` where they are equal; NaN on either side wins. Differentiated as chosen.
    fn min(self, other: Self) -> Self {
        let (a, b) = (self.re(), other.re());
        if a <= b || a.is_nan() { self } else { other }
    }
    /// The larger one, `self` where they are equal; NaN on either side wins. Differentiated as chosen.
    fn max(self, other: Self) -> Self {
        let (a, b) = (self.re(), other.re());
        if a >= b || a.is_nan() { self } else { other }
    }
    /// `self` to the power of `exponent`, exp(b ln a). At `self` ≤ 0 it has no derivative along the exponent, which is taken as a
    /// constant there.
    fn pow(self, exponent: Self) -> Self {
        if self.re() > 0.0 {
            return (exponent * self.ln()).exp();
        }
        let b = exponent.re();
        if b.fract() == 0.0 && b.abs() <= 1000.0 {
            self.powi(b as i32)
        } else {
            self.powf(b)
        }
    }
}

impl<T: DualNum<Primitive = f64> + Copy + Send + Sync> Scalar for T {
    fn constant(x: f64) -> Self {
        T::from(x)
    }
    fn re(self) -> f64 {
        DualStruct::re(&self)
    }
    fn sin(self) -> Self {
        DualNum::sin(&self)
    }
    fn cos(self) -> Self {
        DualNum::cos(&self)
    }
    fn sin_cos(self) -> (Self, Self) {
        DualNum::sin_cos(&self)
    }
    fn tan(self) -> Self {
        DualNum::tan(&self)
    }
    fn asin(self) -> Self {
        DualNum::asin(&self)
    }
    fn acos(self) -> Self {
        DualNum::acos(&self)
    }
    fn atan(self) -> Self {
        DualNum::atan(&self)
    }
    fn atan2(self, x: Self) -> Self {
        DualNum::atan2(&self, x)
    }
    fn sinh(self) -> Self {
        DualNum::sinh(&self)
    }
    fn cosh(self) -> Self {
        DualNum::cosh(&self)
    }
    fn tanh(self) -> Self {
        // num-dual divides sinh by cosh, which is NaN once both overflow; beyond 20 the slope is below rounding.
        let re = DualStruct::re(&self);
        if re.abs() > 20.0 {
            T::from(re.signum())
        } else {
            DualNum::tanh(&self)
        }
    }
    fn exp(self) -> Self {
        DualNum::exp(&self)
    }
    fn ln(self) -> Self {
        DualNum::ln(&self)
    }
    fn sqrt(self) -> Self {
        DualNum::sqrt(&self)
    }
    fn powi(self, n: i32) -> Self {
        DualNum::powi(&self, n)
    }
    fn powf(self, n: f64) -> Self {
        DualNum::powf(&self, n)
    }
}

#[cfg(test)]
mod tests {
    use super::Scalar;
    use num_dual::Dual64;

    #[test]
    fn tanh_of_a_large_dual_is_flat_and_not_nan() {
        for x in [-1e4, -720.0, 720.0, 1e4] {
            let y = Scalar::tanh(Dual64::new(x, 1.0));
            assert_eq!((y.re, y.eps), (x.signum(), 0.0));
        }
        let below = Scalar::tanh(Dual64::new(19.99, 1.0));
        let above = Scalar::tanh(Dual64::new(20.01, 1.0));
        assert!((below.re - above.re).abs() < 1e-15 && (below.eps - above.eps).abs() < 1e-15);
    }
}
