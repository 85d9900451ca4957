//! How well a fitted model explains each window, and whether one explains them better than another.

use crate::shooting::{Channel, Fit};

/// Noise counts with this factor: a model that fits below it gains nothing more.
const FLOOR: f64 = 0.7;

/// Log-likelihood of each window under its own variance, l_w = −½ Σ_c n_cw ln(SSE_cw/n_cw + (0.7 σ_c)²).
///
/// With one variance for all windows a few chaotic ones would own the sum. −∞ where the roll-out diverges. A hidden state that the
/// window itself determines costs a nat (Akaike): half of that it gains by fitting noise, as much it would lose on new noise.
pub fn window_scores(fit: &Fit, channels: &[Channel]) -> Vec<f64> {
    fit.squares
        .iter()
        .zip(&fit.determined)
        .map(|(window, determined)| {
            let likelihood: f64 = window
                .iter()
                .zip(channels)
                .filter(|((sum, n), _)| *n > 0 || sum.is_infinite())
                .map(|(&(sum, n), channel)| {
                    let n = n.max(1) as f64;
                    -0.5 * n * (sum / n + (FLOOR * channel.noise).powi(2)).ln()
                })
                .sum();
            likelihood - determined
        })
        .collect()
}

/// Mean samples per window and channel pair: what a gain is divided by to be a gain per sample.
pub fn samples_per_window(fit: &Fit) -> f64 {
    let channels = fit.squares.first().map_or(1, Vec::len).max(1);
    let samples: usize = fit.squares.iter().flatten().map(|(_, n)| n).sum();
    (samples as f64 / channels as f64 / fit.squares.len().max(1) as f64).max(1.0)
}

/// So many nats decide a window: it has one chance in a hundred to be for the wrong model.
const DECISIVE: f64 = 5.0;

/// No comparison is surer than this many standard errors: where all windows are for one model, no number of them says how sure that is.
const SUREST: f64 = 100.0;

/// A paired comparison of two models over the same windows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paired {
    /// Mean difference over its standard error.
    pub z: f64,
    /// The same where few windows differ much: of differences that are skewed z takes the scatter of the large ones for doubt. See [`tilted`].
    pub skewed_z: f64,
    /// Sum of the differences, nats.
    pub gain: f64,
    /// Number of windows compared.
    pub windows: usize,
    /// Number of those that decide for the new model, and against it.
    pub decided: [usize; 2],
}

/// d_w = l_w(new) − l_w(old), z = mean(d) / (sd(d)/√n). A window in which the new model diverges counts as a loss as large as the
/// largest difference seen; one in which only the old one diverges counts nothing.
pub fn paired(new: &[f64], old: &[f64]) -> Paired {
    let mut differences: Vec<f64> = new
        .iter()
        .zip(old)
        .filter(|(n, o)| n.is_finite() && o.is_finite())
        .map(|(n, o)| n - o)
        .collect();
    let worst = differences.iter().fold(1.0_f64, |a, d| a.max(d.abs()));
    let lost = new
        .iter()
        .zip(old)
        .filter(|(n, o)| !n.is_finite() && o.is_finite())
        .count();
    differences.extend(std::iter::repeat_n(-worst, lost));
    let n = differences.len() as f64;
    if differences.len() < 3 {
        return Paired {
            z: 0.0,
            skewed_z: 0.0,
            gain: 0.0,
            windows: differences.len(),
            decided: [0; 2],
        };
    }
    let gain: f64 = differences.iter().sum();
    let mean = gain / n;
    let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    // The same loss in every window, as of a model that diverges everywhere, has no variance: it is no tie.
    let error = (variance / n).sqrt().max(1e-9 * mean.abs());
    Paired {
        z: if error > 0.0 { mean / error } else { 0.0 },
        skewed_z: tilted(&differences),
        gain,
        windows: differences.len(),
        decided: [1.0, -1.0].map(|sign| {
            let decides = |d: &&f64| sign * **d > DECISIVE;
            differences.iter().filter(decides).count()
        }),
    }
}

/// Bisections of the tilt: more than a double can tell apart.
const BISECTIONS: usize = 60;

