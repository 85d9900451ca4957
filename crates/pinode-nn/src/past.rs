//! The state that a model is in by what was measured of the past: no reading after the sample tells of it, so a free run from there predicts.
//!
//! Run over the last [`PAST`] seconds under the inputs of then, the model has its positions where they were read if it began at the right state: that
//! is fitted (a moving-horizon estimate), and where the run ends is the state. One reading has the noise of its sensor, a difference of two that of
//! both over a sample interval; this has what is left of that after as many readings as there are.

use crate::diagnose::audit::audit;
use crate::evaluate::{GAP, Options};
use crate::free_run::{FreeRun, Initial, initial_states};
use crate::hybrid::Hybrid;
use crate::log::{Log, Run, typical_interval};
use crate::model::Model;
use crate::shooting::{FitOptions, HiddenPrior, Member, Window, fit, roll_all};

/// How far back positions tell of the state, s.
pub(crate) const PAST: f64 = 0.3;
/// At least so many samples do.
const FEWEST: usize = 5;
/// Steps of the fit.
const STEPS: usize = 6;
/// Integration steps of the fit are not longer, s: what they miss is far below the sensors' noise.
const LONGEST_STEP: f64 = 5e-3;

/// The states (q, v, h) at samples of recordings.
pub(crate) struct States {
    /// One a sample.
    pub states: Vec<Vec<f64>>,
    /// How many of them are those of [`Initial::Measured`].
    pub fallen_back: usize,
}

/// The states at these samples of these recordings of `logs`; that of [`Initial::Measured`] where fewer than [`FEWEST`] samples are before one without
/// a gap, or the model does not get there.
pub(crate) fn states_by_the_past(
    model: &Model,
    logs: &[Log],
    at: &[(usize, usize)],
    options: &Options,
) -> States {
    let audited = audit(model, logs, &[]);
    let (observations, firsts) = (audited.observations, audited.firsts);
    let hybrid = Hybrid::of(model);
    let theta = hybrid.theta();
    let runs: Vec<_> = logs.iter().flat_map(|log| &log.runs).collect();
    let of = |kind: Initial, longest: f64| -> Vec<Vec<Vec<f64>>> {
        let states = |run: &&Run| {
            let free = FreeRun::new(&hybrid, &run.t, &run.u, longest);
            free.with_hidden(initial_states(model, run, kind))
        };
        runs.iter().map(states).collect()
    };
    let (measured, guesses) = (
        of(Initial::Measured, options.longest_step),
        of(Initial::Estimated, options.longest_step),
    );
    let gaps: Vec<f64> = (observations.runs.iter())
        .map(|run| GAP * typical_interval(&run.t).unwrap_or(f64::INFINITY))
        .collect();
    // (which of `at`, its window), and where that begins.
    let mut asked = Vec::new();
    let mut states = Vec::new();
    for (index, &(run, sample)) in at.iter().enumerate() {
        // Before a recording's first sample that counts nothing tells of a state.
        let Some(last) = sample.checked_sub(firsts[run]) else {
            continue;
        };
        let t = &observations.runs[run].t;
        // Nor does anything behind its last one.
        if last >= t.len() {
            continue;
        }
        let first = beginning(t, last, gaps[run]);
        let count = last + 1 - first;
        if count >= FEWEST {
            asked.push((index, Window { run, first, count }));
            states.push(guesses[run][first + firsts[run]].clone());
        }
    }
    let hidden = HiddenPrior::kept(&states, hybrid.nx() - hybrid.nh());
    let windows: Vec<Window> = asked.iter().map(|(_, window)| *window).collect();
    let interval = observations.runs.iter().flat_map(|run| run.t.windows(2));
    let longest = interval.map(|t| t[1] - t[0]).fold(0.0, f64::max);
    let substeps = ((longest / LONGEST_STEP).ceil() as usize).clamp(1, 100);
    let noise = observations.channels.iter().map(|c| 3.0 * c.noise);
    let fitted = fit(
        &hybrid,
        &observations,
        &windows,
        &[],
        theta.clone(),
        states,
        noise.collect(),
        &hidden,
        &FitOptions {
            substeps,
            iterations: 0,
            state_iterations: STEPS,
        },
    );
    let runs = &observations.runs;
    let inputs: Vec<_> = runs
        .iter()
        .map(|run| hybrid.drive(&run.t, &run.u, substeps, &theta, &[]))
        .collect();
    let members: Vec<Member> = windows
        .iter()
        .zip(&fitted.states)
        .map(|(window, initial)| Member {
            inputs: &inputs[window.run],
            span: (window.first, window.count),
            initial,
        })
        .collect();
    let rolled = roll_all((&hybrid, &theta, &[]), &members, false);
    let mut found: Vec<Vec<f64>> = at
        .iter()
        .map(|&(run, sample)| measured[run][sample].clone())
        .collect();
    let mut fallen_back = at.len();
    for ((index, _), trajectory) in asked.iter().zip(rolled) {
        let last =
            trajectory.and_then(|t| t.states.rchunks(hybrid.nx()).next().map(<[f64]>::to_vec));
        if let Some(last) = last {
            found[*index] = last;
            fallen_back -= 1;
        }
    }
    States {
        states: found,
        fallen_back,
    }
}

