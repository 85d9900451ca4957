//! The virtual rig against physics, against its own promises, and against closed forms.
#![allow(clippy::needless_range_loop)] // i counts joints

use std::path::{Path, PathBuf};

use cartpole::config::{Config, NoiseLevel, Rail};
use cartpole::rig::effects::{Backlash, DryFriction, Effects, JointForces};
use cartpole::rig::plant::{self, Plant};
use cartpole::rig::truth::{State, Truth};
use cartpole::rig::{self, CASES, Hidden, Key, Recording, Target, draw, draw_of};

/// Total mass, kg; first and second moment of the pole about its pivot, kg·m and kg·m² (Table 2 of the paper); g, m/s².
const MASS: f64 = 0.538;
const P: f64 = 8.442e-3;
const J: f64 = 1.292_832e-3;
const G: f64 = 9.81;

/// The cart-pole by hand, φ = 0 upright:
/// m ẍ + P cos φ φ̈ − P sin φ φ̇² = F, P cos φ ẍ + J φ̈ − P g sin φ = 0.
#[derive(Debug, Clone, Copy)]
struct ByHand;

impl Plant for ByHand {
    fn mass_and_bias(&mut self, q: [f64; 2], v: [f64; 2]) -> ([[f64; 2]; 2], [f64; 2]) {
        let (sin, cos) = q[1].sin_cos();
        (
            [[MASS, P * cos], [P * cos, J]],
            [-P * sin * v[1] * v[1], -P * G * sin],
        )
    }
}

/// A cart of 0.5 kg without a pole to disturb it.
#[derive(Clone)]
struct Block;

impl Plant for Block {
    fn mass_and_bias(&mut self, _: [f64; 2], _: [f64; 2]) -> ([[f64; 2]; 2], [f64; 2]) {
        ([[0.5, 0.0], [0.0, 1.0]], [0.0, 0.0])
    }
}

fn energy(State { q, v }: State) -> f64 {
    0.5 * MASS * v[0] * v[0]
        + P * q[1].cos() * v[0] * v[1]
        + 0.5 * J * v[1] * v[1]
        + P * G * q[1].cos()
}

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole")
}

fn config() -> Config {
    Config::read(&models().join("rig.toml")).unwrap()
}

fn dry(force: f64) -> JointForces {
    JointForces {
        dry: DryFriction {
            against_positive: force,
            against_negative: force,
            ..DryFriction::default()
        },
        ..JointForces::default()
    }
}

fn on_slider(slider: JointForces) -> Effects {
    Effects {
        joints: [slider, JointForces::default()],
        ..Effects::default()
    }
}

fn run(config: &Config, hidden: &Hidden, seed: u64) -> (Recording, Vec<State>) {
    rig::run_with(ByHand, config, hidden, seed).unwrap()
}

fn deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn mass_matrix_and_bias_of_the_urdf_are_those_of_table_2() {
    let mut urdf = plant::read(&models().join("cartpole.urdf")).unwrap();
    for (q, v) in [
        ([0.1, 0.0], [0.3, 2.0]),
        ([-0.2, 2.5], [-0.4, -7.0]),
        ([0.0, 4.0], [1.0, 11.0]),
    ] {
        let ((m, b), (m_hand, b_hand)) = (urdf.mass_and_bias(q, v), ByHand.mass_and_bias(q, v));
        for i in 0..2 {
            for j in 0..2 {
                approx::assert_abs_diff_eq!(m[i][j], m_hand[i][j], epsilon = 1e-9);
            }
            approx::assert_abs_diff_eq!(b[i], b_hand[i], epsilon = 1e-6);
        }
    }
}

#[test]
fn energy_is_conserved_without_friction_and_input() {
    let start = State {
        q: [0.0, 0.5],
        v: [0.2, 1.0],
    };
    let mut truth = Truth::new(ByHand, Effects::default(), 5e-4, start);
    let (mut worst, scale) = (0.0_f64, P * G);
    for _ in 0..3000 {
        truth.advance(0.0, 0.02).unwrap();
        worst = worst.max((energy(truth.state()) - energy(start)).abs());
    }
    assert!(
        worst < 1e-8 * scale,
        "energy drifts by {worst} J of {scale} J"
    );
}

