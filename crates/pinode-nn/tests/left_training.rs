//! A network is warned of where a roll-out leaves what it was trained on: the quantity, the time and the value are those of the motion.

use std::path::Path;

use pinode_nn::Error;
use pinode_nn::evaluate::{Options, evaluate};
use pinode_nn::free_run::{LONGEST_STEP, simulate};
use pinode_nn::learnt::{Card, Feature, Guard, LearntForce, Names, Output, Quantity, weights};
use pinode_nn::log::Log;
use pinode_nn::model::Model;
use pinode_nn::network::{Activation, Mlp, Shape};

/// A sledge of 2 kg on ice, and a network that found no force on it.
const SLEDGE: &str = r#"
name = "sledge"

[lagrangian]
coordinates = ["x"]
kinetic = "0.5*m*x_dot^2"
potential = "0"
parameters = { m = 2.0 }

[[input]]
name = "push"
joint = "x"
"#;

const NETWORK: &str = r#"
[[effect]]
kind = "neural_network"
weights = "drag.safetensors"
joints = ["x"]
"#;

/// Velocities that the network was trained on, m/s.
const TRAINED: [f64; 2] = [-1.1, 1.2];

/// A network without a force that sees these quantities.
fn still(quantities: &[Quantity]) -> LearntForce {
    let shape = Shape::new(
        &[quantities.len(), 3, 1],
        Activation::Relu,
        Activation::Tanh,
    )
    .unwrap();
    let zeros = vec![0.0; shape.parameters()];
    let feature = |&quantity: &Quantity| Feature {
        quantity,
        offset: 0.0,
        width: 1.0,
        range: TRAINED,
    };
    let output = Output {
        coordinate: 0,
        scale: 5.0,
    };
    LearntForce::new(
        Mlp::from_parameters(shape, zeros).unwrap(),
        quantities.iter().map(feature).collect(),
        vec![output],
        false,
    )
    .unwrap()
}

/// The sledge with this force, from files in `folder`.
fn sledge(folder: &Path, force: &LearntForce) -> Model {
    let bare = Model::parse(&folder.join("bare.toml"), SLEDGE).unwrap();
    let names = Names {
        coordinates: bare.mechanics.coordinates(),
        inputs: &["push"],
    };
    let card = Card::of(force, names);
    weights::write(&folder.join("drag.safetensors"), force, &card, false).unwrap();
    let path = folder.join("sledge.toml");
    std::fs::write(&path, format!("{SLEDGE}{NETWORK}")).unwrap();
    Model::load(&path).unwrap()
}

/// Times of 2 s at 100 Hz, and a push that is held, N.
fn pushed(force: f64) -> (Vec<f64>, Vec<Vec<f64>>) {
    let t: Vec<f64> = (0..=200).map(|k| 0.01 * f64::from(k)).collect();
    let u = vec![vec![force; t.len()]];
    (t, u)
}

#[test]
fn a_sledge_that_is_pushed_beyond_the_trained_velocities_is_told_with_time_and_value() {
    let folder = tempfile::tempdir().unwrap();
    let model = sledge(folder.path(), &still(&[Quantity::Velocity(0)]));
    let (t, u) = pushed(4.0);
    let states = simulate(&model, "push", &t, &u, &[0.0, 0.0], LONGEST_STEP).unwrap();
    let mut guard = Guard::new(&model);
    guard.watch("push", &t, &u, &states);
    let departures = guard.departures();
    let [departure] = departures.as_slice() else {
        panic!("one network has left: {departures:?}")
    };
    // v = 2 m/s² t is a twentieth of the range, 0.115 m/s, beyond 1.2 m/s after 0.6575 s: the next sample is at 0.66 s.
    assert!((departure.t - 0.66).abs() < 1e-12, "{departure:?}");
    let [velocity] = departure.saw.as_slice() else {
        panic!("the network sees one quantity")
    };
    assert_eq!(
        (velocity.name.as_str(), velocity.unit.as_str()),
        ("v.x", "m/s")
    );
    assert!((velocity.value - 1.32).abs() < 1e-9);
    assert_eq!(velocity.trained, TRAINED);
    assert_eq!(departure.joints, ["x"]);
    assert_eq!(
        (departure.samples_outside, departure.samples),
        (201 - 66, 201)
    );
    assert_eq!((departure.distance, departure.reach), (None, None));
}

