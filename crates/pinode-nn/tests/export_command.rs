//! `pinode export` as its users see it: an ONNX file a network, and what stands in its columns.
#![cfg(feature = "cli")]

use std::path::{Path, PathBuf};
use std::process::Command;

use pinode_nn::learnt::{Card, Feature, LearntForce, Names, Quantity, weights};
use pinode_nn::model::Model;
use pinode_nn::network::{Activation, Mlp, Shape};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::program::pinode;

const MODEL: &str = r#"
name = "crane"

[lagrangian]
coordinates = ["trolley", "rope"]
angles = ["rope"]
kinetic = "0.5*3*trolley_dot^2 + trolley_dot*rope_dot*cos(rope) + 0.5*rope_dot^2"
potential = "-9.81*cos(rope)"

[[input]]
name = "motor"
joint = "trolley"
"#;

/// A crane with a network of 5-50-50-50-2 in `folder`, and one of the same name in another folder beside it.
fn crane(folder: &Path, single: bool) {
    let bare = Model::parse(&folder.join("bare.toml"), MODEL).unwrap();
    let names = Names {
        coordinates: bare.mechanics.coordinates(),
        inputs: &["motor"],
    };
    let feature = |(quantity, offset, width, range)| Feature {
        quantity,
        offset,
        width,
        range,
    };
    let features: Vec<Feature> = [
        (Quantity::Cosine(1), 0.0, 1.0, [-0.2, 1.0]),
        (Quantity::Sine(1), 0.0, 1.0, [-0.9, 1.0]),
        (Quantity::Velocity(0), 0.05, 0.6, [-1.4, 1.7]),
        (Quantity::Velocity(1), -0.1, 2.2, [-6.0, 5.0]),
        (
            Quantity::Input { input: 0, back: 1 },
            0.4,
            12.0,
            [-40.0, 40.0],
        ),
    ]
    .map(feature)
    .to_vec();
    let shape = Shape::new(&[5, 50, 50, 50, 2], Activation::Relu, Activation::Tanh).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let network = match single {
        true => Mlp::<f32>::xavier(shape, &mut rng).convert(),
        false => Mlp::<f64>::xavier(shape, &mut rng),
    };
    let output = |coordinate, scale| pinode_nn::learnt::Output { coordinate, scale };
    let outputs = vec![output(0, 31.0), output(1, 0.7)];
    let force = LearntForce::new(network, features, outputs, true).unwrap();
    let card = Card::of(&force, names);
    std::fs::create_dir_all(folder.join("more")).unwrap();
    let mut text = MODEL.to_owned();
    for file in ["learnt.safetensors", "more/learnt.safetensors"] {
        weights::write(&folder.join(file), &force, &card, single).unwrap();
        text += "\n[[effect]]\nkind = \"neural_network\"\njoints = [\"trolley\", \"rope\"]\n";
        text += &format!("weights = \"{file}\"\n");
    }
    std::fs::write(folder.join("crane.toml"), text).unwrap();
}

fn exported(folder: &Path, more: &[&str]) -> Value {
    let arguments = [&["export", "crane.toml", "--out", "onnx", "--json"], more].concat();
    let output = pinode(&arguments, folder);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn every_network_becomes_a_file_whose_columns_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    crane(folder, true);
    let report = exported(folder, &[]);
    let networks = report["networks"].as_array().unwrap();
    let files: Vec<&str> = networks
        .iter()
        .map(|n| n["file"].as_str().unwrap())
        .collect();
    assert_eq!(files, ["onnx/learnt.onnx", "onnx/learnt-2.onnx"]);
    for network in networks {
        assert!(folder.join(network["file"].as_str().unwrap()).exists());
        assert_eq!(network["precision"], "f32");
        let columns = network["input"]["columns"].as_array().unwrap();
        let told: Vec<(&str, &str)> = columns
            .iter()
            .map(|c| (c["name"].as_str().unwrap(), c["unit"].as_str().unwrap()))
            .collect();
        let expected = [
            ("cos(q.rope)", "1"),
            ("sin(q.rope)", "1"),
            ("v.trolley", "m/s"),
            ("v.rope", "rad/s"),
            ("u.motor[-1]", "N"),
        ];
        assert_eq!(told, expected);
        assert_eq!(network["output"]["columns"][1]["unit"], "N·m");
        assert_eq!(network["alone"], true);
    }
    assert_eq!(
        exported(folder, &["--precision", "f64"])["networks"][0]["precision"],
        "f64"
    );
    let text = pinode(&["export", "crane.toml", "--out", "onnx"], folder).stdout;
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("v.rope [rad/s], velocity of rope"), "{text}");
}

#[test]
fn a_model_without_a_network_is_told_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("crane.toml"), MODEL).unwrap();
    let output = pinode(&["export", "crane.toml", "--out", "onnx"], folder);
    assert_eq!(output.status.code(), Some(1));
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        words.contains("crane.toml has no network to export: learn one by `pinode train`"),
        "{words}"
    );
    assert!(!folder.join("onnx").exists());
}

/// A Python that has onnx and onnxruntime: of `PINODE_ONNX_PYTHON`, or `python3`.
fn python() -> Option<String> {
    let candidates = [
        std::env::var("PINODE_ONNX_PYTHON").ok(),
        Some("python3".to_owned()),
    ];
    candidates.into_iter().flatten().find(|python| {
        let mut command = Command::new(python);
        let run = command
            .args(["-c", "import numpy, onnx, onnxruntime"])
            .output();
        run.is_ok_and(|output| output.status.success())
    })
}

#[test]
fn onnxruntime_computes_the_same_forces() {
    let Some(python) = python() else {
        eprintln!(
            "SKIPPED: no Python with onnx, onnxruntime and numpy; name one by PINODE_ONNX_PYTHON"
        );
        return;
    };
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("benches/peers/onnx_check.py");
    for single in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        crane(folder, single);
        exported(folder, &[]);
        let output = Command::new(&python)
            .arg(&script)
            .args(["learnt.safetensors", "onnx/learnt.onnx"])
            .current_dir(folder)
            .output()
            .unwrap();
        let words = String::from_utf8_lossy(&output.stdout).into_owned();
        println!("{words}");
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{words}{errors}");
    }
}
