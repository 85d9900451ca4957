//! An environment is the free run of its model, refuses what it cannot take, and repeats itself.
#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::free_run::{FreeRun, simulate, substeps};
use crate::hybrid::Hybrid;
use crate::learnt::{Card, Feature, LearntForce, Names, Output, Quantity};
use crate::model::{Model, NetworkEntry};
use crate::network::{Activation, Mlp, Shape};
use crate::shooting::Trajectory;

const INTERVAL: f64 = 0.02;
/// Well between two whole shares of the interval: rounding of the times does not make it one step more.
const LONGEST_STEP: f64 = 0.95e-3;

fn model(file: &str, effects: &str) -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../models")
        .join(file);
    let text = std::fs::read_to_string(&path).unwrap() + effects;
    Model::parse(&path, text).unwrap()
}

fn cartpole(effects: &str) -> Model {
    model("cartpole/cartpole.toml", effects)
}

const DELAY: &str = "\n[[effect]]\nkind = \"input_delay\"\ninput = \"motor\"\ndelay = 0.0337\n";
const LAG: &str =
    "\n[[effect]]\nkind = \"actuator_lag\"\ninput = \"motor\"\ntime_constant = 0.015\n";
const DEAD_ZONE: &str =
    "\n[[effect]]\nkind = \"input_dead_zone\"\ninput = \"motor\"\nwidth = 0.3\n";
const BRISTLES: &str = "\n[[effect]]\nkind = \"dahl_friction\"\njoint = \"slider\"\nstiffness = 900.0\ncoulomb_force = 0.3\n";
const STRING: &str = "\n[[effect]]\nkind = \"elastic_transmission\"\ninput = \"motor\"\nstiffness = 340.0\ndamping = 2.7\nmotor_inertia = 0.06\n";

/// With a random network on the first coordinate that sees the state and the first input, now and two samples ago.
fn with_network(mut model: Model) -> Model {
    let quantities = [
        Quantity::Velocity(0),
        Quantity::Input { input: 0, back: 0 },
        Quantity::Input { input: 0, back: 2 },
    ];
    let shape = Shape::new(&[3, 8, 1], Activation::Tanh, Activation::Tanh).unwrap();
    let feature = |quantity| Feature {
        quantity,
        offset: 0.0,
        width: 2.0,
        range: [-1.0, 1.0],
    };
    let output = Output {
        coordinate: 0,
        scale: 0.7,
    };
    let network = Mlp::xavier(shape, &mut ChaCha8Rng::seed_from_u64(3));
    let features = quantities.map(feature).to_vec();
    let force = LearntForce::new(network, features, vec![output], false).unwrap();
    let names = Names {
        coordinates: model.mechanics.coordinates(),
        inputs: &["motor"],
    };
    model.networks.push(NetworkEntry {
        table: 0,
        share: 1.0,
        single: false,
        weights: "none.safetensors".to_owned(),
        path: "none.safetensors".into(),
        sha256: String::new(),
        card: Card::of(&force, names),
        force: Arc::new(force),
    });
    model
}

fn nothing_wanted() -> impl Task {
    Closures::new(
        |_: &mut dyn rand::Rng, _: &mut [f64]| {},
        |_: &Transition<'_>| Verdict {
            reward: 0.0,
            terminated: false,
        },
    )
}

fn environment(model: &Model) -> ModelEnvironment<impl Task> {
    let settings = Settings {
        longest_step: LONGEST_STEP,
        ..Settings::new(INTERVAL)
    };
    ModelEnvironment::new(model, settings, nothing_wanted()).unwrap()
}

fn action(k: usize) -> f64 {
    2.0 * (0.7 * k as f64).sin() + 0.5
}

