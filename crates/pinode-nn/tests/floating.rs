//! Models whose base floats, and planar joints: from the model file to the trajectory.
#![cfg(feature = "cli")]

use std::path::Path;
use std::process::{Command, Output};

use nalgebra::{DMatrix, DVector, Quaternion, UnitQuaternion, Vector3};
use pinode_nn::Error;
use pinode_nn::free_run::{Scheme, simulate, simulate_by};
use pinode_nn::model::Model;
use serde_json::{Value, json};

/// A body with three different moments of inertia, about its own origin.
const STONE: &str = "<robot name='stone'><link name='stone'><inertial><mass value='2'/>
  <inertia ixx='0.03' iyy='0.05' izz='0.07' ixy='0.004' ixz='-0.002' iyz='0.003'/></inertial></link></robot>";

/// A trunk with four legs of two joints each.
fn quadruped() -> String {
    let mut text = "<robot name='quadruped'><link name='trunk'><inertial><mass value='4'/><origin xyz='0.02 -0.01 0.03'/>
      <inertia ixx='0.03' iyy='0.06' izz='0.07' ixy='0' ixz='0.001' iyz='0'/></inertial></link>"
        .to_owned();
    for (name, x, y) in [
        ("lf", 0.2, 0.1),
        ("rf", 0.2, -0.1),
        ("lh", -0.2, 0.1),
        ("rh", -0.2, -0.1),
    ] {
        for (part, parent, place, mass) in [
            ("thigh", "trunk".to_owned(), format!("{x} {y} 0"), 0.5),
            (
                "shank",
                format!("{name}_thigh"),
                "0 0.02 -0.2".to_owned(),
                0.3,
            ),
        ] {
            text += &format!(
                "<link name='{name}_{part}'><inertial><origin xyz='0.01 0 -0.1'/><mass value='{mass}'/>
                 <inertia ixx='0.002' iyy='0.002' izz='0.0004' ixy='0' ixz='0' iyz='0'/></inertial></link>
                 <joint name='{name}_{part}' type='continuous'><origin xyz='{place}'/><parent link='{parent}'/>
                 <child link='{name}_{part}'/><axis xyz='0 1 0'/></joint>"
            );
        }
    }
    text + "</robot>"
}

/// A puck on a table that carries a pendulum.
const PUCK: &str = "<robot name='puck'><link name='table'/>
  <link name='puck'><inertial><mass value='1'/><inertia ixx='0.01' iyy='0.01' izz='0.02' ixy='0' ixz='0' iyz='0'/></inertial></link>
  <joint name='slide' type='planar'><parent link='table'/><child link='puck'/><axis xyz='0 0 1'/></joint>
  <link name='bob'><inertial><origin xyz='0 0 -0.3'/><mass value='0.2'/>
    <inertia ixx='0.001' iyy='0.001' izz='0.001' ixy='0' ixz='0' iyz='0'/></inertial></link>
  <joint name='swing' type='continuous'><parent link='puck'/><child link='bob'/><axis xyz='0 1 0'/></joint></robot>";

/// A folder with a model `m.toml` of the given URDF.
fn folder(urdf: &str, model: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("robot.urdf"), urdf).unwrap();
    let text = format!("urdf = 'robot.urdf'\n{model}");
    std::fs::write(dir.path().join("m.toml"), text).unwrap();
    dir
}

fn load(dir: &tempfile::TempDir) -> Model {
    Model::load(&dir.path().join("m.toml")).unwrap_or_else(|e| panic!("{e}"))
}

