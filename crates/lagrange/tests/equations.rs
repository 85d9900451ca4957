//! The two routes to the equations of motion, and their derivatives, on random states of a cart-pole written in Rust.

use approx::assert_relative_eq;
use lagrange::equations::reference::{equations, equations_with};
use lagrange::{
    Dynamics, InverseDynamicsDerivatives, Lagrangian, Mechanics, Parameter, Role, Scalar,
};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

/// Cart and uniform pole, φ = 0 upright (Roehrl et al. 2020, Table 2); the masses are constants.
struct CartPole(Vec<Parameter>);

fn cart_pole() -> Dynamics<CartPole> {
    let constant = |name: &str, nominal| Parameter {
        role: Role::Constant,
        name: name.into(),
        nominal,
    };
    Dynamics::of(CartPole(vec![
        constant("m_c", 0.466),
        constant("m_p", 0.06),
        constant("m_s", 0.012),
    ]))
}

const L: f64 = 0.201;

impl Lagrangian for CartPole {
    fn dof(&self) -> usize {
        2
    }
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        let p: Vec<D> = self.0.iter().map(|p| D::constant(p.nominal)).collect();
        self.kinetic_with(q, v, &p)
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        let p: Vec<D> = self.0.iter().map(|p| D::constant(p.nominal)).collect();
        self.potential_with(q, &p)
    }
    fn parameters(&self) -> &[Parameter] {
        &self.0
    }
    fn kinetic_with<D: Scalar>(&self, q: &[D], v: &[D], p: &[D]) -> D {
        let moment = (p[1] * 0.5 + p[2]) * L;
        let inertia = (p[1] / 3.0 + p[2]) * (L * L);
        (p[0] + p[1] + p[2]) * v[0] * v[0] * 0.5
            + moment * q[1].cos() * v[0] * v[1]
            + inertia * v[1] * v[1] * 0.5
    }
    fn potential_with<D: Scalar>(&self, q: &[D], p: &[D]) -> D {
        (p[1] * 0.5 + p[2]) * q[1].cos() * (L * 9.81)
    }
}

/// A bead on a spinning, relativistically heavy wire: T is not quadratic in v.
struct NotQuadratic;

impl Lagrangian for NotQuadratic {
    fn dof(&self) -> usize {
        1
    }
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        -(-(v[0] * v[0]) * 0.04 + 1.0).sqrt() * 25.0 + q[0] * q[0] * 0.5 + q[0].sin() * v[0]
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        q[0].cos()
    }
}

fn pair(range: f64) -> impl Strategy<Value = [f64; 2]> {
    [-range..range, -range..range]
}

