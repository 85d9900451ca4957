//! Mechanisms as systems of `integrators`: derivatives against differences, order of the methods, energy and momenta over long runs.

use std::path::Path;
use std::sync::Arc;

use integrators::ensemble::{LaneMember, roll_outs_in_lanes};
use integrators::gradient::{Adjoint, Column, RollOutGradient, Schedule, Sensitivity};
use integrators::{
    Differentiable, Gradient, Heun, Jacobian, Mechanical, Method, Order, Rk4, Space, StormerVerlet,
    System, Variational, roll_out,
};
use lagrange::{Dynamics, Mechanics, state, urdf};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use pinode_nn::model::Model;
use pinode_nn::motion::{FreeMotion, Motion, NotFree};

fn model(path: &str) -> Model {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    Model::load(&models.join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

type Any = Motion<Arc<dyn Mechanics>>;

/// The mechanics of a model, without its effects.
fn motion(path: &str) -> Any {
    let model = model(path);
    Motion::new(model.mechanics.clone())
        .with_constants(model.parameter_values)
        .unwrap()
}

fn free(path: &str) -> FreeMotion<Arc<dyn Mechanics>> {
    motion(path).free().unwrap()
}

/// The quadruped of the models in free space.
fn weightless_quadruped() -> FreeMotion<Arc<dyn Mechanics>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/quadruped/quadruped.urdf");
    let options = urdf::Options {
        gravity: [0.0; 3],
        floating_base: true,
        ..urdf::Options::default()
    };
    let robot = urdf::read(&std::fs::read_to_string(path).unwrap(), &options).unwrap();
    let mechanics: Arc<dyn Mechanics> = Arc::new(Dynamics::of(robot.tree));
    Motion::new(mechanics).free().unwrap()
}

/// Numbers in ± `range` that do not repeat.
fn generic(seed: f64, count: usize, range: f64) -> Vec<f64> {
    (0..count)
        .map(|i| range * (seed + 1.3 * i as f64 + 0.1 * seed * i as f64).sin())
        .collect()
}

/// A state away from 0, on the constraints where there are some.
fn start(motion: &Any, seed: f64, speed: f64) -> Vec<f64> {
    let mechanics = motion.mechanics();
    let moved = generic(seed, mechanics.nv(), 0.6);
    let q = mechanics.integrate(&mechanics.neutral(), &moved).unwrap();
    let v = generic(seed + 0.5, mechanics.nv(), speed);
    let (q, v) = match mechanics.constraints() {
        None => (q, v),
        Some(c) => c.project_with(&q, &v, &[], motion.constants()).unwrap(),
    };
    [q, v].concat()
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

const MECHANISMS: [&str; 6] = [
    "cartpole/cartpole.toml",
    "double_pendulum/double_pendulum_text.toml",
    "arm7/arm7.toml",
    "four_bar/four_bar.toml",
    "four_bar/four_bar_text.toml",
    "quadruped/quadruped.toml",
];

/// The same with derivatives in every other constant, last first.
fn with_some_parameters(motion: Any) -> Any {
    let some = (0..motion.constants().len()).rev().step_by(2).collect();
    motion.with_parameters(some).unwrap()
}

#[test]
fn the_linear_system_is_that_of_differences() {
    for path in MECHANISMS {
        let motion = with_some_parameters(motion(path));
        let x = start(&motion, 0.4, 1.5);
        let (nv, nt) = (motion.mechanics().nv(), motion.space().tangent_dim());
        let u = generic(1.1, nv, 2.0);
        let mut memory = motion.memory();
        let (mut dx, mut by) = (vec![0.0; nt], Jacobian::zeros(&motion));
        motion
            .linearize((0.0, &x, &u), &mut memory, &mut dx, &mut by)
            .unwrap();
        let mut rate = vec![0.0; nt];
        motion.rate(0.0, &x, &u, &mut memory, &mut rate).unwrap();
        for (a, b) in dx.iter().zip(&rate) {
            assert!((a - b).abs() <= 1e-12 * largest(&rate), "{path}: {a} {b}");
        }

        let h = 1e-5;
        let close = |what: &str, column: &[f64], up: Vec<f64>, down: Vec<f64>, scale: f64| {
            for (i, exact) in column.iter().enumerate() {
                let found = (up[i] - down[i]) / (2.0 * h);
                assert!(
                    (found - exact).abs() < 1e-7 * scale.max(1.0),
                    "{path}: row {i} {what}: {exact} and {found} by differences, of {scale}"
                );
            }
        };
        for j in 0..nt {
            let at = |sign: f64| {
                let mut xi = vec![0.0; nt];
                xi[j] = sign * h;
                let mut moved = vec![0.0; x.len()];
                motion.space().move_into(&x, &xi, &mut moved);
                let mut out = vec![0.0; nt];
                motion
                    .rate(0.0, &moved, &u, &mut motion.memory(), &mut out)
                    .unwrap();
                out
            };
            let column: Vec<f64> = by.state.column(j).iter().copied().collect();
            close(
                &format!("by x[{j}]"),
                &column,
                at(1.0),
                at(-1.0),
                by.state.amax(),
            );
        }
        for j in 0..nv {
            let at = |sign: f64| {
                let mut force = u.clone();
                force[j] += sign * h;
                let mut out = vec![0.0; nt];
                motion
                    .rate(0.0, &x, &force, &mut motion.memory(), &mut out)
                    .unwrap();
                out
            };
            let column: Vec<f64> = by.input.column(j).iter().copied().collect();
            close(
                &format!("by Q[{j}]"),
                &column,
                at(1.0),
                at(-1.0),
                by.input.amax(),
            );
        }
        // In relative changes of the constants, which are of very different size.
        let sizes: Vec<f64> = (motion.parameters().iter())
            .map(|&constant| motion.constants()[constant].abs().max(1e-3))
            .collect();
        for (mut column, size) in by.parameters.column_iter_mut().zip(&sizes) {
            column *= *size;
        }
        let scale = by.parameters.amax();
        for (k, &constant) in motion.parameters().iter().enumerate() {
            let at = |sign: f64| {
                let mut constants = motion.constants().to_vec();
                constants[constant] += sign * h * sizes[k];
                let other = motion.clone().with_constants(constants).unwrap();
                let mut out = vec![0.0; nt];
                other
                    .rate(0.0, &x, &u, &mut other.memory(), &mut out)
                    .unwrap();
                out
            };
            let column: Vec<f64> = by.parameters.column(k).iter().copied().collect();
            close(
                &format!("by p[{constant}]"),
                &column,
                at(1.0),
                at(-1.0),
                scale,
            );
        }
    }
}

#[test]
fn a_row_pulled_back_is_its_product_with_the_linear_system() {
    for path in MECHANISMS {
        let motion = with_some_parameters(motion(path));
        let x = start(&motion, 0.9, 2.0);
        let (nv, nt) = (motion.mechanics().nv(), motion.space().tangent_dim());
        let u = generic(0.3, nv, 3.0);
        let weight = generic(2.2, nt, 1.0);
        let mut memory = motion.memory();
        let (mut dx, mut by) = (vec![0.0; nt], Jacobian::zeros(&motion));
        let at = (0.0, x.as_slice(), &u);
        motion.linearize(at, &mut memory, &mut dx, &mut by).unwrap();
        let (mut again, mut row) = (vec![0.0; nt], Gradient::zeros(&motion));
        // It adds to what is there.
        row.state.fill(0.25);
        row.input.fill(0.25);
        row.parameters.fill(0.25);
        motion
            .pull_back(at, &mut memory, &weight, &mut again, &mut row)
            .unwrap();
        for (a, b) in dx.iter().zip(&again) {
            assert!((a - b).abs() <= 1e-11 * largest(&dx), "{path}: {a} {b}");
        }
        for (what, matrix, row) in [
            ("x", &by.state, &row.state),
            ("u", &by.input, &row.input),
            ("p", &by.parameters, &row.parameters),
        ] {
            for (j, found) in row.iter().enumerate() {
                let column = matrix.column(j);
                let expected = 0.25 + dot(&weight, column.as_slice());
                let scale = matrix.amax().max(1.0);
                assert!(
                    (found - expected).abs() < 1e-11 * scale,
                    "{path}: {what}[{j}]: {found} and {expected}"
                );
            }
        }
    }
}

#[test]
fn a_force_of_the_wrong_length_is_a_typed_error() {
    let motion = motion("arm7/arm7.toml");
    let x = start(&motion, 0.0, 1.0);
    let refused = motion.rate(0.0, &x, &vec![0.0; 6], &mut motion.memory(), &mut [0.0; 14]);
    assert_eq!(
        refused.unwrap_err().to_string(),
        "the generalized force Q has 6 entries, this mechanism takes 7"
    );
    let refused = motion.clone().with_parameters(vec![0, 99]).unwrap_err();
    assert_eq!(refused.index, 99);
    let count = motion.constants().len();
    assert!(motion.clone().with_constants(vec![1.0; count + 1]).is_err());
    assert!(motion.with_constants(vec![f64::NAN; count]).is_err());
}

#[test]
fn what_has_no_momenta_is_refused_with_the_reason() {
    let refused = motion("four_bar/four_bar.toml").free().unwrap_err();
    assert!(
        matches!(refused, NotFree::Constrained { count: 2, .. }),
        "{refused}"
    );
    assert!(
        refused.to_string().contains("obeys 2 constraints"),
        "{refused}"
    );

    // A bead on a wire that turns: T has a part that does not depend on v.
    let model = model("bead_on_hoop/driven.toml");
    let refused = Motion::new(model.mechanics.clone()).free().unwrap_err();
    assert!(matches!(refused, NotFree::NotQuadratic { .. }), "{refused}");

    for (path, reason) in [
        ("cartpole/cartpole.toml", "M depends on q"),
        ("quadruped/quadruped.toml", "`base` floats"),
    ] {
        let refused = StormerVerlet::new(&free(path)).unwrap_err();
        assert!(refused.reason.contains(reason), "{refused}");
    }
    assert!(StormerVerlet::new(&free("single_pendulum/single_pendulum.toml")).is_ok());
}

#[test]
fn the_velocity_undoes_the_momentum() {
    for path in [
        "cartpole/cartpole.toml",
        "arm7/arm7.toml",
        "quadruped/quadruped.toml",
    ] {
        let motion = free(path);
        let x = start(motion.motion(), 1.4, 3.0);
        let (q, v) = x.split_at(motion.positions().dim());
        let mut memory = motion.memory();
        let mut p = vec![0.0; v.len()];
        motion.momentum((q, v), &mut memory, &mut p).unwrap();
        let mass = motion.motion().mechanics().mass_matrix(q).unwrap();
        let expected = mass * nalgebra::DVector::from_column_slice(v);
        for (p, e) in p.iter().zip(expected.iter()) {
            assert!((p - e).abs() < 1e-13 * expected.amax(), "{path}: {p} {e}");
        }
        motion.velocity(q, &mut memory, &mut p).unwrap();
        for (found, v) in p.iter().zip(v) {
            assert!((found - v).abs() < 1e-11, "{path}: {found} {v}");
        }
    }
}

/// The momentum changes by ad_vᵀ p + ∂L/∂q + Q: against differences along a motion.
#[test]
fn momenta_change_by_the_force_and_with_their_axes() {
    for path in [
        "cartpole/cartpole.toml",
        "arm7/arm7.toml",
        "quadruped/quadruped.toml",
    ] {
        let motion = free(path);
        let x = start(motion.motion(), 0.2, 2.0);
        let (nq, nv) = (motion.positions().dim(), motion.positions().tangent_dim());
        let u = generic(0.7, nv, 4.0);
        let mut memory = motion.memory();
        let mut rate = vec![0.0; nv];
        let mut p = vec![0.0; nv];
        let at = x.split_at(nq);
        motion
            .position_force(0.0, at, &u, &mut memory, &mut rate)
            .unwrap();
        motion.momentum(at, &mut memory, &mut p).unwrap();
        let mut turned = vec![0.0; nv];
        motion.positions().cobracket_into(at.1, &p, &mut turned);
        let h = 1e-5;
        let mut after = |h: f64| {
            let mut x = x.clone();
            Method::step(
                &mut Rk4::default(),
                &motion,
                0.0,
                h,
                &u,
                &mut memory,
                &mut x,
            )
            .unwrap();
            let mut p = vec![0.0; nv];
            motion
                .momentum(x.split_at(nq), &mut memory, &mut p)
                .unwrap();
            p
        };
        let (up, down) = (after(h), after(-h));
        let scale = largest(&rate) + largest(&turned);
        for i in 0..nv {
            let (found, expected) = ((up[i] - down[i]) / (2.0 * h), rate[i] + turned[i]);
            assert!(
                (found - expected).abs() < 1e-7 * scale,
                "{path}: {i}: {found} by differences, {expected}"
            );
        }
    }
}

/// x after `time` in steps of at most `h`.
fn rolled<S: System<Input = Vec<f64>>>(
    system: &S,
    mut method: impl Method<S>,
    (time, steps): (f64, u32),
    u: &Vec<f64>,
    x: &[f64],
) -> Vec<f64>
where
    S::Error: std::error::Error,
{
    let h = time / f64::from(steps);
    let mut x = x.to_vec();
    let mut memory = system.memory();
    for k in 0..steps {
        method
            .step(system, f64::from(k) * h, h, u, &mut memory, &mut x)
            .unwrap_or_else(|e| panic!("step {k}: {e}"));
    }
    x
}

/// Orders measured between three halvings of the step, from the errors against steps that are far shorter.
fn orders<S: System<Input = Vec<f64>>, M: Method<S>>(
    system: &S,
    method: impl Fn() -> M,
    (time, steps): (f64, u32),
    x: &[f64],
) -> Vec<f64>
where
    S::Error: std::error::Error,
{
    let u = vec![0.0; system.space().tangent_dim() / 2];
    let exact = rolled(system, Rk4::default(), (time, 64 * steps), &u, x);
    let errors: Vec<f64> = (0..3)
        .map(|k| {
            let end = rolled(system, method(), (time, steps << k), &u, x);
            let mut missed = vec![0.0; system.space().tangent_dim()];
            system.space().difference_into(&exact, &end, &mut missed);
            missed.iter().map(|e| e * e).sum::<f64>().sqrt()
        })
        .collect();
    errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect()
}

#[test]
fn methods_have_their_order_on_an_arm_and_on_a_floating_quadruped() {
    for (path, steps) in [("arm7/arm7.toml", 100), ("quadruped/quadruped.toml", 100)] {
        let motion = free(path);
        let x = start(motion.motion(), 0.6, 1.0);
        let span = (0.4, steps);
        let two = || Variational::new(&motion, Order::Two);
        let four = || Variational::new(&motion, Order::Four);
        for (name, order, found) in [
            ("Heun", 2.0, orders(&motion, Heun::default, span, &x)),
            ("RK4", 4.0, orders(&motion, Rk4::default, span, &x)),
            ("variational, 2", 2.0, orders(&motion, two, span, &x)),
            ("variational, 4", 4.0, orders(&motion, four, span, &x)),
        ] {
            eprintln!("{path}, {name}: {found:.3?}");
            for o in found {
                assert!((o - order).abs() < 0.2, "{path}, {name}: order {o}");
            }
        }
    }
}

#[test]
fn quaternions_stay_of_length_one_under_every_method() {
    let motion = free("quadruped/quadruped.toml");
    let x = start(motion.motion(), 0.1, 4.0);
    let u = vec![0.0; 18];
    let span = (1.0, 400);
    for end in [
        rolled(&motion, Rk4::default(), span, &u, &x),
        rolled(&motion, Heun::default(), span, &u, &x),
        rolled(&motion, Variational::new(&motion, Order::Two), span, &u, &x),
    ] {
        let length = end[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((length - 1.0).abs() < 4.0 * f64::EPSILON, "{length}");
    }
}

fn energy(motion: &FreeMotion<Arc<dyn Mechanics>>, x: &[f64]) -> f64 {
    let motion = motion.motion();
    let (q, v) = x.split_at(motion.mechanics().nq());
    motion
        .mechanics()
        .kinetic_energy_with(q, v, motion.constants())
        + motion
            .mechanics()
            .potential_energy_with(q, motion.constants())
}

/// E − E₀ after every step.
fn energy_errors(
    motion: &FreeMotion<Arc<dyn Mechanics>>,
    mut method: impl Method<FreeMotion<Arc<dyn Mechanics>>>,
    (h, steps): (f64, u32),
    x: &[f64],
) -> Vec<f64> {
    let mut x = x.to_vec();
    let first = energy(motion, &x);
    let u = vec![0.0; motion.positions().tangent_dim()];
    let mut memory = motion.memory();
    (0..steps)
        .map(|k| {
            method
                .step(motion, f64::from(k) * h, h, &u, &mut memory, &mut x)
                .unwrap_or_else(|e| panic!("step {k}: {e}"));
            energy(motion, &x) - first
        })
        .collect()
}

/// The rise of the least-squares line through the errors, over the whole run.
fn trend(errors: &[f64]) -> f64 {
    let n = errors.len() as f64;
    let middle = 0.5 * (n - 1.0);
    let mean = errors.iter().sum::<f64>() / n;
    let (mut up, mut wide) = (0.0, 0.0);
    for (k, e) in errors.iter().enumerate() {
        let k = k as f64 - middle;
        up += k * (e - mean);
        wide += k * k;
    }
    up / wide * n
}

/// The energy of the variational method swings and does not drift; that of RK4 with the same steps drifts.
#[test]
fn the_energy_of_a_long_free_motion_stays_under_the_variational_method() {
    for (path, h, steps, speed) in [
        ("double_pendulum/double_pendulum.toml", 5e-3, 40_000, 2.0),
        ("arm7/arm7.toml", 2e-3, 20_000, 0.5),
    ] {
        let motion = free(path);
        let x = start(motion.motion(), 0.6, speed);
        let variational = Variational::new(&motion, Order::Two);
        let errors = energy_errors(&motion, variational, (h, steps), &x);
        let (half, all) = (largest(&errors[..errors.len() / 2]), largest(&errors));
        let drift = trend(&errors);
        eprintln!("{path}: swings by {half:e} and {all:e} J, trend {drift:e} J");
        assert!(all < 2.0 * half, "{path}: {half:e} J, then {all:e} J");
        assert!(drift.abs() < 0.25 * all, "{path}: {drift:e} J of {all:e} J");
    }
}

/// Momentum of a floating tree in the world's axes about the world's origin, linear and angular, from M v.
fn spatial_momentum(motion: &FreeMotion<Arc<dyn Mechanics>>, x: &[f64]) -> [Vector3<f64>; 2] {
    let (q, v) = x.split_at(motion.positions().dim());
    let mut p = vec![0.0; v.len()];
    motion
        .momentum((q, v), &mut motion.memory(), &mut p)
        .unwrap();
    let turn = UnitQuaternion::new_unchecked(Quaternion::new(q[3], q[4], q[5], q[6]));
    let linear = turn * Vector3::from_row_slice(&p[..3]);
    let place = Vector3::from_row_slice(&q[..3]);
    [
        linear,
        turn * Vector3::from_row_slice(&p[3..6]) + place.cross(&linear),
    ]
}

#[test]
fn a_quadruped_in_free_space_keeps_its_momenta_to_rounding_and_its_energy_without_trend() {
    let motion = weightless_quadruped();
    let x = start(motion.motion(), 0.3, 1.0);
    let before = spatial_momentum(&motion, &x);
    let first = energy(&motion, &x);
    let (h, steps) = (4e-3, 10_000);
    let mut method = Variational::new(&motion, Order::Two);
    let (mut end, mut memory) = (x.clone(), motion.memory());
    let mut errors = Vec::new();
    for k in 0..steps {
        method
            .step(
                &motion,
                f64::from(k) * h,
                h,
                &vec![0.0; 18],
                &mut memory,
                &mut end,
            )
            .unwrap_or_else(|e| panic!("step {k}: {e}"));
        errors.push(energy(&motion, &end) - first);
    }
    for (before, after) in before.iter().zip(spatial_momentum(&motion, &end)) {
        let lost = (after - before).norm() / before.norm();
        eprintln!("lost of the momentum {:.3}: {lost:e}", before.norm());
        assert!(lost < 1e-11, "{lost:e}");
    }
    let (half, all) = (largest(&errors[..errors.len() / 2]), largest(&errors));
    let drift = trend(&errors);
    eprintln!("of {first} J swings by {half:e} and {all:e} J, trend {drift:e} J");
    assert!(all < 2.0 * half && drift.abs() < 0.25 * all);
    // It has turned and moved its legs.
    let mut moved = vec![0.0; 36];
    motion.space().difference_into(&x, &end, &mut moved);
    assert!(largest(&moved[..18]) > 1.0);
    assert!(state::check_unit(motion.motion().mechanics().coordinates(), &end[..19]).is_ok());
}

/// A loss of all samples, and its derivative along the directions of motion: c_k · x_k with other c in every sample.
fn loss(motion: &Any, k: usize, x: &[f64], by: &mut [f64]) -> f64 {
    let c = generic(0.5 + k as f64, x.len(), 1.0);
    let (nq, nv) = (motion.mechanics().nq(), motion.mechanics().nv());
    for j in 0..nv {
        let mut unit = vec![0.0; nv];
        unit[j] = 1.0;
        // ∂q/∂ξ_j is the rate of q at the velocity 1 along j.
        let rate = state::position_rate(motion.mechanics().coordinates(), &x[..nq], &unit);
        by[j] = dot(&c, &rate.unwrap());
        by[nv + j] = c[nq + j];
    }
    dot(&c, x)
}

/// Gradients of roll-outs in everything: the adjoint against forward sensitivities and against differences.
#[test]
fn gradients_of_roll_outs_are_those_of_differences() {
    for (path, parameters) in [
        ("cartpole/cartpole.toml", 2),
        ("arm7/arm7.toml", 3),
        ("four_bar/four_bar.toml", 2),
        ("four_bar/four_bar_text.toml", 4),
        ("quadruped/quadruped.toml", 2),
    ] {
        let motion = motion(path);
        let count = motion.constants().len();
        let some = (0..count).step_by((count / parameters).max(1)).collect();
        let motion = motion.with_parameters(some).unwrap();
        let x = start(&motion, 0.4, 1.0);
        let (nv, nt) = (motion.mechanics().nv(), motion.space().tangent_dim());
        let times = [0.0, 0.02, 0.05, 0.08];
        let inputs: Vec<Vec<f64>> = (0..3).map(|k| generic(f64::from(k), nv, 2.0)).collect();
        let schedule = Schedule {
            times: &times,
            inputs: &inputs,
            substeps: 5,
        };
        let mut by = RollOutGradient {
            inputs: nalgebra::DMatrix::zeros(nv, 3),
            ..RollOutGradient::default()
        };
        Adjoint::new(&motion, Rk4::default())
            .gradient(
                &motion,
                schedule,
                &x,
                |k, x, by| loss(&motion, k, x, by),
                &mut by,
            )
            .unwrap();

        // Forwards, in everything.
        let mut columns = Column::initial_and_parameters(&motion);
        columns.extend(Column::inputs(&motion, 0..3));
        let mut forwards = vec![0.0; columns.len()];
        Sensitivity::new(&motion, Rk4::default())
            .roll_out(&motion, schedule, &x, &columns, |k, x, columns| {
                let mut by = vec![0.0; nt];
                loss(&motion, k, x, &mut by);
                for (sum, column) in forwards.iter_mut().zip(columns.column_iter()) {
                    *sum += dot(&by, column.as_slice());
                }
            })
            .unwrap();
        let backwards = [by.initial.as_slice(), &by.parameters, by.inputs.as_slice()].concat();
        let size = largest(&backwards);
        for (i, (a, b)) in backwards.iter().zip(&forwards).enumerate() {
            assert!(
                (a - b).abs() < 1e-11 * size,
                "{path}: {i}: {a} back, {b} forth"
            );
        }

        let value = |motion: &Any, x: &[f64], inputs: &[Vec<f64>]| -> f64 {
            let rolled = roll_out(motion, Rk4::default(), &times, inputs, 5, x).unwrap();
            let mut unused = vec![0.0; nt];
            let each = rolled.iter().enumerate();
            each.map(|(k, x)| loss(motion, k, x, &mut unused)).sum()
        };
        // Of each kind of variable beside the largest derivative of its kind.
        let close = |what: &str, exact: &[f64], h: f64, value: &dyn Fn(usize, f64) -> f64| {
            for (j, exact_j) in exact.iter().enumerate() {
                let found = (value(j, h) - value(j, -h)) / (2.0 * h);
                assert!(
                    (found - exact_j).abs() < 1e-6 * largest(exact),
                    "{path}: {what}[{j}]: {exact_j}, {found} by differences"
                );
            }
        };
        close("x", &by.initial, 1e-5, &|j, h| {
            let mut xi = vec![0.0; nt];
            xi[j] = h;
            let mut moved = vec![0.0; x.len()];
            motion.space().move_into(&x, &xi, &mut moved);
            value(&motion, &moved, &inputs)
        });
        close("u", by.inputs.as_slice(), 1e-4, &|j, h| {
            let mut inputs = inputs.clone();
            inputs[j / nv][j % nv] += h;
            value(&motion, &x, &inputs)
        });
        // In relative changes of the constants.
        let size = |k: usize| motion.constants()[motion.parameters()[k]].abs();
        let relative: Vec<f64> = (by.parameters.iter().enumerate())
            .map(|(k, d)| d * size(k))
            .collect();
        close("p", &relative, 1e-5, &|j, h| {
            let mut constants = motion.constants().to_vec();
            constants[motion.parameters()[j]] *= 1.0 + h;
            let other = motion.clone().with_constants(constants).unwrap();
            value(&other, &x, &inputs)
        });
    }
}

#[test]
fn roll_outs_in_lanes_are_those_of_one_state_at_a_time() {
    for path in [
        "cartpole/cartpole.toml",
        "arm7/arm7.toml",
        "quadruped/quadruped.toml",
    ] {
        let motion = motion(path);
        let nv = motion.mechanics().nv();
        let times = [0.0, 0.05, 0.1];
        let starts: Vec<Vec<f64>> = (0..11)
            .map(|k| start(&motion, 0.3 * f64::from(k), 1.0))
            .collect();
        let inputs: Vec<Vec<Vec<f64>>> = (0..11)
            .map(|k| vec![generic(f64::from(k), nv, 1.0), vec![0.0; nv]])
            .collect();
        let members: Vec<LaneMember<'_, Vec<f64>>> = starts
            .iter()
            .zip(&inputs)
            .map(|(initial, inputs)| LaneMember { inputs, initial })
            .collect();
        let rolled = roll_outs_in_lanes(&motion, &Rk4::default(), &times, 20, &members);
        for ((lane, initial), inputs) in rolled.into_iter().zip(&starts).zip(&inputs) {
            let alone = roll_out(&motion, Rk4::default(), &times, inputs, 20, initial).unwrap();
            let lane = lane.unwrap();
            for (a, b) in lane.iter().flatten().zip(alone.iter().flatten()) {
                assert!((a - b).abs() < 1e-11 * b.abs().max(1.0), "{path}: {a} {b}");
            }
        }
    }
}
