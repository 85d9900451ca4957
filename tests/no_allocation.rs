//! The `_into` calls take no memory: after the first call of each, all of them together allocate nothing.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

mod common {
    pub mod load;
}

use std::fmt::Write;

use common::load::tree;
use lagrange::constraint::{Constrained, Constraint, LinkPoint, Loop, Loops};
use lagrange::mechanism::{LinkForceMemory, Tree};
use lagrange::urdf::Options;
use lagrange::{
    Dynamics, ForwardDynamicsDerivatives, ForwardDynamicsGradient, InverseDynamicsDerivatives,
    InverseDynamicsGradient, LANES, Linear, Mechanics, Scalar, TextLagrangian, TextSource, state,
};
use nalgebra::{DMatrix, DVector};

/// What the calls write to.
struct Results {
    work: lagrange::Workspace,
    mass: DMatrix<f64>,
    matrix: DMatrix<f64>,
    force: DVector<f64>,
    /// One state eight times.
    q_lanes: Vec<[f64; LANES]>,
    v_lanes: Vec<[f64; LANES]>,
    mass_lanes: Vec<[f64; LANES]>,
    force_lanes: Vec<[f64; LANES]>,
    acceleration: DVector<f64>,
    inverse: InverseDynamicsDerivatives,
    forward: ForwardDynamicsDerivatives,
    inverse_gradient: InverseDynamicsGradient,
    forward_gradient: ForwardDynamicsGradient,
    linear: Linear,
    matrix_lanes: Vec<[f64; LANES]>,
    inverse_lanes: InverseDynamicsDerivatives<[f64; LANES]>,
    forward_lanes: ForwardDynamicsDerivatives<[f64; LANES]>,
    inverse_gradient_lanes: InverseDynamicsGradient<[f64; LANES]>,
    forward_gradient_lanes: ForwardDynamicsGradient<[f64; LANES]>,
}

impl Results {
    fn of(mechanics: &dyn Mechanics, q: &[f64], v: &[f64], constants: usize) -> Self {
        let (n, np) = (mechanics.nv(), mechanics.parameters().len());
        let lanes = |x: &[f64]| x.iter().map(|&x| [x; LANES]).collect();
        Results {
            work: mechanics.workspace(),
            mass: DMatrix::zeros(n, n),
            matrix: DMatrix::zeros(n, n),
            q_lanes: lanes(q),
            v_lanes: lanes(v),
            mass_lanes: vec![[0.0; LANES]; n * n],
            force_lanes: vec![[0.0; LANES]; n],
            force: DVector::zeros(n),
            acceleration: DVector::zeros(n),
            inverse: InverseDynamicsDerivatives::zeros(n, constants),
            forward: ForwardDynamicsDerivatives::zeros(n, constants),
            inverse_gradient: InverseDynamicsGradient::zeros(n, np),
            forward_gradient: ForwardDynamicsGradient::zeros(n, np),
            linear: Linear::zeros(n),
            matrix_lanes: vec![[0.0; LANES]; n * n],
            inverse_lanes: InverseDynamicsDerivatives::lanes(n, constants),
            forward_lanes: ForwardDynamicsDerivatives::lanes(n, constants),
            inverse_gradient_lanes: InverseDynamicsGradient::lanes(n, np),
            forward_gradient_lanes: ForwardDynamicsGradient::lanes(n, np),
        }
    }
}

type Call = fn(&dyn Mechanics, &[f64], &[f64], &[f64], &[usize], &mut Results);

