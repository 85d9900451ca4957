//! The program as its users see it: streams, exit codes, numbers.
#![cfg(feature = "cli")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::{Value, json};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

fn cartpole() -> String {
    models()
        .join("cartpole/cartpole.toml")
        .display()
        .to_string()
}

fn pinode(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(arguments)
        .output()
        .unwrap()
}

fn stdout_json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Writes `content` into a new folder, which lives as long as the first of the pair.
fn file(name: &str, content: &str) -> (tempfile::TempDir, String) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, content).unwrap();
    let path = path.display().to_string();
    (dir, path)
}

#[test]
fn exit_codes_tell_failed_work_from_wrong_usage() {
    assert_eq!(pinode(&["check", &cartpole()]).status.code(), Some(0));
    assert_eq!(pinode(&["--version"]).status.code(), Some(0));
    let failed = pinode(&["check", "no-such-model.toml"]);
    assert_eq!(failed.status.code(), Some(1));
    assert!(failed.stdout.is_empty());
    assert!(stderr(&failed).contains("no-such-model.toml"));
    for usage in [
        &["chekc"][..],
        &[],
        &["check"],
        &["check", "a", "--threads", "0"],
        &["evaluate", "a.toml", "b.csv", "--horizon", "-1"],
    ] {
        let wrong = pinode(usage);
        assert_eq!(wrong.status.code(), Some(2), "{usage:?}");
        assert!(wrong.stdout.is_empty());
    }
}

#[test]
fn what_stands_in_the_wrong_place_is_told_with_what_to_do() {
    let (dir, log) = file("log.csv", "t,q.slider,q.pole,u.motor\n0,0,0,0\n");
    let folder = dir.path().display().to_string();
    for (arguments, said) in [
        (
            &["diagnose", &log, &cartpole(), "--out", &folder][..],
            "the model comes first, then the logs",
        ),
        (&["check", &folder], "give a file in that folder"),
        (
            &["diagnose", &cartpole(), &folder, "--out", &folder],
            "give a file in that folder",
        ),
        (&["check", "no-such-model.toml"], "check the path"),
    ] {
        let failed = pinode(arguments);
        assert_eq!(failed.status.code(), Some(1), "{arguments:?}");
        let told = stderr(&failed);
        assert!(told.contains(said), "{told}");
        assert!(told.trim_end().lines().count() <= 2, "{told}");
    }
}

#[test]
fn check_prints_the_mechanism_as_text_and_as_json() {
    let text = pinode(&["check", &cartpole()]);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    for words in [
        "slider [m]",
        "pole [rad, wraps]",
        "cart: 0.466 kg",
        "motor on slider",
        "viscous_friction on pole: coefficient = 0.002 N·m·s/rad",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
    let document = stdout_json(&pinode(&["check", "--json", &cartpole()]));
    assert_eq!(document["coordinates"][1]["name"], "pole");
    assert_eq!(document["effects"][0]["target"], "slider");
}

#[test]
fn quiet_leaves_stdout_and_stderr_empty() {
    let output = pinode(&["check", "--quiet", &cartpole()]);
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stdout.is_empty() && output.stderr.is_empty());
}

#[test]
fn strict_refuses_an_inertia_that_no_body_has() {
    let urdf = "<robot name='r'><link name='a'/><link name='b'><inertial><mass value='1'/>
      <inertia ixx='1' iyy='1' izz='3' ixy='0' ixz='0' iyz='0'/></inertial></link>
      <joint name='j' type='continuous'><parent link='a'/><child link='b'/></joint></robot>";
    let (dir, _) = file("r.urdf", urdf);
    let path = dir.path().join("r.toml");
    std::fs::write(&path, "urdf = 'r.urdf'").unwrap();
    let path = path.display().to_string();
    let lenient = pinode(&["check", &path]);
    assert_eq!(lenient.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&lenient.stdout).contains("1 warning:"));
    assert_eq!(pinode(&["check", "--strict", &path]).status.code(), Some(1));
}