#[test]
fn steps_are_the_free_run_under_the_same_inputs() {
    let bare = cartpole("");
    for model in [
        cartpole(""),
        cartpole(DELAY),
        cartpole(LAG),
        cartpole(&[DELAY, LAG, DEAD_ZONE].concat()),
        cartpole(&[DELAY, BRISTLES].concat()),
        cartpole(&[STRING, DELAY].concat()),
        with_network(cartpole(DELAY)),
    ] {
        let mut environment = environment(&model);
        let start = [0.05, 2.0, 0.1, -1.0];
        // What was before is under way at the start.
        let before: Vec<f64> = (0..environment.past()).map(|k| action(k + 100)).collect();
        let past: Vec<&[f64]> = before.chunks(1).collect();
        environment.reset_to(&start, &past).unwrap();
        let steps = 25;

        let u: Vec<f64> = before
            .iter()
            .copied()
            .chain((0..=steps).map(action))
            .collect();
        let t: Vec<f64> = (0..u.len()).map(|k| k as f64 * INTERVAL).collect();
        let hybrid = Hybrid::explicit(&model);
        let first = before.len();
        let free = FreeRun::new(&hybrid, &t, std::slice::from_ref(&u), LONGEST_STEP);
        // What has a memory starts where the force that arrives just before leaves it.
        let theta = hybrid.theta();
        let columns = std::slice::from_ref(&u);
        let inputs = hybrid.drive(&t, columns, substeps(&t, LONGEST_STEP), &theta, &[]);
        let last = (first * inputs.grid.substeps()).saturating_sub(1);
        let hidden = hybrid.hidden_start(&start[2..], &theta, &inputs, last);
        let mut rolled = Trajectory::default();
        let initial = [&start[..], &hidden].concat();
        free.roll(
            &mut free.roller(),
            (first, steps + 1),
            &initial,
            &mut rolled,
        )
        .unwrap();

        for (k, expected) in rolled.states.chunks(hybrid.nx()).enumerate().skip(1) {
            let step = environment.step(&[action(k - 1)]).unwrap();
            for (found, expected) in step.observation.iter().zip(expected) {
                let error = (found - expected).abs() / (1.0 + expected.abs());
                assert!(
                    error < 1e-12,
                    "{}: step {k}: {error:e}",
                    model.effects.len()
                );
            }
        }
        // The effects do something.
        if model.effects.len() + model.networks.len() > bare.effects.len() {
            let mut other = self::environment(&bare);
            other.reset_to(&start, &past[..0]).unwrap();
            (0..steps).for_each(|k| drop(other.step(&[action(k)]).unwrap()));
            assert!((other.state()[0] - environment.state()[0]).abs() > 1e-4);
        }
    }
}

#[test]
fn from_rest_steps_are_a_simulation_to_the_last_bits() {
    let model = cartpole("");
    let hanging = [0.0, PI, 0.0, 0.0];
    let mut environment = environment(&model);
    environment.reset_to(&hanging, &[]).unwrap();
    let t: Vec<f64> = (0..=100).map(|k| k as f64 * INTERVAL).collect();
    let u: Vec<f64> = (0..=100).map(action).collect();
    let states = simulate(&model, "", &t, &[u], &hanging, LONGEST_STEP).unwrap();
    for (k, expected) in states.iter().enumerate().skip(1) {
        let found = environment.step(&[action(k - 1)]).unwrap().observation;
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "step {k}");
        }
    }
}

/// A block of 2 kg under a force that comes 30 ms late: nothing moves for 1.5 intervals, then half a push has come.
#[test]
fn a_delay_holds_back_what_is_done() {
    let text = r#"
        [lagrangian]
        coordinates = ["x"]
        kinetic = "x_dot^2"
        potential = "0"
        [[input]]
        name = "push"
        joint = "x"
        [[effect]]
        kind = "input_delay"
        input = "push"
        delay = 0.03
    "#;
    let model = Model::parse("block.toml".as_ref(), text).unwrap();
    let mut environment = environment(&model);
    assert_eq!(environment.past(), 2);
    environment.reset(None).unwrap();
    let speeds: Vec<f64> = [1.0, 0.0, 0.0, 0.0]
        .iter()
        .map(|push| environment.step(&[*push]).unwrap().observation[1])
        .collect();
    for (speed, impulse) in speeds.iter().zip([0.0, 0.01, 0.02, 0.02]) {
        assert!((speed - impulse / 2.0).abs() < 1e-15, "{speeds:?}");
    }
    // What was idle before an episode goes on until the first action comes.
    let settings = Settings {
        idle: vec![4.0],
        ..Settings::new(INTERVAL)
    };
    let mut environment = ModelEnvironment::new(&model, settings, nothing_wanted()).unwrap();
    environment.reset(None).unwrap();
    let speeds = [0, 1].map(|_| environment.step(&[0.0]).unwrap().observation[1]);
    assert!((speeds[0] - 0.04).abs() < 1e-15 && (speeds[1] - 0.06).abs() < 1e-15);
    // An episode does not know of the one before.
    environment
        .reset_to(&[0.0, 0.0], &[&[0.0], &[0.0]])
        .unwrap();
    assert_eq!(environment.step(&[0.0]).unwrap().observation, [0.0, 0.0]);
}

