//! A few numbers of many.

/// The value below which the share `q` of `values` lies, linear between two of them; NaN for none.
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = q * sorted.len().saturating_sub(1) as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    match (sorted.get(low), sorted.get(high)) {
        (Some(a), Some(b)) => a + (at - low as f64) * (b - a),
        _ => f64::NAN,
    }
}

/// Wilson's 95 % interval of a share that was seen `hits` times in `of`.
pub fn wilson(hits: usize, of: usize) -> (f64, f64) {
    if of == 0 {
        return (0.0, 1.0);
    }
    let (z, n) = (1.96_f64, of as f64);
    let p = hits as f64 / n;
    let middle = p + z * z / (2.0 * n);
    let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + z * z / n;
    (
        ((middle - half) / scale).max(0.0),
        ((middle + half) / scale).min(1.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_the_values() {
        let values = [3.0, 1.0, 2.0, 4.0];
        assert_eq!(quantile(&values, 0.0), 1.0);
        assert_eq!(quantile(&values, 0.5), 2.5);
        assert_eq!(quantile(&values, 1.0), 4.0);
        assert!(quantile(&[], 0.5).is_nan());
    }

    #[test]
    fn wilsons_interval_is_that_of_the_textbook() {
        // 10 of 10: the lower end is n/(n + z²).
        let (low, high) = wilson(10, 10);
        approx::assert_abs_diff_eq!(low, 10.0 / (10.0 + 1.96 * 1.96), epsilon = 1e-12);
        assert_eq!(high, 1.0);
        let (low, high) = wilson(50, 100);
        approx::assert_abs_diff_eq!(low + high, 1.0, epsilon = 1e-12);
        assert!((0.40..0.41).contains(&low), "{low}");
    }
}