/// How sure a sum of n differences d is of its sign, as a number of standard errors z: n that are drawn from among them have a sum of the other sign with a chance of
/// at most exp(−z²/2) = (min_t mean exp(−t d))ⁿ (Chernoff's bound; the exponential tilting of Efron, *Canadian Journal of Statistics* 9, 1981). Of normal
/// differences z is the mean over its standard error. Capped at [`SUREST`]; negative where the sum is.
fn tilted(differences: &[f64]) -> f64 {
    let largest = differences.iter().fold(0.0_f64, |a, d| a.max(d.abs()));
    let sum: f64 = differences.iter().sum();
    if !(largest > 0.0 && largest.is_finite() && sum != 0.0) {
        return 0.0;
    }
    let scaled: Vec<f64> = differences
        .iter()
        .map(|d| sum.signum() * d / largest)
        .collect();
    let n = scaled.len() as f64;
    let mean = |t: f64| scaled.iter().map(|d| (-t * d).exp()).sum::<f64>() / n;
    let slope = |t: f64| -scaled.iter().map(|d| d * (-t * d).exp()).sum::<f64>();
    // The mean is convex in t and falls at 0.
    let (mut low, mut high) = (0.0, 1.0);
    while slope(high) < 0.0 && high < SUREST * SUREST {
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        match slope(middle) < 0.0 {
            true => low = middle,
            false => high = middle,
        }
    }
    let z = (-2.0 * n * mean(low).ln()).max(0.0).sqrt();
    sum.signum() * z.min(SUREST)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_gain_is_significant_and_a_lucky_window_is_not() {
        let old = vec![0.0; 40];
        let steady: Vec<f64> = (0..40).map(|k| 1.0 + 0.5 * (k as f64).sin()).collect();
        assert!(paired(&steady, &old).z > 10.0);
        let mut lucky = vec![0.0; 40];
        lucky[7] = 500.0;
        assert!(paired(&lucky, &old).z < 2.0);
        assert!(paired(&lucky, &old).skewed_z < 2.0);
        assert_eq!(paired(&lucky, &old).decided, [1, 0]);
        assert_eq!(paired(&old, &lucky).decided, [0, 1]);
        assert_eq!(paired(&steady, &old).decided, [0, 0]);
    }

    #[test]
    fn large_gains_in_few_windows_are_no_doubt_and_large_losses_are() {
        let old = vec![0.0; 40];
        let mut few: Vec<f64> = (0..40).map(|k| (1.7 * k as f64).sin()).collect();
        for k in 0..10 {
            few[4 * k] = 8.0 * 1.6_f64.powi(k as i32);
        }
        let gains = paired(&few, &old);
        assert!(gains.z < 2.5 && gains.skewed_z > 4.0, "{gains:?}");
        few[1] = -0.7 * gains.gain;
        let lost = paired(&few, &old);
        assert!(lost.gain > 0.0 && lost.skewed_z < 1.0, "{lost:?}");
        let losses: Vec<f64> = few.iter().map(|d| -d).collect();
        let other = paired(&losses, &old);
        assert!((other.skewed_z + lost.skewed_z).abs() < 1e-9, "{other:?}");
    }

    #[test]
    fn of_normal_differences_both_are_the_same() {
        let old = vec![0.0; 2000];
        // Quantiles of a normal distribution, by its logistic approximation to a percent.
        let normal = |k: usize| {
            let p = (k as f64 + 0.5) / 2000.0;
            (p / (1.0 - p)).ln() / 1.702 + 0.05
        };
        let new: Vec<f64> = (0..2000).map(normal).collect();
        let found = paired(&new, &old);
        assert!((found.skewed_z / found.z - 1.0).abs() < 0.02, "{found:?}");
        assert_eq!(paired(&old, &old).skewed_z, 0.0);
    }

    #[test]
    fn a_diverging_rival_loses() {
        let old = vec![0.0; 10];
        let mut rival = vec![0.1; 10];
        rival[3] = f64::NEG_INFINITY;
        let result = paired(&rival, &old);
        assert!(result.gain < 0.5 && result.z.is_finite());
        assert!(paired(&[f64::NEG_INFINITY; 10], &old).z < -1e3);
    }
}