#[test]
fn a_closed_pipe_is_no_failure() {
    let states: Vec<Value> = (0..2000)
        .map(|i| json!({ "q": [0.0, i], "v": [1.0, 2.0], "tau": [0.0, 0.0] }))
        .collect();
    let (_dir, path) = file("states.json", &json!({ "states": states }).to_string());
    let mut child = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(["dynamics", &cartpole(), &path])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(output.stderr.is_empty());
}

#[test]
fn all_faults_of_the_states_are_named() {
    let states = r#"{"states": [
        {"q": [0, 0], "v": [0, 0], "tau": [0, 0]},
        {"q": [0], "v": [0, null], "tau": "none"},
        {"q": [0, 0], "v": [0, 0], "tou": [0, 0]},
        7
    ]}"#;
    let (_dir, path) = file("states.json", states);
    let output = pinode(&["dynamics", &cartpole(), &path]);
    assert_eq!(output.status.code(), Some(1));
    assert!(output.stdout.is_empty());
    let message = stderr(&output);
    for words in [
        "states[1].q has 1 entries, the model has 2 coordinates: slider, pole",
        "states[1].v[1] is null, not a finite number",
        "states[1].tau is not an array of numbers",
        "states[2].tau is missing",
        "states[2]: unknown key `tou`; nearest: `tau`",
        "states[3].q is missing",
    ] {
        assert!(message.contains(words), "no {words:?} in\n{message}");
    }
    for (broken, words) in [
        ("{\"states\": [", "states.json:1:"),
        ("[]", "no array `states`"),
        ("{\"states\": [{\"q\": [1e999, 0]}]}", "number out of range"),
    ] {
        let (_dir, path) = file("states.json", broken);
        let output = pinode(&["dynamics", &cartpole(), &path]);
        assert_eq!(output.status.code(), Some(1));
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    }
}

#[test]
fn mass_scales_reach_the_equations_of_motion() {
    let model = |scale: f64| {
        let folder = models()
            .join("cartpole/cartpole.urdf")
            .canonicalize()
            .unwrap();
        format!("urdf = {folder:?}\n[mass_scale]\ncart = {scale}\n")
    };
    let (_states_dir, states) = file(
        "states.json",
        r#"{"states": [{"q": [0, 0.3], "v": [0, 0], "tau": [0, 0]}]}"#,
    );
    let mass = |scale: f64| {
        let (_dir, path) = file("m.toml", &model(scale));
        let document = stdout_json(&pinode(&["dynamics", &path, &states]));
        document["states"][0]["mass_matrix"][0][0].as_f64().unwrap()
    };
    assert!((mass(2.0) - mass(1.0) - 0.466).abs() < 1e-15);
}

