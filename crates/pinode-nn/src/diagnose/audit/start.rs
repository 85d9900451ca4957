//! Recordings that start before the input acts.

use super::super::verdict::DataFault;
use crate::log::Run;
use crate::model::Model;
use crate::shooting::Channel;

/// The first sample of each recording that counts: behind a dead start, in which an input as large as those that move the mechanism
/// later does not move it. Every recording must have one: a joint that sticks rests now and then.
pub fn dead_starts(
    model: &Model,
    runs: &[&Run],
    channels: &[Channel],
    faults: &mut Vec<DataFault>,
) -> Vec<usize> {
    for (i, input) in model.inputs.iter().enumerate() {
        // What pushes a link may balance others, or push another coordinate.
        let Some(c) = input.coordinate() else {
            continue;
        };
        let noise = channels[c].noise;
        let ends: Vec<usize> = runs
            .iter()
            .filter_map(|run| dead_until(&run.q[c], &run.u[i], noise))
            .collect();
        if runs.len() > 1 && ends.len() == runs.len() {
            let coordinate = &model.mechanics.coordinates()[c].name;
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
