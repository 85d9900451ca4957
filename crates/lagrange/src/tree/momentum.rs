//! The momentum of a tree, in O(n).

use super::common::{Axis, Moved, POSITION, Sums};
use super::plan::Plan;
use super::state::State;
use super::vector::Spatial;
use crate::Scalar;

/// ∂T/∂v = M v, into `out`; poses, axes and motions at VELOCITY. `momenta` is memory for one wrench a body.
///
/// ∂T/∂v_i = ∫ ∂r/∂q_i · ṙ dm = S_i · (∫ r × ṙ dm, ∫ ṙ dm), over all that joint i carries.
#[inline(always)]
pub fn momentum<D: Scalar>(
    plan: &Plan,
    state: &State<D>,
    (moved, axes): (&[Moved<D>], &[Axis<D>]),
    momenta: &mut [Spatial<D>],
    out: &mut [D],
) {
    for (i, body) in plan.bodies.iter().enumerate() {
        momenta[i] = match state.factor(body) {
            Some(factor) => {
                let alone = Sums::of::<POSITION>(body, &moved[i], factor);
                alone.of_motion(&moved[i].velocity)
            }
            None => Spatial::zero(),
        };
    }
    out.fill(D::zero());
    for (i, body) in plan.bodies.iter().enumerate().rev() {
        let here = momenta[i];
        for k in 0..body.freedom.dof() {
            let to = &mut out[body.v + k];
            *to = *to + axes[body.first + k].s.dot(&here) * body.ratio;
        }
        if let Some(parent) = body.parent {
            momenta[parent] = momenta[parent].plus(&here);
        }
    }
}