#[test]
fn energy_falls_by_the_work_of_friction() {
    // Pole locked out of the way at its stable rest: a sliding cart loses F times its way and then stands.
    let start = State {
        q: [0.0, std::f64::consts::PI],
        v: [0.0, 0.0],
    };
    let mut truth = Truth::new(ByHand, on_slider(dry(0.2)), 5e-4, start);
    let (mut work, mut friction) = (0.0, 0.0);
    for k in 0..400 {
        let force = if k < 100 { 1.0 } else { 0.0 };
        let before = truth.state().q[0];
        truth.advance(force, 5e-4).unwrap();
        let way = truth.state().q[0] - before;
        work += force * way;
        friction += 0.2 * way.abs();
    }
    let gained = energy(truth.state()) - energy(start);
    assert!(truth.state().q[0] > 1e-3);
    approx::assert_abs_diff_eq!(gained, work - friction, epsilon = 1e-9);
}

#[test]
fn stuck_cart_stays_at_rest_below_breakaway_and_moves_above() {
    let moved_by = |force: f64, effects| {
        let mut truth = Truth::new(ByHand, effects, 5e-4, State::HANGING);
        truth.advance(force, 1.0).unwrap();
        truth.state().q[0]
    };
    for sign in [1.0, -1.0] {
        assert_eq!(moved_by(sign * 0.2152, on_slider(dry(0.2153))), 0.0);
        assert!(sign * moved_by(sign * 0.2163, on_slider(dry(0.2153))) > 1e-4);
    }
    // The breakaway force of Stribeck friction is the static one, that of asymmetric friction depends on the side.
    let mut stribeck = dry(0.2);
    stribeck.dry.stribeck = 0.1;
    stribeck.dry.stribeck_velocity = 0.05;
    assert_eq!(moved_by(0.299, on_slider(stribeck)), 0.0);
    assert!(moved_by(0.33, on_slider(stribeck)) > 0.01);
    let mut asymmetric = dry(0.3);
    asymmetric.dry.against_negative = 0.1;
    assert_eq!(moved_by(0.299, on_slider(asymmetric)), 0.0);
    assert_eq!(moved_by(-0.099, on_slider(asymmetric)), 0.0);
    assert!(moved_by(-0.2, on_slider(asymmetric)) < -0.01);
}

#[test]
fn sliding_cart_comes_to_rest_when_and_where_coulomb_says() {
    let start = State {
        q: [0.0, 0.0],
        v: [0.37, 0.0],
    };
    let mut truth = Truth::new(Block, on_slider(dry(0.2153)), 5e-4, start);
    truth.advance(0.0, 2.0).unwrap();
    let State { q, v } = truth.state();
    // x = m v²/(2 F)
    approx::assert_abs_diff_eq!(q[0], 0.5 * 0.37 * 0.37 / (2.0 * 0.2153), epsilon = 1e-12);
    assert_eq!(v[0], 0.0);
}

#[test]
fn swinging_pole_shakes_the_cart_loose_only_when_it_swings_hard() {
    let moved_by = |amplitude: f64| {
        let start = State {
            q: [0.0, std::f64::consts::PI - amplitude],
            v: [0.0, 0.0],
        };
        let mut truth = Truth::new(ByHand, on_slider(dry(0.05)), 5e-4, start);
        truth.advance(0.0, 2.0).unwrap();
        truth.state().q[0].abs()
    };
    assert_eq!(moved_by(0.05), 0.0);
    assert!(moved_by(1.5) > 1e-4);
}

#[test]
fn dry_friction_in_the_bearing_stops_the_pole_off_the_vertical() {
    let mut effects = on_slider(dry(0.2153));
    effects.joints[1] = dry(0.005);
    let start = State {
        q: [0.0, 2.0],
        v: [0.0, 0.0],
    };
    let mut truth = Truth::new(ByHand, effects, 5e-4, start);
    truth.advance(0.0, 30.0).unwrap();
    let State { q, v } = truth.state();
    assert_eq!(v, [0.0, 0.0]);
    // |P g sin φ| is within what the bearing holds.
    assert!((P * G * q[1].sin()).abs() <= 0.005, "φ = {}", q[1]);
    assert!((q[1] - std::f64::consts::PI).abs() > 1e-6);
}

