//! Derivatives of the constrained forward dynamics.
//!
//! In any variable x, with the residuals R = M v̇ + C v + G − Jᵀ λ − Q and r = φ̈ + 2 ω φ̇ + ω² φ,
//!
//! | M −Jᵀ | | ∂v̇/∂x |     | ∂R/∂x at fixed v̇, λ |
//! | J   0 | | ∂λ/∂x | = − | ∂r/∂x at fixed v̇    |

use nalgebra::DMatrix;

use super::kinematics::{Room, Variable};
use super::{Constrained, Constraint, factor};
use crate::{Error, ForwardDynamicsDerivatives, InverseDynamicsDerivatives, Mechanics, Workspace};

impl<M: Mechanics, C: Constraint> Constrained<M, C> {
    pub(super) fn derivatives(
        &self,
        (q, v, force): (&[f64], &[f64], &[f64]),
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        room: &mut Room,
        out: &mut ForwardDynamicsDerivatives,
    ) -> Result<(), Error> {
        out.acceleration.copy_from_slice(force);
        self.solve((q, v), p, self.rate(), work, room, &mut out.acceleration)?;
        let a = out.acceleration.as_slice();

        let mut inverse = InverseDynamicsDerivatives {
            by_q: std::mem::take(&mut out.by_q),
            by_v: std::mem::take(&mut out.by_v),
            by_p: std::mem::take(&mut out.by_p),
        };
        self.free()
            .inverse_dynamics_derivatives_into(q, v, a, p, constants, work, &mut inverse);
        let InverseDynamicsDerivatives { by_q, by_v, by_p } = inverse;
        (out.by_q, out.by_v, out.by_p) = (by_q, by_v, by_p);
        for by in [&mut out.by_q, &mut out.by_v, &mut out.by_p] {
            by.neg_mut();
        }

        // −∂R/∂x gets + ∂(Jᵀ λ)/∂x; ∂r/∂x goes to `room.by`: q, then v, then the constants.
        let kinematics = self.kinematics();
        let nv = v.len();
        for j in 0..nv {
            let position = Variable::Position(j);
            kinematics.by_variable((q, v, a), p, self.rate(), position, j, room);
            kinematics.add_force_by(q, p, position, j, room, &mut out.by_q);
            let velocity = Variable::Velocity(j);
            kinematics.by_variable((q, v, a), p, self.rate(), velocity, nv + j, room);
        }
        for (k, &constant) in constants.iter().enumerate() {
            let constant = Variable::Constant(constant);
            kinematics.by_variable((q, v, a), p, self.rate(), constant, 2 * nv + k, room);
            kinematics.add_force_by(q, p, constant, k, room, &mut out.by_p);
        }

        out.by_force.fill_with_identity();
        solve_columns(&mut out.by_q, Some(0), work, room);
        solve_columns(&mut out.by_v, Some(nv), work, room);
        solve_columns(&mut out.by_p, Some(2 * nv), work, room);
        solve_columns(&mut out.by_force, None, work, room);
        Ok(())
    }
}

/// Turns the columns x of −∂R/∂x into ∂v̇/∂x: z = M⁻¹ x, (J M⁻¹ Jᵀ) ∂λ = −∂r/∂x − J z, ∂v̇ = z + M⁻¹ Jᵀ ∂λ. The ∂r/∂x stand in
/// `room.by` from column `first` on; none: zero.
fn solve_columns(
    columns: &mut DMatrix<f64>,
    first: Option<usize>,
    work: &Workspace,
    room: &mut Room,
) {
    work.solve_mass(columns);
    for (k, mut column) in columns.column_iter_mut().enumerate() {
        room.rhs.gemv(-1.0, &room.jacobian, &column, 0.0);
        if let Some(first) = first {
            room.rhs -= room.by.column(first + k);
        }
        factor::solve(&room.coupling, &mut room.rhs);
        column.gemv(1.0, &room.response, &room.rhs, 1.0);
    }
}
