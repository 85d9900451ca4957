//! The gap over shorter and longer free runs.

use super::curves::FreeRun;
use super::gap::{Errors, finite, overall};
use super::verdict::{CoordinateGap, Horizon};

/// Length of the shortest free runs, s at the usual pace: the beginnings of those by which the gap is measured.
pub const SHORT_S: f64 = 0.1;
/// Length of the longest free runs, s at the usual pace.
pub const LONG_S: f64 = 2.0;

/// The errors of the first `horizon` s of free runs over the coordinates of a gap; none where nothing was measured.
pub fn horizon(free_runs: &[FreeRun], gaps: &[CoordinateGap], horizon: f64) -> Option<Horizon> {
    let within = |run: &FreeRun, k: usize| run.t[k] - run.start < horizon * (1.0 + 1e-9);
    let errors: Vec<Errors> = gaps
        .iter()
        .enumerate()
        .map(|(c, gap)| Errors::of(free_runs, c, gap.noise, within))
        .collect();
    errors.iter().any(|e| e.samples > 0).then(|| Horizon {
        horizon_s: horizon,
        windows: finite(free_runs),
        diverged: free_runs.len() - finite(free_runs),
        before: overall(errors.iter().map(|e| e.before)),
        after: overall(errors.iter().map(|e| e.after)),
        expected: overall(errors.iter().map(|e| e.expected)),
    })
}

#[cfg(test)]
mod tests {
    use super::super::curves::FreeRunCoordinate;
    use super::*;

    fn gap() -> CoordinateGap {
        CoordinateGap {
            name: "q.x".into(),
            unit: "m".into(),
            before: 0.0,
            after: 0.0,
            expected: 1.0,
            noise_floor: 1.0,
            noise: 1e-3,
        }
    }

    /// Free from 1 s on; the model before runs away as 2 mm/s, that after stays 1 mm off.
    fn run() -> FreeRun {
        let t: Vec<f64> = (0..=100).map(|k| 0.5 + 0.01 * f64::from(k)).collect();
        FreeRun {
            run: 0,
            start: t[50],
            coordinates: vec![FreeRunCoordinate {
                measured: vec![0.0; t.len()],
                before: t.iter().map(|t| 2e-3 * (t - 1.0)).collect(),
                after: vec![1e-3; t.len()],
                of_start: vec![0.75; t.len()],
                counts: (0..t.len()).map(|k| k > 50).collect(),
            }],
            t,
        }
    }

    #[test]
    fn an_error_that_grows_with_time_grows_with_the_horizon() {
        let at = |h: f64| horizon(&[run()], &[gap()], h).unwrap();
        let (short, long) = (at(0.1), at(0.4));
        // Root mean square of 1 … n times 0.02.
        let expected = |n: i32| {
            let squares: f64 = (1..=n).map(|k| (0.02 * f64::from(k)).powi(2)).sum();
            (squares / f64::from(n)).sqrt()
        };
        assert!((short.before - expected(10)).abs() < 1e-9, "{short:?}");
        assert!((long.before - expected(40)).abs() < 1e-9, "{long:?}");
        assert!((short.after - 1.0).abs() < 1e-9 && (long.after - 1.0).abs() < 1e-9);
        assert!((long.expected - 1.25).abs() < 1e-9, "a noise and 3/4 more");
        assert_eq!((long.windows, long.diverged), (1, 0));
    }

    #[test]
    fn a_run_that_diverges_is_counted_and_does_not_count() {
        let mut gone = run();
        gone.coordinates[0].after.clear();
        let both = horizon(&[run(), gone.clone()], &[gap()], 0.4).unwrap();
        let one = horizon(&[run()], &[gap()], 0.4).unwrap();
        assert_eq!((both.windows, both.diverged), (1, 1));
        assert_eq!(both.before, one.before);
        assert_eq!(horizon(&[gone], &[gap()], 0.4), None);
    }
}
