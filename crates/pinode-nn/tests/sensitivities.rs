//! Roll-outs of the cart-pole with every kind of effect at once: exact sensitivities against differences.

use std::path::Path;
use std::sync::Arc;

use integrators::{Differentiable, Gradient, Jacobian, Space, System};
use pinode_nn::effect::{ActsOn, default_smoothing, registry};
use pinode_nn::hybrid::{ConstantId, Hybrid, HybridMotion, Placed};
use pinode_nn::learnt::{Feature, LearntForce, Output, Quantity};
use pinode_nn::model::Model;
use pinode_nn::network::{Activation, Mlp, Shape};
use pinode_nn::shooting::{Roller, Trajectory};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const SUBSTEPS: usize = 4;

fn load(path: &str) -> Model {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    Model::load(&models.join(path)).unwrap()
}

/// The cart-pole with each kind of effect on the slider (or its sensor, or the motor, or the link of the pole), and friction on the pole, and one of the kinds that
/// may stand between the motor and the slider; all of θ free.
fn with_every_effect(transmission: &str) -> Hybrid {
    let model = load("cartpole/cartpole.toml");
    let mut hybrid = Hybrid::of(&model);
    let links = hybrid.links().to_vec();
    for kind in registry::ALL.iter().copied() {
        if kind.is_transmission() && kind.name != transmission {
            continue;
        }
        let values: &[f64] = match kind.name {
            "viscous_friction" => &[0.3],
            "coulomb_friction" => &[0.1],
            "asymmetric_coulomb_friction" => &[0.2, 0.15],
            "stribeck_friction" => &[0.05, 0.12, 0.06],
            "quadratic_drag" => &[0.4],
            "linear_spring" => &[2.0, 0.05],
            "cubic_spring" => &[30.0],
            "constant_force" => &[-0.1],
            "end_stop" => &[0.03, 0.08, 150.0, 4.0],
            "input_gain_error" => &[0.1],
            "input_delay" => &[0.0312],
            "asymmetric_viscous_friction" => &[0.1, 0.25],
            "load_dependent_friction" => &[0.07],
            "position_dependent_friction" => &[0.05, 0.3],
            "periodic_force" => &[0.1, 0.06, 0.4],
            "input_offset" => &[0.15],
            "actuator_lag" => &[0.03],
            "input_dead_zone" => &[0.2],
            "input_saturation" => &[1.9],
            "backlash" => &[0.01, 900.0, 3.0, 0.07, 1.0],
            "elastic_transmission" => &[300.0, 2.0, 0.07, 0.3, 1.0, 1.0],
            "sensor_offset" => &[0.02],
            "sensor_scale" => &[0.03],
            "sensor_delay" => &[0.027],
            "dahl_friction" => &[40.0, 0.2],
            "lugre_friction" => &[60.0, 0.4, 0.1, 0.2, 0.1],
            "hysteresis" => &[12.0, 0.02],
            "added_mass" => &[0.02],
            "payload" => &[0.02, 1.4],
            "centre_of_mass" => &[1.2],
            "link_inertia" => &[3e-4],
            "reflected_inertia" => &[0.02],
            "gravity_tilt" => &[0.02],
            other => panic!("{other} is new: give it parameters here"),
        };
        let angular = false;
        let placed = Placed {
            kind,
            target: match kind.acts_on() {
                ActsOn::Link => links.iter().position(|l| l.name == "pole").unwrap(),
                _ => 0,
            },
            smoothing: 10.0 * default_smoothing(angular),
            fixed: false,
        };
        hybrid.add(placed, values);
    }
    hybrid.add_open_network(Arc::new(learnt()), f64::INFINITY);
    for constant in hybrid.constants_mut() {
        constant.tolerance = f64::INFINITY;
    }
    hybrid
}

/// A network that sees a position, an angle's cosine, a velocity and an input and acts on both coordinates.
fn learnt() -> LearntForce {
    let feature = |quantity, offset, width| Feature {
        quantity,
        offset,
        width,
        range: [-1.0, 1.0],
    };
    let features = vec![
        feature(Quantity::Position(0), 0.02, 0.1),
        feature(Quantity::Cosine(1), 0.0, 1.0),
        feature(Quantity::Velocity(1), -0.5, 3.0),
        feature(Quantity::Input { input: 0, back: 1 }, 0.1, 2.0),
    ];
    let shape = Shape::new(&[4, 5, 2], Activation::Tanh, Activation::Identity).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let network = Mlp::xavier(shape, &mut rng);
    let outputs = [(0, 0.3), (1, 0.01)].map(|(coordinate, scale)| Output { coordinate, scale });
    LearntForce::new(network, features, outputs.to_vec(), false).unwrap()
}

