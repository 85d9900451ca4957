//! What holds for every mechanism, on random trees of one to eight bodies.

use crate::common::load::tree;
use crate::common::random_tree::{RandomBody, body, urdf};
use lagrange::equations::reference;
use lagrange::mechanism::{LinkForceEntry, LinkForceMemory, Tree};
use lagrange::urdf::{Options, Urdf};
use lagrange::{Dynamics, InverseDynamicsDerivatives, LANES, Lagrangian, Mechanics, state};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector3};
use num_dual::Dual64;
use proptest::collection::vec;
use proptest::prelude::*;

/// A tree at a state (q, v) with an acceleration a, and the sizes that rounding is measured by.
struct Case {
    urdf: Urdf,
    mechanics: Dynamics<Tree>,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    /// Largest entry of M.
    mass: f64,
    /// M |v|², M |a| and the bias together: what the terms of a force are made of, N.
    force: f64,
}

/// A tree on a fixed base whose velocities are the rates of its coordinates.
fn case() -> impl Strategy<Value = Case> {
    let joints = &["revolute", "continuous", "prismatic", "planar"];
    vec(body(joints), 1..=8).prop_flat_map(|bodies| case_of(bodies, false))
}

/// A tree on a floating base, with floating joints in it.
fn floating_case() -> impl Strategy<Value = Case> {
    let joints = &[
        "revolute",
        "continuous",
        "prismatic",
        "planar",
        "revolute",
        "floating",
    ];
    vec(body(joints), 1..=6).prop_flat_map(|bodies| case_of(bodies, true))
}

fn case_of(bodies: Vec<RandomBody>, floating_base: bool) -> impl Strategy<Value = Case> {
    let most = 7 * (bodies.len() + 1);
    let state = (
        vec(-3.0..3.0, most),
        vec(-2.0..2.0, most),
        vec(-5.0..5.0, most),
    );
    (Just(bodies), state)
        .prop_map(move |(bodies, (q, v, a))| new_case(&bodies, floating_base, q, v, a))
}

