//! Logs of bodies that float: a satellite with a reaction wheel, which has drag that the model lacks. Its log comes from Euler's equations, here:
//!
//! J ω̇ + A ẇ a = −ω × (J ω + A w a),  A (a·ω̇ + ẇ) = τ − drag(w)
//!
//! ω in the body's axes, J with the wheel in it, a the axis of the wheel, w its speed against the body, A its inertia about a.
#![cfg(feature = "cli")]

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use lagrange::mechanism::Axis;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use pinode_nn::log::Log;
use pinode_nn::model::Model;
use pinode_nn::poses::by_angles;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::Value;

/// Of the body, kg·m², about its centre of mass, which the wheel stands in.
const BODY: [f64; 3] = [0.16, 0.20, 0.12];
/// Of the wheel, about its axis and across.
const WHEEL: [f64; 2] = [0.02, 0.011];
/// m and rad.
const NOISE: [f64; 2] = [1e-3, 5e-4];
const DRAG: f64 = 2e-4;

/// Its axis in the body.
fn axis() -> Vector3<f64> {
    Vector3::new(0.0, 0.6, 0.8)
}

struct State {
    turn: UnitQuaternion<f64>,
    w: Vector3<f64>,
    wheel: f64,
    angle: f64,
}

/// (ω̇, ẇ).
fn accelerations(w: Vector3<f64>, wheel: f64, torque: f64) -> (Vector3<f64>, f64) {
    let a = axis();
    let own = a * a.transpose();
    let of_wheel = own * WHEEL[0] + (Matrix3::identity() - own) * WHEEL[1];
    let j = Matrix3::from_diagonal(&Vector3::from(BODY)) + of_wheel;
    let on_body = -w.cross(&(j * w + a * (WHEEL[0] * wheel)));
    let on_wheel = torque - DRAG * wheel.abs() * wheel;
    // ẇ = on_wheel/A − a·ω̇ in the first equation.
    let left = j - own * WHEEL[0];
    let of_body = left.try_inverse().unwrap() * (on_body - a * on_wheel);
    (of_body, on_wheel / WHEEL[0] - a.dot(&of_body))
}

fn step(x: &mut State, torque: f64, h: f64) {
    let slope = |turn: Quaternion<f64>, w: Vector3<f64>, wheel: f64| {
        let (dw, dwheel) = accelerations(w, wheel, torque);
        (turn * Quaternion::from_imag(w) * 0.5, dw, dwheel, wheel)
    };
    let at = |by: f64, k: &(Quaternion<f64>, Vector3<f64>, f64, f64)| {
        slope(*x.turn + k.0 * by, x.w + k.1 * by, x.wheel + k.2 * by)
    };
    let a = slope(*x.turn, x.w, x.wheel);
    let b = at(0.5 * h, &a);
    let c = at(0.5 * h, &b);
    let d = at(h, &c);
    let s = h / 6.0;
    x.turn = UnitQuaternion::new_normalize(*x.turn + (a.0 + b.0 * 2.0 + c.0 * 2.0 + d.0) * s);
    x.w += (a.1 + b.1 * 2.0 + c.1 * 2.0 + d.1) * s;
    x.angle += s * (a.3 + 2.0 * b.3 + 2.0 * c.3 + d.3);
    x.wheel += s * (a.2 + 2.0 * b.2 + 2.0 * c.2 + d.2);
}

/// 60 s at 50 Hz, the torque held; it drifts along at a steady speed.
fn log(spin: Vector3<f64>) -> String {
    let mut draws = ChaCha8Rng::seed_from_u64(11);
    let mut noise = |sigma: f64| -> f64 {
        let x: f64 = StandardNormal.sample(&mut draws);
        sigma * x
    };
    let mut x = State {
        turn: UnitQuaternion::from_euler_angles(0.2, -0.1, 0.4),
        w: spin,
        wheel: 0.0,
        angle: 0.0,
    };
    let mut text = String::from(
        "t,q.base.x,q.base.y,q.base.z,q.base.qw,q.base.qx,q.base.qy,q.base.qz,q.wheel,u.motor\n",
    );
    for k in 0..3000 {
        let t = 0.02 * f64::from(k);
        let torque = 0.03 * (0.9 * t).sin() + 0.03 * (2.3 * t).cos();
        let place = [0.2 * t, 1.0 - 0.1 * t, 0.05 * t].map(|p| p + noise(NOISE[0]));
        let small = Vector3::from_fn(|_, _| noise(NOISE[1]));
        let turn = x.turn * UnitQuaternion::from_scaled_axis(small);
        write!(text, "{t:.3}").unwrap();
        for number in place.into_iter().chain([turn.w, turn.i, turn.j, turn.k]) {
            write!(text, ",{number:.9}").unwrap();
        }
        writeln!(text, ",{:.9},{torque:.9}", x.angle + noise(NOISE[1])).unwrap();
        for _ in 0..20 {
            step(&mut x, torque, 1e-3);
        }
    }
    text
}