#[test]
fn delayed_input_shifts_the_response_by_the_delay() {
    // Two intervals and a half late: the same motion, half an interval between two rows of the undelayed one.
    let interval = 0.02;
    let (early, late) = (0.5 * interval, 0.05);
    let mut plain = Truth::new(ByHand, Effects::default(), 5e-4, State::HANGING);
    let mut delayed = Truth::new(ByHand, Effects::default(), 5e-4, State::HANGING);
    plain.advance(1.0, 0.3).unwrap();
    delayed.advance(0.0, late).unwrap();
    delayed.advance(1.0, 0.3).unwrap();
    approx::assert_abs_diff_eq!(plain.state().q[0], delayed.state().q[0], epsilon = 1e-12);

    // The rig: the first 2 rows after the first force are as if there were none, the delayed force begins in the third.
    let mut config = config();
    config.noise = NoiseLevel::Low;
    config.duration = 0.5;
    config.operator.tremor = 1.0;
    config.operator.dwell = [10.0, 10.0];
    config.known.slider_coulomb_friction = 0.0;
    let moved = |delay| {
        let hidden = Hidden::InputDelay {
            target: Target::Motor,
            delay,
        };
        let (log, states) = run(&config, &hidden, 3);
        assert!(log.u[0] != 0.0);
        let first = states.iter().position(|s| s.q[0].abs() > 1e-12).unwrap();
        (first, states[first].q[0], log.u[0])
    };
    assert_eq!(moved(0.0).0, 1);
    let (row, x, u) = moved(late);
    assert_eq!(row, 3);
    // After half an interval under u₀: x = ½ (u₀/m_eff) t², m_eff = m − P²/J with the pole hanging.
    let expected = 0.5 * u / (MASS - P * P / J) * early * early;
    approx::assert_relative_eq!(x, expected, max_relative = 1e-2);
    // The rail's own bookkeeping agrees with the log: whole intervals.
    assert_eq!(moved(2.0 * interval).0, 3);
    assert_eq!(moved(3.0 * interval).0, 4);
}

#[test]
fn gain_error_scales_the_force_on_the_cart() {
    let mut config = config();
    config.noise = NoiseLevel::Low;
    config.duration = 0.06;
    config.operator.tremor = 1.0;
    config.known.slider_coulomb_friction = 0.0;
    let after_one_row = |gain| {
        let hidden = Hidden::InputGainError {
            target: Target::Motor,
            gain,
        };
        run(&config, &hidden, 3).1[1].v[0]
    };
    approx::assert_relative_eq!(
        after_one_row(0.2) / after_one_row(0.0),
        1.2,
        max_relative = 1e-3
    );
}

#[test]
fn encoder_gives_whole_counts_below_the_true_angle() {
    for (level, counts) in [(NoiseLevel::Realistic, 4096.0), (NoiseLevel::High, 1024.0)] {
        let mut config = config();
        config.noise = level;
        let (log, states) = run(&config, &Hidden::Nothing, 5);
        let count = std::f64::consts::TAU / counts;
        for ((phi, phi_dot), state) in log.q[1].iter().zip(&log.v[1]).zip(&states) {
            let whole = phi / count;
            assert!((whole - whole.round()).abs() < 1e-6);
            assert!((0.0..std::f64::consts::TAU).contains(phi));
            let below = (state.q[1] - phi).rem_euclid(std::f64::consts::TAU);
            assert!(below < count * (1.0 + 1e-9) || below > std::f64::consts::TAU - 1e-9);
            let steps = phi_dot * 0.02 / count;
            assert!((steps - steps.round()).abs() < 1e-6);
        }
    }
}

#[test]
fn ultrasonic_noise_has_its_deviation_and_its_glitches() {
    let mut config = config();
    config.noise = NoiseLevel::High;
    let (log, states) = run(&config, &Hidden::Nothing, 5);
    let errors: Vec<f64> = log.q[0]
        .iter()
        .zip(&states)
        .map(|(y, s)| y - s.q[0])
        .collect();
    let (quiet, glitches): (Vec<f64>, Vec<f64>) = errors.iter().partition(|e| e.abs() < 0.0125);
    assert!((0.95..1.05).contains(&(deviation(&quiet) / 2.5e-3)));
    assert!(
        (1..20).contains(&glitches.len()),
        "{} glitches",
        glitches.len()
    );
    assert!(glitches.iter().all(|e| e.abs() < 0.06 + 0.0125));
}

