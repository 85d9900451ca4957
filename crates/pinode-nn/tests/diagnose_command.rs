//! `pinode diagnose` as its users see it: streams, exit codes, files, and the name of a friction that was put into the log.
#![cfg(feature = "cli")]

use std::path::Path;
use std::process::{Command, Output};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde_json::Value;

/// Mass of the model and of the truth, kg.
const MASS: f64 = 2.0;
/// Friction that the model lacks, N·s/m.
const FRICTION: f64 = 1.5;
/// Standard deviation of the measured position, m.
const NOISE: f64 = 1e-3;

const MODEL: &str = include_str!("data/known_sledge.toml");

/// A log of m ẍ + c ẋ = u with u held over every sample of 0.02 s. There the solution is exact: with w = u/c and a = c/m,
/// ẋ = w + (ẋ₀ − w) e^{−a t} and x = x₀ + w t + (ẋ₀ − w) (1 − e^{−a t})/a.
fn log(duration: f64) -> String {
    let h = 0.02;
    let a = FRICTION / MASS;
    let decay = (-a * h).exp();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut x, mut v, mut u) = (0.0, 0.0, 0.0);
    let mut text = "t,q.x,u.push\n".to_owned();
    for k in 0..(duration / h) as usize {
        if k % 20 == 0 {
            // A new push every 0.4 s, towards the middle where the sledge has gone far.
            u = rng.random_range(-8.0..8.0) - 2.0 * x;
        }
        let noise: f64 = rng.sample(StandardNormal);
        text += &format!("{},{},{u}\n", h * k as f64, x + NOISE * noise);
        let w = u / FRICTION;
        x += w * h + (v - w) * (1.0 - decay) / a;
        v = w + (v - w) * decay;
    }
    text
}

/// A folder with the model and a log of `duration` seconds.
fn folder(duration: f64) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("sledge.toml"), MODEL).unwrap();
    std::fs::write(dir.path().join("log.csv"), log(duration)).unwrap();
    dir
}

