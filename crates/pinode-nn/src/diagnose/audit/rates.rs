//! Velocities that are not the rates of their positions: in other units, with another sign, of another joint, late, or none at all.
//!
//! Over spans of some samples a position changes by Δq and the velocity says ∫ v dt. Where both are the same motion, they are the same but for noise and
//! for the time by which the velocity is late, v(t) = q̇(t − τ), or filtered, τ v̇ = q̇ − v:
//!
//! ∫ v dt − Δq = −τ Δv.

use super::super::verdict::DataFault;
use super::noise::{Readings, median, noise};
use crate::diagnose::smooth::unwrapped;
use crate::digits::uncertain;
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

/// What is late by more than this many rows, and by so many standard errors, is not what differences of the positions are: these are half a row late, …
const LATE_ROWS: f64 = 1.5;
const SURE: f64 = 5.0;
/// … and tells something of it where the rates change, in the middle, by more than this part of their noise in that time.
const LATE_TELLS: f64 = 1.0;

/// Factors of different joints that differ by less than this are one.
const SAME: f64 = 0.05;
/// Factors that people choose, but for powers of ten.
const ROUND: [f64; 5] = [1.0, 2.0, 4.0, 5.0, 6.0];

/// The velocities of a coordinate in some recordings, where they are not the rates of its positions.
pub fn fault(model: &Model, runs: &[&Run], c: usize) -> Option<DataFault> {
    let coordinate = &model.mechanics.coordinates()[c];
    let compared = compared(runs, c, coordinate.wraps)?;
    let what = match (compared.off > OFF, compared.factor, compared.late) {
        (true, Some(factor), _) => format!(
            "these are not the rates of the positions: they are {factor:.4} times those: their unit or sign is another one, or `t` counts otherwise"
        ),
        (true, None, _) => format!(
            "these are not the rates of the positions: over short spans they are off by {:.0} % of the way that it goes",
            100.0 * compared.off
        ),
        (false, _, Some(late)) => format!(
            "these are late, as a filter makes them: by {} ms behind the rates of the positions",
            uncertain(1e3 * late.by, Some(1e3 * late.error))
        ),
        (false, _, None) => return None,
    };
    Some(DataFault {
        kind: "velocity".into(),
        column: format!("v.{}", coordinate.name),
        when: Vec::new(),
        detail: format!(
            "{what}; they are left out of all fits, and nothing should start from them"
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
    /// By how much v is late, where it clearly is.
    late: Option<Late>,
}

/// By how much velocities are late, s.
struct Late {
    by: f64,
    error: f64,
}

/// What happens in a span.
struct Span {
    /// Δq.
    way: f64,
    /// ∫ v dt.
    by_v: f64,
    /// Δv.
    change: f64,
    /// s.
    duration: f64,
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
    let least = MOVES * noise(&readings);
    let of_span = |samples: usize| {
        let of_runs = measured.iter().zip(&q);
        let all = of_runs.flat_map(|((run, v), q)| spans(samples, &run.t, q, v));
        all.collect::<Vec<Span>>()
    };
    let all = SPANS.map(of_span);
    let moving = all.each_ref().map(|all| {
        let moving = all.iter().filter(|span| span.way.abs() > least);
        moving.collect::<Vec<&Span>>()
    });
    let told = moving.iter().filter(|spans| spans.len() >= FEWEST);
    let best = told.min_by(|a, b| left(a, 1.0).total_cmp(&left(b, 1.0)))?;
    let ratios = best.iter().map(|span| span.by_v / span.way);
    let factor = median(&mut ratios.collect::<Vec<f64>>());
    let rates = measured.iter();
    let rates = rates.map(|(run, v)| Readings { t: &run.t, y: v });
    let noise_of_rates = noise(&rates.collect::<Vec<Readings>>());
    Some(Compared {
        off: left(best, 1.0),
        factor: (factor != 0.0 && left(best, factor.recip()) < BY_A_FACTOR).then_some(factor),
        late: late(&all[0], noise_of_rates),
    })
}

/// What is left of Δq, as a part of it and in the middle, where v is multiplied by a factor.
fn left(spans: &[&Span], factor: f64) -> f64 {
    let off = spans
        .iter()
        .map(|span| (span.way - factor * span.by_v).abs() / span.way.abs());
    median(&mut off.collect::<Vec<f64>>())
}

/// By how much v is late, τ = (Δq − ∫ v dt)/Δv in the middle of the spans in which v changes most, where that is clear and tells something.
fn late(spans: &[Span], noise_of_rates: f64) -> Option<Late> {
    let middle = |of: &dyn Fn(&Span) -> f64, spans: &[&Span]| {
        median(&mut spans.iter().map(|span| of(span)).collect::<Vec<f64>>())
    };
    let all: Vec<&Span> = spans.iter().collect();
    let usual = middle(&|span| span.change.abs(), &all);
    let changing = all.iter().copied();
    let changing: Vec<&Span> = changing
        .filter(|span| span.change.abs() > usual.max(MOVES * noise_of_rates))
        .collect();
    if changing.len() < FEWEST {
        return None;
    }
    let of = |span: &Span| (span.way - span.by_v) / span.change;
    let by = middle(&of, &changing);
    // Of a median, where the scatter is normal.
    let scatter = 1.4826 * middle(&|span| (of(span) - by).abs(), &changing);
    let error = 1.2533 * scatter / (changing.len() as f64).sqrt();
    let row = middle(&|span| span.duration, &all) / SPANS[0] as f64;
    let tells = by * middle(&|span| span.change.abs() / span.duration, &all);
    let is_late = by > LATE_ROWS * row && by > SURE * error && tells > LATE_TELLS * noise_of_rates;
    is_late.then_some(Late { by, error })
}

/// Spans of so many samples, one after the other.
fn spans(samples: usize, t: &[f64], q: &[f64], v: &[f64]) -> Vec<Span> {
    let starts = (0..t.len()).step_by(samples);
    let span = |k: usize| {
        let steps = k..k + samples;
        let by_v = steps.map(|i| 0.5 * (v[i] + v[i + 1]) * (t[i + 1] - t[i]));
        Span {
            way: q[k + samples] - q[k],
            by_v: by_v.sum(),
            change: v[k + samples] - v[k],
            duration: t[k + samples] - t[k],
        }
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
    fn velocities_that_are_rates_are_no_fault_though_they_are_a_row_late_or_noisy() {
        assert_eq!(found(&swing(rate)), None);
        assert_eq!(found(&swing(|t| rate(t - 0.02))), None);
        assert_eq!(found(&swing(|t| 1.2 * rate(t) + (1e4 * t).sin())), None);
        // Nor is anything that rests.
        let mut at_rest = swing(|_| 0.3);
        at_rest.q[0].fill(1.0);
        assert_eq!(found(&at_rest), None);
    }

    /// Both without noise, and where it hides what is late by so little.
    #[test]
    fn late_and_filtered_velocities_are_told_where_that_is_more_than_their_noise() {
        let late = found(&swing(|t| rate(t - 0.05))).unwrap();
        assert!(late.contains("late") && late.contains("by 49."), "{late}");
        // 1/(τ s + 1) of the rates, in the long run.
        let tau = 0.05_f64;
        let filtered = |t: f64| {
            let phase = (tau * FREQUENCY).atan();
            FREQUENCY * phase.cos() * (FREQUENCY * t - phase).cos()
        };
        let late = found(&swing(filtered)).unwrap();
        assert!(late.contains("by 50.") || late.contains("by 49."), "{late}");
        let noisy = |t: f64| rate(t - 0.05) + 8.0 * (1e4 * t).sin();
        assert_eq!(found(&swing(noisy)), None);
        assert_eq!(found(&swing(|t| rate(t + 0.05))), None, "early");
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
