//! The chart exp around a state, with its derivative.

use nalgebra::DMatrix;

use crate::Space;

/// Powers of ad_ξ that are summed, the zeroth one included; the last one is even, as odd ones have no part in φ⁻¹.
const TERMS: usize = 35;

/// A sum whose last term is larger than this part of it has not converged.
const CONVERGED: f64 = 1e-13;

/// The chart x₀ ∘ exp ξ, in which a velocity η in the moved axes reads ξ̇ = φ(ad_ξ)⁻¹ η with φ(z) = (1 − e^{−z})/z.
///
/// φ⁻¹ is summed as its power series, which converges where |ad_ξ| < 2π and is exact to rounding for |ad_ξ| ≤ 2. (Iserles,
/// Munthe-Kaas, Nørsett, Zanna, "Lie-group methods", Acta Numerica 2000, with the sides exchanged.)
#[derive(Debug, Clone)]
pub(super) struct Chart {
    /// Of z/(1 − e^{−z}).
    inverse: [f64; TERMS],
    /// Of (1 − e^{−z})/z.
    forward: [f64; TERMS],
    term: Vec<f64>,
    next: Vec<f64>,
    slope: Vec<f64>,
    slope_next: Vec<f64>,
    unit: Vec<f64>,
}

/// Coefficients of z/(1 − e^{−z}): 1, 1/2, and −2 (−1)ᵏ ζ(2k)/(2π)²ᵏ at z²ᵏ.
fn inverse_series() -> [f64; TERMS] {
    let mut series = [0.0; TERMS];
    for (n, coefficient) in series.iter_mut().enumerate() {
        *coefficient = match n {
            0 => 1.0,
            1 => 0.5,
            2 => 1.0 / 12.0,
            4 => -1.0 / 720.0,
            6 => 1.0 / 30_240.0,
            n if n % 2 == 1 => 0.0,
            n => {
                let power = n as i32;
                // From n = 8 on, what follows the 128th term of ζ(n) is below rounding.
                let zeta: f64 = (1..=128_u32).rev().map(|j| f64::from(j).powi(-power)).sum();
                let sign = if n % 4 == 0 { -1.0 } else { 1.0 };
                sign * 2.0 * zeta / std::f64::consts::TAU.powi(power)
            }
        };
    }
    series
}

/// Coefficients of (1 − e^{−z})/z: (−1)ⁿ/(n + 1)!.
fn forward_series() -> [f64; TERMS] {
    let mut series = [1.0; TERMS];
    let mut last = 1.0;
    for (n, coefficient) in series.iter_mut().enumerate() {
        last *= if n == 0 { 1.0 } else { -1.0 / (n + 1) as f64 };
        *coefficient = last;
    }
    series
}

impl Chart {
    pub fn new(tangent_dim: usize) -> Self {
        let zeros = || vec![0.0; tangent_dim];
        Chart {
            inverse: inverse_series(),
            forward: forward_series(),
            term: zeros(),
            next: zeros(),
            slope: zeros(),
            slope_next: zeros(),
            unit: zeros(),
        }
    }

    /// Writes ξ̇ = φ(ad_ξ)⁻¹ η to `out`, and says whether the series converges there.
    pub fn rate_into<S: Space>(
        &mut self,
        space: &S,
        xi: &[f64],
        velocity: &[f64],
        out: &mut [f64],
    ) -> bool {
        let series = self.inverse;
        self.sum_into(&series, space, xi, velocity, out)
    }

    /// out = Σ cₙ ad_ξⁿ v; whether the sum has converged.
    fn sum_into<S: Space>(
        &mut self,
        series: &[f64; TERMS],
        space: &S,
        xi: &[f64],
        v: &[f64],
        out: &mut [f64],
    ) -> bool {
        self.term.copy_from_slice(v);
        out.fill(0.0);
        let (mut size, mut total) = (0.0_f64, 0.0_f64);
        for &coefficient in series {
            size = 0.0;
            for (out, term) in out.iter_mut().zip(&self.term) {
                *out += coefficient * term;
                size = size.max((coefficient * term).abs());
            }
            total = total.max(size);
            if coefficient != 0.0 && size <= f64::EPSILON * 1e-3 * total {
                return true;
            }
            space.bracket_into(xi, &self.term, &mut self.next);
            std::mem::swap(&mut self.term, &mut self.next);
        }
        size <= CONVERGED * total
    }

    /// Writes ∂ξ̇/∂ξ to `out` for a velocity η with the derivative `of_velocity` along the directions of motion at x₀ ∘ exp ξ.
    ///
    /// ∂ξ̇/∂ξ = φ⁻¹ (∂η/∂x) φ + Σ bₙ ∂(ad_ξⁿ η)/∂ξ, the last at fixed η by the rule of products, term after term.
    pub fn jacobian_into<S: Space>(
        &mut self,
        space: &S,
        xi: &[f64],
        velocity: &[f64],
        of_velocity: &DMatrix<f64>,
        out: &mut DMatrix<f64>,
    ) {
        let n = xi.len();
        let mut unit = std::mem::take(&mut self.unit);
        let (mut forward, mut column) = (vec![0.0; n], vec![0.0; n]);
        let (inverse_of, forward_of) = (self.inverse, self.forward);
        for j in 0..n {
            unit.fill(0.0);
            if let Some(entry) = unit.get_mut(j) {
                *entry = 1.0;
            }
            self.sum_into(&forward_of, space, xi, &unit, &mut forward);
            for (row, moved) in column.iter_mut().enumerate() {
                *moved = of_velocity
                    .row(row)
                    .iter()
                    .zip(&forward)
                    .map(|(a, b)| a * b)
                    .sum();
            }
            self.sum_into(&inverse_of, space, xi, &column, &mut forward);
            for (row, value) in forward.iter().enumerate() {
                out[(row, j)] = *value;
            }
            // term = ad_ξⁿ η and slope = its derivative along e_j: [ξ, slope] + [e_j, term].
            self.term.copy_from_slice(velocity);
            self.slope.fill(0.0);
            for &coefficient in &inverse_of {
                for (row, slope) in self.slope.iter().enumerate() {
                    out[(row, j)] += coefficient * slope;
                }
                space.bracket_into(xi, &self.slope, &mut self.slope_next);
                space.bracket_into(&unit, &self.term, &mut self.next);
                for (slope, next) in self.slope_next.iter_mut().zip(&self.next) {
                    *slope += next;
                }
                std::mem::swap(&mut self.slope, &mut self.slope_next);
                space.bracket_into(xi, &self.term, &mut self.next);
                std::mem::swap(&mut self.term, &mut self.next);
            }
        }
        self.unit = unit;
    }