/// (q, v, h) with what the effects remember of before.
fn initial(hybrid: &Hybrid) -> Vec<f64> {
    let mut x = vec![0.05, 2.4, 0.3, -2.0];
    for effect in hybrid.effects() {
        let h: &[f64] = match effect.kind.name {
            "dahl_friction" => &[0.003],
            "lugre_friction" => &[-0.001],
            "hysteresis" => &[0.004],
            "elastic_transmission" => &[0.01, 0.2],
            "backlash" => &[-0.006, 0.5],
            _ => &[],
        };
        x.extend(h);
    }
    assert_eq!(x.len(), hybrid.nx());
    x
}

/// As many inputs as `hybrid` has.
fn times_and_inputs(hybrid: &Hybrid) -> (Vec<f64>, Vec<Vec<f64>>) {
    let t: Vec<f64> = (0..40).map(|k| 0.02 * f64::from(k)).collect();
    let u = |i: usize| {
        let of = |t: &f64| 2.0 * (9.0 * t + i as f64).sin() + (23.0 * t).cos();
        t.iter().map(of).collect()
    };
    let u = (0..hybrid.inputs()).map(u).collect();
    (t, u)
}

fn rolled(hybrid: &Hybrid, theta: &[f64], initial: &[f64]) -> Vec<f64> {
    let (t, u) = times_and_inputs(hybrid);
    let inputs = hybrid.drive(&t, &u, SUBSTEPS, theta, &[]);
    let mut out = Trajectory::default();
    Roller::new(hybrid, &[])
        .roll(theta, &inputs, (5, 30), initial, &mut out)
        .unwrap();
    out.states
}

#[test]
fn sensitivities_of_a_roll_out_equal_differences() {
    for transmission in ["none", "elastic_transmission", "backlash"] {
        let hybrid = with_every_effect(transmission);
        equal_differences(&hybrid, &initial(&hybrid));
    }
}

/// What pushes links turns with them: two fans, one of them late, with gains that are free as well.
#[test]
fn sensitivities_of_a_roll_out_under_inputs_that_turn_with_links_equal_differences() {
    for (hybrid, x) in [hovercraft(), quadrotor("angles")] {
        equal_differences(&hybrid, &x);
    }
}

fn free_of(model: Model) -> Hybrid {
    let mut hybrid = Hybrid::of(&model);
    let delay = Placed {
        kind: registry::find("input_delay").unwrap(),
        target: 1,
        smoothing: default_smoothing(false),
        fixed: false,
    };
    hybrid.add(delay, &[0.0312]);
    for constant in hybrid.constants_mut() {
        constant.tolerance = f64::INFINITY;
    }
    hybrid
}

fn hovercraft() -> (Hybrid, Vec<f64>) {
    let model = load("hovercraft/hovercraft.toml");
    (free_of(model), vec![0.3, -0.2, 0.7, 0.5, -0.4, 1.3])
}

/// With its pose as `quaternion` or `angles`.
fn quadrotor(pose: &str) -> (Hybrid, Vec<f64>) {
    let model = load("quadrotor/quadrotor.toml");
    let spin = [0.3, -0.1, 0.2, 0.4, -0.6, 0.8];
    match pose {
        "angles" => {
            let model = model.by_angles(lagrange::mechanism::Axis::X).unwrap();
            let x = [0.1, 0.2, -0.3, 0.5, -0.4, 0.6];
            (free_of(model), [x, spin].concat())
        }
        _ => {
            let hybrid = free_of(model);
            let mechanics = hybrid.mechanics();
            let moved = [0.1, 0.2, -0.3, 0.5, -0.4, 0.6];
            let mut x = mechanics.integrate(&mechanics.neutral(), &moved).unwrap();
            x.extend(spin);
            (hybrid, x)
        }
    }
}