fn satellite(folder: &Path) -> PathBuf {
    let [x, y, z] = BODY;
    // The wheel's frame has z along its axis: turned about x.
    let roll = -(0.6_f64).atan2(0.8);
    let [about, across] = WHEEL;
    let urdf = format!(
        r#"<robot name="satellite">
  <link name="body"><inertial><mass value="8"/><inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/></inertial></link>
  <link name="rotor"><inertial><mass value="1"/><inertia ixx="{across}" ixy="0" ixz="0" iyy="{across}" iyz="0" izz="{about}"/></inertial></link>
  <joint name="wheel" type="continuous"><parent link="body"/><child link="rotor"/><origin rpy="{roll} 0 0"/><axis xyz="0 0 1"/></joint>
</robot>"#
    );
    let model = "urdf = \"satellite.urdf\"\nbase = \"floating\"\ngravity = [0.0, 0.0, 0.0]\n[[input]]\nname = \"motor\"\njoint = \"wheel\"\n";
    std::fs::write(folder.join("satellite.urdf"), urdf).unwrap();
    let path = folder.join("satellite.toml");
    std::fs::write(&path, model).unwrap();
    path
}

fn pinode(arguments: &[&Path]) -> (Value, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(arguments)
        .arg("--json")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    (serde_json::from_slice(&output.stdout).unwrap(), said)
}

#[test]
fn drag_on_the_wheel_of_a_satellite_is_found_in_a_log_of_its_pose() {
    let dir = tempfile::tempdir().unwrap();
    let model = satellite(dir.path());
    let path = dir.path().join("log.csv");
    // It turns about its vertical axis, and nods.
    std::fs::write(&path, log(Vector3::new(0.05, -0.1, 0.4))).unwrap();
    let out = dir.path().join("out");
    let arguments = ["diagnose".as_ref(), &*model, &path, "--out".as_ref(), &out];
    let (diagnosis, _) = pinode(&arguments);
    let effects = diagnosis["effects"].as_array().unwrap();
    let [drag] = &effects[..] else {
        panic!("{effects:#?}");
    };
    assert_eq!(
        (&drag["kind"], &drag["target"]),
        (&"quadratic_drag".into(), &"wheel".into())
    );
    let value = drag["parameters"]["coefficient"]["value"].as_f64().unwrap();
    assert!((value / DRAG - 1.0).abs() < 0.03, "{value:e}");
    let gap = &diagnosis["gap"];
    assert!(gap["after"].as_f64().unwrap() < 4.0, "{gap}");
    let names: Vec<&str> = gap["coordinates"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        names[..6],
        [
            "q.base.x",
            "q.base.y",
            "q.base.z",
            "q.base.yaw",
            "q.base.pitch",
            "q.base.roll"
        ]
    );

    // The new model says how its pose is written, and reads the log of poses.
    let written = out.join("model.toml");
    let text = std::fs::read_to_string(&written).unwrap();
    assert!(
        text.contains("pose = \"angles\"") && text.contains("quadratic_drag"),
        "{text}"
    );
    let (before, after) = (wheel_error(&model, &path), wheel_error(&written, &path));
    assert!(after < 0.5 * before, "{before} {after}");
}

/// Of free runs of 3 s, rad.
fn wheel_error(model: &Path, log: &Path) -> f64 {
    let how = "--initial estimated --horizon 3 --windows 50".split(' ');
    let how: Vec<&Path> = how.map(Path::new).collect();
    let (found, _) = pinode(&[&["evaluate".as_ref(), model, log][..], &how].concat());
    let all = found["coordinates"].as_array().unwrap();
    let wheel = all.iter().find(|c| c["name"] == "q.wheel").unwrap();
    wheel["rmse"].as_f64().unwrap()
}