proptest! {
    #[test]
    fn fast_route_equals_the_reference_route(q in pair(4.0), v in pair(9.0), a in pair(20.0)) {
        let dynamics = cart_pole();
        let at = equations(dynamics.lagrangian(), &q, &v);
        assert_relative_eq!(dynamics.mass_matrix(&q).unwrap(), at.mass_matrix, max_relative = 1e-12, epsilon = 1e-14);
        assert_relative_eq!(dynamics.gravity_force(&q).unwrap(), at.gravity_force, max_relative = 1e-12, epsilon = 1e-14);
        assert_relative_eq!(dynamics.bias_force(&q, &v).unwrap(), at.bias_force, max_relative = 1e-12, epsilon = 1e-13);
        let needed = &at.mass_matrix * DVector::from_row_slice(&a) + &at.bias_force;
        assert_relative_eq!(dynamics.inverse_dynamics(&q, &v, &a).unwrap(), needed, max_relative = 1e-11, epsilon = 1e-12);
    }

    #[test]
    fn christoffel_coriolis_times_v_is_bias_less_gravity(q in pair(4.0), v in pair(9.0)) {
        let dynamics = cart_pole();
        let cv = dynamics.coriolis_matrix(&q, &v).unwrap() * DVector::from_row_slice(&v);
        let expected = dynamics.bias_force(&q, &v).unwrap() - dynamics.gravity_force(&q).unwrap();
        assert_relative_eq!(cv, expected, max_relative = 1e-12, epsilon = 1e-13);
    }

    #[test]
    fn mass_rate_less_twice_coriolis_is_skew(q in pair(4.0), v in pair(9.0)) {
        let dynamics = cart_pole();
        // Ṁ along q̇ = v by a central difference, independent of the duals.
        let h = 1e-5;
        let shifted = |s: f64| [q[0] + s * v[0], q[1] + s * v[1]];
        let rate = (dynamics.mass_matrix(&shifted(h)).unwrap() - dynamics.mass_matrix(&shifted(-h)).unwrap()) / (2.0 * h);
        let skew = rate - dynamics.coriolis_matrix(&q, &v).unwrap() * 2.0;
        assert_relative_eq!(skew.clone(), -skew.transpose(), epsilon = 1e-7);
    }

    #[test]
    fn mass_matrix_is_symmetric_positive_definite(q in pair(4.0)) {
        let mass = cart_pole().mass_matrix(&q).unwrap();
        prop_assert_eq!(mass.clone(), mass.transpose());
        prop_assert!(mass.symmetric_eigen().eigenvalues.min() > 0.0);
    }

    #[test]
    fn inverse_dynamics_undoes_forward_dynamics(q in pair(4.0), v in pair(9.0), force in pair(3.0)) {
        let dynamics = cart_pole();
        let a = dynamics.forward_dynamics(&q, &v, &force).unwrap();
        let back = dynamics.inverse_dynamics(&q, &v, a.as_slice()).unwrap();
        assert_relative_eq!(back, DVector::from_row_slice(&force), epsilon = 1e-11);
    }

    #[test]
    fn derivatives_of_inverse_dynamics_equal_differences(q in pair(3.0), v in pair(5.0), a in pair(9.0)) {
        let dynamics = cart_pole();
        let nominal = dynamics.nominal();
        let mut work = dynamics.workspace();
        let mut out = InverseDynamicsDerivatives::zeros(2, 3);
        dynamics.inverse_dynamics_derivatives_into(&q, &v, &a, &nominal, &[0, 1, 2], &mut work, &mut out);

        let force = |q: &[f64], v: &[f64], p: &[f64]| {
            let at = equations_with(dynamics.lagrangian(), q, v, p);
            at.mass_matrix * DVector::from_row_slice(&a) + at.bias_force
        };
        let h = 1e-5;
        let difference = |which: usize, j: usize| -> DVector<f64> {
            let at = |s: f64| {
                let (mut q, mut v, mut p) = (q.to_vec(), v.to_vec(), nominal.clone());
                [&mut q, &mut v, &mut p][which][j] += s;
                force(&q, &v, &p)
            };
            (at(h) - at(-h)) / (2.0 * h)
        };
        for (which, matrix) in [&out.by_q, &out.by_v, &out.by_p].into_iter().enumerate() {
            for j in 0..matrix.ncols() {
                assert_relative_eq!(matrix.column(j).into_owned(), difference(which, j), max_relative = 1e-6, epsilon = 1e-6);
            }
        }
    }

    #[test]
    fn energies_not_quadratic_in_velocity_take_the_reference_route(q in -2.0..2.0, v in -3.0..3.0, force in -2.0..2.0) {
        let dynamics = Dynamics::of(NotQuadratic);
        prop_assert!(!dynamics.kinetic_is_quadratic());
        let at = equations(&NotQuadratic, &[q], &[v]);
        let a = dynamics.forward_dynamics(&[q], &[v], &[force]).unwrap();
        assert_relative_eq!(at.mass_matrix[(0, 0)] * a[0] + at.bias_force[0], force, epsilon = 1e-10);
        assert_relative_eq!(dynamics.inverse_dynamics(&[q], &[v], a.as_slice()).unwrap()[0], force, epsilon = 1e-10);
    }

    #[test]
    fn the_momentum_is_the_slope_of_an_energy_that_is_not_quadratic(q in -2.0..2.0, v in -3.0..3.0) {
        let momentum = Dynamics::of(NotQuadratic).momentum(&[q], &[v]).unwrap();
        // d/dv (−25 √(1 − 0.04 v²) + v sin q)
        let expected = v / (1.0 - 0.04 * v * v).sqrt() + q.sin();
        assert_relative_eq!(momentum[0], expected, epsilon = 1e-14, max_relative = 1e-14);
    }

    #[test]
    fn work_goes_into_the_energy_that_stays_where_it_is_not_quadratic(q in -2.0..2.0, v in -3.0..3.0, force in -2.0..2.0) {
        let dynamics = Dynamics::of(NotQuadratic);
        let balance = dynamics.power_balance(&[q], &[v], &[force]).unwrap();
        // v ∂T/∂v − T = 25/√(1 − 0.04 v²) − q²/2: its rate is γ³ v v̇ − q v.
        let a = dynamics.forward_dynamics(&[q], &[v], &[force]).unwrap()[0];
        let kinetic = v * a / (1.0 - 0.04 * v * v).powf(1.5) - q * v;
        assert_relative_eq!(balance.kinetic, kinetic, epsilon = 1e-12);
        assert_relative_eq!(balance.potential, -v * q.sin(), epsilon = 1e-14);
        assert_relative_eq!(balance.kinetic + balance.potential, balance.input, epsilon = 1e-12);
        assert_relative_eq!(balance.input, force * v, epsilon = 1e-14);
    }

    #[test]
    fn momentum_is_the_same_by_programs_and_by_duals(q in pair(4.0), v in pair(9.0)) {
        let (compiled, p) = (cart_pole(), [0.5, 0.07, 0.01]);
        let mut at = [&compiled, &cart_pole().by_duals()].map(|dynamics| {
            let mut out = DVector::zeros(2);
            dynamics.momentum_into(&q, &v, &p, &mut dynamics.workspace(), &mut out);
            out
        });
        let mut mass = DMatrix::zeros(2, 2);
        compiled.mass_matrix_into(&q, &p, &mut compiled.workspace(), &mut mass);
        let [x, y] = &mut at;
        assert_relative_eq!(x, y, max_relative = 1e-13, epsilon = 1e-13);
        assert_relative_eq!(*x, mass * DVector::from_column_slice(&v), max_relative = 1e-13, epsilon = 1e-13);
    }
}

