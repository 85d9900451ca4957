//! Readings that jump and stay there while the motion goes on: an encoder that slipped on its shaft or lost counts.
//!
//! Around each sample k, with τ_j = j − 5.5, j = 0 … 11, the reading is
//!
//! y_{k−6+j} = c₀ + c₁ τ_j + c₂ τ_j² + c₃ τ_j³ + J [j ≥ 6],
//!
//! a jump J between the samples k − 1 and k of a motion that is the same on both sides. What a mechanism does at once changes its velocity, where
//! it is struck, and its acceleration, where a force sets in: a kink in place of the jump, at some τ = s between the two samples.
//! What jumps often does so by itself: friction that lets go of a belt, a light motor under pulses. Rows that a log has lost are a jump by what the motion
//! goes in a few samples.

use std::ops::Range;

use nalgebra::{SMatrix, SVector};

use super::super::verdict::DataFault;
use super::noise::median;
use crate::log::Run;

/// Samples on either side.
const SIDE: usize = 6;
const SPAN: usize = 2 * SIDE;
/// A jump is so many times the sensor's noise, and what is left around it, or more.
const JUMP: f64 = 12.0;
/// A kink leaves so many times what a jump leaves, and half the noise.
const NO_KINK: f64 = 4.0;
/// In one interval the motion goes by so many times the noise, and in so many seconds by the jump: what rests before and behind may have moved meanwhile.
const MOVING: (f64, f64) = (1.0, 1.0);
/// Nor is it a slip by what the motion goes in so many intervals: rows that are lost.
const LOST_ROWS: f64 = 6.0;
/// What jumps more often in a recording does so by itself.
const MOST: usize = 3;
/// A kink is asked for at so many places between the two samples.
const PLACES: usize = 5;
/// An interval so many times the usual one is a gap.
const GAP: f64 = 1.5;

/// A jump of a sensor's readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slip {
    /// The first sample behind it.
    pub at: usize,
    /// By how much.
    pub by: f64,
}

/// An orthonormal basis of functions of τ, by which what is left of readings is told.
struct Shape<const N: usize>(SMatrix<f64, SPAN, N>);

impl<const N: usize> Shape<N> {
    fn of(function: impl Fn(f64, usize) -> f64) -> Self {
        let columns = SMatrix::<f64, SPAN, N>::from_fn(|j, column| function(tau(j), column));
        // The columns are independent, and few: Gram and Schmidt's way twice is exact to rounding.
        let mut basis = columns;
        for _ in 0..2 {
            for n in 0..N {
                for m in 0..n {
                    let along = basis.column(m).dot(&basis.column(n));
                    let other = basis.column(m) * along;
                    let mut own = basis.column_mut(n);
                    own -= other;
                }
                let norm = basis.column(n).norm();
                basis.column_mut(n).unscale_mut(norm);
            }
        }
        Shape(basis)
    }

    /// What is left of `y`, root mean square by degrees of freedom.
    fn left(&self, y: &SVector<f64, SPAN>) -> f64 {
        let rest = y - self.0 * (self.0.transpose() * y);
        (rest.norm_squared() / (SPAN - N) as f64).sqrt()
    }
}

fn tau(j: usize) -> f64 {
    j as f64 - (SIDE as f64 - 0.5)
}

/// 1, τ, τ², τ³, as powers.
fn power(tau: f64, column: usize) -> f64 {
    (0..column).fold(1.0, |power, _| power * tau)
}

