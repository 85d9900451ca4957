//! Noise of the sensors, from their readings alone.

/// Intervals that differ by less than this part of themselves are even.
const EVEN: f64 = 1e-6;

/// Readings in a row, and when they were taken, s.
#[derive(Debug, Clone, Copy)]
pub struct Readings<'a> {
    /// The times, ascending.
    pub t: &'a [f64],
    /// What was read.
    pub y: &'a [f64],
}

/// Noise of a sensor, from its readings alone: 1.4826 · median |Σ w y| / √(Σ w²), with the weights wⱼ = Π 1/(tⱼ − tᵢ) of the divided difference of order
/// m over m + 1 readings, the smaller of m = 4 and m = 6. Differences of that order remove the motion, however unevenly it was sampled; what is left of a
/// fast one makes the lower order the larger.
pub fn noise(parts: &[Readings]) -> f64 {
    of_order(parts, 4).min(of_order(parts, 6))
}

fn of_order(parts: &[Readings], m: usize) -> f64 {
    let binomial: f64 = (1..=m).map(|k| (m + k) as f64 / k as f64).product();
    let mut size: Vec<f64> = Vec::new();
    for part in parts {
        let readings = part.t.windows(m + 1).zip(part.y.windows(m + 1));
        size.extend(readings.map(|(t, y)| match is_even(t) {
            true => difference(y),
            false => binomial.sqrt() * divided_difference(t, y),
        }));
    }
    1.4826 * median(&mut size) / binomial.sqrt()
}

fn is_even(t: &[f64]) -> bool {
    let intervals = t.len() - 1;
    let usual = (t[intervals] - t[0]) / intervals as f64;
    let mut each = t.windows(2).map(|p| p[1] - p[0]);
    each.all(|interval| (interval - usual).abs() < EVEN * usual)
}

/// |Δᵐ y| of m + 1 readings at even times: the weights are the binomial coefficients, Σ w² = 2m choose m.
fn difference(y: &[f64]) -> f64 {
    let mut d = y.to_vec();
    for left in (1..d.len()).rev() {
        for k in 0..left {
            d[k] = d[k + 1] - d[k];
        }
    }
    d[0].abs()
}

/// |Σ w y| / √(Σ w²) of readings at any times.
fn divided_difference(t: &[f64], y: &[f64]) -> f64 {
    // Any unit will do: it keeps the weights from being large.
    let unit = (t[t.len() - 1] - t[0]) / t.len() as f64;
    let (mut sum, mut squares) = (0.0, 0.0);
    for (j, at) in t.iter().enumerate() {
        let others = t.iter().enumerate().filter(|(i, _)| *i != j);
        let weight: f64 = others.map(|(_, other)| unit / (at - other)).product();
        sum += weight * (y[j] - y[0]);
        squares += weight * weight;
    }
    sum.abs() / squares.sqrt()
}

/// Two orders of differences find the same noise to this part of it where there is some; what a motion leaves falls by much more.
const SAME: f64 = 0.7;

/// Rounding of an angle without its turns is less than this part of the noise.
const ROUNDING: f64 = 1e-6;

/// Whether the readings scatter: what differences of higher order leave is noise and no motion, and more than the least step between two readings. Rounding
/// looks like noise in a motion, by a sensor as well as by a file's digits, and is none at rest.
pub fn scatters(parts: &[Readings]) -> bool {
    let (six, eight) = (of_order(parts, 6), of_order(parts, 8));
    let steps = parts.iter().flat_map(|part| part.y.windows(2));
    let steps = steps.map(|p| (p[1] - p[0]).abs());
    let least = steps.filter(|d| *d > ROUNDING * six);
    eight > SAME * six && six > least.fold(f64::INFINITY, f64::min)
}

pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Whether `v` is the backward difference of `q`, to rounding of a decimal log.
pub fn is_difference(t: &[f64], q: &[f64], v: &[f64]) -> bool {
    let mut agree = 0;
    let mut moving = 0;
    for k in 1..t.len() {
        let d = (q[k] - q[k - 1]) / (t[k] - t[k - 1]);
        if d != 0.0 {
            moving += 1;
            agree += usize::from((d - v[k]).abs() <= 1e-3 * d.abs());
        }
    }
    moving > 0 && agree * 10 > moving * 9
}

