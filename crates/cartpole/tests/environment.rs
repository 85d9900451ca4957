//! The paper's rig as an environment: it is the rig of the recordings, and what runs on a model runs on it.

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

use approx::assert_abs_diff_eq;
use cartpole::paper::{PaperRig, RigEnvironment, Start};
use cartpole::rig::truth::State;
use pinode_nn::environment::{
    Channel, Closures, Environment, EnvironmentError, ModelEnvironment, Settings, Task, Transition,
    Verdict, uniform,
};
use pinode_nn::model::Model;

fn models(file: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../models/cartpole")
        .join(file)
}

fn rig() -> PaperRig {
    PaperRig::read(&models("paper.toml")).unwrap()
}

const START: [f64; 4] = [0.05, 2.6, 0.1, -0.5];

/// Worth cos φ a step, from a start that is drawn around `START`.
fn task(spread: f64) -> impl Task {
    Closures::new(
        uniform(START.to_vec(), vec![0.0, spread]),
        |step: &Transition<'_>| Verdict {
            reward: step.next[1].cos(),
            terminated: false,
        },
    )
}

fn force(k: usize) -> f64 {
    3.0 * (0.35 * k as f64).cos()
}

#[test]
fn it_moves_as_the_rig_does_late_input_string_and_friction_included() {
    let mut environment = RigEnvironment::new(rig(), None, task(0.0)).unwrap();
    environment.reset(Some(1)).unwrap();
    let inputs: Vec<f64> = (0..40).map(force).collect();
    let [x, phi, x_rate, phi_rate] = START;
    // The string is at rest, as fast as the cart.
    let start = Start {
        state: State {
            q: [x, phi],
            v: [x_rate, phi_rate],
        },
        motor: Some((x, x_rate)),
    };
    let truth = rig().true_run(&start, &[], &inputs).unwrap();
    for (k, expected) in truth.iter().enumerate().skip(1) {
        environment.step(&[inputs[k - 1]]).unwrap();
        let found = environment.truth().unwrap();
        for i in 0..2 {
            // The disturbance's pieces cut the integrator's steps elsewhere.
            assert_abs_diff_eq!(found.q[i], expected.q[i], epsilon = 1e-5);
            assert_abs_diff_eq!(found.v[i], expected.v[i], epsilon = 1e-3);
        }
    }
    assert!(environment.blows().is_empty());
}

#[test]
fn it_shows_what_the_sensors_read() {
    let mut environment = RigEnvironment::new(rig(), None, task(0.0)).unwrap();
    let mut before = environment.reset(Some(2)).unwrap();
    let count = TAU / f64::from(rig().settings.sensors.encoder_counts);
    let mut squares = 0.0;
    for k in 0..200 {
        let step = environment.step(&[0.3 * force(k)]).unwrap();
        let [x, phi, x_rate, phi_rate] = step.observation[..] else {
            panic!("four numbers");
        };
        let truth = environment.truth().unwrap();
        assert_eq!(step.reward, truth.q[1].cos());
        squares += (x - truth.q[0]).powi(2);
        let short = (truth.q[1] - phi).rem_euclid(TAU);
        assert!((-1e-9..count + 1e-9).contains(&short), "{short}");
        assert!(environment.observation_space()[1].contains(phi));
        assert_abs_diff_eq!(x_rate, (x - before[0]) / 0.02, epsilon = 1e-9);
        let turn = phi - before[1];
        let turn = turn - TAU * (turn / TAU).round();
        assert_abs_diff_eq!(phi_rate, turn / 0.02, epsilon = 1e-9);
        before = step.observation;
    }
    // 0.8 mm, and at times a glitch of centimetres.
    let noise = (squares / 200.0).sqrt();
    assert!((0.6e-3..5e-3).contains(&noise), "{noise}");
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_one_other_noise() {
    let run = |environment: &mut RigEnvironment<_>, seed| {
        let mut all = environment.reset(seed).unwrap();
        for k in 0..15 {
            let step = environment.step(&[force(k)]).unwrap();
            assert_eq!(step.truncated, k == 14);
            all.extend(step.observation);
        }
        all
    };
    let mut one = RigEnvironment::new(rig(), Some(15), task(0.2)).unwrap();
    let mut other = RigEnvironment::new(rig(), Some(15), task(0.2)).unwrap();
    let first = run(&mut one, Some(5));
    let second = run(&mut one, None);
    assert_ne!(first, second);
    assert_ne!(run(&mut other, Some(6)), first);
    assert_eq!(run(&mut other, Some(5)), first);
    assert_eq!(run(&mut other, None), second);
}

#[test]
fn what_the_rig_cannot_do_is_refused() {
    let mut environment = RigEnvironment::new(rig(), Some(2), task(0.0)).unwrap();
    let early = environment.step(&[0.0]).unwrap_err();
    assert!(matches!(early, EnvironmentError::NotReset));
    environment.reset(None).unwrap();
    for wrong in [&[][..], &[0.0, 0.0], &[f64::NAN], &[11.0]] {
        assert!(environment.step(wrong).is_err(), "{wrong:?}");
    }
    environment.step(&[10.9]).unwrap();
    assert!(environment.step(&[-10.9]).unwrap().truncated);
    let late = environment.step(&[0.0]).unwrap_err();
    assert!(matches!(late, EnvironmentError::Over { steps: 2 }));

    let beyond = Closures::new(uniform(vec![0.3], vec![]), |_: &Transition<'_>| Verdict {
        reward: 0.0,
        terminated: false,
    });
    let mut environment = RigEnvironment::new(rig(), None, beyond).unwrap();
    let error = environment.reset(None).unwrap_err().to_string();
    assert!(
        error.contains("q.slider = 0.3") && error.contains("-0.325 to 0.276 m"),
        "{error}"
    );
    assert!(environment.step(&[0.0]).is_err());
    assert!(RigEnvironment::new(rig(), Some(0), task(0.0)).is_err());
}