#[test]
fn a_simulated_log_is_met_exactly_by_its_own_model() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("t.csv").display().to_string();
    let model = models().join("double_pendulum/double_pendulum_text.toml");
    let model = model.display().to_string();
    let simulated = pinode(&[
        "simulate",
        &model,
        "--initial",
        "2.5,-1,0,0.5",
        "--duration",
        "3",
        "--out",
        &out,
        "--json",
    ]);
    assert_eq!(stdout_json(&simulated)["samples"], 301);
    let document = stdout_json(&pinode(&[
        "evaluate",
        "--json",
        &model,
        &out,
        "--windows",
        "50",
    ]));
    assert_eq!(document["horizon_s"], 0.6);
    assert_eq!(document["windows"], 50);
    assert_eq!(document["diverged"], 0);
    let signals = document["coordinates"].as_array().unwrap();
    let names: Vec<&str> = signals
        .iter()
        .map(|c| c["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["q.shoulder", "q.elbow", "v.shoulder", "v.elbow"]);
    for signal in signals {
        assert!(signal["rmse"].as_f64().unwrap() < 1e-9, "{signal}");
    }
    // Positions alone: the velocities are estimated, and small errors are left.
    let estimated = stdout_json(&pinode(&[
        "evaluate",
        "--json",
        &model,
        &out,
        "--windows",
        "50",
        "--initial",
        "estimated",
    ]));
    let rmse = estimated["coordinates"][0]["rmse"].as_f64().unwrap();
    assert!(rmse > 1e-9 && rmse < 0.05, "{rmse}");

    // The log's initial state and inputs lead along the same trajectory.
    let again = dir.path().join("again.csv").display().to_string();
    let output = pinode(&["simulate", &model, "--log", &out, "--out", &again]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let last = |path: &str| -> Vec<f64> {
        let text = std::fs::read_to_string(path).unwrap();
        let line = text.lines().last().unwrap().to_owned();
        line.split(',')
            .take(5)
            .map(|x| x.parse().unwrap())
            .collect()
    };
    assert_eq!(last(&out), last(&again));
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("t.csv").display().to_string();
    pinode(&[
        "simulate",
        &cartpole(),
        "--initial",
        "0,0.1,0,0",
        "--duration",
        "3",
        "--out",
        &out,
    ]);
    let evaluate = |threads: &str| {
        pinode(&[
            "evaluate",
            "--json",
            &cartpole(),
            &out,
            "--initial",
            "estimated",
            "--threads",
            threads,
        ])
        .stdout
    };
    assert!(!evaluate("1").is_empty());
    assert_eq!(evaluate("1"), evaluate("3"));
}

#[test]
fn a_failed_simulation_writes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("t.csv");
    let path = out.display().to_string();
    let wrong = pinode(&["simulate", &cartpole(), "--initial", "0,0", "--out", &path]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("q.slider,q.pole,v.slider,v.pole"));
    let unstable =
        "[lagrangian]\ncoordinates = ['x']\nkinetic = '0.5*x_dot^2'\npotential = '-x^4'\n";
    let (_model_dir, model) = file("m.toml", unstable);
    let diverged = pinode(&["simulate", &model, "--initial", "1,1", "--out", &path]);
    assert_eq!(diverged.status.code(), Some(1));
    assert!(
        stderr(&diverged).contains("diverges"),
        "{}",
        stderr(&diverged)
    );
    let singular =
        "[lagrangian]\ncoordinates = ['x']\nkinetic = '(1-x)^2*x_dot^2'\npotential = 'x'\n";
    let (_model_dir, model) = file("m.toml", singular);
    let stopped = pinode(&["simulate", &model, "--initial", "1,0", "--out", &path]);
    assert_eq!(stopped.status.code(), Some(1));
    for words in ["after t = 0 s", "mass matrix is not positive definite"] {
        assert!(stderr(&stopped).contains(words), "{}", stderr(&stopped));
    }
    assert!(!stderr(&stopped).contains("shorter step"));
    assert!(!out.exists());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn a_horizon_longer_than_the_log_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("t.csv").display().to_string();
    pinode(&[
        "simulate",
        &cartpole(),
        "--initial",
        "0,0.1,0,0",
        "--duration",
        "1",
        "--out",
        &out,
    ]);
    let output = pinode(&["evaluate", &cartpole(), &out, "--horizon", "2"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("no window of 2 s"),
        "{}",
        stderr(&output)
    );
}

/// A column of torques is all that a new mechanism has to be driven by.
#[test]
fn inputs_alone_drive_a_mechanism_from_a_given_state() {
    let (dir, model) = file(
        "wheel.toml",
        "name = \"wheel\"\n[lagrangian]\ncoordinates = [\"turn\"]\nkinetic = \"turn_dot^2\"\npotential = \"0\"\n[[input]]\nname = \"motor\"\njoint = \"turn\"\n",
    );
    let [log, out] = ["u.csv", "out.csv"].map(|name| dir.path().join(name).display().to_string());
    std::fs::write(&log, "t,u.motor\n0,4\n0.5,-2\n1,0\n").unwrap();
    let simulate = [
        "simulate",
        &model,
        "--log",
        &log,
        "--initial",
        "0.25,1",
        "--out",
        &out,
    ];
    let output = pinode(&simulate);
    assert!(output.status.success(), "{}", stderr(&output));
    // 2 kg·m² under 4 N·m for half a second and −2 N·m for another.
    let text = std::fs::read_to_string(&out).unwrap();
    let last: Vec<f64> = text
        .lines()
        .last()
        .unwrap()
        .split(',')
        .take(3)
        .map(|x| x.parse().unwrap())
        .collect();
    let turn = 0.25 + 1.0 + 0.5 * 2.0 * 0.25 + 0.5 - 0.5 * 0.25;
    for (x, expected) in last.iter().zip([1.0, turn, 1.5]) {
        assert!((x - expected).abs() < 1e-9, "{text}");
    }
    let without = pinode(&["simulate", &model, "--log", &log, "--out", &out]);
    assert!(
        stderr(&without).contains("`q.turn` is missing"),
        "{}",
        stderr(&without)
    );
}

/// Reference dynamics, `<robot>.urdf` with `<robot>.json` and `closed_<name>.json`: in the folder that PINODE_ORACLES names, or
/// beside the repository.
fn oracles() -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/oracles");
    let folder = std::env::var_os("PINODE_ORACLES").map_or_else(|| beside.into(), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no reference dynamics at {}", folder.display());
    None
}

fn read_json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn an_interval_between_samples_that_is_longer_than_the_run_is_wrong_usage() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.csv");
    let out = out.to_str().unwrap();
    let model = cartpole();
    let simulate = [
        "simulate",
        &model,
        "--duration",
        "1",
        "--sample",
        "3",
        "--out",
        out,
    ];
    let output = pinode(&simulate);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("longer than the 1 s of the run"));
    assert!(!Path::new(out).exists());
}

