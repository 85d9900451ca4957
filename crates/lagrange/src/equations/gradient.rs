//! Products of a row of weights with the derivatives of the dynamics: what reverse-mode differentiation asks for.

use nalgebra::{DMatrix, DVector};

use super::Workspace;
use super::derivatives::{ForwardDynamicsDerivatives, InverseDynamicsDerivatives};
use crate::{Error, LANES, Mechanics};

/// λᵀ ∂Q/∂x of the inverse dynamics Q(q, v, v̇; p), for one row λ. Entries are numbers, or `[f64; LANES]` for eight states with a row
/// each: lane k is state k.
#[derive(Debug, Clone, PartialEq)]
pub struct InverseDynamicsGradient<T = f64> {
    /// λᵀ ∂Q/∂q, nv entries; along the velocities where a joint floats.
    pub by_q: DVector<T>,
    /// λᵀ ∂Q/∂v, nv entries.
    pub by_v: DVector<T>,
    /// λᵀ ∂Q/∂v̇ = (M λ)ᵀ, nv entries.
    pub by_a: DVector<T>,
    /// λᵀ ∂Q/∂p, for all constants.
    pub by_p: DVector<T>,
}

impl InverseDynamicsGradient {
    /// Zeros, for `nv` degrees of freedom and `np` constants.
    pub fn zeros(nv: usize, np: usize) -> Self {
        Self::filled(nv, np, 0.0)
    }
}

impl InverseDynamicsGradient<[f64; LANES]> {
    /// Zeros for eight states.
    pub fn lanes(nv: usize, np: usize) -> Self {
        Self::filled(nv, np, [0.0; LANES])
    }
}

impl<T: nalgebra::Scalar> InverseDynamicsGradient<T> {
    fn filled(nv: usize, np: usize, zero: T) -> Self {
        InverseDynamicsGradient {
            by_q: DVector::from_element(nv, zero.clone()),
            by_v: DVector::from_element(nv, zero.clone()),
            by_a: DVector::from_element(nv, zero.clone()),
            by_p: DVector::from_element(np, zero.clone()),
        }
    }
}

/// The acceleration v̇(q, v, Q; p), and wᵀ ∂v̇/∂x for one row w. Entries are numbers, or `[f64; LANES]` for eight states with a row
/// each: lane k is state k.
#[derive(Debug, Clone, PartialEq)]
pub struct ForwardDynamicsGradient<T = f64> {
    /// v̇.
    pub acceleration: DVector<T>,
    /// wᵀ ∂v̇/∂q, nv entries; along the velocities where a joint floats.
    pub by_q: DVector<T>,
    /// wᵀ ∂v̇/∂v, nv entries.
    pub by_v: DVector<T>,
    /// wᵀ ∂v̇/∂Q, nv entries: M⁻¹ w where nothing is constrained.
    pub by_force: DVector<T>,
    /// wᵀ ∂v̇/∂p, for all constants.
    pub by_p: DVector<T>,
}

impl ForwardDynamicsGradient {
    /// Zeros, for `nv` degrees of freedom and `np` constants.
    pub fn zeros(nv: usize, np: usize) -> Self {
        Self::filled(nv, np, 0.0)
    }
}

impl ForwardDynamicsGradient<[f64; LANES]> {
    /// Zeros for eight states.
    pub fn lanes(nv: usize, np: usize) -> Self {
        Self::filled(nv, np, [0.0; LANES])
    }
}

impl<T: nalgebra::Scalar> ForwardDynamicsGradient<T> {
    fn filled(nv: usize, np: usize, zero: T) -> Self {
        ForwardDynamicsGradient {
            acceleration: DVector::from_element(nv, zero.clone()),
            by_q: DVector::from_element(nv, zero.clone()),
            by_v: DVector::from_element(nv, zero.clone()),
            by_force: DVector::from_element(nv, zero.clone()),
            by_p: DVector::from_element(np, zero.clone()),
        }
    }
}

impl ForwardDynamicsGradient {
    /// From the derivatives themselves.
    pub(crate) fn collect(&mut self, by: &ForwardDynamicsDerivatives, weight: &[f64]) {
        self.acceleration.copy_from(&by.acceleration);
        for (to, by) in [
            (&mut self.by_q, &by.by_q),
            (&mut self.by_v, &by.by_v),
            (&mut self.by_force, &by.by_force),
            (&mut self.by_p, &by.by_p),
        ] {
            product(to, by, weight);
        }
    }
}

impl InverseDynamicsGradient {
    /// From the derivatives themselves and M.
    pub(crate) fn collect(
        &mut self,
        by: &InverseDynamicsDerivatives,
        mass: &DMatrix<f64>,
        weight: &[f64],
    ) {
        for (to, by) in [
            (&mut self.by_q, &by.by_q),
            (&mut self.by_v, &by.by_v),
            (&mut self.by_a, mass),
            (&mut self.by_p, &by.by_p),
        ] {
            product(to, by, weight);
        }
    }
}

/// wᵀ A.
fn product(to: &mut DVector<f64>, by: &DMatrix<f64>, weight: &[f64]) {
    for (to, column) in to.iter_mut().zip(by.column_iter()) {
        *to = column.iter().zip(weight).map(|(x, w)| x * w).sum();
    }
}

/// As a product with the derivatives.
pub(crate) fn of_inverse_dynamics<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, a): (&[f64], &[f64], &[f64]),
    p: &[f64],
    weight: &[f64],
    work: &mut Workspace,
    out: &mut InverseDynamicsGradient,
) {
    let mut by = work.take_derivatives(mechanics.nv(), p.len());
    let mut mass = std::mem::take(&mut work.lane_matrix);
    mechanics.inverse_dynamics_derivatives_into(q, v, a, p, &by.all, work, &mut by.inverse);
    mechanics.mass_matrix_into(q, p, work, &mut mass);
    out.collect(&by.inverse, &mass, weight);
    work.lane_matrix = mass;
    work.derivatives = Some(by);
}

/// As a product with the derivatives.
pub(crate) fn of_forward_dynamics<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, force): (&[f64], &[f64], &[f64]),
    p: &[f64],
    weight: &[f64],
    work: &mut Workspace,
    out: &mut ForwardDynamicsGradient,
) -> Result<(), Error> {
    let mut by = work.take_derivatives(mechanics.nv(), p.len());
    let all = &by.all;
    let done =
        mechanics.forward_dynamics_derivatives_into(q, v, force, p, all, work, &mut by.forward);
    out.collect(&by.forward, weight);
    work.derivatives = Some(by);
    done
}
