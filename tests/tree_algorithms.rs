//! The algorithms for trees against Euler–Lagrange by dual numbers, on random trees of one to forty joints: planar joints among them,
//! on a fixed base and on a floating one.

use crate::common::load::tree;
use crate::common::random_tree::{RandomBody, body, urdf};
use lagrange::equations::adjoint;
use lagrange::mechanism::Tree;
use lagrange::urdf::Options;
use lagrange::{
    Dynamics, ForwardDynamicsDerivatives, ForwardDynamicsGradient, InverseDynamicsDerivatives,
    InverseDynamicsGradient, LANES, Lagrangian, Linear, Mechanics, state,
};
use nalgebra::{DMatrix, DVector};
use num_dual::Dual64;
use proptest::collection::vec;
use proptest::prelude::*;

const MOST: usize = 40;

struct Case {
    text: String,
    mechanics: Dynamics<Tree>,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    /// Largest entry of M.
    mass: f64,
    /// The size of a force's terms, N: what rounding is measured by.
    force: f64,
    /// The mechanism's reach, m: of what a link's displacement by a joint is made.
    reach: f64,
}

fn case(most: usize) -> impl Strategy<Value = Case> {
    let joints = &["revolute", "continuous", "prismatic", "revolute", "planar"];
    (vec(body(joints), 1..=most), any::<bool>()).prop_flat_map(|(bodies, floating)| {
        // A planar joint has three coordinates, the base seven.
        let n = 3 * bodies.len() + 7;
        let state = (vec(-3.0..3.0, n), vec(-2.0..2.0, n), vec(-5.0..5.0, n));
        (Just((bodies, floating)), state)
            .prop_map(|((bodies, floating), state)| new_case(&bodies, floating, state))
    })
}

fn new_case(
    bodies: &[RandomBody],
    floating: bool,
    (mut q, mut v, mut a): (Vec<f64>, Vec<f64>, Vec<f64>),
) -> Case {
    // A floating base has mass.
    let root = r#"<link name="l0"><inertial><mass value="4"/>
      <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.15" iyz="0" izz="0.12"/></inertial></link>"#;
    let text = match floating {
        true => urdf(bodies).replace("<link name=\"l0\"/>", root),
        false => urdf(bodies),
    };
    let mechanics = tree(
        &text,
        &Options {
            floating_base: floating,
            ..Options::default()
        },
    );
    q.truncate(mechanics.nq());
    v.truncate(mechanics.nv());
    a.truncate(mechanics.nv());
    let coordinates = mechanics.coordinates();
    state::normalize(coordinates, &mut q);
    let mass = mechanics.mass_matrix(&q).unwrap().amax();
    let amax = |x: &[f64]| x.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
    let bias = mechanics.bias_force(&q, &v).unwrap().amax();
    let gravity = mechanics.gravity_force(&q).unwrap().amax();
    let force = mass * (amax(&v).powi(2) + amax(&a)) + bias + gravity;
    Case {
        text,
        reach: 1.0 + 3.0 * bodies.len() as f64,
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
        let joints = self.mechanics.lagrangian().joints();
        write!(f, "q = {q:?}, v = {v:?}, a = {a:?}, {joints:#?}")
    }
}

impl Case {
    fn tree(&self) -> &Tree {
        self.mechanics.lagrangian()
    }
    fn floats(&self) -> bool {
        self.mechanics.coordinates().iter().any(|c| c.floating)
    }
}

