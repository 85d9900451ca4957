//! Power series of ad_ξ, which say how motions one after the other add up.
//!
//! Along x(s) = x₀ ∘ exp ξ(s), the velocity in the moved axes is x⁻¹ ẋ = φ(ad_ξ) ξ̇ with φ(z) = (1 − e^{−z})/z, and a displacement η
//! of x₀ is seen at x as e^{−ad_ξ} η. (Iserles, Munthe-Kaas, Nørsett, Zanna, "Lie-group methods", Acta Numerica 2000, with the sides
//! exchanged: there motions stand on the left.)

use super::Space;

/// Coefficients of zⁿ, n = 0, 1, ….
type Series = [f64];

/// z/(1 − e^{−z}) = 1 + z/2 + z²/12 − z⁴/720 + …, as far as methods up to order 6 need it.
const RATE: [f64; 5] = [1.0, 0.5, 1.0 / 12.0, 0.0, -1.0 / 720.0];

/// ξ̇ = φ(ad_ξ)⁻¹ `rate`: how the chart ξ moves when x = x₀ ∘ exp ξ has the velocity `rate` in its moved axes.
///
/// The series is cut after ad⁴, with an error of |ad ξ|⁶/30240 · |rate|: of order h⁷ in a step h.
pub fn chart_rate<S: Space>(space: &S, xi: &[f64], rate: &[f64], work: &mut Work, out: &mut [f64]) {
    sum(&RATE, rate, work, out, |x, y| space.bracket_into(xi, x, y));
}

/// Memory for two terms.
#[derive(Debug, Clone, Default)]
pub struct Work {
    term: Vec<f64>,
    next: Vec<f64>,
}

impl Work {
    pub fn new(tangent_dim: usize) -> Self {
        Work {
            term: vec![0.0; tangent_dim],
            next: vec![0.0; tangent_dim],
        }
    }
}

/// out = Σ cₙ Aⁿ x for the linear map y = A x that `apply(x, y)` is.
pub fn sum(
    series: &Series,
    x: &[f64],
    work: &mut Work,
    out: &mut [f64],
    mut apply: impl FnMut(&[f64], &mut [f64]),
) {
    out.fill(0.0);
    work.term.resize(x.len(), 0.0);
    work.next.resize(x.len(), 0.0);
    work.term.copy_from_slice(x);
    for (n, &coefficient) in series.iter().enumerate() {
        for (out, term) in out.iter_mut().zip(&work.term) {
            *out += coefficient * term;
        }
        if n + 1 < series.len() {
            apply(&work.term, &mut work.next);
            std::mem::swap(&mut work.term, &mut work.next);
        }
    }
}
