//! What the kernels need of f32 and f64, one at a time and by vectors.

use std::fmt::{Debug, Display, LowerExp};

use pulp::{Simd, bytemuck};

use super::tape::{PANEL, Row};

/// f32 or f64.
pub trait Real:
    Vectors
    + Copy
    + Default
    + PartialEq
    + PartialOrd
    + Debug
    + Display
    + LowerExp
    + Send
    + Sync
    + 'static
{
    /// The nearest number.
    fn from_f64(x: f64) -> Self;
    /// The same number.
    fn to_f64(self) -> f64;
}

/// Constants of the hyperbolic tangent, see [`super::tanh`].
pub struct TanhConstants<T: 'static> {
    /// tanh of larger arguments rounds to 1.
    pub limit: T,
    /// 1/ln 2.
    pub inverse_ln2: T,
    /// ln 2 as a sum.
    pub ln2: [T; 2],
    /// Adding this to a small k leaves round(k) in the last bits.
    pub round: T,
    /// 1/n!, from the last to 1/2!.
    pub factorials: &'static [T],
}

/// Vectors of numbers on the processor `S`; `V` stands for `Self::Vector<S>`.
///
/// It cannot be named outside of this module: there is no other implementation.
pub trait Vectors: Sized + 'static {
    /// As many numbers as a register holds.
    type Vector<S: Simd>: Copy;

    /// Constants of the hyperbolic tangent.
    const TANH: TanhConstants<Self>;

    /// How many numbers a vector has: a power of two, not more than 16.
    fn lanes<S: Simd>() -> usize;
    /// The whole vectors of `x`, and what is left.
    fn split<S: Simd>(x: &[Self]) -> (&[Self::Vector<S>], &[Self]);
    /// The whole vectors of `x`, and what is left.
    fn split_mut<S: Simd>(x: &mut [Self]) -> (&mut [Self::Vector<S>], &mut [Self]);
    /// The numbers of a vector.
    fn numbers<S: Simd>(x: &Self::Vector<S>) -> &[Self];
    /// x in all lanes.
    fn splat<S: Simd>(s: S, x: Self) -> Self::Vector<S>;
    /// a + b.
    fn add<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// a − b.
    fn sub<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// a · b.
    fn mul<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// a / b.
    fn div<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// √x.
    fn sqrt<S: Simd>(s: S, x: Self::Vector<S>) -> Self::Vector<S>;
    /// a · b + c, rounded once where the processor has an instruction for it, and else twice.
    fn mul_add<S: Simd>(
        s: S,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
        c: Self::Vector<S>,
    ) -> Self::Vector<S>;
    /// a · b + c, rounded once, however long that takes.
    fn fused<S: Simd>(
        s: S,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
        c: Self::Vector<S>,
    ) -> Self::Vector<S>;
    /// start + the sum of the lanes.
    fn sum<S: Simd>(s: S, x: Self::Vector<S>, start: Self) -> Self;
    /// x where it is not below 0, NaN among it; else 0.
    fn positive_part<S: Simd>(s: S, x: Self::Vector<S>) -> Self::Vector<S>;
    /// x where y > 0, else 0.
    fn where_positive<S: Simd>(s: S, y: Self::Vector<S>, x: Self::Vector<S>) -> Self::Vector<S>;
    /// `limit` where x is above it, else x, NaN among it.
    fn at_most<S: Simd>(s: S, x: Self::Vector<S>, limit: Self::Vector<S>) -> Self::Vector<S>;
    /// |x|, and −0 or 0 of the sign of x.
    fn magnitude_and_sign<S: Simd>(s: S, x: Self::Vector<S>) -> [Self::Vector<S>; 2];
    /// Magnitude and sign put together again.
    fn with_sign<S: Simd>(
        s: S,
        magnitude: Self::Vector<S>,
        sign: Self::Vector<S>,
    ) -> Self::Vector<S>;
    /// 2^k, 0 ≤ k < 64, from k + [`TanhConstants::round`].
    fn power_of_two<S: Simd>(s: S, shifted: Self::Vector<S>) -> Self::Vector<S>;
}

/// The vectors of a row.
#[inline(always)]
pub(super) fn row<T: Vectors, S: Simd>(row: &Row<T>) -> &[T::Vector<S>] {
    T::split::<S>(&row.0).0
}

/// The vectors of a row.
#[inline(always)]
pub(super) fn row_mut<T: Vectors, S: Simd>(row: &mut Row<T>) -> &mut [T::Vector<S>] {
    T::split_mut::<S>(&mut row.0).0
}

/// How many vectors a row has.
#[inline(always)]
pub(super) fn vectors<T: Vectors, S: Simd>() -> usize {
    PANEL / T::lanes::<S>()
}

