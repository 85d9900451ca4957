//! The reference route: Euler–Lagrange written down as it stands, right for any L.

use nalgebra::{DMatrix, DVector};
use num_dual::HyperDual64;

use super::Workspace;
use crate::Lagrangian;

/// The equations of motion at one state, M v̇ + bias = Q.
#[derive(Debug, Clone, PartialEq)]
pub struct Equations {
    /// M = ∂²L/∂v∂v, kg, kg·m or kg·m².
    pub mass_matrix: DMatrix<f64>,
    /// G = +∂V/∂q, N or N·m, on the left-hand side.
    pub gravity_force: DVector<f64>,
    /// C v + G = (∂²L/∂v∂q) v − ∂L/∂q, N or N·m, on the left-hand side.
    pub bias_force: DVector<f64>,
}

/// M, G and the bias force at (q, v) from the second derivatives of L = T − V over (q, v):
///
/// d/dt ∂L/∂v − ∂L/∂q = (∂²L/∂v∂v) v̇ + (∂²L/∂v∂q) v − ∂L/∂q.
///
/// One hyper-dual evaluation of T for each pair of a velocity and a coordinate or velocity; allocates. `q` and `v` have
/// [`dof`](Lagrangian::dof) entries. For T that is not quadratic in v (relativistic, gyroscopic, driven) this is the route.
///
/// ```
/// use lagrange::{Lagrangian, Scalar, equations::reference::equations};
///
/// struct Mass;
/// impl Lagrangian for Mass {
///     fn dof(&self) -> usize { 1 }
///     fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D { v[0] * v[0] * 1.5 }
///     fn potential<D: Scalar>(&self, q: &[D]) -> D { q[0] * (3.0 * 9.81) }
/// }
/// let at = equations(&Mass, &[0.2], &[1.0]);
/// assert_eq!(at.mass_matrix[(0, 0)], 3.0);
/// assert_eq!(at.bias_force[0], 3.0 * 9.81);
/// ```
pub fn equations<L: Lagrangian>(lagrangian: &L, q: &[f64], v: &[f64]) -> Equations {
    let p: Vec<f64> = lagrangian.parameters().iter().map(|p| p.nominal).collect();
    equations_with(lagrangian, q, v, &p)
}

/// M = ∂²T/∂v∂v at (q, v) alone, for any T, by n(n+1)/2 hyper-dual evaluations; allocates nothing.
pub(crate) fn mass_matrix<L: Lagrangian>(
    lagrangian: &L,
    (q, v): (&[f64], Option<&[f64]>),
    p: &[f64],
    work: &mut Workspace,
    mass: &mut DMatrix<f64>,
) {
    let at = &mut work.hyper;
    at.set(q, v.unwrap_or(&[]), p);
    if v.is_none() {
        at.v.fill(0.0.into());
    }
    for i in 0..lagrangian.dof() {
        at.v[i].eps1 = 1.0;
        for j in 0..=i {
            at.v[j].eps2 = 1.0;
            let entry = lagrangian.kinetic_with(&at.q, &at.v, &at.p).eps1eps2;
            (mass[(i, j)], mass[(j, i)]) = (entry, entry);
            at.v[j].eps2 = 0.0;
        }
        at.v[i].eps1 = 0.0;
    }
}

/// [`equations`] with the constants `p` in place of the nominal ones.
pub fn equations_with<L: Lagrangian>(lagrangian: &L, q: &[f64], v: &[f64], p: &[f64]) -> Equations {
    let n = lagrangian.dof();
    let constant = |x: &[f64]| -> Vec<HyperDual64> { x.iter().map(|&x| x.into()).collect() };
    let (mut qd, mut vd, pd) = (constant(q), constant(v), constant(p));

    let mut mass_matrix = DMatrix::zeros(n, n);
    let mut gravity_force = DVector::zeros(n);
    let mut bias_force = DVector::zeros(n);
    for i in 0..n {
        vd[i].eps1 = 1.0;
        for j in 0..n {
            vd[j].eps2 = 1.0;
            mass_matrix[(i, j)] = lagrangian.kinetic_with(&qd, &vd, &pd).eps1eps2;
            vd[j].eps2 = 0.0;

            qd[j].eps2 = 1.0;
            bias_force[i] += lagrangian.kinetic_with(&qd, &vd, &pd).eps1eps2 * v[j];
            qd[j].eps2 = 0.0;
        }
        vd[i].eps1 = 0.0;

        qd[i].eps1 = 1.0;
        let by_q_i = lagrangian.kinetic_with(&qd, &vd, &pd).eps1;
        gravity_force[i] = lagrangian.potential_with(&qd, &pd).eps1;
        bias_force[i] += gravity_force[i] - by_q_i;
        qd[i].eps1 = 0.0;
    }
    Equations {
        mass_matrix,
        gravity_force,
        bias_force,
    }
}