#[test]
fn a_sledge_within_the_trained_velocities_is_not_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let model = sledge(folder.path(), &still(&[Quantity::Velocity(0)]));
    let (t, u) = pushed(1.2);
    let states = simulate(&model, "push", &t, &u, &[0.0, 0.0], LONGEST_STEP).unwrap();
    let mut guard = Guard::new(&model);
    guard.watch("push", &t, &u, &states);
    assert_eq!(guard.departures(), []);
}

#[test]
fn an_input_that_was_never_so_strong_is_named_as_it_acts_samples_later() {
    let folder = tempfile::tempdir().unwrap();
    let late = Quantity::Input { input: 0, back: 2 };
    let model = sledge(folder.path(), &still(&[Quantity::Velocity(0), late]));
    let (t, mut u) = pushed(0.0);
    u[0][50..].fill(-3.0);
    let states = simulate(&model, "push", &t, &u, &[0.0, 0.0], LONGEST_STEP).unwrap();
    let mut guard = Guard::new(&model);
    guard.watch("push", &t, &u, &states);
    let departure = guard.departures().remove(0);
    assert_eq!(departure.saw[0].name, "u.push[-2]");
    assert_eq!(
        (departure.saw[0].value, departure.saw[0].unit.as_str()),
        (-3.0, "N")
    );
    assert!((departure.t - 0.52).abs() < 1e-12);
}

#[test]
fn a_state_between_what_was_seen_is_unlike_it_though_each_quantity_is_in_its_range() {
    let folder = tempfile::tempdir().unwrap();
    let quantities = [Quantity::Position(0), Quantity::Velocity(0)];
    // Trained on a swing of 1 m at 1 rad/s; then the sledge glides through its middle, slowly.
    let swing: Vec<Vec<f64>> = (0..630)
        .map(|k| 0.01 * f64::from(k))
        .map(|t| vec![t.sin(), t.cos()])
        .collect();
    let force = still(&quantities).trained_on(&swing);
    let model = sledge(folder.path(), &force);
    // What covers the training is in the file.
    assert_eq!(model.networks[0].force.region(), force.region());
    let (t, u) = pushed(0.0);
    let mut guard = Guard::new(&model);
    let glide = simulate(&model, "glide", &t, &u, &[-0.9, 0.4], LONGEST_STEP).unwrap();
    guard.watch("glide", &t, &u, &glide);
    let departure = guard.departures().remove(0);
    // It starts on the swing, √(0.9² + 0.4²) = 0.98, and half a second later both quantities are well off.
    assert!(departure.t > 0.3 && departure.t < 0.8, "{departure:?}");
    let (distance, reach) = (departure.distance.unwrap(), departure.reach.unwrap());
    assert!(distance > reach && distance < 0.1, "{departure:?}");
    let within =
        |saw: &pinode_nn::learnt::Saw| (saw.trained[0]..saw.trained[1]).contains(&saw.value);
    assert!(departure.saw.iter().all(within));

    let mut guard = Guard::new(&model);
    let states: Vec<Vec<f64>> = t.iter().map(|t| vec![t.sin(), t.cos()]).collect();
    guard.watch("swing", &t, &u, &states);
    assert_eq!(guard.departures(), []);
}

/// The log of a sledge under a push of 4 N.
fn log() -> String {
    let mut text = "t,q.x,v.x,u.push\n".to_owned();
    for k in 0..=200 {
        let t = 0.01 * f64::from(k);
        text += &format!("{t},{},{},4\n", t * t, 2.0 * t);
    }
    text
}

#[test]
fn windows_of_an_evaluation_that_leave_are_counted_by_their_samples() {
    let folder = tempfile::tempdir().unwrap();
    let model = sledge(folder.path(), &still(&[Quantity::Velocity(0)]));
    let path = folder.path().join("log.csv");
    std::fs::write(&path, log()).unwrap();
    let log = Log::read(&path, &model).unwrap();
    let options = Options {
        horizon: 0.1,
        windows: 10,
        ..Options::default()
    };
    let evaluation = evaluate(&model, &[log], &options).unwrap();
    let [departure] = evaluation.left_training.as_slice() else {
        panic!("the network leaves what it was trained on")
    };
    // 10 windows of 11 samples begin at 0, 0.19 … 1.71 s: 0.57 to 0.67 s has 2 samples from 0.66 s on, and all of 0.76 s and later.
    assert_eq!(
        (departure.samples_outside, departure.samples),
        (2 + 6 * 11, 110)
    );
    assert!((departure.t - 0.66).abs() < 1e-9);
}

