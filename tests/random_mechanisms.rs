//! What holds for every mechanism, on random trees of one to eight bodies.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

mod common {
    pub mod load;
    pub mod random_tree;
}

use common::load::tree;
use common::random_tree::{RandomBody, body, urdf};
use lagrange::equations::reference;
use lagrange::mechanism::Tree;
use lagrange::urdf::Options;
use lagrange::{Dynamics, InverseDynamicsDerivatives, Lagrangian, Mechanics};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector3};
use num_dual::Dual64;
use proptest::collection::vec;
use proptest::prelude::*;

/// A tree at a state (q, v) with an acceleration a, and the sizes that rounding is measured by.
struct Case {
    mechanics: Dynamics<Tree>,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    /// Largest entry of M.
    mass: f64,
    /// M |v|², M |a| and the bias together: what the terms of a force are made of, N.
    force: f64,
}

fn case() -> impl Strategy<Value = Case> {
    let joints = &["revolute", "continuous", "prismatic"];
    vec(body(joints), 1..=8).prop_flat_map(|bodies| {
        let n = bodies.len();
        let state = (vec(-3.0..3.0, n), vec(-2.0..2.0, n), vec(-5.0..5.0, n));
        (Just(bodies), state).prop_map(|(bodies, (q, v, a))| new_case(&bodies, q, v, a))
    })
}

fn new_case(bodies: &[RandomBody], q: Vec<f64>, v: Vec<f64>, a: Vec<f64>) -> Case {
    let mechanics = tree(&urdf(bodies), &Options::default());
    let mass = mechanics.mass_matrix(&q).unwrap().amax();
    let amax = |x: &[f64]| x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let bias = mechanics.bias_force(&q, &v).unwrap().amax();
    let force = mass * (amax(&v).powi(2) + amax(&a)) + bias;
    Case {
        mechanics,
        q,
        v,
        a,
        mass,
        force,
    }
}

impl std::fmt::Debug for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (q, v, a) = (&self.q, &self.v, &self.a);
        write!(
            f,
            "q = {q:?}, v = {v:?}, a = {a:?}, {:#?}",
            self.mechanics.lagrangian()
        )
    }
}

/// x + ε dx.
fn along(x: &[f64], dx: &[f64]) -> Vec<Dual64> {
    x.iter()
        .zip(dx)
        .map(|(&x, &dx)| Dual64::new(x, dx))
        .collect()
}

/// Ṁ along q̇ = v, from the definition: M_ij = T(e_i + e_j) − T(e_i) − T(e_j) on dual numbers.
fn mass_rate(tree: &Tree, q: &[f64], v: &[f64]) -> DMatrix<f64> {
    let n = q.len();
    let q = along(q, v);
    let kinetic = |i: usize, j: usize, both: f64| {
        let mut u = vec![Dual64::from(0.0); n];
        u[i] += 1.0;
        u[j] += both;
        tree.kinetic(&q, &u).eps
    };
    DMatrix::from_fn(n, n, |i, j| {
        kinetic(i, j, 1.0) - kinetic(i, j, 0.0) - kinetic(j, i, 0.0)
    })
}

/// T and V from the poses of the links: velocities are differences of fourth order along q̇ = v.
fn energies_by_poses(tree: &Tree, q: &[f64], v: &[f64]) -> (f64, f64) {
    let h = 1e-3;
    let poses = |s: f64| {
        let moved: Vec<f64> = q.iter().zip(v).map(|(q, v)| q + s * h * v).collect();
        tree.link_poses(&moved).unwrap()
    };
    let around = [poses(-2.0), poses(-1.0), poses(1.0), poses(2.0)];
    let (now, gravity) = (poses(0.0), Vector3::from(tree.gravity()));
    let (mut kinetic, mut potential) = (0.0, 0.0);
    for body in tree.bodies() {
        let link = tree
            .links()
            .iter()
            .position(|l| l.name == body.name)
            .unwrap();
        let centre = |poses: &[Isometry3<f64>]| (poses[link] * Point3::from(body.centre)).coords;
        let turn =
            |poses: &[Isometry3<f64>]| poses[link].rotation.to_rotation_matrix().into_inner();
        let [a, b, c, d] = &around;
        let velocity = ((centre(c) - centre(b)) * 8.0 - (centre(d) - centre(a))) / (12.0 * h);
        let turning = ((turn(c) - turn(b)) * 8.0 - (turn(d) - turn(a))) / (12.0 * h);
        // Rᵀ Ṙ is the matrix of ω ×.
        let spin = turn(&now).transpose() * turning;
        let w = Vector3::new(spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]);
        kinetic += 0.5 * body.mass * velocity.norm_squared() + 0.5 * w.dot(&(body.inertia * w));
        potential -= body.mass * gravity.dot(&centre(&now));
    }
    (kinetic, potential)
}

#[test]
fn a_hinge_about_the_opposite_axis_turns_back() {
    for (axis, turned) in [("0 1 0", 1.0), ("0 -1 0", 0.0), ("0 -2 0", 0.0)] {
        let text = format!(
            r#"<robot name="r"><link name="base"/><link name="a"/>
<link name="b"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint>
<joint name="k" type="continuous"><parent link="a"/><child link="b"/><axis xyz="{axis}"/></joint></robot>"#
        );
        let mechanics = tree(&text, &Options::default());
        let pose = mechanics.lagrangian().link_poses(&[0.5, 0.5]).unwrap()[2];
        assert!((pose.rotation.angle() - turned).abs() < 1e-12, "{axis}");
        // The centre of mass goes down by sin of the angle about +y.
        let expected = -9.81 * 0.1 * f64::sin(turned);
        let found = mechanics.potential_energy(&[0.5, 0.5]).unwrap();
        assert!((found - expected).abs() < 1e-12, "{axis}: {found}");
        // Both rates turn the body: T = ½ (1 + 0.1²) ω².
        let w = 2.0 + if turned > 0.0 { 0.3 } else { -0.3 };
        let found = mechanics.kinetic_energy(&[0.5, 0.5], &[2.0, 0.3]).unwrap();
        assert!(
            (found - 0.5 * 1.01 * w * w).abs() < 1e-12,
            "{axis}: {found}"
        );
    }
}

