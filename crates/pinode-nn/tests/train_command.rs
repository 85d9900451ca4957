//! `pinode train` as its users see it: a force that no effect in the library has is learnt from a log, and what was learnt is a model.
#![cfg(feature = "cli")]

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use pinode_nn::model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde_json::Value;

use crate::program::pinode;

/// kg.
const MASS: f64 = 2.0;
/// Standard deviation of the measured position, m.
const NOISE: f64 = 1e-3;

const MODEL: &str = include_str!("data/known_sledge.toml");

/// The force that the model lacks, N at v m/s. It falls everywhere: where it rose, motions would leave so fast that no log tells it.
fn missing(v: f64) -> f64 {
    -1.5 * v - 0.6 * (2.0 * v).sin()
}

/// A log of m v̇ = u + missing(v) with u held over every sample of 0.02 s, by steps of 0.5 ms.
fn log(seed: u64, duration: f64) -> String {
    let (h, parts) = (0.02, 40);
    let dt = h / f64::from(parts);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut x, mut v, mut u) = (0.0, 0.0, 0.0);
    let mut text = "t,q.x,u.push\n".to_owned();
    for k in 0..(duration / h) as usize {
        if k % 20 == 0 {
            // A new push every 0.4 s, towards the middle where the sledge has gone far.
            u = rng.random_range(-6.0..6.0) - 1.0 * x;
        }
        let noise: f64 = rng.sample(StandardNormal);
        text += &format!("{},{},{u}\n", h * k as f64, x + NOISE * noise);
        for _ in 0..parts {
            let rate = |v: f64| (u + missing(v)) / MASS;
            let middle = v + 0.5 * dt * rate(v);
            x += dt * middle;
            v += dt * rate(middle);
        }
    }
    text
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("sledge.toml"), MODEL).unwrap();
    std::fs::write(folder.path().join("log.csv"), log(1, 60.0)).unwrap();
    folder
}

const TRAIN: &[&str] = &[
    "train",
    "sledge.toml",
    "log.csv",
    "--joint",
    "x",
    "--sees",
    "v.x",
    "--units",
    "32,32",
    "--activation",
    "tanh",
    "--rate",
    "0.005",
];

fn rmse(folder: &Path, model: &str) -> f64 {
    let arguments = [
        "evaluate",
        model,
        "fresh.csv",
        "--initial",
        "estimated",
        "--json",
    ];
    let output = pinode(&arguments, folder);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    json["coordinates"][0]["rmse"].as_f64().unwrap()
}

#[test]
fn a_force_that_no_effect_has_is_learnt_and_the_gap_shrinks_on_a_fresh_log() {
    let folder = folder();
    let folder = folder.path();
    let arguments = [TRAIN, &["--epochs", "150", "--out", "out", "--json"]].concat();
    let output = pinode(&arguments, folder);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |key: &str| report[key].as_f64().unwrap();
    // In units of the noise: 0.9 of the true force, whose starts are fitted to two of the 21 numbers of each window.
    assert!(number("held_out") < 1.3, "{report}");
    assert!(
        number("held_out_without_network") > 10.0 * number("held_out"),
        "{report}"
    );
    assert_eq!(report["network"]["features"][0]["name"], "v.x");

    std::fs::write(folder.join("fresh.csv"), log(2, 20.0)).unwrap();
    let (before, after) = (rmse(folder, "sledge.toml"), rmse(folder, "out/model.toml"));
    // What is left is of the starts: 60 ms of positions to 1 mm tell a velocity to 2 cm/s.
    assert!(after < 0.25 * before, "{after} after {before}");

    // The force itself, where nine tenths of the log are.
    let model = Model::load(&folder.join("out/model.toml")).unwrap();
    let [network] = model.networks.as_slice() else {
        panic!("one network is expected")
    };
    let [feature] = network.force.features() else {
        panic!("one feature is expected")
    };
    let [low, high] = feature.range;
    assert!(low < -1.5 && high > 1.5, "{low} {high}");
    for k in -8..=8 {
        let z = 0.2 * f64::from(k);
        let v = feature.offset + feature.width * z;
        let found = network.force.outputs()[0].scale * network.force.network().evaluate(&[z])[0];
        assert!(
            (found - missing(v)).abs() < 0.25,
            "{found} for {} at {v} m/s",
            missing(v)
        );
    }
    // One line of metrics an epoch, and nothing left of the checkpoint.
    let metrics = std::fs::read_to_string(folder.join("out/metrics.jsonl")).unwrap();
    assert_eq!(
        metrics.lines().count() as u64,
        report["epochs"].as_u64().unwrap()
    );
    assert!(!folder.join("out/checkpoint.safetensors").exists());
}

