//! Kinetic energies that are not quadratic in the velocities: what `dynamics` says of them, and those that are a slip.
#![cfg(feature = "cli")]

use serde_json::{Value, json};

use crate::program::{pinode, stderr};

/// What `dynamics` gives for the model at one state.
fn dynamics(model: &str, state: &Value) -> Value {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.toml"), model).unwrap();
    let states = json!({ "states": [state] }).to_string();
    std::fs::write(dir.path().join("s.json"), states).unwrap();
    let output = pinode(&["dynamics", "m.toml", "s.json"], dir.path());
    assert!(output.status.success(), "{}", stderr(&output));
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    document["states"][0].clone()
}

fn vector(value: &Value) -> Vec<f64> {
    let list = value.as_array().unwrap().iter();
    list.map(|x| x.as_f64().unwrap()).collect()
}

/// A v of a matrix A.
fn product(matrix: &Value, v: &[f64]) -> Vec<f64> {
    let rows = matrix.as_array().unwrap().iter().map(vector);
    let dot = |row: Vec<f64>| row.iter().zip(v).map(|(a, v)| a * v).sum();
    rows.map(dot).collect()
}

/// M v̇ + C v + G − Q, with the bias force for C v + G where there is no C.
fn assert_balanced(at: &Value, state: &Value) {
    let inertial = product(&at["mass_matrix"], &vector(&at["acceleration"]));
    let bias = match &at["coriolis_matrix"] {
        Value::Null => vector(&at["bias_force"]),
        coriolis => {
            let gravity = vector(&at["gravity_force"]);
            let coriolis = product(coriolis, &vector(&state["v"]));
            coriolis.iter().zip(&gravity).map(|(c, g)| c + g).collect()
        }
    };
    for ((inertial, bias), tau) in inertial.iter().zip(&bias).zip(vector(&state["tau"])) {
        assert!((inertial + bias - tau).abs() < 1e-12, "{at}");
    }
}

/// T = −m c² √(1 − v²/c²): M = γ³ m, 1.5396 kg at v = c/2.
#[test]
fn the_mass_of_a_relativistic_body_is_that_at_its_speed() {
    let model = "lagrangian = { coordinates = ['x'], kinetic = '-m*c^2*sqrt(1 - x_dot^2/c^2)', potential = '0.5*x^2', \
                 parameters = { m = 1.0, c = 3.0 } }";
    let state = json!({ "q": [0.3], "v": [1.5], "tau": [0.7] });
    let at = dynamics(model, &state);
    let mass = at["mass_matrix"][0][0].as_f64().unwrap();
    assert!((mass - 0.75_f64.powf(-1.5)).abs() < 1e-14, "{mass}");
    assert_balanced(&at, &state);
}

#[test]
fn the_equations_balance_where_the_energy_has_fourth_powers() {
    let model = "lagrangian = { coordinates = ['x', 'y'], potential = 'cos(x)*y', \
                 kinetic = '0.5*x_dot^2 + 0.25*x_dot^4 + 0.5*(1 + x^2)*y_dot^2 + 0.1*x_dot^2*y_dot^2' }";
    let state = json!({ "q": [0.3, 0.2], "v": [1.5, -0.7], "tau": [0.1, 0.2] });
    let at = dynamics(model, &state);
    // 1 + 3 ẋ² + 0.2 ẏ²
    let mass = at["mass_matrix"][0][0].as_f64().unwrap();
    assert!((mass - 7.848).abs() < 1e-14, "{mass}");
    assert_balanced(&at, &state);
    assert!(at.get("no_coriolis_matrix").is_none(), "{at}");
}

/// Foucault's pendulum: its force is linear in the velocities and has no Christoffel matrix.
#[test]
fn a_force_that_no_coriolis_matrix_gives_is_said_to_be_one() {
    let model = "lagrangian = { coordinates = ['x', 'y'], potential = '5*(x^2 + y^2)', \
                 kinetic = '0.5*(x_dot^2 + y_dot^2) + 0.1*(x*y_dot - y*x_dot)' }";
    let state = json!({ "q": [0.3, 0.2], "v": [1.5, -0.7], "tau": [0.1, 0.2] });
    let at = dynamics(model, &state);
    assert!(at["coriolis_matrix"].is_null(), "{at}");
    let why = at["no_coriolis_matrix"].as_str().unwrap();
    assert!(
        why.contains("T is not quadratic in v") && why.contains("bias_force"),
        "{why}"
    );
    assert_balanced(&at, &state);
}

/// What `check` says on stderr, and whether it passes.
fn checked(kinetic: &str) -> (bool, String) {
    let dir = tempfile::tempdir().unwrap();
    let model = format!(
        "[lagrangian]\ncoordinates = ['x', 'theta']\npotential = 'x^2 - cos(theta)'\nkinetic = '{kinetic}'\nparameters = {{ M = 1.0 }}\n"
    );
    std::fs::write(dir.path().join("m.toml"), model).unwrap();
    let output = pinode(&["check", "m.toml"], dir.path());
    (output.status.success(), stderr(&output))
}

#[test]
fn a_forgotten_square_in_t_is_refused_with_its_coordinate() {
    let (passes, told) = checked("0.5*M*x_dot + 0.5*theta_dot^2");
    assert!(!passes);
    for part in [
        "m.toml:2:16",
        "`x` moves no mass",
        "first power only",
        "0.5*m*x_dot^2",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    // A mass at speed alone, and forces that turn velocities, are no slips.
    for kinetic in [
        "0.5*M*x_dot^4 + 0.5*theta_dot^2",
        "0.5*M*x_dot^2 + x*theta_dot + 0.5*theta_dot^2",
    ] {
        assert!(checked(kinetic).0, "{kinetic}");
    }
}

/// A heavy top's angles at θ = 0, where spin and precession are one motion.
#[test]
fn a_singular_mass_matrix_names_the_coordinate_and_where_to_begin() {
    let dir = tempfile::tempdir().unwrap();
    let model = "lagrangian = { coordinates = ['phi', 'theta', 'psi'], potential = 'cos(theta)', \
                 kinetic = '(phi_dot*sin(theta))^2 + theta_dot^2 + (psi_dot + phi_dot*cos(theta))^2' }";
    std::fs::write(dir.path().join("m.toml"), model).unwrap();
    let output = pinode(&["simulate", "m.toml", "--out", "o.csv"], dir.path());
    let told = stderr(&output);
    assert!(!output.status.success());
    assert!(
        told.contains("that of `psi`, moves no mass there"),
        "{told}"
    );
    assert!(
        told.contains("where other configurations have an acceleration, start from one"),
        "{told}"
    );
}
