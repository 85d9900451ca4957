//! What the rig can hide, against closed forms.
#![allow(clippy::needless_range_loop)] // k counts rows

use std::f64::consts::TAU;
use std::path::Path;

use approx::{assert_abs_diff_eq, assert_relative_eq};
use cartpole::config::{Config, NoiseLevel};
use cartpole::rig::effects::{
    Bristles, Drive, DryFriction, Effects, ElasticString, JointForces, Ripple, SlippingSpring,
};
use cartpole::rig::plant::Plant;
use cartpole::rig::truth::{State, Truth};
use cartpole::rig::{
    self, CASES, CASES_ALL, CHOICES, Hidden, Key, Recording, Target, UNSEEN, draw, draw_any,
    draw_of,
};

/// Mass of the cart without a pole, kg.
const M: f64 = 0.5;
const STEP: f64 = 5e-4;

/// A cart that no pole disturbs.
#[derive(Clone)]
struct Block;

impl Plant for Block {
    fn mass_and_bias(&mut self, _: [f64; 2], _: [f64; 2]) -> ([[f64; 2]; 2], [f64; 2]) {
        ([[M, 0.0], [0.0, 1.0]], [0.0, 0.0])
    }
}

/// The cart at x with the speed v, and these effects.
fn cart(effects: Effects, x: f64, v: f64) -> Truth<Block> {
    let start = State {
        q: [x, 0.0],
        v: [v, 0.0],
    };
    Truth::new(Block, effects, STEP, start)
}

fn place(truth: &Truth<Block>) -> (f64, f64) {
    (truth.state().q[0], truth.state().v[0])
}

fn on_slider(slider: JointForces) -> Effects {
    Effects {
        joints: [slider, JointForces::default()],
        ..Effects::default()
    }
}

fn dry(force: f64) -> DryFriction {
    DryFriction {
        against_positive: force,
        against_negative: force,
        ..DryFriction::default()
    }
}

fn config() -> Config {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole");
    Config::read(&models.join("rig.toml")).unwrap()
}

/// A rig whose sensors show what is, whose cart slides without friction, and whose hand begins with a tremor.
fn noiseless() -> Config {
    let mut config = config();
    config.noise = NoiseLevel::Low;
    config.noise_levels.low.ultrasonic = 0.0;
    config.noise_levels.low.encoder_counts = 1_000_000_000;
    config.known.slider_coulomb_friction = 0.0;
    config.operator.tremor = 1.0;
    config
}

fn run(config: &Config, hidden: &Hidden, seed: u64) -> (Recording, Vec<State>) {
    rig::run_with(Block, config, hidden, seed).unwrap()
}

#[test]
fn a_lagging_motor_pushes_as_the_step_response_of_first_order_says() {
    let (t_lag, u) = (0.03, 1.2);
    let effects = Effects {
        drive: Drive {
            lag: Some(t_lag),
            ..Drive::default()
        },
        ..Effects::default()
    };
    let mut truth = cart(effects, 0.0, 0.0);
    for k in 1..=20 {
        truth.advance(u, 0.01).unwrap();
        // m v = ∫ u (1 − e^(−t/T)) dt
        let t = 0.01 * f64::from(k);
        let v = u / M * (t - t_lag * (1.0 - (-t / t_lag).exp()));
        assert_abs_diff_eq!(place(&truth).1, v, epsilon = 1e-9);
    }
    // The force dies away as it came: after the step back the cart still gains u T/m.
    let before = place(&truth).1;
    truth.advance(0.0, 1.0).unwrap();
    let lasting = u * t_lag * (1.0 - (-0.2 / t_lag).exp()) / M;
    assert_abs_diff_eq!(place(&truth).1 - before, lasting, epsilon = 1e-9);
}