#[test]
fn a_file_with_half_of_a_region_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let force = still(&[Quantity::Velocity(0)]);
    let model = sledge(folder.path(), &force);
    let mut card = model.networks[0].card.clone();
    card.reach = Some(0.1);
    weights::write(
        &folder.path().join("drag.safetensors"),
        &force,
        &card,
        false,
    )
    .unwrap();
    let Err(Error::Problems(problems)) = Model::load(&folder.path().join("sledge.toml")) else {
        panic!("half of a region is a fault")
    };
    let words = problems.to_string();
    assert!(
        words.contains("`reach` in its card and lacks the tensor"),
        "{words}"
    );
}

#[cfg(feature = "cli")]
#[test]
fn the_program_warns_people_and_tells_programs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    sledge(folder, &still(&[Quantity::Velocity(0)]));
    std::fs::write(folder.join("log.csv"), log()).unwrap();
    let warning = "warning: the network on `x` left what it was trained on at t = 0.66 s of run `0`: v.x = 1.32 m/s, trained within \
                   -1.1 … 1.2 m/s; ";
    for (arguments, share) in [
        (
            &[
                "simulate",
                "sledge.toml",
                "--log",
                "log.csv",
                "--out",
                "out.csv",
                "--json",
            ][..],
            "67 % of the samples are outside",
        ),
        (
            &["evaluate", "sledge.toml", "log.csv", "--json"][..],
            "of the samples are outside",
        ),
    ] {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_pinode"))
            .args(arguments)
            .current_dir(folder)
            .output()
            .unwrap();
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{words}");
        assert!(words.contains(warning) && words.contains(share), "{words}");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let departure = &json["left_training"][0];
        assert_eq!(departure["joints"], serde_json::json!(["x"]));
        assert_eq!(departure["saw"][0]["name"], "v.x");
        assert!((departure["t"].as_f64().unwrap() - 0.66).abs() < 1e-9);
        assert!(departure["samples_outside"].as_u64().unwrap() > 0);
    }
    let still = [
        "simulate",
        "sledge.toml",
        "--duration",
        "1",
        "--out",
        "out.csv",
        "--json",
    ];
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(still)
        .current_dir(folder)
        .output()
        .unwrap();
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["left_training"], serde_json::json!([]));
    assert!(output.stderr.is_empty());
}

#[test]
fn samples_ago_are_another_time_in_a_log_of_another_rate() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let late = Quantity::Input { input: 0, back: 2 };
    let warnings = |quantities: &[Quantity], interval: Option<f64>| {
        let force = still(quantities);
        let model = sledge(folder, &force);
        let card = Card {
            interval,
            ..model.networks[0].card.clone()
        };
        weights::write(&folder.join("drag.safetensors"), &force, &card, false).unwrap();
        let model = Model::load(&folder.join("sledge.toml")).unwrap();
        let path = folder.join("log.csv");
        let rows = (0..200).map(|k| format!("{},{},0\n", 0.02 * f64::from(k), 0.01 * f64::from(k)));
        let text = "t,q.x,u.push\n".to_owned() + &rows.collect::<String>();
        std::fs::write(&path, text).unwrap();
        let log = Log::read(&path, &model).unwrap();
        let evaluation = evaluate(&model, &[log], &Options::default()).unwrap();
        evaluation.warnings
    };
    let seen = [Quantity::Velocity(0), late];
    let told = warnings(&seen, Some(0.01));
    let words = "the network of drag.safetensors sees u.push[-2], and samples of 0.010000 s";
    assert!(told.len() == 1 && told[0].contains(words), "{told:?}");
    // The same rate, a file of before, and a network that sees the present alone.
    assert_eq!(warnings(&seen, Some(0.02)), [""; 0]);
    assert_eq!(warnings(&seen, None), [""; 0]);
    assert_eq!(warnings(&seen[..1], Some(0.01)), [""; 0]);
}