/// The first sample of a recording that has [`PAST`] before it, and [`FEWEST`] samples with itself.
pub(crate) fn known_from(run: &Run) -> usize {
    let begin = run.t.first().copied().unwrap_or(0.0);
    let near = run.t.partition_point(|t| *t < begin + PAST);
    near.max(FEWEST - 1)
}

/// Where the stretch to the sample `last` begins: [`PAST`] before it, or farther back where that is too few samples; behind the last gap.
fn beginning(t: &[f64], last: usize, gap: f64) -> usize {
    let near = t[..=last].partition_point(|early| *early < t[last] - PAST);
    let first = near.min((last + 1).saturating_sub(FEWEST));
    let behind_gap = (first..last).rev().find(|&k| t[k + 1] - t[k] > gap);
    behind_gap.map_or(first, |k| k + 1)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::*;

    const PENDULUM: &str = r#"
        name = "pendulum"
        [lagrangian]
        coordinates = ["q"]
        angles = ["q"]
        kinetic = "0.5*q_dot^2"
        potential = "-20*cos(q)"
        [sensor.q]
        position_noise = 1e-3
        velocity = "none"
    "#;
    const NOISE: f64 = 1e-3;
    const SAMPLE: usize = 120;

    /// A pendulum that swings freely: its states, and a log of its angle, which goes away from the motion by `ramp` rad/s after [`SAMPLE`].
    fn recorded(ramp: f64) -> (Model, Log, Vec<[f64; 2]>) {
        let model = Model::parse("pendulum.toml".as_ref(), PENDULUM.to_owned()).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (h, parts) = (0.02, 200);
        let (mut q, mut v) = (1.2_f64, 0.0);
        let mut states = Vec::new();
        let mut log = "t,q.q\n".to_owned();
        for k in 0..240 {
            let t = h * f64::from(k);
            let noise: f64 = rng.sample(StandardNormal);
            let away = ramp * (t - h * SAMPLE as f64).max(0.0);
            log += &format!("{t},{}\n", q + NOISE * noise + away);
            states.push([q, v]);
            for _ in 0..parts {
                // Störmer and Verlet's steps: no code of the library.
                let dt = h / f64::from(parts);
                v -= 0.5 * dt * 20.0 * q.sin();
                q += dt * v;
                v -= 0.5 * dt * 20.0 * q.sin();
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(&path, log).unwrap();
        let log = Log::read(&path, &model).unwrap();
        (model, log, states)
    }

    fn found(model: &Model, log: &Log, samples: impl Iterator<Item = usize>) -> Vec<Vec<f64>> {
        let at: Vec<(usize, usize)> = samples.map(|k| (0, k)).collect();
        states_by_the_past(model, std::slice::from_ref(log), &at, &Options::default()).states
    }

    #[test]
    fn the_state_by_the_past_has_less_than_the_noise_of_one_reading() {
        let (model, log, truth) = recorded(0.0);
        let states = found(&model, &log, 20..230);
        let square = |i: usize| {
            let misses = states.iter().zip(&truth[20..]);
            let sum: f64 = misses
                .map(|(found, truth)| (found[i] - truth[i]).powi(2))
                .sum();
            (sum / states.len() as f64).sqrt()
        };
        assert!(square(0) < 0.7 * NOISE, "{}", square(0));
        // A difference of two readings has 70 mrad/s.
        let difference = NOISE * 2.0_f64.sqrt() / 0.02;
        assert!(square(1) < 0.1 * difference, "{}", square(1));
    }

    /// Two recordings of a mass that a held force moves only after a dead start of 0.6 s: x, and v = F (t − 0.6)/m then.
    #[test]
    fn a_dead_start_does_not_shift_the_states_after_it() {
        let text = r#"
            name = "mass"
            [lagrangian]
            coordinates = ["x"]
            kinetic = "0.5*2*x_dot^2"
            potential = "0"
            [[input]]
            name = "push"
            joint = "x"
            [sensor.x]
            position_noise = 1e-4
            velocity = "none"
        "#;
        let model = Model::parse("mass.toml".as_ref(), text.to_owned()).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let (h, dead, rows) = (0.02, 30, 200);
        let mut log = "t,q.x,u.push,run\n".to_owned();
        for run in 0..2 {
            for k in 0..rows {
                let noise: f64 = rng.sample(StandardNormal);
                let moved = h * (k as f64 - dead as f64).max(0.0);
                let x = 0.5 * 1.5 * moved.powi(2);
                log += &format!("{},{},3,{run}\n", h * k as f64, x + 1e-4 * noise);
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(&path, log).unwrap();
        let log = Log::read(&path, &model).unwrap();
        let firsts = audit(&model, std::slice::from_ref(&log), &[]).firsts;
        assert!(
            firsts.iter().all(|first| (dead..dead + 10).contains(first)),
            "{firsts:?}"
        );
        let at = [(0, 60), (1, 199), (0, 2)];
        let found = states_by_the_past(&model, &[log], &at, &Options::default());
        assert_eq!(found.fallen_back, 1);
        let states = found.states;
        for (state, (_, k)) in states.iter().zip(&at[..2]) {
            let moved = h * (k - dead) as f64;
            assert!((state[0] - 0.75 * moved.powi(2)).abs() < 3e-4, "{state:?}");
            assert!((state[1] - 1.5 * moved).abs() < 3e-3, "{state:?}");
        }
        assert!(states[2][0].abs() < 1e-3, "{:?}", states[2]);
    }

    #[test]
    fn a_stretch_goes_back_until_it_has_enough_samples_but_over_no_gap() {
        let slow: Vec<f64> = (0..20).map(|k| 0.1 * f64::from(k)).collect();
        assert_eq!(beginning(&slow, 10, 1.0), 6);
        assert_eq!(beginning(&slow, 2, 1.0), 0);
        let fast: Vec<f64> = (0..60).map(|k| 0.01 * f64::from(k)).collect();
        assert!((25..=26).contains(&beginning(&fast, 55, 0.1)));
        let with_gap: Vec<f64> = slow
            .iter()
            .map(|t| t + 5.0 * (t / 0.75).min(1.0).floor())
            .collect();
        assert_eq!(beginning(&with_gap, 10, 1.0), 8);
    }

    /// A model with an input more took what is behind the log's columns.
    #[test]
    fn a_log_that_was_read_for_another_model_is_refused() {
        let (model, log, _) = recorded(0.0);
        let driven = PENDULUM.to_owned() + "\n[[input]]\nname = 'motor'\njoint = 'q'\n";
        let driven = Model::parse("driven.toml".as_ref(), driven).unwrap();
        let mut other = log.clone();
        let still = vec![0.0; log.runs[0].len()];
        other.runs[0].u.push(still);
        for (model, log) in [(&driven, log), (&model, other)] {
            for initial in [Initial::Measured, Initial::Past] {
                let options = Options {
                    initial,
                    ..Options::default()
                };
                let refused =
                    crate::evaluate::evaluate(model, std::slice::from_ref(&log), &options);
                let words = refused.unwrap_err().to_string();
                assert!(words.contains("inputs, and the model has"), "{words}");
            }
        }
    }

    /// At 10 Hz 0.3 s have four samples: all windows started from the measured state, and nothing was said.
    #[test]
    fn a_slow_log_tells_of_the_past_too_and_where_it_does_not_is_counted() {
        let (model, mut log, _) = recorded(0.0);
        let every_fifth = |column: &Vec<f64>| column.iter().copied().step_by(5).collect();
        for run in &mut log.runs {
            run.t = every_fifth(&run.t);
            run.q = run.q.iter().map(every_fifth).collect();
        }
        let options = Options {
            initial: Initial::Past,
            ..Options::default()
        };
        let evaluation = crate::evaluate::evaluate(&model, &[log], &options).unwrap();
        // The four first samples have too few with them.
        assert_eq!((evaluation.initial, evaluation.fallen_back), ("past", 4));
        assert!(evaluation.windows > 30);
    }

    #[test]
    fn what_is_measured_later_does_not_move_the_state() {
        let [(model, usual, _), (_, other, _)] = [recorded(0.0), recorded(0.5)];
        let [usual, other] = [&usual, &other].map(|log| found(&model, log, SAMPLE..SAMPLE + 1));
        for (usual, other) in usual[0].iter().zip(&other[0]) {
            // The noise of the sensor is taken from the whole log, and hardly changes.
            assert!((usual - other).abs() < 0.01 * NOISE, "{usual} {other}");
        }
    }
}