/// The largest entry of a difference.
fn gap(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).amax()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn the_mass_matrix_is_symmetric_and_positive_definite(case in case()) {
        let mass = case.mechanics.mass_matrix(&case.q).unwrap();
        prop_assert_eq!(&mass, &mass.transpose());
        prop_assert!(mass.cholesky().is_some());
    }

    #[test]
    fn both_routes_give_the_same_equations(case in case()) {
        let Case { mechanics, q, v, .. } = &case;
        let at = reference::equations(mechanics.lagrangian(), q, v);
        prop_assert!(gap(&mechanics.mass_matrix(q).unwrap(), &at.mass_matrix) <= 1e-13 * case.mass);
        let bias = mechanics.bias_force(q, v).unwrap();
        prop_assert!((bias - &at.bias_force).amax() <= 1e-12 * case.force);
        let gravity = mechanics.gravity_force(q).unwrap();
        prop_assert!((gravity - &at.gravity_force).amax() <= 1e-13 * case.force);
    }

    #[test]
    fn the_coriolis_matrix_makes_the_bias_and_takes_no_power(case in case()) {
        let Case { mechanics, q, v, .. } = &case;
        let coriolis = mechanics.coriolis_matrix(q, v).unwrap();
        let velocity = DVector::from_column_slice(v);
        let bias = mechanics.bias_force(q, v).unwrap();
        let gravity = mechanics.gravity_force(q).unwrap();
        prop_assert!((&coriolis * velocity + gravity - bias).amax() <= 1e-12 * case.force);
        let twist = mass_rate(mechanics.lagrangian(), q, v) - &coriolis * 2.0;
        prop_assert!((&twist + twist.transpose()).amax() <= 1e-12 * (case.mass + coriolis.amax()));
    }

    #[test]
    fn forward_dynamics_undoes_inverse_dynamics(case in case()) {
        let Case { mechanics, q, v, a, .. } = &case;
        let force = mechanics.inverse_dynamics(q, v, a).unwrap();
        let found = mechanics.forward_dynamics(q, v, force.as_slice()).unwrap();
        // As forces, so that the condition of M does not enter.
        let missed = mechanics.mass_matrix(q).unwrap() * (found - DVector::from_column_slice(a));
        prop_assert!(missed.amax() <= 1e-12 * case.force);
    }

    #[test]
    fn the_applied_forces_give_the_power(case in case()) {
        let Case { mechanics, q, v, a, .. } = &case;
        let force = mechanics.inverse_dynamics(q, v, a).unwrap();
        let power = force.dot(&DVector::from_column_slice(v));
        // d/dt (T + V) along q̇ = v, v̇ = a.
        let (moving, tree) = (along(q, v), mechanics.lagrangian());
        let rate = (tree.kinetic(&moving, &along(v, a)) + tree.potential(&moving)).eps;
        let speed: f64 = v.iter().map(|v| v.abs()).sum();
        prop_assert!((power - rate).abs() <= 1e-12 * case.force * (1.0 + speed));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn the_energies_are_those_of_the_moving_bodies(case in case()) {
        let Case { mechanics, q, v, .. } = &case;
        let (kinetic, potential) = energies_by_poses(mechanics.lagrangian(), q, v);
        let found = mechanics.kinetic_energy(q, v).unwrap();
        prop_assert!((found - kinetic).abs() <= 1e-8 * (1.0 + kinetic), "{found} {kinetic}");
        let found = mechanics.potential_energy(q).unwrap();
        prop_assert!((found - potential).abs() <= 1e-11 * (1.0 + potential.abs()), "{found} {potential}");
    }

    #[test]
    fn derivatives_of_the_inverse_dynamics_are_those_of_differences(case in case()) {
        let Case { mechanics, q, v, a, .. } = &case;
        let p = mechanics.nominal();
        let constants: Vec<usize> = (0..p.len()).collect();
        let mut work = mechanics.workspace();
        let mut exact = InverseDynamicsDerivatives::zeros(q.len(), p.len());
        mechanics.inverse_dynamics_derivatives_into(q, v, a, &p, &constants, &mut work, &mut exact);

        // Differences of fourth order; x = (q, v, p).
        let mut force = |x: &[f64]| {
            let (q, rest) = x.split_at(case.q.len());
            let (v, p) = rest.split_at(case.q.len());
            let mut out = DVector::zeros(q.len());
            mechanics.inverse_dynamics_into(q, v, a, p, &mut work, &mut out);
            out
        };
        let x = [&q[..], &v[..], &p[..]].concat();
        let columns = exact.by_q.column_iter().chain(exact.by_v.column_iter()).chain(exact.by_p.column_iter());
        for (j, column) in columns.enumerate() {
            let h = 2e-3;
            let mut at = |s: f64| {
                let mut moved = x.clone();
                moved[j] += s * h;
                force(&moved)
            };
            let difference = ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * h);
            let error = (column - &difference).amax();
            prop_assert!(error <= 1e-8 * (case.force + difference.amax()), "column {j}: {error:e}");
        }
    }
}
