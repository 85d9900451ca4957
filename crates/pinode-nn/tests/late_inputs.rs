//! Inputs that arrive between two samples, of which what the integration steps make is nobody's missing physics; and inputs that are written rows late.

use std::path::Path;

use pinode_nn::diagnose::diagnose;
use pinode_nn::diagnose::verdict::Verdict;
use pinode_nn::log::{Log, Mapping};
use pinode_nn::model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const INERTIA: f64 = 0.012;
const WEIGHT: f64 = 0.5;
const FRICTION: f64 = 0.02;
const NOISE: f64 = 3e-4;
const INTERVAL: f64 = 0.01;

/// (φ, φ̇) after the time `t` under a torque, by steps of 0.2 ms at most.
fn after((q, v): (f64, f64), torque: f64, t: f64) -> (f64, f64) {
    let acceleration = |q: f64, v: f64| (torque - WEIGHT * q.sin() - FRICTION * v) / INERTIA;
    let steps = (t / 2e-4).ceil().max(1.0);
    let h = t / steps;
    let (mut q, mut v) = (q, v);
    for _ in 0..steps as usize {
        let a1 = acceleration(q, v);
        let (v2, q2) = (v + 0.5 * h * a1, q + 0.5 * h * v);
        let a2 = acceleration(q2, v2);
        let (v3, q3) = (v + 0.5 * h * a2, q + 0.5 * h * v2);
        let a3 = acceleration(q3, v3);
        let (v4, q4) = (v + h * a3, q + h * v3);
        let a4 = acceleration(q4, v4);
        q += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4);
        v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
    }
    (q, v)
}

/// 40 s of a pendulum that a random torque of ± 2 N·m, new every 50 ms, throws about `delay` s late.
fn thrown_about(delay: f64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut state, mut old, mut torque) = ((0.3, 0.0), 0.0, 0.0);
    let mut text = "t,q.phi,u.motor\n".to_owned();
    for k in 0..4000 {
        if k % 5 == 0 {
            torque = rng.random_range(-2.0..2.0);
        }
        let noise: f64 = rng.sample(StandardNormal);
        let (t, q) = (f64::from(k) * INTERVAL, state.0 + NOISE * noise);
        text += &format!("{t:.2},{q},{torque}\n");
        state = after(state, old, delay);
        state = after(state, torque, INTERVAL - delay);
        old = torque;
    }
    text
}

fn model(effects: &str) -> Model {
    let text = format!(
        "name = \"pendulum\"\n\
         lagrangian = {{ coordinates = [\"phi\"], kinetic = \"0.5*{INERTIA}*phi_dot^2\", potential = \"-{WEIGHT}*cos(phi)\" }}\n\
         [[input]]\nname = \"motor\"\njoint = \"phi\"\n\
         [sensor.phi]\nposition_noise = {NOISE}\nvelocity = \"none\"\n\
         [tolerance]\ngain = 0.0\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"phi\"\ncoefficient = {FRICTION}\nfixed = true\n\
         {effects}"
    );
    Model::parse(Path::new("pendulum.toml"), text).unwrap_or_else(|e| panic!("{e}"))
}

/// The log with every torque so many rows further down than where it was put out.
fn written_late(log: &str, rows: usize) -> String {
    let lines: Vec<&str> = log.lines().collect();
    let parts = |line: &str| -> Option<(String, String)> {
        let (state, torque) = line.rsplit_once(',')?;
        Some((state.to_owned(), torque.to_owned()))
    };
    let parts: Vec<(String, String)> = lines[1..].iter().filter_map(|l| parts(l)).collect();
    let row = |(k, (state, _)): (usize, &(String, String))| {
        format!("{state},{}\n", parts[k.saturating_sub(rows)].1)
    };
    let rows: String = parts.iter().enumerate().map(row).collect();
    format!("{}\n{rows}", lines[0])
}

/// 23.7 ms early are three rows less a delay: no effect makes an input early.
#[test]
fn inputs_that_are_written_rows_late_are_read_where_they_belong() {
    const DELAY: f64 = 6.3e-3;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.csv");
    std::fs::write(&path, written_late(&thrown_about(DELAY), 3)).unwrap();
    let given = model("");
    let log = Log::read(&path, &given).unwrap();
    let outcome = diagnose(&given, &[log], &[], dir.path(), 0, &|_| ()).unwrap();
    let found = &outcome.diagnosis;
    let [late] = &found.effects[..] else {
        panic!("{:?}, {:?}", found.verdict, found.effects)
    };
    assert_eq!(late.kind, "input_delay");
    let delay = late.parameters["delay"].value;
    assert!((delay - DELAY).abs() < 1e-5, "{delay}");
    assert!(found.unexplained.is_none(), "{:?}", found.unexplained);
    let [fault] = &found.data_faults[..] else {
        panic!("{:?}", found.data_faults)
    };
    assert_eq!((&*fault.kind, &*fault.column), ("convention", "u.motor"));
    assert!(fault.detail.contains("is written 3 rows late"), "{fault:?}");
    let new = Model::load(&outcome.model).unwrap();
    let mapping = Mapping {
        rows_late: 3,
        ..Mapping::new("u.motor", "u.motor")
    };
    assert_eq!(new.columns.mappings, [mapping]);

    // The new model reads them from there.
    let reread = Log::read(&path, &new).unwrap();
    std::fs::write(&path, thrown_about(DELAY)).unwrap();
    let meant = Log::read(&path, &given).unwrap();
    let torques = |log: &Log| log.runs[0].u[0][..3990].to_vec();
    assert_eq!(torques(&reread), torques(&meant));
}

/// 6.3 ms are no whole number of integration steps, and the torque changes within one.
#[test]
fn nothing_is_left_of_a_delay_of_a_fraction_of_a_sample_hidden_or_known() {
    const DELAY: f64 = 6.3e-3;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.csv");
    std::fs::write(&path, thrown_about(DELAY)).unwrap();
    let hidden = model("");
    let log = Log::read(&path, &hidden).unwrap();
    let outcome = diagnose(&hidden, &[log], &[], dir.path(), 0, &|_| ()).unwrap();
    let found = &outcome.diagnosis;
    let [late] = &found.effects[..] else {
        panic!("{:?}, {:?}", found.verdict, found.effects)
    };
    assert_eq!(
        (late.kind.as_str(), late.target.as_str()),
        ("input_delay", "motor")
    );
    assert_eq!(found.verdict, Verdict::EffectsFound);
    assert!(found.unexplained.is_none(), "{:?}", found.unexplained);
    let delay = late.parameters["delay"].value;
    assert!((delay - DELAY).abs() < 1e-5, "{delay}");

    let known = model(&format!(
        "[[effect]]\nkind = \"input_delay\"\ninput = \"motor\"\ndelay = {DELAY}\nfixed = true\n"
    ));
    let log = Log::read(&path, &known).unwrap();
    let outcome = diagnose(&known, &[log], &[], dir.path(), 0, &|_| ()).unwrap();
    let found = &outcome.diagnosis;
    assert_eq!(
        found.verdict,
        Verdict::NothingMissing,
        "{:?}",
        found.effects
    );
}