/// The four-bar with friction on its rocker; the lengths in its constraints are free as well.
#[test]
fn sensitivities_of_a_constrained_roll_out_equal_differences() {
    let model = load("four_bar/four_bar_text.toml");
    let constraints = model.mechanics.constraints().unwrap();
    let (q, v) = constraints
        .project_with(
            &[0.4, 0.0, 0.0],
            &[3.0, 0.0, 0.0],
            &[0],
            &model.parameter_values,
        )
        .unwrap();
    let mut hybrid = Hybrid::of(&model);
    let placed = Placed {
        kind: registry::find("viscous_friction").unwrap(),
        target: 2,
        smoothing: default_smoothing(true),
        fixed: false,
    };
    hybrid.add(placed, &[0.02]);
    hybrid.add_open_network(Arc::new(learnt()), f64::INFINITY);
    for constant in hybrid.constants_mut() {
        constant.tolerance = f64::INFINITY;
    }
    // As strong as the weights of the bars are on the crank.
    for constant in hybrid.constants_mut() {
        if matches!(constant.id, ConstantId::Gain(_)) {
            constant.value = 0.05;
        }
    }
    let initial: Vec<f64> = q.into_iter().chain(v).collect();
    equal_differences(&hybrid, &initial);
}

fn equal_differences(hybrid: &Hybrid, initial: &[f64]) {
    let theta = hybrid.theta();
    let free = hybrid.free();
    assert_eq!(free.len(), theta.len());
    let (t, u) = times_and_inputs(hybrid);
    let inputs = hybrid.drive(&t, &u, SUBSTEPS, &theta, &free);
    let mut roller = Roller::new(hybrid, &free);
    let mut out = Trajectory::default();
    roller
        .roll_with_sensitivities(&theta, &inputs, (5, 30), initial, &mut out)
        .unwrap();
    assert_eq!(out.states, rolled(hybrid, &theta, initial));

    let (nx, columns) = (initial.len(), roller.columns());
    for column in 0..columns {
        let shifted = |h: f64| {
            let (mut theta, mut initial) = (theta.clone(), initial.to_vec());
            match column.checked_sub(nx) {
                Some(k) => theta[free[k]] += h,
                None => initial[column] += h,
            }
            rolled(hybrid, &theta, &initial)
        };
        let scale = match column.checked_sub(nx) {
            Some(k) => theta[free[k]].abs().max(0.1),
            None => 1.0,
        };
        let h = 1e-6 * scale;
        let (plus, minus) = (shifted(h), shifted(-h));
        let (plus_2, minus_2) = (shifted(2.0 * h), shifted(-2.0 * h));
        // A sensor changes what is read, not the motion.
        let name = hybrid
            .constants()
            .get(column.wrapping_sub(nx))
            .map(|c| c.id);
        let mut largest = 0.0_f64;
        for k in 0..30 {
            for i in 0..nx {
                let at = k * nx + i;
                let difference =
                    (8.0 * (plus[at] - minus[at]) - (plus_2[at] - minus_2[at])) / (12.0 * h);
                let exact = out.sensitivities[(k * columns + column) * nx + i];
                largest = largest.max(exact.abs());
                let error = (exact - difference).abs();
                let allowed = 1e-4 * (exact.abs() + 1e-2 / scale);
                assert!(
                    error < allowed,
                    "{name:?}, sample {k}, state {i}: {exact} {difference}"
                );
            }
        }
        let silent = match name {
            Some(ConstantId::Zero(_)) => true,
            // Behind a transmission no force of an input acts on the joint itself.
            Some(ConstantId::Effect(effect, k)) => {
                let kind = hybrid.effects()[effect].kind;
                let carried = hybrid.effects().iter().any(|e| e.kind.is_transmission());
                // A yes is a yes, however large.
                kind.acts_on() == ActsOn::Sensor
                    || kind.parameters[k].is_flag
                    || (kind.name == "load_dependent_friction" && carried)
            }
            _ => false,
        };
        assert_eq!(largest == 0.0, silent, "{name:?} moves nothing");
    }
}

