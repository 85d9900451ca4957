//! Steps of training and roll-outs of the paper's cart-pole: `cargo bench -p pinode-nn --bench training`.
//!
//! The problem of Roehrl et al. 2020 with the numbers of Table 2: a network 5-50-50-50-1 stands for all of Q on the cart, one step of Runge-Kutta
//! of 20 ms, batches of 128 of 24,271 windows, Adam. `benches/peers/jax_training.py` times JAX on the same. Times are those of the clock on the
//! wall: with two threads that of one says nothing.
#![allow(clippy::unwrap_used)] // a bench may stop
#![allow(missing_docs)] // of what criterion's macros write

#[path = "../../lagrange/benches/support/random.rs"]
#[allow(dead_code)] // the other benches take the rest
mod random;

use std::path::Path;
use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use integrators::{Rk4, roll_out};
use pinode_nn::hybrid::{Hybrid, HybridMotion};
use pinode_nn::log::{Log, Run};
use pinode_nn::model::Model;
use pinode_nn::network::Real;
use pinode_nn::train::{Options, Session, Training};
use rayon::ThreadPoolBuilder;

use random::Random;

/// Windows of an epoch and of a step.
const WINDOWS: usize = 24_271;
const BATCH: usize = 128;
/// Roll-outs and the steps of each.
const ROLL_OUTS: usize = 1000;
const STEPS: usize = 30;
/// Between two samples, s.
const INTERVAL: f64 = 0.02;
/// Windows of a recording.
const RECORDING: usize = 250;
const RATE: f64 = 1e-3;
/// The friction of the pole is known; all else that acts is the network's.
const MODEL: &str = "
name = 'cart-pole'
urdf = 'cartpole.urdf'
[[input]]
name = 'motor'
joint = 'slider'
[[effect]]
kind = 'viscous_friction'
joint = 'pole'
coefficient = 0.0020
";

fn training(criterion: &mut Criterion) {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../models/cartpole/training.toml"
    );
    let model = Model::parse(Path::new(path), MODEL).unwrap();
    let logs = [recordings(
        &model,
        WINDOWS.div_ceil(RECORDING),
        RECORDING,
        1,
    )];
    let held_out = [recordings(&model, ROLL_OUTS, STEPS, 2)];
    in_precision::<f32>(criterion, "f32", &model, &logs, &held_out);
    in_precision::<f64>(criterion, "f64", &model, &logs, &held_out);
}

fn in_precision<T: Real>(
    criterion: &mut Criterion,
    precision: &str,
    model: &Model,
    logs: &[Log],
    held_out: &[Log],
) {
    let training = Training {
        model,
        logs,
        held_out,
    };
    let paper = Options::paper(vec![0]);
    // The windows held out are as long as those that are learnt from.
    let long = Options {
        horizon: INTERVAL * STEPS as f64,
        ..paper.clone()
    };
    let mut session = Session::<T>::new(&training, &paper).unwrap();
    let mut rolled = Session::<T>::new(&training, &long).unwrap();
    assert!(session.windows() >= WINDOWS);
    assert_eq!(session.network().shape().sizes(), [5, 50, 50, 50, 1]);
    let order = shuffled(WINDOWS);
    for threads in [1, 2] {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.unwrap();
        let time = |work: &mut (dyn FnMut() + Send), times: u64| -> Duration {
            pool.install(|| {
                let start = Instant::now();
                (0..times).for_each(|_| work());
                start.elapsed()
            })
        };
        let mut group = criterion.benchmark_group(format!("{precision}/{threads}"));
        group.throughput(Throughput::Elements(BATCH as u64));
        group.bench_function("step", |bencher| {
            let mut batches = order.chunks_exact(BATCH).cycle();
            bencher.iter_custom(|times| {
                let mut step = || {
                    session.step(batches.next().unwrap(), RATE).unwrap();
                };
                time(&mut step, times)
            });
        });
        group.throughput(Throughput::Elements(WINDOWS as u64));
        group.bench_function("epoch", |bencher| {
            bencher.iter_custom(|times| {
                let mut epoch = || {
                    for batch in order.chunks(BATCH) {
                        session.step(batch, RATE).unwrap();
                    }
                };
                time(&mut epoch, times)
            });
        });
        group.throughput(Throughput::Elements((ROLL_OUTS * STEPS) as u64));
        group.bench_function("roll_outs", |bencher| {
            bencher.iter_custom(|times| {
                let mut roll = || {
                    rolled.held_out().unwrap();
                };
                time(&mut roll, times)
            });
        });
        group.finish();
    }
}

/// The cart-pole under random forces, `count` recordings of `windows` steps.
fn recordings(model: &Model, count: usize, windows: usize, seed: u64) -> Log {
    let hybrid = Hybrid::of(model);
    let theta = hybrid.theta();
    let mut random = Random(seed);
    let t: Vec<f64> = (0..=windows).map(|k| INTERVAL * k as f64).collect();
    let recording = |number: usize| {
        let u: Vec<f64> = t.iter().map(|_| 4.0 * random.uniform()).collect();
        let initial = [
            0.3 * random.uniform(),
            std::f64::consts::PI * random.uniform(),
            0.5 * random.uniform(),
            7.0 * random.uniform(),
        ];
        let inputs = hybrid.drive(&t, std::slice::from_ref(&u), 20, &theta, &[]);
        let motion = HybridMotion::new(&hybrid, &theta, &[], &inputs);
        let steps: Vec<usize> = (0..inputs.grid.bounds.len() - 1).collect();
        let rk4 = Rk4::default();
        let states = roll_out(&motion, rk4, &inputs.grid.bounds, &steps, 1, &initial).unwrap();
        let column = |i: usize| states.iter().step_by(20).map(|x| x[i]).collect();
        Run {
            id: number.to_string(),
            q: vec![column(0), column(1)],
            v: vec![Some(column(2)), Some(column(3))],
            u: vec![u],
            t: t.clone(),
        }
    };
    Log {
        path: "recordings.csv".into(),
        sha256: seed.to_string(),
        runs: (0..count).map(recording).collect(),
        warnings: Vec::new(),
    }
}

/// The numbers below `n` in a random order.
fn shuffled(n: usize) -> Vec<usize> {
    let mut random = Random(3);
    let mut order: Vec<usize> = (0..n).collect();
    for k in (1..n).rev() {
        order.swap(k, random.below(k + 1));
    }
    order
}

fn short() -> Criterion {
    Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2))
        .sample_size(30)
        .configure_from_args()
}

criterion_group! {
    name = benches;
    config = short();
    targets = training
}
criterion_main!(benches);
