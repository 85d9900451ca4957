//! Several effects at once, wrong masses, laws of other forms and small disturbances.

use std::path::Path;

use approx::{assert_abs_diff_eq, assert_relative_eq};
use cartpole::config::{Config, NoiseLevel};
use cartpole::rig::effects::{Drive, DryFriction, Effects, ElasticString, JointForces, Power};
use cartpole::rig::plant::Plant;
use cartpole::rig::truth::{State, Truth};
use cartpole::rig::{
    self, Base, CASES_ALL, Dirt, Error, FORM_CASES, Forms, Hidden, Scene, Target, draw_any,
    draw_of, draw_several, draw_suspects,
};
use integrators::event::Direction;

const M: f64 = 0.5;
const STEP: f64 = 5e-4;

/// A cart of 0.5 kg without a pole to disturb it.
#[derive(Clone)]
struct Block;

impl Plant for Block {
    fn mass_and_bias(&mut self, _: [f64; 2], _: [f64; 2]) -> ([[f64; 2]; 2], [f64; 2]) {
        ([[M, 0.0], [0.0, 1.0]], [0.0, 0.0])
    }
}

fn config() -> Config {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole");
    let mut config = Config::read(&models.join("rig.toml")).unwrap();
    config.duration = 4.0;
    config
}

fn cart(effects: Effects, v: f64) -> Truth<Block> {
    let start = State {
        q: [0.0, 0.0],
        v: [v, 0.0],
    };
    Truth::new(Block, effects, STEP, start)
}

#[test]
fn a_scene_with_one_effect_is_the_rig_with_it() {
    let config = config();
    for case in 0..CASES_ALL {
        let hidden = draw_of(&config, case, 5);
        let scene = rig::run_scene(&config, &Scene::of(&hidden), 5).unwrap();
        assert_eq!(scene, rig::run(&config, &hidden, 5).unwrap(), "{hidden:?}");
    }
}

#[test]
fn effects_drawn_together_can_be_together_and_the_first_is_the_draw_of_one() {
    let config = config();
    let mut kinds = std::collections::BTreeSet::new();
    for seed in 0..200 {
        let three = draw_several(&config, 3, seed);
        assert_eq!(three.len(), 3);
        assert_eq!(three[0], draw_any(&config, seed));
        assert_eq!(draw_several(&config, 2, seed), three[..2]);
        let scene = Scene {
            hidden: three.clone(),
            ..Scene::default()
        };
        scene.effects(&config.known).unwrap();
        kinds.extend(three.iter().map(|h| h.kind()));
    }
    assert!(kinds.len() >= 24, "{kinds:?}");
    let suspects: Vec<_> = draw_suspects(&config, 1)
        .iter()
        .map(Hidden::in_short)
        .collect();
    let expected = [
        "asymmetric_coulomb_friction on slider",
        "elastic_transmission on motor",
        "hysteresis on slider",
        "input_delay on motor",
    ];
    assert_eq!(suspects, expected);
}

#[test]
fn two_laws_of_one_friction_are_refused() {
    let config = config();
    let hidden = [2, 4].map(|case| draw_of(&config, case, 1)).to_vec();
    let scene = Scene {
        hidden,
        ..Scene::default()
    };
    let error = rig::run_scene(&config, &scene, 1).unwrap_err();
    assert!(matches!(error, Error::SamePlace { .. }), "{error}");
    let text = error.to_string();
    assert!(
        text.contains("coulomb_friction on slider") && text.contains("hide one of them"),
        "{text}"
    );
}

#[test]
fn the_sum_of_two_effects_acts_on_the_cart() {
    // Viscous friction c and a constant force F: the cart nears F/c with the time constant m/c.
    let (c, force) = (0.4, 0.1);
    let hidden = vec![
        Hidden::ViscousFriction {
            target: Target::Slider,
            coefficient: c,
        },
        Hidden::ConstantForce {
            target: Target::Slider,
            force,
        },
    ];
    let scene = Scene {
        hidden,
        ..Scene::default()
    };
    let mut known = config().known;
    known.slider_coulomb_friction = 0.0;
    let mut truth = cart(scene.effects(&known).unwrap(), 0.0);
    truth.advance(0.0, 1.5).unwrap();
    let expected = force / c * (1.0 - (-c / M * 1.5).exp());
    assert_abs_diff_eq!(truth.state().v[0], expected, epsilon = 1e-11);
}

