//! A driven pendulum and its logs, by an integrator of its own.

use std::path::{Path, PathBuf};

use pinode_nn::diagnose::diagnose;
use pinode_nn::diagnose::verdict::Diagnosis;
use pinode_nn::log::{Log, Run};
use pinode_nn::model::Model;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub const NOISE: f64 = 1e-3;
/// m l², m g l, and the viscous friction that the model knows of.
pub const INERTIA: f64 = 0.05;
pub const WEIGHT: f64 = 0.981;
pub const VISCOUS: f64 = 0.01;

pub fn model(fixed: bool) -> Model {
    parsed(&text(fixed))
}

pub fn parsed(text: &str) -> Model {
    Model::parse(Path::new("pendulum.toml"), text.to_owned()).unwrap_or_else(|e| panic!("{e}"))
}

pub fn text(fixed: bool) -> String {
    text_of(INERTIA, VISCOUS, fixed)
}

/// The same with another inertia and viscous friction.
pub fn text_of(inertia: f64, viscous: f64, fixed: bool) -> String {
    format!(
        "name = \"pendulum\"\n\
         lagrangian = {{ coordinates = [\"phi\"], angles = [\"phi\"], kinetic = \"0.5*{inertia}*phi_dot^2\", potential = \"-{WEIGHT}*cos(phi)\" }}\n\
         [[input]]\nname = \"motor\"\njoint = \"phi\"\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"phi\"\ncoefficient = {viscous}\nfixed = {fixed}\n\
         [sensor.phi]\nposition_noise = {NOISE:e}\nvelocity = \"none\"\n"
    )
}

/// `x` a step of `h` s later, by Runge and Kutta's method.
pub fn stepped<const N: usize>(
    x: [f64; N],
    h: f64,
    rates: impl Fn([f64; N]) -> [f64; N],
) -> [f64; N] {
    let ahead = |h: f64, k: [f64; N]| -> [f64; N] { std::array::from_fn(|i| x[i] + h * k[i]) };
    let a = rates(x);
    let b = rates(ahead(h / 2.0, a));
    let c = rates(ahead(h / 2.0, b));
    let d = rates(ahead(h, c));
    std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]))
}

/// Two coordinates and their rates under feedback: at each of the times `t` the coordinates are read with this noise, and the `push` of what is read and of the state is
/// held to the next, by so many steps of h s.
pub fn under_feedback(
    t: Vec<f64>,
    (noise, seed): ([f64; 2], u64),
    (h, steps): (f64, usize),
    mut state: [f64; 4],
    push: impl Fn(f64, [f64; 2], [f64; 4]) -> f64,
    rates: impl Fn([f64; 4], f64) -> [f64; 4],
) -> Log {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let (mut q, mut u) = (vec![Vec::new(); 2], Vec::new());
    for &t in &t {
        let read = [0, 1].map(|c| state[c] + noise[c] * normal());
        let push = push(t, read, state);
        for (column, read) in q.iter_mut().zip(read) {
            column.push(read);
        }
        u.push(push);
        for _ in 0..steps {
            state = stepped(state, h, |state| rates(state, push));
        }
    }
    recorded(t, q, vec![u])
}

/// The accelerations a of two coordinates under forces f, M a = f, M = (m₁₁, m₁₂; m₁₂, m₂₂).
pub fn accelerated([m11, m12, m22]: [f64; 3], forces: [f64; 2]) -> [f64; 2] {
    let determinant = m11 * m22 - m12 * m12;
    [
        (m22 * forces[0] - m12 * forces[1]) / determinant,
        (m11 * forces[1] - m12 * forces[0]) / determinant,
    ]
}

/// One recording of these positions and inputs.
pub fn recorded(t: Vec<f64>, q: Vec<Vec<f64>>, u: Vec<Vec<f64>>) -> Log {
    Log {
        path: PathBuf::from("log.csv"),
        sha256: String::new(),
        runs: vec![Run {
            id: "0".into(),
            t,
            v: vec![None; q.len()],
            q,
            u,
        }],
        warnings: Vec::new(),
    }
}

