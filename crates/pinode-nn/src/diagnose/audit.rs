//! What the log itself tells: noise of each sensor, outliers, gaps.

use super::smooth::unwrapped;
use super::verdict::DataFault;
use crate::log::{Log, Run};
use crate::model::{Model, Velocity};
use crate::shooting::{Channel, Observations, ObservedRun};

/// The observations in a model's logs, and the faults of the data. The logs in `held_out` come last.
pub fn audit(model: &Model, logs: &[Log], held_out: &[Log]) -> (Observations, Vec<DataFault>) {
    let coordinates = model.mechanics.coordinates();
    let nv = coordinates.len();
    let all: Vec<&Run> = logs
        .iter()
        .chain(held_out)
        .flat_map(|log| &log.runs)
        .collect();
    // Velocities count only where they are measured everywhere, and are not differences of the positions after all.
    let measured_velocity: Vec<usize> = (0..nv)
        .filter(|&c| {
            model.sensors[c].velocity == Velocity::Measured
                && all.iter().all(|run| {
                    run.v[c]
                        .as_ref()
                        .is_some_and(|v| !is_difference(&run.t, &run.q[c], v))
                })
        })
        .collect();

    let mut channels = Vec::new();
    let mut columns: Vec<Vec<Vec<f64>>> = Vec::new();
    for (c, coordinate) in coordinates.iter().enumerate() {
        columns.push(all.iter().map(|run| run.q[c].clone()).collect());
        channels.push(Channel {
            coordinate: c,
            velocity: false,
            wraps: coordinate.wraps,
            noise: 0.0,
        });
    }
    for &c in &measured_velocity {
        columns.push(
            all.iter()
                .map(|run| run.v[c].clone().unwrap_or_default())
                .collect(),
        );
        channels.push(Channel {
            coordinate: c,
            velocity: true,
            wraps: false,
            noise: 0.0,
        });
    }

    let mut faults = Vec::new();
    let mut valid: Vec<Vec<Vec<bool>>> = Vec::new();
    for (channel, column) in channels.iter_mut().zip(&columns) {
        let smooth: Vec<Vec<f64>> = column
            .iter()
            .map(|y| {
                if channel.wraps {
                    unwrapped(y)
                } else {
                    y.clone()
                }
            })
            .collect();
        let sensor = &model.sensors[channel.coordinate];
        let quantum = sensor.resolution.unwrap_or(0.0) / 12.0_f64.sqrt();
        let declared = sensor.position_noise.filter(|_| !channel.velocity);
        let seen = noise(&smooth);
        let name = &coordinates[channel.coordinate].name;
        let letter = if channel.velocity { "v" } else { "q" };
        channel.noise = match declared {
            Some(declared) if seen <= MORE_THAN_DECLARED * declared => declared.hypot(quantum),
            Some(declared) => {
                faults.push(DataFault {
                    kind: "noise".into(),
                    column: format!("{letter}.{name}"),
                    when: Vec::new(),
                    detail: format!(
                        "the readings scatter by {seen:.2e} {}, the model declares {declared:.2e}; the scatter is taken",
                        coordinates[channel.coordinate].unit()
                    ),
                });
                seen
            }
            None => seen.max(quantum),
        };
        if channel.noise == 0.0 {
            // A sensor without noise does not exist; a simulated log may have none. The middle nine tenths tell the range.
            let mut sorted: Vec<f64> = smooth.iter().flatten().copied().collect();
            sorted.sort_by(f64::total_cmp);
            let at = |share: usize| {
                sorted
                    .get(sorted.len() * share / 20)
                    .copied()
                    .unwrap_or(0.0)
            };
            channel.noise = 1e-7 * (at(19) - at(1)).max(1e-9);
        }
        let marked: Vec<Vec<bool>> = smooth
            .iter()
            .map(|y| without_outliers(y, channel.noise))
            .collect();
        let when: Vec<[f64; 2]> = all
            .iter()
            .zip(&marked)
            .flat_map(|(run, marks)| {
                let times = marks.iter().enumerate().filter(|(_, valid)| !**valid);
                times.map(|(k, _)| [run.t[k], run.t[k]]).collect::<Vec<_>>()
            })
            .collect();
        if !when.is_empty() {
            faults.push(DataFault {
                kind: "outliers".into(),
                column: format!("{letter}.{name}"),
                detail: format!(
                    "{} of {} samples stand alone, far from both neighbours; they are left out of all fits",
                    when.len(),
                    smooth.iter().map(Vec::len).sum::<usize>()
                ),
                when: when.into_iter().take(100).collect(),
            });
        }
        valid.push(marked);
    }
    faults.extend(all.iter().filter_map(|run| gaps(&run.t)));
    let starts = dead_starts(model, &all, &channels, &mut faults);

    let runs = all
        .iter()
        .enumerate()
        .map(|(r, run)| {
            let from = starts[r];
            ObservedRun {
                t: run.t[from..].to_vec(),
                u: run.u.iter().map(|u| u[from..].to_vec()).collect(),
                y: columns
                    .iter()
                    .map(|column| column[r][from..].to_vec())
                    .collect(),
                valid: valid
                    .iter()
                    .map(|marks| marks[r][from..].to_vec())
                    .collect(),
            }
        })
        .collect();
    (Observations { channels, runs }, faults)
}

