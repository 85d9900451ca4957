//! An ensemble of networks: the force is the mean of its members, and how far their roll-outs are apart is told.
#![allow(clippy::unwrap_used)]
#![cfg(feature = "cli")]

use std::path::Path;
use std::process::{Command, Output};

use pinode_nn::free_run::{LONGEST_STEP, simulate};
use pinode_nn::learnt::{Card, Feature, LearntForce, Names, Quantity, weights};
use pinode_nn::model::{Model, Revision};
use pinode_nn::network::{Activation, Mlp, Shape};
use serde_json::Value;

/// A sledge of 2 kg on ice.
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

[sensor.x]
position_noise = 1e-3
velocity = "none"
"#;

const ENSEMBLE: &str = r#"
[[effect]]
kind = "neural_network"
weights = ["weak.safetensors", "strong.safetensors"]
joints = ["x"]
"#;

/// A network that found this force everywhere, N.
fn constant(force: f64) -> LearntForce {
    let shape = Shape::new(&[1, 1], Activation::Relu, Activation::Identity).unwrap();
    let network = Mlp::from_parameters(shape, vec![0.0, force / 10.0]).unwrap();
    let feature = Feature {
        quantity: Quantity::Velocity(0),
        offset: 0.0,
        width: 1.0,
        range: [-5.0, 5.0],
    };
    let output = pinode_nn::learnt::Output {
        coordinate: 0,
        scale: 10.0,
    };
    LearntForce::new(network, vec![feature], vec![output], false).unwrap()
}

/// The sledge with an ensemble of 1 N and 3 N in `folder`.
fn sledge(folder: &Path) -> Model {
    let bare = Model::parse(&folder.join("bare.toml"), SLEDGE).unwrap();
    let names = Names {
        coordinates: bare.mechanics.coordinates(),
        inputs: &["push"],
    };
    for (name, newtons) in [("weak", 1.0), ("strong", 3.0)] {
        let force = constant(newtons);
        let path = folder.join(format!("{name}.safetensors"));
        weights::write(&path, &force, &Card::of(&force, names), false).unwrap();
    }
    let path = folder.join("sledge.toml");
    std::fs::write(&path, format!("{SLEDGE}{ENSEMBLE}")).unwrap();
    Model::load(&path).unwrap()
}

fn pinode(arguments: &[&str], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinode"));
    let command = command.args(arguments).current_dir(folder);
    command.output().unwrap()
}

fn json(arguments: &[&str], folder: &Path) -> Value {
    let output = pinode(arguments, folder);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{words}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// x after 1 s from rest.
fn way(model: &Model) -> f64 {
    let t = [0.0, 1.0];
    let states = simulate(model, "0", &t, &[vec![0.0; 2]], &[0.0, 0.0], LONGEST_STEP).unwrap();
    states[1][0]
}

#[test]
fn a_sledge_under_an_ensemble_goes_as_under_the_mean_force_and_its_members_as_under_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let model = sledge(folder.path());
    assert!(model.has_ensemble());
    // ½ F/m t²: 2 N, and 1 N and 3 N.
    assert!((way(&model) - 0.5).abs() < 1e-9);
    let members: Vec<f64> = model.members().iter().map(way).collect();
    assert!((members[0] - 0.25).abs() < 1e-9 && (members[1] - 0.75).abs() < 1e-9);
    assert!(!model.members()[0].has_ensemble());
}

#[test]
fn a_revised_model_keeps_all_members() {
    let folder = tempfile::tempdir().unwrap();
    let model = sledge(folder.path());
    let out = folder.path().join("revised");
    let path = model.write_revision(&out, "model.toml", &Revision::of(&model));
    let revised = Model::load(&path.unwrap()).unwrap();
    let names: Vec<&str> = revised
        .networks
        .iter()
        .map(|n| n.weights.as_str())
        .collect();
    assert_eq!(names, ["weak.safetensors", "strong.safetensors"]);
    assert!((way(&revised) - way(&model)).abs() < 1e-15);
}

#[test]
fn simulate_tells_how_far_the_members_are_apart_at_every_sample() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    sledge(folder);
    let simulate = [
        "simulate",
        "sledge.toml",
        "--duration",
        "2",
        "--out",
        "way.csv",
    ];
    let banded = [&simulate[..], &["--band", "band.csv", "--json"]].concat();
    let report = json(&banded, folder);
    let band = &report["band"];
    assert_eq!(
        (&band["members"], &band["left_out"]),
        (&2.into(), &0.into())
    );
    // The accelerations are 0.5 and 1.5 m/s², their standard deviation √½: of x at the end √½ ½ (2 s)².
    let largest = band["standard_deviations"][0]["largest"].as_f64().unwrap();
    assert!((largest - 0.5_f64.sqrt() * 2.0).abs() < 1e-9, "{band}");
    let text = std::fs::read_to_string(folder.join("band.csv")).unwrap();
    let rows: Vec<&str> = text.lines().collect();
    assert_eq!((rows[0], rows.len()), ("t,q.x,v.x", 202));
    let numbers: Vec<f64> = rows[101].split(',').map(|x| x.parse().unwrap()).collect();
    let expected = [1.0, 0.5_f64.sqrt() * 0.5, 0.5_f64.sqrt()];
    assert!(
        numbers
            .iter()
            .zip(expected)
            .all(|(a, b)| (a - b).abs() < 1e-9)
    );

    std::fs::write(folder.join("bare.toml"), SLEDGE).unwrap();
    let bare = [
        "simulate",
        "bare.toml",
        "--out",
        "way.csv",
        "--band",
        "band.csv",
    ];
    let refused = pinode(&bare, folder);
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        words.contains("bare.toml has no ensemble, and a band needs one"),
        "{words}"
    );
}

