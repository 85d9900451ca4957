//! Local polynomials through a recording: first guesses of states, and accelerations to look at.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};

use super::audit::median;
use super::pace::WINDOW_S;
use crate::hybrid::Reading;
use crate::shooting::{ObservedRun, wrap_angle};

/// Position, velocity and acceleration of each coordinate at each sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothed {
    /// One column a coordinate, m or rad; angles unwrapped.
    pub q: Vec<Vec<f64>>,
    /// Velocities.
    pub v: Vec<Vec<f64>>,
    /// Accelerations.
    pub a: Vec<Vec<f64>>,
}

impl Smoothed {
    /// State (q, v) at sample `k`.
    pub fn state(&self, k: usize) -> Vec<f64> {
        let at = |columns: &[Vec<f64>]| columns.iter().map(|c| c[k]).collect::<Vec<_>>();
        [at(&self.q), at(&self.v)].concat()
    }

    /// The state (q, v) behind `readings`, one a coordinate, at sample `k` of the times `t`. What a sensor reads late is looked up where it
    /// reads it, by the parabola at the sample nearest to that.
    pub(crate) fn behind(&self, readings: &[Reading], t: &[f64], k: usize) -> Vec<f64> {
        let n = readings.len();
        let mut state = self.state(k);
        for (c, reading) in readings.iter().enumerate() {
            let time = t[k] + reading.delay;
            let later = k + t[k..].partition_point(|&t| t < time);
            let apart = |&j: &usize| (t[j] - time).abs();
            let near = (later.saturating_sub(1).max(k)..t.len().min(later + 1))
                .min_by(|i, j| apart(i).total_cmp(&apart(j)))
                .unwrap_or(k);
            let (x, a) = (time - t[near], self.a[c][near]);
            let (y, rate) = (self.q[c][near], self.v[c][near]);
            state[c] = (y + x * (rate + 0.5 * x * a) - reading.offset) / reading.factor;
            state[n + c] = (rate + x * a) / reading.factor;
        }
        state
    }
}

/// The coordinates, each wrapping or not, by cubics fitted by least squares to the samples within `half_width` s (and at least three on either side) of every sample.
pub fn smooth(run: &ObservedRun, wraps: &[bool], half_width: f64) -> Smoothed {
    let nv = wraps.len();
    let mut smoothed = Smoothed {
        q: Vec::with_capacity(nv),
        v: Vec::with_capacity(nv),
        a: Vec::with_capacity(nv),
    };
    for (c, &wraps) in wraps.iter().enumerate() {
        let y = if wraps {
            unwrapped(&run.y[c])
        } else {
            run.y[c].clone()
        };
        let fits: Vec<[f64; 3]> = (0..y.len())
            .map(|k| local_cubic(&run.t, &y, &run.valid[c], k, half_width))
            .collect();
        smoothed.q.push(fits.iter().map(|f| f[0]).collect());
        smoothed.v.push(fits.iter().map(|f| f[1]).collect());
        smoothed.a.push(fits.iter().map(|f| f[2]).collect());
    }
    smoothed
}

/// Readings of an angle whose middle 98 % span more than so many turns are not folded: their turns are counted.
const UNFOLDED: f64 = 1.5;

/// So many turns in a window are many.
const MANY: f64 = 5.0;

/// The angle without its jumps by whole turns.
pub fn unwrapped(y: &[f64]) -> Vec<f64> {
    let mut out = Vec::with_capacity(y.len());
    let mut last = match y.first() {
        Some(&first) => first,
        None => return out,
    };
    for &angle in y {
        last += wrap_angle(angle - last);
        out.push(last);
    }
    out
}

/// Whether readings of an angle at times t are of a rotor whose turns are counted, and that goes over many of them within a window: half of one is soon what a model
/// leaves of them, and that is no folded angle either. What tumbles goes over two or three.
pub fn outruns_folding(t: &[f64], y: &[f64]) -> bool {
    let steps = t.windows(2).zip(y.windows(2));
    let mut speeds: Vec<f64> = steps
        .map(|(t, y)| (y[1] - y[0]).abs() / (t[1] - t[0]))
        .collect();
    goes_over_turns(y) && median(&mut speeds) * WINDOW_S > MANY * TAU
}