#[test]
fn without_forces_the_energy_stays() {
    let mut model = model("double_pendulum/double_pendulum_text.toml", "");
    model.effects.clear();
    let mut environment = environment(&model);
    let n = model.inputs.len();
    environment.reset_to(&[1.0, 2.0, 0.0, 0.0], &[]).unwrap();
    let (mechanics, p) = (&model.mechanics, &model.parameter_values);
    let energy = |x: &[f64]| {
        mechanics.kinetic_energy_with(&x[..2], &x[2..], p)
            + mechanics.potential_energy_with(&x[..2], p)
    };
    let start = energy(environment.state());
    for _ in 0..100 {
        environment.step(&vec![0.0; n]).unwrap();
    }
    let lost = (energy(environment.state()) - start).abs();
    assert!(lost < 1e-8, "{lost:e}");
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let model = cartpole(DELAY);
    let task = || {
        Closures::new(
            uniform(vec![0.0, PI, 0.0, 0.0], vec![0.1, 0.3, 0.0, 1.0]),
            |step: &Transition<'_>| Verdict {
                reward: step.next[1].cos() - 0.01 * step.action[0].powi(2),
                terminated: step.next[0].abs() > 10.0,
            },
        )
    };
    let settings = || Settings {
        episode: Some(20),
        ..Settings::new(INTERVAL)
    };
    let run = |environment: &mut dyn Environment, seed| {
        let mut all = environment.reset(seed).unwrap();
        for k in 0..20 {
            let step = environment.step(&[action(k)]).unwrap();
            assert_eq!(step.truncated, k == 19);
            assert!(!step.terminated);
            all.extend(step.observation);
            all.push(step.reward);
        }
        all
    };
    let mut one = ModelEnvironment::new(&model, settings(), task()).unwrap();
    let mut other = ModelEnvironment::new(&model, settings(), task()).unwrap();
    let first = run(&mut one, Some(7));
    let second = run(&mut one, None);
    assert_ne!(first, second);
    run(&mut other, Some(8));
    assert_eq!(run(&mut other, Some(7)), first);
    assert_eq!(run(&mut other, None), second);
    // Without a seed at first: seed 0.
    let mut fresh = ModelEnvironment::new(&model, settings(), task()).unwrap();
    assert_eq!(run(&mut fresh, None), run(&mut one, Some(0)));
    assert!((first[1] - PI).abs() < 0.3 && first[2] == 0.0);
}

#[test]
fn what_is_out_of_turn_or_out_of_bounds_is_refused_and_changes_nothing() {
    let model = cartpole("");
    let settings = Settings {
        actions: vec![Channel::new("u.motor", -5.0, 5.0)],
        episode: Some(3),
        ..Settings::new(INTERVAL)
    };
    let mut environment = ModelEnvironment::new(&model, settings, nothing_wanted()).unwrap();
    let said = |error: EnvironmentError| error.to_string();
    let early = environment.step(&[0.0]).unwrap_err();
    assert!(matches!(early, EnvironmentError::NotReset));
    assert!(said(early).contains("call `reset`"));
    environment.reset(Some(1)).unwrap();
    let long = environment.step(&[0.0, 1.0]).unwrap_err();
    assert_eq!(
        said(long),
        "the action has 2 numbers, and the environment takes 1: u.motor"
    );
    for wrong in [f64::NAN, f64::INFINITY, 5.1, -6.0] {
        let error = environment.step(&[wrong]).unwrap_err();
        assert!(matches!(error, EnvironmentError::Action { .. }), "{error}");
        assert!(said(error).contains("u.motor = "));
    }
    assert_eq!(environment.state(), [0.0; 4]);
    for k in 0..3 {
        assert_eq!(environment.step(&[5.0]).unwrap().truncated, k == 2);
    }
    let late = environment.step(&[0.0]).unwrap_err();
    assert!(matches!(late, EnvironmentError::Over { steps: 3 }));
    let short = environment.reset_to(&[0.0], &[]).unwrap_err();
    assert!(said(short).contains("has 1 numbers"));
    let nan = environment.reset_to(&[0.0, f64::NAN, 0.0, 0.0], &[]);
    assert!(said(nan.unwrap_err()).contains("q.pole = NaN"));
    let past: [&[f64]; 1] = [&[1.0, 2.0]];
    assert!(environment.reset_to(&[0.0; 4], &past).is_err());
}