#[test]
fn dead_zone_saturation_and_offset_change_the_acceleration_as_their_curves_say() {
    let target = Target::Motor;
    type Curve = fn(f64) -> f64;
    let curves: [(Hidden, Curve); 4] = [
        (Hidden::InputDeadZone { target, width: 0.3 }, |u| {
            if u.abs() < 0.3 {
                0.0
            } else {
                u - 0.3 * u.signum()
            }
        }),
        (Hidden::InputSaturation { target, limit: 1.5 }, |u| {
            u.clamp(-1.5, 1.5)
        }),
        (
            Hidden::InputOffset {
                target,
                offset: -0.1,
            },
            |u| u - 0.1,
        ),
        (Hidden::Nothing, |u| u),
    ];
    let mut config = noiseless();
    config.duration = 2.0;
    for (hidden, curve) in curves {
        let (log, states) = run(&config, &hidden, 5);
        let (mut flat, mut steep) = (0, 0);
        for (u, pair) in log.u.iter().zip(states.windows(2)) {
            let force = M * (pair[1].v[0] - pair[0].v[0]) / 0.02;
            assert_abs_diff_eq!(force, curve(*u), epsilon = 1e-9);
            match (curve(*u) - u).abs() < 1e-9 {
                true => flat += 1,
                false => steep += 1,
            }
        }
        // Both branches of the curve are there.
        assert_eq!(flat + steep, 99);
        match hidden {
            Hidden::InputSaturation { .. } => assert!(flat > 10 && steep > 10),
            Hidden::Nothing => assert_eq!(steep, 0),
            _ => assert!(steep > 80),
        }
    }
}

#[test]
fn the_string_between_motor_and_cart_swings_at_its_resonance() {
    let (j, k, c, force) = (0.1, 200.0, 0.8, 0.3);
    let string = |damping| Effects {
        string: Some(ElasticString {
            stiffness: k,
            damping,
            motor_inertia: j,
            hardening: 0.0,
            free_play: 0.0,
        }),
        ..Effects::default()
    };
    // The stretch s = z − x obeys s̈ + c r ṡ + k r s = F/J with r = 1/m + 1/J.
    let r = 1.0 / M + 1.0 / j;
    let (omega, delta) = ((k * r).sqrt(), 0.5 * c * r);
    let damped = (omega * omega - delta * delta).sqrt();
    let mut truth = cart(string(c), 0.0, 0.0);
    for i in 1..=200 {
        truth.advance(force, 2e-3).unwrap();
        let t = 2e-3 * f64::from(i);
        let swing = (damped * t).cos() + delta / damped * (damped * t).sin();
        let stretch = force / j / (omega * omega) * (1.0 - (-delta * t).exp() * swing);
        let ((z, z_dot), (x, x_dot)) = (truth.motor(), place(&truth));
        assert_abs_diff_eq!(z - x, stretch, epsilon = 1e-9);
        assert_abs_diff_eq!(j * z_dot + M * x_dot, force * t, epsilon = 1e-12);
    }
    // Without damping, after a push: the frequency by zero crossings of the stretch.
    let mut truth = cart(string(0.0), 0.0, 0.0);
    truth.advance(1.0, 5e-3).unwrap();
    let stretch = |truth: &Truth<Block>| truth.motor().0 - place(truth).0;
    let (mut crossings, mut before) = (Vec::new(), stretch(&truth));
    for i in 0..4000 {
        truth.advance(0.0, STEP).unwrap();
        let now = stretch(&truth);
        if before < 0.0 && now >= 0.0 {
            crossings.push((f64::from(i) - before / (now - before)) * STEP);
        }
        before = now;
    }
    let periods = crossings.len() - 1;
    let period = (crossings[periods] - crossings[0]) / periods as f64;
    assert!(periods > 10);
    assert_relative_eq!(TAU / period, omega, max_relative = 1e-5);
}

#[test]
fn a_stiff_string_is_a_motor_that_rides_on_the_cart() {
    let apart = |stiffness: f64| {
        let string = ElasticString {
            stiffness,
            damping: 2.0,
            motor_inertia: 0.1,
            hardening: 0.0,
            free_play: 0.0,
        };
        let effects = Effects {
            string: Some(string),
            ..Effects::default()
        };
        let mut truth = cart(effects, 0.0, 0.0);
        truth.advance(1.0, 0.5).unwrap();
        (place(&truth).0 - 0.5 * 0.25 / (M + 0.1)).abs()
    };
    // The centre of both is where it must be, so the cart is behind it by J/(m + J) times the stretch F m/((m + J) k).
    for k in [1e3, 1e4] {
        let behind = 0.1 / 0.6 * M / (0.6 * k);
        assert_relative_eq!(apart(k), behind, max_relative = 0.05);
    }
}

