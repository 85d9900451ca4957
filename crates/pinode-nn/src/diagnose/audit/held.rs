//! Readings that are held: dropped samples repeated, or a sensor that is stuck.
//!
//! A mechanism that comes to rest slows down first and starts slowly again. A reading that is held repeats bit for bit, and jumps to the
//! truth at its end: by more than the motion on either side of the hold. Readings that scatter by more than their least step do not repeat at all unless they
//! are held.

use std::ops::Range;

use super::noise::Readings;

/// The jump at the end of a hold is at least so many times the sensor's noise …
const JUMP: f64 = 10.0;
/// … and so many times the largest step of the motion around it: where that goes on the same way through the hold …
const BEYOND_MOTION: f64 = 1.6;
/// … and where it turns round meanwhile: an encoder that hangs at the turning point of a slow swing jumps by two steps or three.
const BEYOND_A_TURN: f64 = 4.0;
/// Readings that scatter are held when so many repeat the one before.
const FROZEN: usize = 25;
/// So many samples on either side tell the motion around a hold.
const AROUND: usize = 4;

/// The samples of `y` that repeat the one before because the reading is held: [first, last] of each hold. `scatters`: see
/// [`noise::scatters`](super::noise::scatters).
pub fn holds(y: &[f64], noise: f64, scatters: bool) -> Vec<[usize; 2]> {
    let held = repetitions(y, noise).into_iter().filter(|samples| {
        let frozen = scatters && samples.len() >= FROZEN;
        frozen || is_held(y, samples.start, samples.end, noise)
    });
    held.map(|samples| [samples.start, samples.end - 1])
        .collect()
}

/// The parts between long repetitions of one reading: of a sensor that freezes, what it read before.
pub fn moving(readings: Readings) -> Vec<Readings> {
    let long = repetitions(readings.y, 0.0)
        .into_iter()
        .filter(|r| r.len() >= FROZEN);
    let long: Vec<[usize; 2]> = long.map(|r| [r.start, r.end - 1]).collect();
    without(readings, &long)
}

/// The parts between holds.
pub fn without<'a>(Readings { t, y }: Readings<'a>, holds: &[[usize; 2]]) -> Vec<Readings<'a>> {
    let part = |range: Range<usize>| {
        let (t, y) = (t.get(range.clone())?, y.get(range)?);
        Some(Readings { t, y })
    };
    let mut parts = Vec::new();
    let mut start = 0;
    for &[first, last] in holds {
        parts.extend(part(start..first));
        start = last + 1;
    }
    parts.extend(part(start..y.len()));
    parts
}

/// The samples that count before a hold that does not end, or behind one with which they begin; all of them beside any other.
pub fn beside(counting: Range<usize>, hold: Range<usize>) -> Range<usize> {
    if hold.end >= counting.end {
        counting.start..hold.start.clamp(counting.start, counting.end)
    } else if hold.start <= counting.start + 1 {
        counting.start.max(hold.end)..counting.end
    } else {
        counting
    }
}

/// The stretches of samples that repeat the one before.
fn repetitions(y: &[f64], noise: f64) -> Vec<Range<usize>> {
    // An angle that was unwrapped repeats but for rounding.
    let same = |a: f64, b: f64| (a - b).abs() <= 1e-6 * noise;
    let mut all = Vec::new();
    let mut k = 1;
    while k < y.len() {
        let first = k;
        while k < y.len() && same(y[k], y[first - 1]) {
            k += 1;
        }
        if k > first {
            all.push(first..k);
        }
        k += 1;
    }
    all
}

