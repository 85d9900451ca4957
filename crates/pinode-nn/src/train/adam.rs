//! Adam (Kingma and Ba, 2015): m ← β₁ m + (1 − β₁) g, s ← β₂ s + (1 − β₂) g², x ← x − η m̂/(√ŝ + ε), m̂ and ŝ without their bias to 0.

use pulp::{NullaryFnOnce, Simd, WithSimd};

use crate::network::Real;
use crate::processor::Processor;

/// β₁, β₂ and ε, as in the paper.
const MEAN: f64 = 0.9;
const SQUARE: f64 = 0.999;
const EPSILON: f64 = 1e-8;

/// Gradients are cut to so many usual lengths, and each counts so much in the usual one.
const LONGEST: f64 = 2.0;
const NEW: f64 = 0.01;

/// The moments of a gradient.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Adam<T> {
    pub mean: Vec<T>,
    pub square: Vec<T>,
    /// Steps made.
    pub steps: u64,
    /// The usual length of a gradient; 0 before the first.
    pub usual: f64,
}

impl<T: Real> Adam<T> {
    /// For `n` numbers.
    pub fn new(n: usize) -> Self {
        Adam {
            mean: vec![T::from_f64(0.0); n],
            square: vec![T::from_f64(0.0); n],
            steps: 0,
            usual: 0.0,
        }
    }

    /// By what `scale` times `gradient` is to be made shorter: to [`LONGEST`] usual lengths, where a few windows that chaos has taken far make it
    /// longer (Pascanu et al. 2013).
    pub fn clipping(&mut self, scale: f64, gradient: &[T]) -> f64 {
        let length = scale.abs() * Processor::here().run(SquaredLength(gradient)).sqrt();
        let limit = if self.usual > 0.0 {
            LONGEST * self.usual
        } else {
            length
        };
        let kept = length.min(limit);
        self.usual += NEW * (kept - self.usual);
        if self.steps == 0 {
            self.usual = kept;
        }
        if length > limit { limit / length } else { 1.0 }
    }

    /// One step of length `rate` along `scale` times `gradient`.
    pub fn step(&mut self, rate: f64, scale: f64, gradient: &[T], x: &mut [T]) {
        self.steps += 1;
        let steps = self.steps as f64;
        let unbiased = rate * (1.0 - SQUARE.powf(steps)).sqrt() / (1.0 - MEAN.powf(steps));
        // √ŝ = √s/√(1 − β₂ᵗ), so ε takes that factor, too.
        let epsilon = EPSILON * (1.0 - SQUARE.powf(steps)).sqrt();
        Processor::here().run(Moments {
            factors: [
                MEAN,
                (1.0 - MEAN) * scale,
                SQUARE,
                (1.0 - SQUARE) * scale * scale,
                epsilon,
                unbiased,
            ],
            gradient,
            mean: &mut self.mean,
            square: &mut self.square,
            x,
        });
    }
}

/// Σ g².
struct SquaredLength<'a, T>(&'a [T]);

impl<T: Real> NullaryFnOnce for SquaredLength<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let (rows, rest) = self.0.as_chunks::<8>();
        let mut sums = [0.0; 8];
        for row in rows {
            for (sum, g) in sums.iter_mut().zip(row) {
                *sum += g.to_f64().powi(2);
            }
        }
        let rest: f64 = rest.iter().map(|g| g.to_f64().powi(2)).sum();
        sums.iter().sum::<f64>() + rest
    }
}

struct Moments<'a, T> {
    /// β₁ and (1 − β₁) c, β₂ and (1 − β₂) c², c the factor of the gradient; ε and the length of the step.
    factors: [f64; 6],
    gradient: &'a [T],
    mean: &'a mut [T],
    square: &'a mut [T],
    x: &'a mut [T],
}

impl<T: Real> WithSimd for Moments<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let factors = self.factors.map(|x| T::splat(s, T::from_f64(x)));
        let (gradient, rest) = T::split::<S>(self.gradient);
        let (means, rest_of_means) = T::split_mut::<S>(self.mean);
        let (squares, rest_of_squares) = T::split_mut::<S>(self.square);
        let (xs, rest_of_xs) = T::split_mut::<S>(self.x);
        let moments = means.iter_mut().zip(squares);
        for ((x, &g), (mean, square)) in xs.iter_mut().zip(gradient).zip(moments) {
            [*mean, *square, *x] = one::<T, S>(s, &factors, g, [*mean, *square, *x]);
        }
        let moments = rest_of_means.iter_mut().zip(rest_of_squares);
        for ((x, &g), (mean, square)) in rest_of_xs.iter_mut().zip(rest).zip(moments) {
            let splat = |x: T| T::splat(s, x);
            let at = [splat(*mean), splat(*square), splat(*x)];
            let after = one::<T, S>(s, &factors, splat(g), at);
            let first = |v: &T::Vector<S>| T::numbers::<S>(v).first().copied();
            if let [Some(m), Some(q), Some(new)] = after.each_ref().map(first) {
                (*mean, *square, *x) = (m, q, new);
            }
        }
    }
}

/// m, s and x after a step.
#[inline(always)]
fn one<T: Real, S: Simd>(
    s: S,
    [mean, of_mean, square, of_square, epsilon, rate]: &[T::Vector<S>; 6],
    g: T::Vector<S>,
    [m, q, x]: [T::Vector<S>; 3],
) -> [T::Vector<S>; 3] {
    let m = T::add(s, T::mul(s, *mean, m), T::mul(s, *of_mean, g));
    let squared = T::mul(s, T::mul(s, *of_square, g), g);
    let q = T::add(s, T::mul(s, *square, q), squared);
    let width = T::add(s, T::sqrt(s, q), *epsilon);
    let step = T::div(s, T::mul(s, *rate, m), width);
    [m, q, T::sub(s, x, step)]
}
