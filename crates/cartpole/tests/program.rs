//! The program `cartpole` as its users see it.

use std::path::Path;
use std::process::{Command, Output};

use cartpole::config::Config;
use cartpole::rig::{Key, draw, draw_any};
use pinode_nn::log::Log;
use pinode_nn::model::Model;

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/cartpole");

/// Runs `cartpole` in `dir`, where no `models/cartpole` is.
fn cartpole(dir: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cartpole"))
        .current_dir(dir)
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn the_rig_writes_a_log_that_its_model_reads_and_the_key() {
    let dir = tempfile::tempdir().unwrap();
    let arguments = ["rig", "--seed", "3", "--duration", "20", "--out", "new/rig"];
    let output = cartpole(dir.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let out = dir.path().join("new/rig");
    let model = Model::load(&out.join("model.toml")).unwrap();
    let log = Log::read(&out.join("log.csv"), &model).unwrap();
    assert_eq!((log.samples(), log.warnings.len()), (1000, 0));
    let key = Key::read_json(&out.join("key.json")).unwrap();
    assert_eq!(key.seed, 3);
    // The secret is kept: it is in the key and nowhere else.
    let kind = key.hidden.kind();
    assert!(!text(&output.stdout).contains(kind) && !text(&output.stderr).contains(kind));
    assert!(text(&output.stdout).contains("--seed 3"));

    let log = std::fs::read(out.join("log.csv")).unwrap();
    cartpole(dir.path(), &arguments);
    assert!(
        log == std::fs::read(out.join("log.csv")).unwrap(),
        "same seed, other log"
    );
}

#[test]
fn the_hidden_effect_can_be_chosen() {
    let dir = tempfile::tempdir().unwrap();
    let hidden = |options: &[&str]| {
        let common = ["rig", "--duration", "2", "--out", "out", "--json"];
        let output = cartpole(dir.path(), &[&common[..], options].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(document.get("hidden").is_none());
        let key = Key::read_json(&dir.path().join(document["key"].as_str().unwrap())).unwrap();
        (key.hidden.kind(), key.hidden.target().map(|t| t.name()))
    };
    assert_eq!(hidden(&["--nothing"]), ("nothing", None));
    assert_eq!(
        hidden(&["--effect", "input_delay"]),
        ("input_delay", Some("motor"))
    );
    assert_eq!(
        hidden(&["--effect", "backlash"]),
        ("backlash", Some("motor"))
    );
    let drag = hidden(&["--effect", "quadratic_drag@pole", "--noise", "low"]);
    assert_eq!(drag, ("quadratic_drag", Some("pole")));
    assert_eq!(
        hidden(&["--effect", "viscous_friction", "--seed", "1"]).0,
        "viscous_friction"
    );
    for kind in [
        "asymmetric_viscous_friction",
        "position_dependent_friction",
        "load_dependent_friction",
        "periodic_force",
        "input_offset",
        "actuator_lag",
        "input_dead_zone",
        "input_saturation",
        "elastic_transmission",
        "sensor_offset",
        "sensor_scale",
        "sensor_delay",
        "dahl_friction",
        "lugre_friction",
        "hysteresis",
    ] {
        assert_eq!(hidden(&["--effect", kind]).0, kind);
    }
    // `medium` and `realistic` are one; the wider draw knows more than the other.
    for noise in ["medium", "realistic", "high"] {
        assert_eq!(hidden(&["--nothing", "--noise", noise]).0, "nothing");
    }
    let drawn = |from| {
        let kind = |seed: usize| hidden(&["--from", from, "--seed", &seed.to_string()]).0;
        (0..8).map(kind).collect::<Vec<_>>()
    };
    let (basic, all) = (drawn("basic"), drawn("all"));
    let config = Config::read(&Path::new(MODELS).join("rig.toml")).unwrap();
    for seed in 0..8 {
        assert_eq!(basic[seed as usize], draw(&config, seed).kind());
        assert_eq!(all[seed as usize], draw_any(&config, seed).kind());
    }
}

#[test]
fn wrong_usage_ends_with_2_and_failed_work_with_1() {
    let dir = tempfile::tempdir().unwrap();
    for usage in [
        &["rgi"][..],
        &["--seed", "-1"],
        &["--duration", "0"],
        &["--noise", "none"],
        &["--nothing", "--effect", "input_delay"],
        &["--from", "all", "--effect", "input_delay"],
        &["--from", "everywhere"],
        &["rig", "--effect", "viscous_friction@motor"],
    ] {
        let output = cartpole(dir.path(), usage);
        assert_eq!(output.status.code(), Some(2), "{usage:?}");
        assert!(output.stdout.is_empty() && !output.stderr.is_empty());
    }
    let unknown = cartpole(dir.path(), &["rig", "--effect", "viscous@pole"]);
    assert!(
        text(&unknown.stderr).contains("viscous_friction@pole"),
        "{}",
        text(&unknown.stderr)
    );

    let failed = cartpole(dir.path(), &["rig", "--models", "no-such-folder"]);
    assert_eq!(failed.status.code(), Some(1));
    assert!(text(&failed.stderr).contains("no-such-folder"));
    assert!(!dir.path().join("out").exists());
}

#[test]
fn a_clear_effect_is_recorded_found_and_compared_with_the_key() {
    let dir = tempfile::tempdir().unwrap();
    let effect = ["--effect", "viscous_friction@pole", "--noise", "low"];
    let common = ["--seed", "1", "--duration", "20", "--json", "--out", "all"];
    let output = cartpole(dir.path(), &[&effect[..], &common].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["hidden"]["kind"], "viscous_friction");
    assert_eq!(document["judgement"], "right", "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("the key is opened"));
    for path in document["files"].as_object().unwrap().values() {
        let path = dir.path().join(path.as_str().unwrap());
        assert!(path.exists(), "{}", path.display());
    }
    let written = std::fs::read(dir.path().join("all/diagnosis/diagnosis.json")).unwrap();
    let written: serde_json::Value = serde_json::from_slice(&written).unwrap();
    assert_eq!(written, document["diagnosis"]);
}

/// All bytes that the rig leaves in a folder, by path.
fn files(dir: &Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(files(&path)),
            false => found.push((path.clone(), std::fs::read(&path).unwrap())),
        }
    }
    found
}

#[test]
fn a_secret_draw_is_in_its_key_file_and_nowhere_else() {
    let dir = tempfile::tempdir().unwrap();
    let config = Config::read(&Path::new(MODELS).join("rig.toml")).unwrap();
    for (seed, json) in [(7_654_321_u64, false), (7_654_322, true)] {
        let seed_text = seed.to_string();
        let mut arguments = vec!["rig", "--secret", &seed_text, "--from", "all"];
        arguments.extend(["--duration", "5", "--out", "handed/over"]);
        if json {
            arguments.push("--json");
        }
        let output = cartpole(dir.path(), &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));

        // The draw is that of the same seed in the open, and its key lies outside of what is handed over.
        let key = Key::read_json(&dir.path().join("handed/over.key.json")).unwrap();
        assert_eq!((key.seed, key.hidden), (seed, draw_any(&config, seed)));
        let in_folder = files(&dir.path().join("handed/over"));
        let names: Vec<_> = in_folder
            .iter()
            .map(|(path, _)| path.file_name().unwrap().to_str().unwrap().to_owned())
            .collect();
        assert_eq!(in_folder.len(), 3, "{names:?}");

        let mut said = vec![text(&output.stdout), text(&output.stderr)];
        said.extend(in_folder.iter().map(|(_, bytes)| text(bytes)));
        let truth: Vec<String> = [key.hidden.kind().to_owned(), seed_text.clone()]
            .into_iter()
            .chain(key.hidden.parameters().iter().map(|(_, x)| x.to_string()))
            .collect();
        // What the model still says of a kind is what its user knows anyway.
        let model = std::fs::read_to_string(Path::new(MODELS).join("cartpole.toml")).unwrap();
        for secret in truth.iter().filter(|secret| !model.contains(*secret)) {
            for said in &said {
                assert!(!said.contains(secret), "{secret} is told in: {said}");
            }
        }
    }
    for usage in [
        &["--secret", "1", "--seed", "2"][..],
        &["--secret", "1", "--nothing"],
        &["--secret", "1", "--effect", "input_delay"],
    ] {
        assert_eq!(cartpole(dir.path(), usage).status.code(), Some(2));
    }
}

#[test]
fn the_key_goes_where_it_is_told_to() {
    let dir = tempfile::tempdir().unwrap();
    let arguments = ["rig", "--secret", "5", "--duration", "2", "--key", "k.json"];
    let output = cartpole(dir.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(Key::read_json(&dir.path().join("k.json")).unwrap().seed, 5);
}