/// Every `_into` call of [`Mechanics`], by name.
const CALLS: [(&str, Call); 26] = [
    ("energies", |m, q, v, p, _, _| {
        let energy = m.kinetic_energy_with(q, v, p) + m.potential_energy_with(q, p);
        assert!(energy.is_finite());
    }),
    ("mass_matrix_into", |m, q, _, p, _, r| {
        m.mass_matrix_into(q, p, &mut r.work, &mut r.matrix);
    }),
    ("coriolis_matrix_into", |m, q, v, p, _, r| {
        m.coriolis_matrix_into(q, v, p, &mut r.work, &mut r.matrix);
    }),
    ("gravity_force_into", |m, q, _, p, _, r| {
        m.gravity_force_into(q, p, &mut r.work, &mut r.force);
    }),
    ("bias_force_into", |m, q, v, p, _, r| {
        m.bias_force_into(q, v, p, &mut r.work, &mut r.force);
    }),
    ("inverse_dynamics_into", |m, q, v, p, _, r| {
        m.inverse_dynamics_into(q, v, v, p, &mut r.work, &mut r.force);
    }),
    ("forward_dynamics_into", |m, q, v, p, _, r| {
        r.acceleration.fill(0.1);
        let (work, out) = (&mut r.work, &mut r.acceleration);
        m.forward_dynamics_into(q, v, p, work, out).unwrap();
    }),
    ("momentum_into", |m, q, v, p, _, r| {
        m.momentum_into(q, v, p, &mut r.work, &mut r.force);
    }),
    ("power_balance_with", |m, q, v, p, _, r| {
        let balance = m.power_balance_with(q, v, v, p, &mut r.work).unwrap();
        assert!(balance.input > 0.0);
    }),
    ("linearize_into", |m, q, v, p, _, r| {
        let (work, out) = (&mut r.work, &mut r.linear);
        m.linearize_into(q, v, v, p, work, out).unwrap();
    }),
    ("equations_into", |m, q, v, p, _, r| {
        let (work, mass) = (&mut r.work, &mut r.mass);
        m.equations_into(q, v, p, work, mass, &mut r.matrix, &mut r.force);
    }),
    ("mass_matrix_lanes_into", |m, _, _, p, _, r| {
        m.mass_matrix_lanes_into(&r.q_lanes, p, &mut r.work, &mut r.mass_lanes);
    }),
    ("coriolis_matrix_lanes_into", |m, _, _, p, _, r| {
        let (q, v, out) = (&r.q_lanes, &r.v_lanes, &mut r.matrix_lanes);
        m.coriolis_matrix_lanes_into(q, v, p, &mut r.work, out);
    }),
    ("gravity_force_lanes_into", |m, _, _, p, _, r| {
        m.gravity_force_lanes_into(&r.q_lanes, p, &mut r.work, &mut r.force_lanes);
    }),
    ("bias_force_lanes_into", |m, _, _, p, _, r| {
        let (q, v, out) = (&r.q_lanes, &r.v_lanes, &mut r.force_lanes);
        m.bias_force_lanes_into(q, v, p, &mut r.work, out);
    }),
    ("equations_lanes_into", |m, _, _, p, _, r| {
        let (q, v, work) = (&r.q_lanes, &r.v_lanes, &mut r.work);
        let (mass, coriolis) = (&mut r.mass_lanes, &mut r.matrix_lanes);
        m.equations_lanes_into(q, v, p, work, mass, coriolis, &mut r.force_lanes);
    }),
    (
        "inverse_dynamics_derivatives_lanes_into",
        |m, _, _, p, c, r| {
            let (q, v, out) = (&r.q_lanes, &r.v_lanes, &mut r.inverse_lanes);
            m.inverse_dynamics_derivatives_lanes_into(q, v, v, p, c, &mut r.work, out);
        },
    ),
    (
        "forward_dynamics_derivatives_lanes_into",
        |m, _, _, p, c, r| {
            let (q, v, out) = (&r.q_lanes, &r.v_lanes, &mut r.forward_lanes);
            m.forward_dynamics_derivatives_lanes_into(q, v, v, p, c, &mut r.work, out)
                .unwrap();
        },
    ),
    (
        "inverse_dynamics_gradient_lanes_into",
        |m, _, _, p, _, r| {
            let (q, v, out) = (&r.q_lanes, &r.v_lanes, &mut r.inverse_gradient_lanes);
            m.inverse_dynamics_gradient_lanes_into(q, v, v, p, v, &mut r.work, out);
        },
    ),
    (
        "forward_dynamics_gradient_lanes_into",
        |m, _, _, p, _, r| {
            let (q, v, out) = (&r.q_lanes, &r.v_lanes, &mut r.forward_gradient_lanes);
            m.forward_dynamics_gradient_lanes_into(q, v, v, p, v, &mut r.work, out)
                .unwrap();
        },
    ),
    ("inverse_dynamics_lanes_into", |m, _, _, p, _, r| {
        let (q, v, out) = (&r.q_lanes, &r.v_lanes, &mut r.force_lanes);
        m.inverse_dynamics_lanes_into(q, v, v, p, &mut r.work, out);
    }),
    ("forward_dynamics_lanes_into", |m, _, _, p, _, r| {
        let (q, v, out) = (&r.q_lanes, &r.v_lanes, &mut r.force_lanes);
        m.forward_dynamics_lanes_into(q, v, p, &mut r.work, out)
            .unwrap();
    }),
    ("inverse_dynamics_derivatives_into", |m, q, v, p, c, r| {
        let (work, out) = (&mut r.work, &mut r.inverse);
        m.inverse_dynamics_derivatives_into(q, v, v, p, c, work, out);
    }),
    ("inverse_dynamics_gradient_into", |m, q, v, p, _, r| {
        let (work, out) = (&mut r.work, &mut r.inverse_gradient);
        m.inverse_dynamics_gradient_into(q, v, v, p, v, work, out);
    }),
    ("forward_dynamics_gradient_into", |m, q, v, p, _, r| {
        let (work, out) = (&mut r.work, &mut r.forward_gradient);
        m.forward_dynamics_gradient_into(q, v, v, p, v, work, out)
            .unwrap();
    }),
    ("forward_dynamics_derivatives_into", |m, q, v, p, c, r| {
        let (work, out) = (&mut r.work, &mut r.forward);
        m.forward_dynamics_derivatives_into(q, v, v, p, c, work, out)
            .unwrap();
    }),
];