/// A torque of four sines, N·m.
pub fn torque(t: f64) -> f64 {
    0.35 * (1.3 * t).sin()
        + 0.3 * (2.9 * t + 1.0).sin()
        + 0.25 * (4.7 * t + 2.0).sin()
        + 0.2 * (7.1 * t + 0.5).sin()
}

/// 60 s at 50 Hz of I φ̈ = −m g l sin φ − d φ̇ + τ, τ held from sample to sample, by `law`(t, [φ, φ̇], u) = τ − d φ̇.
pub fn log(seed: u64, law: impl Fn(f64, [f64; 2], f64) -> f64) -> Log {
    log_by(NOISE, seed, law)
}

/// The same under half of the torque, by which the pendulum does not turn over: near the top one window knows more of its
/// torque than all others, and what it leaves is a matter of luck.
pub fn log_of_swings(seed: u64, law: impl Fn(f64, [f64; 2], f64) -> f64) -> Log {
    let mut log = log_under(|t| 0.5 * torque(t), NOISE, seed, law);
    log.runs[0].v = vec![None];
    log
}

/// The same as [`log`] by a sensor of this noise.
pub fn log_by(sensor: f64, seed: u64, law: impl Fn(f64, [f64; 2], f64) -> f64) -> Log {
    let mut log = log_of_both(sensor, seed, law);
    log.runs[0].v = vec![None];
    log
}

/// The same with velocities as they are.
pub fn log_of_both(sensor: f64, seed: u64, law: impl Fn(f64, [f64; 2], f64) -> f64) -> Log {
    log_under(torque, sensor, seed, law)
}

fn log_under(
    torque: impl Fn(f64) -> f64,
    sensor: f64,
    seed: u64,
    law: impl Fn(f64, [f64; 2], f64) -> f64,
) -> Log {
    const SUBSTEPS: usize = 80;
    let mut noise = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = || -> f64 { StandardNormal.sample(&mut noise) };
    let t: Vec<f64> = (0..3000).map(|k| 0.02 * f64::from(k)).collect();
    let u: Vec<f64> = t.iter().map(|&t| torque(t)).collect();
    let h = 0.02 / SUBSTEPS as f64;
    let mut x = [0.2, 0.0];
    let (mut q, mut v) = (Vec::new(), Vec::new());
    for (&start, &u) in t.iter().zip(&u) {
        q.push(x[0] + sensor * noise());
        v.push(x[1]);
        for k in 0..SUBSTEPS {
            let now = start + h * k as f64;
            let slope =
                |x: [f64; 2], t: f64| [x[1], (law(t, x, u) - WEIGHT * x[0].sin()) / INERTIA];
            let ahead = |by: f64, k: [f64; 2]| [x[0] + by * k[0], x[1] + by * k[1]];
            let a = slope(x, now);
            let b = slope(ahead(0.5 * h, a), now + 0.5 * h);
            let c = slope(ahead(0.5 * h, b), now + 0.5 * h);
            let d = slope(ahead(h, c), now + h);
            x = [0, 1].map(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
    }
    Log {
        path: PathBuf::from("log.csv"),
        sha256: String::new(),
        runs: vec![Run {
            id: "0".into(),
            t,
            q: vec![q],
            v: vec![Some(v)],
            u: vec![u],
        }],
        warnings: Vec::new(),
    }
}

pub fn diagnosed(model: &Model, log: Log) -> Diagnosis {
    diagnosed_beside(model, log, &[])
}

/// The same with these logs held out.
pub fn diagnosed_beside(model: &Model, log: Log, held_out: &[Log]) -> Diagnosis {
    let dir = tempfile::tempdir().unwrap();
    let diagnosis = diagnose(model, &[log], held_out, dir.path(), 0, &|_| ())
        .unwrap_or_else(|e| panic!("{e}"))
        .diagnosis;
    // What explains less and relieves no more comes later.
    for pair in diagnosis.effects.windows(2) {
        let [first, second] = [&pair[0], &pair[1]].map(|effect| &effect.evidence);
        let comes_first = first.gain_fit >= second.gain_fit || first.relief > second.relief;
        assert!(comes_first, "{first:?} before {second:?}");
    }
    diagnosis
}

pub fn advises(diagnosis: &Diagnosis, words: &str) -> bool {
    diagnosis.advice.iter().any(|a| a.contains(words))
}
