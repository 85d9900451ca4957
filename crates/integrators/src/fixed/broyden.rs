//! Steps towards the root of F.

/// Broyden's method for F(x) = 0 from the Jacobian 1, with its memory of earlier steps.
///
/// The first step is −F; later ones are −F seen through updates of rank 1 that make the Jacobian agree with what the steps before have
/// shown. (Kelley, "Iterative Methods for Linear and Nonlinear Equations", 1995, section 7.3.)
#[derive(Debug, Clone)]
pub(crate) struct Broyden {
    /// s₀, s₁, … with |s|², of which `count` are in use.
    steps: Vec<(Vec<f64>, f64)>,
    count: usize,
    plain: Vec<f64>,
}

/// Steps that are remembered; then the memory is emptied.
const KEPT: usize = 12;
/// The least 1 − sᵀz/|s|² that is divided by.
const LEAST: f64 = 0.05;

impl Broyden {
    /// For `dim` unknowns.
    pub fn new(dim: usize) -> Self {
        Broyden {
            steps: vec![(vec![0.0; dim], 0.0); KEPT],
            count: 0,
            plain: vec![0.0; dim],
        }
    }

    /// Forgets the steps towards another root.
    pub fn begin(&mut self) {
        self.count = 0;
    }

    /// Replaces −F, at the x that the last step led to, by the next step.
    pub fn step(&mut self, minus_f: &mut [f64]) {
        self.plain.copy_from_slice(minus_f);
        if self.count == KEPT || !self.update(minus_f) {
            minus_f.copy_from_slice(&self.plain);
            self.count = 0;
        }
        let square = dot(minus_f, minus_f);
        if let Some((kept, kept_square)) = self.steps.get_mut(self.count) {
            kept.copy_from_slice(minus_f);
            *kept_square = square;
            self.count += 1;
        }
    }

    /// z = B⁻¹ (−F), in place; `false` where an update is close to singular, or a step too small to be squared.
    fn update(&self, z: &mut [f64]) -> bool {
        let known = self.steps.get(..self.count).unwrap_or_default();
        let Some((last, last_square)) = known.last() else {
            return true;
        };
        for pair in known.windows(2) {
            if let [(from, square), (to, _)] = pair {
                let factor = dot(from, z) / square;
                for (z, s) in z.iter_mut().zip(to) {
                    *z += factor * s;
                }
            }
        }
        let rest = 1.0 - dot(last, z) / last_square;
        for z in z.iter_mut() {
            *z /= rest;
        }
        // NaN is not more than anything.
        rest > LEAST && z.iter().all(|z| z.is_finite())
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calls of F until a step is below 1e-14.
    fn calls(mut f: impl FnMut(&[f64]) -> Vec<f64>, x: &mut [f64]) -> usize {
        let mut broyden = Broyden::new(x.len());
        for calls in 1..50 {
            let mut step: Vec<f64> = f(x).iter().map(|f| -f).collect();
            broyden.step(&mut step);
            for (x, s) in x.iter_mut().zip(&step) {
                *x += s;
            }
            if step.iter().all(|s| s.abs() < 1e-14) {
                return calls;
            }
        }
        50
    }

    #[test]
    fn a_linear_equation_of_n_unknowns_takes_at_most_2n_steps() {
        // F = (1 + A) x − b, where x ← x − F alone diverges.
        let f = |x: &[f64]| {
            vec![
                1.4 * x[0] + 0.9 * x[1] - 1.0,
                -0.8 * x[0] + 2.5 * x[1] + 2.0,
            ]
        };
        let mut x = [0.0, 0.0];
        let count = calls(f, &mut x);
        assert!(count <= 5, "{count}");
        let residual = f(&x);
        assert!(residual.iter().all(|r| r.abs() < 1e-14), "{residual:?}");
    }

    #[test]
    fn one_unknown_is_the_secant_method() {
        let mut x = [1.0];
        let count = calls(|x| vec![x[0] - x[0].cos()], &mut x);
        approx::assert_abs_diff_eq!(x[0], 0.739_085_133_215_160_6, epsilon = 1e-15);
        // x ← cos x alone takes 80.
        assert!(count <= 8, "{count}");
    }

    #[test]
    fn a_root_found_at_once_stays() {
        let mut x = [0.0];
        assert_eq!(calls(|_| vec![0.0], &mut x), 1);
        assert_eq!(x, [0.0]);
    }
}