/// The slips of a sensor with this noise; `y` without turns, held over `holds`, [first, last] of each.
pub fn slips(t: &[f64], y: &[f64], holds: &[[usize; 2]], noise: f64) -> Vec<Slip> {
    let jump = Shape::<5>::of(|tau, column| match column {
        4 => f64::from(u8::from(tau > 0.0)),
        _ => power(tau, column),
    });
    let kinks: Vec<Shape<6>> = (0..PLACES)
        .map(|i| i as f64 / (PLACES - 1) as f64 - 0.5)
        .map(|s| {
            Shape::of(move |tau, column| match column {
                4 => (tau - s).max(0.0),
                5 => (tau - s).max(0.0).powi(2),
                _ => power(tau, column),
            })
        })
        .collect();
    let smooth = Shape::<4>::of(power);
    let mut intervals: Vec<f64> = t.windows(2).map(|p| p[1] - p[0]).collect();
    let interval = median(&mut intervals);
    let longest = GAP * interval;
    let mut found: Vec<(Slip, f64)> = Vec::new();
    for first in 0..=y.len().saturating_sub(SPAN) {
        let end = first + SPAN;
        let (Some(own), Some(times)) = (y.get(first..end), t.get(first..end)) else {
            break;
        };
        let step = own[SIDE] - own[SIDE - 1];
        let is_held = || holds.iter().any(|&[a, b]| a < end && b + 1 >= first);
        let has_gap = || times.windows(2).any(|p| p[1] - p[0] > longest);
        if step.abs() < 0.5 * JUMP * noise || has_gap() || is_held() {
            continue;
        }
        let own = SVector::<f64, SPAN>::from_column_slice(own);
        let left = jump.left(&own);
        let least = NO_KINK * left.max(0.5 * noise);
        let no_kink = || kinks.iter().all(|kink| kink.left(&own) > least);
        if smooth.left(&own) < least || !no_kink() {
            continue;
        }
        let by = size(&jump, &own);
        let rate = step - by;
        let moves = rate.abs() > (MOVING.0 * noise).max(by.abs() * interval / MOVING.1);
        let lost_rows = rate * by > 0.0 && by.abs() < LOST_ROWS * rate.abs();
        if by.abs() > JUMP * noise.max(left) && moves && !lost_rows {
            let at = first + SIDE;
            found.push((Slip { at, by }, left));
        }
    }
    // Of several in one span the one that leaves least.
    let mut slips: Vec<(Slip, f64)> = Vec::new();
    for (slip, left) in found {
        match slips.last_mut() {
            Some(last) if slip.at - last.0.at < SPAN => {
                if left < last.1 {
                    *last = (slip, left);
                }
            }
            _ => slips.push((slip, left)),
        }
    }
    match slips.len() {
        0..=MOST => slips.into_iter().map(|(slip, _)| slip).collect(),
        _ => Vec::new(),
    }
}

/// J, by what of the last column of the basis is in `y`.
fn size(jump: &Shape<5>, y: &SVector<f64, SPAN>) -> f64 {
    let own = jump.0.column(4);
    let unit: f64 = own.iter().skip(SIDE).sum();
    own.dot(y) / unit
}

/// The longest stretch of these samples without a slip in it; the first of several.
fn longest(samples: Range<usize>, slips: &[Slip]) -> Range<usize> {
    let inside = slips.iter().map(|slip| slip.at);
    let inside = inside.filter(|at| samples.contains(at));
    let mut ends: Vec<usize> = inside.chain([samples.end]).collect();
    ends.sort_unstable();
    let mut longest = samples.start..samples.start;
    let mut start = samples.start;
    for end in ends {
        if end - start > longest.len() {
            longest = start..end;
        }
        start = end;
    }
    longest
}

/// A sensor's slips, recording by recording.
pub struct Slipped {
    /// The slips of each recording.
    pub slips: Vec<Vec<Slip>>,
    /// The column of the log.
    pub column: String,
    /// Of its readings.
    pub unit: String,
}

/// Of the samples of each recording that count otherwise the longest stretch in which no sensor slips.
pub fn kept(counting: Vec<Range<usize>>, sensors: &[Slipped]) -> Vec<Range<usize>> {
    let of_run = |(r, samples)| {
        let own = sensors.iter().filter_map(|sensor| sensor.slips.get(r));
        let all: Vec<Slip> = own.flatten().copied().collect();
        longest(samples, &all)
    };
    counting.into_iter().enumerate().map(of_run).collect()
}