#[test]
fn wrong_masses_and_frictions_are_those_of_the_model_times_their_factors() {
    let config = config();
    let base = Base::draw(0.05, 3);
    for factor in base.masses.iter().chain(&base.friction) {
        assert_abs_diff_eq!((factor - 1.0).abs(), 0.05, epsilon = 1e-12);
    }
    let scene = Scene {
        base: Some(base),
        ..Scene::default()
    };
    let effects = scene.effects(&config.known).unwrap();
    let expected = base.friction[0] * config.known.slider_coulomb_friction;
    assert_eq!(effects.joints[0].dry.against_positive, expected);
    // At the upright the inertia of the cart's equation is the sum of the masses.
    let masses = scene.masses().unwrap();
    let mut plant = rig::plant::read(&config.urdf)
        .unwrap()
        .with_masses(&masses)
        .unwrap();
    let sum = 0.466 * masses[0] + 0.072 * masses[1];
    let (m, _) = plant.mass_and_bias([0.0, 0.0], [0.0, 0.0]);
    assert_relative_eq!(m[0][0], sum, max_relative = 1e-9);
    for wrong in [vec![1.0], vec![1.0, f64::NAN], vec![0.0, 1.0]] {
        let plant = rig::plant::read(&config.urdf).unwrap();
        assert!(plant.with_masses(&wrong).is_err());
    }
}

#[test]
fn eleven_disturbances_are_small_and_all_there() {
    let mut config = config();
    config.noise = NoiseLevel::Low;
    let clean = Effects::known(&config.known);
    let mut sums = [0.0; 11];
    for seed in 0..400 {
        let d = Dirt::draw(seed);
        let scaled = [
            (d.cart_mass - 1.0) * 0.466 / 0.007,
            (d.pole_mass - 1.0) / 0.014,
            d.encoder_zero / 3e-3,
            d.bias / 8e-3,
            d.spring / 0.05,
            d.viscous / 0.015,
            d.gain / 8e-3,
            d.asymmetry / 6e-3,
            d.ripple / 6e-3,
            d.stribeck / 15e-3,
            d.delay / 1.5e-3,
        ];
        sums.iter_mut().zip(scaled).for_each(|(s, x)| *s += x * x);
        let scene = Scene {
            dirt: Some(d),
            ..Scene::default()
        };
        let effects = scene.effects(&config.known).unwrap();
        assert_ne!(effects, clean);
        assert!(scene.masses().is_some());
    }
    // Unit variance, to 4 standard deviations of a sum of 400 squares.
    for sum in sums {
        assert_abs_diff_eq!(sum / 400.0, 1.0, epsilon = 4.0 * (2.0 / 400.0_f64).sqrt());
    }
}

#[test]
fn every_other_form_moves_the_rig_otherwise_than_the_librarys_law() {
    let mut config = config();
    config.noise = NoiseLevel::Low;
    config.duration = 20.0;
    for case in FORM_CASES {
        let hidden = draw_of(&config, case, 3);
        let formed = Scene {
            forms: Some(Forms::draw(3)),
            ..Scene::of(&hidden)
        };
        let with = rig::run_scene(&config, &formed, 3).unwrap();
        assert!(with.blows.is_empty(), "{hidden:?}");
        assert_ne!(with, rig::run(&config, &hidden, 3).unwrap(), "{hidden:?}");
    }
}

#[test]
fn drag_by_a_power_brakes_as_its_integral_says() {
    // m v̇ = −d v₀^(2−n) vⁿ: v^(1−n) grows by (n − 1) d v₀^(2−n)/m a second.
    let (d, n, reference, v) = (0.6, 1.6, 0.5, 0.7);
    let slider = JointForces {
        quadratic: d,
        power: Some(Power {
            exponent: n,
            speed: reference,
        }),
        ..JointForces::default()
    };
    let effects = Effects {
        joints: [slider, JointForces::default()],
        ..Effects::default()
    };
    let mut truth = cart(effects, v);
    truth.advance(0.0, 1.0).unwrap();
    let grown = v.powf(1.0 - n) + (n - 1.0) * d * reference.powf(2.0 - n) / M;
    let expected = grown.powf(1.0 / (1.0 - n));
    assert_abs_diff_eq!(truth.state().v[0], expected, epsilon = 1e-10);
}

#[test]
fn two_lags_in_series_answer_a_step_as_both_together() {
    let (first, second, force, t) = (0.03, 0.02, 1.0, 0.15_f64);
    let effects = Effects {
        drive: Drive {
            lag: Some(first),
            second_lag: Some(second),
            ..Drive::default()
        },
        ..Effects::default()
    };
    let mut truth = cart(effects, 0.0);
    truth.advance(force, t).unwrap();
    // ∫ f dt of f = F [1 − (T₁ e^(−t/T₁) − T₂ e^(−t/T₂))/(T₁ − T₂)].
    let part = |tau: f64| tau * tau * (1.0 - (-t / tau).exp());
    let impulse = force * (t - (part(first) - part(second)) / (first - second));
    assert_abs_diff_eq!(truth.state().v[0], impulse / M, epsilon = 1e-7);
}