/// Noise of a sensor, from its readings alone: 1.4826 · median |Δᵐ y| / √(2m choose m), the smaller of m = 4 and m = 6. Differences
/// of that order remove the motion; what is left of a fast one makes the lower order the larger.
pub fn noise(runs: &[Vec<f64>]) -> f64 {
    let of_order = |m: usize, binomial: f64| {
        let mut size: Vec<f64> = Vec::new();
        for run in runs {
            let mut d = run.clone();
            for _ in 0..m {
                d = d.windows(2).map(|p| p[1] - p[0]).collect();
            }
            size.extend(d.into_iter().map(f64::abs));
        }
        1.4826 * median(&mut size) / binomial.sqrt()
    };
    of_order(4, 70.0).min(of_order(6, 924.0))
}

pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Whether `v` is the backward difference of `q`, to rounding of a decimal log.
fn is_difference(t: &[f64], q: &[f64], v: &[f64]) -> bool {
    let mut agree = 0;
    let mut moving = 0;
    for k in 1..t.len() {
        let d = (q[k] - q[k - 1]) / (t[k] - t[k - 1]);
        if d != 0.0 {
            moving += 1;
            agree += usize::from((d - v[k]).abs() <= 1e-3 * d.abs());
        }
    }
    moving > 0 && agree * 10 > moving * 9
}

/// Readings that scatter more than so many times the declared noise are believed, not the declaration.
const MORE_THAN_DECLARED: f64 = 1.5;
/// At most this share of the samples can be outliers: what happens more often is how the sensor is.
const MOST_OUTLIERS: f64 = 0.005;

/// False where a sample stands alone: away from the cubic through its four neighbours,
///
/// e_k = y_k − (−y_{k−2} + 4 y_{k−1} + 4 y_{k+1} − y_{k+2}) / 6,
///
/// by more than eight times the noise, by more than eight times what is usual around it (fast motion is no fault), and by more than
/// its neighbours, whom a glitch pulls along. Twice as far, and so on, while that holds for too many samples.
fn without_outliers(y: &[f64], noise: f64) -> Vec<bool> {
    let mut factor = 8.0;
    loop {
        let valid = within(y, noise, factor);
        let outliers = valid.iter().filter(|v| !**v).count();
        if outliers <= 3 || (outliers as f64) < MOST_OUTLIERS * y.len() as f64 || factor > 1e6 {
            return valid;
        }
        factor *= 2.0;
    }
}

fn within(y: &[f64], noise: f64, factor: f64) -> Vec<bool> {
    let mut valid = vec![true; y.len()];
    let away: Vec<f64> = y
        .windows(5)
        .map(|w| (w[2] - (4.0 * (w[1] + w[3]) - w[0] - w[4]) / 6.0).abs())
        .collect();
    for (i, &e) in away.iter().enumerate() {
        let near = away.get(i.saturating_sub(2)..(i + 3).min(away.len()));
        let largest = near.is_some_and(|near| near.iter().all(|&other| other <= e));
        if e <= factor * noise || !largest {
            continue;
        }
        let first = i.saturating_sub(15);
        let mut around: Vec<f64> = (first..(i + 16).min(away.len()))
            .filter(|k| k.abs_diff(i) > 2)
            .map(|k| away[k])
            .collect();
        valid[i + 2] = e <= factor * median(&mut around);
    }
    valid
}

