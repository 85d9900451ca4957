//! How well a fitted model explains each window, and whether one explains them better than another.

use std::f64::consts::LN_2;

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

/// A paired comparison of two models over the same windows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paired {
    /// How sure the sign of the gain is, in standard errors. See [`sureness`].
    pub z: f64,
    /// Sum of the differences, nats.
    pub gain: f64,
    /// Number of windows compared.
    pub windows: usize,
}

/// Where all of so few windows are for one model that they could be no surer, they are as sure as this.
const ALL: f64 = 4.4;

impl Paired {
    /// z, where there are so few windows that it cannot be [`ALL`] by that share of what it can be.
    pub fn z_in_reach(&self) -> f64 {
        let most = (2.0 * self.windows as f64 * LN_2).sqrt();
        self.z * (ALL / most.max(f64::MIN_POSITIVE)).max(1.0)
    }
}

/// Differences d_w = l_w(new) − l_w(old) and their sum. A window in which the new model diverges counts as a loss as large as the largest difference
/// seen; one in which only the old one diverges counts nothing.
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
    Paired {
        z: sureness(&differences),
        gain: differences.iter().sum(),
        windows: differences.len(),
    }
}

/// Bisections of t: more than a double can tell apart.
const BISECTIONS: usize = 60;

/// How sure a sum of differences d is of its sign, as a number of standard errors z: if each difference had either sign by chance, as where both models are as good,
/// their sum would be as large with a chance of at most exp(−z²/2), z² = 2 max_t Σ t d − ln cosh t d (Fisher's test of random signs, *The Design of Experiments*
/// 21, 1935, with Chernoff's bound). Of many small and scattered differences it is the mean over its standard error; few large gains are not doubted for being of
/// several sizes, and n differences of one sign have z = √(2 n ln 2), be they all the same. Negative where the sum is.
fn sureness(differences: &[f64]) -> f64 {
    let largest = differences.iter().fold(0.0_f64, |a, d| a.max(d.abs()));
    let sum: f64 = differences.iter().sum();
    if !(largest > 0.0 && largest.is_finite() && sum != 0.0) {
        return 0.0;
    }
    let scaled: Vec<f64> = differences
        .iter()
        .map(|d| sum.signum() * d / largest)
        .collect();
    // It is concave in t and rises from 0; where no difference is of the other sign it rises for ever, to ln 2 of each.
    let slope = |t: f64| {
        scaled
            .iter()
            .map(|d| d * (1.0 - (t * d).tanh()))
            .sum::<f64>()
    };
    let (mut low, mut high) = (0.0, 1.0);
    while slope(high) > 0.0 {
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        match slope(middle) > 0.0 {
            true => low = middle,
            false => high = middle,
        }
    }
    // t d − ln cosh t d = ln 2 − ln(1 + exp(−2 t d)), which overflows for none.
    let gained = |d: &f64| {
        let x = low * d;
        (x - x.abs()) + LN_2 - (-2.0 * x.abs()).exp().ln_1p()
    };
    let exponent: f64 = scaled.iter().map(gained).sum();
    sum.signum() * (2.0 * exponent).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_gain_is_significant_and_a_lucky_window_is_not() {
        let old = vec![0.0; 40];
        let steady: Vec<f64> = (0..40).map(|k| 1.0 + 0.5 * (k as f64).sin()).collect();
        assert!(paired(&steady, &old).z > 7.0);
        let mut lucky = vec![0.0; 40];
        lucky[7] = 500.0;
        assert!(paired(&lucky, &old).z < 2.0);
    }

    #[test]
    fn large_gains_in_few_windows_are_no_doubt_and_large_losses_are() {
        let old = vec![0.0; 40];
        let mut few: Vec<f64> = (0..40).map(|k| (1.7 * k as f64).sin()).collect();
        for k in 0..10 {
            few[4 * k] = 8.0 * 1.6_f64.powi(k as i32);
        }
        let gains = paired(&few, &old);
        let mean = gains.gain / 40.0;
        let scatter = few.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / 39.0;
        assert!(mean / (scatter / 40.0).sqrt() < 2.5, "{gains:?}");
        assert!(gains.z > 3.0, "{gains:?}");
        few[1] = -0.7 * gains.gain;
        let lost = paired(&few, &old);
        assert!(lost.gain > 0.0 && lost.z < 1.0, "{lost:?}");
        let losses: Vec<f64> = few.iter().map(|d| -d).collect();
        let other = paired(&losses, &old);
        assert!((other.z + lost.z).abs() < 1e-9, "{other:?}");
    }

    #[test]
    fn gains_of_one_sign_are_as_sure_as_there_are_many_of_them() {
        for n in [1, 3, 12, 40] {
            let expected = (2.0 * n as f64 * 2.0_f64.ln()).sqrt();
            let same = paired(&vec![2.0; n], &vec![0.0; n]);
            assert!((same.z - expected).abs() < 1e-9, "{same:?}: {expected}");
            let gains: Vec<f64> = (0..n).map(|k| 3.0_f64.powi(k as i32 % 8)).collect();
            let many = paired(&gains, &vec![0.0; n]);
            assert!((many.z - expected).abs() < 1e-9, "{many:?}: {expected}");
        }
    }

    #[test]
    fn of_normal_differences_it_is_the_mean_over_its_standard_error() {
        let old = vec![0.0; 2000];
        // Quantiles of a normal distribution, by its logistic approximation to a percent.
        let normal = |k: usize| {
            let p = (k as f64 + 0.5) / 2000.0;
            (p / (1.0 - p)).ln() / 1.702 + 0.05
        };
        let new: Vec<f64> = (0..2000).map(normal).collect();
        let found = paired(&new, &old);
        let variance = new.iter().map(|d| (d - 0.05).powi(2)).sum::<f64>() / 1999.0;
        let expected = 0.05 / (variance / 2000.0).sqrt();
        assert!(
            (found.z / expected - 1.0).abs() < 0.03,
            "{found:?}: {expected}"
        );
        assert_eq!(paired(&old, &old).z, 0.0);
    }

    #[test]
    fn a_diverging_rival_loses() {
        let old = vec![0.0; 10];
        let mut rival = vec![0.1; 10];
        rival[3] = f64::NEG_INFINITY;
        let result = paired(&rival, &old);
        assert!(result.gain < 0.5 && result.z.is_finite());
        assert!(paired(&[f64::NEG_INFINITY; 10], &old).z < -3.0);
    }
}
