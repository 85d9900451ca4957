//! Logs whose rows come early, late or never.

use std::path::Path;

use approx::assert_abs_diff_eq;
use cartpole::config::{Config, NoiseLevel};
use cartpole::rig::{self, Hidden, Recording, Sampling, Scene, Target};

/// Nothing moves the rig but the hand, and the cart's sensor has no noise.
fn quiet() -> Config {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole");
    let mut config = Config::read(&models.join("rig.toml")).unwrap();
    config.duration = 10.0;
    config.noise = NoiseLevel::Low;
    config.noise_levels.low.ultrasonic = 0.0;
    config.noise_levels.low.cart_force = 0.0;
    config.operator.tremor = 0.0;
    config
}

const EXACT: Sampling = Sampling {
    jitter: 0.0,
    lost: 0.0,
    time_decimals: 12,
    decimals: 12,
};

fn log(hidden: &Hidden, sampling: Option<Sampling>) -> Recording {
    let scene = Scene {
        sampling,
        ..Scene::of(hidden)
    };
    rig::run_scene(&quiet(), &scene, 3).unwrap()
}

/// How far the cart is from the straight line between its neighbours over time, at most, m.
fn bend(t: &[f64], x: &[f64]) -> f64 {
    let line = |k: usize| {
        let share = (t[k] - t[k - 1]) / (t[k + 1] - t[k - 1]);
        x[k - 1] + share * (x[k + 1] - x[k - 1])
    };
    (1..x.len() - 1).fold(0.0, |most, k| (x[k] - line(k)).abs().max(most))
}

#[test]
fn a_logger_that_is_even_after_all_records_the_same_motion() {
    let late = Hidden::InputDelay {
        target: Target::Motor,
        delay: 0.033,
    };
    for hidden in [Hidden::Nothing, late] {
        let (even, ticks) = (log(&hidden, None), log(&hidden, Some(EXACT)));
        assert_eq!(even.len(), ticks.len());
        for k in 0..even.len() {
            assert_abs_diff_eq!(even.t[k], ticks.t[k], epsilon = 1e-11);
            assert_abs_diff_eq!(even.q[0][k], ticks.q[0][k], epsilon = 2e-5);
            assert_abs_diff_eq!(even.v[0][k], ticks.v[0][k], epsilon = 1e-3);
        }
    }
}

#[test]
fn rows_that_come_early_or_late_have_true_stamps() {
    let uneven = log(
        &Hidden::Nothing,
        Some(Sampling {
            jitter: 0.3,
            ..EXACT
        }),
    );
    let due: Vec<f64> = (0..uneven.len()).map(|k| k as f64 / 50.0).collect();
    let off = uneven.t.iter().zip(&due).map(|(t, due)| (t - due).abs());
    let most = off.fold(0.0, f64::max);
    // A tick is a thirty-second of 20 ms, to which times are rounded.
    assert!(
        (0.0055..=0.3 * 0.02 + 0.02 / 64.0).contains(&most),
        "{most}"
    );
    // ẍ δt²/2 of 10 m/s² over 20 ms; at the times that are due a metre a second over several milliseconds.
    let (own, even) = (bend(&uneven.t, &uneven.q[0]), bend(&due, &uneven.q[0]));
    assert!(own < 2e-3 && even > 3.0 * own, "{own} {even}");
    for k in 1..uneven.len() {
        let rate = (uneven.q[0][k] - uneven.q[0][k - 1]) / (uneven.t[k] - uneven.t[k - 1]);
        assert_abs_diff_eq!(uneven.v[0][k], rate, epsilon = 1e-8);
    }
}

#[test]
fn rows_are_lost_and_numbers_are_short() {
    let sampling = Sampling {
        jitter: 0.1,
        lost: 0.1,
        time_decimals: 3,
        decimals: 4,
    };
    let lossy = log(&Hidden::Nothing, Some(sampling));
    assert!((420..=480).contains(&lossy.len()), "{}", lossy.len());
    assert_eq!(lossy.u.len(), lossy.len());
    for (t, x) in lossy.t.iter().zip(&lossy.q[0]) {
        assert_abs_diff_eq!(t * 1e3, (t * 1e3).round(), epsilon = 1e-9);
        assert_abs_diff_eq!(x * 1e4, (x * 1e4).round(), epsilon = 1e-9);
    }
    let whole = log(
        &Hidden::Nothing,
        Some(Sampling {
            lost: 0.0,
            ..sampling
        }),
    );
    let written = |t: &f64| whole.t.iter().any(|other| other == t);
    assert!(lossy.t.iter().all(written), "losses do not move the others");
    assert_eq!(lossy, log(&Hidden::Nothing, Some(sampling)));
}
