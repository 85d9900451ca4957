//! The paper's rig (Roehrl et al. 2020): its recordings have the paper's statistics, and its true motion is what was recorded.

use std::path::PathBuf;

use approx::{assert_abs_diff_eq, assert_relative_eq};
use cartpole::config::{ConfigError, PaperConfig};
use cartpole::paper::{
    Contestant, Error, Experiment, Friction, Lesson, PaperRig, Start, StartsAt, report, table,
    true_errors,
};
use cartpole::rig::plant::{self, Plant};
use cartpole::rig::truth::State;

fn settings() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole/paper.toml")
}

fn rig(friction: Friction) -> PaperRig {
    PaperRig::read(&settings()).unwrap().with_friction(friction)
}

const BOTH: [Friction; 2] = [Friction::Mild, Friction::Strong];

#[test]
fn a_recording_has_the_statistics_of_table_1() {
    for friction in BOTH {
        for seed in 1..=3 {
            let recording = rig(friction).record(table::SAMPLES, seed).unwrap();
            assert_eq!(recording.log.len(), table::SAMPLES);
            let ours = table::statistics(&recording.log);
            for (column, (ours, paper)) in ours.iter().zip(&table::TABLE_1).enumerate() {
                let [mean, std, min, max] = ours.departures(paper);
                let context = format!("{friction:?}, seed {seed}: {ours:?}");
                assert!(mean < 0.15 && std < 0.15, "{context}");
                // The extremes of the cart's speed are glitches of its sensor.
                if column != 2 {
                    assert!(min < 0.15 && max < 0.15, "{context}");
                } else {
                    assert!(min < 0.5 && max < 0.5, "{context}");
                }
            }
            // "about 200 movements" in eight minutes.
            assert!((160..240).contains(&recording.moves), "{}", recording.moves);
        }
    }
}

#[test]
fn the_mechanism_is_that_of_table_2() {
    use table::{CART_MASS, GRAVITY, POLE_LENGTH, POLE_MASS, TIP_MASS};
    let config = PaperConfig::read(&settings()).unwrap();
    let mut plant = plant::read(&config.urdf).unwrap();
    let total = CART_MASS + POLE_MASS + TIP_MASS;
    let moment = (POLE_MASS / 2.0 + TIP_MASS) * POLE_LENGTH;
    let inertia = (POLE_MASS / 3.0 + TIP_MASS) * POLE_LENGTH.powi(2);
    for (phi, rate) in [(0.0, 0.0), (0.7, 3.0), (2.0, -11.0), (4.5, 6.0)] {
        let (mass, bias) = plant.mass_and_bias([0.1, phi], [0.4, rate]);
        let (sin, cos) = f64::sin_cos(phi);
        assert_relative_eq!(mass[0][0], total, max_relative = 1e-12);
        assert_relative_eq!(mass[1][1], inertia, max_relative = 1e-12);
        assert_abs_diff_eq!(mass[0][1], moment * cos, epsilon = 1e-14);
        assert_abs_diff_eq!(bias[0], -moment * sin * rate * rate, epsilon = 1e-12);
        assert_abs_diff_eq!(bias[1], -moment * GRAVITY * sin, epsilon = 1e-14);
    }
    let mild = config.friction.mild;
    let mean = 0.5 * (mild.coulomb[0] + mild.coulomb[1]);
    assert_relative_eq!(
        mean,
        table::CART_FRICTION * total * GRAVITY,
        max_relative = 1e-3
    );
    assert_eq!(mild.pole_viscous, table::POLE_FRICTION);
}

#[test]
fn the_encoder_has_a_step_of_which_the_extremes_of_table_1_are_multiples() {
    let config = PaperConfig::read(&settings()).unwrap();
    let step = std::f64::consts::TAU / f64::from(config.sensors.encoder_counts);
    let [_, phi, _, rate] = table::TABLE_1;
    // The table gives three decimals.
    for (value, in_one_step) in [
        (phi.max, step),
        (rate.min, step * config.rate),
        (rate.max, step * config.rate),
    ] {
        let steps = (value / in_one_step).round();
        assert_abs_diff_eq!(value, steps * in_one_step, epsilon = 0.5e-3);
    }
    assert_abs_diff_eq!((3.0_f64.to_radians() / step).fract(), 0.0, epsilon = 1e-9);
}

