//! Momenta, and how they change, where effects change the mechanics.

use lagrange::{Error, Mechanics, Workspace};

use super::{Extra, ExtraMemory, Number, singular};
use crate::motion::{Momenta, Positions};

impl Extra {
    /// Adds to ∂T/∂v = M v in `out`.
    pub fn add_momentum(
        &self,
        (q, v): (&[f64], &[f64]),
        theta: &[f64],
        memory: &mut ExtraMemory,
        out: &mut [f64],
    ) {
        self.load(theta, memory);
        let mut mass = std::mem::take(&mut memory.mass);
        mass.fill(0.0);
        self.add_mass(q, memory, &mut mass);
        for (out, column) in out.iter_mut().zip(mass.column_iter()) {
            *out += column.iter().zip(v).map(|(m, v)| m * v).sum::<f64>();
        }
        memory.mass = mass;
    }

    /// M⁻¹ of what `out` holds.
    pub fn velocity(
        &self,
        mechanics: (&dyn Mechanics, &[f64]),
        q: &[f64],
        theta: &[f64],
        work: &mut Workspace,
        memory: &mut ExtraMemory,
        out: &mut [f64],
    ) -> Result<(), Error> {
        self.factorise(mechanics, q, theta, work, memory);
        if memory.factor.is_none() {
            return Err(singular(mechanics.0.coordinates(), q, &memory.mass));
        }
        f64::solve(&memory.factor, out);
        Ok(())
    }

    /// Adds to ∂L/∂q in `out`.
    #[allow(clippy::too_many_arguments)]
    pub fn add_position_force(
        &self,
        positions: &Positions,
        (q, v): (&[f64], &[f64]),
        (theta, constants): (&[f64], &[f64]),
        momenta: &mut Momenta,
        memory: &mut ExtraMemory,
        out: &mut [f64],
    ) {
        self.load(theta, memory);
        for (term, work) in self.terms.iter().zip(&mut memory.works) {
            let p = term.family.map_or(constants, |f| &memory.masses[f]);
            let (part, row) = (&mut memory.part, &mut memory.bias);
            if term.factor.is_weight() {
                term.mechanics.gravity_force_into(q, p, work, part);
                let factor = term.factor.at(&memory.p).0;
                for (out, g) in out.iter_mut().zip(part.iter()) {
                    *out -= factor * g;
                }
            } else {
                row.fill(0.0);
                momenta.position_force(
                    &*term.mechanics,
                    positions,
                    (q, v),
                    p,
                    work,
                    row.as_mut_slice(),
                );
                for (out, x) in out.iter_mut().zip(row.iter()) {
                    *out += x;
                }
            }
        }
    }
}
