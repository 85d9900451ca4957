//! Velocities that are not the rates of their positions: in other units, with another sign, of another joint, or none at all.
//!
//! Over spans of some samples a position changes by Δq and the velocity says ∫ v dt. Where both are the same motion, they are the same but for noise and
//! for the time by which one of them is late.

use super::super::verdict::DataFault;
use super::noise::{Readings, median, noise};
use crate::diagnose::smooth::unwrapped;
use crate::log::Run;
use crate::model::Model;

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

/// Factors of different joints that differ by less than this are one.
const SAME: f64 = 0.05;
/// Factors that people choose, but for powers of ten.
const ROUND: [f64; 5] = [1.0, 2.0, 4.0, 5.0, 6.0];

/// The velocities of a coordinate in some recordings, where they are not the rates of its positions.
pub fn fault(model: &Model, runs: &[&Run], c: usize) -> Option<DataFault> {
    let coordinate = &model.mechanics.coordinates()[c];
    let compared = compared(runs, c, coordinate.wraps)?;
    if compared.off <= OFF {
        return None;
    }
    let what = match compared.factor {
        Some(factor) => format!(
            "they are {factor:.4} times those: their unit or sign is another one, or `t` counts otherwise"
        ),
        None => format!(
            "over short spans they are off by {:.0} % of the way that it goes",
            100.0 * compared.off
        ),
    };
    Some(DataFault {
        kind: "velocity".into(),
        column: format!("v.{}", coordinate.name),
        when: Vec::new(),
        detail: format!(
            "these are not the rates of the positions: {what}; they are left out of all fits, and nothing should start from them"
        ),
    })
}

/// What `t` has to be multiplied by for the velocities to be the rates of the positions, all by the same factor; a round number where one is near. `None` where
/// they are so as it is, or by no factor.
pub fn scale_of_time(model: &Model, runs: &[&Run]) -> Option<f64> {
    let coordinates = model.mechanics.coordinates().iter().enumerate();
    let compared = coordinates.filter_map(|(c, coordinate)| compared(runs, c, coordinate.wraps));
    let factors: Vec<f64> = compared
        .map(|compared| compared.factor)
        .collect::<Option<_>>()?;
    let factor = median(&mut factors.clone());
    let is_that = |of_joint: &f64| (of_joint / factor - 1.0).abs() < SAME;
    let is_another = factor > 0.0 && (factor - 1.0).abs() > OFF;
    if factors.is_empty() || !is_another || !factors.iter().all(is_that) {
        return None;
    }
    let scale = factor.recip();
    let tens = 10.0_f64.powi(scale.log10().floor() as i32);
    let round = ROUND.iter().map(|digit| digit * tens);
    let round = round.chain([10.0 * tens]);
    let near = |round: &f64| (round / scale - 1.0).abs() < SAME;
    Some(round.into_iter().find(near).unwrap_or(scale))
}

/// ∫ v dt beside Δq.
struct Compared {
    /// By how much it is off, as a part of Δq and in the middle.
    off: f64,
    /// How many times Δq it is, where that is all that is wrong.
    factor: Option<f64>,
}

/// `None` where no velocities were measured, or too little moves.
fn compared(runs: &[&Run], coordinate: usize, wraps: bool) -> Option<Compared> {
    let measured = runs
        .iter()
        .filter_map(|run| Some((*run, run.v[coordinate].as_deref()?)));
    let measured: Vec<(&Run, &[f64])> = measured.collect();
    if measured.is_empty() {
        return None;
    }
    let unfolded = |(run, _): &(&Run, &[f64])| match wraps {
        true => unwrapped(&run.q[coordinate]),
        false => run.q[coordinate].clone(),
    };
    let q: Vec<Vec<f64>> = measured.iter().map(unfolded).collect();
    let readings = measured.iter().zip(&q);
    let readings = readings.map(|((run, _), y)| Readings { t: &run.t, y });
    let readings: Vec<Readings> = readings.collect();
    let noise = noise(&readings);
    let of_span = |samples: usize| {
        let of_runs = measured.iter().zip(&q);
        let all = of_runs.flat_map(|((run, v), q)| spans(samples, &run.t, q, v));
        let moving = all.filter(|[dq, _]| dq.abs() > MOVES * noise);
        moving.collect::<Vec<[f64; 2]>>()
    };
    let moving = SPANS.map(of_span);
    let told = moving.iter().filter(|spans| spans.len() >= FEWEST);
    let best = told.min_by(|a, b| left(a, 1.0).total_cmp(&left(b, 1.0)))?;
    let ratios = best.iter().map(|[dq, by_v]| by_v / dq);
    let factor = median(&mut ratios.collect::<Vec<f64>>());
    Some(Compared {
        off: left(best, 1.0),
        factor: (factor != 0.0 && left(best, factor.recip()) < BY_A_FACTOR).then_some(factor),
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

    use std::path::Path;

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

    fn model() -> Model {
        let text = "lagrangian = { coordinates = [\"joint\"], kinetic = \"0.5*joint_dot^2\", potential = \"18*joint^2\" }\n";
        Model::parse(Path::new("swing.toml"), text.to_owned()).unwrap()
    }

    fn found(run: &Run) -> Option<String> {
        fault(&model(), &[run], 0).map(|fault| fault.detail)
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

    #[test]
    fn a_clock_that_runs_at_another_pace_is_told_by_the_velocities() {
        let paced = |pace: f64, velocity: f64| {
            let mut run = swing(|t| velocity * rate(t));
            for t in &mut run.t {
                *t *= pace;
            }
            scale_of_time(&model(), &[&run])
        };
        assert_eq!(paced(1.0, 1.0), None);
        assert_eq!(paced(2.0, 1.0), Some(0.5));
        assert_eq!(paced(0.1, 1.0), Some(10.0));
        assert_eq!(paced(1e3, 1.0), Some(1e-3));
        assert!((paced(1.0 / 3.0, 1.0).unwrap() - 3.0).abs() < 0.05);
        // That is a sign, and no time runs backwards.
        assert_eq!(paced(1.0, -1.0), None);
        let mut without = swing(rate);
        without.v[0] = None;
        assert_eq!(scale_of_time(&model(), &[&without]), None);
    }
}