#[test]
fn a_delay_of_whole_steps_shifts_the_input_and_any_delay_keeps_its_impulse() {
    let mut hybrid = Hybrid::of(&load("cartpole/cartpole.toml"));
    let delay = registry::find("input_delay").unwrap();
    let placed = Placed {
        kind: delay,
        target: 0,
        smoothing: default_smoothing(false),
        fixed: false,
    };
    hybrid.add(placed, &[0.0]);
    let (t, mut u) = times_and_inputs(&hybrid);
    u[0][..2].fill(0.0);
    u[0][35..].fill(0.0);
    let forces = |seconds: f64| {
        let mut theta = hybrid.theta();
        *theta.last_mut().unwrap() = seconds;
        let inputs = hybrid.drive(&t, &u, SUBSTEPS, &theta, &[]);
        inputs.forces[0].value.clone()
    };
    let now = forces(0.0);
    let later = forces(0.04);
    for k in 0..now.len() - 8 {
        assert!((later[k + 8] - now[k]).abs() < 1e-9, "step {k}");
    }
    let sum = |forces: Vec<f64>| forces.iter().sum::<f64>();
    let impulse = sum(now);
    for seconds in [0.0013, 0.02, 0.0377] {
        assert!((sum(forces(seconds)) - impulse).abs() < 1e-9 * impulse.abs().max(1.0));
    }
}

/// The quadruped in the air, with the damping of its gears.
fn quadruped() -> (Hybrid, Vec<f64>) {
    let mut hybrid = Hybrid::of(&load("quadruped/quadruped.toml"));
    for constant in hybrid.constants_mut() {
        constant.tolerance = f64::INFINITY;
    }
    let motion: Vec<f64> = (0..18).map(|i| (0.8 * f64::from(i)).sin()).collect();
    let mechanics = hybrid.mechanics();
    let mut x = mechanics.integrate(&mechanics.neutral(), &motion).unwrap();
    x.extend((0..18).map(|i| 2.0 * (1.7 * f64::from(i)).cos()));
    (hybrid, x)
}

/// The model as a system of `integrators`: rows pulled back against the linear system, and that against differences along the
/// directions of motion.
#[test]
fn derivatives_of_the_hybrid_motion_agree_with_one_another_and_with_differences() {
    let cartpoles = ["none", "elastic_transmission", "backlash"].map(|transmission| {
        let hybrid = with_every_effect(transmission);
        let x = initial(&hybrid);
        (hybrid, x)
    });
    let others = [
        quadruped(),
        hovercraft(),
        quadrotor("angles"),
        quadrotor("quaternion"),
    ];
    for (hybrid, x) in cartpoles.into_iter().chain(others) {
        let (t, u) = times_and_inputs(&hybrid);
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let inputs = hybrid.drive(&t, &u, SUBSTEPS, &theta, &free);
        let motion = HybridMotion::new(&hybrid, &theta, &free, &inputs);
        let nt = motion.space().tangent_dim();
        let mut memory = motion.memory();
        let (mut dx, mut by) = (vec![0.0; nt], Jacobian::zeros(&motion));
        let at = (0.0, x.as_slice(), &57);
        motion.linearize(at, &mut memory, &mut dx, &mut by).unwrap();

        let weight: Vec<f64> = (0..nt).map(|i| (0.3 + 1.9 * i as f64).sin()).collect();
        let mut row = Gradient::zeros(&motion);
        let mut again = vec![0.0; nt];
        motion
            .pull_back(at, &mut memory, &weight, &mut again, &mut row)
            .unwrap();
        let size = dx.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for (a, b) in dx.iter().zip(&again) {
            assert!((a - b).abs() < 1e-11 * size, "{a} {b}");
        }
        let matrices = [(&by.state, &row.state), (&by.parameters, &row.parameters)];
        for (matrix, row) in matrices {
            assert_eq!(matrix.ncols(), row.len());
            for (column, found) in matrix.column_iter().zip(row) {
                let expected: f64 = column.iter().zip(&weight).map(|(a, w)| a * w).sum();
                assert!(
                    (found - expected).abs() < 1e-11 * matrix.amax(),
                    "{found} {expected}"
                );
            }
        }

        let h = 1e-6;
        for j in 0..nt {
            let mut rate = |sign: f64| {
                let mut xi = vec![0.0; nt];
                xi[j] = sign * h;
                let mut moved = vec![0.0; x.len()];
                motion.space().move_into(&x, &xi, &mut moved);
                let mut out = vec![0.0; nt];
                motion
                    .rate(0.0, &moved, &57, &mut memory, &mut out)
                    .unwrap();
                out
            };
            for ((up, down), exact) in rate(1.0).iter().zip(rate(-1.0)).zip(&by.state.column(j)) {
                let found = (up - down) / (2.0 * h);
                assert!(
                    (found - exact).abs() < 1e-6 * by.state.amax(),
                    "x[{j}]: {exact}, {found} by differences"
                );
            }
        }
    }
}