/// |x − y| ≤ tolerance · scale, entry by entry; NaN fails.
fn close(what: &str, x: &[f64], y: &[f64], tolerance: f64) -> Result<(), TestCaseError> {
    prop_assert_eq!(x.len(), y.len());
    for (i, (x, y)) in x.iter().zip(y).enumerate() {
        prop_assert!(
            (x - y).abs() <= tolerance,
            "{}: entry {} is {} against {}, tolerance {:e}",
            what,
            i,
            x,
            y,
            tolerance
        );
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    #[test]
    fn the_mass_matrix_is_the_second_derivative_of_the_kinetic_energy(case in case(MOST)) {
        let n = case.mechanics.nv();
        let mass = case.mechanics.mass_matrix(&case.q).unwrap();
        // ∂T/∂v_i at v = e_j.
        let q: Vec<Dual64> = case.q.iter().map(|&x| x.into()).collect();
        let by_t = DMatrix::from_fn(n, n, |i, j| {
            let v: Vec<Dual64> = (0..n)
                .map(|k| Dual64::new(f64::from(u8::from(k == j)), f64::from(u8::from(k == i))))
                .collect();
            case.tree().kinetic(&q, &v).eps
        });
        close("M", mass.as_slice(), by_t.as_slice(), 1e-13 * case.reach * case.mass)?;
    }

    #[test]
    fn gravity_is_the_slope_of_the_potential_energy(case in case(MOST)) {
        let n = case.mechanics.nv();
        let gravity = case.mechanics.gravity_force(&case.q).unwrap();
        let coordinates = case.mechanics.coordinates();
        let slope: Vec<f64> = (0..n).map(|i| {
            let mut along = vec![0.0; n];
            along[i] = 1.0;
            let rate = state::position_rate(coordinates, &case.q, &along).unwrap();
            let q: Vec<Dual64> = case.q.iter().zip(&rate).map(|(&q, &r)| Dual64::new(q, r)).collect();
            case.tree().potential(&q).eps
        }).collect();
        close("G", gravity.as_slice(), &slope, 1e-13 * case.reach * case.force)?;
    }

    #[test]
    fn inverse_dynamics_is_euler_lagrange_by_the_adjoint(case in case(MOST)) {
        let Case { q, v, a, .. } = &case;
        let recursion = case.mechanics.inverse_dynamics(q, v, a).unwrap();
        let adjoint = adjoint::inverse_dynamics(case.tree(), q, v, a).unwrap();
        close("Q", recursion.as_slice(), adjoint.as_slice(), 1e-13 * case.reach * case.force)?;
    }

    #[test]
    fn inverse_dynamics_is_euler_lagrange_by_dual_numbers(case in case(12)) {
        if !case.floats() {
            let Case { q, v, a, .. } = &case;
            let recursion = case.mechanics.inverse_dynamics(q, v, a).unwrap();
            let duals = case.mechanics.clone().by_duals().inverse_dynamics(q, v, a).unwrap();
            close("Q", recursion.as_slice(), duals.as_slice(), 1e-13 * case.reach * case.force)?;
        }
    }

    #[test]
    fn the_terms_add_up_to_the_inverse_dynamics(case in case(MOST)) {
        let Case { q, v, a, mechanics, .. } = &case;
        let n = mechanics.nv();
        let tolerance = 1e-13 * case.reach * case.force;
        let (mut mass, mut coriolis, mut gravity) =
            (DMatrix::zeros(n, n), DMatrix::zeros(n, n), DVector::zeros(n));
        let p = mechanics.nominal();
        mechanics.equations_into(q, v, &p, &mut mechanics.workspace(), &mut mass, &mut coriolis, &mut gravity);
        let sum = &mass * DVector::from_column_slice(a) + &coriolis * DVector::from_column_slice(v) + &gravity;
        close("Q", sum.as_slice(), mechanics.inverse_dynamics(q, v, a).unwrap().as_slice(), tolerance)?;
        // Together and alone.
        close("M", mass.as_slice(), mechanics.mass_matrix(q).unwrap().as_slice(), 1e-14 * case.mass)?;
        close("C", coriolis.as_slice(), mechanics.coriolis_matrix(q, v).unwrap().as_slice(), tolerance)?;
        close("G", gravity.as_slice(), mechanics.gravity_force(q).unwrap().as_slice(), tolerance)?;
    }

    #[test]
    fn the_coriolis_matrix_is_half_the_slope_of_the_velocity_force(case in case(20)) {
        if !case.floats() {
            let Case { q, v, mechanics, .. } = &case;
            let n = mechanics.nv();
            let coriolis = mechanics.coriolis_matrix(q, v).unwrap();
            let zero = vec![0.0; n];
            for j in 0..n {
                let mut along = zero.clone();
                along[j] = 1.0;
                let slope = adjoint::inverse_dynamics_along(case.tree(), (q, v, &zero), (&zero, &along, &zero)).unwrap() * 0.5;
                close("C", coriolis.column(j).as_slice(), slope.as_slice(), 1e-13 * case.reach * case.force)?;
            }
        }
    }

    #[test]
    fn the_coriolis_matrix_takes_no_power(case in case(MOST)) {
        // Ṁ = C + Cᵀ: Ṁ − 2C is skew. Ṁ along q̇ by dual numbers of T.
        let Case { q, v, mechanics, .. } = &case;
        let n = mechanics.nv();
        let coriolis = mechanics.coriolis_matrix(q, v).unwrap();
        let rate = state::position_rate(mechanics.coordinates(), q, v).unwrap();
        let moving: Vec<Dual64> = q.iter().zip(&rate).map(|(&q, &r)| Dual64::new(q, r)).collect();
        let kinetic = |i: usize, j: usize, both: f64| {
            let mut u = vec![Dual64::from(0.0); n];
            u[i] += 1.0;
            u[j] += both;
            case.tree().kinetic(&moving, &u).eps
        };
        let alone: Vec<f64> = (0..n).map(|i| kinetic(i, i, 0.0)).collect();
        let mass_rate = DMatrix::from_fn(n, n, |i, j| kinetic(i, j, 1.0) - alone[i] - alone[j]);
        // T of a pair: for i = j it is T(2 e_i) = 4 T(e_i).
        let expected = DMatrix::from_fn(n, n, |i, j| if i == j { 2.0 * alone[i] } else { mass_rate[(i, j)] });
        let sum = &coriolis + coriolis.transpose();
        close("Ṁ", sum.as_slice(), expected.as_slice(), 1e-12 * case.reach * case.mass)?;
    }

    #[test]
    fn both_forward_dynamics_undo_the_inverse(case in case(MOST)) {
        let Case { q, v, a, mechanics, .. } = &case;
        let force = mechanics.inverse_dynamics(q, v, a).unwrap();
        let found = mechanics.forward_dynamics(q, v, force.as_slice()).unwrap();
        // Measured where it is well conditioned: by the force that the error would need.
        let mass = mechanics.mass_matrix(q).unwrap();
        let residual = &mass * (&found - DVector::from_column_slice(a));
        close("M v̇", residual.as_slice(), &vec![0.0; a.len()], 1e-11 * case.reach * case.force)?;
        let by = mechanics.forward_dynamics_derivatives(q, v, force.as_slice()).unwrap();
        let residual = &mass * (&by.acceleration - DVector::from_column_slice(a));
        close("M v̇", residual.as_slice(), &vec![0.0; a.len()], 1e-11 * case.reach * case.force)?;
        let identity = &mass * &by.by_force;
        let condition = case.mass * by.by_force.amax();
        close("M M⁻¹", identity.as_slice(), DMatrix::<f64>::identity(a.len(), a.len()).as_slice(), 1e-13 * case.reach * condition)?;
    }

    #[test]
    fn derivatives_of_the_inverse_dynamics_are_those_of_dual_numbers(case in case(MOST)) {
        let Case { q, v, a, mechanics, .. } = &case;
        let n = mechanics.nv();
        let zero = vec![0.0; n];
        let found = mechanics.inverse_dynamics_derivatives(q, v, a).unwrap();
        let tolerance = 1e-12 * case.reach * case.force;
        // Some columns of each tree; all of them over the cases.
        for j in (0..n).step_by(1 + n / 8) {
            let mut along = zero.clone();
            along[j] = 1.0;
            let at = (&q[..], &v[..], &a[..]);
            let by_q = adjoint::inverse_dynamics_along(case.tree(), at, (&along, &zero, &zero)).unwrap();
            let by_v = adjoint::inverse_dynamics_along(case.tree(), at, (&zero, &along, &zero)).unwrap();
            close("∂Q/∂q", found.by_q.column(j).as_slice(), by_q.as_slice(), tolerance)?;
            close("∂Q/∂v", found.by_v.column(j).as_slice(), by_v.as_slice(), tolerance)?;
        }
    }

    #[test]
    fn derivatives_in_the_masses_add_up_to_the_force(case in case(MOST)) {
        // Q is linear in the factors of all masses.
        let Case { q, v, a, mechanics, .. } = &case;
        let found = mechanics.inverse_dynamics_derivatives(q, v, a).unwrap();
        let sum = found.by_p.column_sum();
        let force = mechanics.inverse_dynamics(q, v, a).unwrap();
        close("Σ ∂Q/∂p", sum.as_slice(), force.as_slice(), 1e-12 * case.reach * case.force)?;
        // And one factor alone.
        let mut p = mechanics.nominal();
        let k = p.len() / 2;
        p[k] = 1.5;
        let mut other = force.clone();
        mechanics.inverse_dynamics_into(q, v, a, &p, &mut mechanics.workspace(), &mut other);
        let expected = &force + found.by_p.column(k) * 0.5;
        close("Q(p)", other.as_slice(), expected.as_slice(), 1e-12 * case.reach * case.force)?;
    }

    #[test]
    fn derivatives_of_the_forward_dynamics_cancel_those_of_the_inverse(case in case(MOST)) {
        // 0 = d/dx Q(q, v, v̇(x)) = ∂Q/∂x + M ∂v̇/∂x.
        let Case { q, v, a, mechanics, .. } = &case;
        let n = mechanics.nv();
        let force = mechanics.inverse_dynamics(q, v, a).unwrap();
        let p = mechanics.nominal();
        let some = [0, p.len() - 1];
        let (mut work, some) = (mechanics.workspace(), &some[..p.len().min(2)]);
        let mut by = ForwardDynamicsDerivatives::zeros(n, some.len());
        mechanics.forward_dynamics_derivatives_into(q, v, force.as_slice(), &p, some, &mut work, &mut by).unwrap();
        let mut inverse = InverseDynamicsDerivatives::zeros(n, some.len());
        mechanics.inverse_dynamics_derivatives_into(q, v, by.acceleration.as_slice(), &p, some, &mut work, &mut inverse);
        let mass = mechanics.mass_matrix(q).unwrap();
        for (what, by, inverse) in [("q", &by.by_q, &inverse.by_q), ("v", &by.by_v, &inverse.by_v), ("p", &by.by_p, &inverse.by_p)] {
            let sum = &mass * by + inverse;
            let scale = (case.force + inverse.amax()) * case.reach;
            close(what, sum.as_slice(), DMatrix::<f64>::zeros(n, by.ncols()).as_slice(), 1e-10 * scale)?;
        }
    }

    #[test]
    fn gradients_are_products_with_the_derivatives(case in case(MOST), seed in vec(-1.0..1.0, 3 * MOST + 6)) {
        let Case { q, v, a, mechanics, .. } = &case;
        let (n, p) = (mechanics.nv(), mechanics.nominal());
        let weight = DVector::from_column_slice(&seed[..n]);
        let row = weight.transpose();
        let (mut work, w) = (mechanics.workspace(), weight.as_slice());
        let mut inverse = InverseDynamicsGradient::zeros(n, p.len());
        mechanics.inverse_dynamics_gradient_into(q, v, a, &p, w, &mut work, &mut inverse);
        let by = mechanics.inverse_dynamics_derivatives(q, v, a).unwrap();
        let tolerance = 1e-12 * case.reach * case.force * n as f64;
        close("λᵀ ∂Q/∂q", inverse.by_q.as_slice(), (&row * &by.by_q).as_slice(), tolerance)?;
        close("λᵀ ∂Q/∂v", inverse.by_v.as_slice(), (&row * &by.by_v).as_slice(), tolerance)?;
        close("λᵀ ∂Q/∂p", inverse.by_p.as_slice(), (&row * &by.by_p).as_slice(), tolerance)?;
        close("λᵀ M", inverse.by_a.as_slice(), (&row * mechanics.mass_matrix(q).unwrap()).as_slice(), tolerance)?;

        let mut forward = ForwardDynamicsGradient::zeros(n, p.len());
        mechanics.forward_dynamics_gradient_into(q, v, a, &p, w, &mut work, &mut forward).unwrap();
        let by = mechanics.forward_dynamics_derivatives(q, v, a).unwrap();
        for (what, gradient, by) in [
            ("q", &forward.by_q, &by.by_q), ("v", &forward.by_v, &by.by_v),
            ("Q", &forward.by_force, &by.by_force), ("p", &forward.by_p, &by.by_p),
        ] {
            let condition = case.mass * forward.by_force.amax().max(1.0 / case.mass);
            let scale = 1e-11 * case.reach * n as f64 * condition * (1.0 + by.amax());
            close(what, gradient.as_slice(), (&row * by).as_slice(), scale)?;
        }
    }

    #[test]
    fn the_force_is_linear_in_the_inertial_parameters(case in case(MOST)) {
        let Case { q, v, a, mechanics, .. } = &case;
        let force = mechanics.regressor(q, v, a).unwrap() * mechanics.inertial_parameters();
        let expected = mechanics.inverse_dynamics(q, v, a).unwrap();
        close("Y π", force.as_slice(), expected.as_slice(), 1e-12 * case.reach * case.force)?;
    }

    #[test]
    fn derivatives_in_mass_centre_and_inertia_are_those_of_differences(case in case(8), parameter in 0..10_usize) {
        // The last link of the URDF, with one number of its inertial moved.
        let Case { q, v, a, mechanics, .. } = &case;
        let links = case.tree().links();
        let link = links.len() - 1;
        let force = mechanics.inverse_dynamics(q, v, a).unwrap();
        let moved = |by: f64| {
            let inertia = links[link].inertial.unwrap().in_link();
            let (mut mass, mut centre, mut about) = (inertia.mass, inertia.centre(), inertia.rotational_about_centre());
            match parameter {
                0 => mass += by,
                1..=3 => centre[parameter - 1] += by,
                _ => {
                    let (i, j) = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)][parameter - 4];
                    about[(i, j)] += by;
                    if i != j {
                        about[(j, i)] += by;
                    }
                }
            }
            let start = case.text.find(&format!("<link name=\"{}\">", links[link].name)).unwrap();
            let end = start + case.text[start..].find("</link>").unwrap();
            let [x, y, z]: [f64; 3] = centre.into();
            let [xx, xy, xz, yy, yz, zz] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|e| about[e]);
            let body = format!(
                r#"<link name="{}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/><inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/></inertial>"#,
                links[link].name
            );
            let mut text = case.text.clone();
            text.replace_range(start..end, &body);
            let other = tree(&text, &Options { floating_base: case.floats(), ..Options::default() });
            (other.inverse_dynamics(q, v, a).unwrap(), other.forward_dynamics(q, v, force.as_slice()).unwrap())
        };
        let h = 1e-4;
        let ((up, up_a), (down, down_a)) = (moved(h), moved(-h));
        let by = mechanics.inverse_dynamics_by_inertia(link, q, v, a).unwrap();
        let column = by.column(parameter).into_owned();
        // Quadratic at most in each parameter: differences are exact to rounding.
        let expected = (up - down) / (2.0 * h);
        close("∂Q/∂π", column.as_slice(), expected.as_slice(), 1e-9 * case.reach * (case.force + column.amax()))?;
        let by = mechanics.forward_dynamics_by_inertia(link, q, v, force.as_slice()).unwrap();
        let mass = mechanics.mass_matrix(q).unwrap();
        let expected = &mass * (up_a - down_a) / (2.0 * h);
        let found = &mass * by.column(parameter);
        let scale = case.reach * (case.force + column.amax());
        close("M ∂v̇/∂π", found.as_slice(), expected.as_slice(), 1e-4 * scale)?;
    }

    #[test]
    fn work_goes_into_the_two_energies(case in case(MOST)) {
        let Case { q, v, a, mechanics, .. } = &case;
        let balance = mechanics.power_balance(q, v, a).unwrap();
        // dT/dt + dV/dt along the motion, by dual numbers of the energies themselves.
        let acceleration = mechanics.forward_dynamics(q, v, a).unwrap();
        let rate = state::position_rate(mechanics.coordinates(), q, v).unwrap();
        let lift = |x: &[f64], dx: &[f64]| -> Vec<Dual64> { x.iter().zip(dx).map(|(&x, &dx)| Dual64::new(x, dx)).collect() };
        let (qd, vd) = (lift(q, &rate), lift(v, acceleration.as_slice()));
        let scale = 2.0 * case.reach * (case.force + case.mass * acceleration.amax()) * a.len() as f64;
        let rates = [case.tree().kinetic(&qd, &vd).eps, case.tree().potential(&qd).eps];
        close("dT/dt, dV/dt", &[balance.kinetic, balance.potential], &rates, 1e-12 * scale)?;
        close("Q · v", &[balance.input], &[rates[0] + rates[1]], 1e-11 * scale)?;
    }

    #[test]
    fn the_momentum_is_the_slope_of_the_kinetic_energy(case in case(MOST)) {
        let Case { q, v, mechanics, .. } = &case;
        let n = mechanics.nv();
        let momentum = mechanics.momentum(q, v).unwrap();
        let by_mass = mechanics.mass_matrix(q).unwrap() * DVector::from_column_slice(v);
        let qd: Vec<Dual64> = q.iter().map(|&x| x.into()).collect();
        let slope: Vec<f64> = (0..n).map(|i| {
            let vd: Vec<Dual64> = v.iter().enumerate().map(|(k, &v)| Dual64::new(v, f64::from(u8::from(k == i)))).collect();
            case.tree().kinetic(&qd, &vd).eps
        }).collect();
        let tolerance = 1e-13 * case.reach * case.mass * n as f64;
        close("M v", momentum.as_slice(), by_mass.as_slice(), tolerance)?;
        close("∂T/∂v", momentum.as_slice(), &slope, tolerance)?;
    }

    #[test]
    fn twins_in_used_memory_and_with_other_masses_are_the_calls_that_allocate(case in case(12), factor in 0.5..2.0_f64) {
        let Case { q, v, a, mechanics, .. } = &case;
        let (n, p, work) = (mechanics.nv(), mechanics.nominal(), &mut mechanics.workspace());
        let links = mechanics.lagrangian().links().len();
        let mut linear = Linear::zeros(n);
        let mut momentum = DVector::zeros(n);
        let mut y = mechanics.regressor(q, v, a).unwrap();
        let (mut inverse, mut forward) = (DMatrix::zeros(n, 10), DMatrix::zeros(n, 10));
        // Twice, the first time elsewhere: nothing is left over.
        let slow: Vec<f64> = v.iter().map(|v| 0.3 * v).collect();
        for v in [&slow, v] {
            mechanics.momentum_into(q, v, &p, work, &mut momentum);
            mechanics.linearize_into(q, v, a, &p, work, &mut linear).unwrap();
            let balance = mechanics.power_balance_with(q, v, a, &p, work).unwrap();
            mechanics.regressor_into(q, v, a, work, &mut y);
            for link in (0..links).rev() {
                mechanics.inverse_dynamics_by_inertia_into(link, q, v, a, &p, work, &mut inverse);
                mechanics.forward_dynamics_by_inertia_into(link, q, v, a, &p, work, &mut forward).unwrap();
            }
            prop_assert_eq!(&momentum, &mechanics.momentum(q, v).unwrap());
            prop_assert_eq!(&linear, &mechanics.linearize(q, v, a).unwrap());
            prop_assert_eq!(balance, mechanics.power_balance(q, v, a).unwrap());
            prop_assert_eq!(&y, &mechanics.regressor(q, v, a).unwrap());
            prop_assert_eq!(&inverse, &mechanics.inverse_dynamics_by_inertia(0, q, v, a).unwrap());
            prop_assert_eq!(&forward, &mechanics.forward_dynamics_by_inertia(0, q, v, a).unwrap());
        }
        // All masses times `factor`: momenta and slopes grow with it.
        let scaled: Vec<f64> = p.iter().map(|p| factor * p).collect();
        mechanics.momentum_into(q, v, &scaled, work, &mut momentum);
        let expected = mechanics.momentum(q, v).unwrap() * factor;
        close("p", momentum.as_slice(), expected.as_slice(), 1e-13 * case.reach * case.mass * n as f64)?;
        let last = links - 1;
        mechanics.inverse_dynamics_by_inertia_into(last, q, v, a, &scaled, work, &mut inverse);
        let expected = mechanics.inverse_dynamics_by_inertia(last, q, v, a).unwrap() * factor;
        close("∂Q/∂π", inverse.as_slice(), expected.as_slice(), 1e-13 * (expected.amax() + case.force))?;
        // −M⁻¹ of them, at the v̇ of those masses.
        let mut acceleration = DVector::from_column_slice(a);
        mechanics.forward_dynamics_into(q, v, &scaled, work, &mut acceleration).unwrap();
        mechanics.inverse_dynamics_by_inertia_into(last, q, v, acceleration.as_slice(), &scaled, work, &mut inverse);
        mechanics.forward_dynamics_by_inertia_into(last, q, v, a, &scaled, work, &mut forward).unwrap();
        let sum = mechanics.mass_matrix(q).unwrap() * factor * &forward + &inverse;
        let size = (1.0 + case.force + inverse.amax() + case.mass * forward.amax()) * case.reach;
        close("M ∂v̇/∂π + ∂Q/∂π", sum.as_slice(), DMatrix::<f64>::zeros(n, 10).as_slice(), 1e-11 * size)?;
    }

    #[test]
    fn momentum_stays_where_nothing_pulls(case in case(MOST)) {
        // Without gravity and forces a mechanism on a floating base keeps its linear and angular momentum in the world.
        if case.floats() {
            let Case { q, v, mechanics, .. } = &case;
            let n = mechanics.nv();
            let options = Options { floating_base: true, gravity: [0.0; 3], ..Options::default() };
            let free = tree(&case.text, &options);
            let a = free.forward_dynamics(q, v, &vec![0.0; n]).unwrap();
            // The base's six rows of M v are the momentum in its axes, about its origin: d/dt in the world is ṗ + ω × p, L̇ + ω × L + u × p.
            let mass = free.mass_matrix(q).unwrap();
            let coriolis = free.coriolis_matrix(q, v).unwrap();
            let v = DVector::from_column_slice(v);
            let momentum = &mass * &v;
            // Ṁ v + M v̇ with Ṁ = C + Cᵀ.
            let rate = &mass * &a + (&coriolis + coriolis.transpose()) * &v;
            let three = |x: &DVector<f64>, k: usize| nalgebra::Vector3::new(x[k], x[k + 1], x[k + 2]);
            let (u, w) = (three(&v, 0), three(&v, 3));
            let (p, l) = (three(&momentum, 0), three(&momentum, 3));
            let linear = three(&rate, 0) + w.cross(&p);
            let angular = three(&rate, 3) + w.cross(&l) + u.cross(&p);
            let scale = case.reach * (case.force + case.mass * a.amax()) * n as f64;
            close("ṗ", linear.as_slice(), &[0.0; 3], 1e-11 * scale)?;
            close("L̇", angular.as_slice(), &[0.0; 3], 1e-11 * scale)?;
        }
    }

    #[test]
    fn eight_states_in_lanes_are_eight_states(case in case(MOST), shift in vec(-1.0..1.0, LANES)) {
        let Case { q, v, a, mechanics, .. } = &case;
        let (n, nq) = (mechanics.nv(), mechanics.nq());
        let states: Vec<Vec<f64>> = shift.iter().map(|s| {
            let mut q: Vec<f64> = q.iter().map(|x| x + s).collect();
            state::normalize(mechanics.coordinates(), &mut q);
            q
        }).collect();
        let lanes = |of: &dyn Fn(usize, usize) -> f64, n: usize| -> Vec<[f64; LANES]> {
            (0..n).map(|i| std::array::from_fn(|k| of(k, i))).collect()
        };
        let ql = lanes(&|k, i| states[k][i], nq);
        let vl = lanes(&|k, i| v[i] * (1.0 + shift[k]), n);
        let al = lanes(&|k, i| a[i] - shift[k], n);
        let p = mechanics.nominal();
        let work = &mut mechanics.workspace();
        let mut force = vec![[0.0; LANES]; n];
        mechanics.inverse_dynamics_lanes_into(&ql, &vl, &al, &p, work, &mut force);
        let mut mass = vec![[0.0; LANES]; n * n];
        mechanics.mass_matrix_lanes_into(&ql, &p, work, &mut mass);
        let mut back = force.clone();
        mechanics.forward_dynamics_lanes_into(&ql, &vl, &p, work, &mut back).unwrap();
        for k in 0..LANES {
            let of = |x: &[[f64; LANES]]| -> Vec<f64> { x.iter().map(|x| x[k]).collect() };
            let (q, v, a) = (of(&ql), of(&vl), of(&al));
            let one = mechanics.inverse_dynamics(&q, &v, &a).unwrap();
            // The states are larger than the case's: up to twice the speed.
            close("Q", &of(&force), one.as_slice(), 1e-12 * case.reach * case.force)?;
            let one = mechanics.mass_matrix(&q).unwrap();
            close("M", &of(&mass), one.as_slice(), 1e-12 * case.reach * one.amax())?;
            let found = DVector::from_vec(of(&back)) - DVector::from_column_slice(&a);
            close("M v̇", (one * found).as_slice(), &vec![0.0; n], 1e-10 * case.reach * case.force)?;
        }
    }

    #[test]
    fn eight_states_one_of_which_has_no_acceleration_are_an_error(case in case(4)) {
        let Case { q, v, a, mechanics, .. } = &case;
        let lanes = |x: &[f64]| -> Vec<[f64; LANES]> { x.iter().map(|&x| [x; LANES]).collect() };
        let (p, work) = (mechanics.nominal(), &mut mechanics.workspace());
        let mut out = lanes(a);
        out[0][5] = f64::NAN;
        let result = mechanics.forward_dynamics_lanes_into(&lanes(q), &lanes(v), &p, work, &mut out);
        let message = result.unwrap_err().to_string();
        prop_assert!(message.contains("generalized force holds a NaN"), "{}", message);
        let mut bad = lanes(q);
        bad[0][3] = f64::INFINITY;
        let result = mechanics.forward_dynamics_lanes_into(&bad, &lanes(v), &p, work, &mut lanes(a));
        let message = result.map_or_else(|e| e.to_string(), |()| "none".to_owned());
        // What slides on the base, or turns about a vertical, does not feel where it is; programs then do not read q.
        let insensitive = !mechanics.coordinates()[0].angular || mechanics.is_compiled();
        prop_assert!(insensitive || message.contains("q[0] is inf"), "{}", message);
    }
}

