//! What roll-outs of mechanisms and their gradients take of memory.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use std::path::Path;
use std::sync::Arc;

use integrators::gradient::{Adjoint, RollOutGradient, Schedule};
use integrators::{Differentiable, Gradient, Jacobian, Method, Rk4, Space};
use lagrange::Mechanics;
use pinode_nn::effect::{default_smoothing, registry};
use pinode_nn::hybrid::{Hybrid, HybridMotion, Placed};
use pinode_nn::model::Model;
use pinode_nn::motion::Motion;

fn model(path: &str) -> Model {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    Model::load(&models.join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

type Any = Motion<Arc<dyn Mechanics>>;

/// The mechanics of a model with derivatives in all constants, and a state that moves, on the constraints where there are some.
fn moving(path: &str) -> (Any, Vec<f64>) {
    let model = model(path);
    let motion: Any = Motion::new(model.mechanics.clone())
        .with_constants(model.parameter_values)
        .unwrap();
    let all = (0..motion.constants().len()).collect();
    let motion = motion.with_parameters(all).unwrap();
    let mechanics = motion.mechanics();
    let generic = |seed: f64, size: f64| -> Vec<f64> {
        (0..mechanics.nv())
            .map(|i| size * (seed + 1.3 * i as f64).sin())
            .collect()
    };
    let q = mechanics
        .integrate(&mechanics.neutral(), &generic(0.4, 0.3))
        .unwrap();
    let v = generic(0.9, 0.5);
    let (q, v) = match mechanics.constraints() {
        None => (q, v),
        Some(c) => c.project_with(&q, &v, &[], motion.constants()).unwrap(),
    };
    let state = [q, v].concat();
    (motion, state)
}

/// One of each kind: a tree of few joints and one of many, text, a closed loop, a floating base.
const MECHANISMS: [&str; 5] = [
    "cartpole/cartpole.toml",
    "arm7/arm7.toml",
    "double_pendulum/double_pendulum_text.toml",
    "four_bar/four_bar.toml",
    "quadruped/quadruped.toml",
];

/// Allocations of the second of two equal calls.
fn of_the_second(mut call: impl FnMut()) -> u64 {
    call();
    allocation_counter::measure(call).count_total
}

/// Allocations of a step, of a linearisation and of a row pulled back, each at its second time.
fn allocations<S: Differentiable>(system: &S, u: &S::Input, state: &[f64]) -> [u64; 3]
where
    S::Error: std::fmt::Debug,
{
    let nt = system.space().tangent_dim();
    let (mut memory, mut rk4) = (system.memory(), Rk4::default());
    let mut x = state.to_vec();
    let step = of_the_second(|| {
        Method::step(&mut rk4, system, 0.0, 1e-3, u, &mut memory, &mut x).unwrap();
    });
    let (mut dx, mut jacobian) = (vec![0.0; nt], Jacobian::zeros(system));
    let linearize = of_the_second(|| {
        let at = (0.0, state, u);
        system
            .linearize(at, &mut memory, &mut dx, &mut jacobian)
            .unwrap();
    });
    let (weight, mut by) = (vec![1.0; nt], Gradient::zeros(system));
    let pull_back = of_the_second(|| {
        let at = (0.0, state, u);
        system
            .pull_back(at, &mut memory, &weight, &mut dx, &mut by)
            .unwrap();
    });
    assert!(by.state.iter().all(|x| x.is_finite()) && by.state.iter().any(|&x| x != 0.0));
    [step, linearize, pull_back]
}

#[test]
fn steps_and_derivatives_of_mechanisms_allocate_nothing() {
    // The counter counts.
    let vector = allocation_counter::measure(|| drop(std::hint::black_box(vec![1.0; 4])));
    assert_eq!(vector.count_total, 1);
    for path in MECHANISMS {
        let (motion, state) = moving(path);
        let u = vec![0.1; motion.mechanics().nv()];
        assert_eq!(allocations(&motion, &u, &state), [0; 3], "{path}");
    }
    let plain = Hybrid::of(&model("cartpole/cartpole.toml"));
    let mut changed = plain.clone();
    for (kind, target, values) in [
        ("added_mass", 2, &[0.02][..]),
        ("payload", 2, &[0.02, 1.5]),
        ("centre_of_mass", 2, &[0.9]),
        ("link_inertia", 2, &[3e-4]),
        ("reflected_inertia", 0, &[0.02]),
        ("gravity_tilt", 0, &[0.02]),
    ] {
        let placed = Placed {
            kind: registry::find(kind).unwrap(),
            target,
            smoothing: default_smoothing(false),
            fixed: false,
        };
        changed.add(placed, values);
    }
    for hybrid in [plain, changed] {
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let t: Vec<f64> = (0..=5).map(|k| 0.02 * f64::from(k)).collect();
        let u: Vec<f64> = t.iter().map(|t| 2.0 * (9.0 * t).sin()).collect();
        let inputs = hybrid.drive(&t, &[u], 20, &theta, &free);
        let motion = HybridMotion::new(&hybrid, &theta, &free, &inputs);
        let counted = allocations(&motion, &3, &[0.05, 2.4, 0.3, -2.0]);
        assert_eq!(counted, [0; 3], "a hybrid model, {:?}", hybrid.effects());
    }
}

/// Over `steps` steps in ten intervals: most bytes at one time that a new adjoint and its gradient take, and allocations of the same
/// gradient once more.
fn of_the_adjoint(motion: &Any, initial: &[f64], steps: usize, budget: usize) -> (u64, u64) {
    let times: Vec<f64> = (0..=10).map(|k| 1e-4 * (k * steps / 10) as f64).collect();
    let inputs = vec![vec![0.0; motion.mechanics().nv()]; 10];
    let schedule = Schedule {
        times: &times,
        inputs: &inputs,
        substeps: steps / 10,
    };
    let loss = |k: usize, x: &[f64], by: &mut [f64]| {
        by[0] = if k == 10 { 1.0 } else { 0.0 };
        by[0] * x[0]
    };
    let mut again = 0;
    let counted = allocation_counter::measure(|| {
        let mut out = RollOutGradient::default();
        let mut adjoint = Adjoint::new(motion, Rk4::default()).with_budget(budget);
        let mut run = || {
            adjoint
                .gradient(motion, schedule, initial, loss, &mut out)
                .unwrap();
        };
        run();
        if steps <= 1_000 {
            again = allocation_counter::measure(run).count_total;
        }
        assert!(out.initial.iter().any(|&x| x != 0.0));
    });
    (counted.bytes_max, again)
}

#[test]
fn memory_of_the_adjoint_of_a_mechanism_does_not_grow_with_the_steps() {
    // A budget that even the shorter roll-out fills.
    for (path, budget) in [
        ("cartpole/cartpole.toml", 64 << 10),
        ("four_bar/four_bar.toml", 128 << 10),
        ("quadruped/quadruped.toml", 1 << 20),
    ] {
        let (motion, state) = moving(path);
        // All but the states: of the shortest roll-out with the least memory for states.
        let (rest, again) = of_the_adjoint(&motion, &state, 10, 0);
        assert_eq!(again, 0, "{path}: the second of two equal gradients");
        let peaks = [1_000, 100_000].map(|steps| of_the_adjoint(&motion, &state, steps, budget).0);
        eprintln!("{path}: {peaks:?} bytes at 1e3 and 1e5 steps, {rest} without a budget");
        for bytes in peaks {
            assert!(
                bytes <= budget as u64 + rest,
                "{path}: {bytes} of {budget} and {rest}"
            );
            assert!(bytes > budget as u64 / 2, "{path}: {bytes} of {budget}");
        }
    }
}