#[test]
fn velocities_are_differences_of_the_measured_positions() {
    let (log, _) = run(&config(), &Hidden::Nothing, 2);
    assert_eq!(log.len(), 3000);
    for k in 1..log.len() {
        let x_dot = (log.q[0][k] - log.q[0][k - 1]) * 50.0;
        approx::assert_abs_diff_eq!(log.v[0][k], x_dot, epsilon = 1e-9);
        assert!(
            log.v[1][k].abs() < 60.0,
            "the encoder's wrap is no velocity"
        );
    }
}

#[test]
fn operator_keeps_the_cart_on_its_rail_with_every_hidden_effect() {
    let config = config();
    let mut pooled = [0.0; 4];
    let mut runs = 0.0;
    let seeds = std::env::var("RIG_SEEDS").map_or(4, |n| n.parse().unwrap());
    let mut furthest = 0.0_f64;
    for seed in 1..=seeds {
        for case in 0..=CASES {
            let hidden = if case == CASES {
                Hidden::Nothing
            } else {
                draw_of(&config, case, seed)
            };
            let (log, states) = run(&config, &hidden, seed * 100 + case as u64);
            let of = |f: fn(&State) -> f64| states.iter().map(f).collect::<Vec<f64>>();
            let x = of(|s| s.q[0]);
            let reach = x.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
            furthest = furthest.max(reach);
            let found = [
                deviation(&x),
                deviation(&of(|s| s.v[0])),
                deviation(&of(|s| s.v[1])),
                (log.u.iter().map(|u| u * u).sum::<f64>() / log.u.len() as f64).sqrt(),
            ];
            assert!(reach < 0.325, "{hidden:?} seed {seed}: |x| up to {reach} m");
            assert!(
                (0.09..0.19).contains(&found[0]),
                "{hidden:?}: std x {found:?}"
            );
            assert!(
                (0.25..0.75).contains(&found[1]),
                "{hidden:?}: std v {found:?}"
            );
            assert!(
                (1.5..10.0).contains(&found[2]),
                "{hidden:?}: std φ̇ {found:?}"
            );
            assert!(
                (1.0..3.4).contains(&found[3]),
                "{hidden:?}: rms u {found:?}"
            );
            for (sum, value) in pooled.iter_mut().zip(found) {
                *sum += value;
            }
            runs += 1.0;
        }
    }
    let [x, v, omega, u] = pooled.map(|sum| sum / runs);
    eprintln!(
        "mean of {runs} runs: std x {x:.3} m, v {v:.3} m/s, φ̇ {omega:.2} rad/s, rms u {u:.2} N; |x| up to {furthest:.3} m"
    );
    assert!((0.12..0.155).contains(&x), "std x {x}");
    assert!((0.38..0.50).contains(&v), "std v {v}");
    assert!((2.7..7.0).contains(&omega), "std φ̇ {omega}");
    assert!((1.4..1.9).contains(&u), "rms u {u}");
}

#[test]
fn same_seed_same_bits() {
    let config = config();
    let hidden = draw(&config, 11);
    let first = run(&config, &hidden, 11).0;
    assert_eq!(first, run(&config, &hidden, 11).0);
    assert_ne!(first, run(&config, &hidden, 12).0);
    let elsewhere = std::thread::scope(|scope| {
        let other = scope.spawn(|| run(&config, &hidden, 11).0);
        other.join().unwrap()
    });
    assert_eq!(first, elsewhere);
}

#[test]
fn halving_the_step_changes_far_less_than_the_sensors_see() {
    let config = config();
    for hidden in [
        draw_of(&config, 5, 1),
        draw_of(&config, 3, 1),
        draw_of(&config, 12, 1),
    ] {
        let effects = Effects::of(&config.known, &hidden).unwrap();
        let (log, states) = run(&config, &hidden, 8);
        let mut worst = [0.0_f64; 2];
        // 0.6 s windows from true states, under the logged input.
        for start in (0..2900).step_by(100) {
            let mut coarse = Truth::new(ByHand, effects, 5e-4, states[start]);
            let mut fine = Truth::new(ByHand, effects, 2.5e-4, states[start]);
            for u in &log.u[start..start + 30] {
                coarse.advance(*u, 0.02).unwrap();
                fine.advance(*u, 0.02).unwrap();
                for i in 0..2 {
                    let d = (coarse.state().q[i] - fine.state().q[i]).abs();
                    worst[i] = worst[i].max(d);
                }
            }
        }
        eprintln!(
            "{}: x {:.1e} m, φ {:.1e} rad",
            hidden.kind(),
            worst[0],
            worst[1]
        );
        // A hundredth of the best sensors: 0.3 mm and a count of 1.5 mrad.
        assert!(
            worst[0] < 3e-6 && worst[1] < 1.5e-5,
            "{hidden:?}: {worst:?}"
        );
    }
}

