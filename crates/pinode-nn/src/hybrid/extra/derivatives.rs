//! Derivatives of v̇ where effects change the mechanics.

use lagrange::{Error, ForwardDynamicsDerivatives, ForwardDynamicsGradient};
use lagrange::{InverseDynamicsGradient, Mechanics, Workspace};

use super::{Extra, ExtraMemory, Number, Rotor, Term, add_scaled};
use crate::hybrid::State;

/// What a [gradient](Extra::gradient) needs beside [`ExtraMemory`].
pub(in crate::hybrid) struct RowMemory {
    whole: InverseDynamicsGradient,
    of_terms: Vec<InverseDynamicsGradient>,
    /// λᵀ ∂ID/∂p of the last gradient.
    pub of_slots: Vec<f64>,
}

impl Extra {
    /// For `nv` velocities and `np` constants of the mechanics.
    pub fn row_memory(&self, nv: usize, np: usize) -> RowMemory {
        let of = |term: &Term| match term.family {
            Some(_) => InverseDynamicsGradient::zeros(nv, self.bodies),
            None => InverseDynamicsGradient::zeros(nv, np),
        };
        RowMemory {
            whole: InverseDynamicsGradient::zeros(nv, np),
            of_terms: self.terms.iter().map(of).collect(),
            of_slots: vec![0.0; self.parameters.len()],
        }
    }

    /// v̇ under Q = `force` and its derivatives as [`Mechanics::forward_dynamics_derivatives_into`], and ∂ID/∂p in `memory.by_slot`.
    #[allow(clippy::too_many_arguments)]
    pub fn derivatives<T: Number>(
        &self,
        (mechanics, constants): (&dyn Mechanics, &[f64]),
        (q, v): (&[T], &[T]),
        theta: &[f64],
        force: &[T],
        selected: &[usize],
        work: &mut Workspace,
        memory: &mut ExtraMemory<T>,
        out: &mut ForwardDynamicsDerivatives<T>,
    ) -> Result<(), Error> {
        let (zero, one) = (T::constant(0.0), T::constant(1.0));
        let a = out.acceleration.as_mut_slice();
        a.copy_from_slice(force);
        let whole = (mechanics, constants);
        self.forward_dynamics(whole, (q, v), theta, work, memory, a)?;
        let a = out.acceleration.as_slice();
        let ExtraMemory {
            works,
            p,
            masses,
            zeros,
            factor: factor_of_mass,
            part,
            derivatives: sum,
            of_terms,
            by_slot,
            ..
        } = memory;
        out.by_force.fill(zero);
        out.by_force.fill_diagonal(one);
        T::solve(factor_of_mass, out.by_force.as_mut_slice());
        T::inverse_dynamics_derivatives(mechanics, (q, v, a), constants, selected, work, sum);
        by_slot.fill(zero);
        for ((term, work), by) in self.terms.iter().zip(works).zip(of_terms) {
            let (constants, selected) = match term.family {
                Some(family) => (masses[family].as_slice(), self.loaded.as_slice()),
                None => (constants, selected),
            };
            let (v, a) = match term.factor.is_weight() {
                true => (zeros.as_slice(), zeros.as_slice()),
                false => (v, a),
            };
            let own = &*term.mechanics;
            T::inverse_dynamics_derivatives(own, (q, v, a), constants, selected, work, by);
            let (factor, derivative) = term.factor.at(p);
            add_scaled(&mut sum.by_q, factor, &by.by_q);
            if !term.factor.is_weight() {
                add_scaled(&mut sum.by_v, factor, &by.by_v);
            }
            match term.family {
                None => add_scaled(&mut sum.by_p, factor, &by.by_p),
                Some(family) => {
                    for point in &self.points {
                        for (slot, slope) in point.in_family(family, p).1 {
                            let mut to = by_slot.column_mut(slot);
                            let from = by.by_p.column(point.column);
                            add_scaled(to.iter_mut(), factor * slope, from.iter());
                        }
                    }
                }
            }
            if let Some((slot, derivative)) = derivative {
                T::gravity_force(own, q, constants, work, part);
                let mut to = by_slot.column_mut(slot);
                add_scaled(to.iter_mut(), derivative, part.iter());
            }
        }
        for &Rotor { v, slot, sign } in &self.rotors {
            let to = &mut by_slot[(v, slot)];
            *to = to.plus(sign, a[v]);
        }
        for (to, from) in [
            (&mut out.by_q, &sum.by_q),
            (&mut out.by_v, &sum.by_v),
            (&mut out.by_p, &sum.by_p),
        ] {
            to.fill(zero);
            add_scaled(to.iter_mut(), -1.0, from.iter());
            T::solve(factor_of_mass, to.as_mut_slice());
        }
        Ok(())
    }

    /// v̇ under Q = `force` and wᵀ ∂v̇/∂x as [`Mechanics::forward_dynamics_gradient_into`], and with λ = M⁻¹ w the row λᵀ ∂ID/∂p in
    /// `rows.of_slots`.
    #[allow(clippy::too_many_arguments)]
    pub fn gradient(
        &self,
        (mechanics, constants): (&dyn Mechanics, &[f64]),
        state: State<'_>,
        theta: &[f64],
        force: &[f64],
        weight: &[f64],
        work: &mut Workspace,
        (memory, rows): (&mut ExtraMemory, &mut RowMemory),
        out: &mut ForwardDynamicsGradient,
    ) -> Result<(), Error> {
        let State { q, v, .. } = state;
        let a = out.acceleration.as_mut_slice();
        a.copy_from_slice(force);
        let whole = (mechanics, constants);
        self.forward_dynamics(whole, (q, v), theta, work, memory, a)?;
        let a = out.acceleration.as_slice();
        out.by_force.as_mut_slice().copy_from_slice(weight);
        f64::solve(&memory.factor, out.by_force.as_mut_slice());
        let lambda = out.by_force.as_slice();
        let ExtraMemory {
            works,
            p,
            masses,
            zeros,
            part,
            ..
        } = memory;
        let RowMemory {
            whole: base,
            of_terms: gradients,
            of_slots,
        } = rows;
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
            let constants = term.family.map_or(constants, |f| masses[f].as_slice());
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
            match term.family {
                None => out.by_p.axpy(-factor, &by.by_p, 1.0),
                Some(family) => {
                    for point in &self.points {
                        for (slot, slope) in point.in_family(family, p).1 {
                            of_slots[slot] += factor * slope * by.by_p[point.body];
                        }
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