/// What the sensors read is a smooth function of the states at the samples and of θ: its derivatives against differences, between
/// samples, before the first one and at a sample.
#[test]
fn readings_change_with_states_and_constants_as_their_derivatives_say() {
    let hybrid = with_every_effect("backlash");
    let (theta, free) = (hybrid.theta(), hybrid.free());
    let t: Vec<f64> = (0..6).map(|k| 0.02 * f64::from(k)).collect();
    let nx = hybrid.nx();
    let states: Vec<f64> = (0..6 * nx).map(|i| (0.7 * i as f64).sin()).collect();
    let read = |theta: &[f64], states: &[f64], k: usize, position: bool| {
        let reading = hybrid.reading(0, theta, &free);
        match position {
            true => reading.position((0, 2), nx, states, &t, k),
            false => reading.velocity((0, 2), nx, states, &t, k),
        }
    };
    for (k, position) in [
        (0, true),
        (1, true),
        (2, true),
        (5, true),
        (0, false),
        (4, false),
    ] {
        let here = read(&theta, &states, k, position);
        let h = 1e-6;
        for i in 0..states.len() {
            let shifted = |d: f64| {
                let mut states = states.clone();
                states[i] += d;
                read(&theta, &states, k, position).value
            };
            let found = (shifted(h) - shifted(-h)) / (2.0 * h);
            let exact: f64 = here
                .terms
                .iter()
                .filter(|(sample, state, _)| sample * nx + state == i)
                .map(|(.., weight)| weight)
                .sum();
            assert!(
                (found - exact).abs() < 1e-7,
                "sample {k}, state {i}: {exact} {found}"
            );
        }
        let mut by_theta = vec![0.0; free.len()];
        hybrid
            .reading(0, &theta, &free)
            .add_by_theta(&here, 1.0, position, &mut by_theta);
        for (i, exact) in by_theta.into_iter().enumerate() {
            let shifted = |d: f64| {
                let mut theta = theta.clone();
                theta[i] += d;
                read(&theta, &states, k, position).value
            };
            let found = (shifted(h) - shifted(-h)) / (2.0 * h);
            assert!(
                (found - exact).abs() < 1e-6 * exact.abs().max(1.0),
                "sample {k}, θ[{i}]: {exact} {found}"
            );
        }
    }
}

/// A reading that is T late is that of T before: a motion that is a cubic in time is met exactly between samples.
#[test]
fn a_delayed_sensor_reads_the_motion_of_before() {
    let mut hybrid = Hybrid::of(&load("cartpole/cartpole.toml"));
    let placed = Placed {
        kind: registry::find("sensor_delay").unwrap(),
        target: 1,
        smoothing: default_smoothing(true),
        fixed: false,
    };
    hybrid.add(placed, &[0.033]);
    let reading = hybrid.reading(1, &hybrid.theta(), &[]);
    let t: Vec<f64> = (0..6).map(|k| 0.02 * f64::from(k)).collect();
    let q = |t: f64| 0.3 + 2.0 * t - 5.0 * t * t + 40.0 * t.powi(3);
    let v = |t: f64| 2.0 - 10.0 * t + 120.0 * t * t;
    let states: Vec<f64> = t.iter().flat_map(|&t| [0.0, q(t), 0.0, v(t)]).collect();
    for k in 2..6 {
        let read = reading.position((1, 3), 4, &states, &t, k).value;
        assert!((read - q(t[k] - 0.033)).abs() < 1e-14, "sample {k}");
    }
    // Before the first sample a parabola has to do: 40 · 0.033³ and what the cubic does to the first interval's acceleration.
    let read = reading.position((1, 3), 4, &states, &t, 0).value;
    assert!((read - q(-0.033)).abs() < 4e-3, "{read} {}", q(-0.033));
}
