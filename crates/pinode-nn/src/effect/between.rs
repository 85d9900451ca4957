//! What an input does between two samples.
//!
//! Held: u(t) = u_k for t_k ≤ t < t_{k+1}, as a converter puts it out.
//!
//! Smooth: what was measured beside the response, as a voltage or a force is. With s = (t − t_k)/h, h = t_{k+1} − t_k,
//!
//! u(t) = u_k + s (u_{k+1} − u_k) + s (1 − s) [(1 − s) (h u̇_k − Δ) + s (Δ − h u̇_{k+1})],  Δ = u_{k+1} − u_k,
//!
//! the natural cubic spline: its slopes u̇ are those with which the second derivative does not jump at a sample, and is zero at either
//! end. A sine with nine samples to a period is met to a thousandth, and to six percent by straight lines; held, it comes half a sample
//! late.

use super::Grid;

/// What an input does between two samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Between {
    /// It stays as it is until the next sample.
    #[default]
    Held,
    /// It passes smoothly through the samples.
    Smooth,
}

impl Between {
    pub(crate) const ALL: [Between; 2] = [Between::Held, Between::Smooth];

    /// The word for it in model files.
    pub fn name(self) -> &'static str {
        match self {
            Between::Held => "held",
            Between::Smooth => "smooth",
        }
    }

    /// The means over the steps of `grid` of an input with the samples `u`, one a sample of the grid; NaN where one is missing.
    pub fn over_steps(self, grid: &Grid, u: &[f64]) -> Vec<f64> {
        let known = |k: usize| u.get(k).copied().unwrap_or(f64::NAN);
        let Between::Smooth = self else {
            let samples = 0..grid.samples();
            let held = samples.flat_map(|k| grid.steps_from(k).map(move |_| known(k)));
            return held.collect();
        };
        let samples = 0..grid.samples();
        let at = |k: usize| grid.bounds.get(grid.steps_from(k).start).copied();
        let t: Vec<f64> = samples.filter_map(at).collect();
        let u: Vec<f64> = (0..t.len()).map(known).collect();
        let slopes = slopes(&t, &u);
        let mut means = Vec::with_capacity(grid.steps());
        for k in 0..t.len().saturating_sub(1) {
            let n = grid.steps_from(k).len();
            let (h, rise) = (t[k + 1] - t[k], u[k + 1] - u[k]);
            let (leaving, arriving) = (h * slopes[k] - rise, rise - h * slopes[k + 1]);
            let at =
                |s: f64| u[k] + s * rise + s * (1.0 - s) * ((1.0 - s) * leaving + s * arriving);
            let mut from = at(0.0);
            for i in 0..n {
                let (a, b) = (i as f64 / n as f64, (i + 1) as f64 / n as f64);
                let to = at(b);
                // Simpson's rule: exact for a cubic.
                means.push((from + 4.0 * at(0.5 * (a + b)) + to) / 6.0);
                from = to;
            }
        }
        means
    }
}

/// The slope of the spline at every sample. With h± the intervals and Δ± the rises after and before sample k,
///
/// u̇_{k−1}/h₋ + 2 (1/h₋ + 1/h₊) u̇_k + u̇_{k+1}/h₊ = 3 (Δ₋/h₋² + Δ₊/h₊²),
///
/// at either end without what is beyond it. Solved by elimination downwards and substitution upwards.
fn slopes(t: &[f64], u: &[f64]) -> Vec<f64> {
    // What an interval gives to either of its samples: 1/h, and 3 Δ/h².
    let intervals: Vec<(f64, f64)> = t
        .windows(2)
        .zip(u.windows(2))
        .map(|(t, u)| (1.0 / (t[1] - t[0]), u[1] - u[0]))
        .map(|(rate, rise)| (rate, 3.0 * rise * rate * rate))
        .collect();
    let interval = |k: Option<usize>| {
        k.and_then(|k| intervals.get(k))
            .copied()
            .unwrap_or_default()
    };
    // Row k once the rows above are eliminated: u̇_k + upper · u̇_{k+1} = right.
    let mut rows: Vec<(f64, f64)> = Vec::with_capacity(u.len());
    for k in 0..u.len() {
        let (before, after) = (interval(k.checked_sub(1)), interval(Some(k)));
        let (upper, right) = rows.last().copied().unwrap_or_default();
        let pivot = 2.0 * (before.0 + after.0) - before.0 * upper;
        rows.push((
            after.0 / pivot,
            (before.1 + after.1 - before.0 * right) / pivot,
        ));
    }
    let mut slopes = vec![0.0; u.len()];
    let mut next = 0.0;
    for (slope, (upper, right)) in slopes.iter_mut().zip(rows).rev() {
        next = right - upper * next;
        *slope = next;
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ of the sine over a step, over its length.
    fn mean(omega: f64, a: f64, b: f64) -> f64 {
        ((omega * a).cos() - (omega * b).cos()) / (omega * (b - a))
    }

    #[test]
    fn means_over_steps_of_unlike_lengths_are_those_of_the_intervals() {
        let t: Vec<f64> = (0..9).map(|k| 0.3 * f64::from(k)).collect();
        let u: Vec<f64> = t.iter().map(|t| (2.0 * t).sin()).collect();
        let times = [1, 3, 2, 1, 1, 4, 1, 2];
        let (whole, cut) = (Grid::new(&t, 1), Grid::finer(&t, 2, &times));
        for between in Between::ALL {
            let (mean, means) = (between.over_steps(&whole, &u), between.over_steps(&cut, &u));
            assert_eq!(means.len(), cut.steps());
            for (k, mean) in mean.iter().enumerate() {
                let own = &means[cut.steps_from(k)];
                let of_all = own.iter().sum::<f64>() / own.len() as f64;
                assert!((of_all - mean).abs() < 1e-14, "{between:?} {k}");
            }
        }
    }

    #[test]
    fn a_straight_line_is_met_exactly_at_uneven_samples() {
        let t = [0.0, 0.1, 0.25, 0.3, 0.5];
        let u = t.map(|t: f64| 3.0 - 2.0 * t);
        let grid = Grid::new(&t, 4);
        let means = Between::Smooth.over_steps(&grid, &u);
        for (b, mean) in grid.bounds.windows(2).zip(means) {
            let expected = 3.0 - (b[0] + b[1]);
            assert!((mean - expected).abs() < 1e-12, "{mean} for {expected}");
        }
    }

    #[test]
    fn a_vibration_is_met_between_its_samples_where_held_it_comes_late() {
        let omega = 2.0 * std::f64::consts::PI / 9.0;
        let t: Vec<f64> = (0..91).map(f64::from).collect();
        let u: Vec<f64> = t.iter().map(|t| (omega * t).sin()).collect();
        let grid = Grid::new(&t, 4);
        let worst = |between: Between| {
            let means = between.over_steps(&grid, &u);
            let steps = grid.bounds.windows(2).zip(&means).skip(8).take(320);
            steps
                .map(|(b, u)| (u - mean(omega, b[0], b[1])).abs())
                .fold(0.0, f64::max)
        };
        assert!(worst(Between::Smooth) < 1e-3, "{}", worst(Between::Smooth));
        assert!(worst(Between::Held) > 0.3);
    }
}