/// The first sample of each recording that counts: behind a dead start, in which an input as large as those that move the mechanism
/// later does not move it. Every recording must have one: a joint that sticks rests now and then.
fn dead_starts(
    model: &Model,
    runs: &[&Run],
    channels: &[Channel],
    faults: &mut Vec<DataFault>,
) -> Vec<usize> {
    for (i, input) in model.inputs.iter().enumerate() {
        let noise = channels[input.coordinate].noise;
        let ends: Vec<usize> = runs
            .iter()
            .filter_map(|run| dead_until(&run.q[input.coordinate], &run.u[i], noise))
            .collect();
        if runs.len() > 1 && ends.len() == runs.len() {
            let coordinate = &model.mechanics.coordinates()[input.coordinate].name;
            faults.push(DataFault {
                kind: "dead_start".into(),
                column: format!("u.{}", input.name),
                when: runs
                    .iter()
                    .zip(&ends)
                    .map(|(run, &k)| [run.t[0], run.t[k]])
                    .collect(),
                detail: format!(
                    "every recording starts with the input at work and `{coordinate}` at rest; these stretches are left out of \
                     all fits"
                ),
            });
            return ends;
        }
    }
    vec![0; runs.len()]
}

/// The end of a rest under full input in the first quarter of a recording, of at least ten samples.
fn dead_until(q: &[f64], u: &[f64], noise: f64) -> Option<usize> {
    let low = q.iter().copied().fold(f64::INFINITY, f64::min);
    let high = q.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let still = (6.0 * noise).max(1e-3 * (high - low));
    let size = |u: &[f64]| u.iter().map(|u| u.abs()).sum::<f64>() / u.len().max(1) as f64;
    let usual = size(u);
    let mut from = 0;
    let mut end = None;
    for k in 1..q.len() {
        if (q[k] - q[from]).abs() > still {
            if k - from >= 10 && size(&u[from..k]) > 0.7 * usual {
                end = Some(k);
            }
            if from > q.len() / 4 {
                break;
            }
            from = k;
        }
    }
    end.filter(|_| usual > 0.0)
}

fn gaps(t: &[f64]) -> Option<DataFault> {
    let mut intervals: Vec<f64> = t.windows(2).map(|p| p[1] - p[0]).collect();
    let typical = median(&mut intervals);
    let when: Vec<[f64; 2]> = t
        .windows(2)
        .filter(|p| p[1] - p[0] > 1.5 * typical)
        .map(|p| [p[0], p[1]])
        .collect();
    (!when.is_empty()).then(|| DataFault {
        kind: "gap".into(),
        column: "t".into(),
        detail: format!(
            "{} intervals are longer than 1.5 times the usual {typical:.4} s; the input is taken as held over them",
            when.len()
        ),
        when: when.into_iter().take(100).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    #[test]
    fn noise_is_found_under_motion() {
        let normal = Normal::new(0.0, 1e-3).unwrap();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let y: Vec<f64> = (0..3000)
            .map(|k| 0.2 * (5.0 * k as f64 * 0.02).sin() + normal.sample(&mut rng))
            .collect();
        let found = noise(&[y]);
        assert!((found / 1e-3 - 1.0).abs() < 0.1, "{found}");
    }

    #[test]
    fn a_glitch_is_masked_and_a_fast_swing_is_not() {
        let mut y: Vec<f64> = (0..500).map(|k| (10.0 * k as f64 * 0.02).sin()).collect();
        assert!(without_outliers(&y, 1e-3).iter().all(|v| *v));
        y[100] += 0.5;
        let valid = without_outliers(&y, 1e-3);
        assert!(!valid[100] && valid.iter().filter(|v| !**v).count() == 1);
    }

    #[test]
    fn a_rest_under_full_input_at_the_start_is_dead_and_a_later_one_is_not() {
        let u: Vec<f64> = (0..1000).map(|k| 3.0 * (0.1 * k as f64).sin()).collect();
        let mut q: Vec<f64> = (0..1000).map(|k| 0.1 * (0.1 * k as f64).cos()).collect();
        assert_eq!(dead_until(&q, &u, 1e-5), None);
        let stuck = q[500];
        q[500..600].fill(stuck);
        assert_eq!(dead_until(&q, &u, 1e-5), None);
        q[20..120].fill(0.05);
        assert_eq!(dead_until(&q, &u, 1e-5), Some(120));
    }

    #[test]
    fn velocities_that_are_differences_are_recognised() {
        let t: Vec<f64> = (0..50).map(|k| k as f64 * 0.02).collect();
        let q: Vec<f64> = t.iter().map(|t| (3.0 * t).sin()).collect();
        let mut v = vec![0.0];
        v.extend((1..50).map(|k| (q[k] - q[k - 1]) / 0.02));
        assert!(is_difference(&t, &q, &v));
        let true_v: Vec<f64> = t.iter().map(|t| 3.0 * (3.0 * t).cos()).collect();
        assert!(!is_difference(&t, &q, &true_v));
    }
}