#[test]
fn a_kinetic_energy_that_is_quadratic_only_near_the_origin_is_found_out() {
    let source = lagrange::TextSource {
        coordinates: vec!["x".into()],
        kinetic: "0.5*m*x_dot^2 + max(0, x - 10)*x_dot^4".into(),
        potential: "0".into(),
        parameters: vec![("m".into(), 2.0)],
        ..Default::default()
    };
    let text = lagrange::TextLagrangian::new(&source).unwrap();
    let dynamics = Dynamics::of(text);
    assert!(!dynamics.kinetic_is_quadratic());
    // At x = 12, v = 1: M = m + 12 (x − 10) v², bias = 3 v⁴.
    let a = dynamics.forward_dynamics(&[12.0], &[1.0], &[1.0]).unwrap();
    assert_relative_eq!(a[0], (1.0 - 3.0) / 26.0, max_relative = 1e-14);
}

#[test]
fn a_massless_coordinate_is_named() {
    struct Massless;
    impl Lagrangian for Massless {
        fn dof(&self) -> usize {
            2
        }
        fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D {
            v[0] * v[0]
        }
        fn potential<D: Scalar>(&self, _q: &[D]) -> D {
            D::zero()
        }
    }
    let error = Dynamics::of(Massless)
        .forward_dynamics(&[0.0; 2], &[0.0; 2], &[1.0; 2])
        .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("velocity 1, that of `q1`, moves no mass"),
        "{error}"
    );
}

#[test]
fn wrong_length_and_nan_are_refused() {
    let dynamics = cart_pole();
    let error = dynamics.bias_force(&[0.0], &[0.0; 2]).unwrap_err();
    assert_eq!(error.to_string(), "q has 1 entries, this mechanism takes 2");
    let error = dynamics.mass_matrix(&[0.0, f64::NAN]).unwrap_err();
    assert_eq!(error.to_string(), "q[1] is NaN: every entry must be finite");
}

#[test]
fn a_force_accelerates_by_the_inverse_of_the_mass_matrix() {
    let dynamics = cart_pole();
    let (q, v, force) = ([0.1, 2.0], [0.3, -4.0], [1.0, 0.1]);
    let by = dynamics
        .forward_dynamics_derivatives(&q, &v, &force)
        .unwrap();
    let identity = dynamics.mass_matrix(&q).unwrap() * by.by_force;
    assert_relative_eq!(identity, DMatrix::identity(2, 2), epsilon = 1e-12);
}

