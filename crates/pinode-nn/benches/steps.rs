//! Steps, roll-outs and their gradients on mechanisms: `cargo bench -p pinode-nn --bench steps`.
//!
//! The names are those of the rows in BENCHMARKS.md; `benches/peers` times MuJoCo's steps beside them. With PINODE_ENDS set to a file,
//! a roll-out of 1 s of every robot is written there, for the peer to be compared with.
#![allow(clippy::unwrap_used)] // a bench may stop
#![allow(missing_docs)] // of what criterion's macros write

#[path = "../../lagrange/benches/support/mod.rs"]
mod support;

use std::path::Path;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use integrators::ensemble::{LANES, LaneMember, roll_outs_in_lanes};
use integrators::gradient::{Adjoint, Column, RollOutGradient, Schedule, Sensitivity};
use integrators::{Method, Order, Rk4, System, Variational, roll_out};
use lagrange::Mechanics;
use nalgebra::{DMatrix, DVector};
use pinode_nn::hybrid::{Hybrid, HybridMotion};
use pinode_nn::model::Model;
use pinode_nn::motion::Motion;
use pinode_nn::shooting::{Roller, Trajectory};
use serde_json::json;

use support::cpu_time::CpuTime;
use support::robot::{self, Robot};

/// The robots that MuJoCo reads as well, and the number of steps of a roll-out.
const ROBOTS: [&str; 5] = [
    "cartpole_roehrl2020/fixed",
    "kuka_iiwa/fixed",
    "quadruped/floating",
    "talos_reduced/fixed",
    "talos_reduced/floating",
];
const STEPS: usize = 1000;

/// A state does not leave its place in so short a step, s.
const SHORT: f64 = 1e-6;
/// Step of the roll-outs, s.
const STEP: f64 = 1e-3;

fn steps(criterion: &mut Criterion<CpuTime>) {
    let robots: Vec<Robot> = robot::all()
        .into_iter()
        .filter(|robot| ROBOTS.contains(&robot.name.as_str()))
        .collect();
    write_ends(&robots);
    window(criterion);
    for robot in &robots {
        let motion = Motion::new(&robot.mechanics);
        let states: Vec<Vec<f64>> = (robot.states.iter())
            .map(|s| [s.q.as_slice(), &s.v].concat())
            .collect();
        single(criterion, &robot.name, &motion, &states);
        lanes(criterion, &robot.name, &motion, &states);
        gradients(criterion, &robot.name, motion, &states[0]);
    }
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../models/four_bar/four_bar.toml"
    );
    let model = Model::load(Path::new(path)).unwrap();
    let motion: Motion<Arc<dyn Mechanics>> = Motion::new(model.mechanics.clone());
    let constraints = motion.mechanics().constraints().unwrap();
    let (q, v) = constraints
        .project_with(&[0.3, 0.2, 0.1], &[1.0, 0.0, 0.0], &[], motion.constants())
        .unwrap();
    let start = [q, v].concat();
    let mut group = criterion.benchmark_group("four_bar/fixed");
    group.bench_function("rk4_step", rk4_steps(&motion, std::slice::from_ref(&start)));
    group.finish();
    gradients(criterion, "four_bar/fixed", motion, &start);
}

