//! Inputs that push a link and turn with it: fans of a hovercraft, rotors of a quadrotor.

use std::path::Path;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use pinode_nn::free_run::simulate;
use pinode_nn::model::Model;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

fn model(name: &str) -> Model {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    Model::load(&models.join(format!("{name}/{name}.toml"))).unwrap()
}

/// Both fans push alike, so that the hull goes on turning at ω (its drag is taken out): m a = F (cos ωt, sin ωt), a cycloid.
#[test]
fn a_turning_hovercraft_under_steady_thrust_draws_a_cycloid() {
    let mut model = model("hovercraft");
    model.effects.clear();
    let (mass, w, u) = (2.4, 1.7, 0.4);
    let force = 2.0 * 1.5 * u;
    let t: Vec<f64> = (0..201).map(|k| 0.02 * f64::from(k)).collect();
    let inputs = vec![vec![u; t.len()]; 2];
    let state = [0.0, 0.0, 0.0, 0.0, 0.0, w];
    let states = simulate(&model, "0", &t, &inputs, &state, 1e-3).unwrap();
    for (t, state) in t.iter().zip(states) {
        let a = w * t;
        let by = force / (mass * w * w);
        let expected = [
            by * (1.0 - a.cos()),
            by * (a - a.sin()),
            a,
            by * w * a.sin(),
            by * w * (1.0 - a.cos()),
            w,
        ];
        for (found, expected) in state.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{t}: {found} {expected}");
        }
    }
}

/// One fan alone turns it as well: I θ̈ = F d.
#[test]
fn the_fan_on_the_right_turns_the_hull_to_the_left() {
    let mut model = model("hovercraft");
    model.effects.clear();
    let t = [0.0, 0.5];
    let inputs = [vec![0.0; 2], vec![0.6; 2]];
    let states = simulate(&model, "0", &t, &inputs, &[0.0; 6], 1e-3).unwrap();
    let spin = 1.5 * 0.6 * 0.08 / 0.068 * 0.5;
    assert!((states[1][5] - spin).abs() < 1e-12, "{:?}", states[1]);
}

/// What u.starboard counts in beside u.port.
const COUNTS: f64 = 1e-3;

/// 60 s at 50 Hz of a hovercraft whose port fan makes no more of u than `limit` and whose fans are late by so many steps of 1 ms, by the equations
/// m v̇ = R(θ) (F + F', 0) − c v, I θ̈ = d (F' − F) − b θ̇.
#[cfg(feature = "cli")]
fn log(limit: f64, late: usize) -> String {
    use std::fmt::Write;

    let mut draws = ChaCha8Rng::seed_from_u64(5);
    let mut noise = |sigma: f64| -> f64 {
        let x: f64 = StandardNormal.sample(&mut draws);
        sigma * x
    };
    let slope = |x: [f64; 6], [port, starboard]: [f64; 2]| {
        let (f, g) = (1.5 * port.clamp(-limit, limit), 1.5 * starboard);
        let (sin, cos) = x[2].sin_cos();
        [
            x[3],
            x[4],
            x[5],
            ((f + g) * cos - 0.9 * x[3]) / 2.4,
            ((f + g) * sin - 0.9 * x[4]) / 2.4,
            (0.08 * (g - f) - 0.03 * x[5]) / 0.068,
        ]
    };
    let plus = |x: [f64; 6], k: [f64; 6], h: f64| std::array::from_fn(|i| x[i] + h * k[i]);
    let mut x = [0.0; 6];
    let mut text = String::from("t,q.craft.x,q.craft.y,q.craft.theta,u.port,u.starboard\n");
    for k in 0..3000_usize {
        let t = 0.02 * k as f64;
        // What is put out at a sample is held until the next one.
        let out = |step: usize| {
            let t = 0.02 * (step / 20) as f64;
            [
                0.5 * (1.1 * t).sin() + 0.4 * (3.1 * t).cos(),
                0.5 * (1.1 * t).sin() + 0.4 * (2.3 * t).sin(),
            ]
        };
        let u = out(20 * k);
        let read = [x[0] + noise(1e-3), x[1] + noise(1e-3), x[2] + noise(2e-3)];
        let [a, b, c] = read;
        let u = [u[0], u[1] / COUNTS];
        writeln!(text, "{t:.2},{a:.6},{b:.6},{c:.6},{:.9},{:.9}", u[0], u[1]).unwrap();
        let h = 1e-3;
        for step in 20 * k..20 * (k + 1) {
            let u = out(step.saturating_sub(late));
            let a = slope(x, u);
            let b = slope(plus(x, a, 0.5 * h), u);
            let c = slope(plus(x, b, 0.5 * h), u);
            let d = slope(plus(x, c, h), u);
            x = std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]));
        }
    }
    text
}

/// Kind and target of an effect, its parameter with the standard error, and how sure it is.
#[cfg(feature = "cli")]
type Named = (String, String, [f64; 2], f64);

