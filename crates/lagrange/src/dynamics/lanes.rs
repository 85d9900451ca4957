//! Eight states at once: joint by joint or by programs, in lanes; by dual numbers one after the other.

use nalgebra::DVector;

use super::Dynamics;
use crate::equations::eight::{Eight, product};
use crate::equations::{Workspace, one_by_one};
use crate::trace::{Arguments, Quantity};
use crate::tree::{Algorithms, At};
use crate::{Error, LANES, Lagrangian, Mechanics};
use crate::{ForwardDynamicsDerivatives, ForwardDynamicsGradient};
use crate::{InverseDynamicsDerivatives, InverseDynamicsGradient};

/// One vector of eight states, or a matrix column after column.
type Lane = [f64; LANES];

impl<L: Lagrangian> Dynamics<L> {
    /// A quantity by its program, where that is the route to it; whether it is.
    pub(super) fn program_lanes<'a>(
        &self,
        quantity: Quantity,
        at: Arguments<Lane>,
        eight: &mut Eight,
        slots: impl Iterator<Item = &'a mut Lane>,
    ) -> bool {
        let Some(programs) = self.program(quantity) else {
            return false;
        };
        programs.lanes(
            quantity,
            at,
            eight.factor.processor,
            &mut eight.registers,
            slots,
        );
        true
    }

    /// v̇ in place of Q by a dense factor of M, which is left in `eight`: by programs, or where a joint follows another.
    fn forward_dynamics_dense(
        &self,
        (q, v): (&[Lane], &[Lane]),
        p: &[f64],
        work: &mut Workspace,
        eight: &mut Eight,
        out: &mut [Lane],
    ) {
        eight.grow(self.nv());
        let mut mass = std::mem::take(&mut eight.factor.entries);
        let mut bias = std::mem::take(&mut eight.force);
        let slots = mass.iter_mut().chain(&mut bias);
        let at = Arguments { q, v, p, a: &[] };
        if !self.program_lanes(Quantity::Equations, at, eight, slots) {
            self.mass_matrix_lanes_into(q, p, work, &mut mass);
            self.bias_force_lanes_into(q, v, p, work, &mut bias);
        }
        for (out, bias) in out.iter_mut().zip(&bias) {
            for (out, bias) in out.iter_mut().zip(bias) {
                *out -= bias;
            }
        }
        (eight.factor.entries, eight.force) = (mass, bias);
        eight.factor.factorise();
        eight.factor.solve(out);
    }

    /// Whether there is a way in lanes at all.
    fn has_lanes(&self) -> bool {
        self.by_joints || self.programs.is_some()
    }

    /// An error for the first state without an acceleration.
    fn accelerated(
        &self,
        (q, v): (&[Lane], &[Lane]),
        p: &[f64],
        work: &mut Workspace,
        a: &[Lane],
    ) -> Result<(), Error> {
        let Some(lane) = (0..LANES).find(|&k| a.iter().any(|a| !a[k].is_finite())) else {
            return Ok(());
        };
        let of = |x: &[Lane]| -> Vec<f64> { x.iter().map(|x| x[lane]).collect() };
        Err(self.no_acceleration(&of(q), &of(v), p, work))
    }

    pub(super) fn forward_lanes(
        &self,
        (q, v): (&[Lane], &[Lane]),
        p: &[f64],
        work: &mut Workspace,
        out: &mut [Lane],
    ) -> Result<(), Error> {
        if let Some((engine, machine)) = self.forward_by_joints(None, work) {
            engine.forward_dynamics(At { q, v, p }, machine, out);
        } else if self.has_lanes() {
            let mut eight = std::mem::take(&mut work.eight);
            self.forward_dynamics_dense((q, v), p, work, &mut eight, out);
            work.eight = eight;
        } else {
            return one_by_one::forward_dynamics(self, (q, v), p, work, out);
        }
        self.accelerated((q, v), p, work, out)
    }

    pub(super) fn inverse_derivatives_lanes(
        &self,
        (q, v, a): (&[Lane], &[Lane], &[Lane]),
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        out: &mut InverseDynamicsDerivatives<Lane>,
    ) {
        let (n, square) = (self.nv(), self.nv() * self.nv());
        if self.program(Quantity::Derivatives).is_some() {
            let by_p = self.derivative_columns((q, v, a), p, &mut work.eight);
            let (by_q, by_v) = (&by_p[..square], &by_p[square..2 * square]);
            out.by_q.as_mut_slice().copy_from_slice(by_q);
            out.by_v.as_mut_slice().copy_from_slice(by_v);
            for (column, &constant) in constants.iter().enumerate() {
                let from = &by_p[2 * square + constant * n..][..n];
                let to = &mut out.by_p.as_mut_slice()[column * n..(column + 1) * n];
                to.copy_from_slice(from);
            }
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.inverse_derivatives(At { q, v, p }, a, constants, machine, out);
        } else {
            one_by_one::inverse_derivatives(self, (q, v, a), p, constants, work, out);
        }
    }

    /// ∂Q/∂q, ∂Q/∂v and ∂Q/∂p by the program.
    fn derivative_columns<'a>(
        &self,
        (q, v, a): (&[Lane], &[Lane], &[Lane]),
        p: &[f64],
        eight: &'a mut Eight,
    ) -> &'a [Lane] {
        let n = self.nv();
        let mut columns = std::mem::take(&mut eight.derivatives);
        columns.resize((2 * n + p.len()) * n, [0.0; LANES]);
        let at = Arguments { q, v, a, p };
        self.program_lanes(Quantity::Derivatives, at, eight, columns.iter_mut());
        eight.derivatives = columns;
        &eight.derivatives
    }

    pub(super) fn forward_derivatives_lanes(
        &self,
        (q, v, force): (&[Lane], &[Lane], &[Lane]),
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        out: &mut ForwardDynamicsDerivatives<Lane>,
    ) -> Result<(), Error> {
        if !self.has_lanes() {
            let at = (q, v, force);
            return one_by_one::forward_derivatives(self, at, p, constants, work, out);
        }
        out.acceleration.as_mut_slice().copy_from_slice(force);
        if let Some((engine, machine)) = self.forward_by_joints(Some(Quantity::Derivatives), work) {
            engine.forward_derivatives_lanes(At { q, v, p }, constants, machine, out);
            return self.accelerated((q, v), p, work, out.acceleration.as_slice());
        }
        let mut eight = std::mem::take(&mut work.eight);
        let a = out.acceleration.as_mut_slice();
        self.forward_dynamics_dense((q, v), p, work, &mut eight, a);
        // The derivatives need the registers, and leave the factor alone.
        work.eight = eight;
        // The same matrices take the derivatives of the inverse dynamics, and then M⁻¹ of them.
        let mut inverse = InverseDynamicsDerivatives {
            by_q: std::mem::take(&mut out.by_q),
            by_v: std::mem::take(&mut out.by_v),
            by_p: std::mem::take(&mut out.by_p),
        };
        let a = out.acceleration.as_slice();
        self.inverse_derivatives_lanes((q, v, a), p, constants, work, &mut inverse);
        let InverseDynamicsDerivatives { by_q, by_v, by_p } = inverse;
        (out.by_q, out.by_v, out.by_p) = (by_q, by_v, by_p);
        for by in [&mut out.by_q, &mut out.by_v, &mut out.by_p] {
            negate(by.as_mut_slice());
            work.eight.factor.solve(by.as_mut_slice());
        }
        out.by_force.fill([0.0; LANES]);
        out.by_force.fill_diagonal([1.0; LANES]);
        work.eight.factor.solve(out.by_force.as_mut_slice());
        self.accelerated((q, v), p, work, out.acceleration.as_slice())
    }

    pub(super) fn inverse_gradient_lanes(
        &self,
        (q, v, a): (&[Lane], &[Lane], &[Lane]),
        p: &[f64],
        weight: &[Lane],
        work: &mut Workspace,
        out: &mut InverseDynamicsGradient<Lane>,
    ) {
        if self.program(Quantity::Derivatives).is_some() {
            let mut mass = std::mem::take(&mut work.lanes_matrix);
            mass.resize(self.nv() * self.nv(), [0.0; LANES]);
            self.mass_matrix_lanes_into(q, p, work, &mut mass);
            let processor = work.eight.factor.processor;
            let by = self.derivative_columns((q, v, a), p, &mut work.eight);
            let square = mass.len();
            let (by_q, by) = by.split_at(square);
            let (by_v, by_p) = by.split_at(square);
            for (to, by) in [
                (&mut out.by_q, by_q),
                (&mut out.by_v, by_v),
                (&mut out.by_a, &mass),
                (&mut out.by_p, by_p),
            ] {
                product(processor, weight, by, to.as_mut_slice());
            }
            work.lanes_matrix = mass;
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.inverse_gradient(At { q, v, p }, a, weight, machine, out);
        } else {
            one_by_one::inverse_gradient(self, (q, v, a), p, weight, work, out);
        }
    }

    pub(super) fn forward_gradient_lanes(
        &self,
        (q, v, force): (&[Lane], &[Lane], &[Lane]),
        p: &[f64],
        weight: &[Lane],
        work: &mut Workspace,
        out: &mut ForwardDynamicsGradient<Lane>,
    ) -> Result<(), Error> {
        if !self.has_lanes() {
            return one_by_one::forward_gradient(self, (q, v, force), p, weight, work, out);
        }
        out.acceleration.as_mut_slice().copy_from_slice(force);
        if let Some((engine, machine)) = self.forward_by_joints(Some(Quantity::Derivatives), work) {
            engine.forward_gradient(At { q, v, p }, weight, machine, out);
            return self.accelerated((q, v), p, work, out.acceleration.as_slice());
        }
        let mut eight = std::mem::take(&mut work.eight);
        let a = out.acceleration.as_mut_slice();
        self.forward_dynamics_dense((q, v), p, work, &mut eight, a);
        // wᵀ ∂v̇/∂x = −λᵀ ∂Q/∂x at fixed v̇ and wᵀ ∂v̇/∂Q = λᵀ, with λ = M⁻¹ w.
        out.by_force.as_mut_slice().copy_from_slice(weight);
        eight.factor.solve(out.by_force.as_mut_slice());
        work.eight = eight;
        let mut inverse = InverseDynamicsGradient {
            by_q: std::mem::take(&mut out.by_q),
            by_v: std::mem::take(&mut out.by_v),
            by_a: std::mem::take(&mut work.lanes_vector),
            by_p: std::mem::take(&mut out.by_p),
        };
        if inverse.by_a.len() != self.nv() {
            inverse.by_a = DVector::from_element(self.nv(), [0.0; LANES]);
        }
        let (a, weight) = (out.acceleration.as_slice(), out.by_force.as_slice());
        self.inverse_gradient_lanes((q, v, a), p, weight, work, &mut inverse);
        work.lanes_vector = inverse.by_a;
        (out.by_q, out.by_v, out.by_p) = (inverse.by_q, inverse.by_v, inverse.by_p);
        for by in [&mut out.by_q, &mut out.by_v, &mut out.by_p] {
            negate(by.as_mut_slice());
        }
        self.accelerated((q, v), p, work, out.acceleration.as_slice())
    }
}

fn negate(x: &mut [Lane]) {
    for x in x.as_flattened_mut() {
        *x = -*x;
    }
}