/// Goes twice through all calls and counts in the second round. No derivatives in the constants, and in all of them.
fn assert_no_allocation(mechanics: &dyn Mechanics, q: &[f64]) {
    let p = mechanics.nominal();
    let v: Vec<f64> = (0..mechanics.nv())
        .map(|i| (1.7 * i as f64).cos())
        .collect();
    let all: Vec<usize> = (0..p.len()).collect();
    for constants in [&[], all.as_slice()] {
        let mut results = Results::of(mechanics, q, &v, constants.len());
        for (_, call) in CALLS {
            call(mechanics, q, &v, &p, constants, &mut results);
        }
        for (name, call) in CALLS {
            let counted = allocation_counter::measure(|| {
                call(mechanics, q, &v, &p, constants, &mut results);
            });
            let (count, bytes) = (counted.count_total, counted.bytes_total);
            assert_eq!(count, 0, "{name} allocates {count} times, {bytes} bytes");
        }
    }
}

/// Goes twice through the calls of a tree for the inertia of its links and counts in the second round.
fn assert_no_allocation_by_inertia(mechanics: &Dynamics<Tree>, q: &[f64]) {
    let (n, p) = (mechanics.nv(), mechanics.nominal());
    let v: Vec<f64> = (0..n).map(|i| (1.7 * i as f64).cos()).collect();
    let last = mechanics.lagrangian().links().len() - 1;
    let mut work = mechanics.workspace();
    let mut y = mechanics.regressor(q, &v, &v).unwrap();
    let (mut inverse, mut forward) = (DMatrix::zeros(n, 10), DMatrix::zeros(n, 10));
    let mut calls = || {
        mechanics.regressor_into(q, &v, &v, &mut work, &mut y);
        for link in [0, last] {
            let (work, out) = (&mut work, &mut inverse);
            mechanics.inverse_dynamics_by_inertia_into(link, q, &v, &v, &p, work, out);
            let out = &mut forward;
            mechanics
                .forward_dynamics_by_inertia_into(link, q, &v, &v, &p, work, out)
                .unwrap();
        }
    };
    calls();
    let counted = allocation_counter::measure(calls);
    let (count, bytes) = (counted.count_total, counted.bytes_total);
    assert_eq!(count, 0, "{count} times, {bytes} bytes");
    assert!(y.amax() > 0.0 && inverse.amax() > 0.0 && forward.amax() > 0.0);
}

