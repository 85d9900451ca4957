//! `pinode equations`: what it prints is what `pinode dynamics` computes.
#![cfg(feature = "cli")]

use std::path::Path;
use std::process::{Command, Output};

use lagrange::Expression;
use serde_json::{Value, json};

fn model(path: &str) -> String {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    models.join(path).display().to_string()
}

fn pinode(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(arguments)
        .output()
        .unwrap()
}

fn stdout(output: &Output) -> String {
    assert!(output.status.success(), "{}", stderr(output));
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn strings(value: &Value) -> Vec<&str> {
    let list = value.as_array().unwrap();
    list.iter().map(|x| x.as_str().unwrap()).collect()
}

/// Every formula of the document at one state, against the numbers of `pinode dynamics`.
fn agrees_with_dynamics(path: &str, more: &[&str]) {
    let path = model(path);
    let document: Value = serde_json::from_str(&stdout(&pinode(
        &[&["equations", "--json", &path], more].concat(),
    )))
    .unwrap();
    let (q, v) = (
        strings(&document["coordinates"]),
        strings(&document["velocities"]),
    );
    let state =
        json!({ "q": vec![0.4; q.len()], "v": vec![-0.7; v.len()], "tau": vec![0.0; v.len()] });
    let folder = tempfile::tempdir().unwrap();
    let states = folder.path().join("states.json");
    std::fs::write(&states, json!({ "states": [state] }).to_string()).unwrap();
    let numbers: Value = serde_json::from_str(&stdout(&pinode(&[
        "dynamics",
        &path,
        states.to_str().unwrap(),
    ])))
    .unwrap();
    let numbers = &numbers["states"][0];

    let mut values: Vec<f64> = [vec![0.4; q.len()], vec![-0.7; v.len()]].concat();
    let mut names = [q, v].concat();
    for parameter in document["parameters"].as_array().unwrap() {
        names.push(parameter["name"].as_str().unwrap());
        values.push(parameter["value"].as_f64().unwrap());
    }
    let value = |formula: &str, names: &[&str], values: &[f64]| {
        Expression::parse(formula, names)
            .unwrap()
            .evaluate(|slot| values[slot])
    };
    for definition in document["definitions"].as_array().unwrap() {
        let x = value(definition["formula"].as_str().unwrap(), &names, &values);
        names.push(definition["name"].as_str().unwrap());
        values.push(x);
    }
    let close = |formula: &Value, number: &Value, scale: f64| {
        let (formula, number) = (formula.as_str().unwrap(), number.as_f64().unwrap());
        let found = value(formula, &names, &values);
        assert!(
            (found - number).abs() <= 1e-12 * scale,
            "{path}: {formula} = {found:e}, not {number:e}"
        );
    };
    for key in [
        "mass_matrix",
        "coriolis_matrix",
        "gravity_force",
        "bias_force",
    ] {
        let (formulas, numbers) = (&document[key], &numbers[key]);
        let flat = |value: &Value| -> Vec<Value> {
            let rows = value.as_array().unwrap();
            rows.iter()
                .flat_map(|row| row.as_array().cloned().unwrap_or_else(|| vec![row.clone()]))
                .collect()
        };
        let (formulas, numbers) = (flat(formulas), flat(numbers));
        assert_eq!(formulas.len(), numbers.len());
        let scale = numbers
            .iter()
            .fold(1e-3, |m: f64, x| m.max(x.as_f64().unwrap().abs()));
        for (formula, number) in formulas.iter().zip(&numbers) {
            close(formula, number, scale);
        }
    }
    for key in ["kinetic_energy", "potential_energy"] {
        close(
            &document[key],
            &numbers[key],
            numbers[key].as_f64().unwrap().abs().max(1e-3),
        );
    }
}

#[test]
fn printed_formulas_are_the_numbers_of_the_dynamics() {
    for more in [&[][..], &["--numeric"], &["--parameters"]] {
        agrees_with_dynamics("double_pendulum/double_pendulum_text.toml", more);
        agrees_with_dynamics("double_pendulum/double_pendulum.toml", more);
        agrees_with_dynamics("cartpole/cartpole.toml", more);
    }
}

#[test]
fn constants_are_names_or_numbers_as_asked() {
    let text = model("double_pendulum/double_pendulum_text.toml");
    assert!(stdout(&pinode(&["equations", &text])).contains("sin("));
    let urdf = model("cartpole/cartpole.toml");
    let formulas = |more: &[&str]| {
        let document: Value = serde_json::from_str(&stdout(&pinode(
            &[&["equations", "--json", &urdf], more].concat(),
        )))
        .unwrap();
        document["mass_matrix"][0][0].as_str().unwrap().to_owned()
    };
    assert_eq!(formulas(&[]), "0.538");
    assert!(formulas(&["--parameters"]).contains("scale_cart"));
    let latex = stdout(&pinode(&["equations", "--format", "latex", &text]));
    assert!(latex.contains(r"\begin{bmatrix}"), "{latex}");
    let both = pinode(&["equations", &text, "--numeric", "--parameters"]);
    assert_eq!(both.status.code(), Some(2));
}

#[test]
fn code_goes_to_a_file_and_never_over_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.toml");
    std::fs::copy(model("double_pendulum/double_pendulum_text.toml"), &path).unwrap();
    let path = path.to_str().unwrap();
    let before = std::fs::read(path).unwrap();
    let refused = pinode(&["equations", path, "--emit", "c", "--out", path]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        stderr(&refused).contains("is an input"),
        "{}",
        stderr(&refused)
    );
    assert_eq!(std::fs::read(path).unwrap(), before);

    let file = folder.path().join("model.rs");
    let written = pinode(&[
        "equations",
        path,
        "--emit",
        "rust",
        "--out",
        file.to_str().unwrap(),
    ]);
    assert!(stdout(&written).is_empty());
    let on_stdout = stdout(&pinode(&["equations", path, "--emit", "rust"]));
    assert_eq!(std::fs::read_to_string(&file).unwrap(), on_stdout);
    assert!(on_stdout.contains("pub struct Equations"));
}

#[test]
fn equations_of_a_constrained_model_say_that_it_is_constrained() {
    let path = model("four_bar/four_bar.toml");
    for more in [
        &["--emit", "c"][..],
        &["--emit", "rust"],
        &["--format", "latex"],
    ] {
        let text = stdout(&pinode(&[&["equations", &path], more].concat()));
        assert!(
            text.contains("constraints phi(q) = 0: pin.x, pin.z."),
            "{text}"
        );
        assert!(
            text.contains("M dv/dt + C v + G = Q + J^T lambda"),
            "{text}"
        );
    }
    let text = stdout(&pinode(&["equations", &path]));
    assert!(
        text.contains("constraints φ(q) = 0: pin.x, pin.z."),
        "{text}"
    );
    let text = stdout(&pinode(&["equations", &model("cartpole/cartpole.toml")]));
    assert!(!text.contains("constraints"), "{text}");
}
