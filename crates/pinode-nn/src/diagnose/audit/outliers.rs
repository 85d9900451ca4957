//! Samples that stand alone.

use super::noise::median;

/// At most this share of the samples can be outliers: what happens more often is how the sensor is.
const MOST_OUTLIERS: f64 = 0.005;

/// False where a sample stands alone: away from the cubic through its four neighbours,
///
/// e_k = y_k − (−y_{k−2} + 4 y_{k−1} + 4 y_{k+1} − y_{k+2}) / 6,
///
/// by more than eight times the noise, by more than eight times what is usual around it (fast motion is no fault), and by more than
/// its neighbours, whom a glitch pulls along. Twice as far, and so on, while that holds for too many samples.
pub fn without_outliers(y: &[f64], noise: f64) -> Vec<bool> {
    let mut factor = 8.0;
    loop {
        let valid = within(y, noise, factor);
        let outliers = valid.iter().filter(|v| !**v).count();
        if outliers <= 3 || (outliers as f64) < MOST_OUTLIERS * y.len() as f64 || factor > 1e6 {
            return valid;
        }
        factor *= 2.0;
    }
}

fn within(y: &[f64], noise: f64, factor: f64) -> Vec<bool> {
    let mut valid = vec![true; y.len()];
    let away: Vec<f64> = y
        .windows(5)
        .map(|w| (w[2] - (4.0 * (w[1] + w[3]) - w[0] - w[4]) / 6.0).abs())
        .collect();
    for (i, &e) in away.iter().enumerate() {
        let near = away.get(i.saturating_sub(2)..(i + 3).min(away.len()));
        let largest = near.is_some_and(|near| near.iter().all(|&other| other <= e));
        if e <= factor * noise || !largest {
            continue;
        }
        let first = i.saturating_sub(15);
        let mut around: Vec<f64> = (first..(i + 16).min(away.len()))
            .filter(|k| k.abs_diff(i) > 2)
            .map(|k| away[k])
            .collect();
        valid[i + 2] = e <= factor * median(&mut around);
    }
    valid
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_glitch_is_masked_and_a_fast_swing_is_not() {
        let mut y: Vec<f64> = (0..500).map(|k| (10.0 * k as f64 * 0.02).sin()).collect();
        assert!(without_outliers(&y, 1e-3).iter().all(|v| *v));
        y[100] += 0.5;
        let valid = without_outliers(&y, 1e-3);
        assert!(!valid[100] && valid.iter().filter(|v| !**v).count() == 1);
    }
}