/// Waits until the training has made its first checkpoint, then kills it.
fn kill_after_a_checkpoint(mut child: Child, checkpoint: &Path) {
    let began = Instant::now();
    while !checkpoint.exists() && began.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_killed_training_resumes_to_the_same_bits_on_any_number_of_threads() {
    let folder = folder();
    let folder = folder.path();
    // A constant that is fitted beside the network is a part of what is resumed.
    let friction = "[[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 0.5\n";
    std::fs::write(folder.join("sledge.toml"), MODEL.to_owned() + friction).unwrap();
    let train = |more: &[&str]| {
        let output = pinode(
            &[TRAIN, &["--epochs", "6", "--quiet"], more].concat(),
            folder,
        );
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
    };
    let weights = |out: &str| std::fs::read(folder.join(out).join("network.safetensors")).unwrap();
    train(&["--out", "whole", "--threads", "1"]);
    train(&["--out", "threads", "--threads", "3"]);
    assert!(weights("whole") == weights("threads"));

    let child = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(TRAIN)
        .args(["--epochs", "6", "--quiet", "--out", "killed"])
        .current_dir(folder)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let checkpoint = folder.join("killed/checkpoint.safetensors");
    kill_after_a_checkpoint(child, &checkpoint);
    assert!(checkpoint.exists());
    // Another training does not go on from it.
    let other = [TRAIN, &["--epochs", "7", "--out", "killed", "--resume"]].concat();
    let refused = pinode(&other, folder);
    assert_eq!(refused.status.code(), Some(1));
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(words.contains("of another training"), "{words}");
    // Nor does any from a file that is damaged.
    let bytes = std::fs::read(&checkpoint).unwrap();
    let mut with_another = bytes.clone();
    with_another[bytes.len() - 8] ^= 1;
    for (damaged, expected) in [
        (&bytes[..bytes.len() / 2], "is damaged"),
        (with_another.as_slice(), "are not those that were written"),
    ] {
        std::fs::write(&checkpoint, damaged).unwrap();
        let arguments = [TRAIN, &["--epochs", "6", "--out", "killed", "--resume"]].concat();
        let refused = pinode(&arguments, folder);
        assert_eq!(refused.status.code(), Some(1));
        let words = String::from_utf8_lossy(&refused.stderr).into_owned();
        let said = words.contains(expected) && !words.contains("another training");
        assert!(said, "{words}");
    }
    std::fs::write(&checkpoint, &bytes).unwrap();
    train(&["--out", "killed", "--resume"]);
    assert!(weights("whole") == weights("killed"));
    let model = |out: &str| std::fs::read(folder.join(out).join("model.toml")).unwrap();
    assert!(model("whole") == model("killed"));

    // What is finished is not begun again over what it left.
    let arguments = [TRAIN, &["--epochs", "2", "--out", "killed", "--resume"]].concat();
    let refused = pinode(&arguments, folder);
    assert_eq!(refused.status.code(), Some(1));
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(words.contains("there is nothing to resume"), "{words}");
    assert!(weights("whole") == weights("killed"));
}

#[test]
fn what_networks_are_compared_with_are_models_too() {
    let folder = folder();
    let folder = folder.path();
    let short = ["--units", "8", "--epochs", "3"];
    for (baseline, more) in [("ode", &[][..]), ("black-box", &short)] {
        let common = ["train", "sledge.toml", "log.csv", "--json"];
        let own = ["--baseline", baseline, "--out", baseline];
        let output = pinode(&[&common[..], &own, more].concat(), folder);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{words}");
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        let [loss, held_out] = ["loss", "held_out"].map(|key| report[key].as_f64().unwrap());
        let model = Model::load(&folder.join(baseline).join("model.toml")).unwrap();
        let network = baseline != "ode";
        assert_eq!(!model.networks.is_empty(), network);
        // The black box does not know the mass.
        assert_eq!(model.mechanics.parameters().is_empty(), network);
        match model.networks.first() {
            Some(entry) => assert!(entry.force.is_alone()),
            // Nothing in the model brakes the sledge: far from the noise.
            None => assert!(loss > 5.0 && held_out > 5.0, "{report}"),
        }
    }
}

/// The sledge is braked by a force that follows its velocity alone.
#[test]
fn what_a_network_has_learnt_is_told_and_kept_with_its_weights() {
    let folder = folder();
    let folder = folder.path();
    let more = ["--epochs", "30", "--out", "out", "--json"];
    let output = pinode(&[TRAIN, &more].concat(), folder);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let law = &report["network"]["training"]["laws"][0];
    let signal = &law["signals"][0];
    assert_eq!((&law["joint"], &law["unit"]), (&"x".into(), &"N".into()));
    assert_eq!(
        (&signal["name"], &signal["unit"]),
        (&"v.x".into(), &"m/s".into())
    );
    assert!(signal["share"].as_f64().unwrap() > 0.9, "{law}");
    assert!(signal["odd_share"].as_f64().unwrap() > 0.9, "{law}");
    let model = Model::load(&folder.join("out/model.toml")).unwrap();
    assert_eq!(model.networks[0].card.training["laws"][0], *law);
}

/// The baseline took them, and did nothing with them.
#[test]
fn a_model_alone_takes_no_options_of_a_network() {
    let folder = folder();
    let common = ["train", "sledge.toml", "log.csv", "--out", "out"];
    let more = ["--baseline", "ode", "--members", "3", "--sees", "v.x"];
    let output = pinode(&[&common[..], &more].concat(), folder.path());
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{words}");
    assert!(words.contains("leave out --members, --sees"), "{words}");
    // A network needs a joint.
    let output = pinode(&common, folder.path());
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn what_cannot_be_trained_is_said_before_the_work() {
    let folder = folder();
    let folder = folder.path();
    // Of options that are wrong by themselves or for the model, and of work that cannot be done.
    const USAGE: i32 = 2;
    const FAILURE: i32 = 1;
    let usage: &[(&[&str], &str)] = &[
        (&["--joint", "y"], "unknown joint `y`"),
        (&["--joint", "x", "x"], "given twice"),
        (&["--joint", "y", "x", "x"], "2 problems in --joint"),
        (&["--joint", "x", "--sees", "v.y"], "cannot see `v.y`"),
        (&["--joint", "x", "--units", "0"], "0 is not in 1.."),
    ];
    let failures: &[(&[&str], &str)] = &[
        (
            &["--joint", "x", "--sees", "v.x", "--sees", "v.x"],
            "to see v.x twice",
        ),
        (&["--joint", "x", "--horizon", "80"], "no window of 80 s"),
        (&["--joint", "x", "--rate", "0"], "learning rate is 0"),
        (
            &["--joint", "x", "--step", "1e-300"],
            "give a longer --step",
        ),
        (&["--joint", "x", "--step", "1e-9"], "2e7 steps in a sample"),
        (
            &["--joint", "x", "--units", "100000000,100000"],
            "layer of 100000000 units is too large",
        ),
        (
            &["--joint", "x", "--units", "4096,4096"],
            "10000000 at most",
        ),
        (
            &[
                "--joint",
                "x",
                "--units",
                "4096",
                "--horizon",
                "2",
                "--step",
                "1e-3",
            ],
            "GB of memory",
        ),
    ];
    let usage = usage.iter().map(|case| (USAGE, case));
    let failures = failures.iter().map(|case| (FAILURE, case));
    for (code, (arguments, expected)) in usage.chain(failures) {
        let all = [
            &["train", "sledge.toml", "log.csv", "--out", "out"],
            *arguments,
        ]
        .concat();
        let output = pinode(&all, folder);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{words}");
        assert!(words.contains(expected), "{words} for {expected}");
        // Nor an empty folder.
        assert!(!folder.join("out").exists());
    }
}

/// A sledge with a network that a short training has left in `first`, there under the name `a.toml`.
fn trained_before(folder: &Path) {
    let more = ["--epochs", "1", "--quiet", "--out", "first"];
    let output = pinode(&[TRAIN, &more].concat(), folder);
    assert!(output.status.success());
    std::fs::rename(folder.join("first/model.toml"), folder.join("first/a.toml")).unwrap();
}

/// The training wrote the new weights over those that its own model uses; a log at `OUT/metrics.jsonl` was lost as well.
#[test]
fn a_training_does_not_write_over_what_it_reads() {
    let folder = folder();
    let folder = folder.path();
    trained_before(folder);
    let weights = folder.join("first/network.safetensors");
    let before = std::fs::read(&weights).unwrap();
    let refused = |arguments: &[&str], name: &str| {
        let output = pinode(arguments, folder);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{words}");
        let said = words.contains(name) && words.contains("is an input that was read");
        assert!(said, "{words}");
    };
    let again = ["--joint", "x", "--baseline", "black-box", "--epochs", "1"];
    let over = ["train", "first/a.toml", "log.csv", "--out", "first"];
    refused(&[&over[..], &again].concat(), "network.safetensors");
    assert!(before == std::fs::read(&weights).unwrap());

    let log = folder.join("first/metrics.jsonl");
    std::fs::copy(folder.join("log.csv"), &log).unwrap();
    let own = [
        "train",
        "sledge.toml",
        "first/metrics.jsonl",
        "--joint",
        "x",
    ];
    refused(&[&own[..], &["--out", "first"]].concat(), "metrics.jsonl");
    assert!(std::fs::read(&log).unwrap() == std::fs::read(folder.join("log.csv")).unwrap());
}

/// Room for all of the batch that was asked for was taken before anything else.
#[test]
fn a_batch_of_more_windows_than_there_are_is_one_of_all() {
    let folder = folder();
    let folder = folder.path();
    let more = ["--epochs", "1", "--quiet", "--out", "out"];
    let batch = ["--batch", "1000000000000"];
    let output = pinode(&[TRAIN, &more, &batch].concat(), folder);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{words}");
}

/// What a program says that Ctrl-C ends.
#[cfg(unix)]
fn interrupted(child: Child) -> String {
    let mut interrupt = Command::new("kill");
    let sent = interrupt.args(["-INT", &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
    let output = child.wait_with_output().unwrap();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(130), "{words}");
    words
}

#[cfg(unix)]
#[test]
fn an_interruption_of_a_later_member_tells_how_to_go_on_and_leaves_no_half_written_file() {
    let folder = folder();
    let folder = folder.path();
    let child = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(TRAIN)
        .args(["--members", "2", "--epochs", "20", "--out", "out"])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let first = folder.join("out/metrics-1.jsonl");
    let epochs = || std::fs::read_to_string(&first).map_or(0, |text| text.lines().count());
    let began = Instant::now();
    while epochs() < 20 && began.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(1));
    }
    // The second member has just begun.
    std::thread::sleep(Duration::from_millis(20));
    let words = interrupted(child);
    assert!(
        words.contains("the same command with --resume goes on"),
        "{words}"
    );
    for entry in std::fs::read_dir(folder.join("out")).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        let known = name.starts_with("checkpoint-") || name.starts_with("metrics-");
        assert!(known, "{name}");
    }
}

/// An empty folder stayed behind.
#[cfg(unix)]
#[test]
fn an_interruption_before_the_first_epoch_leaves_nothing() {
    let folder = folder();
    let folder = folder.path();
    let child = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(TRAIN.iter().map(|&argument| match argument {
            "32,32" => "3000,3000", // an epoch takes far longer than the test
            _ => argument,
        }))
        .args(["--out", "new/out"])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !folder.join("new/out").exists() && began.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(1));
    }
    // The training has just begun.
    std::thread::sleep(Duration::from_millis(200));
    let words = interrupted(child);
    assert!(words.contains("before the first epoch ended"), "{words}");
    assert!(!folder.join("new").exists());
}