/// Of q, v and a as much is taken as there are coordinates.
fn new_case(
    bodies: &[RandomBody],
    floating_base: bool,
    mut q: Vec<f64>,
    mut v: Vec<f64>,
    mut a: Vec<f64>,
) -> Case {
    let options = Options {
        floating_base,
        ..Options::default()
    };
    let text = urdf(bodies);
    let read = lagrange::urdf::read(&text, &options).unwrap();
    let mechanics = tree(&text, &options);
    q.truncate(mechanics.nq());
    v.truncate(mechanics.nv());
    a.truncate(mechanics.nv());
    state::normalize(mechanics.coordinates(), &mut q);
    let mass = mechanics.mass_matrix(&q).unwrap().amax();
    let amax = |x: &[f64]| x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let bias = mechanics.bias_force(&q, &v).unwrap().amax();
    let force = mass * (amax(&v).powi(2) + amax(&a)) + bias;
    Case {
        urdf: read,
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

/// q after the time h at the velocity v.
fn moved(tree: &Tree, q: &[f64], v: &[f64], h: f64) -> Vec<f64> {
    let motion: Vec<f64> = v.iter().map(|v| h * v).collect();
    state::integrate(tree.coordinates(), q, &motion).unwrap()
}

/// T and V from the poses of the links: velocities are differences of fourth order along the motion at v.
fn energies_by_poses(tree: &Tree, q: &[f64], v: &[f64]) -> (f64, f64) {
    let h = 1e-3;
    let poses = |s: f64| tree.link_poses(&moved(tree, q, v, s * h)).unwrap();
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
    fn the_energies_of_floating_trees_are_those_of_the_moving_bodies(case in floating_case()) {
        let Case { mechanics, q, v, .. } = &case;
        let (kinetic, potential) = energies_by_poses(mechanics.lagrangian(), q, v);
        let found = mechanics.kinetic_energy(q, v).unwrap();
        prop_assert!((found - kinetic).abs() <= 1e-8 * (1.0 + kinetic), "{found} {kinetic}");
        let found = mechanics.potential_energy(q).unwrap();
        prop_assert!((found - potential).abs() <= 1e-11 * (1.0 + potential.abs()), "{found} {potential}");
    }

    #[test]
    fn forces_on_floating_trees_give_the_power_and_the_acceleration(case in floating_case()) {
        let Case { mechanics, q, v, a, .. } = &case;
        let tree = mechanics.lagrangian();
        let force = mechanics.inverse_dynamics(q, v, a).unwrap();
        let found = mechanics.forward_dynamics(q, v, force.as_slice()).unwrap();
        let missed = mechanics.mass_matrix(q).unwrap() * (found - DVector::from_column_slice(a));
        prop_assert!(missed.amax() <= 1e-12 * case.force);
        // d/dt (T + V) by differences of fourth order along a smooth motion that has this v and v̇ = a in its middle.
        let energy = |s: f64| {
            let h = s * 1e-3;
            let at = |share: f64| -> Vec<f64> { v.iter().zip(a).map(|(v, a)| v + share * h * a).collect() };
            let there = moved(tree, q, &at(0.5), h);
            tree.kinetic(&there, &at(1.0)) + tree.potential(&there)
        };
        let rate = ((energy(1.0) - energy(-1.0)) * 8.0 - (energy(2.0) - energy(-2.0))) / 12e-3;
        let power = force.dot(&DVector::from_column_slice(v));
        let speed: f64 = v.iter().map(|v| v.abs()).sum();
        prop_assert!((power - rate).abs() <= 1e-8 * case.force * (1.0 + speed), "{power} {rate}");
    }

    #[test]
    fn a_tree_that_is_written_and_read_again_is_the_same(case in floating_case()) {
        let mechanics = &case.mechanics;
        let text = lagrange::urdf::write(&case.urdf);
        let again = tree(&text, &Options { floating_base: true, ..Options::default() });
        prop_assert_eq!(mechanics.coordinates(), again.coordinates());
        let (q, v) = (&case.q, &case.v);
        prop_assert_eq!(mechanics.mass_matrix(q).unwrap(), again.mass_matrix(q).unwrap());
        prop_assert_eq!(mechanics.bias_force(q, v).unwrap(), again.bias_force(q, v).unwrap());
    }

    #[test]
    fn jacobians_times_v_are_the_velocities_of_points_links_and_centre_of_mass(case in floating_case()) {
        let Case { mechanics, q, v, .. } = &case;
        let tree = mechanics.lagrangian();
        let (h, velocity) = (1e-3, DVector::from_column_slice(v));
        let around = [-2.0, -1.0, 1.0, 2.0].map(|s| moved(tree, q, v, s * h));
        let rates = state::position_rate(tree.coordinates(), q, v).unwrap();
        let moving = along(q, &rates);
        let size = 1.0 + q.iter().chain(v).fold(0.0_f64, |m, x| m.max(x.abs()));
        for link in 0..tree.links().len() {
            let point = [0.2, -0.1, 0.3];
            let moved = tree.link_jacobian(q, link, point).unwrap() * &velocity;
            // The point by dual numbers, exactly; and where it is.
            let position = tree.point_position(&moving, link, point);
            let pose = tree.link_pose(q, link).unwrap();
            let at = (pose * Point3::from(point)).coords;
            for k in 0..3 {
                prop_assert!((position[k].re - at[k]).abs() <= 1e-13 * size);
                prop_assert!((position[k].eps - moved[k]).abs() <= 1e-12 * size * size, "{} {}", position[k].eps, moved[k]);
            }
            // The angular velocity by differences.
            let [a, b, c, d] = around.each_ref().map(|q| {
                tree.link_pose(q, link).unwrap().rotation.to_rotation_matrix().into_inner()
            });
            let turning = ((c - b) * 8.0 - (d - a)) / (12.0 * h);
            let spin = turning * pose.rotation.to_rotation_matrix().into_inner().transpose();
            let w = Vector3::new(spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]);
            prop_assert!((moved.fixed_rows::<3>(3) - w).amax() <= 1e-8 * size.powi(5), "{w}");
        }
        let [a, b, c, d] = around.each_ref().map(|q| tree.centre_of_mass(q).unwrap());
        let expected = ((c - b) * 8.0 - (d - a)) / (12.0 * h);
        let found = tree.centre_of_mass_jacobian(q).unwrap() * &velocity;
        prop_assert!((found - expected).amax() <= 1e-8 * size.powi(5));
        // m g · c is −V.
        let gravity = Vector3::from(tree.gravity());
        let potential = -tree.mass() * gravity.dot(&tree.centre_of_mass(q).unwrap());
        prop_assert!((potential - tree.potential(q)).abs() <= 1e-12 * tree.mass() * 10.0 * size * 10.0);
    }

    #[test]
    fn what_is_fixed_in_a_link_pushes_by_its_jacobian_and_changes_with_the_position_as_duals_say(case in floating_case()) {
        let Case { mechanics, q, .. } = &case;
        let tree = mechanics.lagrangian();
        let (nv, size) = (tree.nv(), 1.0 + q.iter().fold(0.0_f64, |m, x| m.max(x.abs())));
        let (point, force, torque) = ([0.2, -0.1, 0.3], [0.7, -1.1, 0.4], [-0.5, 0.2, 0.9]);
        let mut memory = LinkForceMemory::default();
        for link in 0..tree.links().len() {
            let Some(own) = tree.link_force(link, point, force, torque) else {
                prop_assert!(tree.links()[link].body.is_none());
                continue;
            };
            let turn = tree.link_pose(q, link).unwrap().rotation;
            let [f, n] = [force, torque].map(|x| turn * Vector3::from(x));
            let world = DVector::from_iterator(6, f.iter().chain(n.iter()).copied());
            let expected = tree.link_jacobian(q, link, point).unwrap().tr_mul(&world);
            let found = DVector::from_vec(own.generalized(q));
            prop_assert!((&found - expected).amax() <= 1e-13 * size * size);
            prop_assert!((0..nv).all(|i| own.moves(i) || found[i] == 0.0));

            let (mut value, mut by_q) = (DVector::zeros(nv), DMatrix::<f64>::zeros(nv, nv));
            own.each_derivative(q, &mut memory, |entry, part| match entry {
                LinkForceEntry::Value(i) => value[i] += part,
                LinkForceEntry::ByPosition(i, k) => by_q[(i, k)] += part,
            });
            prop_assert_eq!(&value, &found);
            for k in 0..nv {
                let mut direction = vec![0.0; nv];
                direction[k] = 1.0;
                let rates = state::position_rate(tree.coordinates(), q, &direction).unwrap();
                let mut slope = vec![0.0_f64; nv];
                own.each(&along(q, &rates), |i, part: Dual64| slope[i] += part.eps);
                for i in 0..nv {
                    prop_assert!((slope[i] - by_q[(i, k)]).abs() <= 1e-12 * size * size, "{i} {k}: {} {}", slope[i], by_q[(i, k)]);
                }
            }

            // Seven states beside this one.
            let eight: Vec<[f64; LANES]> = q.iter().map(|&q| std::array::from_fn(|lane| match lane {
                3 => q,
                _ => 0.1 * lane as f64,
            })).collect();
            let (mut lane, mut by_lane) = (DVector::zeros(nv), DMatrix::<f64>::zeros(nv, nv));
            own.each_derivative_of_eight(&eight, &mut memory, |entry, part| match entry {
                LinkForceEntry::Value(i) => lane[i] += part[3],
                LinkForceEntry::ByPosition(i, k) => by_lane[(i, k)] += part[3],
            });
            prop_assert!((&lane - &value).amax() <= 1e-14 * size * size && (by_lane - &by_q).amax() <= 1e-14 * size * size);
            own.each_of_eight(&eight, |i, part| lane[i] -= part[3]);
            prop_assert!(lane.amax() == 0.0 || lane.amax() <= 1e-14 * size * size);
        }
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
