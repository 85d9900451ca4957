//! Derivatives of the constrained forward dynamics.
//!
//! With the free forward dynamics F, v̇ = F(q, v, Q + Jᵀ λ) and ∂F/∂Q = M⁻¹; r = φ̈ + 2 ω φ̇ + ω² φ is 0. In any variable x,
//!
//! - ∂v̇/∂x = z + M⁻¹ Jᵀ ∂λ/∂x with z = ∂F/∂x + M⁻¹ ∂(Jᵀ λ)/∂x at fixed λ,
//! - (J M⁻¹ Jᵀ) ∂λ/∂x = −∂r/∂x − J z with ∂r/∂x at fixed v̇.

use nalgebra::{Dyn, Matrix, StorageMut};

use super::kinematics::{Room, Variable};
use super::{Constrained, Constraint};
use crate::equations::cholesky;
use crate::{Error, ForwardDynamicsDerivatives, Mechanics, Workspace};

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
        room.acceleration.copy_from(&out.acceleration);
        room.force.copy_from_slice(force);
        room.force
            .gemv_tr(1.0, &room.jacobian, &room.multipliers, 1.0);
        let total = std::mem::take(&mut room.force);
        let solved = self.free().forward_dynamics_derivatives_into(
            q,
            v,
            total.as_slice(),
            p,
            constants,
            work,
            out,
        );
        room.force = total;
        solved?;
        // The same to the last bit as without derivatives.
        out.acceleration.copy_from(&room.acceleration);

        let a = out.acceleration.as_slice();
        let kinematics = self.kinematics();
        let rate = self.rate();
        for j in 0..v.len() {
            let position = Variable::Position(j);
            kinematics.by_variable((q, v, a), p, rate, position, j, room);
            kinematics.force_by(q, p, position, j, room);
        }
        room.product.gemm(1.0, &out.by_force, &room.force_by, 0.0);
        out.by_q += &room.product;
        obey(&mut out.by_q, true, room);

        for j in 0..v.len() {
            let velocity = Variable::Velocity(j);
            kinematics.by_variable((q, v, a), p, rate, velocity, j, room);
        }
        obey(&mut out.by_v, true, room);

        // In the constants, one by one: there may be more of them than velocities.
        for (k, &constant) in constants.iter().enumerate() {
            if !kinematics.constraint.uses_constant(constant) {
                obey(&mut out.by_p.columns_mut(k, 1), false, room);
                continue;
            }
            let constant = Variable::Constant(constant);
            kinematics.by_variable((q, v, a), p, rate, constant, 0, room);
            kinematics.force_by(q, p, constant, 0, room);
            let force_by = room.force_by.column(0);
            let mut column = out.by_p.columns_mut(k, 1);
            column.gemm(1.0, &out.by_force, &force_by, 1.0);
            obey(&mut column, true, room);
        }
        obey(&mut out.by_force, false, room);
        Ok(())
    }
}

/// Turns the columns z into ∂v̇/∂x = z + M⁻¹ Jᵀ ∂λ/∂x, with ∂r/∂x in the first columns of `room.by`, or 0.
fn obey<S: StorageMut<f64, Dyn, Dyn>>(
    columns: &mut Matrix<f64, Dyn, Dyn, S>,
    by_variable: bool,
    room: &mut Room,
) {
    for (k, mut column) in columns.column_iter_mut().enumerate() {
        room.rhs.gemv(-1.0, &room.jacobian, &column, 0.0);
        if by_variable {
            room.rhs -= room.by.column(k);
        }
        cholesky::solve(&room.coupling, &mut room.rhs);
        column.gemv(1.0, &room.response, &room.rhs, 1.0);
    }
}