#[test]
fn a_regressor_and_derivatives_in_the_inertia_of_a_link() {
    for count in [2, 7, 20] {
        let fixed = tree(&bodies(count, |k| k / 2), &Options::default());
        let q = somewhere(count);
        assert_no_allocation_by_inertia(&fixed, &q);
        assert_no_allocation_by_inertia(&fixed.by_duals(), &q);
    }
    let mimic = bodies(6, |k| k / 2).replace(
        "<child link=\"l5\"/>",
        "<child link=\"l5\"/><mimic joint=\"j1\" multiplier=\"-0.5\" offset=\"0.1\"/>",
    );
    let follower = tree(&mimic, &Options::default());
    assert_eq!(follower.nv(), 5);
    check(&follower);
    assert_no_allocation_by_inertia(&follower, &somewhere(5));
}

/// Positions off the symmetric ones.
fn somewhere(n: usize) -> Vec<f64> {
    (0..n).map(|i| 0.3 + 0.9 * (2.3 * i as f64).sin()).collect()
}

fn check(mechanics: &dyn Mechanics) {
    assert_no_allocation(mechanics, &somewhere(mechanics.nv()));
}

/// Bodies on oblique joints; joint k hangs on link `parent(k)`.
fn bodies(count: usize, parent: impl Fn(usize) -> usize) -> String {
    let mut text = String::from("<robot name=\"bodies\"><link name=\"l0\"/>");
    for k in 0..count {
        let kind = if k % 5 == 3 { "prismatic" } else { "revolute" };
        let (from, child, tilt) = (parent(k), k + 1, 0.3 * k as f64);
        write!(
            text,
            r#"<link name="l{child}"><inertial><origin xyz="0.05 0.02 -0.1" rpy="0.1 0.2 {tilt}"/><mass value="1.5"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.025"/></inertial></link>
<joint name="j{child}" type="{kind}"><parent link="l{from}"/><child link="l{child}"/>
  <origin xyz="0.1 0 -0.2" rpy="{tilt} 0.4 0"/><axis xyz="0.2 1 {tilt}"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"#
        )
        .unwrap();
    }
    text + "</robot>"
}

fn text(kinetic: &str, potential: &str) -> Dynamics<TextLagrangian> {
    let text = TextLagrangian::new(&TextSource {
        coordinates: vec!["x".into(), "y".into()],
        kinetic: kinetic.into(),
        potential: potential.into(),
        parameters: vec![("m".into(), 0.5), ("c".into(), 2.0)],
        ..TextSource::default()
    })
    .unwrap();
    Dynamics::of(text)
}

#[test]
fn the_counter_counts() {
    let counted = allocation_counter::measure(|| drop(std::hint::black_box(vec![1.0_f64; 100])));
    assert_eq!((counted.count_total, counted.bytes_total), (1, 800));
}

#[test]
fn a_cartpole() {
    let urdf = include_str!("../models/cartpole/cartpole.urdf");
    let cartpole = tree(urdf, &Options::default());
    check(&cartpole);
    check(&cartpole.by_duals());
}

#[test]
fn an_arm_of_seven_joints() {
    check(&tree(&bodies(7, |k| k), &Options::default()));
}

#[test]
fn a_branched_tree_of_twenty_joints() {
    check(&tree(&bodies(20, |k| k / 2), &Options::default()));
}

#[test]
fn a_fast_particle_whose_kinetic_energy_is_not_quadratic() {
    let particle = text("-9*sqrt(1 - (x_dot^2 + y_dot^2)/9)", "x^2 + y^2 + x*y");
    assert!(!particle.kinetic_is_quadratic());
    check(&particle);
}

#[test]
fn energies_written_as_text() {
    let kinetic = "0.5*m*(x_dot^2 + (1 + c*sin(x)^2)*y_dot^2)";
    let bead = text(kinetic, "m*9.81*x*cos(y)");
    check(&bead);
    check(&bead.by_duals());
}

/// Two point masses, 1 kg and 2 kg, in a vertical plane: q = (x₁, z₁, x₂, z₂).
struct Masses;

impl lagrange::Lagrangian for Masses {
    fn dof(&self) -> usize {
        4
    }
    fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D {
        (v[0] * v[0] + v[1] * v[1]) * 0.5 + v[2] * v[2] + v[3] * v[3]
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        (q[1] + q[3] * 2.0) * 9.81
    }
}

/// A rod of 1 m from the origin to the first, and one from there to the second.
struct Rods;