/// Runs `pinode` in `dir`.
fn pinode(dir: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pinode"))
        .current_dir(dir)
        .args(arguments)
        .output()
        .unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn wrong_usage_ends_with_2() {
    let dir = folder(1.0);
    for usage in [
        &["diagnose"][..],
        &["diagnose", "sledge.toml", "--out", "out"],
        &["diagnose", "sledge.toml", "log.csv"],
        &[
            "diagnose",
            "sledge.toml",
            "log.csv",
            "--out",
            "out",
            "--seed",
            "x",
        ],
        &[
            "diagnose",
            "sledge.toml",
            "log.csv",
            "--out",
            "out",
            "--no-such",
        ],
    ] {
        let output = pinode(dir.path(), usage);
        assert_eq!(output.status.code(), Some(2), "{usage:?}");
        assert!(output.stdout.is_empty() && !output.stderr.is_empty());
    }
}

#[test]
fn a_log_that_is_not_there_is_named() {
    let dir = folder(1.0);
    for logs in [
        &["no-such-log.csv"][..],
        &["log.csv", "--holdout", "no-such-log.csv"],
    ] {
        let arguments = [&["diagnose", "sledge.toml", "--out", "out"][..], logs].concat();
        let output = pinode(dir.path(), &arguments);
        assert_eq!(output.status.code(), Some(1));
        assert!(output.stdout.is_empty());
        assert!(
            stderr(&output).contains("no-such-log.csv"),
            "{}",
            stderr(&output)
        );
        assert!(!dir.path().join("out").exists());
    }
}

#[test]
fn a_log_that_is_too_short_leaves_nothing_behind() {
    let dir = folder(2.0);
    let arguments = ["diagnose", "sledge.toml", "log.csv", "--out", "new/out"];
    let output = pinode(dir.path(), &arguments);
    assert_eq!(output.status.code(), Some(1));
    assert!(output.stdout.is_empty());
    assert!(
        stderr(&output).contains("give a longer log"),
        "{}",
        stderr(&output)
    );
    assert!(!dir.path().join("new").exists());

    // What was there before stays.
    std::fs::create_dir(dir.path().join("old")).unwrap();
    std::fs::write(dir.path().join("old/diagnosis.json"), "{}").unwrap();
    let arguments = ["diagnose", "sledge.toml", "log.csv", "--out", "old"];
    assert_eq!(pinode(dir.path(), &arguments).status.code(), Some(1));
    let left: Vec<_> = std::fs::read_dir(dir.path().join("old"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    assert_eq!(left, ["diagnosis.json"]);
}

#[test]
fn the_model_that_is_read_is_not_written_over() {
    let dir = folder(30.0);
    std::fs::write(dir.path().join("model.toml"), MODEL).unwrap();
    let output = pinode(
        dir.path(),
        &["diagnose", "model.toml", "log.csv", "--out", "."],
    );
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("is an input that was read"),
        "{}",
        stderr(&output)
    );
    assert_eq!(
        std::fs::read_to_string(dir.path().join("model.toml")).unwrap(),
        MODEL
    );
    assert!(!dir.path().join("report.html").exists());
}

#[test]
fn viscous_friction_is_found_added_and_written_down() {
    let dir = folder(30.0);
    let diagnose = |threads: &str, more: &[&str]| {
        let _ = std::fs::remove_dir_all(dir.path().join("out"));
        let common = [
            "diagnose",
            "sledge.toml",
            "log.csv",
            "--out",
            "out",
            "--seed",
            "5",
        ];
        let output = pinode(
            dir.path(),
            &[&common[..], &["--threads", threads], more].concat(),
        );
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let written = |name: &str| std::fs::read(dir.path().join("out").join(name)).unwrap();
        let files = ["diagnosis.json", "model.toml"].map(written);
        assert!(!written("report.html").is_empty());
        (output, files)
    };
    let (output, files) = diagnose("1", &["--json"]);
    assert_eq!(output.stdout, files[0]);
    assert!(
        stderr(&output).contains("iscous friction on `x` is missing"),
        "{}",
        stderr(&output)
    );
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    has_the_keys_of_the_contract(&document);
    assert_eq!(document["verdict"], "effects_found");
    let effects = document["effects"].as_array().unwrap();
    assert_eq!(effects.len(), 1);
    assert_eq!(effects[0]["kind"], "viscous_friction");
    assert_eq!(effects[0]["target"], "x");
    let coefficient = &effects[0]["parameters"]["coefficient"];
    let (value, std) = (
        coefficient["value"].as_f64().unwrap(),
        coefficient["std"].as_f64().unwrap(),
    );
    assert!(
        (value - FRICTION).abs() < 4.0 * std && std < 0.1 * FRICTION,
        "{value} ± {std}"
    );
    let gap = &document["gap"];
    let number = |key: &str| gap[key].as_f64().unwrap();
    assert!(number("before") > 2.0 * number("after"), "{gap}");
    assert!(number("after") < 1.5, "{gap}");
    // The free runs of the gap are one of the horizons, and a longer one shows more of what was missing.
    let horizons = gap["horizons"].as_array().unwrap();
    let at = |s: f64, key: &str| {
        let horizon = horizons.iter().find(|h| h["horizon_s"] == s).unwrap();
        horizon[key].as_f64().unwrap()
    };
    assert_eq!(at(0.6, "before"), number("before"));
    assert_eq!(at(0.6, "after"), number("after"));
    assert!(at(2.0, "before") > at(0.6, "before") && at(0.6, "before") > at(0.1, "before"));
    for region in gap["regions"].as_array().unwrap() {
        let inside = &region["inside"];
        assert!(
            inside["before"].as_f64() > inside["after"].as_f64(),
            "{region}"
        );
    }

    let check = pinode(dir.path(), &["check", "out/model.toml", "--json"]);
    assert_eq!(check.status.code(), Some(0), "{}", stderr(&check));
    let checked: Value = serde_json::from_slice(&check.stdout).unwrap();
    assert_eq!(checked["effects"][0]["kind"], "viscous_friction");

    // Same seed, same bytes, with any number of threads; text in place of the document.
    let (again, same) = diagnose("2", &[]);
    assert!(same == files);
    let text = String::from_utf8(again.stdout).unwrap();
    for words in [
        "viscous_friction on x, confidence",
        "N·s/m",
        "q.x",
        "out/report.html",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
}

/// Every key that other tools rely on.
fn has_the_keys_of_the_contract(document: &Value) {
    let keys = |value: &Value, keys: &[&str]| {
        for key in keys {
            assert!(value.get(key).is_some(), "no `{key}` in {value}");
        }
    };
    keys(
        document,
        &[
            "verdict",
            "disagreement",
            "effects",
            "gap",
            "data_faults",
            "advice",
        ],
    );
    keys(
        &document["disagreement"][0],
        &["coordinate", "share", "rms", "unit", "where", "when"],
    );
    keys(
        &document["effects"][0],
        &[
            "kind",
            "target",
            "confidence",
            "parameters",
            "alternatives",
            "indistinguishable_from",
        ],
    );
    keys(
        &document["effects"][0]["parameters"]["coefficient"],
        &["value", "std", "unit"],
    );
    let gap = &document["gap"];
    keys(
        gap,
        &["horizon_s", "coordinates", "before", "after", "noise_floor"],
    );
    keys(
        &gap["coordinates"][0],
        &["name", "unit", "before", "after", "noise_floor"],
    );
}

#[test]
fn quiet_leaves_both_streams_empty() {
    let dir = folder(12.0);
    let arguments = [
        "diagnose",
        "sledge.toml",
        "log.csv",
        "--out",
        "out",
        "--quiet",
    ];
    let output = pinode(dir.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(
        output.stdout.is_empty() && output.stderr.is_empty(),
        "{}",
        stderr(&output)
    );
    assert!(dir.path().join("out/report.html").exists());
}

#[test]
fn a_log_cannot_be_held_out_from_itself() {
    let dir = folder(30.0);
    std::fs::write(dir.path().join("cart.toml"), MODEL).unwrap();
    let arguments = [
        "diagnose",
        "cart.toml",
        "log.csv",
        "--holdout",
        "log.csv",
        "--out",
        "out",
    ];
    let output = pinode(dir.path(), &arguments);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("is given twice"),
        "{}",
        stderr(&output)
    );
    assert!(!dir.path().join("out").exists());
}

#[test]
fn a_report_that_cannot_be_written_leaves_the_other_files_as_they_were() {
    let dir = folder(12.0);
    let out = dir.path().join("out");
    std::fs::create_dir_all(out.join("report.html")).unwrap();
    for name in ["model.toml", "diagnosis.json"] {
        std::fs::write(out.join(name), "of an older diagnosis").unwrap();
    }
    let output = pinode(
        dir.path(),
        &["diagnose", "sledge.toml", "log.csv", "--out", "out"],
    );
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(message.contains("report.html"), "{message}");
    for name in ["model.toml", "diagnosis.json"] {
        let text = std::fs::read_to_string(out.join(name)).unwrap();
        assert_eq!(text, "of an older diagnosis");
    }
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 3);
}

/// Starts a diagnosis in `dir`, sends `signal` once it has finished a fit or two, and returns how it ended.
#[cfg(unix)]
fn stopped_by(signal: &str, dir: &Path, arguments: &[&str]) -> Output {
    use std::time::{Duration, Instant};
    let child = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .current_dir(dir)
        .args(arguments)
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let kept = dir.join("out/.unfinished-diagnosis");
    let patience = Instant::now() + Duration::from_secs(120);
    let size = || std::fs::metadata(&kept).map_or(0, |file| file.len());
    while size() < 10_000 && Instant::now() < patience {
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(size() >= 10_000, "it ended before it was stopped");
    let sent = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
    child.wait_with_output().unwrap()
}

#[cfg(unix)]
#[test]
fn an_interrupted_diagnosis_goes_on_to_the_same_bits() {
    let common = ["diagnose", "sledge.toml", "log.csv", "--out", "out"];
    let written = |dir: &Path| {
        ["diagnosis.json", "model.toml", "report.html"]
            .map(|name| std::fs::read(dir.join("out").join(name)).unwrap())
    };
    let names = |dir: &Path| -> Vec<String> {
        let entries = std::fs::read_dir(dir.join("out")).unwrap();
        let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name();
        let mut names: Vec<String> = entries
            .map(|e| name(e).to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    };
    let whole = folder(30.0);
    let output = pinode(whole.path(), &common);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let whole = written(whole.path());

    for signal in ["-INT", "-KILL"] {
        let dir = folder(30.0);
        let stopped = stopped_by(signal, dir.path(), &common);
        if signal == "-INT" {
            assert_eq!(stopped.status.code(), Some(130), "{}", stderr(&stopped));
            let said = stderr(&stopped);
            assert!(
                said.contains("interrupted; what was finished is kept in"),
                "{said}"
            );
            assert_eq!(names(dir.path()), [".unfinished-diagnosis"]);
        }
        let again = pinode(dir.path(), &common);
        assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
        let said = stderr(&again);
        assert!(
            said.contains("going on with the unfinished diagnosis in out: "),
            "{said}"
        );
        assert!(!said.contains(": 0 of its fits"), "{said}");
        assert!(written(dir.path()) == whole, "after {signal}");
        let left = names(dir.path());
        assert!(
            !left.contains(&".unfinished-diagnosis".to_owned()),
            "{left:?}"
        );
    }

    // With another seed it is another diagnosis.
    let dir = folder(30.0);
    stopped_by("-INT", dir.path(), &common);
    let other = pinode(dir.path(), &[&common[..], &["--seed", "3"]].concat());
    assert_eq!(other.status.code(), Some(0), "{}", stderr(&other));
    let said = stderr(&other);
    assert!(said.contains("was of other inputs: begun anew"), "{said}");
}
