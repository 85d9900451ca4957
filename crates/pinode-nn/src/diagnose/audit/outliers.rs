//! Samples that stand alone.

use super::noise::{Readings, median};

/// At most this share of the samples can be outliers: what happens more often is how the sensor is.
const MOST_OUTLIERS: f64 = 0.005;
/// … but for those without which all around them is as it should be: no motion does that, only readings that are wrong.
const MOST_SPIKES: f64 = 0.05;
/// What is left around such a one without it, in units of the noise. A blow leaves a sixth of it: a spike is larger than ten times that.
const CLEAN: f64 = 6.0;
const SPIKE: f64 = 10.0 * CLEAN;
/// Over an interval that is so many times another one nothing is known of the motion: no sample there stands alone.
const GAP: f64 = 8.0;
/// So many may always be.
const FEW: usize = 3;
/// So many samples either side of one tell whether it is read wrongly or the motion bends there, …
const REACH: usize = 4;
/// … at one of so many times an interval, of the two before and the two after it.
const BENDS: usize = 8;

/// What a sensor reads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Read {
    Position,
    Velocity,
}

/// False where a sample stands alone: away from the cubic through its four neighbours, of even samples
///
/// e_k = y_k − (−y_{k−2} + 4 y_{k−1} + 4 y_{k+1} − y_{k+2}) / 6,
///
/// by more than eight times the noise, by more than eight times what is usual around it (fast motion is no fault), and by more than
/// its neighbours, whom a glitch pulls along, and where one wrong reading explains all of them better than a [bend](bends) of the motion. Twice as far, and so on, while that holds for too many samples.
pub fn without_outliers(readings: Readings, noise: f64, what: Read) -> Vec<bool> {
    let (n, mut factor) = (readings.y.len() as f64, 8.0);
    let mut known: Vec<Option<bool>> = vec![None; readings.y.len()];
    let mut bent = |k: usize| *known[k].get_or_insert_with(|| bends(readings, what, k));
    loop {
        let (valid, spikes) = within(readings, noise, factor, &mut bent);
        let others = valid.iter().filter(|v| !**v).count() - spikes;
        let few = |count: usize, most: f64| count <= FEW || (count as f64) < most * n;
        if (few(others, MOST_OUTLIERS) && few(spikes, MOST_SPIKES)) || factor > 1e6 {
            return valid;
        }
        factor *= 2.0;
    }
}

/// How far each sample but the outer two is from the cubic through its neighbours, e.
fn away(Readings { t, y }: Readings) -> Vec<f64> {
    const NEIGHBOURS: [usize; 4] = [0, 1, 3, 4];
    let of = |(t, y): (&[f64], &[f64])| {
        let intervals = t.windows(2).map(|p| p[1] - p[0]);
        let (short, long) = intervals.fold((f64::INFINITY, 0.0_f64), |(short, long), interval| {
            (short.min(interval), long.max(interval))
        });
        if long > GAP * short {
            return 0.0;
        }
        // Lagrange's polynomial of the neighbours, at the time of the sample.
        let share = |j: usize| -> f64 {
            let others = NEIGHBOURS.iter().filter(|i| **i != j);
            others.map(|&i| (t[2] - t[i]) / (t[j] - t[i])).product()
        };
        NEIGHBOURS.iter().map(|&j| share(j) * (y[2] - y[j])).sum()
    };
    t.windows(5).zip(y.windows(5)).map(of).collect()
}

/// False where a sample stands alone by so large a factor; and the number of those without which nothing is left of it.
fn within(
    readings: Readings,
    noise: f64,
    factor: f64,
    bent: &mut impl FnMut(usize) -> bool,
) -> (Vec<bool>, usize) {
    let (mut valid, mut spikes) = (vec![true; readings.y.len()], 0);
    let away = away(readings);
    for (i, &e) in away.iter().enumerate() {
        let near = away.get(i.saturating_sub(2)..(i + 3).min(away.len()));
        let largest = near.is_some_and(|near| near.iter().all(|other| other.abs() <= e.abs()));
        if e.abs() <= factor * noise || !largest {
            continue;
        }
        let first = i.saturating_sub(15);
        let mut around: Vec<f64> = (first..(i + 16).min(away.len()))
            .filter(|k| k.abs_diff(i) > 2)
            .map(|k| away[k].abs())
            .collect();
        valid[i + 2] = e.abs() <= factor * median(&mut around) || bent(i + 2);
        spikes += usize::from(!valid[i + 2] && is_spike(&away, i, noise));
    }
    (valid, spikes)
}

/// Whether the motion bends at about sample `k` rather than that this is read wrongly. A force that steps does to a position what (t − τ)₊² is and to a velocity
/// what (t − τ)₊ is; one that lasts for a sample makes a velocity rise over an interval. What is left of e around the sample beside the best of these, by least
/// squares and for any τ, is less than beside a pulse at `k`. (A blow does to a position what a force does to a velocity; that counts as read wrongly, and is left
/// out: a sample that a body turns round at says nothing that a stop of any softness can follow.)
fn bends(readings: Readings, what: Read, k: usize) -> bool {
    let first = k.saturating_sub(REACH);
    let last = (k + REACH + 1).min(readings.t.len());
    let t = &readings.t[first..last];
    let own = away(Readings {
        t,
        y: &readings.y[first..last],
    });
    let left = |shape: &dyn Fn(f64) -> f64| {
        let y: Vec<f64> = t.iter().map(|t| shape(*t)).collect();
        let shape = away(Readings { t, y: &y });
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let along = product(&shape, &own).powi(2) / product(&shape, &shape);
        product(&own, &own) - if along.is_finite() { along } else { 0.0 }
    };
    let pulse = left(&|time| f64::from(time == readings.t[k]));
    let centre = k - first;
    let (from, to) = (
        t[centre.saturating_sub(2)],
        t[(centre + 2).min(t.len() - 1)],
    );
    let mut times = (0..=4 * BENDS).map(|j| from + (to - from) * j as f64 / (4 * BENDS) as f64);
    let interval = 0.25 * (to - from);
    let ramp = |since: f64| since.max(0.0);
    let shapes: &[&dyn Fn(f64) -> f64] = match what {
        Read::Position => &[&|since| ramp(since).powi(2)],
        Read::Velocity => &[&ramp, &|since| since.clamp(0.0, interval)],
    };
    times.any(|bend| {
        shapes
            .iter()
            .any(|shape| left(&|time| shape(time - bend)) < pulse)
    })
}

