//! The hyperbolic tangent, by vectors.

use pulp::{Simd, WithSimd};

use super::real::Real;
use crate::processor::Processor;

/// x ← tanh x of every number, to 2 units in the last place; ±0, ±∞ and NaN as by the standard library. The derivative is 1 − tanh² x.
pub fn tanh<T: Real>(x: &mut [T]) {
    Processor::here().run(InPlace { x });
}

struct InPlace<'a, T> {
    x: &'a mut [T],
}

impl<T: Real> WithSimd for InPlace<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let (whole, rest) = T::split_mut::<S>(self.x);
        for x in whole {
            *x = tanh_of::<T, S>(s, *x);
        }
        for x in rest {
            let y = tanh_of::<T, S>(s, T::splat(s, *x));
            if let Some(y) = T::numbers::<S>(&y).first() {
                *x = *y;
            }
        }
    }
}

/// tanh x, without a branch.
///
/// tanh |x| = t/(t + 2), t = exp(2|x|) − 1. With 2|x| = k ln 2 + r, |r| ≤ ln 2/2, t = (2^k − 1) + 2^k (r + (r²/2! + r³/3! + …)), which
/// is kept as a sum of two numbers, and so are the denominator and the remainder of the division: only the last sum rounds.
#[inline(always)]
pub(super) fn tanh_of<T: Real, S: Simd>(s: S, x: T::Vector<S>) -> T::Vector<S> {
    let number = |x: T| T::splat(s, x);
    let negative = |x| T::sub(s, T::splat(s, T::from_f64(0.0)), x);
    let (one, two) = (number(T::from_f64(1.0)), number(T::from_f64(2.0)));
    let c = T::TANH;
    let [magnitude, sign] = T::magnitude_and_sign(s, x);
    let y = T::at_most(s, magnitude, number(c.limit));
    let y = T::add(s, y, y);
    let round = number(c.round);
    let shifted = T::fused(s, y, number(c.inverse_ln2), round);
    let k = negative(T::sub(s, shifted, round));
    let r = T::fused(s, k, number(c.ln2[0]), y);
    let r = T::fused(s, k, number(c.ln2[1]), r);
    let scale = T::power_of_two(s, shifted);
    let mut series = number(T::from_f64(0.0));
    for &factorial in c.factorials {
        series = T::fused(s, series, r, number(factorial));
    }
    let series = T::mul(s, series, T::mul(s, r, r));
    // t = high + low.
    let whole = T::sub(s, scale, one);
    let scaled = T::mul(s, scale, r);
    let sum = T::add(s, whole, scaled);
    let lost = T::sub(s, scaled, T::sub(s, sum, whole));
    let low = T::fused(s, scale, series, lost);
    let high = T::add(s, sum, low);
    let low = T::sub(s, low, T::sub(s, high, sum));
    // t + 2 = bottom + rest.
    let bottom = T::add(s, high, two);
    let part = T::sub(s, bottom, high);
    let lost = T::add(
        s,
        T::sub(s, high, T::sub(s, bottom, part)),
        T::sub(s, two, part),
    );
    let rest = T::add(s, lost, low);
    let inverse = T::div(s, one, bottom);
    let quotient = T::mul(s, high, inverse);
    let minus = negative(quotient);
    let remainder = T::fused(s, minus, bottom, high);
    let remainder = T::add(s, remainder, T::fused(s, minus, rest, low));
    let tanh = T::fused(s, remainder, inverse, quotient);
    T::with_sign(s, tanh, sign)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sum of two numbers, the second below the rounding of the first: about 104 bits.
    #[derive(Clone, Copy)]
    struct Double(f64, f64);

    impl Double {
        /// a + b, exactly.
        fn sum(a: f64, b: f64) -> Double {
            let sum = a + b;
            let part = sum - a;
            Double(sum, (a - (sum - part)) + (b - part))
        }

        fn add(self, other: Double) -> Double {
            let Double(high, low) = Double::sum(self.0, other.0);
            Double::sum(high, low + (self.1 + other.1))
        }

        fn mul(self, other: Double) -> Double {
            let product = self.0 * other.0;
            let rest = self.0.mul_add(other.0, -product);
            Double::sum(product, rest + (self.0 * other.1 + self.1 * other.0))
        }

        fn div(self, other: Double) -> Double {
            let first = self.0 / other.0;
            let rest = self.add(other.mul(Double(-first, 0.0)));
            let second = rest.0 / other.0;
            let rest = rest.add(other.mul(Double(-second, 0.0)));
            Double::sum(first, second).add(Double(rest.0 / other.0, 0.0))
        }
    }

    /// tanh x to some 2⁻⁹⁵, 1e-290 < x < 30: exp − 1 of 2x/2ⁿ by its series, n times e ← e (e + 2), and e/(e + 2).
    fn exact(x: f64) -> Double {
        let mut halvings = 0;
        let mut y = 2.0 * x;
        while y > 0.05 {
            (y, halvings) = (y / 2.0, halvings + 1);
        }
        let y = Double(y, 0.0);
        let one = Double(1.0, 0.0);
        let mut series = one;
        for n in (2..=24).rev() {
            series = one.add(y.mul(series).div(Double(f64::from(n), 0.0)));
        }
        let mut e = y.mul(series);
        let two = Double(2.0, 0.0);
        for _ in 0..halvings {
            e = e.mul(e.add(two));
        }
        e.div(e.add(two))
    }

    /// The worst error of f64 in units of the last place of the result.
    fn worst_of_f64(xs: &[f64]) -> f64 {
        let mut found = xs.to_vec();
        tanh(&mut found);
        let error = |(x, y): (&f64, &f64)| {
            let Double(high, low) = exact(*x);
            let unit = high.next_up() - high;
            ((y - high) - low).abs() / unit
        };
        xs.iter().zip(&found).map(error).fold(0.0, f64::max)
    }

    #[test]
    fn the_exact_tangent_is_that_of_known_digits() {
        // tanh 1 = 0.7615941559557648 8811945828260479…
        let digits = Double::sum(7_615_941_559_557_648.0, 0.881_194_582_826_047_9);
        let known = digits.div(Double(1e16, 0.0));
        let found = exact(1.0);
        assert_eq!(found.0, known.0);
        assert!((found.1 - known.1).abs() < 1e-29);
        let e = exact(20.0);
        let gap = (1.0 - e.0) - e.1;
        assert!((gap / (2.0 * (-40.0_f64).exp()) - 1.0).abs() < 1e-14);
    }

    #[test]
    fn f64_is_right_to_less_than_two_units_of_the_last_place() {
        let n = 200_000;
        let even: Vec<f64> = (1..n).map(|k| 25.0 * f64::from(k) / f64::from(n)).collect();
        let small: Vec<f64> = (1..n).map(|k| 1.1 * f64::from(k) / f64::from(n)).collect();
        let tiny: Vec<f64> = (0..n)
            .map(|k| (-650.0 + 653.0 * f64::from(k) / f64::from(n)).exp())
            .collect();
        for xs in [even, small, tiny] {
            let worst = worst_of_f64(&xs);
            assert!(worst < 1.25, "{worst}");
        }
    }

    #[test]
    fn f32_is_right_to_one_unit_of_the_last_place() {
        // Every 61st number above 0, up to infinity.
        let xs: Vec<f32> = (0..=f32::INFINITY.to_bits())
            .step_by(61)
            .map(f32::from_bits)
            .collect();
        let mut found = xs.clone();
        tanh(&mut found);
        let mut worst = 0.0_f64;
        for (x, y) in xs.iter().zip(&found) {
            let exact = f64::from(*x).tanh();
            let unit = f64::from((exact as f32).next_up() - exact as f32);
            worst = worst.max((f64::from(*y) - exact).abs() / unit);
        }
        assert!(worst < 1.0, "{worst}");
    }

    macro_rules! ends {
        ($float:ident) => {
            let smallest = $float::from_bits(1);
            let up = [
                0.0,
                smallest,
                3.0 * smallest,
                $float::MIN_POSITIVE,
                1e-30,
                9.1,
                19.1,
                1e4,
                $float::MAX,
                $float::INFINITY,
            ];
            let mut y = up;
            tanh(&mut y);
            assert_eq!(y[..5], up[..5]);
            assert_eq!(y[6..], [1.0; 4]);
            assert!(y[5] <= 1.0 && y[5] > 0.999_999_9);
            let mut z = up.map(|x| -x);
            tanh(&mut z);
            assert_eq!(z.map($float::to_bits), y.map(|y| (-y).to_bits()));
            let mut none = [$float::NAN; 21];
            tanh(&mut none);
            assert!(none.iter().all(|x| x.is_nan()));
        };
    }

    #[test]
    fn tiny_and_huge_numbers_signs_and_nan_are_kept() {
        ends!(f32);
        ends!(f64);
    }

    #[test]
    fn a_number_is_the_same_wherever_it_stands() {
        let mut all: Vec<f64> = (0..37).map(|k| 0.1 * f64::from(k) - 1.7).collect();
        let each: Vec<f64> = all
            .iter()
            .map(|&x| {
                let mut x = [x];
                tanh(&mut x);
                x[0]
            })
            .collect();
        tanh(&mut all);
        assert_eq!(all, each);
    }
}