/// A call of one step by the classical Runge-Kutta method, of one state after the other.
fn rk4_steps<'a, S: System<Input = Vec<f64>, Error = lagrange::Error>>(
    system: &'a S,
    states: &[Vec<f64>],
) -> impl FnMut(&mut criterion::Bencher<'_, CpuTime>) + use<'a, S> {
    let mut states = states.to_vec();
    let no_force = no_force(system);
    move |bencher| {
        let mut rk4 = Rk4::default();
        let mut memory = system.memory();
        let mut next = 0;
        bencher.iter(|| {
            next = (next + 1) % states.len();
            let x = &mut states[next];
            Method::step(&mut rk4, system, 0.0, SHORT, &no_force, &mut memory, x).unwrap();
            x[0]
        });
    }
}

fn no_force<S: System>(system: &S) -> Vec<f64> {
    use integrators::Space;
    vec![0.0; system.space().tangent_dim() / 2]
}

fn single<M: Mechanics>(
    criterion: &mut Criterion<CpuTime>,
    name: &str,
    motion: &Motion<&M>,
    states: &[Vec<f64>],
) {
    let mechanics = motion.mechanics();
    let mut group = criterion.benchmark_group(name);
    // Of the four of which a step is made.
    group.bench_function("forward_dynamics", |bencher| {
        let p = mechanics.nominal();
        let mut work = mechanics.workspace();
        let mut out = DVector::zeros(mechanics.nv());
        let mut states = states.iter().cycle();
        bencher.iter(|| {
            let (q, v) = states.next().unwrap().split_at(mechanics.nq());
            out.fill(0.0);
            mechanics
                .forward_dynamics_into(q, v, &p, &mut work, &mut out)
                .unwrap();
            out[0]
        });
    });
    group.bench_function("rk4_step", rk4_steps(motion, states));
    let free = motion.clone().free().unwrap();
    let no_force = no_force(&free);
    for (name, order) in [
        ("variational_2", Order::Two),
        ("variational_4", Order::Four),
    ] {
        group.bench_function(name, |bencher| {
            let mut method = Variational::new(&free, order);
            let mut memory = free.memory();
            let mut states = states.iter().cycle();
            let mut x = states.next().unwrap().clone();
            bencher.iter(|| {
                x.copy_from_slice(states.next().unwrap());
                method
                    .step(&free, 0.0, STEP, &no_force, &mut memory, &mut x)
                    .unwrap();
                x[0]
            });
        });
    }
    group.finish();
}

/// Eight roll-outs of a hundred steps at once.
fn lanes<M: Mechanics>(
    criterion: &mut Criterion<CpuTime>,
    name: &str,
    motion: &Motion<&M>,
    states: &[Vec<f64>],
) {
    let inputs = [no_force(motion)];
    let members: Vec<LaneMember<'_, Vec<f64>>> = (states[..LANES].iter())
        .map(|initial| LaneMember {
            inputs: &inputs,
            initial,
        })
        .collect();
    let times = [0.0, 100.0 * SHORT];
    let mut group = criterion.benchmark_group(name);
    group.bench_function("rk4_100_steps_lanes", |bencher| {
        bencher.iter(|| {
            let rolled = roll_outs_in_lanes(motion, &Rk4::default(), &times, 100, &members);
            assert!(rolled.iter().all(Result::is_ok));
            rolled.len()
        });
    });
    group.finish();
}

/// A roll-out, and the gradient of its last state in the initial state, all constants and the forces of ten intervals.
fn gradients<M: std::ops::Deref<Target: Mechanics> + Clone + Send + Sync>(
    criterion: &mut Criterion<CpuTime>,
    name: &str,
    motion: Motion<M>,
    initial: &[f64],
) {
    let all = (0..motion.constants().len()).collect();
    let motion = motion.with_parameters(all).unwrap();
    let times: Vec<f64> = (0..=10).map(|k| 0.1 * STEP * (k * STEPS) as f64).collect();
    let inputs = vec![no_force(&motion); 10];
    let schedule = Schedule {
        times: &times,
        inputs: &inputs,
        substeps: STEPS / 10,
    };
    let mut group = criterion.benchmark_group(name);
    group.bench_function("roll_out_1000", |bencher| {
        bencher.iter(|| {
            let Schedule {
                times,
                inputs,
                substeps,
            } = schedule;
            roll_out(&motion, Rk4::default(), times, inputs, substeps, initial).unwrap()
        });
    });
    group.bench_function("adjoint_1000", |bencher| {
        let mut adjoint = Adjoint::new(&motion, Rk4::default());
        let mut by = RollOutGradient {
            inputs: DMatrix::zeros(motion.mechanics().nv(), 10),
            ..RollOutGradient::default()
        };
        bencher.iter(|| {
            adjoint
                .gradient(
                    &motion,
                    schedule,
                    initial,
                    |k, x, by| {
                        if k == 10 {
                            by.fill(1.0);
                        }
                        x[0]
                    },
                    &mut by,
                )
                .unwrap()
        });
    });
    group.finish();
}

/// The window of a fit, half a second of the cart-pole with derivatives in its initial state and in its free constants: by the loop
/// of the fits, and by the sensitivities of `integrators`.
fn window(criterion: &mut Criterion<CpuTime>) {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../models/cartpole/cartpole.toml"
    );
    let hybrid = Hybrid::of(&Model::load(Path::new(path)).unwrap());
    let (theta, free) = (hybrid.theta(), hybrid.free());
    let t: Vec<f64> = (0..=25).map(|k| 0.02 * f64::from(k)).collect();
    let u: Vec<f64> = t.iter().map(|t| 2.0 * (9.0 * t).sin()).collect();
    let inputs = hybrid.drive(&t, &[u], 20, &theta, &free);
    let initial = [0.05, 2.4, 0.3, -2.0];
    let mut group = criterion.benchmark_group("window/fixed");
    group.bench_function("by_the_fits", |bencher| {
        let mut roller = Roller::new(&hybrid, &free);
        let mut out = Trajectory::default();
        bencher.iter(|| {
            roller
                .roll_with_sensitivities(&theta, &inputs, (0, t.len()), &initial, &mut out)
                .unwrap();
            out.sensitivities[0]
        });
    });
    group.bench_function("by_sensitivity", |bencher| {
        let motion = HybridMotion::new(&hybrid, &theta, &free, &inputs);
        let columns = Column::initial_and_parameters(&motion);
        let steps: Vec<usize> = (0..inputs.grid.bounds.len() - 1).collect();
        let schedule = Schedule {
            times: &inputs.grid.bounds,
            inputs: &steps,
            substeps: 1,
        };
        let mut sensitivity = Sensitivity::new(&motion, Rk4::default());
        bencher.iter(|| {
            let mut last = 0.0;
            sensitivity
                .roll_out(&motion, schedule, &initial, &columns, |_, _, by| {
                    last = by[0]
                })
                .unwrap();
            last
        });
    });
    group.finish();
}

