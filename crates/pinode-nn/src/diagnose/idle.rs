//! Windows in which nothing happens: where they are most of a log they say the same thing again and again, if anything, and hide from averages how steadily the
//! others speak.

use crate::shooting::{Observations, Window, consecutive};

/// A position that keeps within so many times its noise does not move.
const STILL: f64 = 10.0;
/// An input that keeps within this part of its range does not change.
const SAME: f64 = 1e-6;
/// A log of which a smaller share is busy rests.
const RESTS: f64 = 0.5;

/// The share of the windows of `duration` s in which something happens, where that is the smaller one. `None`: it is not.
pub fn busy_share(observations: &Observations, duration: f64) -> Option<f64> {
    let runs = observations.runs.iter().enumerate();
    let all: Vec<Window> = runs
        .flat_map(|(run, observed)| consecutive(run, &observed.t, duration))
        .collect();
    let busy = busy(observations, &all).len() as f64;
    let share = busy / all.len().max(1) as f64;
    (busy > 0.0 && share < RESTS).then_some(share)
}

/// The windows in which a position moves or an input changes.
pub fn busy(observations: &Observations, windows: &[Window]) -> Vec<Window> {
    let runs = || observations.runs.iter();
    let inputs = runs().next().map_or(0, |run| run.u.len());
    let change: Vec<f64> = (0..inputs)
        .map(|i| SAME * range(runs().flat_map(|run| run.u[i].iter())))
        .collect();
    let is_busy = |window: &&Window| {
        let run = &observations.runs[window.run];
        let own = |signal: &[f64]| {
            let from = window.first.min(signal.len());
            let to = (window.first + window.count).min(signal.len());
            range(signal[from..to].iter())
        };
        let positions = observations.channels.iter().enumerate();
        let mut positions = positions.filter(|(_, channel)| !channel.velocity);
        let pushed = run.u.iter().zip(&change).any(|(u, least)| own(u) > *least);
        pushed || positions.any(|(c, channel)| own(&run.y[c]) > STILL * channel.noise)
    };
    windows.iter().filter(is_busy).copied().collect()
}

fn range<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    let empty = (f64::INFINITY, f64::NEG_INFINITY);
    let (least, most) = values.fold(empty, |(least, most), x| (least.min(*x), most.max(*x)));
    (most - least).max(0.0)
}

#[cfg(test)]
pub mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::shooting::{Channel, Finer, ObservedRun};

    /// 100 s at 10 Hz: an input of 1 from 20 to 21 s, a position that moves from 20 to 22 s.
    fn a_push() -> Observations {
        let t: Vec<f64> = (0..1000).map(|k| 0.1 * f64::from(k)).collect();
        let moved = |t: &f64| (t - 20.0).clamp(0.0, 2.0);
        let pushed = |t: &f64| f64::from((20.0..21.0).contains(t));
        let (y, u) = (
            t.iter().map(moved).collect(),
            t.iter().map(pushed).collect(),
        );
        of_one_position(t, y, u)
    }

    /// A recording of a position, by a sensor of 1 mm, and an input.
    pub fn of_one_position(t: Vec<f64>, y: Vec<f64>, u: Vec<f64>) -> Observations {
        Observations {
            channels: vec![Channel {
                coordinate: 0,
                velocity: false,
                wraps: false,
                noise: 1e-3,
            }],
            runs: vec![ObservedRun {
                finer: Finer::default(),
                u: vec![u],
                y: vec![y],
                valid: vec![vec![true; t.len()]],
                t,
            }],
        }
    }

    #[test]
    fn a_log_of_one_push_is_busy_where_it_pushes_or_moves() {
        let observations = a_push();
        let windows = consecutive(0, &observations.runs[0].t, 0.5);
        let times: Vec<usize> = busy(&observations, &windows)
            .iter()
            .map(|w| w.first / 5)
            .collect();
        assert_eq!(times, [40, 41, 42, 43]);
        let share = busy_share(&observations, 0.5).unwrap();
        assert!((share - 4.0 / 200.0).abs() < 1e-9, "{share}");
        assert!(
            busy_share(&observations, 80.0).is_none(),
            "one window, busy"
        );
    }

    #[test]
    fn a_log_of_rest_alone_has_no_busy_share() {
        let mut observations = a_push();
        observations.runs[0].u[0].fill(0.3);
        observations.runs[0].y[0].fill(1.0);
        assert!(busy_share(&observations, 0.5).is_none());
    }
}