/// `pinode dynamics` on the states of an oracle gives its numbers.
fn assert_agrees(model: &str, states: &Value, name: &str) {
    let input: Vec<Value> = states
        .as_array()
        .unwrap()
        .iter()
        .map(|s| json!({ "q": s["q"], "v": s["v"], "tau": s["tau"] }))
        .collect();
    let (_dir, path) = file("states.json", &json!({ "states": input }).to_string());
    let output = stdout_json(&pinode(&["dynamics", model, &path]));
    for (i, expected) in states.as_array().unwrap().iter().enumerate() {
        for (ours, theirs) in [
            ("mass_matrix", "M"),
            ("coriolis_matrix", "C_christoffel"),
            ("gravity_force", "G"),
            ("bias_force", "bias"),
            ("acceleration", "qdd"),
            ("kinetic_energy", "KE"),
            ("potential_energy", "PE"),
        ] {
            let (a, b) = (flat(&output["states"][i][ours]), flat(&expected[theirs]));
            assert_eq!(a.len(), b.len(), "{name} {ours}");
            let size = b.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
            for (a, b) in a.iter().zip(&b) {
                assert!(
                    (a - b).abs() <= 1e-10 * size,
                    "{name}[{i}] {ours}: {a} and {b}"
                );
            }
        }
    }
}

fn flat(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().flat_map(flat).collect(),
        other => vec![other.as_f64().unwrap()],
    }
}

#[test]
fn dynamics_of_urdfs_agree_with_another_engine() {
    let Some(folder) = oracles() else { return };
    for robot in ["cartpole_roehrl2020", "double_pendulum_continuous"] {
        let urdf = folder.join(format!("{robot}.urdf"));
        let (_dir, model) = file("m.toml", &format!("urdf = {urdf:?}\n"));
        let oracle = read_json(&folder.join(format!("{robot}.json")));
        assert_agrees(&model, &oracle["variants"]["fixed"]["states"], robot);
    }
}

#[test]
fn dynamics_of_energies_as_text_agree_with_closed_forms() {
    let Some(folder) = oracles() else { return };
    for name in [
        "cartpole_table2",
        "double_pendulum",
        "elastic_pendulum",
        "furuta_pendulum",
        "spherical_pendulum",
        "triple_pendulum_relative",
    ] {
        let oracle = read_json(&folder.join(format!("closed_{name}.json")));
        let coordinates: Vec<&str> = oracle["coordinates"]
            .as_array()
            .unwrap()
            .iter()
            .map(|c| c.as_str().unwrap().trim_end_matches("(t)"))
            .collect();
        let formula = |key: &str| {
            let mut text = oracle["lagrangian"][key]
                .as_str()
                .unwrap()
                .replace("**", "^");
            for c in &coordinates {
                text = text.replace(&format!("Derivative({c}, t)"), &format!("{c}_dot"));
            }
            text
        };
        let mut model = format!(
            "[lagrangian]\ncoordinates = {coordinates:?}\nkinetic = {:?}\npotential = {:?}\n[lagrangian.parameters]\n",
            formula("T"),
            formula("V")
        );
        for (parameter, value) in oracle["parameters"].as_object().unwrap() {
            model.push_str(&format!("{parameter} = {value}\n"));
        }
        let (_dir, path) = file("m.toml", &model);
        assert_agrees(&path, &oracle["states"], name);
    }
}

