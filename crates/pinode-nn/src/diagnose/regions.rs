//! The gap inside and outside the region in which the missing force is large.

use super::curves::{FreeRun, ResidualForce};
use super::gap::Errors;
use super::signals::TIED;
use super::verdict::{CoordinateGap, Region, RegionErrors};

/// Bins whose mean square force is more than this part of the largest one are in the region.
const LARGE: f64 = 0.5;

/// For each missing force that follows a signal: the ranges of the signal in which it is large, and the errors of free runs there and
/// elsewhere. None where the force is large everywhere alike, or where the free runs know only one side.
pub fn regions(
    residuals: &[ResidualForce],
    free_runs: &[FreeRun],
    gaps: &[CoordinateGap],
) -> Vec<Region> {
    let of = |residual: &ResidualForce| {
        let name = |gap: &CoordinateGap| gap.name.strip_prefix("q.") == Some(&residual.coordinate);
        let c = gaps.iter().position(name)?;
        let tied = residual.explained_by.first().is_some_and(|s| s.1 >= TIED);
        let ranges = tied.then(|| large(residual))??;
        let (signal, unit, values) = &residual.best_signal;
        let interval = spacing(residual);
        let inside = |run: &FreeRun, k: usize| {
            nearest(residual, run.run, run.t[k], interval).map(|i| is_in(&ranges, values[i]))
        };
        let errors = |wanted| {
            let keep = |run: &FreeRun, k: usize| inside(run, k) == Some(wanted);
            Errors::of(free_runs, c, gaps[c].noise, keep)
        };
        let (inside, outside) = (errors(true), errors(false));
        let square = |i: &usize| residual.force[*i].powi(2);
        let all = 0..residual.force.len();
        let own: Vec<usize> = all.clone().filter(|&i| is_in(&ranges, values[i])).collect();
        let total: f64 = all.map(|i| square(&i)).sum();
        (inside.samples > 0 && outside.samples > 0).then(|| Region {
            coordinate: residual.coordinate.clone(),
            signal: signal.clone(),
            unit: unit.clone(),
            force_share: own.iter().map(square).sum::<f64>() / total,
            time_share: own.len() as f64 / residual.force.len() as f64,
            ranges,
            inside: said(inside),
            outside: said(outside),
        })
    };
    residuals.iter().filter_map(of).collect()
}

fn said(errors: Errors) -> RegionErrors {
    RegionErrors {
        before: errors.before,
        after: errors.after,
        samples: errors.samples,
    }
}

/// The ranges of the best signal in which the force is large; none where that is everywhere.
fn large(residual: &ResidualForce) -> Option<Vec<[f64; 2]>> {
    const BINS: usize = 12;
    let values = &residual.best_signal.2;
    let squares: Vec<f64> = residual.force.iter().map(|f| f * f).collect();
    let bins = crate::bins::along(values, &squares, BINS);
    let limit = LARGE * bins.iter().map(|bin| bin.1).fold(0.0, f64::max);
    let mut ranges: Vec<[f64; 2]> = Vec::new();
    let mut joins = false;
    for (range, mean) in &bins {
        let is_large = *mean > limit;
        match ranges.last_mut().filter(|_| joins && is_large) {
            Some(last) => last[1] = range[1],
            None if is_large => ranges.push(*range),
            None => {}
        }
        joins = is_large;
    }
    let everywhere = bins.iter().all(|(_, mean)| *mean > limit);
    (!ranges.is_empty() && !everywhere).then_some(ranges)
}

fn is_in(ranges: &[[f64; 2]], value: f64) -> bool {
    ranges.iter().any(|r| (r[0]..=r[1]).contains(&value))
}

/// Typical time between two samples of the force, s.
fn spacing(residual: &ResidualForce) -> f64 {
    let pairs = residual.t.windows(2).zip(residual.run.windows(2));
    let mut steps: Vec<f64> = pairs
        .filter(|(_, run)| run[0] == run[1])
        .map(|(t, _)| t[1] - t[0])
        .collect();
    super::audit::median(&mut steps)
}

/// The sample of the force nearest to a time, where there is one within its spacing.
fn nearest(residual: &ResidualForce, run: usize, t: f64, interval: f64) -> Option<usize> {
    let first = residual.run.partition_point(|&r| r < run);
    let last = residual.run.partition_point(|&r| r <= run);
    let after = first + residual.t[first..last].partition_point(|&x| x < t);
    let away = |&i: &usize| (residual.t[i] - t).abs();
    [after.checked_sub(1), Some(after)]
        .into_iter()
        .flatten()
        .filter(|i| (first..last).contains(i) && away(i) <= interval)
        .min_by(|a, b| away(a).total_cmp(&away(b)))
}

#[cfg(test)]
mod tests {
    use super::super::curves::FreeRunCoordinate;
    use super::*;

    /// A force at low speed only, and a free run of which the model before is wrong by three noises there and right elsewhere.
    #[test]
    fn the_error_is_told_apart_inside_and_outside_of_where_the_force_is_large() {
        let t: Vec<f64> = (0..2000).map(|k| 0.01 * f64::from(k)).collect();
        let v: Vec<f64> = t.iter().map(|t| (1.3 * t).sin()).collect();
        let slow = |v: f64| v.abs() < 0.2;
        let force = v.iter().map(|&v| if slow(v) { 1.0 } else { 0.0 });
        let residual = ResidualForce {
            coordinate: "x".into(),
            unit: "N".into(),
            run: vec![0; t.len()],
            force: force.collect(),
            explained_by: vec![("velocity of x".into(), 0.9)],
            best_signal: ("velocity of x".into(), "m/s".into(), v.clone()),
            profiles: Vec::new(),
            t: t.clone(),
        };
        let off = v.iter().map(|&v| if slow(v) { 3e-3 } else { 1e-3 });
        let run = FreeRun {
            run: 0,
            start: 0.0,
            coordinates: vec![FreeRunCoordinate {
                measured: vec![0.0; t.len()],
                before: off.collect(),
                after: vec![1e-3; t.len()],
                of_start: vec![0.0; t.len()],
                counts: vec![true; t.len()],
            }],
            t,
        };
        let gap = CoordinateGap {
            name: "q.x".into(),
            unit: "m".into(),
            before: 0.0,
            after: 0.0,
            expected: 1.0,
            noise_floor: 1.0,
            noise: 1e-3,
        };
        let found = regions(
            std::slice::from_ref(&residual),
            std::slice::from_ref(&run),
            std::slice::from_ref(&gap),
        );
        let [region] = found.as_slice() else {
            panic!("{found:?}")
        };
        let [[from, to]] = region.ranges[..] else {
            panic!("{region:?}")
        };
        // Bins are a twelfth of the samples wide: at the borders they hold both.
        assert!((-0.4..=-0.1).contains(&from) && (0.1..=0.4).contains(&to));
        assert!(region.force_share > 0.8, "{region:?}");
        assert!(region.inside.before > 2.3 && region.outside.before < 1.7);
        assert!((region.inside.after - 1.0).abs() < 1e-9);
        assert_eq!(region.inside.samples + region.outside.samples, 2000);

        // The same force everywhere: there is no region.
        let alike = ResidualForce {
            force: vec![1.0; 2000],
            ..residual
        };
        assert_eq!(regions(&[alike], &[run], &[gap]), Vec::new());
    }
}