/// What the program finds of the hovercraft in a log, the gap before and after, and what it says meanwhile.
#[cfg(feature = "cli")]
fn found(log: String) -> (Vec<Named>, [f64; 2], String) {
    let dir = tempfile::tempdir().unwrap();
    let (path, out) = (dir.path().join("log.csv"), dir.path().join("out"));
    std::fs::write(&path, log).unwrap();
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/hovercraft");
    let model = dir.path().join("hovercraft.toml");
    std::fs::copy(
        models.join("hovercraft.urdf"),
        dir.path().join("hovercraft.urdf"),
    )
    .unwrap();
    let text = std::fs::read_to_string(models.join("hovercraft.toml")).unwrap();
    let (port, starboard) = text.split_once("\"starboard\"").unwrap();
    let gain = format!("gain = {}", 1.5 * COUNTS);
    let starboard = starboard.replacen("gain = 1.5", &gain, 1);
    std::fs::write(&model, format!("{port}\"starboard\"{starboard}")).unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_pinode"))
        .arg("diagnose")
        .args([&model, &path])
        .arg("--out")
        .arg(&out)
        .arg("--json")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let diagnosis: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let effect = |effect: &serde_json::Value| {
        let text = |key: &str| effect[key].as_str().unwrap().to_owned();
        let parameters = effect["parameters"].as_object().unwrap();
        let parameter = parameters.values().next().unwrap();
        let number = |key: &str| parameter[key].as_f64().unwrap();
        let confidence = effect["confidence"].as_f64().unwrap();
        let numbers = ["value", "std"].map(number);
        (text("kind"), text("target"), numbers, confidence)
    };
    let effects = diagnosis["effects"].as_array().unwrap().iter();
    let gap = ["before", "after"].map(|key| diagnosis["gap"][key].as_f64().unwrap());
    (effects.map(effect).collect(), gap, said)
}

/// The other one counts in thousandths.
#[cfg(feature = "cli")]
#[test]
fn the_fan_that_makes_no_more_of_its_input_is_found() {
    let (effects, [before, after], _) = found(log(0.6, 0));
    let [(kind, fan, [limit, error], _)] = &effects[..] else {
        panic!("{effects:?}")
    };
    assert_eq!((&**kind, &**fan), ("input_saturation", "port"));
    let off = (limit - 0.6).abs();
    assert!(off < (4.0 * error).min(0.02), "{limit} ± {error}");
    assert!(after < 3.0 && before > 1.5 * after, "{before} {after}");
}

#[cfg(feature = "cli")]
#[test]
fn fans_that_are_late_alike_are_found_together() {
    let (effects, [before, after], said) = found(log(f64::INFINITY, 65));
    assert!(said.contains("input_delay on every input"), "{said}");
    let names: Vec<(&str, &str)> = effects.iter().map(|e| (&*e.0, &*e.1)).collect();
    let delays = [("input_delay", "port"), ("input_delay", "starboard")];
    assert_eq!(names, delays, "{effects:?}");
    for (_, fan, [delay, error], confidence) in &effects {
        // One beside the other explains little.
        assert!(*confidence > 0.9, "{fan}: {confidence}");
        let off = (delay - 0.065).abs();
        assert!(off < (4.0 * error).min(0.005), "{fan}: {delay} ± {error}");
    }
    assert!(after < 3.0 && before > 2.0 * after, "{before} {after}");
}

/// The equations of Newton and Euler, written here, by small steps: m p̈ = R z Σ f − m g z, J ω̇ = Σ r × f z ± k f z − ω × J ω.
#[test]
fn a_quadrotor_flies_as_newton_and_euler_say() {
    let model = model("quadrotor");
    let (mass, j) = (1.1, Vector3::new(0.011, 0.012, 0.021));
    let thrust = [2.9, 2.6, 2.75, 2.68];
    let (lift, roll, pitch, yaw) = (
        thrust.iter().sum::<f64>(),
        0.2 * (thrust[1] - thrust[3]),
        0.2 * (thrust[2] - thrust[0]),
        0.016 * (thrust[0] - thrust[1] + thrust[2] - thrust[3]),
    );
    let torque = Vector3::new(roll, pitch, yaw);
    let slope = |turn: Quaternion<f64>, w: Vector3<f64>| {
        let pose = UnitQuaternion::new_normalize(turn);
        let a = pose * Vector3::z() * (lift / mass) - Vector3::z() * 9.81;
        let dw = (torque - w.cross(&j.component_mul(&w))).component_div(&j);
        (a, turn * Quaternion::from_imag(w) * 0.5, dw)
    };
    let mut turn = *UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7);
    let mut w = Vector3::new(0.4, -0.3, 0.9);
    let (mut p, mut v) = (Vector3::zeros(), Vector3::new(0.5, 0.0, -0.2));
    let body = UnitQuaternion::new_normalize(turn).inverse() * v;
    let start = [
        0.0, 0.0, 0.0, turn.w, turn.i, turn.j, turn.k, body.x, body.y, body.z, w.x, w.y, w.z,
    ];
    let h = 1e-4;
    for _ in 0..10_000 {
        let a = slope(turn, w);
        let b = slope(turn + a.1 * (0.5 * h), w + a.2 * (0.5 * h));
        let c = slope(turn + b.1 * (0.5 * h), w + b.2 * (0.5 * h));
        let d = slope(turn + c.1 * h, w + c.2 * h);
        p += v * h + (a.0 + b.0 + c.0) * (h * h / 6.0);
        v += (a.0 + (b.0 + c.0) * 2.0 + d.0) * (h / 6.0);
        w += (a.2 + (b.2 + c.2) * 2.0 + d.2) * (h / 6.0);
        turn += (a.1 + (b.1 + c.1) * 2.0 + d.1) * (h / 6.0);
    }
    let inputs: Vec<Vec<f64>> = thrust.iter().map(|&f| vec![f; 2]).collect();
    let states = simulate(&model, "0", &[0.0, 1.0], &inputs, &start, 1e-3).unwrap();
    let end = &states[1];
    let turn = UnitQuaternion::new_normalize(turn);
    let body = turn.inverse() * v;
    let sign = if end[3] * turn.w < 0.0 { -1.0 } else { 1.0 };
    let expected = [
        p.x,
        p.y,
        p.z,
        sign * turn.w,
        sign * turn.i,
        sign * turn.j,
        sign * turn.k,
        body.x,
        body.y,
        body.z,
        w.x,
        w.y,
        w.z,
    ];
    for (found, expected) in end.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-8, "{end:?} {expected}");
    }
}
