//! Adam (Kingma and Ba, 2015): m ← β₁ m + (1 − β₁) g, s ← β₂ s + (1 − β₂) g², x ← x − η m̂/(√ŝ + ε), m̂ and ŝ without their bias to 0.

use pulp::{Arch, NullaryFnOnce};

use crate::network::Real;

/// β₁, β₂ and ε, as in the paper.
const MEAN: f64 = 0.9;
const SQUARE: f64 = 0.999;
const EPSILON: f64 = 1e-8;

/// The moments of a gradient.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Adam<T> {
    pub mean: Vec<T>,
    pub square: Vec<T>,
    /// Steps made.
    pub steps: u64,
}

impl<T: Real> Adam<T> {
    /// For `n` numbers.
    pub fn new(n: usize) -> Self {
        Adam {
            mean: vec![T::from_f64(0.0); n],
            square: vec![T::from_f64(0.0); n],
            steps: 0,
        }
    }

    /// One step of length `rate`.
    pub fn step(&mut self, rate: f64, gradient: &[T], x: &mut [T]) {
        self.steps += 1;
        let steps = self.steps as f64;
        let unbiased = rate * (1.0 - SQUARE.powf(steps)).sqrt() / (1.0 - MEAN.powf(steps));
        // √ŝ = √s/√(1 − β₂ᵗ), so ε takes that factor, too.
        let epsilon = EPSILON * (1.0 - SQUARE.powf(steps)).sqrt();
        Arch::new().dispatch(Moments {
            rate: unbiased,
            epsilon,
            gradient,
            mean: &mut self.mean,
            square: &mut self.square,
            x,
        });
    }
}

struct Moments<'a, T> {
    rate: f64,
    epsilon: f64,
    gradient: &'a [T],
    mean: &'a mut [T],
    square: &'a mut [T],
    x: &'a mut [T],
}

impl<T: Real> NullaryFnOnce for Moments<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let moments = self.mean.iter_mut().zip(self.square);
        for ((x, gradient), (mean, square)) in self.x.iter_mut().zip(self.gradient).zip(moments) {
            let g = gradient.to_f64();
            let m = MEAN * mean.to_f64() + (1.0 - MEAN) * g;
            let s = SQUARE * square.to_f64() + (1.0 - SQUARE) * g * g;
            (*mean, *square) = (T::from_f64(m), T::from_f64(s));
            *x = T::from_f64(x.to_f64() - self.rate * m / (s.sqrt() + self.epsilon));
        }
    }
}
