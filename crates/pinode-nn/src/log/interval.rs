//! How far samples are apart.

/// Sample intervals that are apart by more than this share are different.
const NEAR: f64 = 0.01;

/// The median time between samples, s; none of a single one.
pub(crate) fn typical_interval(t: &[f64]) -> Option<f64> {
    typical(t.windows(2).map(|p| p[1] - p[0]).collect())
}

/// The median of times between samples.
pub(crate) fn typical(mut intervals: Vec<f64>) -> Option<f64> {
    intervals.sort_by(f64::total_cmp);
    intervals.get(intervals.len() / 2).copied()
}

/// Whether what was some samples ago in the one log was as long ago in the other, by their sample intervals.
pub(crate) fn same_rate(interval: f64, other: f64) -> bool {
    (interval / other - 1.0).abs() <= NEAR
}