/// Whether nothing is left of what the neighbours of a sample are away from theirs once it is where they have it: e_{k±1} + 4/6 e_k and e_{k±2} − 1/6 e_k.
fn is_spike(away: &[f64], i: usize, noise: f64) -> bool {
    let left = |by: usize, share: f64| {
        let sides = [i.checked_sub(by), Some(i + by)];
        let there = sides.into_iter().flatten().filter_map(|k| away.get(k));
        there.fold(0.0_f64, |most, e| most.max((e - share * away[i]).abs()))
    };
    let clean = left(1, -4.0 / 6.0).max(left(2, 1.0 / 6.0)) < CLEAN * noise;
    clean && away[i].abs() > SPIKE * noise
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of samples that are as far apart as in these tests, every 20 ms.
    fn without_outliers(y: &[f64], noise: f64) -> Vec<bool> {
        let t: Vec<f64> = (0..y.len()).map(|k| 0.02 * k as f64).collect();
        super::without_outliers(Readings { t: &t, y }, noise, Read::Position)
    }

    #[test]
    fn samples_around_a_gap_and_at_uneven_times_do_not_stand_alone() {
        let kept = (0..900).filter(|k| k % 70 != 0 && !(300..420).contains(k));
        let t: Vec<f64> = kept
            .map(|k| 0.01 * k as f64 + 2e-3 * crate::bins::pseudo(k, 0.7))
            .collect();
        let mut y: Vec<f64> = t.iter().map(|t| (3.0 * t).sin()).collect();
        let valid =
            |y: &[f64]| super::without_outliers(Readings { t: &t, y }, 1e-4, Read::Position);
        assert!(valid(&y).iter().all(|v| *v));
        y[200] += 0.5;
        assert!(!valid(&y)[200]);
    }

    #[test]
    fn a_glitch_is_masked_and_a_fast_swing_is_not() {
        let mut y: Vec<f64> = (0..500).map(|k| (10.0 * k as f64 * 0.02).sin()).collect();
        assert!(without_outliers(&y, 1e-3).iter().all(|v| *v));
        y[100] += 0.5;
        let valid = without_outliers(&y, 1e-3);
        assert!(!valid[100] && valid.iter().filter(|v| !**v).count() == 1);
    }

    /// A torque that steps bends the velocity, which is measured with little noise, and one that lasts for a sample makes it step; a wrong reading among the bends is told from them.
    #[test]
    fn a_speed_under_forces_that_step_does_not_stand_alone() {
        let mut y = vec![0.0];
        for k in 1..4000_usize {
            let force = 5.0 * crate::bins::pseudo((100 * k + 37) / 31700, 0.7);
            let force = force + if k % 457 == 0 { 40.0 } else { 0.0 };
            y.push(y[k - 1] + 0.01 * (force - y[k - 1]));
        }
        let read = |k: usize| y[k] + 1e-5 * crate::bins::pseudo(k, 0.3);
        let mut y: Vec<f64> = (0..y.len()).map(read).collect();
        let t: Vec<f64> = (0..y.len()).map(|k| 0.02 * k as f64).collect();
        let masked = |y: &[f64]| -> Vec<usize> {
            let valid = super::without_outliers(Readings { t: &t, y }, 1e-5, Read::Velocity);
            let valid = valid.into_iter().enumerate();
            valid
                .filter_map(|(k, valid)| (!valid).then_some(k))
                .collect()
        };
        assert_eq!(masked(&y), [0; 0]);
        y[2222] += 3e-4;
        assert_eq!(masked(&y), [2222]);
    }

    /// A reading that is wrong in one sample of fifty leaves the others as they should be; a mechanism that is struck as often does not.
    #[test]
    fn many_spikes_are_masked_and_many_blows_are_not() {
        let swing = |k: usize| (3.0 * k as f64 * 0.01).sin();
        let noise = |k: usize| 1e-3 * crate::bins::pseudo(k, 0.3);
        let mut spiky: Vec<f64> = (0..3000).map(|k| swing(k) + noise(k)).collect();
        for k in (25..3000).step_by(50) {
            spiky[k] += 0.3;
        }
        let valid = without_outliers(&spiky, 1e-3);
        assert!((25..3000).step_by(50).all(|k| !valid[k]));
        assert_eq!(valid.iter().filter(|v| !**v).count(), 60);
        // A ball that bounces every 0.5 s: its speed turns round at a sample or between two.
        for (speed, phase) in [(2.0, 0.0), (2.0, 0.5), (3.0, 0.1), (10.0, 0.0), (10.0, 0.3)] {
            let bounce = |k: usize| {
                let t = 0.01 * ((k % 50) as f64 + phase);
                speed * t - 2.0 * speed * t * t
            };
            let struck: Vec<f64> = (0..3000).map(|k| bounce(k) + noise(k)).collect();
            let masked = without_outliers(&struck, 1e-3);
            let masked = masked.iter().filter(|v| !**v).count();
            assert!(masked < 15, "{speed} m/s, {phase}: {masked}");
        }
    }
}