#[test]
fn a_spring_that_slips_catches_the_cart_and_leaves_it_in_a_loop_of_its_width() {
    let (k, w, v) = (60.0, 3e-3, 0.2);
    let effects = Effects {
        slipping_spring: Some(SlippingSpring {
            stiffness: k,
            width: w,
        }),
        ..Effects::default()
    };
    let mut truth = cart(effects, 0.0, v);
    // ½ m v² = ½ k w² while it stretches, then k w a metre.
    let furthest = w + (0.5 * M * v * v - 0.5 * k * w * w) / (k * w);
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    let mut turned = None;
    let mut time = 0.0;
    for _ in 0..8000 {
        let before = place(&truth).1;
        truth.advance(0.0, STEP).unwrap();
        time += STEP;
        let (x, v) = place(&truth);
        most = most.max(x);
        if turned.is_none() && before > 0.0 && v <= 0.0 {
            turned = Some(time);
        }
        if turned.is_some() {
            least = least.min(x);
        }
    }
    assert_abs_diff_eq!(most, furthest, epsilon = 1e-6);
    // Then the block stands and the cart swings about it, from one end of the loop to the other: 2 w.
    assert_abs_diff_eq!(most - least, 2.0 * w, epsilon = 1e-6);
    // When it turns: a sine until the spring slips, then the deceleration k w/m.
    let omega = (k / M).sqrt();
    let slip = (w * omega / v).asin() / omega;
    let speed = (v * v - k / M * w * w).sqrt();
    assert_abs_diff_eq!(
        turned.unwrap(),
        slip + speed * M / (k * w),
        epsilon = 2.0 * STEP
    );
}

#[test]
fn the_force_of_a_slipping_spring_goes_around_its_loop() {
    let spring = SlippingSpring {
        stiffness: 40.0,
        width: 5e-3,
    };
    // To 20 mm, back to 0, again: the work of a cycle is that of the loop, 2 k w times twice the way beyond the loop's width.
    let (mut block, mut work) = (0.0, 0.0);
    let steps = 40_000;
    for i in 0..3 * steps {
        let phase = |i: usize| 0.01 * (1.0 - (TAU * i as f64 / steps as f64).cos());
        let (x, next) = (phase(i), phase(i + 1));
        let force = spring.force(0.5 * (x + next), block);
        block = spring.drag(next, block);
        if i >= 2 * steps {
            work -= force * (next - x);
        }
    }
    let expected = 2.0 * 40.0 * 5e-3 * (0.02 - 2.0 * 5e-3);
    assert_relative_eq!(work, expected, max_relative = 1e-6);
}

#[test]
fn dahls_friction_takes_its_energy_along_the_way() {
    let (sigma, force, v) = (80.0, 0.25, 0.4);
    let effects = Effects {
        bristles: Some(Bristles {
            stiffness: sigma,
            damping: 0.0,
            slip: dry(force),
        }),
        ..Effects::default()
    };
    let mut truth = cart(effects, 0.0, v);
    // dz/dx = 1 − σ z/F while it goes one way: the force is F (1 − e^(−σ x/F)).
    for _ in 0..60 {
        truth.advance(0.0, 5e-3).unwrap();
        let (x, now) = place(&truth);
        assert!(now > 0.0);
        let taken = force * (x - force / sigma * (1.0 - (-sigma * x / force).exp()));
        assert_abs_diff_eq!(0.5 * M * (v * v - now * now), taken, epsilon = 1e-9);
    }
}

#[test]
fn lugre_friction_is_a_spring_at_rest_and_coulombs_when_fast() {
    let (sigma, u) = (200.0, 0.5);
    let effects = Effects {
        bristles: Some(Bristles {
            stiffness: sigma,
            damping: 1.0,
            slip: DryFriction {
                stribeck: 0.1,
                stribeck_velocity: 0.05,
                ..dry(0.2)
            },
        }),
        ..Effects::default()
    };
    // A force of a thousandth of the static one bends the bristles by u/σ₀. Coming to rest the cart swings over some 13 times that way,
    // of which the share u/F_s slips.
    let mut truth = cart(effects, 0.0, 0.0);
    truth.advance(3e-4, 10.0).unwrap();
    assert_relative_eq!(place(&truth).0, 3e-4 / sigma, max_relative = 0.03);
    // Far above the Stribeck velocity and beyond the way g/σ₀ the bristles are bent by F_c/σ₀: m v̇ = u − F_c.
    let mut truth = cart(effects, 0.0, 0.5);
    truth.advance(u, 0.1).unwrap();
    let before = place(&truth).1;
    truth.advance(u, 0.1).unwrap();
    let force = M * (place(&truth).1 - before) / 0.1;
    assert_abs_diff_eq!(force, u - 0.2, epsilon = 1e-9);
}