#[test]
fn a_slack_string_lets_the_motor_go_until_it_is_tight() {
    let string = ElasticString {
        stiffness: 300.0,
        damping: 0.5,
        motor_inertia: 0.05,
        hardening: 0.0,
        free_play: 4e-3,
    };
    let effects = Effects {
        string: Some(string),
        ..Effects::default()
    };
    let mut truth = cart(effects, 0.0);
    // 2 mm of free way at F/J take √(2 · 2 mm · J/F).
    let slack = (2.0 * 2e-3 * 0.05 / 0.2_f64).sqrt();
    truth.advance(0.2, 0.98 * slack).unwrap();
    assert_eq!(truth.state().q[0], 0.0);
    assert_relative_eq!(truth.motor().0, 2e-3 * 0.98 * 0.98, max_relative = 1e-9);
    truth.advance(0.2, 0.1).unwrap();
    assert!(truth.state().q[0] > 1e-4);
    let hard = ElasticString {
        hardening: 1e6,
        free_play: 0.0,
        ..string
    };
    assert_relative_eq!(hard.pull(0.02, 0.0), 300.0 * 0.02 + 1e6 * 8e-6);
}

#[test]
fn stribecks_exponent_and_the_reach_of_position_dependent_friction_are_in_the_force() {
    let dry = DryFriction {
        against_positive: 0.2,
        against_negative: 0.2,
        stribeck: 0.1,
        stribeck_velocity: 0.05,
        stribeck_exponent: Some(1.0),
        ..DryFriction::default()
    };
    let size = dry.size(Direction::Positive, 0.1);
    assert_relative_eq!(size, 0.2 + 0.1 * (-2.0_f64).exp());
    let dry = DryFriction {
        against_positive: 0.2,
        slope: 0.5,
        slope_reach: Some(0.1),
        ..DryFriction::default()
    };
    let size = dry.size_at(Direction::Positive, 0.3, 0.25, 0.0);
    assert_relative_eq!(size, 0.2 + 0.05 * 2.5_f64.tanh());
}

#[test]
fn a_tenth_of_an_effect_is_a_tenth_of_its_distance_from_the_known_friction() {
    let config = config();
    let asymmetric = draw_of(&config, 4, 1);
    let tenth = asymmetric.scaled(0.1, &config.known).unwrap();
    let known = config.known.slider_coulomb_friction;
    for ((_, whole), (_, part)) in asymmetric.parameters().iter().zip(tenth.parameters()) {
        assert_abs_diff_eq!(part - known, 0.1 * (whole - known), epsilon = 1e-12);
    }
    // Of whatever can be scaled, the whole is itself, and a hundredth is an effect that the rig takes.
    let mut scaled = 0;
    for case in 0..CASES_ALL {
        let hidden = draw_of(&config, case, 2);
        let Some(small) = hidden.scaled(0.1, &config.known) else {
            continue;
        };
        scaled += 1;
        small.check().unwrap();
        let whole = hidden.scaled(1.0, &config.known).unwrap();
        for ((_, a), (_, b)) in whole.parameters().iter().zip(hidden.parameters()) {
            assert_relative_eq!(*a, b, max_relative = 1e-12);
        }
    }
    assert_eq!(scaled, CASES_ALL - 3);
}

/// The total energy of cart and pole on a level rail, J, with the point masses: φ = 0 upright.
fn energy(extra: [f64; 2], State { q, v }: State) -> f64 {
    let (mass, p, j, l) = (0.538, 8.442e-3, 1.292_832e-3, 0.117_25);
    let (mass, p, j) = (
        mass + extra[0] + extra[1],
        p + extra[1] * l,
        j + extra[1] * l * l,
    );
    0.5 * mass * v[0] * v[0]
        + p * q[1].cos() * v[0] * v[1]
        + 0.5 * j * v[1] * v[1]
        + p * 9.81 * q[1].cos()
}

