//! Blows that a log shows: where the motion is turned back at once near the end of its range, and how much speed it keeps.
//!
//! Where z, the coordinate or its negative, turns near its end at a sample, parabolas through the samples before and behind it meet at the place of the
//! blow with the slopes v and −v′ there. Lines through the same samples have slopes whose difference, over the time between the middles of the two, is the acceleration
//! that turned the motion. What swings to and fro has the same acceleration before and behind; what is struck has not.

use std::ops::Range;

use nalgebra::SVector;

use super::audit::median;
use super::smooth::{polynomial, unwrapped};
use crate::effect::Struck;
use crate::shooting::{Observations, ObservedRun};

/// The part of the samples that may be beyond what is taken for an end of the range.
const BEYOND: f64 = 0.005;
/// Within this part of half the range a motion is at its end.
const END: f64 = 0.08;
/// Samples before and behind a blow, at least, that parabolas go through.
const FEWEST_SAMPLES: usize = 4;
/// Steps in which parabolas are found to meet.
const MEETING: usize = 4;
/// No sample so near is further out than one at which the motion turns.
const NEAR: usize = 3;
/// Fewer blows say nothing of an end.
const FEWEST: usize = 5;
/// Blows turn a motion by so many times the acceleration inwards before and behind them, those at the end opposite to one that is struck by so many …
const SHARP: (f64, f64) = (3.0, 1.5);
/// … and are so many standard errors fast.
const FAST: f64 = 5.0;

/// What strikes the `c`th coordinate at its lower and its upper end; between the blows its motion is a parabola for `free` s.
pub fn struck(observations: &Observations, c: usize, free: f64) -> [Option<Struck>; 2] {
    let ends = [-1.0, 1.0].map(|side| at_end(observations, c, side, free));
    let enough = match ends.iter().flatten().any(|end| end.1 > SHARP.0) {
        true => SHARP.1,
        false => SHARP.0,
    };
    ends.map(|end| end.filter(|end| end.1 > enough).map(|end| end.0))
}

/// One turn at an end.
struct Turn {
    /// Where the parabolas meet.
    place: f64,
    /// Speed outwards before it, and inwards behind it.
    before: f64,
    after: f64,
    /// Speed outwards in the middle of the samples before it.
    coming: f64,
    /// Acceleration inwards that turned it.
    turning: f64,
    /// Acceleration inwards before it, and behind.
    swinging: [f64; 2],
}

/// What the faster half of the turns at one end are as blows, where `side` times the coordinate is largest, and by how many times the acceleration around them they
/// turn the motion; `None` where there are too few, or too slow ones.
fn at_end(observations: &Observations, c: usize, side: f64, free: f64) -> Option<(Struck, f64)> {
    let interval = observations.typical_interval();
    let count = ((free / interval).round() as usize).max(FEWEST_SAMPLES);
    let runs = observations.runs.iter().map(|run| {
        let y = match observations.channels[c].wraps {
            true => unwrapped(&run.y[c]),
            false => run.y[c].clone(),
        };
        (run, y.iter().map(|y| side * y).collect::<Vec<f64>>())
    });
    let runs: Vec<(&ObservedRun, Vec<f64>)> = runs.collect();
    let mut sorted: Vec<f64> = runs.iter().flat_map(|(_, z)| z).copied().collect();
    sorted.sort_by(f64::total_cmp);
    let few = (BEYOND * sorted.len() as f64) as usize;
    let (low, high) = (sorted.get(few)?, sorted.iter().nth_back(few)?);
    let margin = END * 0.5 * (high - low);
    let mut turns: Vec<Turn> = Vec::new();
    for (run, z) in &runs {
        for k in count..z.len().saturating_sub(count) {
            let is_end = (z[k] - high).abs() < margin;
            let is_furthest = |j: usize| z[k] > z[j] || (z[k] == z[j] && k <= j);
            if is_end && (k - NEAR..=k + NEAR).all(is_furthest) {
                turns.extend(turn((run, c), z, k, count));
            }
        }
    }
    turns.sort_by(|a, b| b.coming.total_cmp(&a.coming));
    turns.truncate(turns.len().div_ceil(2));
    if turns.len() < FEWEST {
        return None;
    }
    let middle = |of: &dyn Fn(&Turn) -> f64| median(&mut turns.iter().map(of).collect::<Vec<_>>());
    let swinging = turns.iter().flat_map(|turn| turn.swinging);
    let swinging = median(&mut swinging.collect::<Vec<_>>());
    let n = count as f64;
    let noise = observations.channels[c].noise;
    let speed_noise = noise / (interval * (n * (n * n - 1.0) / 12.0).sqrt());
    let fast = middle(&|turn| turn.coming) > FAST * speed_noise;
    let turning = middle(&|turn| turn.turning);
    let sharpness = match swinging > 0.0 {
        true => turning / swinging,
        false => f64::INFINITY,
    };
    let sum = |of: fn(&Turn) -> f64| turns.iter().map(of).sum::<f64>();
    let struck = Struck {
        place: side * middle(&|turn| turn.place),
        speed: middle(&|turn| turn.before),
        restitution: (sum(|t| t.after) / sum(|t| t.before)).clamp(0.0, 1.0),
        within: interval,
    };
    fast.then_some((struck, sharpness))
}