    /// ‖ad_ξ‖∞, which bounds how far the series has to reach; for one turn between its angle and √2 times that.
    pub fn reach<S: Space>(&mut self, space: &S, xi: &[f64]) -> f64 {
        let mut rows = std::mem::take(&mut self.slope);
        rows.fill(0.0);
        self.unit.fill(0.0);
        for j in 0..xi.len() {
            if let Some(entry) = self.unit.get_mut(j) {
                *entry = 1.0;
            }
            space.bracket_into(xi, &self.unit, &mut self.next);
            for (row, entry) in rows.iter_mut().zip(&self.next) {
                *row += entry.abs();
            }
            if let Some(entry) = self.unit.get_mut(j) {
                *entry = 0.0;
            }
        }
        let reach = rows.iter().fold(0.0, |a: f64, &b| a.max(b));
        self.slope = rows;
        reach
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rotation;

    /// φ⁻¹ of a turn, in closed form: η + ½ ξ × η + (1 − (θ/2) cot(θ/2))/θ² ξ × (ξ × η).
    fn closed(xi: &[f64; 3], eta: &[f64; 3]) -> [f64; 3] {
        let cross = |a: &[f64; 3], b: &[f64; 3]| {
            [
                a[1] * b[2] - a[2] * b[1],
                a[2] * b[0] - a[0] * b[2],
                a[0] * b[1] - a[1] * b[0],
            ]
        };
        let angle = xi.iter().map(|x| x * x).sum::<f64>().sqrt();
        let once = cross(xi, eta);
        let twice = cross(xi, &once);
        let part = (1.0 - 0.5 * angle / (0.5 * angle).tan()) / (angle * angle);
        std::array::from_fn(|i| eta[i] + 0.5 * once[i] + part * twice[i])
    }

    #[test]
    fn chart_of_a_turn_is_its_closed_form_up_to_two_radians() {
        let mut chart = Chart::new(3);
        for angle in [0.1, 0.5, 1.0, 1.5, 2.0] {
            let xi = [0.6 * angle, -0.64 * angle, 0.48 * angle];
            let eta = [0.3, 1.2, -0.7];
            let mut rate = [0.0; 3];
            assert!(chart.rate_into(&Rotation, &xi, &eta, &mut rate));
            for (a, b) in rate.iter().zip(closed(&xi, &eta)) {
                approx::assert_abs_diff_eq!(*a, b, epsilon = 4e-15);
            }
        }
    }

    #[test]
    fn chart_beyond_a_full_turn_says_that_it_has_no_value() {
        let mut chart = Chart::new(3);
        let mut rate = [0.0; 3];
        assert!(!chart.rate_into(&Rotation, &[0.0, 7.0, 0.0], &[1.0, 0.0, 0.0], &mut rate));
    }

    #[test]
    fn jacobian_of_the_chart_agrees_with_central_differences() {
        // A velocity that depends on the orientation: η = R(x)ᵀ a, so that its derivative along ξ is −[ξ, η].
        let a = [0.4, -1.1, 0.8];
        let velocity = |xi: &[f64; 3]| {
            let mut q = [0.0; 4];
            Rotation.move_into(&[1.0, 0.0, 0.0, 0.0], xi, &mut q);
            let (w, v) = (q[0], [-q[1], -q[2], -q[3]]);
            let mut once = [0.0; 3];
            Rotation.bracket_into(&v, &a, &mut once);
            let mut twice = [0.0; 3];
            Rotation.bracket_into(&v, &once, &mut twice);
            [0, 1, 2].map(|i| a[i] + 2.0 * (w * once[i] + twice[i]))
        };
        let mut chart = Chart::new(3);
        let xi = [0.9, -0.5, 0.7];
        let eta = velocity(&xi);
        let of_velocity = DMatrix::from_fn(3, 3, |i, j| {
            let mut unit = [0.0; 3];
            unit[j] = -1.0;
            let mut out = [0.0; 3];
            Rotation.bracket_into(&unit, &eta, &mut out);
            out[i]
        });
        let mut jacobian = DMatrix::zeros(3, 3);
        chart.jacobian_into(&Rotation, &xi, &eta, &of_velocity, &mut jacobian);
        let h = 1e-5;
        for j in 0..3 {
            let mut rate = |sign: f64| {
                let mut moved = xi;
                moved[j] += sign * h;
                let mut out = [0.0; 3];
                chart.rate_into(&Rotation, &moved, &velocity(&moved), &mut out);
                out
            };
            let (up, down) = (rate(1.0), rate(-1.0));
            for i in 0..3 {
                let slope = (up[i] - down[i]) / (2.0 * h);
                approx::assert_abs_diff_eq!(jacobian[(i, j)], slope, epsilon = 1e-9);
            }
        }
    }
}