/// `count` hinges; two of them, next to one another, turn about the same axis with a massless link between them.
fn coaxial(count: usize) -> Dynamics<Tree> {
    let mut text = String::from("<robot name=\"coaxial\"><link name=\"l0\"/>");
    for k in 1..=count {
        let at = count / 2;
        let inertial = match k == at {
            true => "",
            false => {
                r#"<inertial><origin xyz="0.1 0 0.2"/><mass value="1.5"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.025"/></inertial>"#
            }
        };
        let (axis, origin) = match k {
            _ if k == at || k == at + 1 => ("0 1 0", if k == at { "0.3 0 0.1" } else { "0 0 0" }),
            _ => ("0.2 0.3 1", "0.3 0 0.1"),
        };
        text += &format!(
            r#"<link name="l{k}">{inertial}</link><joint name="j{k}" type="continuous"><parent link="l{}"/><child link="l{k}"/>
              <origin xyz="{origin}"/><axis xyz="{axis}"/></joint>"#,
            k - 1
        );
    }
    tree(&(text + "</robot>"), &Options::default())
}

#[test]
fn hinges_in_line_have_no_acceleration_of_their_own_and_no_garbage_either() {
    // Two by a program or the factor of M, eight by the factor, twelve by articulated bodies; and by dual numbers.
    for count in [2, 8, 12] {
        let mechanics = coaxial(count);
        for state in 0..20 {
            let x = |k: usize| (1.3 * (k + 7 * state) as f64).sin();
            let q: Vec<f64> = (0..count).map(x).collect();
            let v: Vec<f64> = (count..2 * count).map(x).collect();
            let force: Vec<f64> = (2 * count..3 * count).map(x).collect();
            let lanes =
                |x: &[f64]| -> Vec<[f64; LANES]> { x.iter().map(|&x| [x; LANES]).collect() };
            let (p, work) = (mechanics.nominal(), &mut mechanics.workspace());
            let mut out = lanes(&force);
            let errors = [
                mechanics.forward_dynamics(&q, &v, &force).unwrap_err(),
                mechanics
                    .forward_dynamics_derivatives(&q, &v, &force)
                    .unwrap_err(),
                mechanics
                    .clone()
                    .by_duals()
                    .forward_dynamics(&q, &v, &force)
                    .unwrap_err(),
                mechanics
                    .clone()
                    .by_programs()
                    .forward_dynamics(&q, &v, &force)
                    .unwrap_err(),
                mechanics
                    .forward_dynamics_lanes_into(&lanes(&q), &lanes(&v), &p, work, &mut out)
                    .unwrap_err(),
            ];
            for error in errors {
                let pivot = count / 2;
                let name = &mechanics.coordinates()[pivot].name;
                let culprit = format!(
                    "velocity {pivot}, that of `{name}`, moves no mass there, or none that those before it do not move"
                );
                assert!(error.to_string().contains(&culprit), "{error}");
            }
        }
    }
}

