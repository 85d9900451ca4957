//! Numbers with derivatives in several variables at once, over any [`Scalar`]: of eight states at once, over lanes.

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
    fn chain(mut self, f: T, slope: T) -> Self {
        self.re = f;
        for own in &mut self.eps {
            *own = *own * slope;
        }
        self
    }

    /// f(x, y) with its derivative from those of x and y, one after the other. Loops are inlined where `from_fn` is not.
    #[inline(always)]
    fn join(mut self, other: Self, f: T, derivative: impl Fn(T, T) -> T) -> Self {
        self.re = f;
        for (own, other) in self.eps.iter_mut().zip(other.eps) {
            *own = derivative(*own, other);
        }
        self
    }
}

impl<T: Scalar, const N: usize> Add for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.join(other, self.re + other.re, |a, b| a + b)
    }
}

impl<T: Scalar, const N: usize> Sub for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.join(other, self.re - other.re, |a, b| a - b)
    }
}

impl<T: Scalar, const N: usize> Mul for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let (x, y) = (self.re, other.re);
        self.join(other, x * y, |a, b| a.times_plus(y, x * b))
    }
}

impl<T: Scalar, const N: usize> Div for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let (inverse, ratio) = (T::constant(1.0) / other.re, self.re / other.re);
        self.join(other, ratio, |a, b| (a - ratio * b) * inverse)
    }
}

impl<T: Scalar, const N: usize> Neg for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.re, T::constant(-1.0))
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
        let (b, a) = (self.re, x.re);
        let square = b * b + a * a;
        self.join(x, b.atan2(a), |db, da| (db * a - b * da) / square)
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
        let slope = match n {
            0 => T::zero(),
            n => self.re.powi(n - 1) * f64::from(n),
        };
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

#[cfg(test)]
mod tests {
    use super::*;
    use num_dual::DualSVec64;

    /// Every operation and function of [`Scalar`], of x and y in (0, 1).
    fn all<D: Scalar>(x: D, y: D) -> Vec<D> {
        vec![
            x + y,
            x - y,
            x * y,
            x / y,
            -x,
            x + 2.0,
            x - 2.0,
            x * 3.0,
            x / 3.0,
            x.sin(),
            x.cos(),
            x.tan(),
            x.asin(),
            x.acos(),
            x.atan(),
            x.atan2(y),
            x.sinh(),
            x.cosh(),
            x.tanh(),
            x.exp(),
            x.ln(),
            x.sqrt(),
            x.powi(3),
            x.powi(-2),
            x.powf(1.7),
            x.abs(),
            (-x).abs(),
            (-x).sign(),
            x.min(y),
            x.max(y),
            x.pow(y),
        ]
    }

    #[test]
    fn derivatives_are_those_of_num_dual() {
        for (x, y) in [(0.3, 0.8), (0.9, 0.2)] {
            let own = all(Dual::<f64, 2>::variable(x, 0), Dual::variable(y, 1));
            let variable = |x, k| DualSVec64::<2>::from_re(x).derivative(k);
            let other = all(variable(x, 0), variable(y, 1));
            for (k, (own, other)) in own.iter().zip(&other).enumerate() {
                let by: [f64; 2] = other.eps.0.map_or([0.0; 2], Into::into);
                let pairs = [(own.re, other.re), (own.eps[0], by[0]), (own.eps[1], by[1])];
                for (own, other) in pairs {
                    assert!((own - other).abs() < 1e-14 * (1.0 + other.abs()), "{k}");
                }
            }
        }
    }
}
