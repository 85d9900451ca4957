//! Inverse dynamics in O(n), body by body in its own axes.

use super::plan::{Body, Freedom, Plan};
use super::state::State;
use super::vector::{
    Matrix, Vector, add, constant, constant_columns, cross, cross_add, negate, scale, scale_add,
    times, times_add, transposed_times, zero,
};
use crate::Scalar;

/// A body's pose on its parent, its motion in its own axes, and the wrench that its joint transmits.
#[derive(Debug, Clone, Copy)]
pub struct Link<D> {
    /// Its axes in the parent's, as columns.
    rotation: Matrix<D>,
    /// Its origin in the parent's frame.
    origin: Vector<D>,
    /// ω
    spin: Vector<D>,
    /// ω̇
    spin_rate: Vector<D>,
    /// Acceleration of the origin, less gravity.
    acceleration: Vector<D>,
    force: Vector<D>,
    /// About the origin.
    moment: Vector<D>,
}

impl<D: Scalar> Link<D> {
    pub fn memory(plan: &Plan) -> Vec<Self> {
        let zero = zero();
        let link = Link {
            rotation: [zero; 3],
            origin: zero,
            spin: zero,
            spin_rate: zero,
            acceleration: zero,
            force: zero,
            moment: zero,
        };
        vec![link; plan.bodies.len()]
    }
}

/// Q = M v̇ + C v + G, into `force`; v̇ is `state.a`.
///
/// d/dt ∂T/∂v − ∂T/∂q + ∂V/∂q of each body is the wrench
///
/// - F = m a + ω̇ × h + ω × (ω × h)
/// - N = I ω̇ + ω × I ω + h × a
///
/// about its origin, h = m c, and a the acceleration of the origin less gravity: to accelerate the base with −g adds what ∂V/∂q
/// is. Q is what the wrenches of all bodies beyond a joint do along its motion. (Luh, Walker and Paul 1980.)
#[inline(always)]
pub fn inverse_dynamics<D: Scalar>(
    plan: &Plan,
    state: &State<D>,
    links: &mut [Link<D>],
    force: &mut [D],
) {
    for (i, body) in plan.bodies.iter().enumerate() {
        let link = moved(plan, state, links, i, body);
        links[i] = loaded(state, body, link);
    }
    force.fill(D::zero());
    for (i, body) in plan.bodies.iter().enumerate().rev() {
        let link = links[i];
        match body.freedom {
            Freedom::Turn => {
                force[body.v] = force[body.v] + link.moment[2] * body.ratio;
            }
            Freedom::Slide => {
                force[body.v] = force[body.v] + link.force[2] * body.ratio;
            }
            Freedom::Free => {
                let wrench = link.force.into_iter().chain(link.moment);
                for (q, w) in force[body.v..body.v + 6].iter_mut().zip(wrench) {
                    *q = *q + w;
                }
            }
        }
        if let Some(parent) = body.parent {
            let carried = times(&link.rotation, &link.force);
            let parent = &mut links[parent];
            parent.force = add(&parent.force, &carried);
            let moment = times_add(&link.rotation, &link.moment, &parent.moment);
            parent.moment = cross_add(&link.origin, &carried, &moment);
        }
    }
}

/// Pose and motion of body `i`, whose parent's are known.
#[inline(always)]
fn moved<D: Scalar>(
    plan: &Plan,
    state: &State<D>,
    links: &[Link<D>],
    i: usize,
    body: &Body,
) -> Link<D> {
    let (rotation, origin) = state.pose(i, body);
    // What the parent brings to this frame.
    let (spin, spin_rate, acceleration) = match body.parent {
        None => {
            let fall = negate(&constant(&plan.gravity));
            (zero(), zero(), transposed_times(&rotation, &fall))
        }
        Some(parent) => {
            let parent = &links[parent];
            let sweep = cross(&parent.spin, &origin);
            let acceleration = cross_add(&parent.spin, &sweep, &parent.acceleration);
            let acceleration = cross_add(&parent.spin_rate, &origin, &acceleration);
            (
                transposed_times(&rotation, &parent.spin),
                transposed_times(&rotation, &parent.spin_rate),
                transposed_times(&rotation, &acceleration),
            )
        }
    };
    let mut link = Link {
        rotation,
        origin,
        spin,
        spin_rate,
        acceleration,
        force: zero(),
        moment: zero(),
    };
    // What the joint adds.
    match body.freedom {
        Freedom::Turn => {
            let (v, a) = (state.v[body.v] * body.ratio, state.a[body.v] * body.ratio);
            link.spin[2] = spin[2] + v;
            link.spin_rate = [
                spin[1].times_plus(v, spin_rate[0]),
                (-spin[0]).times_plus(v, spin_rate[1]),
                spin_rate[2] + a,
            ];
        }
        Freedom::Slide => {
            let (v, a) = (state.v[body.v] * body.ratio, state.a[body.v] * body.ratio);
            let twice = v + v;
            link.acceleration = [
                spin[1].times_plus(twice, acceleration[0]),
                (-spin[0]).times_plus(twice, acceleration[1]),
                acceleration[2] + a,
            ];
        }
        Freedom::Free => {
            let (w, u) = state.joint(body, &state.v);
            let (w_rate, u_rate) = state.joint(body, &state.a);
            link.spin = add(&spin, &w);
            link.spin_rate = cross_add(&spin, &w, &add(&spin_rate, &w_rate));
            // The velocity u is in turning axes: u̇ + ω_joint × u, and Coriolis' 2 ω_parent × u.
            let turning = add(&w, &add(&spin, &spin));
            link.acceleration = cross_add(&turning, &u, &add(&acceleration, &u_rate));
        }
    }
    link
}

/// The body's own wrench.
#[inline(always)]
fn loaded<D: Scalar>(state: &State<D>, body: &Body, mut link: Link<D>) -> Link<D> {
    let Some(factor) = state.factor(body) else {
        return link;
    };
    let (w, a) = (&link.spin, &link.acceleration);
    let h = constant::<D>(&body.moment);
    let sweep = cross_add(w, &cross(w, &h), &scale(a, D::constant(body.mass)));
    link.force = scale(&cross_add(&link.spin_rate, &h, &sweep), factor);
    let momentum = symmetric(&body.inertia, w);
    let moment = cross_add(w, &momentum, &symmetric(&body.inertia, &link.spin_rate));
    link.moment = scale(&cross_add(&h, a, &moment), factor);
    link
}

/// I x, for I given as xx, yy, zz, xy, xz, yz.
#[inline(always)]
fn symmetric<D: Scalar>(i: &[f64; 6], x: &Vector<D>) -> Vector<D> {
    let [xx, yy, zz, xy, xz, yz] = *i;
    let columns = constant_columns::<D>(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
    scale_add(
        &columns[0],
        x[0],
        &scale_add(&columns[1], x[1], &scale(&columns[2], x[2])),
    )
}