#[test]
fn draws_reach_every_kind_within_the_stated_ranges() {
    let config = config();
    let mut seen = std::collections::BTreeMap::new();
    for seed in 0..1300 {
        let hidden = draw(&config, seed);
        hidden.check().unwrap();
        *seen
            .entry((hidden.kind(), hidden.target().unwrap().name()))
            .or_insert(0) += 1;
        let within = |value: f64, [from, to]: [f64; 2]| assert!((from..=to).contains(&value));
        match hidden {
            Hidden::CoulombFriction {
                target: Target::Slider,
                force,
            } => within(force, [0.1, 0.4]),
            Hidden::ConstantForce { force, .. } => within(force.abs(), [0.03, 0.15]),
            Hidden::InputDelay { delay, .. } => within(delay, [0.012, 0.06]),
            Hidden::AsymmetricCoulombFriction {
                force_positive,
                force_negative,
                ..
            } => {
                within(
                    (force_positive - force_negative).abs() / 2.0,
                    [0.04 - 1e-12, 0.13 + 1e-12],
                );
            }
            _ => {}
        }
    }
    assert_eq!(seen.len(), CASES);
    assert!(seen.values().all(|n| (60..150).contains(n)), "{seen:?}");
}

#[test]
fn log_and_key_are_read_back_as_they_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = config();
    config.duration = 1.0;
    let hidden = draw(&config, 4);
    let (log, _) = run(&config, &hidden, 4);
    let path = folder.path().join("log.csv");
    log.write_csv(&path).unwrap();
    let mut reader = csv::Reader::from_path(&path).unwrap();
    let header: Vec<&str> = reader
        .headers()
        .unwrap()
        .iter()
        .map(str::to_owned)
        .map(|s| &*s.leak())
        .collect();
    assert_eq!(
        header,
        ["t", "q.slider", "q.pole", "v.slider", "v.pole", "u.motor"]
    );
    for (k, row) in reader.deserialize::<[f64; 6]>().enumerate() {
        let expected = [
            log.t[k],
            log.q[0][k],
            log.q[1][k],
            log.v[0][k],
            log.v[1][k],
            log.u[k],
        ];
        assert_eq!(row.unwrap(), expected);
    }
    let key = Key::new(&config, &hidden, 4);
    let path = folder.path().join("key.json");
    key.write_json(&path).unwrap();
    assert_eq!(Key::read_json(&path).unwrap(), key);
    // Nothing else is left in the folder.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn users_model_lacks_the_hidden_effect_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("models");
    std::fs::create_dir(&source).unwrap();
    std::fs::write(source.join("cartpole.urdf"), "<robot/>").unwrap();
    std::fs::write(
        source.join("cartpole.toml"),
        "# the model\nurdf = \"cartpole.urdf\"\n\n[[effect]]\nkind = \"coulomb_friction\" # cart\njoint = \"slider\"\nforce = 0.2153\n\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"pole\"\ncoefficient = 0.002\n",
    )
    .unwrap();
    let config = config();
    let left = |case| {
        let out = folder.path().join(format!("user{case}"));
        let path = rig::known_model(&draw_of(&config, case, 1), &source, &out).unwrap();
        assert!(out.join("cartpole.urdf").exists());
        let text = std::fs::read_to_string(path).unwrap();
        assert!(text.starts_with("# the model"));
        (
            text.contains("coulomb_friction"),
            text.contains("viscous_friction"),
        )
    };
    assert_eq!(left(0), (true, true)); // viscous on the slider is no known effect
    assert_eq!(left(1), (true, false)); // viscous on the pole
    assert_eq!(left(2), (false, true)); // Coulomb on the slider
    assert_eq!(left(3), (true, true)); // Coulomb on the pole
    assert_eq!(left(4), (true, true)); // asymmetric: plain Coulomb stays, the wrong law
    assert_eq!(left(5), (true, true)); // Stribeck
    assert_eq!(left(12), (true, true));
}