#[test]
fn load_dependent_friction_grows_with_the_motors_force_moving_and_at_rest() {
    let (held, mu) = (0.2, 0.15);
    let effects = || {
        on_slider(JointForces {
            dry: DryFriction {
                load: mu,
                ..dry(held)
            },
            ..JointForces::default()
        })
    };
    // It breaks away at |u| = F + μ |u|.
    let breakaway = held / (1.0 - mu);
    for sign in [1.0, -1.0] {
        let mut truth = cart(effects(), 0.0, 0.0);
        truth.advance(sign * 0.999 * breakaway, 1.0).unwrap();
        assert_eq!(place(&truth), (0.0, 0.0));
        truth.advance(sign * 1.01 * breakaway, 1.0).unwrap();
        assert!(sign * place(&truth).0 > 1e-4);
        // Driven and braked by the motor.
        let mut truth = cart(effects(), 0.0, sign * 0.6);
        truth.advance(sign * 1.0, 0.1).unwrap();
        let gained = sign * place(&truth).1 - 0.6;
        assert_abs_diff_eq!(gained, 0.1 * (1.0 - held - mu) / M, epsilon = 1e-12);
        truth.advance(-sign, 0.1).unwrap();
        let lost = gained + 0.6 - sign * place(&truth).1;
        assert_abs_diff_eq!(lost, 0.1 * (1.0 + held + mu) / M, epsilon = 1e-12);
    }
    // A force of the disturbance is no load of the motor.
    let mut truth = cart(effects(), 0.0, 0.0);
    truth.advance_under([0.0, 0.201], 1.0).unwrap();
    assert!(place(&truth).0 > 1e-4);
    // A lagging motor loads it as its force builds up: it lets go when that is the breakaway force.
    let mut lagging = effects();
    lagging.drive.lag = Some(0.1);
    let mut truth = cart(lagging, 0.0, 0.0);
    let u = 2.0 * breakaway;
    truth.advance(u, 0.1 * 2.0_f64.ln() - 1e-6).unwrap();
    assert_eq!(place(&truth), (0.0, 0.0));
    truth.advance(u, 0.01).unwrap();
    assert!(place(&truth).1 > 0.0);
}

#[test]
fn friction_that_grows_along_the_rail_stops_the_cart_where_it_must() {
    let (force, slope, v) = (0.2, 0.5, 0.3);
    let effects = || {
        on_slider(JointForces {
            dry: DryFriction {
                slope,
                ..dry(force)
            },
            ..JointForces::default()
        })
    };
    for sign in [1.0, -1.0] {
        let mut truth = cart(effects(), 0.0, sign * v);
        truth.advance(0.0, 2.0).unwrap();
        let (x, still) = place(&truth);
        assert_eq!(still, 0.0);
        // ½ m v² = F |x| ± ½ s x²
        let s = sign * slope;
        let way = ((force * force + s * M * v * v).sqrt() - force) / s;
        assert_abs_diff_eq!(x, sign * way, epsilon = 1e-9);
        // At rest it holds what it has there, both ways.
        let holds = force + slope * x;
        truth.advance(0.999 * holds, 0.5).unwrap();
        truth.advance(-0.999 * holds, 0.5).unwrap();
        assert_eq!(place(&truth), (x, 0.0));
        truth.advance(1.01 * holds, 0.2).unwrap();
        assert!(place(&truth).0 > x);
    }
    // Where it would push, there is none.
    let mut truth = cart(effects(), -1.0, 0.1);
    truth.advance(0.0, 1.0).unwrap();
    assert_abs_diff_eq!(place(&truth).1, 0.1, epsilon = 1e-15);
}

