//! The memory in which equations are evaluated.

use nalgebra::{DMatrix, DVector};
use num_dual::{Dual64, HyperDual64, HyperHyperDual64};

use super::eight::Eight;
use crate::constraint::Room;
use crate::trace::Registers;
use crate::tree::Machine;
use crate::{ForwardDynamicsDerivatives, InverseDynamicsDerivatives, LANES, Scalar};
use crate::{ForwardDynamicsGradient, InverseDynamicsGradient};

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
    /// Of the algorithms for trees, where the mechanism is one.
    pub(crate) machine: Option<Machine>,
    /// One of many states.
    pub(crate) lane: Lane,
    pub(crate) lane_matrix: DMatrix<f64>,
    /// Of which gradients are products, where they are not found without; made when first asked for.
    pub(crate) derivatives: Option<Box<Derivatives>>,
    /// Of one of many states; made when first asked for.
    pub(crate) gradients: Option<Box<Gradients>>,
    /// Of many states whose equations are programs or dense.
    pub(crate) eight: Eight,
    pub(crate) lanes_matrix: Vec<[f64; LANES]>,
    pub(crate) lanes_vector: DVector<[f64; LANES]>,
}

#[derive(Debug, Clone)]
pub(crate) struct Gradients {
    pub forward: ForwardDynamicsGradient,
    pub inverse: InverseDynamicsGradient,
    /// The row, nv entries.
    pub weight: Vec<f64>,
}

#[derive(Debug, Clone)]
pub(crate) struct Derivatives {
    pub forward: ForwardDynamicsDerivatives,
    pub inverse: InverseDynamicsDerivatives,
    /// The indices of all constants.
    pub all: Vec<usize>,
}

/// One state of several that are evaluated in a row, and what comes out.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lane {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub a: Vec<f64>,
    pub out: DVector<f64>,
}

impl Lane {
    pub fn load(
        &mut self,
        lane: usize,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        a: &[[f64; LANES]],
    ) {
        for (to, from) in [(&mut self.q, q), (&mut self.v, v), (&mut self.a, a)] {
            for (to, from) in to.iter_mut().zip(from) {
                *to = from[lane];
            }
        }
    }

    pub fn store(&self, lane: usize, out: &mut [[f64; LANES]]) {
        for (to, from) in out.iter_mut().zip(&self.out) {
            to[lane] = *from;
        }
    }
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
    pub(crate) fn new(
        (nq, nv, np): (usize, usize, usize),
        registers: Registers,
        machine: Option<Machine>,
    ) -> Self {
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
            machine,
            lane: Lane {
                q: vec![0.0; nq],
                v: vec![0.0; nv],
                a: vec![0.0; nv],
                out: DVector::zeros(nv),
            },
            lane_matrix: DMatrix::zeros(nv, nv),
            derivatives: None,
            gradients: None,
            eight: Eight::default(),
            lanes_matrix: Vec::new(),
            lanes_vector: DVector::default(),
        }
    }

    /// Taken out, to be put back.
    pub(crate) fn take_gradients(&mut self, nv: usize, np: usize) -> Box<Gradients> {
        self.gradients.take().unwrap_or_else(|| {
            Box::new(Gradients {
                forward: ForwardDynamicsGradient::zeros(nv, np),
                inverse: InverseDynamicsGradient::zeros(nv, np),
                weight: vec![0.0; nv],
            })
        })
    }

    /// Taken out, to be put back.
    pub(crate) fn take_derivatives(&mut self, nv: usize, np: usize) -> Box<Derivatives> {
        self.derivatives.take().unwrap_or_else(|| {
            Box::new(Derivatives {
                forward: ForwardDynamicsDerivatives::zeros(nv, np),
                inverse: InverseDynamicsDerivatives::zeros(nv, np),
                all: (0..np).collect(),
            })
        })
    }

    /// Solves M x = `rhs` in place, column by column, with the factor L of M = L Lᵀ in `mass`.
    pub(crate) fn solve_mass(&self, rhs: &mut DMatrix<f64>) {
        // The diagonal is positive, so both solves succeed.
        self.mass.solve_lower_triangular_mut(rhs);
        self.mass.tr_solve_lower_triangular_mut(rhs);
    }
}