/// Whether `y[first..end]`, all equal to the sample before, end with a jump that no motion makes.
fn is_held(y: &[f64], first: usize, end: usize, noise: f64) -> bool {
    let Some(next) = y.get(end) else {
        return false;
    };
    let jump = next - y[end - 1];
    let mut before = steps(y, first.saturating_sub(AROUND + 1), first);
    let after = steps(y, end, (end + AROUND + 1).min(y.len()));
    let largest_of = |steps: &[f64]| steps.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
    // A sensor that is stuck may read anything: into the hold it jumps as well.
    if end - first >= 3
        && let Some((into, motion)) = before.split_last()
        && !motion.is_empty()
        && into.abs() > JUMP * noise
        && into.abs() > BEYOND_A_TURN * largest_of(motion).max(largest_of(&after))
    {
        before.pop();
    }
    let (Some(&last), Some(&coming)) = (before.last(), after.first()) else {
        return false;
    };
    // A single repetition is one of the many equal neighbours of a coarse sensor unless the motion goes on the same way through it.
    let through = last * jump > 0.0 && coming * jump > 0.0;
    let largest = largest_of(&before).max(largest_of(&after));
    let beyond = match through {
        true => BEYOND_MOTION,
        false => BEYOND_A_TURN,
    };
    jump.abs() > JUMP * noise && jump.abs() > beyond * largest && (through || end - first >= 3)
}

fn steps(y: &[f64], from: usize, to: usize) -> Vec<f64> {
    let part = y.get(from..to).unwrap_or_default();
    part.windows(2).map(|p| p[1] - p[0]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    fn swing(quantum: f64, noise: f64) -> Vec<f64> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        (0..3000)
            .map(|k| {
                let e: f64 = rng.sample(StandardNormal);
                let y = (5.0 * k as f64 * 0.02).sin() + noise * e;
                if quantum > 0.0 {
                    (y / quantum).round() * quantum
                } else {
                    y
                }
            })
            .collect()
    }

    #[test]
    fn dropped_samples_are_found_where_the_joint_moves() {
        let mut y = swing(0.0, 1e-3);
        for first in [100, 700, 1500] {
            let held = y[first - 1];
            y[first..first + 4].fill(held);
        }
        let expected = [[100, 103], [700, 703], [1500, 1503]];
        assert_eq!(holds(&y, 1e-3, true), expected);
    }

    /// A sensor that reads 3.2 for ten seconds, whatever the joint does, was two outliers.
    #[test]
    fn a_sensor_that_is_stuck_elsewhere_is_held() {
        for quantum in [0.0, 4.4e-4] {
            let mut y = swing(quantum, 1e-4);
            y[1000..1500].fill(3.2);
            let found = holds(&y, 4.4e-4, false);
            assert_eq!(found, [[1001, 1499]], "{quantum}");
        }
    }

    /// Without a jump at its end, or without an end.
    #[test]
    fn a_sensor_that_freezes_is_found_where_its_readings_scatter() {
        let mut y = swing(0.0, 1e-3);
        let held = y[2399];
        y[2400..].fill(held);
        let held = y[399];
        y[400..430].fill(held);
        y[430..].iter_mut().for_each(|y| *y -= 1e-2);
        let held = y[0];
        y[..30].fill(held);
        assert_eq!(holds(&y, 1e-3, true), [[1, 29], [400, 429], [2400, 2999]]);
        let t: Vec<f64> = (0..y.len()).map(|k| k as f64 * 0.02).collect();
        let left: usize = moving(Readings { t: &t, y: &y })
            .iter()
            .map(|part| part.y.len())
            .sum();
        assert_eq!(left, 3000 - 29 - 30 - 600);
    }

    #[test]
    fn a_coarse_sensor_and_a_joint_that_sticks_hold_nothing() {
        let quantum = 0.02;
        assert!(holds(&swing(quantum, 0.0), quantum / 12.0_f64.sqrt(), true).is_empty());
        assert!(holds(&swing(quantum, 5e-3), 8e-3, true).is_empty());
        // At rest for two seconds, then off under a constant acceleration of 5 m/s².
        let stick: Vec<f64> = (0..300)
            .map(|k| 2.5 * (0.02 * (k as f64 - 100.0)).max(0.0).powi(2))
            .collect();
        assert!(holds(&stick, 1e-6, false).is_empty());
    }
}
