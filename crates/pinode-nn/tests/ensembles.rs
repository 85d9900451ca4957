//! An ensemble of networks: the force is the mean of its members, and how far their roll-outs are apart is told.
#![cfg(feature = "cli")]

use std::path::Path;

use pinode_nn::free_run::{LONGEST_STEP, simulate};
use pinode_nn::learnt::{Card, Feature, LearntForce, Names, Quantity, weights};
use pinode_nn::model::{Model, Revision};
use pinode_nn::network::{Activation, Mlp, Shape};
use serde_json::Value;

use crate::program::pinode;

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

/// A log of m v̇ = u − 1.5 v − 2 v |v|, 2 kg, whose position is read with 1 mm of noise.
fn dragged_with_noise(seed: u64, samples: u32) -> String {
    let mut state = seed;
    let mut uniform = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut text = "t,q.x,u.push\n".to_owned();
    let (mut x, mut v, mut u) = (0.0, 0.0, 0.0);
    for k in 0..samples {
        if k % 25 == 0 {
            u = 12.0 * (uniform() - 0.5) - 2.0 * x;
        }
        let noise = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        text += &format!("{},{},{u}\n", 0.02 * f64::from(k), x + 1e-3 * noise);
        for _ in 0..20 {
            v += 0.001 * (u - 1.5 * v - 2.0 * v * v.abs()) / 2.0;
            x += 0.001 * v;
        }
    }
    text
}

/// The promise of a band is kept on a recording that neither training nor calibration has seen.
#[test]
fn the_band_of_a_trained_ensemble_holds_what_is_measured_anew() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("bare.toml"), SLEDGE).unwrap();
    for (name, seed, samples) in [("log", 1, 2000), ("held", 2, 2000), ("fresh", 3, 4000)] {
        let text = dragged_with_noise(seed, samples);
        std::fs::write(folder.join(format!("{name}.csv")), text).unwrap();
    }
    let train = "train bare.toml log.csv --holdout held.csv --joint x --sees v.x --units 8 --epochs 15 --keep-physics --members 3 --out out --json";
    let report = json(&train.split(' ').collect::<Vec<_>>(), folder);
    let band = &report["band"];
    assert_eq!(band["coverage"], 0.95);
    assert_eq!(band["horizon_s"], 0.6);
    assert_eq!(band["signals"][0]["name"], "q.x");
    // 2000 samples of 31 each; the first stretch before a window tells of no state.
    let windows = band["windows"].as_u64().unwrap();
    assert!((60..=65).contains(&windows), "{band}");
    // As wide as the noise alone, at least: 1.96 times the 1 mm.
    assert!(
        band["signals"][0]["floor"].as_f64().unwrap() > 1.5e-3,
        "{band}"
    );

    let evaluate = "evaluate out/model.toml fresh.csv --initial past --json";
    let report = json(&evaluate.split(' ').collect::<Vec<_>>(), folder);
    let within = report["coordinates"][0]["within_band"].as_f64().unwrap();
    assert!((0.92..0.985).contains(&within), "{within}");

    let simulate =
        "simulate out/model.toml --duration 0.5 --initial 0,1 --out way.csv --band band.csv --json";
    let report = json(&simulate.split(' ').collect::<Vec<_>>(), folder);
    assert_eq!(report["band"]["coverage"], 0.95);
    let text = std::fs::read_to_string(folder.join("band.csv")).unwrap();
    assert_eq!(text.lines().next(), Some("t,q.x,v.x,half.q.x"));
    let model = Model::load(&folder.join("out/model.toml")).unwrap();
    let width = model.band.as_ref().unwrap().signals[0];
    let mut last = 0.0;
    for line in text.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        assert_eq!(row[3], width.half(row[1], row[0]));
        assert!(row[3] >= last);
        last = row[3];
    }
    let longer = "simulate out/model.toml --duration 2 --initial 0,1 --out way.csv --json";
    let report = json(&longer.split(' ').collect::<Vec<_>>(), folder);
    let warnings = report["warnings"].to_string();
    assert!(
        warnings.contains("the band was tried for 0.6"),
        "{warnings}"
    );
}

/// The sledge with an ensemble and a band.
const BAND: &str = r#"
[band]
horizon = 0.6
windows = 31
[band.q]
x = { spread = 2.5, floor = 1.0e-3, growth = 0.02 }
"#;

#[test]
fn a_band_goes_with_the_model_that_it_was_found_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    sledge(folder);
    let path = folder.join("banded.toml");
    std::fs::write(&path, format!("{SLEDGE}{ENSEMBLE}{BAND}")).unwrap();
    let model = Model::load(&path).unwrap();
    let width = model.band.as_ref().unwrap().signals[0];
    assert_eq!((width.spread, width.floor, width.growth), (2.5, 1e-3, 0.02));

    let out = folder.join("out");
    let same = Revision::of(&model);
    let same = model.write_revision(&out, "same.toml", &same).unwrap();
    assert_eq!(Model::load(&same).unwrap().band, model.band);
    let heavier = Revision {
        parameter_values: vec![2.1],
        ..Revision::of(&model)
    };
    let heavier = model
        .write_revision(&out, "heavier.toml", &heavier)
        .unwrap();
    assert_eq!(Model::load(&heavier).unwrap().band, None);
    // A new band is written as it is, to the last digit.
    let mut band = model.band.clone().unwrap();
    band.signals[0].velocity = true;
    band.signals[0].growth = 0.1 + 0.2;
    let revision = Revision {
        band: Some(band.clone()),
        parameter_values: vec![2.1],
        ..Revision::of(&model)
    };
    let anew = model.write_revision(&out, "anew.toml", &revision).unwrap();
    assert_eq!(Model::load(&anew).unwrap().band, Some(band));
}

#[test]
fn what_is_wrong_with_a_band_is_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    sledge(folder);
    let wrong = BAND
        .replace("horizon = 0.6\n", "")
        .replace("windows = 31", "windows = 2.5")
        .replace("spread = 2.5", "spread = -1")
        .replace("x = {", "y = {");
    let faults = |text: String| {
        let error = Model::parse(&folder.join("model.toml"), text).unwrap_err();
        error.to_string()
    };
    let all = faults(format!("{SLEDGE}{ENSEMBLE}{wrong}"));
    for expected in [
        "[band] has no `horizon`",
        "`windows` is 2.5: it must be a whole number",
        "`spread` is -1: it must be 0 or positive",
        "`y`",
    ] {
        assert!(all.contains(expected), "{expected} in {all}");
    }
    let without = faults(format!("{SLEDGE}{BAND}"));
    assert!(without.contains("this model has none"), "{without}");
}
