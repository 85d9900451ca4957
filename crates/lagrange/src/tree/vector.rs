//! Vectors of three and of six, on any scalar.

use crate::Scalar;

pub type Vector<D> = [D; 3];

/// Three columns.
pub type Matrix<D> = [Vector<D>; 3];

/// A motion: angular velocity and velocity of the body-fixed point at the common origin; or a wrench: moment about the common
/// origin and force.
#[derive(Debug, Clone, Copy)]
pub struct Spatial<D> {
    /// Angular velocity, or moment.
    pub angular: Vector<D>,
    /// Velocity at the origin, or force.
    pub linear: Vector<D>,
}

#[inline(always)]
pub fn zero<D: Scalar>() -> Vector<D> {
    [D::zero(); 3]
}

#[inline(always)]
pub fn constant<D: Scalar>(x: &[f64; 3]) -> Vector<D> {
    // An array, and no closure for `map`, which may be compiled without the instructions that `dispatch` has chosen.
    [D::constant(x[0]), D::constant(x[1]), D::constant(x[2])]
}

/// The matrix with these columns.
#[inline(always)]
pub fn constant_columns<D: Scalar>(x: &[[f64; 3]; 3]) -> Matrix<D> {
    [constant(&x[0]), constant(&x[1]), constant(&x[2])]
}

#[inline(always)]
pub fn add<D: Scalar>(a: &Vector<D>, b: &Vector<D>) -> Vector<D> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub fn subtract<D: Scalar>(a: &Vector<D>, b: &Vector<D>) -> Vector<D> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub fn negate<D: Scalar>(a: &Vector<D>) -> Vector<D> {
    [-a[0], -a[1], -a[2]]
}

#[inline(always)]
pub fn scale<D: Scalar>(a: &Vector<D>, s: D) -> Vector<D> {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// a s + c.
#[inline(always)]
pub fn scale_add<D: Scalar>(a: &Vector<D>, s: D, c: &Vector<D>) -> Vector<D> {
    [
        a[0].times_plus(s, c[0]),
        a[1].times_plus(s, c[1]),
        a[2].times_plus(s, c[2]),
    ]
}

/// a · b.
#[inline(always)]
pub fn dot<D: Scalar>(a: &Vector<D>, b: &Vector<D>) -> D {
    a[0].times_plus(b[0], a[1].times_plus(b[1], a[2] * b[2]))
}

/// a · b + c.
#[inline(always)]
pub fn dot_add<D: Scalar>(a: &Vector<D>, b: &Vector<D>, c: D) -> D {
    a[0].times_plus(b[0], a[1].times_plus(b[1], a[2].times_plus(b[2], c)))
}

/// a × b.
#[inline(always)]
pub fn cross<D: Scalar>(a: &Vector<D>, b: &Vector<D>) -> Vector<D> {
    [
        a[1].times_plus(b[2], -(a[2] * b[1])),
        a[2].times_plus(b[0], -(a[0] * b[2])),
        a[0].times_plus(b[1], -(a[1] * b[0])),
    ]
}

/// a × b + c.
#[inline(always)]
pub fn cross_add<D: Scalar>(a: &Vector<D>, b: &Vector<D>, c: &Vector<D>) -> Vector<D> {
    [
        a[1].times_plus(b[2], (-a[2]).times_plus(b[1], c[0])),
        a[2].times_plus(b[0], (-a[0]).times_plus(b[2], c[1])),
        a[0].times_plus(b[1], (-a[1]).times_plus(b[0], c[2])),
    ]
}

/// R x, for the matrix with these columns.
#[inline(always)]
pub fn times<D: Scalar>(r: &Matrix<D>, x: &Vector<D>) -> Vector<D> {
    scale_add(&r[0], x[0], &scale_add(&r[1], x[1], &scale(&r[2], x[2])))
}

/// R x + c.
#[inline(always)]
pub fn times_add<D: Scalar>(r: &Matrix<D>, x: &Vector<D>, c: &Vector<D>) -> Vector<D> {
    let sum = scale_add(&r[1], x[1], &scale_add(&r[2], x[2], c));
    scale_add(&r[0], x[0], &sum)
}

/// Rᵀ x.
#[inline(always)]
pub fn transposed_times<D: Scalar>(r: &Matrix<D>, x: &Vector<D>) -> Vector<D> {
    [dot(&r[0], x), dot(&r[1], x), dot(&r[2], x)]
}

/// A B.
#[inline(always)]
pub fn product<D: Scalar>(a: &Matrix<D>, b: &Matrix<D>) -> Matrix<D> {
    [times(a, &b[0]), times(a, &b[1]), times(a, &b[2])]
}

impl<D: Scalar> Spatial<D> {
    #[inline(always)]
    pub fn zero() -> Self {
        Spatial {
            angular: zero(),
            linear: zero(),
        }
    }

    #[inline(always)]
    pub fn plus(&self, other: &Self) -> Self {
        Spatial {
            angular: add(&self.angular, &other.angular),
            linear: add(&self.linear, &other.linear),
        }
    }

    /// self s + other.
    #[inline(always)]
    pub fn scaled_plus(&self, s: D, other: &Self) -> Self {
        Spatial {
            angular: scale_add(&self.angular, s, &other.angular),
            linear: scale_add(&self.linear, s, &other.linear),
        }
    }

    #[inline(always)]
    pub fn times(&self, s: D) -> Self {
        Spatial {
            angular: scale(&self.angular, s),
            linear: scale(&self.linear, s),
        }
    }

    /// Power of a wrench on a motion.
    #[inline(always)]
    pub fn dot(&self, other: &Self) -> D {
        dot_add(
            &self.angular,
            &other.angular,
            dot(&self.linear, &other.linear),
        )
    }

    /// The rate of the motion `s` that is carried along by this motion: (ω × s_ω, ω × s_v + u × s_ω).
    #[inline(always)]
    pub fn cross(&self, s: &Self) -> Self {
        Spatial {
            angular: cross(&self.angular, &s.angular),
            linear: cross_add(&self.angular, &s.linear, &cross(&self.linear, &s.angular)),
        }
    }

    /// The rate of the wrench `f` that is carried along by this motion: (ω × n + u × f, ω × f).
    #[inline(always)]
    pub fn cross_wrench(&self, f: &Self) -> Self {
        Spatial {
            angular: cross_add(&self.angular, &f.angular, &cross(&self.linear, &f.linear)),
            linear: cross(&self.angular, &f.linear),
        }
    }
}
