//! Vector–Jacobian products of the inverse dynamics of a tree, in O(n).

use super::common::{ACCELERATION, Axis, Moved, Sums};
use super::plan::Plan;
use super::state::State;
use super::vector::{Spatial, Vector, dot, dot_add, scale, zero};
use crate::Scalar;

/// What a weight on Q makes of one body: its motion Λ = Σ λ_i S_i, and sums over it and all that it carries.
#[derive(Debug, Clone, Copy)]
pub struct Weighed<D> {
    /// Λ of the body that carries it.
    above: Spatial<D>,
    /// Λ
    motion: Spatial<D>,
    /// The momentum of Λ.
    momentum: Spatial<D>,
    /// y with ∫ Λ(r) · (x × ṙ) dm = y · x.
    turning: Vector<D>,
    /// (∫ r × r̈ dm, ∫ r̈ dm)
    wrench: Spatial<D>,
}

impl<D: Scalar> Weighed<D> {
    pub fn memory(plan: &Plan) -> Vec<Self> {
        let weighed = Weighed {
            above: Spatial::zero(),
            motion: Spatial::zero(),
            momentum: Spatial::zero(),
            turning: zero(),
            wrench: Spatial::zero(),
        };
        vec![weighed; plan.bodies.len()]
    }
}

/// Where the products go, in the order of q's tangent, v, v̇ and the factors on masses.
pub struct Products<'a, D> {
    pub by_q: &'a mut [D],
    pub by_v: &'a mut [D],
    pub by_a: &'a mut [D],
    pub by_p: &'a mut [D],
}

/// λᵀ ∂Q/∂q, λᵀ ∂Q/∂v, λᵀ ∂Q/∂v̇ = (M λ)ᵀ and λᵀ ∂Q/∂p; poses, axes and motions at ACCELERATION.
///
/// λ · Q is the power of all inertial forces on the motion Λ that λ would make as velocities. Summed over i, the derivatives of the
/// inverse dynamics leave for each joint j, with P the momentum of Λ, B its turning and f the wrench, all of what j carries:
///
/// - λᵀ ∂Q/∂q_j = Λ_parent · (S_j ×* f) + P · Ψ̈_j + 2 B · Ψ̇_jω
/// - λᵀ ∂Q/∂v_j = P · (Ṡ_j + Ψ̇_j) + 2 B · S_jω
/// - λᵀ ∂Q/∂v̇_j = P · S_j
#[inline(always)]
pub fn inverse_dynamics<D: Scalar>(
    plan: &Plan,
    state: &State<D>,
    (moved, axes): (&[Moved<D>], &[Axis<D>]),
    weight: &[D],
    weighed: &mut [Weighed<D>],
    out: Products<'_, D>,
) {
    let Products {
        by_q,
        by_v,
        by_a,
        by_p,
    } = out;
    for slots in [&mut *by_q, &mut *by_v, &mut *by_a, &mut *by_p] {
        slots.fill(D::zero());
    }
    for (i, body) in plan.bodies.iter().enumerate() {
        let above = match body.parent {
            Some(parent) => weighed[parent].motion,
            None => Spatial::zero(),
        };
        let mut motion = above;
        for k in 0..body.freedom.dof() {
            let rate = weight[body.v + k] * body.ratio;
            motion = axes[body.first + k].s.scaled_plus(rate, &motion);
        }
        let mut here = Weighed {
            above,
            motion,
            momentum: Spatial::zero(),
            turning: zero(),
            wrench: Spatial::zero(),
        };
        if let (Some(k), Some(factor)) = (body.parameter, state.factor(body)) {
            let unit = Sums::of::<ACCELERATION>(body, &moved[i], D::constant(1.0));
            by_p[k] = motion.dot(&unit.wrench);
            here.momentum = unit.of_motion(&motion).times(factor);
            here.turning = scale(&unit.turning_along(&motion), factor);
            here.wrench = unit.wrench.times(factor);
        }
        weighed[i] = here;
    }
    for (i, body) in plan.bodies.iter().enumerate().rev() {
        let here = weighed[i];
        for k in 0..body.freedom.dof() {
            let axis = &axes[body.first + k];
            let ratio = D::constant(body.ratio);
            let twice = scale(&here.turning, D::constant(2.0));
            let pulled = here.above.dot(&axis.s.cross_wrench(&here.wrench));
            let q = here.momentum.dot(&axis.swept_rate) + pulled;
            let q = dot_add(&twice, &axis.swept.angular, q);
            let v = here.momentum.dot(&axis.rate.plus(&axis.swept)) + dot(&twice, &axis.s.angular);
            let a = here.momentum.dot(&axis.s);
            for (to, x) in [(&mut *by_q, q), (&mut *by_v, v), (&mut *by_a, a)] {
                to[body.v + k] = x.times_plus(ratio, to[body.v + k]);
            }
        }
        if let Some(parent) = body.parent {
            let sum = &mut weighed[parent];
            sum.momentum = sum.momentum.plus(&here.momentum);
            sum.turning = super::vector::add(&sum.turning, &here.turning);
            sum.wrench = sum.wrench.plus(&here.wrench);
        }
    }
}