#[test]
fn viscous_friction_of_each_direction_brakes_with_its_own_time_constant() {
    let slider = JointForces {
        viscous: [0.8, 0.3],
        ..JointForces::default()
    };
    for (v, c) in [(0.5, 0.8), (-0.5, 0.3)] {
        let mut truth = cart(on_slider(slider), 0.0, v);
        truth.advance(0.0, 0.7).unwrap();
        assert_abs_diff_eq!(place(&truth).1, v * (-c * 0.7 / M).exp(), epsilon = 1e-12);
    }
}

#[test]
fn a_periodic_force_has_its_potential_and_its_period() {
    let ripple = Ripple {
        amplitude: 0.15,
        period: 0.04,
        phase: 0.7,
        second: 0.0,
    };
    let slider = JointForces {
        ripple: Some(ripple),
        ..JointForces::default()
    };
    let potential = |x: f64| 0.15 * 0.04 / TAU * (TAU * x / 0.04 + 0.7).cos();
    let mut truth = cart(on_slider(slider), 0.01, 0.3);
    let energy = |(x, v): (f64, f64)| 0.5 * M * v * v + potential(x);
    let start = energy(place(&truth));
    let (mut slowest, mut fastest) = (1.0_f64, 0.0_f64);
    for _ in 0..400 {
        truth.advance(0.0, 1e-3).unwrap();
        assert_abs_diff_eq!(energy(place(&truth)), start, epsilon = 1e-11);
        let v = place(&truth).1;
        (slowest, fastest) = (slowest.min(v), fastest.max(v));
    }
    // ½ m (v_max² − v_min²) is twice the amplitude of the potential.
    let swing = 0.5 * M * (fastest * fastest - slowest * slowest);
    assert_relative_eq!(
        swing,
        0.15 * 0.04 / std::f64::consts::PI,
        max_relative = 1e-2
    );
    // At first it pushes by A sin φ.
    let mut truth = cart(on_slider(slider), 0.0, 0.0);
    truth.advance(0.0, 1e-3).unwrap();
    assert_relative_eq!(
        M * place(&truth).1 / 1e-3,
        0.15 * 0.7_f64.sin(),
        max_relative = 1e-3
    );
}

#[test]
fn sensors_read_what_is_shifted_stretched_or_late() {
    let mut config = noiseless();
    config.duration = 3.0;
    let (true_log, states) = run(&config, &Hidden::Nothing, 9);
    // A sensor moves nothing; noting down where the cart was divides the steps.
    let same = |hidden: &Hidden| {
        let (log, moved) = run(&config, hidden, 9);
        for (a, b) in moved.iter().zip(&states) {
            assert_abs_diff_eq!(a.q[0], b.q[0], epsilon = 1e-12);
            assert_abs_diff_eq!(a.v[0], b.v[0], epsilon = 1e-12);
        }
        assert_eq!(log.u, true_log.u);
        log
    };
    let (slider, pole) = (Target::Slider, Target::Pole);
    let shifted = same(&Hidden::SensorOffset {
        target: pole,
        offset: -0.03,
    });
    let stretched = same(&Hidden::SensorScale {
        target: slider,
        scale: 0.05,
    });
    for k in 0..states.len() {
        let [x, phi] = states[k].q;
        assert_abs_diff_eq!(
            shifted.q[1][k],
            (phi - 0.03).rem_euclid(TAU),
            epsilon = 1e-8
        );
        assert_eq!(shifted.q[0][k], x);
        assert_abs_diff_eq!(stretched.q[0][k], 1.05 * x, epsilon = 1e-15);
        assert_eq!(stretched.q[1], true_log.q[1]);
    }
    // Two whole samples late; before the first row the cart was at rest.
    let late = same(&Hidden::SensorDelay {
        target: slider,
        delay: 0.04,
    });
    assert_eq!(late.q[0][..2], [0.0, 0.0]);
    for k in 2..states.len() {
        assert_abs_diff_eq!(late.q[0][k], states[k - 2].q[0], epsilon = 1e-12);
    }
    // A part of a sample: the place where the held input brings the cart within the rest of it.
    for (delay, whole, rest) in [(0.033, 2, 0.007), (0.0151, 1, 0.0049)] {
        let late = same(&Hidden::SensorDelay {
            target: slider,
            delay,
        });
        for k in whole..states.len() {
            let State { q, v } = states[k - whole];
            let x = q[0] + v[0] * rest + 0.5 * true_log.u[k - whole] / M * rest * rest;
            assert_abs_diff_eq!(late.q[0][k], x, epsilon = 1e-12);
        }
        // The velocity in the log is that of the late readings.
        let v = (late.q[0][60] - late.q[0][59]) * 50.0;
        assert_abs_diff_eq!(late.v[0][60], v, epsilon = 1e-9);
    }
}