macro_rules! real {
    ($float:ident, $bits:ident, $vector:ident, $lanes:ident, $split:ident, $split_mut:ident, $splat:ident,
     $add:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident, $mul_add:ident, $fused:ident, $reduce:ident, $select:ident, $greater:ident, $less:ident, $max:ident,
     $and:ident, $or:ident, $xor:ident, $tanh:expr) => {
        impl Real for $float {
            #[inline(always)]
            #[allow(clippy::cast_possible_truncation)]
            fn from_f64(x: f64) -> Self {
                x as $float
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
        }

        impl Vectors for $float {
            type Vector<S: Simd> = S::$vector;

            const TANH: TanhConstants<$float> = $tanh;

            #[inline(always)]
            fn lanes<S: Simd>() -> usize {
                S::$lanes
            }
            #[inline(always)]
            fn split<S: Simd>(x: &[$float]) -> (&[S::$vector], &[$float]) {
                S::$split(x)
            }
            #[inline(always)]
            fn split_mut<S: Simd>(x: &mut [$float]) -> (&mut [S::$vector], &mut [$float]) {
                S::$split_mut(x)
            }
            #[inline(always)]
            fn numbers<S: Simd>(x: &S::$vector) -> &[$float] {
                bytemuck::cast_slice(std::slice::from_ref(x))
            }
            #[inline(always)]
            fn splat<S: Simd>(s: S, x: $float) -> S::$vector {
                s.$splat(x)
            }
            #[inline(always)]
            fn add<S: Simd>(s: S, a: S::$vector, b: S::$vector) -> S::$vector {
                s.$add(a, b)
            }
            #[inline(always)]
            fn sub<S: Simd>(s: S, a: S::$vector, b: S::$vector) -> S::$vector {
                s.$sub(a, b)
            }
            #[inline(always)]
            fn mul<S: Simd>(s: S, a: S::$vector, b: S::$vector) -> S::$vector {
                s.$mul(a, b)
            }
            #[inline(always)]
            fn div<S: Simd>(s: S, a: S::$vector, b: S::$vector) -> S::$vector {
                s.$div(a, b)
            }
            #[inline(always)]
            fn sqrt<S: Simd>(s: S, x: S::$vector) -> S::$vector {
                s.$sqrt(x)
            }
            #[inline(always)]
            fn mul_add<S: Simd>(s: S, a: S::$vector, b: S::$vector, c: S::$vector) -> S::$vector {
                s.$mul_add(a, b, c)
            }
            #[inline(always)]
            fn fused<S: Simd>(s: S, a: S::$vector, b: S::$vector, c: S::$vector) -> S::$vector {
                s.$fused(a, b, c)
            }
            #[inline(always)]
            fn sum<S: Simd>(s: S, x: S::$vector, start: $float) -> $float {
                start + s.$reduce(x)
            }
            #[inline(always)]
            fn positive_part<S: Simd>(s: S, x: S::$vector) -> S::$vector {
                let zero = s.$splat(0.0);
                match S::IS_SCALAR {
                    true => s.$select(s.$less(x, zero), zero, x),
                    // Where one is NaN, the instructions give the second, or NaN.
                    false => s.$max(zero, x),
                }
            }
            #[inline(always)]
            fn where_positive<S: Simd>(s: S, y: S::$vector, x: S::$vector) -> S::$vector {
                let zero = s.$splat(0.0);
                s.$select(s.$greater(y, zero), x, zero)
            }
            #[inline(always)]
            fn at_most<S: Simd>(s: S, x: S::$vector, limit: S::$vector) -> S::$vector {
                s.$select(s.$greater(x, limit), limit, x)
            }
            #[inline(always)]
            fn magnitude_and_sign<S: Simd>(s: S, x: S::$vector) -> [S::$vector; 2] {
                let sign = s.$and(x, s.$splat(-0.0));
                [s.$xor(x, sign), sign]
            }
            #[inline(always)]
            fn with_sign<S: Simd>(s: S, magnitude: S::$vector, sign: S::$vector) -> S::$vector {
                s.$or(magnitude, sign)
            }
            #[inline(always)]
            fn power_of_two<S: Simd>(_: S, shifted: S::$vector) -> S::$vector {
                let mut power = shifted;
                let bits: &mut [$bits] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut power));
                for b in bits {
                    *b = (*b << ($float::MANTISSA_DIGITS - 1))
                        .wrapping_add((1.0 as $float).to_bits());
                }
                power
            }
        }
    };
}

real!(
    f32,
    u32,
    f32s,
    F32_LANES,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    div_f32s,
    sqrt_f32s,
    mul_add_e_f32s,
    mul_add_f32s,
    reduce_sum_f32s,
    select_f32s,
    greater_than_f32s,
    less_than_f32s,
    max_f32s,
    and_f32s,
    or_f32s,
    xor_f32s,
    TanhConstants {
        limit: 10.0,
        inverse_ln2: std::f32::consts::LOG2_E,
        ln2: [std::f32::consts::LN_2, -1.904_654_3e-9],
        round: 12_582_912.0,
        factorials: &[
            1.0 / 40_320.0,
            1.0 / 5_040.0,
            1.0 / 720.0,
            1.0 / 120.0,
            1.0 / 24.0,
            1.0 / 6.0,
            0.5,
        ],
    }
);
real!(
    f64,
    u64,
    f64s,
    F64_LANES,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    div_f64s,
    sqrt_f64s,
    mul_add_e_f64s,
    mul_add_f64s,
    reduce_sum_f64s,
    select_f64s,
    greater_than_f64s,
    less_than_f64s,
    max_f64s,
    and_f64s,
    or_f64s,
    xor_f64s,
    TanhConstants {
        limit: 20.0,
        inverse_ln2: std::f64::consts::LOG2_E,
        ln2: [std::f64::consts::LN_2, 2.319_046_813_846_299_6e-17],
        round: 6_755_399_441_055_744.0,
        factorials: &[
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
        ],
    }
);
