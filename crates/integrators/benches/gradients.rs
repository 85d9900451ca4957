//! Roll-outs, their gradients and ensembles: `cargo bench -p integrators --bench gradients`.
//!
//! The names are those of the rows in BENCHMARKS.md. What is measured is the time of the thread's processor.
#![allow(clippy::unwrap_used, clippy::expect_used)] // a bench may stop
#![allow(missing_docs)] // of what criterion's macros write

#[path = "../../lagrange/benches/support/cpu_time.rs"]
mod cpu_time;
#[path = "../tests/systems/mod.rs"]
mod systems;

use std::convert::Infallible;
use std::time::Duration;

use cpu_time::CpuTime;
use criterion::{Criterion, criterion_group, criterion_main};
use integrators::ensemble::{LANES, LaneMember, LaneSystem, Member, roll_outs, roll_outs_in_lanes};
use integrators::gradient::{Adjoint, Column, RollOutGradient, Schedule, Sensitivity};
use integrators::{Differentiable, Rk4, System, roll_out};
use systems::{Kepler, Pendulum, Top};

fn gradients(criterion: &mut Criterion<CpuTime>) {
    for steps in [1_000, 100_000] {
        let swing = [1.2, 0.0];
        of(
            criterion,
            "pendulum",
            &Pendulum::new(),
            [0.1],
            &swing,
            steps,
        );
        let orbit = [0.7, 0.0, 0.0, 1.36];
        of(criterion, "Kepler", &Kepler::new(), [0.0; 2], &orbit, steps);
        let turning = [0.8, 0.6, 0.0, 0.0, 0.9, -1.4, 0.3];
        of(criterion, "top", &Top::new(0.5), [0.0; 3], &turning, steps);
    }
}

/// The roll-out over ten samples, the gradient of a loss of all of them, and the derivatives in the initial state and the constants.
fn of<S: Differentiable>(
    criterion: &mut Criterion<CpuTime>,
    name: &str,
    system: &S,
    input: S::Input,
    initial: &[f64],
    steps: usize,
) where
    S::Input: Clone,
    S::Error: std::fmt::Debug,
{
    let times: Vec<f64> = (0..=10).map(|k| 1e-3 * (k * steps / 10) as f64).collect();
    let inputs = vec![input; 10];
    let schedule = Schedule {
        times: &times,
        inputs: &inputs,
        substeps: steps / 10,
    };
    let mut group = criterion.benchmark_group(format!("{name}/{steps}"));
    group
        .sample_size(20)
        .measurement_time(Duration::from_secs(3));
    group.bench_function("roll_out", |bencher| {
        bencher.iter(|| {
            roll_out(system, Rk4::default(), &times, &inputs, steps / 10, initial).unwrap()
        });
    });
    let loss = |_k: usize, x: &[f64], by: &mut [f64]| {
        by[0] = x[0];
        0.5 * x[0] * x[0]
    };
    let mut out = RollOutGradient::default();
    let budgets = [("adjoint", 1 << 24), ("adjoint, 64 kB", 1 << 16)];
    for (call, budget) in budgets {
        let mut adjoint = Adjoint::new(system, Rk4::default()).with_budget(budget);
        group.bench_function(call, |bencher| {
            bencher.iter(|| {
                adjoint
                    .gradient(system, schedule, initial, loss, &mut out)
                    .unwrap()
            });
        });
    }
    let columns = Column::initial_and_parameters(system);
    let mut sensitivity = Sensitivity::new(system, Rk4::default());
    group.bench_function("sensitivity", |bencher| {
        bencher.iter(|| {
            let mut sum = 0.0;
            sensitivity
                .roll_out(system, schedule, initial, &columns, |_, _, by| sum += by[0])
                .unwrap();
            sum
        });
    });
    group.finish();
}

impl LaneSystem for Kepler {
    fn rate_lanes(
        &self,
        _t: f64,
        x: &[[f64; LANES]],
        u: [&[f64; 2]; LANES],
        (): &mut (),
        dx: &mut [[f64; LANES]],
    ) -> Result<(), Infallible> {
        let [a, b, va, vb] = [x[0], x[1], x[2], x[3]];
        let mut pull = [0.0; LANES];
        for k in 0..LANES {
            let r2 = a[k] * a[k] + b[k] * b[k];
            pull[k] = self.p[0] / (r2 * r2.sqrt());
        }
        dx[0] = va;
        dx[1] = vb;
        for k in 0..LANES {
            dx[2][k] = u[k][0] - pull[k] * a[k];
            dx[3][k] = u[k][1] - pull[k] * b[k];
        }
        Ok(())
    }
}

/// 64 orbits of 1000 steps on one thread, one at a time and eight at a time.
fn ensembles(criterion: &mut Criterion<CpuTime>) {
    let kepler = Kepler::new();
    let times: Vec<f64> = (0..=10).map(|k| 0.1 * f64::from(k)).collect();
    let inputs = [[0.0; 2]; 10];
    let starts: Vec<[f64; 4]> = (0..64)
        .map(|k| [0.7 + 0.01 * f64::from(k), 0.0, 0.0, 1.2])
        .collect();
    let schedule = Schedule {
        times: &times,
        inputs: &inputs,
        substeps: 100,
    };
    let members: Vec<_> = starts
        .iter()
        .map(|initial| Member {
            system: &kepler,
            schedule,
            initial,
        })
        .collect();
    let in_lanes: Vec<_> = starts
        .iter()
        .map(|initial| LaneMember {
            inputs: &inputs,
            initial,
        })
        .collect();
    let one_thread = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread() // where the clock is
        .build()
        .unwrap();
    let mut group = criterion.benchmark_group("64 orbits");
    group
        .sample_size(20)
        .measurement_time(Duration::from_secs(3));
    group.bench_function("one at a time", |bencher| {
        bencher.iter(|| one_thread.install(|| roll_outs(&members, &Rk4::default())));
    });
    group.bench_function("in lanes", |bencher| {
        bencher.iter(|| {
            one_thread
                .install(|| roll_outs_in_lanes(&kepler, &Rk4::default(), &times, 100, &in_lanes))
        });
    });
    group.finish();
    let _: &integrators::Flat = kepler.space();
}

criterion_group! {
    name = benches;
    config = Criterion::default().with_measurement(CpuTime);
    targets = gradients, ensembles
}
criterion_main!(benches);
