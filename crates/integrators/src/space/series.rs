//! Power series of ad_ξ, which say how motions one after the other add up.
//!
//! Along x(s) = x₀ ∘ exp ξ(s), the velocity in the moved axes is x⁻¹ ẋ = φ(ad_ξ) ξ̇ with φ(z) = (1 − e^{−z})/z, and a displacement η
//! of x₀ is seen at x as e^{−ad_ξ} η. (Iserles, Munthe-Kaas, Nørsett, Zanna, "Lie-group methods", Acta Numerica 2000, with the sides
//! exchanged: there motions stand on the left.)

use std::ops::Range;

use super::Space;

/// Coefficients of zⁿ, n = 0, 1, ….
type Series = [f64];

/// z/(1 − e^{−z}) = 1 + z/2 + z²/12 − z⁴/720 + …, as far as methods up to order 6 need it.
const RATE: [f64; 5] = [1.0, 0.5, 1.0 / 12.0, 0.0, -1.0 / 720.0];

/// ξ̇ = φ(ad_ξ)⁻¹ `rate`: how the chart ξ moves when x = x₀ ∘ exp ξ has the velocity `rate` in its moved axes.
///
/// The series is cut after ad⁴, with an error of |ad ξ|⁶/30240 · |rate|: of order h⁷ in a step h.
pub fn chart_rate<S: Space>(space: &S, xi: &[f64], rate: &[f64], work: &mut Work, out: &mut [f64]) {
    sum(&RATE, (rate, space.curved()), work, out, |x, y| {
        space.bracket_into(xi, x, y);
    });
}

/// (−1)ⁿ/(n + 1)!, the coefficients of φ(z) = (1 − e^{−z})/z, which is dexp of these sides. The first that is left out is 4·10⁻¹⁹: for
/// |ad ξ| ≤ 1, a turn of 1 rad, the series is exact to rounding.
const MOVED: [f64; 19] = {
    let mut series = [1.0; 19];
    let mut n = 1;
    while n < series.len() {
        series[n] = -series[n - 1] / (n as f64 + 1.0);
        n += 1;
    }
    series
};

/// How x = x₀ ∘ exp ξ is displaced, in its moved axes, when x₀ is displaced by `base` = η and the chart by `change` = δξ:
/// e^{−ad_ξ} η + φ(ad_ξ) δξ = η + φ(ad_ξ) (δξ − [ξ, η]), for e^{−z} = 1 − φ(z) z.
pub fn displaced<S: Space>(
    space: &S,
    xi: &[f64],
    (base, change): (&[f64], &[f64]),
    work: &mut Work,
    out: &mut [f64],
) {
    work.rest.resize(base.len(), 0.0);
    let mut rest = std::mem::take(&mut work.rest);
    space.bracket_into(xi, base, &mut rest);
    for (rest, change) in rest.iter_mut().zip(change) {
        *rest = change - *rest;
    }
    sum_to_rounding(&MOVED, (&rest, space.curved()), work, out, |x, y| {
        space.bracket_into(xi, x, y);
    });
    for (out, base) in out.iter_mut().zip(base) {
        *out += base;
    }
    work.rest = rest;
}

/// The transpose of [`displaced`]: for a covector m at x its parts at x₀, (e^{−ad_ξ})ᵀ m = m − ad_ξᵀ φ(ad_ξ)ᵀ m, and in the chart,
/// φ(ad_ξ)ᵀ m.
pub fn displaced_back<S: Space>(
    space: &S,
    xi: &[f64],
    m: &[f64],
    work: &mut Work,
    (of_base, of_change): (&mut [f64], &mut [f64]),
) {
    let curved = space.curved();
    sum_to_rounding(&MOVED, (m, curved.clone()), work, of_change, |x, y| {
        space.cobracket_into(xi, x, y);
    });
    space.cobracket_into(xi, of_change, &mut work.next);
    of_base.copy_from_slice(m);
    for i in curved {
        of_base[i] -= work.next[i];
    }
}

/// Adds to `out` how ξ̇ = Σ rₙ ad_ξⁿ v changes with ξ for fixed v = `rate`, the derivative of the polynomial that [`chart_rate`] is:
/// Σ rₙ Σ ad_ξᵐ [δξ, ad_ξʲ v] over n ≥ 1 and m + j = n − 1.
pub fn chart_rate_change<S: Space>(
    space: &S,
    xi: &[f64],
    (change, rate): (&[f64], &[f64]),
    work: &mut Work,
    out: &mut [f64],
) {
    let (nt, curved) = (rate.len(), space.curved());
    work.powers(nt, rate, |x, y| space.bracket_into(xi, x, y));
    // b_j = [δξ, ad_ξʲ v]; then Σ_m ad_ξᵐ Σ_j r_{m+j+1} b_j by Horner's scheme from the highest m.
    for j in 0..ORDER {
        let (powers, brackets) = (&work.powers, &mut work.brackets);
        let of = j * nt..(j + 1) * nt;
        space.bracket_into(change, &powers[of.clone()], &mut brackets[of]);
    }
    work.term.fill(0.0);
    for m in (0..ORDER).rev() {
        space.bracket_into(xi, &work.term, &mut work.next);
        std::mem::swap(&mut work.term, &mut work.next);
        for j in 0..ORDER - m {
            let b = &work.brackets[j * nt..(j + 1) * nt];
            for i in curved.clone() {
                work.term[i] += RATE[m + j + 1] * b[i];
            }
        }
    }
    for i in curved {
        out[i] += work.term[i];
    }
}