/// The step in which a sensor reads, if its readings stand on a grid: all small differences of neighbours are multiples of the least.
/// Rounding of a decimal log, far below the usual difference, does not count.
pub fn quantum(runs: &[Vec<f64>]) -> Option<f64> {
    let mut steps: Vec<f64> = runs
        .iter()
        .flat_map(|y| y.windows(2).map(|p| (p[1] - p[0]).abs()))
        .filter(|d| *d > 0.0)
        .collect();
    let usual = median(&mut steps);
    let least = steps.iter().copied().find(|d| *d > 0.02 * usual)?;
    let small: Vec<f64> = steps
        .iter()
        .copied()
        .filter(|d| *d > 0.5 * least && *d < 20.5 * least)
        .collect();
    let on_grid = small.iter().filter(|d| {
        let ratio = *d / least;
        (ratio - ratio.round()).abs() < 0.05
    });
    let enough = small.len() >= 50 && 50 * on_grid.count() >= 49 * small.len();
    enough.then_some(least)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, Normal};

    /// Intervals of 20 ms, but for a part of them by which each may be longer or shorter.
    fn clock(uneven: f64) -> Vec<f64> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
        let mut t = 0.0;
        let mut next = || {
            t += 0.02 * (1.0 + uneven * rng.random_range(-1.0..1.0));
            t
        };
        (0..3000).map(|_| next()).collect()
    }

    #[test]
    fn noise_is_found_under_motion_however_it_was_sampled() {
        let normal = Normal::new(0.0, 1e-3).unwrap();
        for uneven in [0.0, 0.01, 0.2, 0.6] {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
            let t = clock(uneven);
            let y: Vec<f64> = t
                .iter()
                .map(|t| 0.2 * (5.0 * t).sin() + normal.sample(&mut rng))
                .collect();
            let found = noise(&[Readings { t: &t, y: &y }]);
            assert!((found / 1e-3 - 1.0).abs() < 0.1, "{uneven}: {found}");
        }
    }

    #[test]
    fn differences_at_even_times_are_the_divided_ones() {
        let t: Vec<f64> = (0..7).map(|k| 3.0 + 0.02 * k as f64).collect();
        let y: Vec<f64> = (0..7).map(|k| crate::bins::pseudo(k, 0.4)).collect();
        assert!(is_even(&t));
        let (plain, divided) = (difference(&y), divided_difference(&t, &y));
        // 12 choose 6.
        assert!((divided * 924_f64.sqrt() / plain - 1.0).abs() < 1e-9);
    }

    /// Every third of them: at twice the interval the motion goes twice as far.
    #[test]
    fn samples_that_are_missing_are_no_noise() {
        let is_kept = |k: &usize| k % 3 != 2;
        let t: Vec<f64> = (0..3000).filter(is_kept).map(|k| 0.02 * k as f64).collect();
        let y: Vec<f64> = t.iter().map(|t| (3.0 * t).sin()).collect();
        let found = noise(&[Readings { t: &t, y: &y }]);
        assert!(found < 1e-5, "{found}");
    }

    #[test]
    fn noise_scatters_and_what_an_encoder_or_a_file_rounds_does_not() {
        let normal = Normal::new(0.0, 1e-3).unwrap();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        let swing = |k: usize| (5.0 * k as f64 * 0.02).sin();
        let noisy: Vec<f64> = (0..2000)
            .map(|k| swing(k) + normal.sample(&mut rng))
            .collect();
        let t: Vec<f64> = (0..2000).map(|k| k as f64 * 0.02).collect();
        let scatters = |y: &[f64]| scatters(&[Readings { t: &t, y }]);
        assert!(scatters(&noisy));
        let exact: Vec<f64> = (0..2000).map(swing).collect();
        for step in [2e-3, 1e-6] {
            let rounded: Vec<f64> = exact.iter().map(|y| (y / step).round() * step).collect();
            assert!(!scatters(&rounded), "{step}");
        }
        assert!(!scatters(&exact));
    }

    #[test]
    fn velocities_that_are_differences_are_recognised() {
        let t: Vec<f64> = (0..50).map(|k| k as f64 * 0.02).collect();
        let q: Vec<f64> = t.iter().map(|t| (3.0 * t).sin()).collect();
        let mut v = vec![0.0];
        v.extend((1..50).map(|k| (q[k] - q[k - 1]) / 0.02));
        assert!(is_difference(&t, &q, &v));
        let true_v: Vec<f64> = t.iter().map(|t| 3.0 * (3.0 * t).cos()).collect();
        assert!(!is_difference(&t, &q, &true_v));
    }

    #[test]
    fn the_step_of_an_encoder_is_found_and_noise_has_none() {
        let step = 2.0 * std::f64::consts::PI / 1024.0;
        let swing: Vec<f64> = (0..2000).map(|k| (0.06 * k as f64).sin()).collect();
        // As a decimal log prints it.
        let read = |y: f64| ((y / step).round() * step * 1e7).round() / 1e7;
        let found = quantum(&[swing.iter().map(|&y| read(y)).collect()]).unwrap();
        assert!((found / step - 1.0).abs() < 1e-3, "{found}");
        let normal = Normal::new(0.0, 1e-3).unwrap();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let noisy = swing.iter().map(|y| y + normal.sample(&mut rng)).collect();
        assert_eq!(quantum(&[noisy]), None);
    }
}