fn goes_over_turns(y: &[f64]) -> bool {
    let mut sorted = y.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = |percent: usize| sorted.get(sorted.len() * percent / 100).copied();
    match (at(1), at(99)) {
        (Some(low), Some(high)) => high - low > UNFOLDED * TAU,
        _ => false,
    }
}

/// Value, slope and curvature at sample `k`.
fn local_cubic(t: &[f64], y: &[f64], valid: &[bool], k: usize, half_width: f64) -> [f64; 3] {
    let mut first = k;
    while first > 0 && (k - first < 3 || t[k] - t[first - 1] <= half_width) {
        first -= 1;
    }
    let mut last = k;
    while last + 1 < t.len() && (last - k < 3 || t[last + 1] - t[k] <= half_width) {
        last += 1;
    }
    let width = (t[last] - t[k]).max(t[k] - t[first]).max(f64::MIN_POSITIVE);
    let within = (first..=last).filter(|&i| valid[i]);
    let points = within.map(|i| ((t[i] - t[k]) / width, y[i] - y[k]));
    match polynomial::<4>(points) {
        Some(x) => [y[k] + x[0], x[1] / width, 2.0 * x[2] / (width * width)],
        // Too few valid samples around: the plain difference.
        None => [
            y[k],
            (y[last] - y[first]) / (t[last] - t[first]).max(f64::MIN_POSITIVE),
            0.0,
        ],
    }
}

/// The coefficients of 1, s, s², … of the polynomial through points (s, y) by least squares; `None` where they do not determine it.
pub fn polynomial<const N: usize>(
    points: impl Iterator<Item = (f64, f64)>,
) -> Option<SVector<f64, N>> {
    let mut normal = SMatrix::<f64, N, N>::zeros();
    let mut rhs = SVector::<f64, N>::zeros();
    for (s, y) in points {
        let mut power = 1.0;
        let row = SVector::<f64, N>::from_fn(|_, _| {
            let this = power;
            power *= s;
            this
        });
        normal += row * row.transpose();
        rhs += row * y;
    }
    Some(normal.cholesky()?.solve(&rhs))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shooting::Finer;

    #[test]
    fn a_cubic_motion_is_met_exactly_across_the_wrap() {
        let t: Vec<f64> = (0..60).map(|k| k as f64 * 0.02).collect();
        let q = |t: f64| 1.0 + 2.0 * t - 3.0 * t * t + 4.0 * t.powi(3);
        let y = t.iter().map(|&t| wrap_angle(q(t))).collect();
        let run = ObservedRun {
            finer: Finer::default(),
            valid: vec![vec![true; t.len()]],
            u: vec![],
            y: vec![y],
            t,
        };
        let smoothed = smooth(&run, &[true], 0.06);
        for k in [0, 20, 59] {
            let t = run.t[k];
            assert!((smoothed.q[0][k] - q(t)).abs() < 1e-9);
            assert!((smoothed.v[0][k] - (2.0 - 6.0 * t + 12.0 * t * t)).abs() < 1e-8);
            assert!((smoothed.a[0][k] - (-6.0 + 24.0 * t)).abs() < 1e-6);
        }
    }

    /// What a model of a rotor of 250 rad/s leaves in a window was folded: 7 rad were less than one.
    #[test]
    fn a_fast_rotor_whose_turns_are_counted_is_no_folded_angle_and_what_tumbles_may_be() {
        let t: Vec<f64> = (0..400).map(|k| 5e-3 * f64::from(k)).collect();
        let turning = |speed: f64| t.iter().map(|t| speed * t).collect::<Vec<f64>>();
        let folded: Vec<f64> = turning(250.0).into_iter().map(wrap_angle).collect();
        assert!(outruns_folding(&t, &turning(250.0)));
        assert!(!outruns_folding(&t, &turning(25.0)) && !outruns_folding(&t, &folded));
    }
}