#[test]
fn settings_report_all_faults_with_line_and_column() {
    let text = std::fs::read_to_string(models().join("rig.toml")).unwrap();
    let wrong = text
        .replace("truth_step = 5e-4", "truth_step = 5e-2")
        .replace("encoder_counts  = 1024", "encoder_counts  = 0");
    let message = Config::parse(&wrong, "rig.toml").unwrap_err().to_string();
    assert_eq!(message.lines().count(), 2, "{message}");
    assert!(message.starts_with("rig.toml:7:"), "{message}");
    assert!(
        message.contains("noise_levels.high.encoder_counts is 0"),
        "{message}"
    );
    let unknown = text.replace("[rail]\nlimit ", "[rail]\nlimits ");
    let message = Config::parse(&unknown, "rig.toml").unwrap_err().to_string();
    assert!(message.contains("unknown field `limits`"), "{message}");
    let nan = text.replace("tremor       = 0.25", "tremor       = nan");
    assert!(Config::parse(&nan, "rig.toml").is_err());
}

#[test]
fn impossible_effects_are_refused_by_name() {
    let pushing = Hidden::CoulombFriction {
        target: Target::Slider,
        force: -0.1,
    };
    let message = pushing.check().unwrap_err().to_string();
    assert_eq!(
        message,
        "coulomb_friction on slider: force is -0.1: it must be at least 0"
    );
    let misplaced = Hidden::InputDelay {
        target: Target::Pole,
        delay: 0.02,
    };
    assert!(misplaced.check().is_err());
    let bouncing = Hidden::Backlash {
        target: Target::Motor,
        gap: 1e-3,
        restitution: 1.5,
        motor_inertia: 0.1,
    };
    let message = bouncing.check().unwrap_err().to_string();
    assert!(message.contains("restitution is 1.5"), "{message}");
}

#[test]
fn the_end_of_the_rail_turns_the_cart_back_by_its_restitution() {
    let effects = Effects {
        rail: Some(Rail {
            limit: 0.1,
            restitution: 0.3,
        }),
        ..Effects::default()
    };
    let start = State {
        q: [0.0, 0.0],
        v: [0.37, 0.0],
    };
    let mut truth = Truth::new(Block, effects, 5e-4, start);
    truth.advance(0.0, 1.0).unwrap();
    let blow = 0.1 / 0.37;
    assert_eq!(truth.blows().len(), 1);
    approx::assert_abs_diff_eq!(truth.blows()[0], blow, epsilon = 1e-12);
    let State { q, v } = truth.state();
    approx::assert_abs_diff_eq!(v[0], -0.3 * 0.37, epsilon = 1e-13);
    approx::assert_abs_diff_eq!(q[0], 0.1 - 0.3 * 0.37 * (1.0 - blow), epsilon = 1e-12);
    // Pushed against the end it comes to rest there, and it leaves it when pulled.
    truth.advance(1.0, 2.0).unwrap();
    assert_eq!((truth.state().q[0], truth.state().v[0]), (0.1, 0.0));
    truth.advance(-1.0, 0.1).unwrap();
    approx::assert_abs_diff_eq!(truth.state().q[0], 0.1 - 0.01, epsilon = 1e-12);
}

#[test]
fn a_hand_that_does_not_see_the_end_of_the_rail_drives_the_cart_against_it() {
    let mut config = config();
    config.rail.limit = 0.05;
    let (log, states) = run(&config, &Hidden::Nothing, 1);
    assert!(
        log.blows.len() > 20 && log.blows.is_sorted(),
        "{:?}",
        log.blows
    );
    assert!(states.iter().all(|s| s.q[0].abs() <= 0.05 + 1e-12));
    config.rail.limit = 0.325;
    assert!(run(&config, &Hidden::Nothing, 1).0.blows.is_empty());
}

/// A gap of 4 mm between a motor of 0.1 kg and a cart of 0.4 kg without friction.
fn with_gap(gap: f64, restitution: f64) -> Effects {
    Effects {
        backlash: Some(Backlash {
            gap,
            restitution,
            motor_inertia: 0.1,
        }),
        ..Effects::default()
    }
}

