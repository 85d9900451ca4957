//! Velocities that are not the rates of their positions: in other units, with another sign, of another joint, or none at all.
//!
//! Over spans of some samples a position changes by Δq and the velocity says ∫ v dt. Where both are the same motion, they are the same but for noise and
//! for the time by which one of them is late.

use super::super::verdict::DataFault;
use super::noise::median;
use crate::log::Run;

/// Samples of a span: of slow motion, and of one that swings to and fro within that.
const SPANS: [usize; 2] = [10, 3];
/// Spans in which a position changes by so many times its noise tell something, and so many of them are needed.
const MOVES: f64 = 20.0;
const FEWEST: usize = 20;
/// ∫ v dt that is off by more than this part of Δq, in the middle, is another motion: a rate that is two samples late is off by a fifth of that where a swing
/// takes a second at 50 Hz.
const OFF: f64 = 0.5;
/// What is left of Δq by a constant factor on v where that is all that is wrong.
const BY_A_FACTOR: f64 = 0.1;

/// The velocities of a coordinate in some recordings, `q` its positions without the turns and `noise` theirs, where they are not its rates.
pub fn fault(
    runs: &[&Run],
    coordinate: usize,
    (q, noise): (&[Vec<f64>], f64),
    column: &str,
) -> Option<DataFault> {
    let of_span = |samples: usize| {
        let of_run = |(run, q): (&&Run, &Vec<f64>)| {
            let v = run.v[coordinate].as_deref();
            v.map_or(Vec::new(), |v| spans(samples, &run.t, q, v))
        };
        let all = runs.iter().zip(q).flat_map(of_run);
        let moving = all.filter(|[dq, _]| dq.abs() > MOVES * noise);
        moving.collect::<Vec<[f64; 2]>>()
    };
    let moving = SPANS.map(of_span);
    let told = moving.iter().filter(|spans| spans.len() >= FEWEST);
    let best = told.min_by(|a, b| left(a, 1.0).total_cmp(&left(b, 1.0)))?;
    if left(best, 1.0) <= OFF {
        return None;
    }
    let ratios = best.iter().map(|[dq, by_v]| by_v / dq);
    let ratio = median(&mut ratios.collect::<Vec<f64>>());
    let what = match ratio != 0.0 && left(best, ratio.recip()) < BY_A_FACTOR {
        true => format!("they are {ratio:.4} times those: their unit or sign is another one"),
        false => format!(
            "over short spans they are off by {:.0} % of the way that it goes",
            100.0 * left(best, 1.0)
        ),
    };
    Some(DataFault {
        kind: "velocity".into(),
        column: column.to_owned(),
        when: Vec::new(),
        detail: format!(
            "these are not the rates of the positions: {what}; they are left out of all fits, and nothing should start from them"
        ),
    })
}

/// What is left of Δq, as a part of it and in the middle, where v is multiplied by a factor.
fn left(spans: &[[f64; 2]], factor: f64) -> f64 {
    let off = spans
        .iter()
        .map(|[dq, by_v]| (dq - factor * by_v).abs() / dq.abs());
    median(&mut off.collect::<Vec<f64>>())
}

/// Δq and ∫ v dt of spans one after the other.
fn spans(samples: usize, t: &[f64], q: &[f64], v: &[f64]) -> Vec<[f64; 2]> {
    let starts = (0..t.len()).step_by(samples);
    let span = |k: usize| {
        let steps = k..k + samples;
        let by_v = steps.map(|i| 0.5 * (v[i] + v[i + 1]) * (t[i + 1] - t[i]));
        [q[k + samples] - q[k], by_v.sum()]
    };
    starts.filter(|k| k + samples < t.len()).map(span).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// rad/s.
    const FREQUENCY: f64 = 6.0;

    fn rate(t: f64) -> f64 {
        FREQUENCY * (FREQUENCY * t).cos()
    }

    /// A swing of a second, 1 rad to each side, sampled at 50 Hz, with these velocities.
    fn swing(velocity: impl Fn(f64) -> f64) -> Run {
        let t: Vec<f64> = (0..500).map(|k| 0.02 * f64::from(k)).collect();
        Run {
            id: "0".into(),
            q: vec![t.iter().map(|t| (FREQUENCY * t).sin()).collect()],
            v: vec![Some(t.iter().map(|t| velocity(*t)).collect())],
            u: Vec::new(),
            t,
        }
    }

    fn found(run: &Run) -> Option<String> {
        let q = (&run.q[..], 1e-3);
        fault(&[run], 0, q, "v.joint").map(|fault| fault.detail)
    }

    #[test]
    fn velocities_that_are_rates_are_no_fault_though_they_are_late_or_noisy() {
        assert_eq!(found(&swing(rate)), None);
        assert_eq!(found(&swing(|t| rate(t - 0.04))), None);
        assert_eq!(found(&swing(|t| 1.2 * rate(t) + (1e4 * t).sin())), None);
        // Nor is anything that rests.
        let mut at_rest = swing(|_| 0.3);
        at_rest.q[0].fill(1.0);
        assert_eq!(found(&at_rest), None);
    }

    /// Ten samples are two periods: hardly any way is made in them.
    #[test]
    fn the_rates_of_a_motion_of_ten_hertz_are_no_fault() {
        let fast = 2.0 * std::f64::consts::PI * 9.7;
        let mut run = swing(|t| fast * (fast * t).cos());
        run.q[0] = run.t.iter().map(|t| (fast * t).sin()).collect();
        assert_eq!(found(&run), None);
    }

    #[test]
    fn velocities_in_other_units_of_another_sign_or_none_at_all_are_told() {
        let told = |velocity: &dyn Fn(f64) -> f64| found(&swing(velocity)).unwrap();
        assert!(told(&|t| rate(t).to_degrees()).contains("57.2"));
        assert!(told(&|t| -rate(t)).contains("-0.99") || told(&|t| -rate(t)).contains("-1.00"));
        assert!(told(&|_| 0.0).contains("off by 100 %"));
        assert!(told(&|t| FREQUENCY * (11.0 * t).cos()).contains("off by"));
    }
}