/// The transposes of [`chart_rate`] in the rate v, Σ rₙ (ad_ξᵀ)ⁿ m for a covector m of ξ̇, and of [`chart_rate_change`] in δξ. As
/// m · ad_ξᵏ [δξ, y] = −(ad_yᵀ (ad_ξᵀ)ᵏ m) · δξ, this one is −Σ_j ad_{yʲ}ᵀ Σ_k r_{k+j+1} (ad_ξᵀ)ᵏ m with yʲ = ad_ξʲ v.
pub fn chart_rate_back<S: Space>(
    space: &S,
    xi: &[f64],
    (m, rate): (&[f64], &[f64]),
    work: &mut Work,
    (of_rate, of_xi): (&mut [f64], &mut [f64]),
) {
    let (nt, curved) = (rate.len(), space.curved());
    work.powers(nt, m, |x, y| space.cobracket_into(xi, x, y));
    space.cobracket_into(xi, &work.powers[(ORDER - 1) * nt..], &mut work.next);
    // r₀ = 1, where nothing turns.
    of_rate.copy_from_slice(m);
    for i in curved.clone() {
        of_rate[i] = RATE[ORDER] * work.next[i];
    }
    add_powers(&RATE, &work.powers, &curved, of_rate);
    work.rest.copy_from_slice(rate);
    of_xi.fill(0.0);
    for j in 0..ORDER {
        work.term[curved.clone()].fill(0.0);
        add_powers(&RATE[j + 1..], &work.powers, &curved, &mut work.term);
        space.cobracket_into(&work.rest, &work.term, &mut work.next);
        for i in curved.clone() {
            of_xi[i] -= work.next[i];
        }
        if j + 1 < ORDER {
            space.bracket_into(xi, &work.rest, &mut work.next);
            std::mem::swap(&mut work.rest, &mut work.next);
        }
    }
}

/// Adds the powers, which stand one after the other, by their coefficients in the entries `curved`; what there is no coefficient or no
/// power for is left out.
fn add_powers(series: &Series, powers: &[f64], curved: &Range<usize>, out: &mut [f64]) {
    for (&coefficient, power) in series.iter().zip(powers.chunks_exact(out.len().max(1))) {
        if coefficient != 0.0 {
            for i in curved.clone() {
                out[i] += coefficient * power[i];
            }
        }
    }
}

/// The highest power of ad_ξ in [`chart_rate`].
const ORDER: usize = RATE.len() - 1;

/// Memory for the terms of a series.
#[derive(Debug, Clone, Default)]
pub struct Work {
    term: Vec<f64>,
    next: Vec<f64>,
    rest: Vec<f64>,
    powers: Vec<f64>,
    brackets: Vec<f64>,
}

impl Work {
    pub fn new(tangent_dim: usize) -> Self {
        Work {
            term: vec![0.0; tangent_dim],
            next: vec![0.0; tangent_dim],
            ..Self::default()
        }
    }

    /// Fills `powers` with x, A x, A² x, … for the linear map y = A x that `apply(x, y)` is, and makes room for the rest.
    fn powers(&mut self, nt: usize, x: &[f64], mut apply: impl FnMut(&[f64], &mut [f64])) {
        for terms in [&mut self.term, &mut self.next, &mut self.rest] {
            terms.resize(nt, 0.0);
        }
        self.powers.resize(ORDER * nt, 0.0);
        self.brackets.resize(ORDER * nt, 0.0);
        self.powers[..nt].copy_from_slice(x);
        for n in 1..ORDER {
            let (before, after) = self.powers.split_at_mut(n * nt);
            apply(&before[(n - 1) * nt..], &mut after[..nt]);
        }
    }
}

/// out = Σ cₙ Aⁿ x for the linear map y = A x that `apply(x, y)` is; A is zero outside of the entries `curved`.
pub fn sum(
    series: &Series,
    x: (&[f64], Range<usize>),
    work: &mut Work,
    out: &mut [f64],
    apply: impl FnMut(&[f64], &mut [f64]),
) {
    add_up(series, x, work, out, apply, false);
}

/// [`sum`] up to the first term that changes no entry: for long series of falling terms.
fn sum_to_rounding(
    series: &Series,
    x: (&[f64], Range<usize>),
    work: &mut Work,
    out: &mut [f64],
    apply: impl FnMut(&[f64], &mut [f64]),
) {
    add_up(series, x, work, out, apply, true);
}

#[inline]
fn add_up(
    series: &Series,
    (x, curved): (&[f64], Range<usize>),
    work: &mut Work,
    out: &mut [f64],
    mut apply: impl FnMut(&[f64], &mut [f64]),
    until_rounding: bool,
) {
    let first = series.first().copied().unwrap_or(0.0);
    for (out, x) in out.iter_mut().zip(x) {
        *out = first * x;
    }
    out[curved.clone()].fill(0.0);
    work.term.resize(x.len(), 0.0);
    work.next.resize(x.len(), 0.0);
    work.term.copy_from_slice(x);
    for (n, &coefficient) in series.iter().enumerate() {
        let mut changed = !until_rounding;
        for (out, term) in out[curved.clone()]
            .iter_mut()
            .zip(&work.term[curved.clone()])
        {
            let before = *out;
            *out += coefficient * term;
            // NaN is a change.
            changed |= *out != before;
        }
        if !changed {
            return;
        }
        if n + 1 < series.len() {
            apply(&work.term, &mut work.next);
            std::mem::swap(&mut work.term, &mut work.next);
        }
    }
}