#[test]
fn backlash_lets_the_motor_strike_the_cart_when_and_as_hard_as_it_must() {
    let still = State {
        q: [0.0, 0.0],
        v: [0.0, 0.0],
    };
    let (force, e) = (0.2, 0.4);
    let mut truth = Truth::new(Block, with_gap(4e-3, e), 5e-4, still);
    // 2 m/s² over 2 mm.
    let (blow, speed) = (2e-3_f64.sqrt(), 2.0 * 2e-3_f64.sqrt());
    truth.advance(force, blow - 1e-6).unwrap();
    assert_eq!(truth.state(), still);
    truth.advance(0.0, 2e-6).unwrap();
    // Momentum stays, and the relative speed is turned: 0.1 kg against 0.4 kg. The force ended 1 µs before the blow.
    let speed = speed - 2.0 * 1e-6;
    approx::assert_abs_diff_eq!(truth.state().v[0], speed * (1.0 + e) / 5.0, epsilon = 1e-12);
    approx::assert_abs_diff_eq!(
        truth.motor().1,
        speed * (1.0 - 4.0 * e) / 5.0,
        epsilon = 1e-12
    );
    // All that the drive gives becomes momentum, and in the end both go together, flank on flank.
    truth.advance(force, 2.0).unwrap();
    let given = force * (2.0 + blow - 1e-6);
    let ((z, z_dot), State { q, v }) = (truth.motor(), truth.state());
    approx::assert_abs_diff_eq!(0.1 * z_dot + 0.4 * v[0], given, epsilon = 1e-12);
    approx::assert_abs_diff_eq!(z_dot, v[0], epsilon = 1e-12);
    approx::assert_abs_diff_eq!(z - q[0], 2e-3, epsilon = 1e-12);
}

#[test]
fn a_small_gap_is_the_rig_without_one() {
    let apart = |gap: f64| {
        let mut with = Truth::new(ByHand, with_gap(gap, 0.3), 5e-4, State::HANGING);
        let mut without = Truth::new(ByHand, Effects::default(), 5e-4, State::HANGING);
        let mut most = 0.0_f64;
        for k in 0..60 {
            let force = if k / 15 % 2 == 0 { 1.0 } else { -1.0 };
            with.advance(force, 0.02).unwrap();
            without.advance(force, 0.02).unwrap();
            let (x, x_without) = (with.state().q[0], without.state().q[0]);
            assert!((with.motor().0 - x).abs() <= 0.5 * gap + 1e-12);
            most = most.max((x - x_without).abs());
        }
        most / gap
    };
    let found = [4e-3, 4e-4, 4e-5].map(apart);
    eprintln!("apart by {found:?} gaps");
    assert!(
        found.iter().all(|apart| (0.1..30.0).contains(apart)),
        "{found:?}"
    );
}

/// The bounces of the motor on its flank grow smaller without end, and each may set going a cart that friction stops before the next.
#[test]
fn a_motor_bounces_to_rest_on_a_cart_that_friction_stops_between_the_blows() {
    let mut config = config();
    config.noise = NoiseLevel::Realistic;
    config.duration = 7.0;
    let seed = 96435;
    let hidden = draw_of(&config, CASES, seed);
    let (log, states) = run(&config, &hidden, seed);
    assert_eq!(log.t.len(), states.len());
    assert!(states.iter().all(|s| s.q[0].abs() < 0.325));
}

#[test]
fn backlash_is_recorded_when_it_is_asked_for_and_never_drawn() {
    let mut config = config();
    config.duration = 20.0;
    for seed in 1..4 {
        let hidden = draw_of(&config, CASES, seed);
        let Hidden::Backlash { gap, .. } = hidden else {
            panic!("{hidden:?}")
        };
        hidden.check().unwrap();
        assert!((2e-3..=8e-3).contains(&gap));
        let (log, states) = run(&config, &hidden, seed);
        assert_eq!(log, run(&config, &hidden, seed).0);
        assert!(states.iter().all(|s| s.q[0].abs() < 0.325));
        assert_ne!(log.q, run(&config, &Hidden::Nothing, seed).0.q);
        let key = Key::new(&config, &hidden, seed);
        let said = serde_json::to_value(&key).unwrap();
        assert_eq!(said["hidden"]["kind"], "backlash");
        assert_eq!(said["hidden"]["gap"], gap);
    }
    assert!((0..500).all(|seed| draw(&config, seed).kind() != "backlash"));
}
