//! `pinode dynamics` and `pinode simulate`, from a model file to printed numbers, against independent engines.

mod common {
    pub mod oracle;
}

use std::path::{Path, PathBuf};
use std::process::Command;

use common::oracle::{
    Agreement, Order, folder, from_sympy, json, numbers, on_a_chain_of_angles, texts,
};
use serde_json::{Value, json as object};

/// What the program prints; its arguments must be good.
fn pinode(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(arguments)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "pinode {}: {}",
        arguments.join(" "),
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// The output of `pinode dynamics` for `model` at `states`, which are written into `folder`.
fn dynamics(folder: &tempfile::TempDir, model: &Path, states: &[Value]) -> Value {
    let path = folder.path().join("states.json");
    std::fs::write(&path, object!({ "states": states }).to_string()).unwrap();
    let [model, states] = [model, &path].map(|p| p.to_str().unwrap());
    serde_json::from_str(&pinode(&["dynamics", model, states])).unwrap()
}

/// A model file in a folder of its own, and where the reference's coordinates stand in what the program prints.
struct Under {
    folder: tempfile::TempDir,
    model: PathBuf,
    order: Order,
}

impl Under {
    /// Writes the model, and lets the program say what its coordinates are.
    fn new(model: &str, files: &[(&str, &str)], dof_order: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let path = folder.path().join("model.toml");
        std::fs::write(&path, model).unwrap();
        let answer = dynamics(&folder, &path, &[]);
        let own: Vec<(String, usize, usize)> = answer["coordinates"]
            .as_array()
            .unwrap()
            .iter()
            .map(|c| {
                let [nq, nv] = ["nq", "nv"].map(|key| c[key].as_u64().unwrap() as usize);
                (c["name"].as_str().unwrap().to_owned(), nq, nv)
            })
            .collect();
        Under {
            folder,
            model: path,
            order: Order::new(&own, dof_order),
        }
    }

    /// Every quantity at every state, to 1e-9 of its largest entry.
    fn agrees_at(&self, states: &[Value], agreement: &mut Agreement) {
        let asked: Vec<Value> = states
            .iter()
            .map(|state| {
                let (v, tau) = (
                    self.order.vector(&state["v"]),
                    self.order.vector(&state["tau"]),
                );
                object!({ "q": self.order.position(state), "v": v, "tau": tau })
            })
            .collect();
        let answer = dynamics(&self.folder, &self.model, &asked);
        let found = answer["states"].as_array().unwrap();
        assert_eq!(found.len(), states.len());
        for (k, (expected, found)) in states.iter().zip(found).enumerate() {
            let place = format!("state {k}");
            let mut close = |what, found: &[f64], expected: &[f64]| {
                agreement.close(what, &place, found, expected, 1e-9);
            };
            let energy = |value: &Value| [value.as_f64().unwrap()];
            let vector = |key: &str| self.order.vector(&expected[key]);
            let (mass, coriolis) = (flat(&found["mass_matrix"]), flat(&found["coriolis_matrix"]));
            let [gravity, bias, acceleration] =
                ["gravity_force", "bias_force", "acceleration"].map(|key| numbers(&found[key]));
            close("M", &mass, &self.order.matrix(&expected["M"]));
            close("G", &gravity, &vector("G"));
            close("bias", &bias, &vector("bias"));
            if expected["C_christoffel"].is_array() {
                let expected = self.order.matrix(&expected["C_christoffel"]);
                close("C", &coriolis, &expected);
            }
            let v = vector("v");
            let product: Vec<f64> = coriolis
                .chunks(v.len())
                .map(|row| row.iter().zip(&v).map(|(c, v)| c * v).sum())
                .collect();
            let expected_product: Vec<f64> = if expected["Cv"].is_array() {
                vector("Cv")
            } else {
                vector("bias")
                    .iter()
                    .zip(vector("G"))
                    .map(|(b, g)| b - g)
                    .collect()
            };
            close("C v", &product, &expected_product);
            close("v̇", &acceleration, &vector("qdd"));
            close(
                "T",
                &energy(&found["kinetic_energy"]),
                &energy(&expected["KE"]),
            );
            close(
                "V",
                &energy(&found["potential_energy"]),
                &energy(&expected["PE"]),
            );
        }
    }

    /// The free motion by `pinode simulate`, to 1e-8 of the largest entry of the state.
    fn moves_along(&self, trajectory: &Value, agreement: &mut Agreement) {
        let times = numbers(&trajectory["t"]);
        let state = |k: usize| {
            let (q, v) = (&trajectory["q"][k], &trajectory["v"][k]);
            [self.order.vector(q), self.order.vector(v)].concat()
        };
        let initial: Vec<String> = state(0).iter().map(f64::to_string).collect();
        let out = self.folder.path().join("trajectory.csv");
        pinode(&[
            "simulate",
            self.model.to_str().unwrap(),
            "--initial",
            &initial.join(","),
            "--sample",
            &(times[1] - times[0]).to_string(),
            "--duration",
            &times[times.len() - 1].to_string(),
            "--step",
            "1e-4",
            "--out",
            out.to_str().unwrap(),
        ]);
        let rows = rows(&out);
        assert_eq!(rows.len(), times.len());
        for (k, (row, t)) in rows.iter().zip(&times).enumerate() {
            assert!((row[0] - t).abs() < 1e-12, "{} s is not {t} s", row[0]);
            let place = format!("at {t} s");
            agreement.close("trajectory", &place, &row[1..], &state(k), 1e-8);
        }
    }
}

/// The numbers of a matrix, row by row.
fn flat(rows: &Value) -> Vec<f64> {
    assert!(rows.is_array(), "no matrix: {rows}");
    let rows = rows.as_array().unwrap();
    rows.iter().flat_map(numbers).collect()
}

/// The numbers of a CSV file below its header.
fn rows(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let numbers = |line: &str| line.split(',').map(|x| x.parse().unwrap()).collect();
    text.lines().skip(1).map(numbers).collect()
}

/// A robot of the reference in one of its variants.
fn robot(robot: &str, variant: &str) {
    let Some(folder) = folder() else { return };
    let reference = json(&folder.join(format!("{robot}.json")));
    let mut urdf = std::fs::read_to_string(folder.join(format!("{robot}.urdf"))).unwrap();
    let (mut base, mut mimic) = ("fixed", "follow");
    match variant {
        "fixed" | "planar_coords" => mimic = "ignore",
        "mimic" | "planar_coords_mimic" => (),
        "floating_quat" => base = "floating",
        "floating_zyx" => urdf = on_a_chain_of_angles(&urdf, "base_link"),
        _ => panic!("unknown variant {variant}"),
    }
    let model = format!(
        "urdf = \"robot.urdf\"\nbase = \"{base}\"\nmimic = \"{mimic}\"\nurdf_dynamics = false\n"
    );
    let variant_data = &reference["variants"][variant];
    let under = Under::new(
        &model,
        &[("robot.urdf", &urdf)],
        &texts(&variant_data["dof_order"]),
    );
    let mut agreement = Agreement::of(format!("{robot}/{variant}"));
    let states = variant_data["states"].as_array().unwrap();
    assert_eq!(states.len(), 20);
    under.agrees_at(states, &mut agreement);
    if variant_data["trajectory_tau0"].is_object() {
        under.moves_along(&variant_data["trajectory_tau0"], &mut agreement);
    }
}

/// One test a variant, named after it.
macro_rules! robots {
    ($($(#[$mark:meta])* $test:ident: $robot:literal, $variant:literal;)*) => {
        $(
            #[test]
            $(#[$mark])*
            fn $test() {
                robot($robot, $variant);
            }
        )*
        /// Every variant of the reference has its test above.
        const VARIANTS: &[(&str, &str)] = &[$(($robot, $variant)),*];
    };
}

robots! {
    the_cart_pole_of_the_paper: "cartpole_roehrl2020", "fixed";
    the_cart_pole_of_pybullet: "cartpole_pybullet", "fixed";
    a_double_pendulum: "double_pendulum_continuous", "fixed";
    the_arm_iiwa: "kuka_iiwa", "fixed";
    the_arm_panda_with_free_fingers: "panda", "fixed";
    the_arm_panda: "panda", "mimic";
    the_arm_j2s6s200: "kinova_j2s6s200", "fixed";
    a_tree_with_a_planar_joint: "stress_tree", "planar_coords";
    a_tree_with_a_planar_joint_and_a_coupling: "stress_tree", "planar_coords_mimic";
    the_quadruped_solo12_held: "solo12", "fixed";
    the_quadruped_solo12: "solo12", "floating_quat";
    the_quadruped_solo12_on_a_chain_of_angles: "solo12", "floating_zyx";
    the_humanoid_talos_held: "talos_reduced", "fixed";
    the_humanoid_talos: "talos_reduced", "floating_quat";
    the_humanoid_talos_on_a_chain_of_angles: "talos_reduced", "floating_zyx";
    the_robot_pr2_without_its_couplings: "pr2", "fixed";
    the_robot_pr2: "pr2", "mimic";
}

#[test]
fn every_variant_of_the_reference_is_tested() {
    let Some(folder) = folder() else { return };
    let mut missing = Vec::new();
    for entry in folder.read_dir().unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "json") {
            continue;
        }
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        for variant in json(&path)["variants"]
            .as_object()
            .into_iter()
            .flat_map(|v| v.keys())
        {
            if !VARIANTS.contains(&(name.as_str(), variant.as_str())) {
                missing.push(format!("{name}/{variant}"));
            }
        }
    }
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn energies_as_text_give_the_closed_forms() {
    let Some(folder) = folder() else { return };
    for name in [
        "cartpole_table2",
        "double_pendulum",
        "triple_pendulum_relative",
        "spherical_pendulum",
        "furuta_pendulum",
        "elastic_pendulum",
    ] {
        let reference = json(&folder.join(format!("closed_{name}.json")));
        let coordinates: Vec<&str> = texts(&reference["coordinates"])
            .into_iter()
            .map(|c| c.trim_end_matches("(t)"))
            .collect();
        let mut model = format!(
            "[lagrangian]\ncoordinates = {coordinates:?}\nkinetic = \"{}\"\npotential = \"{}\"\n[lagrangian.parameters]\n",
            from_sympy(&reference["lagrangian"]["T"]),
            from_sympy(&reference["lagrangian"]["V"]),
        );
        for (name, value) in reference["parameters"].as_object().unwrap() {
            model += &format!("{name} = {value}\n");
        }
        let under = Under::new(&model, &[], &coordinates);
        let mut agreement = Agreement::of(name);
        under.agrees_at(reference["states"].as_array().unwrap(), &mut agreement);
    }
}