/// Roll-outs of 1 s from the first state of every robot, with the step and with one an eighth as long, to the file that PINODE_ENDS
/// names.
fn write_ends(robots: &[Robot]) {
    let Some(path) = std::env::var_os("PINODE_ENDS") else {
        return;
    };
    let ends: Vec<_> = robots
        .iter()
        .map(|robot| {
            let motion = Motion::new(&robot.mechanics);
            let state = &robot.states[0];
            let initial = [state.q.as_slice(), &state.v].concat();
            let end = |substeps| {
                let inputs = [no_force(&motion)];
                let rk4 = Rk4::default();
                roll_out(&motion, rk4, &[0.0, 1.0], &inputs, substeps, &initial)
                    .unwrap()
                    .pop()
            };
            json!({
                "robot": robot.name,
                "joints": robot.mechanics.coordinates().iter().map(|c| &c.joint).collect::<Vec<_>>(),
                "nq": robot.mechanics.nq(),
                "step": STEP,
                "initial": initial,
                "end": end(STEPS),
                "fine": end(8 * STEPS),
            })
        })
        .collect();
    std::fs::write(path, json!(ends).to_string()).unwrap();
}

fn one_thread() -> Criterion<CpuTime> {
    // What runs in rayon's pool runs here, where the clock is.
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread()
        .build_global()
        .unwrap();
    support::criterion()
}

criterion_group! {
    name = benches;
    config = one_thread();
    targets = steps
}
criterion_main!(benches);
