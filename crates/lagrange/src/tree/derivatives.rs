//! Derivatives of the inverse dynamics of a tree, in O(n · depth).

use super::common::{Axis, Sums};
use super::plan::Plan;
use super::sink::Sink;
use super::vector::{dot_add, scale};
use crate::Scalar;

/// ∂Q/∂q and ∂Q/∂v of Q = M v̇ + C v + G, into `out`; sums at ACCELERATION.
///
/// Q_i = ∫ ∂r/∂q_i · r̈ dm (r̈ less g). Where joint j moves, all points beyond it follow:
///
/// - ∂r̈/∂q_j = Ψ̈_j(r) + 2 Ψ̇_jω × ṙ + S_jω × r̈
/// - ∂r̈/∂v_j = Ṡ_j(r) + Ψ̇_j(r) + 2 S_jω × ṙ
/// - ∂²r/∂q_i∂q_j = S_iω × ∂r/∂q_j, if joint i carries joint j; S_jω × ∂r/∂q_i, if j carries i or both are one joint.
///
/// So for i strictly before j, ∂Q_i/∂q_j = S_i · (I Ψ̈_j + 2 B Ψ̇_jω + S_j ×* f) with the momentum I, the turning B and the wrench f
/// of all beyond j, and in the other case the terms with r̈ cancel. (In six-dimensional vectors: Singh, Russell and Wensing 2022.)
/// Where a joint floats, ∂/∂q is along its velocities.
#[inline(always)]
pub fn inverse_dynamics<D: Scalar>(
    plan: &Plan,
    axes: &[Axis<D>],
    sums: &[Sums<D>],
    out: &mut impl Sink<D>,
) {
    for (k, dof) in plan.dofs.iter().enumerate() {
        let (axis, beyond) = (&axes[k], &sums[dof.body]);
        let body = &plan.bodies[dof.body];

        // Row k: joint j carries k, or is its joint.
        let momentum = beyond.of_motion(&axis.s);
        let turning = scale(&beyond.turning_along(&axis.s), D::constant(2.0));
        let mut at = Some(body.first + body.freedom.dof() - 1);
        while let Some(j) = at {
            let (other, across) = (&plan.dofs[j], &axes[j]);
            let ratio = dof.ratio * other.ratio;
            let swept = momentum.dot(&across.swept_rate);
            let q = dot_add(&turning, &across.swept.angular, swept);
            let rate = momentum.dot(&across.rate.plus(&across.swept));
            let v = dot_add(&turning, &across.s.angular, rate);
            out.by_q(k, j, q * ratio);
            out.by_v(k, j, v * ratio);
            at = other.above;
        }

        // Column k: joint i carries k.
        let turned = beyond.of_turning(&axis.swept.angular);
        let column_q = turned
            .plus(&turned)
            .plus(&beyond.of_motion(&axis.swept_rate))
            .plus(&axis.s.cross_wrench(&beyond.wrench));
        let turned = beyond.of_turning(&axis.s.angular);
        let column_v = turned
            .plus(&turned)
            .plus(&beyond.of_motion(&axis.rate.plus(&axis.swept)));
        let mut above = plan.dofs[body.first].above;
        while let Some(i) = above {
            let (other, across) = (&plan.dofs[i], &axes[i]);
            let ratio = dof.ratio * other.ratio;
            out.by_q(i, k, across.s.dot(&column_q) * ratio);
            out.by_v(i, k, across.s.dot(&column_v) * ratio);
            above = other.above;
        }
    }
}
