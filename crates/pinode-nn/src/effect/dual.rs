//! Numbers with derivatives in several variables at once.

use std::ops::{Add, Div, Mul, Neg, Sub};

use lagrange::Scalar;

/// x and ∂x/∂y_k for `N` variables y.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dual<const N: usize> {
    pub re: f64,
    pub eps: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// The variable y_k; none for k ≥ N.
    pub fn variable(re: f64, k: usize) -> Self {
        let mut eps = [0.0; N];
        if let Some(own) = eps.get_mut(k) {
            *own = 1.0;
        }
        Dual { re, eps }
    }

    /// f(x) with f′(x).
    fn chain(mut self, f: f64, slope: f64) -> Self {
        self.re = f;
        for own in &mut self.eps {
            *own *= slope;
        }
        self
    }

    /// f(x, y) with its derivative from those of x and y, one after the other.
    fn join(mut self, other: Self, f: f64, derivative: impl Fn(f64, f64) -> f64) -> Self {
        self.re = f;
        for (own, other) in self.eps.iter_mut().zip(other.eps) {
            *own = derivative(*own, other);
        }
        self
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.join(other, self.re + other.re, |a, b| a + b)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.join(other, self.re - other.re, |a, b| a - b)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let (x, y) = (self.re, other.re);
        self.join(other, x * y, |a, b| a.times_plus(y, x * b))
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let (inverse, ratio) = (1.0 / other.re, self.re / other.re);
        self.join(other, ratio, |a, b| (a - ratio * b) * inverse)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.re, -1.0)
    }
}

impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;
    fn add(self, x: f64) -> Self {
        let re = self.re + x;
        Dual { re, ..self }
    }
}

impl<const N: usize> Sub<f64> for Dual<N> {
    type Output = Self;
    fn sub(self, x: f64) -> Self {
        let re = self.re - x;
        Dual { re, ..self }
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    fn mul(self, x: f64) -> Self {
        self.chain(self.re * x, x)
    }
}

impl<const N: usize> Div<f64> for Dual<N> {
    type Output = Self;
    fn div(self, x: f64) -> Self {
        self.chain(self.re / x, 1.0 / x)
    }
}

impl<const N: usize> Scalar for Dual<N> {
    fn constant(x: f64) -> Self {
        Dual {
            re: x,
            eps: [0.0; N],
        }
    }
    fn re(self) -> f64 {
        self.re.re()
    }
    fn sin(self) -> Self {
        let (sin, cos) = self.re.sin_cos();
        self.chain(sin, cos)
    }
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
        self.chain(self.re.asin(), 1.0 / slope)
    }
    fn acos(self) -> Self {
        let slope = (-self.re * self.re + 1.0).sqrt();
        self.chain(self.re.acos(), -1.0 / slope)
    }
    fn atan(self) -> Self {
        let slope = 1.0 / (self.re * self.re + 1.0);
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
    fn tanh(self) -> Self {
        let tanh = self.re.tanh();
        self.chain(tanh, -tanh * tanh + 1.0)
    }
    fn exp(self) -> Self {
        let exp = self.re.exp();
        self.chain(exp, exp)
    }
    fn ln(self) -> Self {
        self.chain(self.re.ln(), 1.0 / self.re)
    }
    fn sqrt(self) -> Self {
        let root = self.re.sqrt();
        self.chain(root, 0.5 / root)
    }
    fn powi(self, n: i32) -> Self {
        let slope = match n {
            0 => 0.0,
            n => self.re.powi(n - 1) * f64::from(n),
        };
        self.chain(self.re.powi(n), slope)
    }
    fn powf(self, n: f64) -> Self {
        self.chain(self.re.powf(n), self.re.powf(n - 1.0) * n)
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
            let own = all(Dual::<2>::variable(x, 0), Dual::variable(y, 1));
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
