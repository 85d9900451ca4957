//! What the effects that change the mechanics are summed up in: the number of one state, or of eight at once.

use lagrange::{InverseDynamicsDerivatives, LANES, LaneFactor, Mechanics, Workspace};
use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, DVector, Dyn};

use crate::hybrid::Lane;

/// One number, or one of each of eight states, with the calls of [`Mechanics`] for as many states.
pub(in crate::hybrid) trait Number: nalgebra::Scalar + Copy {
    /// The factor of M, and memory for the next one.
    type Factor;

    /// `x` for every state.
    fn constant(x: f64) -> Self;

    /// self + factor · x.
    fn plus(self, factor: f64, x: Self) -> Self;

    /// Memory for the factor of a matrix of `n` rows.
    fn factor(n: usize) -> Self::Factor;

    /// The factor of M, symmetric.
    fn factorise(mass: &DMatrix<Self>, factor: &mut Self::Factor);

    /// M⁻¹ times each column, in place; no numbers for the states in which M has no factor.
    fn solve(factor: &Self::Factor, columns: &mut [Self]);

    /// The first state with an entry that is no number, or infinite.
    fn lost(x: &[Self]) -> Option<usize>;

    /// The number of one of the states.
    fn of_state(self, state: usize) -> f64;

    /// See [`Mechanics::mass_matrix_into`].
    fn mass_matrix(
        mechanics: &dyn Mechanics,
        q: &[Self],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<Self>,
    );

    /// See [`Mechanics::bias_force_into`].
    fn bias_force(
        mechanics: &dyn Mechanics,
        state: (&[Self], &[Self]),
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<Self>,
    );

    /// See [`Mechanics::gravity_force_into`].
    fn gravity_force(
        mechanics: &dyn Mechanics,
        q: &[Self],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<Self>,
    );

    /// See [`Mechanics::inverse_dynamics_derivatives_into`].
    fn inverse_dynamics_derivatives(
        mechanics: &dyn Mechanics,
        state: (&[Self], &[Self], &[Self]),
        p: &[f64],
        selected: &[usize],
        work: &mut Workspace,
        out: &mut InverseDynamicsDerivatives<Self>,
    );
}

impl Number for f64 {
    /// None where M has none.
    type Factor = Option<Cholesky<f64, Dyn>>;

    fn constant(x: f64) -> Self {
        x
    }

    fn plus(self, factor: f64, x: Self) -> Self {
        self + factor * x
    }

    fn factor(n: usize) -> Self::Factor {
        Cholesky::new(DMatrix::identity(n, n))
    }

    fn factorise(mass: &DMatrix<Self>, factor: &mut Self::Factor) {
        let mut own = match factor.take() {
            Some(last) => last.unpack_dirty(),
            None => mass.clone(),
        };
        own.copy_from(mass);
        *factor = Cholesky::new(own);
    }

    fn solve(factor: &Self::Factor, columns: &mut [Self]) {
        let Some(factor) = factor else {
            return columns.fill(f64::NAN);
        };
        let n = factor.l_dirty().nrows();
        let count = columns.len() / n.max(1);
        factor.solve_mut(&mut DMatrixViewMut::from_slice(columns, n, count));
    }

    fn lost(x: &[Self]) -> Option<usize> {
        (!x.iter().all(|x| x.is_finite())).then_some(0)
    }

    fn of_state(self, _: usize) -> f64 {
        self
    }

    fn mass_matrix(
        mechanics: &dyn Mechanics,
        q: &[Self],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<Self>,
    ) {
        mechanics.mass_matrix_into(q, p, work, out);
    }

    fn bias_force(
        mechanics: &dyn Mechanics,
        (q, v): (&[Self], &[Self]),
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<Self>,
    ) {
        mechanics.bias_force_into(q, v, p, work, out);
    }

    fn gravity_force(
        mechanics: &dyn Mechanics,
        q: &[Self],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<Self>,
    ) {
        mechanics.gravity_force_into(q, p, work, out);
    }

    fn inverse_dynamics_derivatives(
        mechanics: &dyn Mechanics,
        (q, v, a): (&[Self], &[Self], &[Self]),
        p: &[f64],
        selected: &[usize],
        work: &mut Workspace,
        out: &mut InverseDynamicsDerivatives<Self>,
    ) {
        mechanics.inverse_dynamics_derivatives_into(q, v, a, p, selected, work, out);
    }
}

impl Number for Lane {
    type Factor = LaneFactor;

    fn constant(x: f64) -> Self {
        [x; LANES]
    }

    fn plus(mut self, factor: f64, x: Self) -> Self {
        for (to, x) in self.iter_mut().zip(x) {
            *to += factor * x;
        }
        self
    }

    fn factor(n: usize) -> Self::Factor {
        LaneFactor::new(n)
    }

    fn factorise(mass: &DMatrix<Self>, factor: &mut Self::Factor) {
        factor.entries_mut().copy_from_slice(mass.as_slice());
        factor.factorise();
    }

    fn solve(factor: &Self::Factor, columns: &mut [Self]) {
        factor.solve(columns);
    }

    fn lost(x: &[Self]) -> Option<usize> {
        (0..LANES).find(|&lane| x.iter().any(|x| !x[lane].is_finite()))
    }

    fn of_state(self, state: usize) -> f64 {
        self[state]
    }

    fn mass_matrix(
        mechanics: &dyn Mechanics,
        q: &[Self],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<Self>,
    ) {
        mechanics.mass_matrix_lanes_into(q, p, work, out.as_mut_slice());
    }

    fn bias_force(
        mechanics: &dyn Mechanics,
        (q, v): (&[Self], &[Self]),
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<Self>,
    ) {
        mechanics.bias_force_lanes_into(q, v, p, work, out.as_mut_slice());
    }

    fn gravity_force(
        mechanics: &dyn Mechanics,
        q: &[Self],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<Self>,
    ) {
        mechanics.gravity_force_lanes_into(q, p, work, out.as_mut_slice());
    }

    fn inverse_dynamics_derivatives(
        mechanics: &dyn Mechanics,
        (q, v, a): (&[Self], &[Self], &[Self]),
        p: &[f64],
        selected: &[usize],
        work: &mut Workspace,
        out: &mut InverseDynamicsDerivatives<Self>,
    ) {
        mechanics.inverse_dynamics_derivatives_lanes_into(q, v, a, p, selected, work, out);
    }
}

/// to += factor · from, entry by entry.
pub(super) fn add_scaled<'a, T: Number>(
    to: impl IntoIterator<Item = &'a mut T>,
    factor: f64,
    from: impl IntoIterator<Item = &'a T>,
) {
    for (to, from) in to.into_iter().zip(from) {
        *to = to.plus(factor, *from);
    }
}