#[test]
fn simulate_writes_over_none_of_its_inputs() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("double_pendulum.toml");
    let given = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../models/double_pendulum/double_pendulum_text.toml"
    );
    std::fs::copy(given, &model).unwrap();
    let before = std::fs::read(&model).unwrap();
    let path = model.to_str().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(["simulate", path, "--duration", "1", "--out", path])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("is an input that was read"), "{message}");
    assert_eq!(std::fs::read(&model).unwrap(), before);
}

fn four_bar() -> String {
    models()
        .join("four_bar/four_bar.toml")
        .display()
        .to_string()
}

#[test]
fn a_constrained_model_gives_multipliers_by_name() {
    let checked = stdout_json(&pinode(&["check", "--json", &four_bar()]));
    assert_eq!(checked["constraints"][1]["name"], "pin.z");
    assert_eq!(checked["constraints"][1]["in_force"], true);

    let states = json!({ "states": [{ "q": [0.0, 0.0, 0.0], "v": [0.0, 0.0, 0.0], "tau": [0.0, 0.0, 0.0] }] });
    let (_dir, path) = file("states.json", &states.to_string());
    let document = stdout_json(&pinode(&["dynamics", &four_bar(), &path]));
    let state = &document["states"][0];
    let list = |key: &str| -> Vec<f64> {
        let array = state[key].as_array().unwrap();
        array.iter().map(|x| x.as_f64().unwrap()).collect()
    };
    let (a, bias) = (list("acceleration"), list("bias_force"));
    let force = |k: usize| state["multipliers"][k]["value"].as_f64().unwrap();
    assert_eq!(state["multipliers"][0]["name"], "pin.x");
    // M v̇ + bias = Jᵀ λ. The pin at (0.24, 0.17) moves with the coupler about the world's origin for the crank, about (0, 0.1) for
    // the elbow, and the other way with the rocker about (0.24, 0); a turn moves (x, z) by (−z, x).
    let columns = [(-0.17, 0.24), (-0.07, 0.24), (0.17, 0.0)];
    for (i, (jx, jz)) in columns.into_iter().enumerate() {
        let row = state["mass_matrix"][i].as_array().unwrap();
        let inertial: f64 = row
            .iter()
            .zip(&a)
            .map(|(m, a)| m.as_f64().unwrap() * a)
            .sum();
        let error = inertial + bias[i] - jx * force(0) - jz * force(1);
        assert!(error.abs() < 1e-12, "{i}: {error:e}");
    }
    // At rest J v̇ = 0.
    for component in [0, 1] {
        let along = |c: (f64, f64)| if component == 0 { c.0 } else { c.1 };
        let closing: f64 = columns.iter().zip(&a).map(|(c, a)| along(*c) * a).sum();
        assert!(closing.abs() < 1e-11, "{closing:e}");
    }
}

#[test]
fn simulate_starts_where_the_loop_is_closed() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("swing.csv").display().to_string();
    let simulated = pinode(&[
        "simulate",
        &four_bar(),
        "--initial",
        "0.5,0,0,0,0,0",
        "--duration",
        "2",
        "--out",
        &out,
    ]);
    assert!(simulated.status.success(), "{}", stderr(&simulated));
    assert!(stderr(&simulated).contains("does not obey the constraints"));
    let text = std::fs::read_to_string(&out).unwrap();
    let mut rows = 0;
    for line in text.lines().skip(1) {
        let x: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let (crank, coupler, rocker) = (x[1], x[1] + x[2], x[3]);
        // The pin on the coupler, and on the rocker.
        let pin = |at: (f64, f64), (x, z): (f64, f64), turn: f64| {
            let (sin, cos) = turn.sin_cos();
            (at.0 + x * cos - z * sin, at.1 + x * sin + z * cos)
        };
        let elbow = pin((0.0, 0.0), (0.0, 0.1), crank);
        let a = pin(elbow, (0.24, 0.07), coupler);
        let b = pin((0.24, 0.0), (0.0, 0.17), rocker);
        assert!(
            (a.0 - b.0).abs() < 1e-8 && (a.1 - b.1).abs() < 1e-8,
            "{line}"
        );
        rows += 1;
    }
    assert_eq!(rows, 201);
}

