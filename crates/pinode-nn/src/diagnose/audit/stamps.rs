//! Stamps of an even clock that were written with too few digits.
//!
//! Seven digits of t = a + h k at 610 Hz are a fiftieth of a millisecond away beyond 100 s. Where a position changes by 20 m/s, that is
//! half a millimetre, and looks like noise of the sensor. Stamps that differ from an even clock by no more than half of their own last
//! digit are that clock; others are believed. So are those whose last digit is worth much of an interval: a clock that missed a sample
//! would differ from an even one by no more than that.

use super::super::verdict::DataFault;
use crate::log::Run;

/// Fewer samples tell no clock.
const FEWEST: usize = 50;
/// More decimals than this are not counted: those stamps are as they were taken.
const MOST_DECIMALS: i32 = 9;
/// Half of the last digit, and a little for where the even clock is laid.
const ROUNDED: f64 = 0.55;
/// The last digit may be worth this part of an interval.
const FINE: f64 = 0.25;
/// Rounding by less than this part of an interval changes nothing.
const NOTHING: f64 = 2e-3;

/// The times of all recordings, even where the stamps are rounded, and the fault that this is.
pub fn times(runs: &[&Run]) -> (Vec<Vec<f64>>, Option<DataFault>) {
    let mut when = Vec::new();
    let mut worst = 0.0_f64;
    let times = runs
        .iter()
        .map(|run| {
            let Some(even) = even_clock(&run.t) else {
                return run.t.clone();
            };
            let away = run.t.iter().zip(&even).map(|(t, even)| (t - even).abs());
            worst = away.fold(worst, f64::max);
            when.extend(run.t.first().zip(run.t.last()).map(|(&a, &b)| [a, b]));
            even
        })
        .collect();
    let fault = (!when.is_empty()).then(|| DataFault {
        kind: "rounded_stamps".into(),
        column: "t".into(),
        when,
        detail: format!(
            "the stamps are those of an even clock, written with too few digits: they are up to {worst:.1e} s away from it; the even \
             clock is taken"
        ),
    });
    (times, fault)
}

/// The even clock a + h k that `t` is rounded from, if it is and the rounding matters.
fn even_clock(t: &[f64]) -> Option<Vec<f64>> {
    let n = t.len();
    if n < FEWEST {
        return None;
    }
    // The least squares of t_k − a − h k.
    let middle = 0.5 * (n - 1) as f64;
    let mean = t.iter().sum::<f64>() / n as f64;
    let places = || (0..n).map(|k| k as f64 - middle);
    let h = places().zip(t).map(|(x, t)| x * (t - mean)).sum::<f64>()
        / places().map(|x| x * x).sum::<f64>();
    let even: Vec<f64> = places().map(|x| mean + h * x).collect();
    let away = |k: usize| (t[k] - even[k]).abs();
    if (0..n).all(|k| away(k) < NOTHING * h) {
        return None;
    }
    let digits = last_digits(t)?;
    let is_rounded = t.iter().enumerate().all(|(k, t)| {
        let place = digits.iter().find(|(power, _)| *power == magnitude(*t));
        place.is_some_and(|(_, digit)| *digit <= FINE * h && away(k) <= ROUNDED * digit)
    });
    is_rounded.then_some(even)
}

/// The power of ten that a stamp begins with.
fn magnitude(t: f64) -> i32 {
    match t == 0.0 {
        true => i32::MIN,
        false => t.abs().log10().floor() as i32,
    }
}

/// What the last written digit is worth, s, for the stamps of each magnitude: numbers of so many significant digits have fewer decimals
/// the larger they are.
fn last_digits(t: &[f64]) -> Option<Vec<(i32, f64)>> {
    let mut digits: Vec<(i32, i32)> = Vec::new();
    for &t in t {
        let decimals = (0..=MOST_DECIMALS).find(|&d| {
            let scaled = t * 10_f64.powi(d);
            (scaled - scaled.round()).abs() < 1e-4
        })?;
        let power = magnitude(t);
        match digits.iter_mut().find(|(known, _)| *known == power) {
            Some((_, most)) => *most = decimals.max(*most),
            None => digits.push((power, decimals)),
        }
    }
    let worth = digits
        .into_iter()
        .map(|(power, d)| (power, 0.1_f64.powi(d)));
    Some(worth.collect())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// From 99 s to 102.2 s at 610 Hz, with seven significant digits.
    fn written() -> (Vec<f64>, Vec<f64>) {
        let exact: Vec<f64> = (0..2000).map(|k| 99.0 + 1.6384e-3 * k as f64).collect();
        let written = exact.iter().map(|t| {
            let digit = if *t < 100.0 { 1e5 } else { 1e4 };
            (t * digit).round() / digit
        });
        (written.collect(), exact)
    }

    #[test]
    fn stamps_with_too_few_digits_are_put_back_on_their_even_clock() {
        let (written, exact) = written();
        let even = even_clock(&written).unwrap();
        let worst = |t: &[f64]| {
            let away = t.iter().zip(&exact).map(|(a, b)| (a - b).abs());
            away.fold(0.0, f64::max)
        };
        assert!(worst(&written) > 4e-5);
        assert!(worst(&even) < 5e-6, "{}", worst(&even));
    }

    #[test]
    fn a_clock_that_wanders_one_that_stops_and_one_with_all_its_digits_are_believed() {
        let (written, exact) = written();
        assert_eq!(even_clock(&exact), None);
        let wanders: Vec<f64> = (0..500)
            .map(|k| ((0.02 * k as f64 + 2e-3 * (0.3 * k as f64).sin()) * 1e4).round() / 1e4)
            .collect();
        assert_eq!(even_clock(&wanders), None);
        let stops: Vec<f64> = written
            .iter()
            .copied()
            .filter(|t| !(100.0..100.1).contains(t))
            .collect();
        assert_eq!(even_clock(&stops), None);
    }

    /// At 100 Hz with two decimals nothing is rounded, and half an interval is half of the last digit.
    #[test]
    fn a_clock_that_misses_a_sample_and_one_of_two_intervals_are_believed() {
        let misses = |at: usize| {
            let kept = (0..4001).filter(|k| *k != at);
            kept.map(|k| f64::from(k as u32) / 100.0)
                .collect::<Vec<_>>()
        };
        for at in [1, 40, 2000, 3999] {
            assert_eq!(even_clock(&misses(at)), None, "{at}");
        }
        let alternating: Vec<f64> = (0..2000)
            .map(|k| f64::from((3 * k + k % 2) / 2) / 100.0)
            .collect();
        assert_eq!(even_clock(&alternating), None);
    }
}
