//! Every call for eight states against the call for one, lane by lane: random trees on a fixed and a floating base, with planar joints
//! and with joints that follow others, energies in text by programs and by dual numbers, and a constrained mechanism.

use crate::common::load::tree;
use crate::common::random_tree::{body, urdf};
use lagrange::constraint::{Constrained, Constraint};
use lagrange::urdf::Options;
use lagrange::{
    Dynamics, ForwardDynamicsDerivatives, ForwardDynamicsGradient, InverseDynamicsDerivatives,
    InverseDynamicsGradient, LANES, Mechanics, Scalar, TextLagrangian, TextSource, state,
};
use nalgebra::{DMatrix, DVector};
use proptest::collection::vec;
use proptest::prelude::*;

type Lane = [f64; LANES];

/// Eight vectors of a mechanism with `n` entries each, side by side.
fn side_by_side(n: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<Lane> {
    let eight = |i: usize| std::array::from_fn(|k| entry(i, k));
    (0..n).map(eight).collect()
}

fn of(lane: usize, x: &[Lane]) -> Vec<f64> {
    x.iter().map(|x| x[lane]).collect()
}

fn amax(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

/// Lane `lane` of `eight` is `one`, to `tolerance`; NaN fails.
fn same(
    what: &str,
    lane: usize,
    eight: &[Lane],
    one: &[f64],
    tolerance: f64,
) -> Result<(), TestCaseError> {
    prop_assert_eq!(eight.len(), one.len(), "{}", what);
    for (i, (x, y)) in eight.iter().zip(one).enumerate() {
        let x = x[lane];
        prop_assert!(
            (x - y).abs() <= tolerance,
            "{what}: entry {i} of lane {lane} is {x} against {y}, tolerance {tolerance:e}"
        );
    }
    Ok(())
}

/// All calls at eight states around (q, v, a), with the constants `p`. `size`: what entries of forces are measured by besides
/// themselves, for the number of terms that they are made of.
fn check(
    mechanics: &dyn Mechanics,
    (q, v, a): (&[f64], &[f64], &[f64]),
    p: &[f64],
    reach: f64,
) -> Result<(), TestCaseError> {
    let (n, nq) = (mechanics.nv(), mechanics.nq());
    let shift = |k: usize| 0.2 * (1.7 * k as f64).sin();
    let states: Vec<Vec<f64>> = (0..LANES)
        .map(|k| {
            let motion: Vec<f64> = (0..n).map(|i| shift(i + k)).collect();
            let mut q = q.to_vec();
            let from = q.clone();
            state::integrate_into(mechanics.coordinates(), &from, &motion, &mut q);
            q
        })
        .collect();
    let ql = side_by_side(nq, |i, k| states[k][i]);
    let vl = side_by_side(n, |i, k| v[i] * (1.0 + shift(k)));
    let al = side_by_side(n, |i, k| a[i] - shift(k));
    let weight = side_by_side(n, |i, k| (0.3 + i as f64 + 0.4 * k as f64).cos());
    // The last constants first.
    let constants: Vec<usize> = (0..p.len()).rev().take(3).collect();

    let work = &mut mechanics.workspace();
    let (mut mass, mut coriolis) = (vec![[0.1; LANES]; n * n], vec![[0.2; LANES]; n * n]);
    let [mut gravity, mut bias, mut force] = [0.3, 0.4, 0.5].map(|x| vec![[x; LANES]; n]);
    let mut together = (mass.clone(), coriolis.clone(), gravity.clone());
    mechanics.mass_matrix_lanes_into(&ql, p, work, &mut mass);
    mechanics.coriolis_matrix_lanes_into(&ql, &vl, p, work, &mut coriolis);
    mechanics.gravity_force_lanes_into(&ql, p, work, &mut gravity);
    mechanics.bias_force_lanes_into(&ql, &vl, p, work, &mut bias);
    mechanics.inverse_dynamics_lanes_into(&ql, &vl, &al, p, work, &mut force);
    let (m, c, g) = (&mut together.0, &mut together.1, &mut together.2);
    mechanics.equations_lanes_into(&ql, &vl, p, work, m, c, g);
    let mut inverse = InverseDynamicsDerivatives::lanes(n, constants.len());
    mechanics.inverse_dynamics_derivatives_lanes_into(
        &ql,
        &vl,
        &al,
        p,
        &constants,
        work,
        &mut inverse,
    );
    let mut row = InverseDynamicsGradient::lanes(n, p.len());
    mechanics.inverse_dynamics_gradient_lanes_into(&ql, &vl, &al, p, &weight, work, &mut row);
    let mut accelerations = al.clone();
    mechanics
        .forward_dynamics_lanes_into(&ql, &vl, p, work, &mut accelerations)
        .unwrap();
    let mut forward = ForwardDynamicsDerivatives::lanes(n, constants.len());
    mechanics
        .forward_dynamics_derivatives_lanes_into(&ql, &vl, &al, p, &constants, work, &mut forward)
        .unwrap();
    let mut forward_row = ForwardDynamicsGradient::lanes(n, p.len());
    let out = &mut forward_row;
    mechanics
        .forward_dynamics_gradient_lanes_into(&ql, &vl, &al, p, &weight, work, out)
        .unwrap();

    for lane in 0..LANES {
        let [q, v, a, w] = [&ql, &vl, &al, &weight].map(|x| of(lane, x));
        let (mut m, mut c) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        let mut f = DVector::zeros(n);
        mechanics.mass_matrix_into(&q, p, work, &mut m);
        let inertia = m.amax();
        mechanics.inverse_dynamics_into(&q, &v, &a, p, work, &mut f);
        let speed = 1.0 + amax(&v);
        let size = reach * (inertia * (speed * speed + amax(&a)) + f.amax());
        let near = 1e-12 * size;
        same("M", lane, &mass, m.as_slice(), 1e-12 * reach * inertia)?;
        same(
            "M of M, C, G",
            lane,
            &together.0,
            m.as_slice(),
            1e-12 * reach * inertia,
        )?;
        same("Q", lane, &force, f.as_slice(), near)?;
        mechanics.coriolis_matrix_into(&q, &v, p, work, &mut c);
        same("C", lane, &coriolis, c.as_slice(), near)?;
        same("C of M, C, G", lane, &together.1, c.as_slice(), near)?;
        mechanics.gravity_force_into(&q, p, work, &mut f);
        same("G", lane, &gravity, f.as_slice(), near)?;
        same("G of M, C, G", lane, &together.2, f.as_slice(), near)?;
        mechanics.bias_force_into(&q, &v, p, work, &mut f);
        same("bias", lane, &bias, f.as_slice(), near)?;

        let mut by = InverseDynamicsDerivatives::zeros(n, constants.len());
        mechanics.inverse_dynamics_derivatives_into(&q, &v, &a, p, &constants, work, &mut by);
        for (what, eight, one) in [
            ("∂Q/∂q", &inverse.by_q, &by.by_q),
            ("∂Q/∂v", &inverse.by_v, &by.by_v),
            ("∂Q/∂p", &inverse.by_p, &by.by_p),
        ] {
            let tolerance = 1e-12 * (size + reach * amax(one.as_slice()));
            same(what, lane, eight.as_slice(), one.as_slice(), tolerance)?;
        }
        let mut by = InverseDynamicsGradient::zeros(n, p.len());
        mechanics.inverse_dynamics_gradient_into(&q, &v, &a, p, &w, work, &mut by);
        for (what, eight, one) in [
            ("λᵀ ∂Q/∂q", &row.by_q, &by.by_q),
            ("λᵀ ∂Q/∂v", &row.by_v, &by.by_v),
            ("λᵀ M", &row.by_a, &by.by_a),
            ("λᵀ ∂Q/∂p", &row.by_p, &by.by_p),
        ] {
            let tolerance = 1e-12 * n as f64 * (size + reach * amax(one.as_slice()));
            same(what, lane, eight.as_slice(), one.as_slice(), tolerance)?;
        }

        let mut one = ForwardDynamicsDerivatives::zeros(n, constants.len());
        mechanics
            .forward_dynamics_derivatives_into(&q, &v, &a, p, &constants, work, &mut one)
            .unwrap();
        // What rounding of M becomes in M⁻¹.
        let condition = (inertia * one.by_force.amax()).max(1.0);
        let tolerance = |x: &[f64]| 1e-12 * reach * n as f64 * condition * (1.0 + amax(x));
        let acceleration = one.acceleration.as_slice();
        let eight = [&accelerations[..], forward.acceleration.as_slice()];
        for eight in [eight[0], eight[1], forward_row.acceleration.as_slice()] {
            same("v̇", lane, eight, acceleration, tolerance(acceleration))?;
        }
        for (what, eight, one) in [
            ("∂v̇/∂q", &forward.by_q, &one.by_q),
            ("∂v̇/∂v", &forward.by_v, &one.by_v),
            ("∂v̇/∂Q", &forward.by_force, &one.by_force),
            ("∂v̇/∂p", &forward.by_p, &one.by_p),
        ] {
            let tolerance = tolerance(one.as_slice());
            same(what, lane, eight.as_slice(), one.as_slice(), tolerance)?;
        }
        let mut by = ForwardDynamicsGradient::zeros(n, p.len());
        mechanics
            .forward_dynamics_gradient_into(&q, &v, &a, p, &w, work, &mut by)
            .unwrap();
        for (what, eight, row, one) in [
            ("wᵀ ∂v̇/∂q", &forward_row.by_q, &by.by_q, &one.by_q),
            ("wᵀ ∂v̇/∂v", &forward_row.by_v, &by.by_v, &one.by_v),
            (
                "wᵀ ∂v̇/∂Q",
                &forward_row.by_force,
                &by.by_force,
                &one.by_force,
            ),
            ("wᵀ ∂v̇/∂p", &forward_row.by_p, &by.by_p, &one.by_p),
        ] {
            let tolerance = n as f64 * tolerance(one.as_slice()) * condition;
            same(what, lane, eight.as_slice(), row.as_slice(), tolerance)?;
        }
    }
    Ok(())
}

/// Nominal constants, each moved a little.
fn moved(mechanics: &dyn Mechanics) -> Vec<f64> {
    let nominal = mechanics.nominal();
    let moved = |(k, x): (usize, f64)| x * (1.0 + 0.1 * (k as f64).cos());
    nominal.into_iter().enumerate().map(moved).collect()
}

/// (q, v, a) from random numbers.
fn cut(mechanics: &dyn Mechanics, x: &[f64]) -> [Vec<f64>; 3] {
    let (n, nq) = (mechanics.nv(), mechanics.nq());
    let mut q = x[..nq].to_vec();
    state::normalize(mechanics.coordinates(), &mut q);
    let third = x.len() / 3;
    [
        q,
        x[third..third + n].to_vec(),
        x[2 * third..2 * third + n].to_vec(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn trees_with_planar_joints_on_both_bases(
        bodies in vec(body(&["revolute", "continuous", "prismatic", "revolute", "planar"]), 1..=14),
        floating in any::<bool>(),
        x in vec(-2.0..2.0, 3 * 49),
    ) {
        let options = Options { floating_base: floating, ..Options::default() };
        let mechanics = tree(&urdf(&bodies), &options);
        let [q, v, a] = cut(&mechanics, &x);
        check(&mechanics, (&q, &v, &a), &moved(&mechanics), 1.0 + 3.0 * bodies.len() as f64)?;
    }

    #[test]
    fn trees_in_which_a_joint_follows_another(
        bodies in vec(body(&["revolute", "continuous"]), 2..=9),
        floating in any::<bool>(),
        x in vec(-2.0..2.0, 3 * 16),
    ) {
        let last = format!("<child link=\"l{}\"/>", bodies.len());
        let follows = format!("{last}<mimic joint=\"j1\" multiplier=\"-0.5\" offset=\"0.2\"/>");
        let options = Options { floating_base: floating, ..Options::default() };
        let mechanics = tree(&urdf(&bodies).replace(&last, &follows), &options);
        prop_assert_eq!(mechanics.nv(), bodies.len() - 1 + if floating { 6 } else { 0 });
        let [q, v, a] = cut(&mechanics, &x);
        check(&mechanics, (&q, &v, &a), &moved(&mechanics), 1.0 + 3.0 * bodies.len() as f64)?;
    }

    #[test]
    fn small_trees_by_programs_and_by_duals(
        bodies in vec(body(&["revolute", "prismatic"]), 1..=2),
        x in vec(-2.0..2.0, 6),
    ) {
        let mechanics = tree(&urdf(&bodies), &Options::default());
        prop_assert!(mechanics.is_compiled());
        let [q, v, a] = cut(&mechanics, &x);
        let p = moved(&mechanics);
        check(&mechanics, (&q, &v, &a), &p, 7.0)?;
        check(&mechanics.clone().by_programs(), (&q, &v, &a), &p, 7.0)?;
        check(&mechanics.by_duals(), (&q, &v, &a), &p, 7.0)?;
    }

    #[test]
    fn energies_in_text(x in vec(-2.0..2.0, 6)) {
        for mechanics in [pendulum(), every_function()] {
            prop_assert!(mechanics.is_compiled());
            let [q, v, a] = cut(&mechanics, &x);
            let p = moved(&mechanics);
            check(&mechanics, (&q, &v, &a), &p, 10.0)?;
            check(&mechanics.by_duals(), (&q, &v, &a), &p, 10.0)?;
        }
    }

    #[test]
    fn energies_that_are_not_quadratic_in_velocity(x in vec(-1.0..1.0, 6)) {
        let particle = written("-9*c*sqrt(1 - (x_dot^2 + y_dot^2)/9)", "m*(x^2 + y^2 + x*y)");
        prop_assert!(!particle.kinetic_is_quadratic() && !particle.is_compiled());
        let [q, v, a] = cut(&particle, &x);
        check(&particle, (&q, &v, &a), &moved(&particle), 10.0)?;
    }

    #[test]
    fn masses_on_a_rod(angle in -3.0..3.0_f64, x in vec(-1.0..1.0, 6)) {
        // Off φ = 0 in most lanes: the calls do not ask for it.
        let free = written("0.5*m*(x_dot^2 + y_dot^2) + c*x_dot*y_dot/9", "m*9.81*y");
        let rod = Constrained::new(free, Rod).unwrap();
        let [_, v, a] = cut(&rod, &x);
        check(&rod, (&[angle.sin(), angle.cos()], &v, &a), &moved(&rod), 10.0)?;
    }
}

struct Rod;

impl Constraint for Rod {
    fn len(&self) -> usize {
        1
    }
    fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) {
        out[0] = q[0] * q[0] + q[1] * q[1] - 1.0;
    }
}

fn written(kinetic: &str, potential: &str) -> Dynamics<TextLagrangian> {
    let text = TextLagrangian::new(&TextSource {
        coordinates: vec!["x".into(), "y".into()],
        kinetic: kinetic.into(),
        potential: potential.into(),
        parameters: vec![("m".into(), 1.5), ("c".into(), 2.0)],
        ..TextSource::default()
    });
    Dynamics::of(text.unwrap())
}

fn pendulum() -> Dynamics<TextLagrangian> {
    let kinetic = "0.5*m*(x_dot^2 + 2*cos(x - y)*x_dot*y_dot/c + 3*y_dot^2)";
    written(kinetic, "-m*9.81*(c*cos(x) + cos(y))")
}

/// Every function that a program can hold, and powers of all kinds.
fn every_function() -> Dynamics<TextLagrangian> {
    let mass = "exp(x*y/100) + (sin(x)*cos(y) + 2)^1.7 + tanh(x) + ln(y^2 + 1) + atan2(x, y + 3) + (x + 3)^(-3) \
                + cosh(x/10) + sinh(y/10)/10 + tan(x/10) + asin(y/10) + acos(x/10) + atan(y) + c^(x/10) + sqrt(x^2 + c)";
    let kinetic = format!("m*(10 + {mass})*x_dot^2 + 4*y_dot^2 + x_dot*y_dot*x/(y + 4)");
    written(&kinetic, "-cos(x*y)/(x^2 + 1) - y^3*m/10 + abs(x - 5)")
}

#[test]
fn a_state_without_an_acceleration_is_named_by_programs_and_where_a_joint_follows_another() {
    let bead = written("0.5*m*x^2*x_dot^2 + y_dot^2", "c*y");
    assert!(bead.is_compiled());
    let p = bead.nominal();
    let work = &mut bead.workspace();
    let mut q = vec![[0.7; LANES]; 2];
    q[0][3] = 0.0;
    let (v, force) = (vec![[0.1; LANES]; 2], vec![[1.0; LANES]; 2]);
    let mut out = force.clone();
    let error = bead
        .forward_dynamics_lanes_into(&q, &v, &p, work, &mut out)
        .unwrap_err();
    let culprit = "velocity 0, that of `q0`, moves no mass there";
    assert!(error.to_string().contains(culprit), "{error}");
    let mut by = ForwardDynamicsDerivatives::lanes(2, 0);
    let error = bead
        .forward_dynamics_derivatives_lanes_into(&q, &v, &force, &p, &[], work, &mut by)
        .unwrap_err();
    assert!(error.to_string().contains(culprit), "{error}");
    let mut by = ForwardDynamicsGradient::lanes(2, 2);
    let error = bead
        .forward_dynamics_gradient_lanes_into(&q, &v, &force, &p, &force, work, &mut by)
        .unwrap_err();
    assert!(error.to_string().contains(culprit), "{error}");
    // With a mass it works in the same memory.
    q[0][3] = 0.2;
    bead.forward_dynamics_derivatives_lanes_into(
        &q,
        &v,
        &force,
        &p,
        &[],
        work,
        &mut ForwardDynamicsDerivatives::lanes(2, 0),
    )
    .unwrap();
}