#[test]
fn a_quaternion_that_is_not_of_length_one_is_refused() {
    let text = r#"<robot name="body"><link name="body"><inertial><mass value="2"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.15"/></inertial></link></robot>"#;
    let options = Options {
        floating_base: true,
        ..Options::default()
    };
    let body = tree(text, &options);
    let q = [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0];
    let zero = [0.0; 6];
    let message = body
        .forward_dynamics(&q, &zero, &zero)
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "q[3..7] is a quaternion of length 2: it must be of length 1; use `state::normalize`"
    );
    assert!(body.lagrangian().link_poses(&q).is_err());
}

#[test]
fn an_energy_with_a_singular_point_is_named_and_not_the_force() {
    struct Cusp;
    impl Lagrangian for Cusp {
        fn dof(&self) -> usize {
            1
        }
        fn kinetic<D: lagrange::Scalar>(&self, _q: &[D], v: &[D]) -> D {
            v[0] * v[0] * 0.5
        }
        fn potential<D: lagrange::Scalar>(&self, q: &[D]) -> D {
            q[0].sqrt()
        }
    }
    let message = Dynamics::of(Cusp)
        .forward_dynamics(&[-1.0], &[0.0], &[0.0])
        .unwrap_err();
    assert!(
        message
            .to_string()
            .starts_with("the force that follows from V is NaN"),
        "{message}"
    );
}