#[test]
fn what_is_drawn_in_secret_is_what_it_always_was() {
    let config = config();
    let coulomb = |force| Hidden::CoulombFriction {
        target: Target::Slider,
        force,
    };
    assert_eq!(draw(&config, 23), coulomb(0.162_214_318_560_996_16));
    assert_eq!(draw(&config, 2), coulomb(0.256_685_159_044_433_9));
    let drag = Hidden::QuadraticDrag {
        target: Target::Pole,
        coefficient: 0.000_296_149_277_978_255_65,
    };
    assert_eq!(draw(&config, 1), drag);
}

#[test]
fn the_wide_draw_reaches_every_effect_that_a_log_can_show() {
    let config = config();
    let mut seen = std::collections::BTreeMap::new();
    for seed in 0..3100 {
        let hidden = draw_any(&config, seed);
        hidden.check().unwrap();
        let name = (hidden.kind(), hidden.target().unwrap().name());
        *seen.entry(name).or_insert(0) += 1;
    }
    assert_eq!(seen.len(), CASES_ALL);
    assert!(seen.values().all(|n| (60..150).contains(n)), "{seen:?}");
    assert!(!seen.contains_key(&("sensor_offset", "slider")));
    let last = draw_of(&config, UNSEEN, 1);
    assert_eq!(
        (last.kind(), last.target()),
        ("sensor_offset", Some(Target::Slider))
    );
    // Either sign of what may have either.
    let signs = |case| {
        let positive = |seed| match draw_of(&config, case, seed) {
            Hidden::SensorScale { scale: x, .. }
            | Hidden::InputOffset { offset: x, .. }
            | Hidden::PositionDependentFriction { slope: x, .. } => x > 0.0,
            Hidden::AsymmetricViscousFriction {
                coefficient_positive,
                coefficient_negative,
                ..
            } => coefficient_positive > coefficient_negative,
            other => panic!("{other:?}"),
        };
        (0..100).filter(|seed| positive(*seed)).count()
    };
    assert!(
        [14, 15, 16, 19, 25]
            .iter()
            .all(|case| (30..70).contains(&signs(*case)))
    );
}