#[test]
fn a_force_or_a_velocity_beyond_the_range_of_numbers_is_the_culprit_itself() {
    for (state, words) in [
        (
            json!({ "q": [0, 0], "v": [0, 0], "tau": [0, 1e308] }),
            "states[0].tau[1] is 1e308: the acceleration under it",
        ),
        (
            json!({ "q": [0, 0.3], "v": [0, -1e200], "tau": [0, 0] }),
            "v[1] is -1e200, and what is made of it is beyond the range of numbers",
        ),
    ] {
        let (_dir, path) = file("states.json", &json!({ "states": [state] }).to_string());
        let output = pinode(&["dynamics", &cartpole(), &path]);
        assert_eq!(output.status.code(), Some(1));
        let message = stderr(&output);
        assert!(message.contains(words), "no {words:?} in\n{message}");
        assert!(!message.contains("mass matrix"), "{message}");
    }
}

#[test]
fn a_negative_number_gets_our_own_answer() {
    for arguments in [
        &["evaluate", "a.toml", "b.csv", "--horizon", "-1"][..],
        &["evaluate", "a.toml", "b.csv", "--step", "-1"],
        &["simulate", "a.toml", "--out", "b.csv", "--duration", "-1"],
        &["simulate", "a.toml", "--out", "b.csv", "--sample", "-1"],
        &["simulate", "a.toml", "--out", "b.csv", "--step", "-1"],
    ] {
        let output = pinode(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let message = stderr(&output);
        assert!(message.contains("-1 is not positive"), "{message}");
    }
}

/// A cart that nothing pushes, and its log with the given sample times and positions.
fn coasting(samples: impl Iterator<Item = (f64, f64)>) -> (tempfile::TempDir, [String; 2]) {
    let (dir, model) = file(
        "m.toml",
        "[lagrangian]\ncoordinates = ['x']\nkinetic = '0.5*x_dot^2'\npotential = '0'\n",
    );
    let mut text = "t,q.x,v.x\n".to_owned();
    for (t, x) in samples {
        text += &format!("{t},{x},1\n");
    }
    let log = dir.path().join("log.csv");
    std::fs::write(&log, text).unwrap();
    (dir, [model, log.display().to_string()])
}

#[test]
fn evaluate_warns_of_gaps() {
    let time = |k: u32| 0.01 * f64::from(k) + if k < 150 { 0.0 } else { 2.5 };
    let (_dir, [model, log]) = coasting((0..300).map(|k| (time(k), time(k))));
    let output = pinode(&["evaluate", "--json", &model, &log]);
    let words = "run `0` has 1 gap of more than 10 sample intervals, the longest 2.510000 s from t = 1.49 s on";
    assert!(stderr(&output).contains(words), "{}", stderr(&output));
    let document = stdout_json(&output);
    assert!(document["warnings"][0].as_str().unwrap().contains(words));

    let (_dir, [model, log]) = coasting((0..300).map(|k| 0.01 * f64::from(k)).map(|t| (t, t)));
    let document = stdout_json(&pinode(&["evaluate", "--json", &model, &log]));
    assert_eq!(document["warnings"], json!([]));
}

/// The document repeated what was asked for, whatever the samples allowed.
#[test]
fn evaluate_tells_the_horizon_that_it_ran() {
    let (_dir, [model, log]) = coasting((0..300).map(|k| 0.02 * f64::from(k)).map(|t| (t, t)));
    let at = |horizon: &str| {
        let evaluated = pinode(&["evaluate", "--json", "--horizon", horizon, &model, &log]);
        stdout_json(&evaluated)
    };
    let whole = at("0.6");
    assert_eq!(whole["horizon_s"], 0.6);
    assert_eq!(whole["warnings"], json!([]));
    for (asked, taken) in [("0.001", 0.02), ("0.605", 0.6)] {
        let document = at(asked);
        let own = document["horizon_s"].as_f64().unwrap();
        assert!((own - taken).abs() < 1e-9, "{own}");
        let words = document["warnings"][0].as_str().unwrap();
        assert!(words.contains("whole sample intervals"), "{words}");
    }
}

/// Its header had one column more than its rows.
#[test]
fn a_trajectory_of_a_joint_with_a_comma_in_its_name_is_read_back() {
    let urdf = models().join("single_pendulum/single_pendulum.urdf");
    let text = std::fs::read_to_string(urdf).unwrap();
    let named = text.replace("joint name=\"swing\"", "joint name=\"a, b\"");
    assert_ne!(named, text);
    let (dir, _) = file("p.urdf", &named);
    let model = dir.path().join("m.toml").display().to_string();
    std::fs::write(&model, "urdf = \"p.urdf\"\n").unwrap();
    let out = dir.path().join("t.csv").display().to_string();
    let short = ["--initial", "1,0", "--duration", "2"];
    let simulate = [&["simulate", "--json", &model, "--out", &out], &short[..]].concat();
    assert_eq!(stdout_json(&pinode(&simulate))["warnings"], json!([]));
    let evaluated = stdout_json(&pinode(&["evaluate", "--json", &model, &out]));
    assert_eq!(evaluated["coordinates"][0]["name"], "q.a, b");

    // And what ends before it should says so.
    let longer = [
        "simulate",
        "--json",
        &model,
        "--log",
        &out,
        "--duration",
        "5",
        "--out",
    ];
    let again = dir.path().join("again.csv").display().to_string();
    let document = stdout_json(&pinode(&[&longer[..], &[&again]].concat()));
    let words = document["warnings"][0].as_str().unwrap();
    assert!(words.contains("lasts 2.000000 s, not 5 s"), "{words}");
}

#[test]
fn evaluate_names_a_sample_whose_square_is_no_number() {
    let position = |k: u32| if k == 77 { -1e200 } else { 0.01 * f64::from(k) };
    let (_dir, [model, log]) = coasting((0..300).map(|k| (0.01 * f64::from(k), position(k))));
    let output = pinode(&["evaluate", "--json", &model, &log]);
    assert_eq!(output.status.code(), Some(1));
    assert!(output.stdout.is_empty());
    let words = "the errors of q.x are too large to be squared: sample 77 of run `0` (t = 0.77 s) reads -1e200";
    assert!(stderr(&output).contains(words), "{}", stderr(&output));
}

/// It said that it had taken the steps that were asked for.
#[test]
fn simulate_tells_of_the_steps_that_it_has_taken() {
    let (dir, [model, log]) = coasting((0..300).map(|k| 0.01 * f64::from(k)).map(|t| (t, t)));
    let out = dir.path().join("t.csv").display().to_string();
    let simulate = ["simulate", "--json", &model, "--log", &log, "--out", &out];
    let output = pinode(&[&simulate[..], &["--step", "1e-12"]].concat());
    let taken = stdout_json(&output)["longest_step_s"].as_f64().unwrap();
    assert!((taken / 1e-5 - 1.0).abs() < 1e-6, "{taken}");
    let words = "are taken, not of 1e-12 s: there are at most 1000 between two samples";
    assert!(stderr(&output).contains(words), "{}", stderr(&output));
}

/// The double pendulum for 2 s, with what is said of it and the last row.
#[cfg(feature = "adaptive")]
fn swung(more: &[&str]) -> (Value, Vec<f64>) {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("t.csv").display().to_string();
    let model = models().join("double_pendulum/double_pendulum_text.toml");
    let model = model.display().to_string();
    let fixed = ["simulate", &model, "--initial", "1.5,-1,0,0.5", "--json"];
    let output = pinode(&[&fixed[..], &["--duration", "2", "--out", &out], more].concat());
    let document = stdout_json(&output);
    let text = std::fs::read_to_string(&out).unwrap();
    let last = text.lines().last().unwrap();
    (
        document,
        last.split(',').map(|x| x.parse().unwrap()).collect(),
    )
}

#[cfg(feature = "adaptive")]
#[test]
fn simulate_by_steps_that_adapt_ends_where_fixed_ones_do() {
    let (document, reference) = swung(&["--step", "1e-4"]);
    assert_eq!(document["longest_step_s"], 1e-4);
    assert!(document["effort"].is_null());
    for (method, tolerance, most) in [
        ("adaptive", "1e-8", 1e-4),
        ("tsit5", "1e-8", 1e-4),
        ("bdf", "1e-8", 1e-3),
        ("esdirk34", "1e-8", 1e-4),
        ("tr-bdf2", "1e-7", 1e-2),
    ] {
        let (document, row) = swung(&["--method", method, "--tolerance", tolerance]);
        assert_eq!(document["samples"], 201);
        assert!(document["longest_step_s"].is_null());
        assert_eq!(
            document["relative_tolerance"],
            tolerance.parse::<f64>().unwrap()
        );
        let effort = &document["effort"];
        assert!(effort["steps"].as_u64().unwrap() > 10, "{effort}");
        let implicit = !["adaptive", "tsit5"].contains(&method);
        assert_eq!(effort["jacobians"].as_u64().unwrap() > 0, implicit);
        for (a, b) in row.iter().zip(&reference) {
            assert!((a - b).abs() < most, "{method}: {a} {b}");
        }
    }
    // Without a tolerance, 1e-6.
    let (document, _) = swung(&["--method", "adaptive"]);
    assert_eq!(document["relative_tolerance"], 1e-6);
}

#[test]
fn a_step_is_for_fixed_steps_and_a_tolerance_for_those_that_adapt() {
    let simulate = |more: &[&str], code: i32| {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("t.csv");
        let path = out.display().to_string();
        let fixed = ["simulate", &cartpole(), "--out", &path];
        let output = pinode(&[&fixed[..], more].concat());
        assert_eq!(output.status.code(), Some(code), "{more:?}");
        assert!(!out.exists());
        stderr(&output)
    };
    let step = simulate(&["--method", "tsit5", "--step", "1e-4"], 2);
    assert!(
        step.contains("--step") && step.contains("--tolerance"),
        "{step}"
    );
    let tolerance = simulate(&["--tolerance", "1e-4"], 2);
    assert!(tolerance.contains("take --method adaptive"), "{tolerance}");
    #[cfg(feature = "adaptive")]
    {
        let large = simulate(&["--method", "adaptive", "--tolerance", "2"], 1);
        assert!(large.contains("relative tolerance is 2"), "{large}");
    }
    #[cfg(not(feature = "adaptive"))]
    {
        let without = simulate(&["--method", "tr-bdf2"], 1);
        assert!(
            without.contains("--method tr-bdf2 needs the feature `adaptive`"),
            "{without}"
        );
    }
}

/// The same recording, written by other programs (`data/logs/make.py`).
#[cfg(all(feature = "parquet", feature = "mcap"))]
#[test]
fn logs_in_csv_parquet_and_mcap_give_the_same_numbers() {
    let logs = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/logs");
    let mapped = std::fs::read_to_string(cartpole()).unwrap()
        + "\n[log.columns]\n\"u.motor\" = \"/motor/command.data\"\n";
    let urdf = models().join("cartpole/cartpole.urdf");
    let mapped = mapped.replace("cartpole.urdf", &urdf.display().to_string());
    let (_dir, mapped) = file("mapped.toml", &mapped);
    let evaluated = |model: &str, name: &str| {
        let log = logs.join(name).display().to_string();
        let output = pinode(&["evaluate", model, &log, "--json", "--windows", "20"]);
        (stdout_json(&output), stderr(&output))
    };
    let (csv, _) = evaluated(&cartpole(), "rig.csv");
    assert!(csv["coordinates"][0]["rmse"].as_f64().unwrap() > 0.0);
    for (model, name) in [
        (&cartpole(), "snappy.parquet"),
        (&cartpole(), "json.mcap"),
        (&mapped, "ros2.mcap"),
    ] {
        assert_eq!(evaluated(model, name).0, csv, "{name}");
    }
    let (_, told) = evaluated(&cartpole(), "json.mcap");
    assert!(
        told.contains("topics not read: `/odd` (protobuf)"),
        "{told}"
    );
}