impl Constraint for Rods {
    fn len(&self) -> usize {
        2
    }
    fn name(&self, equation: usize) -> String {
        format!("rod {equation}")
    }
    fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) {
        out[0] = q[0] * q[0] + q[1] * q[1] - 1.0;
        let (x, z) = (q[2] - q[0], q[3] - q[1]);
        out[1] = x * x + z * z - 1.0;
    }
}

#[test]
fn masses_on_rods() {
    let pendulum = Constrained::new(Dynamics::of(Masses), Rods).unwrap();
    assert_no_allocation(&pendulum, &[0.6, -0.8, 1.6, -0.8]);
}

#[test]
fn a_closed_loop() {
    let urdf = include_str!("../models/four_bar/four_bar.urdf");
    let free = tree(urdf, &Options::default());
    let point = |link: &str, point: [f64; 3]| LinkPoint {
        link: link.into(),
        point,
    };
    let pin = Loop {
        name: "pin".into(),
        a: point("coupler", [0.24, 0.0, 0.07]),
        b: point("rocker", [0.0, 0.0, 0.17]),
        components: [true, false, true],
    };
    let loops = Loops::new(free.lagrangian(), vec![pin]).unwrap();
    let four_bar = Constrained::new(free, loops).unwrap();
    assert_no_allocation(&four_bar, &[0.4, -0.3, 0.2]);
}

#[test]
fn a_base_that_floats() {
    let options = Options {
        floating_base: true,
        ..Options::default()
    };
    let urdf = bodies(6, |k| k / 2);
    if let Err(problems) = lagrange::urdf::read(&urdf, &options) {
        eprintln!("SKIPPED: {problems}");
        return;
    }
    let robot = tree(&urdf, &options);
    let pose = [0.1, -0.2, 0.9, 0.5, 0.5, -0.5, 0.5];
    let q = [&pose, somewhere(6).as_slice()].concat();
    assert_no_allocation(&robot, &q);
    assert_no_allocation_by_inertia(&robot, &q);
}

#[test]
fn poses_jacobians_and_motions_of_a_floating_tree_take_no_memory() {
    let text = r#"<robot name="r"><link name="a"/><link name="b"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="p" type="planar"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"#;
    let options = Options {
        floating_base: true,
        ..Options::default()
    };
    let mechanics = tree(text, &options);
    let (tree, coordinates) = (mechanics.lagrangian(), mechanics.coordinates());
    let q = state::neutral(coordinates);
    let v = somewhere(tree.nv());
    let (mut moved, mut apart, mut rate) = (q.clone(), v.clone(), q.clone());
    let mut poses = tree.poses(&q).unwrap();
    let mut of_link = DMatrix::zeros(6, tree.nv());
    let mut of_centre = DMatrix::zeros(3, tree.nv());
    let force = tree
        .link_force(1, [0.1, 0.2, 0.3], [1.0, 0.5, -0.2], [0.3; 3])
        .unwrap();
    let (mut pushed, mut memory) = (0.0, LinkForceMemory::default());
    let eight: Vec<[f64; LANES]> = q.iter().map(|&q| [q; LANES]).collect();
    // Its memory is taken at the first call.
    force.each_derivative(&q, &mut memory, |_, _| {});
    force.each_derivative_of_eight(&eight, &mut memory, |_, _| {});
    let counted = allocation_counter::measure(|| {
        force.each(&q, |_, part: f64| pushed += part.abs());
        force.each_derivative(&q, &mut memory, |_, part| pushed += part.abs());
        force.each_of_eight(&eight, |_, part| pushed += part[0].abs());
        force.each_derivative_of_eight(&eight, &mut memory, |_, part| pushed += part[0].abs());
        state::integrate_into(coordinates, &q, &v, &mut moved);
        state::difference_into(coordinates, &q, &moved, &mut apart);
        state::position_rate_into(coordinates, &moved, &v, &mut rate);
        state::normalize(coordinates, &mut moved);
        tree.poses_into(&moved, &mut poses);
        tree.link_jacobian_into(&poses, 1, [0.1, 0.2, 0.3], &mut of_link);
        tree.centre_of_mass_jacobian_into(&poses, &mut of_centre);
    });
    assert_eq!(counted.count_total, 0, "{} bytes", counted.bytes_total);
    assert!(of_link.amax() > 0.0 && of_centre.amax() > 0.0 && pushed > 0.0);
}