#[test]
fn settings_that_make_no_sense_are_refused_by_name() {
    let model = cartpole("");
    let refused = |settings| {
        let made = ModelEnvironment::new(&model, settings, nothing_wanted());
        made.map(|_| ()).unwrap_err().to_string()
    };
    let usual = || Settings::new(INTERVAL);
    for interval in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(refused(Settings::new(interval)).starts_with("interval = "));
    }
    let longest_step = 0.0;
    assert!(
        refused(Settings {
            longest_step,
            ..usual()
        })
        .starts_with("longest_step = 0")
    );
    let episode = Some(0);
    assert!(refused(Settings { episode, ..usual() }).starts_with("episode = 0"));
    let idle = vec![f64::NAN];
    assert!(refused(Settings { idle, ..usual() }).starts_with("idle = NaN"));
    let idle = vec![0.0; 2];
    assert!(refused(Settings { idle, ..usual() }).contains("has 2 numbers"));
    let actions = vec![Channel::new("u.motor", 1.0, -1.0)];
    assert!(refused(Settings { actions, ..usual() }).starts_with("u.motor has the bounds"));
    let actions = vec![Channel::unbounded("a"), Channel::unbounded("b")];
    assert!(refused(Settings { actions, ..usual() }).starts_with("the action space has 2 numbers"));
}

#[test]
fn what_a_task_says_is_checked() {
    let model = cartpole("");
    let begins = |q: f64| move |_: &mut dyn rand::Rng, state: &mut [f64]| state[1] = q;
    let worth = |reward: f64| {
        move |_: &Transition<'_>| Verdict {
            reward,
            terminated: true,
        }
    };
    let made = |q, reward| {
        let task = Closures::new(begins(q), worth(reward));
        ModelEnvironment::new(&model, Settings::new(INTERVAL), task).unwrap()
    };
    let error = made(f64::NAN, 0.0).reset(None).unwrap_err();
    assert!(error.to_string().contains("q.pole = NaN"), "{error}");
    let mut environment = made(1.0, f64::NAN);
    environment.reset(None).unwrap();
    let error = environment.step(&[0.0]).unwrap_err();
    assert!(matches!(error, EnvironmentError::Reward { step: 1, .. }));
    let mut environment = made(1.0, 2.0);
    assert_eq!(environment.reset(None).unwrap(), [0.0, 1.0, 0.0, 0.0]);
    let step = environment.step(&[0.0]).unwrap();
    assert!(step.terminated && !step.truncated && step.reward == 2.0);
    assert!(environment.step(&[0.0]).is_err());
}

#[test]
fn a_motion_that_ends_is_told_with_its_step() {
    let model = cartpole("");
    let mut environment = environment(&model);
    environment.reset_to(&[0.0, 0.0, 1e10, 0.0], &[]).unwrap();
    let error = loop {
        match environment.step(&[1e300]) {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    assert!(matches!(error, EnvironmentError::Stopped { .. }), "{error}");
    assert!(matches!(
        environment.step(&[0.0]),
        Err(EnvironmentError::Over { .. })
    ));
    environment.reset(None).unwrap();
    environment.step(&[0.0]).unwrap();
}

/// A floating base: seven numbers of a pose, which keep a unit quaternion.
#[test]
fn poses_have_their_names_and_stay_poses() {
    let model = model("quadruped/quadruped.toml", "");
    let mut environment = environment(&model);
    let start = environment.reset(None).unwrap();
    let names: Vec<&str> = environment
        .observation_space()
        .iter()
        .map(|channel| channel.name.as_str())
        .collect();
    assert_eq!(names.len(), start.len());
    assert_eq!((names[3], start[3]), ("q.base.qw", 1.0));
    let still = vec![0.0; environment.action_space().len()];
    let mut last = start;
    for _ in 0..5 {
        last = environment.step(&still).unwrap().observation;
    }
    let norm: f64 = last[3..7].iter().map(|x| x * x).sum();
    assert!((norm - 1.0).abs() < 1e-12);
    // It has fallen for 0.1 s.
    assert!((last[2] + 0.5 * 9.81 * 0.01).abs() < 0.01, "{}", last[2]);
}

/// What a step takes of memory does not grow.
#[test]
fn steps_take_no_more_memory_later_on() {
    let model = with_network(cartpole(DELAY));
    let mut environment = environment(&model);
    environment.reset(None).unwrap();
    let mut taken = || {
        allocation_counter::measure(|| {
            environment.step(&[0.1]).unwrap();
        })
        .bytes_total
    };
    let early = [0; 3].map(|_| taken())[2];
    let late = [0; 200].map(|_| taken())[199];
    assert_eq!(early, late);
}