#[test]
fn measured_velocities_are_backward_differences() {
    let log = rig(Friction::Mild).record(2000, 4).unwrap().log;
    let h = 0.02;
    for k in 1..log.len() {
        assert_abs_diff_eq!(
            log.v[0][k],
            (log.q[0][k] - log.q[0][k - 1]) / h,
            epsilon = 1e-9
        );
        let turn = log.q[1][k] - log.q[1][k - 1];
        let turn = turn - std::f64::consts::TAU * (turn / std::f64::consts::TAU).round();
        assert_abs_diff_eq!(log.v[1][k], turn / h, epsilon = 1e-9);
        assert_abs_diff_eq!(log.t[k], k as f64 * h, epsilon = 1e-9);
    }
    let all = log.q[1].iter();
    assert!(
        all.clone()
            .all(|phi| (0.0..std::f64::consts::TAU).contains(phi))
    );
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_another_recording() {
    let rig = rig(Friction::Strong);
    let recording = rig.record(1500, 5).unwrap();
    assert_eq!(recording, rig.record(1500, 5).unwrap());
    assert_ne!(recording.log.u, rig.record(1500, 6).unwrap().log.u);
    // A longer one begins as a shorter one does.
    assert_eq!(rig.record(2000, 5).unwrap().log.u[..1500], recording.log.u);
}

/// The largest difference of the states of a roll-out to the recorded ones, by coordinate.
fn difference(rig: &PaperRig, k: usize, steps: usize) -> f64 {
    let recording = rig.record(k + steps + 1, 7).unwrap();
    let (u, truth) = (&recording.log.u, &recording.truth);
    let start = Start {
        state: truth.states[k],
        motor: Some(truth.motor[k]),
    };
    let run = rig.true_run(&start, &u[..k], &u[k..k + steps]).unwrap();
    assert_eq!(run.len(), steps + 1);
    let mut worst: f64 = 0.0;
    for (State { q, v }, recorded) in run.iter().zip(&truth.states[k..]) {
        for i in 0..2 {
            worst = worst.max((q[i] - recorded.q[i]).abs());
            worst = worst.max((v[i] - recorded.v[i]).abs());
        }
    }
    worst
}

#[test]
fn the_true_motion_from_the_true_state_is_the_recorded_one() {
    for friction in BOTH {
        let mut rig = rig(friction);
        for k in [100, 431, 1204] {
            assert!(difference(&rig, k, 30) < 1e-6, "{friction:?} at {k}");
        }
        rig.settings.string = None;
        assert!(difference(&rig, 500, 30) < 1e-6, "without a string");
        rig.settings.delay = 0.0;
        assert!(difference(&rig, 500, 30) < 1e-6, "without a delay");
        rig.settings.delay = 0.04;
        rig.settings.rail = None;
        assert!(difference(&rig, 500, 30) < 1e-6, "without ends of the rail");
    }
}

#[test]
fn the_inputs_of_the_last_delay_move_the_cart() {
    let mut rig = rig(Friction::Mild);
    rig.settings.delay = 0.03;
    assert_eq!(rig.past(), 2);
    let start = Start {
        state: State::HANGING,
        motor: None,
    };
    let end = |past: &[f64]| rig.true_run(&start, past, &[0.0; 3]).unwrap()[3].q[0];
    assert_eq!(end(&[]), 0.0);
    // Older ones have passed; of the last but one the first 10 ms are left, of the last all 20 ms.
    assert_eq!(end(&[2.0, 0.0, 0.0]), 0.0);
    let (early, late) = (end(&[2.0, 0.0]), end(&[0.0, 2.0]));
    assert!(0.0 < early && early < late, "{early} {late}");
}

#[test]
fn the_force_on_the_cart_is_the_rate_of_its_momentum() {
    for friction in BOTH {
        for with_string in [true, false] {
            let mut rig = rig(friction);
            rig.settings.delay = 0.0;
            rig.settings.rate = 1000.0;
            if !with_string {
                rig.settings.string = None;
            }
            // At 1 kHz the force at an instant is that over the step, but where it jumps.
            let truth = rig.record(8000, 2).unwrap().truth;
            let mut apart: Vec<f64> = (0..truth.force.len() - 1)
                .map(|k| {
                    let mean = 0.5 * (truth.force[k] + truth.force[k + 1]);
                    (if with_string { mean } else { truth.force[k] } - truth.mean_force[k]).abs()
                })
                .collect();
            apart.sort_by(f64::total_cmp);
            let most = apart[apart.len() * 95 / 100];
            assert!(most < 0.02, "{friction:?} {with_string}: {most} N");
        }
    }
}

#[test]
fn a_cart_at_rest_is_held_by_its_friction() {
    // A hand that does nothing: the force on the cart is what the hanging pole asks for, which is none.
    let mut rig = rig(Friction::Strong);
    rig.settings.operator.limit = 0.1;
    rig.settings.operator.resolution = 0.05;
    let recording = rig.record(100, 1).unwrap();
    for (force, state) in recording.truth.force.iter().zip(&recording.truth.states) {
        // sin π is no exact 0 in floating-point numbers.
        assert!(state.v[0] == 0.0 && state.v[1].abs() < 1e-12, "{state:?}");
        assert_abs_diff_eq!(*force, 0.0, epsilon = 1e-12);
    }
    assert!(recording.log.u.iter().any(|u| *u != 0.0));
}

#[test]
fn the_true_model_misses_the_measured_motion_by_the_noise_of_its_start() {
    for (friction, most) in [
        (Friction::Mild, [0.03, 0.25, 0.15, 1.6]),
        (Friction::Strong, [0.025, 0.25, 0.12, 1.5]),
    ] {
        let rig = rig(friction);
        let recording = rig.record(table::TEST_SAMPLES, 11).unwrap();
        let windows = (300, 30);
        let measured = true_errors(&rig, &recording, windows, StartsAt::Measured).unwrap();
        let from_true = true_errors(&rig, &recording, windows, StartsAt::True).unwrap();
        for i in 0..4 {
            assert!(measured[i] < most[i], "{friction:?}: {measured:?}");
            assert!(from_true[i] < measured[i], "{from_true:?} {measured:?}");
        }
        // From the true state what is left is the noise of the positions: 0.8 mm √(2/π) and half a count.
        assert!(
            from_true[0] < 1.2e-3 && from_true[1] < 4e-3,
            "{from_true:?}"
        );
    }
}

/// What the whole experiment finds is in BENCHMARKS; here all of it runs, on little.
#[test]
fn the_experiment_compares_all_models_and_draws_them() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = Experiment {
        samples: [2500, 700],
        outlook: vec![Lesson::Calm],
        second: true,
        seeds: vec![1],
        epochs: Some(3),
        windows: 40,
    };
    let models = settings().parent().unwrap().to_owned();
    let mut told = Vec::new();
    let outcome = experiment
        .run(&models, folder.path(), &mut |what| {
            told.push(what.to_owned());
        })
        .unwrap();
    let rigs: Vec<&str> = outcome.tables.iter().map(|table| table.rig).collect();
    assert_eq!(rigs, ["mild", "mild", "strong", "furuta"]);
    assert!(told.iter().any(|what| what.contains("black box")));
    for table in &outcome.tables {
        let learners = match table.learnt_from {
            Lesson::All => Contestant::ALL.len(),
            _ => 3,
        };
        assert_eq!(table.rows.len(), 3 * learners + 2);
        let of = |model: &str, starts: &str| {
            let mut rows = table.rows.iter();
            let row = rows.find(|row| row.model == model && row.starts == starts);
            row.unwrap().mean
        };
        for row in &table.rows {
            assert!(
                row.mean.iter().all(|x| *x > 0.0 && x.is_finite()),
                "{row:?}"
            );
        }
        if table.learnt_from != Lesson::All {
            continue;
        }
        let (truth, naive) = (of("true", "true"), of("constant-velocity", "measured"));
        let ours = of("ours", "past");
        for k in 0..4 {
            assert!(truth[k] < ours[k] && ours[k] < naive[k], "{k}: {table:?}");
        }
    }
    let page = report(&experiment, &outcome, folder.path()).unwrap();
    let page = std::fs::read_to_string(page).unwrap();
    // Two roll-outs and the errors of four signals on three rigs.
    assert_eq!(page.matches("class=\"plot\"").count(), 36);
}

#[test]
fn faulty_settings_are_refused() {
    let text = std::fs::read_to_string(settings()).unwrap();
    let wrong = text.replace("delay      = 0.030", "delay      = -0.030");
    let error = PaperConfig::parse(&wrong, "paper.toml").unwrap_err();
    assert!(error.to_string().contains("delay is -0.03"), "{error}");
    let unknown = text.replace("[rail]\nleft ", "[rail]\nlefts ");
    let error = PaperConfig::parse(&unknown, "paper.toml").unwrap_err();
    assert!(matches!(error, ConfigError::Problems(_)));
    assert!(error.to_string().contains("lefts"), "{error}");
    let mut changed = rig(Friction::Mild);
    changed.settings.delay = f64::NAN;
    let error = changed.record(10, 1).unwrap_err();
    assert!(matches!(error, Error::Setting { .. }), "{error}");
    let rig = rig(Friction::Mild);
    let short = rig.record(20, 1).unwrap();
    let error = true_errors(&rig, &short, (10, 30), StartsAt::Measured).unwrap_err();
    assert!(
        matches!(
            error,
            Error::Short {
                rows: 20,
                needed: 33
            }
        ),
        "{error}"
    );
}
