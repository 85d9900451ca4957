//! M, C and G from sums over the bodies beyond each joint.

use super::common::{Axis, Sums};
use super::plan::Plan;
use super::sink::Sink;
use super::vector::{Spatial, Vector, cross, negate, scale};
use crate::Scalar;

/// M, into `out`; sums at POSITION or above.
///
/// M_ij = ∫ ∂r/∂q_i · ∂r/∂q_j dm = S_i · (momentum of all that both joints move under S_j), where one joint carries the other; else
/// no body is moved by both, and M_ij = 0. (The composite-rigid-body algorithm, Featherstone 2008, §6.2.)
#[inline(always)]
pub fn mass_matrix<D: Scalar>(
    plan: &Plan,
    axes: &[Axis<D>],
    sums: &[Sums<D>],
    out: &mut impl Sink<D>,
) {
    for (k, dof) in plan.dofs.iter().enumerate() {
        let momentum = sums[dof.body].of_motion(&axes[k].s);
        let entry = axes[k].s.dot(&momentum) * (dof.ratio * dof.ratio);
        out.mass(dof.v, dof.v, entry);
        let mut above = dof.above;
        while let Some(j) = above {
            let other = &plan.dofs[j];
            let entry = axes[j].s.dot(&momentum) * (dof.ratio * other.ratio);
            out.mass(dof.v, other.v, entry);
            out.mass(other.v, dof.v, entry);
            above = other.above;
        }
    }
}

/// M and C, into `out`; sums at VELOCITY or above.
///
/// A mass point's Christoffel symbols vanish in the axes of the world, so that
///
/// C_ij = ∫ ∂r/∂q_i · d/dt ∂r/∂q_j dm, with d/dt ∂r/∂q_j = Ṡ_j(r) + S_jω × ṙ,
///
/// and Ṁ = C + Cᵀ at once. (In six-dimensional vectors: Echeandia and Wensing 2021.) In the velocities of a floating body, which
/// are no rates of coordinates, this is one of the C with C v the bias force and Ṁ − 2C skew.
#[inline(always)]
pub fn mass_and_coriolis<D: Scalar>(
    plan: &Plan,
    axes: &[Axis<D>],
    sums: &[Sums<D>],
    out: &mut impl Sink<D>,
) {
    for (k, dof) in plan.dofs.iter().enumerate() {
        let (axis, beyond) = (&axes[k], &sums[dof.body]);
        let momentum = beyond.of_motion(&axis.s);
        let turning = beyond.turning_along(&axis.s);
        let rate = beyond
            .of_motion(&axis.rate)
            .plus(&beyond.of_turning(&axis.s.angular));
        let square = dof.ratio * dof.ratio;
        out.mass(dof.v, dof.v, axis.s.dot(&momentum) * square);
        out.coriolis(dof.v, dof.v, axis.s.dot(&rate) * square);
        let mut above = dof.above;
        while let Some(j) = above {
            let (other, across) = (&plan.dofs[j], &axes[j]);
            let ratio = dof.ratio * other.ratio;
            let entry = across.s.dot(&momentum) * ratio;
            out.mass(dof.v, other.v, entry);
            out.mass(other.v, dof.v, entry);
            out.coriolis(other.v, dof.v, across.s.dot(&rate) * ratio);
            out.coriolis(dof.v, other.v, along(&momentum, &turning, across) * ratio);
            above = other.above;
        }
    }
}

/// ∫ S(r) · (Ṡ_j(r) + S_jω × ṙ) dm, from the momentum and the turning of S.
#[inline(always)]
fn along<D: Scalar>(momentum: &Spatial<D>, turning: &Vector<D>, j: &Axis<D>) -> D {
    super::vector::dot_add(turning, &j.s.angular, momentum.dot(&j.rate))
}

/// G, into `out`: ∂V/∂q_i = −∫ g · ∂r/∂q_i dm = S_i · (−h × g, −m g).
#[inline(always)]
pub fn gravity_force<D: Scalar>(
    plan: &Plan,
    gravity: &Vector<D>,
    axes: &[Axis<D>],
    sums: &[Sums<D>],
    out: &mut impl Sink<D>,
) {
    let lift = negate(gravity);
    for (dof, axis) in plan.dofs.iter().zip(axes) {
        let beyond = &sums[dof.body];
        let weight = Spatial {
            angular: cross(&beyond.moment, &lift),
            linear: scale(&lift, beyond.mass),
        };
        out.gravity(dof.v, axis.s.dot(&weight) * dof.ratio);
    }
}