#[test]
fn evaluate_has_the_spread_of_windows_that_start_together() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    sledge(folder);
    let mut log = "t,q.x,u.push\n".to_owned();
    for k in 0..=100 {
        let t = 0.01 * f64::from(k);
        log += &format!("{t},{},0\n", 0.5 * t * t);
    }
    std::fs::write(folder.join("log.csv"), log).unwrap();
    let arguments = [
        "evaluate",
        "sledge.toml",
        "log.csv",
        "--horizon",
        "0.2",
        "--json",
    ];
    let report = json(&arguments, folder);
    // In every window √½ ½ t² over t = 0.01 … 0.2 s.
    let squares = (1..=20).map(|k| (0.5_f64.sqrt() * 0.5 * (0.01 * f64::from(k)).powi(2)).powi(2));
    let expected = (squares.sum::<f64>() / 20.0).sqrt();
    let spread = report["coordinates"][0]["spread"].as_f64().unwrap();
    assert!((spread - expected).abs() < 1e-9, "{spread} for {expected}");
}

#[test]
fn members_that_are_no_ensemble_are_faults_of_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    sledge(folder);
    for (list, expected) in [
        (
            r#"["weak.safetensors", "weak.safetensors"]"#,
            "`weak.safetensors` is there twice",
        ),
        ("[]", "`weights` is an empty list"),
        (
            r#"["weak.safetensors", "none.safetensors"]"#,
            "none.safetensors",
        ),
    ] {
        let whole = r#"["weak.safetensors", "strong.safetensors"]"#;
        let text = format!("{SLEDGE}{ENSEMBLE}").replace(whole, list);
        let error = Model::parse(&folder.join("model.toml"), text)
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// A log of m v̇ = u − 1.5 v.
fn dragged() -> String {
    let mut text = "t,q.x,u.push\n".to_owned();
    let (mut x, mut v, mut u) = (0.0, 0.0, 0.0);
    for k in 0..800 {
        if k % 20 == 0 {
            u = 4.0 * (0.37 * f64::from(k)).sin();
        }
        text += &format!("{},{x},{u}\n", 0.02 * f64::from(k));
        for _ in 0..20 {
            v += 0.001 * (u - 1.5 * v) / 2.0;
            x += 0.001 * v;
        }
    }
    text
}

#[test]
fn members_are_trained_from_seeds_that_follow_each_other_and_the_first_is_the_network_of_the_seed()
{
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("bare.toml"), SLEDGE).unwrap();
    std::fs::write(folder.join("log.csv"), dragged()).unwrap();
    let train = "train bare.toml log.csv --joint x --sees v.x --units 8 --epochs 3 --keep-physics --json --seed";
    let train: Vec<&str> = train.split(' ').collect();
    let report = json(
        &[&train[..], &["4", "--members", "2", "--out", "two"]].concat(),
        folder,
    );
    let members = report["members"].as_array().unwrap();
    assert_eq!(members.len(), 2);
    json(&[&train[..], &["4", "--out", "first"]].concat(), folder);
    json(&[&train[..], &["5", "--out", "second"]].concat(), folder);
    let bytes = |path: &str| std::fs::read(folder.join(path)).unwrap();
    assert!(bytes("two/network-1.safetensors") == bytes("first/network.safetensors"));
    assert!(bytes("two/network-2.safetensors") == bytes("second/network.safetensors"));
    assert!(folder.join("two/metrics-2.jsonl").exists());
    assert!(!folder.join("two/checkpoint-1.safetensors").exists());

    let model = Model::load(&folder.join("two/model.toml")).unwrap();
    assert_eq!(model.members().len(), 2);
    let report = json(
        &["export", "two/model.toml", "--out", "two", "--json"],
        folder,
    );
    let files = report["networks"].as_array().unwrap();
    assert_eq!(files[1]["file"], "two/network-2.onnx");
    assert_eq!(files[1]["share"], 0.5);
}

#[test]
fn a_simulation_writes_over_no_weights_and_both_its_files_or_none() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    sledge(folder);
    let weights = std::fs::read(folder.join("weak.safetensors")).unwrap();
    let cases: [(&[&str], &str); 4] = [
        (&["--out", "weak.safetensors"], "is an input"),
        (
            &["--out", "a.csv", "--band", "weak.safetensors"],
            "is an input",
        ),
        (&["--out", "a.csv", "--band", "a.csv"], "two results"),
        (&["--out", "a.csv", "--band", "nowhere/b.csv"], "nowhere"),
    ];
    for (arguments, expected) in cases {
        let all = [&["simulate", "sledge.toml", "--duration", "1"], arguments].concat();
        let output = pinode(&all, folder);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{words}");
        assert!(words.contains(expected), "{words}");
        assert!(!folder.join("a.csv").exists(), "{arguments:?}");
    }
    assert!(weights == std::fs::read(folder.join("weak.safetensors")).unwrap());
}

#[test]
fn check_shows_what_a_network_acts_on_and_sees() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    sledge(folder);
    let report = json(&["check", "sledge.toml", "--json"], folder);
    let expected = serde_json::json!([{
        "weights": ["weak.safetensors", "strong.safetensors"],
        "joints": ["x"],
        "sees": ["v.x"],
        "parameters": 2,
        "precision": "f64",
        "alone": false,
    }]);
    assert_eq!(report["networks"], expected);
    let text = String::from_utf8(pinode(&["check", "sledge.toml"], folder).stdout).unwrap();
    let line = "on x: the mean of 2, each of 2 parameters (f64), sees v.x, from weak.safetensors, strong.safetensors";
    assert!(text.contains(line), "{text}");
}