/// The turn at sample `k` of z, by so many samples before and behind it; `None` where too few of them are valid.
fn turn((run, c): (&ObservedRun, usize), z: &[f64], k: usize, count: usize) -> Option<Turn> {
    let points = |samples: &Range<usize>| {
        let valid = samples.clone().filter(|&j| run.valid[c][j]);
        valid.map(|j| (run.t[j] - run.t[k], z[j] - z[k]))
    };
    let sides = [k - count..k, k + 1..k + count + 1];
    let line = |samples| polynomial::<2>(points(samples));
    let bend = |samples| polynomial::<3>(points(samples));
    let middle = |samples| {
        let (sum, n) = points(samples).fold((0.0, 0.0), |(sum, n), (t, _)| (sum + t, n + 1.0));
        sum / n
    };
    let coming = line(&sides[0])?[1];
    let change = coming - line(&sides[1])?[1];
    let between = middle(&sides[1]) - middle(&sides[0]);
    let (before, behind) = (bend(&sides[0])?, bend(&sides[1])?);
    let slope = |x: &SVector<f64, 3>, t: f64| x[1] + 2.0 * x[2] * t;
    let apart = behind - before;
    let (from, to) = (run.t[k - 1] - run.t[k], run.t[k + 1] - run.t[k]);
    // Newton's method for where the parabolas meet, from the sample in the middle.
    let mut at = 0.0;
    for _ in 0..MEETING {
        let step = (apart[0] + at * (apart[1] + at * apart[2])) / slope(&apart, at);
        at = f64::clamp(at - step, from, to);
    }
    let speeds = (slope(&before, at), -slope(&behind, at));
    (speeds.0 > 0.0 && speeds.0 + speeds.1 > 0.0).then_some(Turn {
        place: z[k] + before[0] + at * (before[1] + at * before[2]),
        before: speeds.0,
        after: speeds.1,
        coming,
        turning: change / between,
        swinging: [-2.0 * before[2], -2.0 * behind[2]],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::pseudo;
    use crate::shooting::{Channel, Finer};

    const DT: f64 = 0.01;

    fn observed(y: Vec<f64>, noise: f64) -> Observations {
        Observations {
            channels: vec![Channel {
                coordinate: 0,
                velocity: false,
                wraps: false,
                noise,
            }],
            runs: vec![ObservedRun {
                finer: Finer::default(),
                t: (0..y.len()).map(|k| DT * k as f64).collect(),
                valid: vec![vec![true; y.len()]],
                u: vec![],
                y: vec![y],
            }],
        }
    }

    /// A ball on a floor at `floor` that leaves it with e times the speed, and is thrown up to 1 m when that is slow.
    fn bouncing(floor: f64, e: f64, noise: f64) -> Observations {
        const G: f64 = 9.81;
        let (mut z, mut v, mut y) = (1.0, 0.0, Vec::new());
        for k in 0..6000 {
            y.push(floor + z + noise * 3.0_f64.sqrt() * pseudo(k, 0.3));
            let (new, speed) = (z + v * DT - 0.5 * G * DT * DT, v - G * DT);
            (z, v) = (new, speed);
            if new < 0.0 {
                // When it struck, how fast it is back, and where it is at the end of the interval.
                let struck = (speed * speed + 2.0 * G * new).sqrt();
                let left = (-speed - struck) / G;
                let back = e * struck;
                let up = if back > 0.4 { back } else { (2.0 * G).sqrt() };
                (z, v) = (up * left - 0.5 * G * left * left, up - G * left);
            }
        }
        observed(y, noise)
    }

    #[test]
    fn the_place_and_the_restitution_of_a_floor_are_those_of_the_ball_that_bounces_on_it() {
        for e in [0.3, 0.6, 0.9] {
            let [floor, ceiling] = struck(&bouncing(0.25, e, 1e-3), 0, 0.08);
            assert_eq!(ceiling, None, "at the top it turns by itself");
            let Some(floor) = floor else {
                panic!("{e}: no floor")
            };
            assert!((floor.place - 0.25).abs() < 1e-3, "{e}: {floor:?}");
            assert!((floor.restitution - e).abs() < 0.01, "{e}: {floor:?}");
            assert!((2.0..4.5).contains(&floor.speed), "{e}: {floor:?}");
        }
    }

    #[test]
    fn what_swings_or_rests_is_not_struck() {
        let swing = |noise: f64| -> Observations {
            let q = |k: usize| (k as f64 * DT * 6.0).sin();
            let y = (0..6000).map(|k| q(k) + noise * 3.0_f64.sqrt() * pseudo(k, 0.3));
            observed(y.collect(), noise)
        };
        for noise in [1e-4, 1e-3, 1e-2] {
            assert_eq!(struck(&swing(noise), 0, 0.08), [None; 2]);
        }
        let rest = (0..6000).map(|k| 1e-3 * pseudo(k, 0.3)).collect();
        assert_eq!(struck(&observed(rest, 6e-4), 0, 0.08), [None; 2]);
    }
}
