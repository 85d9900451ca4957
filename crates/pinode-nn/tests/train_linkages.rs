//! Networks beside closed loops: a slider-crank whose crank is braked by a law that the model lacks. Its log comes from the one coordinate that the loop
//! leaves, the crank's angle θ, here:
//!
//! I(θ) θ̈ + ½ I′(θ) θ̇² + V′(θ) = u − d (ds/dθ)² θ̇ − brake(θ̇)

use std::path::{Path, PathBuf};

use pinode_nn::learnt::Quantity;
use pinode_nn::log::{Log, Run};
use pinode_nn::model::Model;
use pinode_nn::network::Activation;
use pinode_nn::train::{Options, Training, train};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Lengths, masses, inertias and friction of `slider_crank_text.toml`, SI units.
const CRANK: f64 = 0.05;
const ROD: f64 = 0.13;
const AT_ZERO: f64 = 0.12;
const MASSES: [f64; 3] = [0.6, 0.25, 0.4];
const CENTRES: [f64; 2] = [0.01, 0.052];
const INERTIAS: [f64; 2] = [5e-4, 4.2e-4];
const GRAVITY: f64 = 9.81;
const FRICTION: f64 = 0.8;
/// Of the angles, rad, and of the slider, m.
const NOISE: [f64; 3] = [5e-3, 5e-3, 1e-3];

/// N·m at ω rad/s.
fn brake(w: f64) -> f64 {
    0.03 * w + 0.03 * (0.4 * w).sin()
}

/// The rod's angle from the horizontal, and what the slider is displaced by, at the crank's angle.
fn closed(crank: f64) -> [f64; 2] {
    let rod = (-CRANK / ROD * crank.cos()).asin();
    [rod, -CRANK * crank.sin() + ROD * rod.cos() - AT_ZERO]
}

/// By how much both move with the crank.
fn rates(crank: f64) -> [f64; 2] {
    let [rod, _] = closed(crank);
    let by = CRANK * crank.sin() / (ROD * rod.cos());
    [by, -CRANK * crank.cos() - ROD * rod.sin() * by]
}

/// 2 T/θ̇².
fn inertia(crank: f64) -> f64 {
    let [rod, _] = closed(crank);
    let [by, slides] = rates(crank);
    let [m1, m2, m3] = MASSES;
    let [c1, c2] = CENTRES;
    INERTIAS[0]
        + m1 * c1 * c1
        + m2 * (CRANK * CRANK + c2 * c2 * by * by + 2.0 * CRANK * c2 * by * (rod - crank).sin())
        + INERTIAS[1] * by * by
        + m3 * slides * slides
}

fn potential(crank: f64) -> f64 {
    let [rod, _] = closed(crank);
    let [m1, m2, _] = MASSES;
    m1 * GRAVITY * CENTRES[0] * crank.cos()
        + m2 * GRAVITY * (CRANK * crank.cos() + CENTRES[1] * rod.sin())
}

fn slope(f: fn(f64) -> f64, x: f64) -> f64 {
    let h = 1e-3;
    (8.0 * (f(x + h) - f(x - h)) - (f(x + 2.0 * h) - f(x - 2.0 * h))) / (12.0 * h)
}

fn model() -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../models/slider_crank/slider_crank_text.toml");
    let mut text = std::fs::read_to_string(&path)
        .unwrap()
        .replace("coefficient =", "fixed = true\ncoefficient =");
    for (joint, noise) in ["crank", "rod", "slider"].iter().zip(NOISE) {
        text += &format!("\n[sensor.{joint}]\nposition_noise = {noise:e}\nvelocity = \"none\"\n");
    }
    Model::parse(&path, text).unwrap_or_else(|e| panic!("{e}"))
}

/// So many seconds at 100 Hz under a torque that is another one every 0.3 s.
fn log(seed: u64, seconds: f64) -> Log {
    const SUBSTEPS: usize = 20;
    let (interval, beta) = (0.01, (5.0_f64 / 12.0).atan());
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut crank, mut w, mut u) = (0.3, 0.0, 0.0);
    let mut run = Run {
        id: "0".into(),
        t: Vec::new(),
        q: vec![Vec::new(); 3],
        v: vec![None; 3],
        u: vec![Vec::new()],
    };
    for k in 0..(seconds / interval) as usize {
        if k % 30 == 0 {
            u = rng.random_range(-0.3..0.3);
        }
        let [rod, slider] = closed(crank);
        run.t.push(interval * k as f64);
        run.u[0].push(u);
        let positions = [crank, rod - crank + beta, slider];
        for ((q, position), noise) in run.q.iter_mut().zip(positions).zip(NOISE) {
            let number: f64 = StandardNormal.sample(&mut rng);
            q.push(position + noise * number);
        }
        let h = interval / SUBSTEPS as f64;
        let f = |[crank, w]: [f64; 2]| {
            let [_, slides] = rates(crank);
            let force = u - FRICTION * slides * slides * w - brake(w);
            let bias = 0.5 * slope(inertia, crank) * w * w + slope(potential, crank);
            [w, (force - bias) / inertia(crank)]
        };
        for _ in 0..SUBSTEPS {
            let x = [crank, w];
            let ahead = |by: f64, k: [f64; 2]| [x[0] + by * k[0], x[1] + by * k[1]];
            let a = f(x);
            let b = f(ahead(0.5 * h, a));
            let c = f(ahead(0.5 * h, b));
            let d = f(ahead(h, c));
            [crank, w] = [0, 1].map(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
    }
    Log {
        path: PathBuf::from(format!("log{seed}.csv")),
        sha256: seed.to_string(),
        runs: vec![run],
        warnings: Vec::new(),
    }
}

#[test]
fn a_brake_on_the_crank_of_a_slider_crank_is_learnt_through_its_loop() {
    let (model, seen, unseen) = (model(), log(1, 16.0), log(2, 8.0));
    let training = Training {
        model: &model,
        logs: &[seen],
        held_out: &[unseen],
    };
    let options = Options {
        units: vec![32, 32],
        hidden: Activation::Tanh,
        quantities: vec![Quantity::Velocity(0)],
        rate: 5e-3,
        batch: 8,
        epochs: 24,
        single: false,
        longest_step: 5e-3,
        ..Options::new(vec![0])
    };
    let trained = train(&training, &options, None, &mut |_| Ok(())).unwrap();
    let held_out = trained.history[trained.best_epoch - 1].held_out;
    let without = trained.without_network.unwrap();
    assert!(held_out < 0.01 * without, "{held_out} {without}");
    for k in -4..=4 {
        let w = 2.0 * f64::from(k);
        let [found, true_one] = [trained.force.at(&[w])[0], -brake(w)];
        assert!((found - true_one).abs() < 0.03, "{w}: {found} {true_one}");
    }
}