#[test]
fn added_masses_have_their_kinetic_and_potential_energy() {
    let config = config();
    let mut known = config.known;
    (known.slider_coulomb_friction, known.pole_viscous_friction) = (0.0, 0.0);
    for (target, extra) in [(Target::Cart, [0.1, 0.0]), (Target::Pole, [0.0, 0.015])] {
        let hidden = Hidden::AddedMass {
            target,
            mass: extra[0] + extra[1],
        };
        let effects = Scene::of(&hidden).effects(&known).unwrap();
        let plant = rig::plant::read(&config.urdf).unwrap();
        let start = State {
            q: [0.0, 1.0],
            v: [0.3, 2.0],
        };
        let mut truth = Truth::new(plant, effects, STEP, start);
        truth.advance(0.0, 2.0).unwrap();
        let (before, after) = (energy(extra, start), energy(extra, truth.state()));
        assert_abs_diff_eq!(after, before, epsilon = 1e-7);
        // Without the extra mass it is not conserved: the test sees it.
        let wrong = energy([0.0; 2], truth.state()) - energy([0.0; 2], start);
        assert!(wrong.abs() > 1e-5, "{wrong}");
    }
}

#[test]
fn on_a_slope_the_cart_runs_down_and_the_pole_hangs_plumb() {
    let config = config();
    let mut known = config.known;
    known.slider_coulomb_friction = 0.0;
    let angle = 0.02_f64;
    let hidden = Hidden::GravityTilt {
        target: Target::Slider,
        angle,
    };
    let effects = Scene::of(&hidden).effects(&known).unwrap();
    let plant = rig::plant::read(&config.urdf).unwrap();
    let mut truth = Truth::new(plant, effects, STEP, State::HANGING);
    // Everything falls along the rail with g sin α; seen from there the pole stays square to the rail.
    truth.advance(0.0, 1.0).unwrap();
    let State { q, v } = truth.state();
    assert_abs_diff_eq!(v[0], -9.81 * angle.sin(), epsilon = 1e-9);
    assert_abs_diff_eq!(q[1], std::f64::consts::PI, epsilon = 1e-9);

    // With the cart held by friction the pole comes to rest plumb, which is π − α from the rail's upright.
    known.slider_coulomb_friction = 5.0;
    known.pole_viscous_friction = 2e-2;
    let effects = Scene::of(&hidden).effects(&known).unwrap();
    let plant = rig::plant::read(&config.urdf).unwrap();
    let mut truth = Truth::new(plant, effects, STEP, State::HANGING);
    truth.advance(0.0, 20.0).unwrap();
    assert_eq!(truth.state().q[0], 0.0);
    let off = truth.state().q[1] - std::f64::consts::PI;
    assert_abs_diff_eq!(off.abs(), angle, epsilon = 1e-6);
}

#[test]
fn a_rotor_on_the_joint_slows_the_pole_as_its_inertia_says() {
    let config = config();
    let mut known = config.known;
    (known.slider_coulomb_friction, known.pole_viscous_friction) = (5.0, 0.0);
    let hidden = Hidden::ReflectedInertia {
        target: Target::Pole,
        inertia: 4e-4,
    };
    let effects = Scene::of(&hidden).effects(&known).unwrap();
    let plant = rig::plant::read(&config.urdf).unwrap();
    let start = State {
        q: [0.0, std::f64::consts::PI - 1e-3],
        v: [0.0, 0.0],
    };
    let mut truth = Truth::new(plant, effects, STEP, start);
    // Half a swing with √(P g/(J + I)).
    let rate = (8.442e-3 * 9.81 / (1.292_832e-3 + 4e-4_f64)).sqrt();
    truth.advance(0.0, std::f64::consts::PI / rate).unwrap();
    let off = truth.state().q[1] - std::f64::consts::PI;
    assert_abs_diff_eq!(off, 1e-3, epsilon = 1e-8);
}

#[test]
fn hidden_stops_turn_the_cart_back_and_nobody_hears_them() {
    let mut config = config();
    config.duration = 20.0;
    let hidden = Hidden::EndStop {
        target: Target::Slider,
        lower: -0.15,
        upper: 0.15,
        restitution: 0.4,
    };
    let plant = rig::plant::read(&config.urdf).unwrap();
    let (log, states) = rig::run_with(plant, &config, &hidden, 2).unwrap();
    let furthest = states.iter().fold(0.0_f64, |a, s| a.max(s.q[0].abs()));
    assert_abs_diff_eq!(furthest, 0.15, epsilon = 1e-3);
    assert!(furthest < 0.15 + 1e-9 && log.blows.is_empty());
    let lopsided = Hidden::EndStop {
        target: Target::Slider,
        lower: -0.1,
        upper: 0.15,
        restitution: 0.4,
    };
    assert!(lopsided.check().is_err());
}