/// A push against the end of the rail is heard.
#[test]
fn the_rail_ends() {
    let mut environment = RigEnvironment::new(rig(), None, task(0.0)).unwrap();
    environment.reset(None).unwrap();
    for _ in 0..50 {
        environment.step(&[8.0]).unwrap();
    }
    assert!(!environment.blows().is_empty());
    assert!(environment.truth().unwrap().q[0] <= 0.276 + 1e-9);
}

/// What runs on one runs on the other: a model of the rig without its string is not far from it after a third of a second.
#[test]
fn a_controller_runs_on_the_model_and_on_the_rig() {
    let effects = "
        [[effect]]
        kind = \"input_delay\"
        input = \"motor\"
        delay = 0.034
        [[effect]]
        kind = \"coulomb_friction\"
        joint = \"slider\"
        force = 0.215
        [[effect]]
        kind = \"viscous_friction\"
        joint = \"pole\"
        coefficient = 0.002
    ";
    let path = models("paper_known.toml");
    let text = std::fs::read_to_string(&path).unwrap() + effects;
    let model = Model::parse(&path, text).unwrap();
    let rig = rig();
    let settings = Settings {
        actions: vec![Channel::new("u.motor", -10.9, 10.9)],
        ..Settings::new(rig.interval())
    };
    let hanging = || {
        Closures::new(
            uniform(vec![0.0, PI, 0.0, 0.0], Vec::new()),
            |step: &Transition<'_>| Verdict {
                reward: -step.next[1].cos(),
                terminated: false,
            },
        )
    };
    let mut on_model = ModelEnvironment::new(&model, settings, hanging()).unwrap();
    let mut on_rig = RigEnvironment::new(rig, None, hanging()).unwrap();
    let run = |environment: &mut dyn Environment| {
        let names: Vec<String> = environment
            .observation_space()
            .iter()
            .map(|channel| channel.name.clone())
            .collect();
        assert_eq!(names, ["q.slider", "q.pole", "v.slider", "v.pole"]);
        let mut seen = environment.reset(Some(3)).unwrap();
        let mut worth = 0.0;
        for _ in 0..16 {
            let wish = 20.0 * (0.1 - seen[0]) - 2.0 * seen[2];
            let action = environment.action_space()[0].clip(wish);
            let step = environment.step(&[action]).unwrap();
            seen = step.observation;
            worth += step.reward;
        }
        (seen, worth)
    };
    let (model, on_model) = run(&mut on_model);
    let (rig, on_rig) = run(&mut on_rig);
    assert_abs_diff_eq!(model[0], rig[0], epsilon = 0.02);
    assert_abs_diff_eq!(model[1], rig[1], epsilon = 0.15);
    assert_abs_diff_eq!(on_model, on_rig, epsilon = 0.2);
}
