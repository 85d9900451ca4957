//! Derivatives of v̇ where effects change the mechanics.

use lagrange::{Error, ForwardDynamicsDerivatives, ForwardDynamicsGradient, Mechanics, Workspace};
use nalgebra::{DMatrix, DVector};

use super::{Extra, ExtraMemory, Rotor};
use crate::hybrid::State;

impl Extra {
    /// v̇ under Q = `force` and its derivatives as [`Mechanics::forward_dynamics_derivatives_into`], and ∂ID/∂p in `memory.by_slot`.
    #[allow(clippy::too_many_arguments)]
    pub fn derivatives(
        &self,
        (mechanics, constants): (&dyn Mechanics, &[f64]),
        state: State<'_>,
        theta: &[f64],
        force: &DVector<f64>,
        selected: &[usize],
        work: &mut Workspace,
        memory: &mut ExtraMemory,
        out: &mut ForwardDynamicsDerivatives,
    ) -> Result<(), Error> {
        out.acceleration.copy_from(force);
        let whole = (mechanics, constants);
        let factor = self.solve(whole, state, theta, work, memory, &mut out.acceleration)?;
        out.by_force.fill_with_identity();
        factor.solve_mut(&mut out.by_force);
        let (State { q, v, .. }, a) = (state, out.acceleration.as_slice());
        let ExtraMemory {
            works,
            p,
            masses,
            zeros,
            part,
            added,
            derivatives: sum,
            of_terms,
            by_slot,
            ..
        } = memory;
        mechanics.inverse_dynamics_derivatives_into(q, v, a, constants, selected, work, sum);
        by_slot.fill(0.0);
        for ((term, work), by) in self.terms.iter().zip(works).zip(of_terms) {
            let (constants, selected) = match term.of_points {
                true => (masses.as_slice(), added.as_slice()),
                false => (constants, selected),
            };
            let (v, a) = match term.factor.is_weight() {
                true => (zeros.as_slice(), zeros.as_slice()),
                false => (v, a),
            };
            let own = &term.mechanics;
            own.inverse_dynamics_derivatives_into(q, v, a, constants, selected, work, by);
            let (factor, derivative) = term.factor.at(p);
            add_scaled(&mut sum.by_q, factor, &by.by_q);
            if !term.factor.is_weight() {
                add_scaled(&mut sum.by_v, factor, &by.by_v);
            }
            match term.of_points {
                false => add_scaled(&mut sum.by_p, factor, &by.by_p),
                true => {
                    for (k, &(_, slot)) in self.points.iter().enumerate() {
                        by_slot
                            .column_mut(slot)
                            .axpy(factor, &by.by_p.column(k), 1.0);
                    }
                }
            }
            if let Some((slot, derivative)) = derivative {
                own.gravity_force_into(q, constants, work, part);
                by_slot.column_mut(slot).axpy(derivative, part, 1.0);
            }
        }
        for &Rotor { v, slot, sign } in &self.rotors {
            by_slot[(v, slot)] += sign * a[v];
        }
        for (to, from) in [
            (&mut out.by_q, &sum.by_q),
            (&mut out.by_v, &sum.by_v),
            (&mut out.by_p, &sum.by_p),
        ] {
            to.copy_from(from);
            factor.solve_mut(to);
            to.neg_mut();
        }
        memory.mass = factor.unpack_dirty();
        Ok(())
    }

    /// v̇ under Q = `force` and wᵀ ∂v̇/∂x as [`Mechanics::forward_dynamics_gradient_into`], and with λ = M⁻¹ w the row λᵀ ∂ID/∂p in
    /// `memory.of_slots`.
    #[allow(clippy::too_many_arguments)]
    pub fn gradient(
        &self,
        (mechanics, constants): (&dyn Mechanics, &[f64]),
        state: State<'_>,
        theta: &[f64],
        force: &DVector<f64>,
        weight: &[f64],
        work: &mut Workspace,
        memory: &mut ExtraMemory,
        out: &mut ForwardDynamicsGradient,
    ) -> Result<(), Error> {
        out.acceleration.copy_from(force);
        let whole = (mechanics, constants);
        let factor = self.solve(whole, state, theta, work, memory, &mut out.acceleration)?;
        out.by_force.as_mut_slice().copy_from_slice(weight);
        factor.solve_mut(&mut out.by_force);
        memory.mass = factor.unpack_dirty();
        let (State { q, v, .. }, a) = (state, out.acceleration.as_slice());
        let lambda = out.by_force.as_slice();
        let ExtraMemory {
            works,
            p,
            masses,
            zeros,
            part,
            gradient: base,
            gradients,
            of_slots,
            ..
        } = memory;
        mechanics.inverse_dynamics_gradient_into(q, v, a, constants, lambda, work, base);
        for (to, from) in [
            (&mut out.by_q, &base.by_q),
            (&mut out.by_v, &base.by_v),
            (&mut out.by_p, &base.by_p),
        ] {
            to.copy_from(from);
            to.neg_mut();
        }
        of_slots.fill(0.0);
        for ((term, work), by) in self.terms.iter().zip(works).zip(gradients) {
            let constants = match term.of_points {
                true => masses.as_slice(),
                false => constants,
            };
            let (v, a) = match term.factor.is_weight() {
                true => (zeros.as_slice(), zeros.as_slice()),
                false => (v, a),
            };
            let own = &term.mechanics;
            own.inverse_dynamics_gradient_into(q, v, a, constants, lambda, work, by);
            let (factor, derivative) = term.factor.at(p);
            out.by_q.axpy(-factor, &by.by_q, 1.0);
            if !term.factor.is_weight() {
                out.by_v.axpy(-factor, &by.by_v, 1.0);
            }
            match term.of_points {
                false => out.by_p.axpy(-factor, &by.by_p, 1.0),
                true => {
                    for &(body, slot) in &self.points {
                        of_slots[slot] += factor * by.by_p[body];
                    }
                }
            }
            if let Some((slot, derivative)) = derivative {
                own.gravity_force_into(q, constants, work, part);
                let along: f64 = part.iter().zip(lambda).map(|(g, l)| g * l).sum();
                of_slots[slot] += derivative * along;
            }
        }
        for &Rotor { v, slot, sign } in &self.rotors {
            of_slots[slot] += sign * lambda[v] * a[v];
        }
        Ok(())
    }
}

/// to += factor · from.
fn add_scaled(to: &mut DMatrix<f64>, factor: f64, from: &DMatrix<f64>) {
    for (to, from) in to.iter_mut().zip(from.iter()) {
        *to += factor * from;
    }
}