/// What is said of the sensors that slipped, of which the stretches `kept` are taken.
pub fn faults(runs: &[&Run], sensors: &[Slipped], kept: &[Range<usize>]) -> Vec<DataFault> {
    let fault = |sensor: &Slipped| {
        let mut lost = [0, 0];
        let mut when = Vec::new();
        let mut first = None;
        for ((run, slips), kept) in runs.iter().zip(&sensor.slips).zip(kept) {
            if let Some(slip) = slips.first() {
                first = first.or(Some(slip.by));
                lost[0] += run.len() - kept.len();
                lost[1] += run.len();
            }
            when.extend(slips.iter().map(|s| [run.t[s.at - 1], run.t[s.at]]));
        }
        let [lost, samples] = lost;
        Some(DataFault {
            kind: "slip".into(),
            column: sensor.column.clone(),
            detail: format!(
                "the readings jump {} and stay there while the motion goes on, first by {:.3e} {}: the sensor slipped or lost counts, and its \
                 zero is another one from there on. The longest stretch without a slip is taken; {lost} of {samples} samples are left out",
                match when.len() {
                    1 => "once".to_owned(),
                    times => format!("{times} times"),
                },
                first?,
                sensor.unit,
            ),
            when: when.into_iter().take(super::MOST_LISTED).collect(),
        })
    };
    sensors.iter().filter_map(fault).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::pseudo;

    const NOISE: f64 = 1e-3;

    fn times(n: usize) -> Vec<f64> {
        (0..n).map(|k| 0.02 * k as f64).collect()
    }

    /// What is found in a motion read every 20 ms.
    fn found(n: usize, noise: f64, motion: impl Fn(f64) -> f64) -> Vec<Slip> {
        let t = times(n);
        let y = t.iter().enumerate();
        let y: Vec<f64> = y
            .map(|(k, &t)| motion(t) + 3.0_f64.sqrt() * noise * pseudo(k, 0.3))
            .collect();
        slips(&t, &y, &[], noise)
    }

    #[test]
    fn an_encoder_that_slips_is_found_with_time_and_size() {
        for (noise, by) in [(NOISE, 0.5), (NOISE, -0.4), (1e-6, -0.02)] {
            let slipped = |t: f64| (3.0 * t).sin() + if t > 10.05 { by } else { 0.0 };
            let slips = found(1500, noise, slipped);
            let [slip] = slips[..] else {
                panic!("{by}: {slips:?}");
            };
            assert_eq!(slip.at, 503);
            assert!((slip.by - by).abs() < 0.1 * by.abs(), "{slip:?}");
        }
    }

    #[test]
    fn blows_steps_of_force_and_what_creeps_between_rests_are_no_slips() {
        // A ball that bounces every 0.5 s with any phase, e = 0.6 and a pull that is another one behind.
        let bounce = |t: f64| {
            let t = (t + 0.007) % 0.5;
            (3.0 * t - 6.0 * t * t) * if t < 0.25 { 1.0 } else { 0.6 }
        };
        assert_eq!(found(1500, NOISE, bounce), []);
        let plastic = |t: f64| (2.0 * t).sin().min(0.7);
        assert_eq!(found(1500, NOISE, plastic), []);
        let pushed = |t: f64| 0.5 * (if t > 7.013 { 30.0 } else { -2.0 }) * (t - 7.013).powi(2);
        assert_eq!(found(700, NOISE, pushed), []);
        // From rest to rest within an interval.
        let stick = |t: f64| 0.2 * t.floor();
        assert_eq!(found(1500, NOISE, stick), []);
        let fast = |t: f64| (40.0 * t).sin();
        assert_eq!(found(1500, NOISE, fast), []);
        assert_eq!(found(1500, 1e-6, fast), []);
        // A spring that lets go of a belt every second; and rows that are lost.
        let belt = |t: f64| 0.3 * (t - 0.8 * t.floor());
        assert_eq!(found(1500, NOISE, belt), []);
        let lost = |t: f64| (3.0 * (if t > 10.05 { t + 0.06 } else { t })).sin();
        assert_eq!(found(1500, NOISE, lost), []);
        // A coarse encoder, of 6 mrad.
        let coarse = |t: f64| ((3.0 * t).sin() / 6e-3).round() * 6e-3;
        assert_eq!(found(1500, 6e-3 / 12.0_f64.sqrt(), coarse), []);
    }

    #[test]
    fn the_longest_stretch_is_taken() {
        let slip = |at| Slip { at, by: 1.0 };
        assert_eq!(longest(0..100, &[]), 0..100);
        assert_eq!(longest(0..100, &[slip(30)]), 30..100);
        assert_eq!(longest(10..100, &[slip(80), slip(30), slip(5)]), 30..80);
    }
}