#[test]
fn every_effect_moves_the_rig_and_keeps_it_off_its_stops_and_its_key_tells_it() {
    let mut config = config();
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole");
    config.duration = 20.0;
    config.noise = NoiseLevel::Low;
    let plant = rig::plant::read(&models.join("cartpole.urdf")).unwrap();
    let go = |hidden: &Hidden, seed| rig::run_with(plant.clone(), &config, hidden, seed).unwrap();
    for case in CASES..CHOICES {
        for seed in 1..3 {
            let hidden = draw_of(&config, case, seed);
            let (log, states) = go(&hidden, seed);
            let (plain, _) = go(&Hidden::Nothing, seed);
            assert!(log.blows.is_empty(), "{hidden:?}: {:?}", log.blows);
            assert_eq!(log.u.len(), plain.u.len());
            // The first three seconds: later the swinging pole would have made something of rounding errors, too.
            let apart = |i: usize| {
                let rows = log.q[i].iter().zip(&plain.q[i]).take(150);
                rows.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            let most = states.iter().fold(0.0_f64, |a, s| a.max(s.q[0].abs()));
            eprintln!(
                "{:30} {:6} x apart {:.1e} m, φ apart {:.1e} rad, |x| up to {most:.3} m",
                hidden.kind(),
                hidden.target().unwrap().name(),
                apart(0),
                apart(1)
            );
            assert!(
                apart(0) > 1e-3 || apart(1) > 5e-3,
                "{hidden:?} does not show"
            );
            let key = Key::new(&config, &hidden, seed);
            let said = serde_json::to_value(&key).unwrap();
            assert_eq!(said["hidden"]["kind"], hidden.kind());
            for (name, value) in hidden.parameters() {
                assert_eq!(said["hidden"][name], value, "{name}");
            }
            assert_eq!(serde_json::from_value::<Key>(said).unwrap(), key);
        }
    }
}

#[test]
fn halving_the_step_changes_the_memory_of_no_effect() {
    let config = config();
    for case in CASES..CHOICES {
        let hidden = draw_of(&config, case, 1);
        let effects = Effects::of(&config.known, &hidden).unwrap();
        let mut motion = [STEP, 0.5 * STEP].map(|step| {
            let plant = rig::plant::read(&config.urdf).unwrap();
            Truth::new(plant, effects, step, State::HANGING)
        });
        let mut worst = [0.0_f64; 2];
        for k in 0..30 {
            let force = 2.0 * (0.02 * TAU * 1.7 * f64::from(k)).sin();
            let [coarse, fine] = motion.each_mut().map(|truth| {
                truth.advance(force, 0.02).unwrap();
                truth.state().q
            });
            worst = [0, 1].map(|i| worst[i].max((coarse[i] - fine[i]).abs()));
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
fn strings_are_drawn_by_the_frequency_and_damping_of_the_motor_on_them() {
    let config = config();
    let ranges = config.hidden.elastic_transmission;
    let within =
        |x: f64, [from, to]: [f64; 2]| (from * (1.0 - 1e-12)..=to * (1.0 + 1e-12)).contains(&x);
    for seed in 0..200 {
        let Hidden::ElasticTransmission {
            stiffness,
            damping,
            motor_inertia,
            ..
        } = draw_of(&config, 23, seed)
        else {
            panic!("case 23 is another effect")
        };
        let rate = (stiffness / motor_inertia).sqrt();
        assert!(within(rate / TAU, ranges.frequency));
        assert!(within(
            damping / (2.0 * motor_inertia * rate),
            ranges.damping_ratio
        ));
        assert!(within(motor_inertia, ranges.motor_inertia));
    }
}

#[test]
fn ranges_of_effects_that_no_rig_can_have_are_refused_by_their_key() {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole");
    let text = std::fs::read_to_string(models.join("rig.toml")).unwrap();
    let refused = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        let wrong = text.replace(from, to);
        Config::parse(&wrong, "rig.toml").unwrap_err().to_string()
    };
    // At the end of the rail, 0.325 m, a slope of 0.7 N/m would make of 0.2153 N of friction one that pushes.
    let steep = refused("slider = [0.25, 0.6]", "slider = [0.25, 0.7]");
    assert!(
        steep.contains("hidden.position_dependent_friction.slider is [0.25, 0.7]"),
        "{steep}"
    );
    let back = refused(
        "damping_ratio = [0.03, 0.15]",
        "damping_ratio = [0.15, 0.03]",
    );
    assert!(back.contains("damping_ratio"), "{back}");
    let zero = refused("period = [0.02, 0.08]", "period = [0.0, 0.08]");
    assert!(zero.contains("hidden.periodic_force.period"), "{zero}");
}

#[test]
fn effects_that_no_rig_has_are_refused() {
    let refused = |hidden: Hidden| hidden.check().unwrap_err().to_string();
    let on_pole = refused(Hidden::DahlFriction {
        target: Target::Pole,
        stiffness: 1.0,
        coulomb_force: 1.0,
    });
    assert!(on_pole.contains("the target is `slider`"), "{on_pole}");
    let no_period = refused(Hidden::PeriodicForce {
        target: Target::Slider,
        amplitude: 0.1,
        period: 0.0,
        phase: -1.0,
    });
    assert!(no_period.contains("period is 0"), "{no_period}");
    let long = refused(Hidden::SensorDelay {
        target: Target::Pole,
        delay: 11.0,
    });
    assert!(long.contains("at most 10 s"), "{long}");
    let weak = refused(Hidden::LugreFriction {
        target: Target::Slider,
        stiffness: 100.0,
        damping: 1.0,
        coulomb_force: 0.3,
        static_force: 0.2,
        stribeck_velocity: 0.1,
    });
    assert!(weak.contains("static_force 0.2"), "{weak}");
    let negative = refused(Hidden::InputSaturation {
        target: Target::Motor,
        limit: -1.0,
    });
    assert!(negative.contains("limit is -1"), "{negative}");
}
