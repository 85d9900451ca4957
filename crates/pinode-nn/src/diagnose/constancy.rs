//! Whether the constants of a fit stay the same over the log.
//!
//! Window w moves constant k of the fit by p_w ([`Fit::influences`](crate::shooting::Fit::influences)), and all together by nothing. Where the constant is the same all the time the sums over
//! the first m windows wander at random, and so do those of their signs s_w = sgn p_w about their mean s̄, |Σ_{w ≤ m} (s_w − s̄)| / √(Σ (s_w − s̄)²) like a Brownian
//! bridge, beyond x with the probability 2 exp(−2 x²). Where it changes they run away and come back. Signs, for a few windows pull a hundred times as
//! strongly as most. (Nyblom, J. Am. Stat. Assoc. 84, 1989; Hjort and Koning, J. Nonparametric Stat. 14, 2002.)

use super::search::Search;
use super::study::{Fitted, Study};
use super::verdict::Change;
use crate::hybrid::ConstantId;

/// The largest sum counts from here on: one constant in fifteen hundred by chance.
const RUNS_AWAY: f64 = 2.0;
/// A change of less than this part of the value is no news.
const WORTH_TELLING: f64 = 0.1;
/// Fewer windows than this say nothing.
const FEWEST: usize = 16;

/// The constant of the found model that changes most clearly over the windows it was fitted to, if one does: beside a network where it was fitted there, else
/// without.
pub fn change(study: &Study, search: &Search, inputs: &[String]) -> Option<Change> {
    let found = shifts(study, search.whole(), |_| true, inputs);
    let held = search.taught.as_ref().map(|taught| {
        let is_held = |i: &usize| !taught.inside.free.contains(i);
        shifts(study, &search.model, is_held, inputs)
    });
    let found = found.chain(held.into_iter().flatten());
    found.max_by(|a, b| a.statistic.total_cmp(&b.statistic))
}

/// Those of the constants of a fit, of those that are asked for, that change.
fn shifts(
    study: &Study,
    fitted: &Fitted,
    is_asked: impl Fn(&usize) -> bool,
    inputs: &[String],
) -> impl Iterator<Item = Change> {
    let Fitted {
        hybrid,
        inside: fit,
        ..
    } = fitted;
    let windows = &study.windows.fit;
    let influences = fit.influences(windows.len());
    let shift = move |k: usize| {
        let index = fit.free[k];
        let constant = &hybrid.constants()[index];
        if matches!(constant.id, ConstantId::Network(..)) || !is_asked(&index) {
            return None;
        }
        let series: Vec<f64> = influences.iter().map(|p| p[k]).collect();
        let (statistic, last, runs_to) = furthest(&series)?;
        let sum: f64 = series[..=last].iter().sum();
        let (count, first) = (series.len() as f64, (last + 1) as f64);
        let value = fit.theta[index];
        let (before, after) = (
            value + sum * count / first,
            value - sum * count / (count - first),
        );
        let known = match constant.tolerance.is_finite() {
            true => constant.tolerance,
            false => 0.0,
        };
        let tells = (before - after).abs() > known.max(WORTH_TELLING * value.abs());
        // A few windows may pull the other way, so strongly that they say by how much it changes.
        let agrees = sum * runs_to > 0.0;
        (statistic > RUNS_AWAY && tells && agrees).then(|| {
            let window = windows[last];
            let run = &study.observations.runs[window.run];
            let end = (window.first + window.count)
                .min(run.t.len())
                .saturating_sub(1);
            Change {
                name: hybrid.describe(index, inputs),
                statistic,
                run: window.run,
                t: run.t.get(end).copied().unwrap_or(f64::NAN),
                before,
                after,
            }
        })
    };
    (0..fit.free.len()).filter_map(shift)
}

/// The largest of the sums of the signs of a series less their mean, over the root of the sum of their squares; where it ends, and the sum itself.
fn furthest(series: &[f64]) -> Option<(f64, usize, f64)> {
    let count = series.len();
    if count < FEWEST || series.iter().any(|x| !x.is_finite()) {
        return None;
    }
    // What does not pull at all has no sign.
    let signs = || {
        series
            .iter()
            .map(|&x| if x == 0.0 { 0.0 } else { x.signum() })
    };
    let mean = signs().sum::<f64>() / count as f64;
    let size = signs().map(|s| (s - mean).powi(2)).sum::<f64>().sqrt();
    let mut sum = 0.0;
    let sums = signs().take(count - 1).enumerate().map(|(w, s)| {
        sum += s - mean;
        (w, sum)
    });
    let (last, sum) = sums.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    (size > 0.0).then(|| (sum.abs() / size, last, sum))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers between −1 and 1 that look like chance.
    fn noise(i: usize) -> f64 {
        let x = (i as f64 * 12.9898 + 4.1).sin() * 43758.5453;
        2.0 * (x - x.floor()) - 1.0
    }

    #[test]
    fn a_series_that_steps_half_way_runs_away_there_and_noise_does_not() {
        let still: Vec<f64> = (0..80).map(noise).collect();
        let (at_rest, ..) = furthest(&still).unwrap();
        assert!(at_rest < 1.4, "{at_rest}");
        let step = |i: usize| if i < 40 { 1.0 } else { -1.0 };
        // One window pulls a hundred times as strongly as the others, the other way.
        let pull = |i: usize| if i == 30 { -100.0 } else { noise(i) + step(i) };
        let stepped: Vec<f64> = (0..80).map(pull).collect();
        let (statistic, last, sum) = furthest(&stepped).unwrap();
        assert!(statistic > RUNS_AWAY, "{statistic}");
        assert!(last.abs_diff(39) <= 2 && sum > 0.0, "{last}, {sum}");
    }

    #[test]
    fn few_windows_and_numbers_that_are_none_say_nothing() {
        assert!(furthest(&[1.0; 8]).is_none());
        assert!(furthest(&[f64::NAN; 80]).is_none());
        assert!(furthest(&[1.0; 80]).is_none());
    }
}