/// Rolled out from the measured pose, by quaternions: the trajectory is a log again.
#[test]
fn a_floating_model_is_simulated_along_a_log() {
    let dir = tempfile::tempdir().unwrap();
    let model = satellite(dir.path());
    let (path, out) = (
        dir.path().join("log.csv"),
        dir.path().join("trajectory.csv"),
    );
    std::fs::write(&path, log(Vector3::new(0.05, -0.1, 0.4))).unwrap();
    // The trajectory is what the sensors read: it starts where the log does, whatever their zeros.
    let zero = "[sensor.wheel]\nzero = 0.3\n";
    let text = std::fs::read_to_string(&model).unwrap();
    std::fs::write(&model, text + zero).unwrap();
    let duration: [&Path; 2] = ["--duration".as_ref(), "2".as_ref()];
    pinode(&[
        "simulate".as_ref(),
        &*model,
        "--log".as_ref(),
        &path,
        "--out".as_ref(),
        &out,
        duration[0],
        duration[1],
    ]);
    let rows = |path: &Path| -> (Vec<String>, Vec<Vec<f64>>) {
        let text = std::fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let header = lines
            .next()
            .unwrap()
            .split(',')
            .map(str::to_owned)
            .collect();
        let numbers = |line: &str| line.split(',').map(|x| x.parse().unwrap()).collect();
        (header, lines.map(numbers).collect())
    };
    let ((names, simulated), (measured_names, measured)) = (rows(&out), rows(&path));
    let column = |names: &[String], name: &str| names.iter().position(|n| n == name).unwrap();
    let starts = [(&names, &simulated), (&measured_names, &measured)];
    let [simulated_start, measured_start] = starts.map(|(n, rows)| rows[0][column(n, "q.wheel")]);
    assert!(
        (simulated_start - measured_start).abs() < 1e-6,
        "{simulated_start} {measured_start}"
    );
    for (name, most) in [("q.base.x", 0.3), ("q.base.qw", 0.1), ("q.base.qz", 0.1)] {
        let (i, j) = (column(&names, name), column(&measured_names, name));
        let apart = (simulated[100][i] - measured[100][j]).abs();
        // A velocity from two positions of 1 mm of noise is 0.07 m/s off, from two angles of 0.5 mrad 0.035 rad/s.
        assert!(apart < most, "{name}: {apart}");
    }
    assert!(names.contains(&"v.base.wz".to_owned()));
}

#[test]
fn where_a_tumbling_body_is_upright_in_its_angles_the_log_is_cut_and_that_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let model = satellite(dir.path());
    let path = dir.path().join("log.csv");
    std::fs::write(&path, log(Vector3::new(0.9, 0.5, 0.7))).unwrap();
    let (evaluation, said) = pinode(&["evaluate".as_ref(), &*model, &path]);
    assert!(
        said.contains("samples are left out, and recordings cut there"),
        "{said}"
    );
    assert!(evaluation["windows"].as_f64().unwrap() > 500.0);
}

#[test]
fn a_quaternion_that_is_none_is_refused_with_run_and_time() {
    let dir = tempfile::tempdir().unwrap();
    let model = satellite(dir.path());
    let path = dir.path().join("log.csv");
    let text = log(Vector3::new(0.05, -0.1, 0.4));
    let wrong = text
        .replacen("q.base.qw", "q.base.wq", 1)
        .replacen("q.base.x,", "q.base.qw,", 1)
        .replacen("q.base.wq", "q.base.x", 1);
    std::fs::write(&path, wrong).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_pinode"))
        .args(["evaluate".as_ref(), &*model, &*path])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains("run `0` at t = 0 s: the quaternion of `base` has the length"),
        "{said}"
    );
    assert!(
        said.contains("\nand 29") || said.contains(" and 29"),
        "{said}"
    );
}

/// The drag of the wheel, learnt by a network from a log of the pose: the new model reads such logs too.
#[test]
fn a_network_beside_a_floating_body_learns_from_a_log_of_its_pose() {
    let dir = tempfile::tempdir().unwrap();
    let model = satellite(dir.path());
    let path = dir.path().join("log.csv");
    std::fs::write(&path, log(Vector3::new(0.05, -0.1, 0.4))).unwrap();
    let out = dir.path().join("learnt");
    let how = "--joint wheel --sees v.wheel --units 8 --epochs 80 --out";
    let how: Vec<&Path> = how.split(' ').map(Path::new).collect();
    let (trained, _) = pinode(&[&["train".as_ref(), &*model, &path][..], &how, &[&out]].concat());
    let loss = |key: &str| trained[key].as_f64().unwrap();
    assert!(
        loss("held_out") < loss("held_out_without_network"),
        "{trained}"
    );
    let written = out.join("model.toml");
    let text = std::fs::read_to_string(&written).unwrap();
    assert!(text.contains("pose = \"angles\""), "{text}");
    let (before, after) = (wheel_error(&model, &path), wheel_error(&written, &path));
    assert!(after < 0.6 * before, "{before} {after}");
}