proptest! {
    #[test]
    fn compiled_programs_equal_the_dual_numbers(q in pair(4.0), v in pair(9.0), a in pair(20.0), force in pair(3.0)) {
        let compiled = cart_pole();
        let duals = cart_pole().by_duals();
        prop_assert!(compiled.is_compiled() && !duals.is_compiled());
        assert_relative_eq!(
            compiled.forward_dynamics(&q, &v, &force).unwrap(),
            duals.forward_dynamics(&q, &v, &force).unwrap(),
            max_relative = 1e-11, epsilon = 1e-11
        );
        let p = [0.5, 0.07, 0.01];
        let mut at = [&compiled, &duals].map(|dynamics| {
            let mut out = InverseDynamicsDerivatives::zeros(2, 2);
            dynamics.inverse_dynamics_derivatives_into(&q, &v, &a, &p, &[2, 0], &mut dynamics.workspace(), &mut out);
            out
        });
        let [x, y] = &mut at;
        for (x, y) in [(&x.by_q, &y.by_q), (&x.by_v, &y.by_v), (&x.by_p, &y.by_p)] {
            assert_relative_eq!(x, y, max_relative = 1e-11, epsilon = 1e-12);
        }
    }
}

/// Every function of the scalar, so that every rule of differentiation is used.
struct EveryFunction;

impl Lagrangian for EveryFunction {
    fn dof(&self) -> usize {
        2
    }
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        let x = q[0] * 0.1;
        let y = q[1] * 0.1;
        let m = (x * y).exp()
            + (x.sin() * y.cos() + 2.0).powf(1.7)
            + x.tanh()
            + (y * y + 1.0).ln()
            + x.atan2(y + 3.0)
            + (x + 2.0).powi(-3)
            + x.cosh()
            + y.sinh() * 0.1
            + x.tan()
            + y.asin()
            + x.acos()
            + y.atan()
            + (x - 5.0).abs();
        m * v[0] * v[0] + (x * x + 1.0).sqrt() * v[1] * v[1] * 2.0 + v[0] * v[1] * x / (y + 4.0)
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        -(q[0] * q[1]).cos() / (q[0] * q[0] + 1.0) - q[1].powi(3) * 0.1
    }
}

proptest! {
    #[test]
    fn every_function_is_differentiated_alike_by_programs_and_duals(q in pair(3.0), v in pair(3.0), a in pair(3.0)) {
        let compiled = Dynamics::of(EveryFunction);
        prop_assert!(compiled.is_compiled());
        let duals = Dynamics::of(EveryFunction).by_duals();
        assert_relative_eq!(
            compiled.forward_dynamics(&q, &v, &a).unwrap(),
            duals.forward_dynamics(&q, &v, &a).unwrap(),
            max_relative = 1e-10, epsilon = 1e-10
        );
        let [x, y] = [&compiled, &duals].map(|dynamics| {
            let mut out = InverseDynamicsDerivatives::zeros(2, 0);
            dynamics.inverse_dynamics_derivatives_into(&q, &v, &a, &[], &[], &mut dynamics.workspace(), &mut out);
            out
        });
        assert_relative_eq!(x.by_q, y.by_q, max_relative = 1e-10, epsilon = 1e-10);
        assert_relative_eq!(x.by_v, y.by_v, max_relative = 1e-10, epsilon = 1e-10);
    }
}

#[test]
fn energies_that_branch_are_left_to_the_dual_numbers() {
    struct Branch;
    impl Lagrangian for Branch {
        fn dof(&self) -> usize {
            1
        }
        fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D {
            v[0] * v[0] * 0.5
        }
        fn potential<D: Scalar>(&self, q: &[D]) -> D {
            if q[0].re() > 0.0 {
                q[0] * q[0] * 0.5
            } else {
                D::zero()
            }
        }
    }
    let dynamics = Dynamics::of(Branch);
    assert!(!dynamics.is_compiled());
    assert_eq!(
        dynamics.forward_dynamics(&[1.0], &[0.0], &[0.0]).unwrap()[0],
        -1.0
    );
    assert_eq!(
        dynamics.forward_dynamics(&[-1.0], &[0.0], &[0.0]).unwrap()[0],
        0.0
    );
}
