//! What gradients of roll-outs take of memory.

#![allow(clippy::unwrap_used)] // helpers of tests

mod systems;

use integrators::gradient::{Adjoint, Column, RollOutGradient, Schedule, Sensitivity};
use integrators::{Differentiable, Rk4, roll_out};
use nalgebra::DMatrix;
use systems::{Pendulum, Top};

/// The last state's first entry.
fn last(samples: usize) -> impl Fn(usize, &[f64], &mut [f64]) -> f64 {
    move |k, x, by| {
        by[0] = if k + 1 == samples { 1.0 } else { 0.0 };
        by[0] * x[0]
    }
}

/// Most bytes at one time that a new adjoint and its gradient take, over `steps` steps in ten intervals.
fn peak<S: Differentiable>(
    system: &S,
    input: S::Input,
    initial: &[f64],
    steps: usize,
    budget: usize,
) -> u64
where
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
    let counted = allocation_counter::measure(|| {
        let mut out = RollOutGradient::default();
        Adjoint::new(system, Rk4::default())
            .with_budget(budget)
            .gradient(system, schedule, initial, last(11), &mut out)
            .unwrap();
        assert!(out.initial.iter().any(|&x| x != 0.0));
    });
    counted.bytes_max
}

#[test]
fn memory_of_the_adjoint_does_not_grow_with_the_steps() {
    const BUDGET: usize = 40_000;
    /// Vectors of the workspace and of the result.
    const REST: u64 = 4_000;
    let top = [0.8, 0.6, 0.0, 0.0, 0.9, -1.4, 0.3];
    let (pendulum, body) = (Pendulum::new(), Top::new(0.5));
    for (name, peaks) in [
        (
            "pendulum",
            [1_000, 10_000, 100_000]
                .map(|steps| peak(&pendulum, [0.1], &[1.2, 0.0], steps, BUDGET)),
        ),
        (
            "top",
            [1_000, 10_000, 100_000].map(|steps| peak(&body, [0.0; 3], &top, steps, BUDGET)),
        ),
    ] {
        eprintln!("{name}: {peaks:?} bytes at 1e3, 1e4, 1e5 steps");
        for bytes in peaks {
            assert!(bytes <= BUDGET as u64 + REST, "{name}: {bytes}");
        }
    }
}

#[test]
fn a_second_gradient_takes_no_memory() {
    let (body, start) = (Top::new(0.5), [0.8, 0.6, 0.0, 0.0, 0.9, -1.4, 0.3]);
    let times: Vec<f64> = (0..=20).map(|k| 0.05 * f64::from(k)).collect();
    let inputs = [[0.1, 0.0, -0.2]; 20];
    let schedule = Schedule {
        times: &times,
        inputs: &inputs,
        substeps: 5,
    };
    for budget in [0, 3_000, 1 << 20] {
        let mut out = RollOutGradient::default();
        let mut adjoint = Adjoint::new(&body, Rk4::default()).with_budget(budget);
        let mut run = || {
            adjoint
                .gradient(&body, schedule, &start, last(21), &mut out)
                .unwrap()
        };
        let first = run();
        let counted = allocation_counter::measure(|| assert_eq!(run(), first));
        assert_eq!(counted.count_total, 0, "budget {budget}");
    }

    let mut columns = Column::initial_and_parameters(&body);
    columns.extend(Column::inputs(&body, 3..8));
    let mut sensitivity = Sensitivity::new(&body, Rk4::default());
    let mut sum = 0.0;
    let mut run = || {
        sensitivity
            .roll_out(
                &body,
                schedule,
                &start,
                &columns,
                |_, _, by: &DMatrix<f64>| sum += by[0],
            )
            .unwrap();
    };
    run();
    let counted = allocation_counter::measure(run);
    assert_eq!(counted.count_total, 0);
    assert!(sum.is_finite());

    // The counter does count.
    let counted = allocation_counter::measure(|| {
        drop(roll_out(&body, Rk4::default(), &times, &inputs, 5, &start));
    });
    assert!(counted.count_total > 0);
}