/// A circle to the left at 2 m/s, nose ahead, with the velocities of the body in its own axes.
#[test]
fn measured_velocities_of_a_body_become_rates_of_its_angles() {
    let dir = tempfile::tempdir().unwrap();
    let path = satellite(dir.path());
    let model = Model::load(&path).unwrap();
    let rate: f64 = 0.5;
    let mut text = String::from(
        "t,q.base.x,q.base.y,q.base.z,q.base.qw,q.base.qx,q.base.qy,q.base.qz,q.wheel,",
    );
    text += "v.base.vx,v.base.vy,v.base.vz,v.base.wx,v.base.wy,v.base.wz,u.motor\n";
    for k in 0..40 {
        let t = 0.1 * f64::from(k);
        // q and −q are one orientation.
        let sign = [1.0, -1.0, -1.0][k as usize % 3];
        let (sin, cos) = (0.5 * rate * t).sin_cos();
        let (sin, cos) = (sign * sin, sign * cos);
        let (x, y) = (
            2.0 / rate * (rate * t).sin(),
            2.0 / rate * (1.0 - (rate * t).cos()),
        );
        writeln!(text, "{t},{x},{y},0,{cos},0,0,{sin},{t},2,0,0,0,0,{rate},0").unwrap();
    }
    let csv = dir.path().join("log.csv");
    std::fs::write(&csv, text).unwrap();
    let log = Log::read(&csv, &model).unwrap();
    assert_eq!((log.runs[0].q.len(), log.runs[0].v.len()), (8, 7));
    let (by_angles, logs) = by_angles(&model, &[log]).unwrap();
    let run = &logs[0].runs[0];
    let speeds = |c: usize| run.v[c].as_deref().unwrap();
    for k in 0..run.len() {
        let yaw = rate * run.t[k];
        let off = |found: f64, expected: f64| {
            assert!((found - expected).abs() < 1e-9, "{k}: {found} {expected}")
        };
        off(run.q[3][k], yaw);
        off(speeds(0)[k], 2.0 * yaw.cos());
        off(speeds(1)[k], 2.0 * yaw.sin());
        off(speeds(3)[k], rate);
        off(speeds(4)[k], 0.0);
    }
    assert!(run.v[6].is_none(), "the wheel's is not measured");

    // A model that writes its pose so reads the same.
    let read = Log::read(&csv, &by_angles).unwrap();
    assert_eq!(read.runs, logs[0].runs);
    let other = model.by_angles(Axis::Y).unwrap();
    let turned = Log::read(&csv, &other).unwrap();
    assert!(
        (turned.runs[0].q[3][0] - std::f64::consts::FRAC_PI_2).abs() < 1e-9,
        "its y axis is ahead"
    );
}

/// Whether the model writes the pose as a quaternion or by angles: what is wrong with a log of poses is told of the columns that it has.
#[test]
fn faults_of_a_log_of_poses_are_told_by_its_own_columns() {
    let dir = tempfile::tempdir().unwrap();
    let model = Model::load(&satellite(dir.path())).unwrap();
    let angles = model.by_angles(Axis::X).unwrap();
    let text = log(Vector3::new(0.05, -0.1, 0.4));
    let csv = dir.path().join("log.csv");
    let told = |model: &Model, text: &str| {
        std::fs::write(&csv, text).unwrap();
        match Log::read(&csv, model) {
            Ok(log) => log.warnings.iter().map(|w| w.to_string()).collect(),
            Err(error) => error.to_string(),
        }
    };
    let lines: Vec<&str> = text.lines().collect();
    let mut broken = lines.clone();
    broken[9] = "0.16,NaN,1,0,1,0,0,0,0,0";
    let without = text.replace("q.base.qz", "q.base.zq");
    for model in [&model, &angles] {
        let said = told(model, &broken.join("\n"));
        assert!(said.contains(":10:6: `q.base.x` is NaN"), "{said}");
        let said = told(model, &without);
        assert!(said.contains("column `q.base.qz` is missing"), "{said}");
        assert!(!said.contains("yaw"), "{said}");
    }
    let neither = "t,q.wheel,u.motor\n0,0,0\n";
    assert!(told(&angles, neither).contains("column `q.base.yaw` is missing"));

    // Some velocities of six are no twist.
    let some = text
        .replace("u.motor", "v.base.vx")
        .replace("q.wheel", "q.wheel,u.motor");
    let some: Vec<String> = some
        .lines()
        .enumerate()
        .map(|(k, line)| match k {
            0 => line.to_owned(),
            _ => format!("{line},0"),
        })
        .collect();
    let said = told(&angles, &some.join("\n"));
    assert!(
        said.contains("velocities of `base` are not used: all six are needed"),
        "{said}"
    );
}

#[test]
fn a_pose_of_nothing_that_floats_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = satellite(dir.path());
    let text = std::fs::read_to_string(&path).unwrap();
    let fixed = text.replace("base = \"floating\"", "pose = \"angles\"");
    let refused = Model::parse(&path, fixed).err().unwrap().to_string();
    assert!(
        refused.contains("none floats: add `base = \"floating\"`"),
        "{refused}"
    );
}
