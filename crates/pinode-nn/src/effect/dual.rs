//! Numbers with derivatives in several variables at once, over any [`Scalar`]: of eight states at once, over lanes.

use std::array::from_fn;
use std::ops::{Add, Div, Mul, Neg, Sub};

use lagrange::Scalar;

/// x and ∂x/∂y_k for `N` variables y.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dual<T, const N: usize> {
    pub re: T,
    pub eps: [T; N],
}

impl<T: Scalar, const N: usize> Dual<T, N> {
    /// The variable y_k; none for k ≥ N.
    #[inline(always)]
    pub fn variable(re: T, k: usize) -> Self {
        let mut eps = [T::zero(); N];
        if let Some(own) = eps.get_mut(k) {
            *own = T::constant(1.0);
        }
        Dual { re, eps }
    }

    /// f(x) with f′(x).
    #[inline(always)]
    fn chain(self, f: T, slope: T) -> Self {
        Dual {
            re: f,
            eps: from_fn(|k| self.eps[k] * slope),
        }
    }
}

impl<T: Scalar, const N: usize> Add for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Dual {
            re: self.re + other.re,
            eps: from_fn(|k| self.eps[k] + other.eps[k]),
        }
    }
}

impl<T: Scalar, const N: usize> Sub for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Dual {
            re: self.re - other.re,
            eps: from_fn(|k| self.eps[k] - other.eps[k]),
        }
    }
}

impl<T: Scalar, const N: usize> Mul for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Dual {
            re: self.re * other.re,
            eps: from_fn(|k| self.eps[k].times_plus(other.re, self.re * other.eps[k])),
        }
    }
}

impl<T: Scalar, const N: usize> Div for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let (inverse, re) = (T::constant(1.0) / other.re, self.re / other.re);
        Dual {
            re,
            eps: from_fn(|k| (-re).times_plus(other.eps[k], self.eps[k]) * inverse),
        }
    }
}

impl<T: Scalar, const N: usize> Neg for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Dual {
            re: -self.re,
            eps: from_fn(|k| -self.eps[k]),
        }
    }
}

impl<T: Scalar, const N: usize> Add<f64> for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, x: f64) -> Self {
        let re = self.re + x;
        Dual { re, ..self }
    }
}

impl<T: Scalar, const N: usize> Sub<f64> for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, x: f64) -> Self {
        let re = self.re - x;
        Dual { re, ..self }
    }
}

impl<T: Scalar, const N: usize> Mul<f64> for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, x: f64) -> Self {
        self.chain(self.re * x, T::constant(x))
    }
}

impl<T: Scalar, const N: usize> Div<f64> for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, x: f64) -> Self {
        self.chain(self.re / x, T::constant(1.0 / x))
    }
}

impl<T: Scalar, const N: usize> Scalar for Dual<T, N> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Dual {
            re: T::constant(x),
            eps: [T::zero(); N],
        }
    }
    fn re(self) -> f64 {
        self.re.re()
    }
    #[inline(always)]
    fn sin(self) -> Self {
        let (sin, cos) = self.re.sin_cos();
        self.chain(sin, cos)
    }
    #[inline(always)]
    fn cos(self) -> Self {
        let (sin, cos) = self.re.sin_cos();
        self.chain(cos, -sin)
    }
    fn tan(self) -> Self {
        let tan = self.re.tan();
        self.chain(tan, tan * tan + 1.0)
    }
    fn asin(self) -> Self {
        let slope = (-self.re * self.re + 1.0).sqrt();
        self.chain(self.re.asin(), T::constant(1.0) / slope)
    }
    fn acos(self) -> Self {
        let slope = (-self.re * self.re + 1.0).sqrt();
        self.chain(self.re.acos(), T::constant(-1.0) / slope)
    }
    fn atan(self) -> Self {
        let slope = T::constant(1.0) / (self.re * self.re + 1.0);
        self.chain(self.re.atan(), slope)
    }
    fn atan2(self, x: Self) -> Self {
        let square = self.re * self.re + x.re * x.re;
        Dual {
            re: self.re.atan2(x.re),
            eps: from_fn(|k| (self.eps[k] * x.re - self.re * x.eps[k]) / square),
        }
    }
    fn sinh(self) -> Self {
        self.chain(self.re.sinh(), self.re.cosh())
    }
    fn cosh(self) -> Self {
        self.chain(self.re.cosh(), self.re.sinh())
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        let tanh = self.re.tanh();
        self.chain(tanh, -tanh * tanh + 1.0)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let exp = self.re.exp();
        self.chain(exp, exp)
    }
    fn ln(self) -> Self {
        self.chain(self.re.ln(), T::constant(1.0) / self.re)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.re.sqrt();
        self.chain(root, T::constant(0.5) / root)
    }
    fn powi(self, n: i32) -> Self {
        let slope = self.re.powi(n - 1) * f64::from(n);
        self.chain(self.re.powi(n), slope)
    }
    fn powf(self, n: f64) -> Self {
        self.chain(self.re.powf(n), self.re.powf(n - 1.0) * n)
    }
    // The choices of `Scalar`, state by state.
    #[inline(always)]
    fn abs(self) -> Self {
        self * self.sign()
    }
    #[inline(always)]
    fn sign(self) -> Self {
        let re = self.re.sign();
        Dual { re, ..Self::zero() }
    }
}