fn pinode(dir: &tempfile::TempDir, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pinode"))
        .current_dir(dir.path())
        .args(arguments)
        .output()
        .unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn printed(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// `pinode dynamics` at these states.
fn dynamics(dir: &tempfile::TempDir, states: &Value, more: &[&str]) -> Output {
    let document = json!({ "states": states }).to_string();
    std::fs::write(dir.path().join("states.json"), document).unwrap();
    pinode(
        dir,
        &[&["dynamics", "m.toml", "states.json"], more].concat(),
    )
}

/// Header and numbers of a CSV file.
fn csv(path: &Path) -> (String, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap().to_owned();
    let numbers = |line: &str| line.split(',').map(|x| x.parse().unwrap()).collect();
    (header, lines.map(numbers).collect())
}

#[test]
fn check_says_what_a_pose_and_a_planar_joint_are_made_of() {
    let stone = folder(STONE, "base = 'floating'");
    let output = pinode(&stone, &["check", "m.toml"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.contains("base [m, 1] pose: in q position x y z"),
        "{text}"
    );
    let document = printed(&pinode(&stone, &["check", "--json", "m.toml"]));
    let base = &document["coordinates"][0];
    assert_eq!((&base["nq"], &base["nv"]), (&json!(7), &json!(6)));
    assert_eq!(
        (&document["pose"], &document["roll_axis"]),
        (&json!("quaternion"), &json!(null))
    );

    let stone = folder(STONE, "base = 'floating'\npose = 'angles'\nroll_axis = 'y'");
    let output = pinode(&stone, &["check", "m.toml"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.contains("roll about the y axis of the body (`roll_axis`)"),
        "{text}"
    );
    let document = printed(&pinode(&stone, &["check", "--json", "m.toml"]));
    assert_eq!(
        (&document["pose"], &document["roll_axis"]),
        (&json!("angles"), &json!("y"))
    );

    let puck = folder(PUCK, "");
    assert_eq!(
        printed(&pinode(&puck, &["check", "--json", "m.toml"]))["pose"],
        json!(null)
    );
    let output = pinode(&puck, &["check", "m.toml"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for words in [
        "slide.x [m] of joint slide",
        "slide.theta [rad, wraps] of joint slide",
        "swing [rad, wraps]\n",
        "slide: planar, table -> puck",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
}

#[test]
fn a_planar_joint_is_driven_by_the_names_of_its_coordinates() {
    let model = "[[input]]\nname = 'push'\njoint = 'slide.y'\n[[effect]]\nkind = 'viscous_friction'\njoint = 'slide.theta'\ncoefficient = 0.5\n[sensor.'slide.x']\nzero = 0.1\n[tolerance.zero]\n'slide.y' = 0.02\n[log.columns]\n'q.slide.x' = 'puck_x'\n";
    let model = load(&folder(PUCK, model));
    assert_eq!(model.inputs[0].coordinate(), Some(1));
    assert_eq!(model.target_name(model.effects[0].target), "slide.theta");
    assert!(model.target_is_angular(model.effects[0].target));
    assert_eq!((model.sensors.len(), model.sensors[0].zero), (4, 0.1));
    assert_eq!(model.tolerance.zero[1], Some(0.02));

    let faulty = folder(PUCK, "[[input]]\nname = 'push'\njoint = 'slide'\n");
    let Err(Error::Problems(problems)) = Model::load(&faulty.path().join("m.toml")) else {
        panic!("accepted");
    };
    let message = problems.to_string();
    assert!(
        message.contains(
            "m.toml:4:9: joint `slide` has the coordinates slide.x, slide.y, slide.theta: name one"
        ),
        "{message}"
    );
}

#[test]
fn dynamics_takes_poses_of_seven_numbers_and_names_what_is_wrong_with_them() {
    let dir = folder(&quadruped(), "base = 'floating'");
    let (mut q, v, tau) = (vec![0.0; 15], vec![0.1; 14], vec![0.0; 14]);
    q[3] = 1.0;
    let mut long = q.clone();
    long[3] = 1.001;
    let states = json!([
        { "q": v, "v": v, "tau": tau },
        { "q": q, "v": q, "tau": tau },
        { "q": long, "v": v, "tau": tau },
        { "q": vec![0.0; 15], "v": v, "tau": tau },
    ]);
    let output = dynamics(&dir, &states, &[]);
    assert_eq!(output.status.code(), Some(1));
    let message = stderr(&output);
    for words in [
        "states[0].q has 14 entries, the model takes 15: base (7 entries), lf_thigh, lf_shank",
        "states[1].v has 15 entries, the model takes 14: base (6 entries), lf_thigh",
        "states[2].q[3..=6], the quaternion w x y z of `base`, has length 1.001: it must be 1",
        "states[3].q[3..=6], the quaternion w x y z of `base`, has length 0",
    ] {
        assert!(message.contains(words), "no {words:?} in\n{message}");
    }

    // Within the tolerance it is made of length 1.
    let mut near = q.clone();
    near[3] = 1.0 + 5e-7;
    let states = json!([{ "q": q, "v": v, "tau": tau }, { "q": near, "v": v, "tau": tau }]);
    let document = printed(&dynamics(&dir, &states, &[]));
    assert_eq!(document["states"][0], document["states"][1]);
    let base = &document["coordinates"][0];
    assert_eq!(
        base,
        &json!({ "name": "base", "joint": "base", "nq": 7, "nv": 6, "unit": "m, 1" })
    );
    assert_eq!(document["coordinates"][8]["nq"], 1);
    assert!(document["states"][0].get("acceleration_by_q").is_none());
}

fn matrix(value: &Value) -> DMatrix<f64> {
    let rows = value.as_array().unwrap();
    DMatrix::from_fn(rows.len(), rows[0].as_array().unwrap().len(), |i, j| {
        value[i][j].as_f64().unwrap()
    })
}

fn vector(value: &Value) -> DVector<f64> {
    let list = value.as_array().unwrap().iter();
    DVector::from_iterator(list.len(), list.map(|x| x.as_f64().unwrap()))
}

#[test]
fn derivatives_of_the_acceleration_are_its_differences_along_the_velocities() {
    let dir = folder(&quadruped(), "base = 'floating'");
    let model = load(&dir);
    let coordinates = model.mechanics.coordinates();
    let turn = UnitQuaternion::from_euler_angles(0.3, -0.7, 1.9);
    let mut q = vec![0.3, -0.2, 0.5, turn.w, turn.i, turn.j, turn.k];
    q.extend((0..8).map(|i| 0.9 * f64::from(i).sin()));
    let v: Vec<f64> = (0..14).map(|i| (1.3 * f64::from(i)).cos()).collect();
    let tau: Vec<f64> = (0..14).map(|i| (0.7 * f64::from(i)).sin()).collect();
    let h = 1e-5;
    let mut states = vec![json!({ "q": q, "v": v, "tau": tau })];
    for j in 0..14 {
        for sign in [1.0, -1.0] {
            let mut step = vec![0.0; 14];
            step[j] = sign * h;
            let moved = lagrange::state::integrate(coordinates, &q, &step).unwrap();
            states.push(json!({ "q": moved, "v": v, "tau": tau }));
            let faster: Vec<f64> = v.iter().zip(&step).map(|(v, s)| v + s).collect();
            states.push(json!({ "q": q, "v": faster, "tau": tau }));
        }
    }
    let document = printed(&dynamics(&dir, &json!(states), &["--derivatives"]));
    let at = &document["states"];
    let acceleration = |k: usize| vector(&at[k]["acceleration"]);
    for (first, key) in [(1, "acceleration_by_q"), (2, "acceleration_by_v")] {
        let exact = matrix(&at[0][key]);
        for j in 0..14 {
            let (up, down) = (4 * j + first, 4 * j + first + 2);
            let difference = (acceleration(up) - acceleration(down)) / (2.0 * h);
            let error = (difference - exact.column(j)).amax();
            assert!(error < 1e-6 * exact.amax(), "{key} column {j}: {error:e}");
        }
    }
    let identity = matrix(&at[0]["acceleration_by_tau"]) * matrix(&at[0]["mass_matrix"]);
    assert!((identity - DMatrix::identity(14, 14)).amax() < 1e-10);
    // C v is what the bias force has beside G.
    let coriolis = matrix(&at[0]["coriolis_matrix"]) * DVector::from_vec(v);
    let rest = vector(&at[0]["bias_force"]) - vector(&at[0]["gravity_force"]);
    assert!((coriolis - &rest).amax() < 1e-11 * rest.amax());
}

#[test]
fn a_thrown_spinning_stone_keeps_its_energy_and_its_angular_momentum() {
    let dir = folder(STONE, "base = 'floating'");
    // The quaternion is given twice as long as it should be.
    let output = pinode(
        &dir,
        &[
            "simulate",
            "m.toml",
            "--initial",
            "0,0,1,1.2,0,1.6,0,1,0.5,3,4,-7,5",
            "--duration",
            "1",
            "--sample",
            "0.05",
            "--step",
            "5e-4",
            "--out",
            "t.csv",
        ],
    );
    assert!(output.status.success(), "{}", stderr(&output));
    let (header, rows) = csv(&dir.path().join("t.csv"));
    assert_eq!(
        header,
        "t,q.base.x,q.base.y,q.base.z,q.base.qw,q.base.qx,q.base.qy,q.base.qz,v.base.vx,v.base.vy,v.base.vz,v.base.wx,v.base.wy,v.base.wz"
    );
    assert_eq!(rows.len(), 21);
    let inertia = nalgebra::matrix![0.03, 0.004, -0.002; 0.004, 0.05, 0.003; -0.002, 0.003, 0.07];
    let of = |row: &[f64]| {
        let quaternion = Quaternion::new(row[4], row[5], row[6], row[7]);
        assert!((quaternion.norm() - 1.0).abs() < 1e-14);
        let turn = UnitQuaternion::new_unchecked(quaternion);
        let (v, w) = (
            Vector3::from_row_slice(&row[8..11]),
            Vector3::from_row_slice(&row[11..14]),
        );
        let energy = v.norm_squared() + 0.5 * w.dot(&(inertia * w)) + 2.0 * 9.81 * row[3];
        (energy, turn * (inertia * w), turn * v)
    };
    let (energy, momentum, velocity) = of(&rows[0]);
    for row in &rows {
        let (e, l, v) = of(row);
        assert!(
            (e - energy).abs() < 1e-9 * energy,
            "{}: {:e}",
            row[0],
            e - energy
        );
        assert!(
            (l - momentum).norm() < 1e-8 * momentum.norm(),
            "{}: {l}",
            row[0]
        );
        // It flies a parabola.
        let t = row[0];
        let free = velocity - Vector3::z() * (9.81 * t);
        assert!((v - free).norm() < 1e-7, "{t}: {v}");
        let height = 1.0 + velocity.z * t - 0.5 * 9.81 * t * t;
        assert!((row[3] - height).abs() < 1e-8, "{t}: {}", row[3] - height);
    }
    // It does tumble.
    let first = UnitQuaternion::new_unchecked(Quaternion::new(
        rows[0][4], rows[0][5], rows[0][6], rows[0][7],
    ));
    let fifth = UnitQuaternion::new_unchecked(Quaternion::new(
        rows[4][4], rows[4][5], rows[4][6], rows[4][7],
    ));
    assert!(first.angle_to(&fifth) > 0.5);
}

#[test]
fn a_falling_quadruped_keeps_its_energy_to_the_fourth_order_of_the_step() {
    let model = load(&folder(&quadruped(), "base = 'floating'"));
    let turn = UnitQuaternion::from_euler_angles(0.4, 0.2, -0.8);
    let mut state = vec![0.0, 0.0, 1.0, turn.w, turn.i, turn.j, turn.k];
    state.extend([0.3, -0.9, 0.1, 0.8, -0.4, 0.6, 0.2, -0.5]);
    state.extend([0.4, -0.2, 0.9, 2.0, -3.0, 1.0]);
    state.extend([3.0, -4.0, 2.0, 5.0, -3.0, 1.0, -2.0, 4.0]);
    let error = |h: f64| {
        let t: Vec<f64> = (0..=20).map(|k| 0.02 * f64::from(k)).collect();
        let states = simulate(&model, "0", &t, &[], &state, h).unwrap();
        let energy = |state: &[f64]| {
            let (q, v) = state.split_at(model.mechanics.nq());
            model.mechanics.total_energy(q, v).unwrap()
        };
        let first = energy(&states[0]);
        let off = states.iter().map(|state| (energy(state) - first).abs());
        off.fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(2e-3), error(1e-3));
    let order = (coarse / fine).log2();
    assert!(
        order > 3.5,
        "{coarse:e} with 2 ms, {fine:e} with 1 ms: order {order}"
    );
    assert!(fine < 1e-8, "{fine:e} J");
}

#[test]
fn an_input_and_a_friction_behind_a_floating_base_act_on_their_own_joint() {
    let model = "base = 'floating'\n[[input]]\nname = 'knee'\njoint = 'rh_shank'\ngain = 2.0\n[[effect]]\nkind = 'viscous_friction'\njoint = 'lf_thigh'\ncoefficient = 0.3\n";
    let model = load(&folder(&quadruped(), model));
    let mechanics = &model.mechanics;
    let mut state = lagrange::state::neutral(mechanics.coordinates());
    state.resize(29, 0.0);
    state[15 + 6] = 1.5;
    let h = 1e-6;
    let states = simulate(&model, "0", &[0.0, h], &[vec![0.7; 2]], &state, h).unwrap();
    let mut force = vec![0.0; 14];
    force[13] = 2.0 * 0.7;
    force[6] = -0.3 * 1.5;
    let (q, v) = state.split_at(15);
    let expected = mechanics.forward_dynamics(q, v, &force).unwrap();
    for (i, a) in expected.iter().enumerate() {
        let found = (states[1][15 + i] - v[i]) / h;
        assert!(
            (found - a).abs() < 1e-3 * expected.amax(),
            "{i}: {found} and {a}"
        );
    }
}

#[test]
fn a_log_without_its_pose_is_told_the_columns_and_the_library_refuses_poses_in_fits() {
    let dir = folder(STONE, "base = 'floating'");
    std::fs::write(dir.path().join("log.csv"), "t,q.base\n0,0\n").unwrap();
    for arguments in [
        &["evaluate", "m.toml", "log.csv"][..],
        &["diagnose", "m.toml", "log.csv", "--out", "out"],
        &["simulate", "m.toml", "--log", "log.csv", "--out", "t.csv"],
    ] {
        let output = pinode(&dir, arguments);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        let message = stderr(&output);
        for words in [
            "column `q.base.x` is missing",
            "column `q.base.qz` is missing",
        ] {
            assert!(
                message.contains(words),
                "{arguments:?}: no {words:?} in\n{message}"
            );
        }
    }
    assert!(!dir.path().join("out").exists() && !dir.path().join("t.csv").exists());
    let model = load(&dir);
    let options = pinode_nn::evaluate::Options::default();
    let refused = pinode_nn::evaluate::evaluate(&model, &[], &options);
    let Err(refused @ Error::Floating { .. }) = refused else {
        panic!("{refused:?}");
    };
    let cure = "write it by angles (pose = \"angles\" in the model file";
    assert!(refused.to_string().contains(cure), "{refused}");
}

#[test]
fn an_initial_state_of_the_wrong_length_is_told_the_names() {
    let dir = folder(STONE, "base = 'floating'");
    for (initial, words) in [
        (
            "0,0,0",
            "3 numbers are given, the state has 13: q.base.x,q.base.y,q.base.z,q.base.qw",
        ),
        ("0,0,0,0,0,0,0,0,0,0,0,0,0", "the quaternion of `base` is 0"),
    ] {
        let output = pinode(
            &dir,
            &["simulate", "m.toml", "--initial", initial, "--out", "t.csv"],
        );
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    }
    // Without one it starts unrotated in the origin.
    let output = pinode(
        &dir,
        &["simulate", "m.toml", "--duration", "0.02", "--out", "t.csv"],
    );
    assert!(output.status.success(), "{}", stderr(&output));
    let (_, rows) = csv(&dir.path().join("t.csv"));
    assert_eq!(
        rows[0],
        [
            0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        ]
    );
}

#[test]
fn the_methods_of_simulate_agree_on_a_falling_quadruped() {
    let model = load(&folder(&quadruped(), "base = 'floating'"));
    let turn = UnitQuaternion::from_euler_angles(0.4, 0.2, -0.8);
    let mut state = vec![0.0, 0.0, 1.0, turn.w, turn.i, turn.j, turn.k];
    state.extend([0.3, -0.9, 0.1, 0.8, -0.4, 0.6, 0.2, -0.5]);
    state.extend([0.4, -0.2, 0.9, 2.0, -3.0, 1.0]);
    state.extend([3.0, -4.0, 2.0, 5.0, -3.0, 1.0, -2.0, 4.0]);
    let t: Vec<f64> = (0..=20).map(|k| 0.01 * f64::from(k)).collect();
    let by = |scheme| simulate_by(scheme, &model, "0", &t, &[], &state, 5e-4).unwrap();
    let rk4 = by(Scheme::Rk4);
    for (scheme, most) in [(Scheme::Variational, 1e-8), (Scheme::Heun, 1e-3)] {
        let other = by(scheme);
        assert_eq!(other.len(), 21);
        for (a, b) in rk4[20].iter().zip(&other[20]) {
            assert!((a - b).abs() < most, "{scheme:?}: {a} {b}");
        }
    }
}

#[test]
fn simulate_refuses_the_variational_method_under_constraints() {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let dir = tempfile::tempdir().unwrap();
    let model = models.join("four_bar/four_bar.toml");
    let arguments = [
        "simulate",
        model.to_str().unwrap(),
        "--out",
        "t.csv",
        "--duration",
        "0.1",
    ];
    let output = pinode(
        &dir,
        &[&arguments[..], &["--method", "variational"]].concat(),
    );
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("obeys 2 constraints"),
        "{}",
        stderr(&output)
    );
    assert!(!dir.path().join("t.csv").exists());
    let output = pinode(&dir, &[&arguments[..], &["--method", "heun"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
}

/// It was a singular mass matrix, or a force that grows without bound.
#[test]
fn a_simulation_that_comes_to_where_its_angles_fail_names_the_angle_and_the_cure() {
    // It pitches at 2 rad/s: up after 0.785 s. At rest there, it cannot even start.
    let ball = STONE.replace(
        "ixy='0.004' ixz='-0.002' iyz='0.003'",
        "ixy='0' ixz='0' iyz='0'",
    );
    let stone = folder(
        &ball,
        "base = 'floating'\npose = 'angles'\ngravity = [0.0, 0.0, 0.0]",
    );
    let up = std::f64::consts::FRAC_PI_2;
    let simulate = |initial: &str, more: &[&str]| {
        let initial = format!("--initial={initial}");
        let arguments = [
            "simulate",
            "m.toml",
            "--out",
            "t.csv",
            "--duration",
            "0.9",
            &initial,
        ];
        pinode(&stone, &[&arguments[..], more].concat())
    };
    let upright = format!("0,0,0,0,{up},0,0,0,0,0.1,0,0");
    for more in [
        &[][..],
        &["--method", "variational"],
        &["--method", "contacts"],
        &["--method", "adaptive"],
    ] {
        let failed = simulate(&upright, more);
        let said = stderr(&failed);
        assert_eq!(failed.status.code(), Some(1), "{said}");
        for words in [
            "`base.pitch` is 1.571 rad at t = 0 s",
            "the x axis of the body",
            "`roll_axis`",
            "quaternion",
        ] {
            assert!(said.contains(words), "no {words:?} in {said}");
        }
        assert!(!stone.path().join("t.csv").exists());
    }
    let passing = simulate("0,0,0,0,0,0.01,0,0,0,0,2,0", &[]);
    let said = stderr(&passing);
    assert!(
        said.contains("`base.pitch` is 1.5") && said.contains("is within 9° of the vertical"),
        "{said}"
    );
    let level = simulate("0,0,0,0,0,0.01,0,0,0,2,0,0", &[]);
    assert!(!stderr(&level).contains("vertical"), "{}", stderr(&level));
}
