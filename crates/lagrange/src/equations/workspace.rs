//! The memory in which equations are evaluated.

use nalgebra::{DMatrix, DVector};
use num_dual::{Dual64, HyperDual64, HyperHyperDual64};

use crate::Scalar;
use crate::constraint::Room;
use crate::trace::Registers;

/// Scratch memory of one mechanism for one thread. Make it with [`Mechanics::workspace`](crate::Mechanics::workspace).
#[derive(Debug, Clone)]
pub struct Workspace {
    pub(crate) real: Lifted<f64>,
    pub(crate) dual: Lifted<Dual64>,
    pub(crate) hyper: Lifted<HyperDual64>,
    pub(crate) third: Lifted<HyperHyperDual64>,
    pub(crate) mass: DMatrix<f64>,
    pub(crate) force: DVector<f64>,
    /// T(q, e_i), the diagonal terms of the polarisation.
    pub(crate) diagonal: Vec<f64>,
    /// ∂M/∂q_k, one matrix a coordinate.
    pub(crate) mass_by_q: Vec<DMatrix<f64>>,
    /// Of the compiled programs, where there are some.
    pub(crate) registers: Registers,
    /// Of the constraints, where there are some.
    pub(crate) constraint: Room,
}

/// The arguments of the energies on one number type.
#[derive(Debug, Clone)]
pub(crate) struct Lifted<D> {
    pub q: Vec<D>,
    pub v: Vec<D>,
    pub p: Vec<D>,
}

impl<D: Scalar> Lifted<D> {
    fn new(nv: usize, np: usize) -> Self {
        Lifted {
            q: vec![D::zero(); nv],
            v: vec![D::zero(); nv],
            p: vec![D::zero(); np],
        }
    }

    /// All three as constants.
    pub fn set(&mut self, q: &[f64], v: &[f64], p: &[f64]) {
        let pairs = [(&mut self.q, q), (&mut self.v, v), (&mut self.p, p)];
        for (to, from) in pairs {
            for (d, &x) in to.iter_mut().zip(from) {
                *d = D::constant(x);
            }
        }
    }
}

impl Workspace {
    pub(crate) fn new(nv: usize, np: usize, registers: Registers) -> Self {
        Workspace {
            real: Lifted::new(nv, np),
            dual: Lifted::new(nv, np),
            hyper: Lifted::new(nv, np),
            third: Lifted::new(nv, np),
            mass: DMatrix::zeros(nv, nv),
            force: DVector::zeros(nv),
            diagonal: vec![0.0; nv],
            mass_by_q: vec![DMatrix::zeros(nv, nv); nv],
            registers,
            constraint: Room::default(),
        }
    }

    /// Solves M x = `rhs` in place, column by column, with the M of the last successful
    /// [`forward_dynamics_into`](crate::Mechanics::forward_dynamics_into).
    pub fn solve_mass(&self, rhs: &mut DMatrix<f64>) {
        // The factor L of M = L Lᵀ; its diagonal is positive, so both solves succeed.
        self.mass.solve_lower_triangular_mut(rhs);
        self.mass.tr_solve_lower_triangular_mut(rhs);
    }
}
