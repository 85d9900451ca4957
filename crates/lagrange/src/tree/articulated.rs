//! Forward dynamics in O(n): articulated bodies.

use super::common::{Axis, Moved, Sums, VELOCITY, gravity, motion};
use super::factor::LEAST_PIVOT;
use super::plan::{Body, Freedom, Plan};
use super::state::State;
use super::vector::{
    Matrix, Spatial, Vector, add, cross, cross_add, dot, negate, scale, scale_add, subtract, times,
    transposed_times, zero,
};
use crate::Scalar;

/// A body with all that it carries, its joints free to give way: wrench = I^A V̇ + p^A.
#[derive(Debug, Clone, Copy)]
pub struct Articulated<D> {
    /// I^A from angular acceleration to moment: xx, yy, zz, xy, xz, yz.
    angular: [D; 6],
    /// From linear acceleration to moment, as columns; its transpose from angular acceleration to force.
    mixed: Matrix<D>,
    /// From linear acceleration to force.
    linear: [D; 6],
    /// ∫ dm and ∫ r·r dm, of the body and all that it carries: what rounding in I^A is measured by.
    size: [D; 2],
    /// p^A
    bias: Spatial<D>,
    /// V̇_joint at zero joint acceleration, c = V_parent × V.
    drift: Spatial<D>,
    /// U = I^A S
    reaction: Spatial<D>,
    /// 1 / (S · U)
    pivot: D,
    /// Q − S · p^A, for a joint of one degree of freedom.
    push: D,
}

impl<D: Scalar> Articulated<D> {
    pub fn memory(plan: &Plan) -> Vec<Self> {
        let body = Articulated {
            angular: [D::zero(); 6],
            mixed: [zero(); 3],
            linear: [D::zero(); 6],
            size: [D::zero(); 2],
            bias: Spatial::zero(),
            drift: Spatial::zero(),
            reaction: Spatial::zero(),
            pivot: D::zero(),
            push: D::zero(),
        };
        vec![body; plan.bodies.len()]
    }

    /// I^A x + p.
    #[inline(always)]
    fn times_add(&self, x: &Spatial<D>, p: &Spatial<D>) -> Spatial<D> {
        let angular = symmetric_add(&self.angular, &x.angular, &p.angular);
        let linear = symmetric_add(&self.linear, &x.linear, &p.linear);
        Spatial {
            angular: add(&angular, &times(&self.mixed, &x.linear)),
            linear: add(&linear, &transposed_times(&self.mixed, &x.angular)),
        }
    }

    /// I^A − U Uᵀ pivot, and the bias `bias`, to be added to the parent's.
    #[inline(always)]
    fn give_way(&self, bias: Spatial<D>) -> Self {
        let Spatial {
            angular: u,
            linear: f,
        } = &self.reaction;
        let (su, sf) = (scale(u, -self.pivot), scale(f, -self.pivot));
        let mut left = *self;
        left.angular = outer_add(&su, u, &self.angular);
        left.linear = outer_add(&sf, f, &self.linear);
        for (column, f) in left.mixed.iter_mut().zip(f) {
            *column = scale_add(&su, *f, column);
        }
        left.bias = bias;
        left
    }

    #[inline(always)]
    fn add(&mut self, other: &Self) {
        for (to, from) in self.angular.iter_mut().zip(&other.angular) {
            *to = *to + *from;
        }
        for (to, from) in self.linear.iter_mut().zip(&other.linear) {
            *to = *to + *from;
        }
        for (to, from) in self.mixed.iter_mut().zip(&other.mixed) {
            *to = add(to, from);
        }
        for (to, from) in self.size.iter_mut().zip(&other.size) {
            *to = *to + *from;
        }
        self.bias = self.bias.plus(&other.bias);
    }
}

/// v̇ from M v̇ = Q − C v − G, into `out`, which holds Q. For joints of which none follows another.
///
/// From the tips inward each joint gives way to what pulls at it:
///
/// - U = I^A S, D = S · U, u = Q − S · p^A
/// - to the parent: I^A − U Uᵀ / D, and p^A + (I^A − U Uᵀ / D) c + U u / D;
///
/// (a D that is rounding is no number: the joint has nothing of its own to accelerate);
///
/// then from the base outward v̇ = (u − U · (V̇_parent + c)) / D. A floating joint hands over its Q and nothing else. (Featherstone
/// 2008, §7.3, here with all vectors in one frame.)
#[inline(always)]
pub fn forward_dynamics<D: Scalar>(
    plan: &Plan,
    state: &State<D>,
    moved: &mut [Moved<D>],
    axes: &mut [Axis<D>],
    bodies: &mut [Articulated<D>],
    out: &mut [D],
) {
    motion::<D, VELOCITY>(plan, state, moved, axes);
    for (i, body) in plan.bodies.iter().enumerate() {
        bodies[i] = rigid(plan, state, moved, i);
        if let Some(parent) = body.parent {
            bodies[i].drift = moved[parent].velocity.cross(&moved[i].velocity);
        }
    }
    for (i, body) in plan.bodies.iter().enumerate().rev() {
        let here = &mut bodies[i];
        match body.freedom {
            Freedom::Turn | Freedom::Slide => {
                let s = &axes[body.first].s;
                here.reaction = here.times_add(s, &Spatial::zero());
                let [mass, spread] = here.size;
                let turned = dot(&s.angular, &s.angular) * spread;
                let size = dot(&s.linear, &s.linear).times_plus(mass, turned);
                let pivot = s.dot(&here.reaction);
                here.pivot = pivot.inverse_above(size * LEAST_PIVOT);
                here.push = out[body.v] - s.dot(&here.bias);
                let Some(parent) = body.parent else { continue };
                let left = here.give_way(here.bias);
                let bias = left.times_add(&left.drift, &left.bias);
                let push = here.push * here.pivot;
                let left = Articulated {
                    bias: here.reaction.scaled_plus(push, &bias),
                    ..left
                };
                bodies[parent].add(&left);
            }
            Freedom::Free => {
                let Some(parent) = body.parent else { continue };
                let handed = handed_over(&moved[i], &out[body.v..body.v + 6]);
                let bias = &mut bodies[parent].bias;
                *bias = bias.plus(&handed);
            }
        }
    }
    let base = Spatial {
        angular: zero(),
        linear: negate(&gravity(plan, state)),
    };
    for (i, body) in plan.bodies.iter().enumerate() {
        let below = match body.parent {
            Some(parent) => moved[parent].acceleration,
            None => base,
        };
        let carried = below.plus(&bodies[i].drift);
        moved[i].acceleration = rate(body, &bodies[i], &moved[i], axes, &carried, out);
    }
}

/// x from M x = b, into `out`, which holds b, by the articulated bodies that [`forward_dynamics`] leaves: v̇ of a tree at rest without
/// gravity under Q = b, for which each joint gives way as it does there.
#[inline(always)]
pub fn solve<D: Scalar>(
    plan: &Plan,
    moved: &[Moved<D>],
    axes: &[Axis<D>],
    bodies: &mut [Articulated<D>],
    motions: &mut [Spatial<D>],
    out: &mut [D],
) {
    for body in bodies.iter_mut() {
        body.bias = Spatial::zero();
    }
    for (i, body) in plan.bodies.iter().enumerate().rev() {
        let here = &mut bodies[i];
        let handed = match body.freedom {
            Freedom::Turn | Freedom::Slide => {
                here.push = out[body.v] - axes[body.first].s.dot(&here.bias);
                here.reaction
                    .scaled_plus(here.push * here.pivot, &here.bias)
            }
            Freedom::Free => handed_over(&moved[i], &out[body.v..body.v + 6]),
        };
        if let Some(parent) = body.parent {
            let bias = &mut bodies[parent].bias;
            *bias = bias.plus(&handed);
        }
    }
    for (i, body) in plan.bodies.iter().enumerate() {
        let carried = match body.parent {
            Some(parent) => motions[parent],
            None => Spatial::zero(),
        };
        motions[i] = rate(body, &bodies[i], &moved[i], axes, &carried, out);
    }
}

/// The acceleration of a body whose joint, held fast, would carry it with `carried`; and that of the joint, in place of its Q in `q`.
#[inline(always)]
fn rate<D: Scalar>(
    body: &Body,
    here: &Articulated<D>,
    moved: &Moved<D>,
    axes: &[Axis<D>],
    carried: &Spatial<D>,
    q: &mut [D],
) -> Spatial<D> {
    match body.freedom {
        Freedom::Turn | Freedom::Slide => {
            let rate = (here.push - here.reaction.dot(carried)) * here.pivot;
            q[body.v] = rate;
            axes[body.first].s.scaled_plus(rate, carried)
        }
        Freedom::Free => {
            let q = &mut q[body.v..body.v + 6];
            let pull = handed_over(moved, q);
            let rest = Spatial {
                angular: subtract(&pull.angular, &here.bias.angular),
                linear: subtract(&pull.linear, &here.bias.linear),
            };
            let acceleration = here.solve(&rest);
            let joint = Spatial {
                angular: subtract(&acceleration.angular, &carried.angular),
                linear: subtract(&acceleration.linear, &carried.linear),
            };
            // Of the origin, in the body's axes.
            let Moved {
                rotation, origin, ..
            } = moved;
            let linear = cross_add(&joint.angular, origin, &joint.linear);
            let linear = transposed_times(rotation, &linear);
            let angular = transposed_times(rotation, &joint.angular);
            for (q, x) in q.iter_mut().zip(linear.into_iter().chain(angular)) {
                *q = x;
            }
            acceleration
        }
    }
}

/// The wrench about the common origin of a force and a moment in a body's axes.
#[inline(always)]
fn handed_over<D: Scalar>(moved: &Moved<D>, q: &[D]) -> Spatial<D> {
    let force = times(&moved.rotation, &[q[0], q[1], q[2]]);
    let moment = times(&moved.rotation, &[q[3], q[4], q[5]]);
    Spatial {
        angular: cross_add(&moved.origin, &force, &moment),
        linear: force,
    }
}

/// The body alone: I = (I, h×; −h×, m), p = (ω × L + u × p, ω × p) with its momenta L = I ω + h × u, p = m u + ω × h.
#[inline(always)]
fn rigid<D: Scalar>(plan: &Plan, state: &State<D>, moved: &[Moved<D>], i: usize) -> Articulated<D> {
    let o = D::zero();
    let mut rigid = Articulated {
        angular: [o; 6],
        mixed: [zero(); 3],
        linear: [o; 6],
        size: [o; 2],
        bias: Spatial::zero(),
        drift: Spatial::zero(),
        reaction: Spatial::zero(),
        pivot: o,
        push: o,
    };
    let body = &plan.bodies[i];
    let Some(factor) = state.factor(body) else {
        return rigid;
    };
    let sums = Sums::of::<{ super::common::POSITION }>(body, &moved[i], factor);
    let [xx, yy, zz, xy, xz, yz] = sums.spread;
    rigid.angular = [yy + zz, xx + zz, xx + yy, -xy, -xz, -yz];
    let [x, y, z] = sums.moment;
    rigid.mixed = [[o, z, -y], [-z, o, x], [y, -x, o]];
    rigid.size = [sums.mass, xx + yy + zz];
    rigid.linear = [sums.mass, sums.mass, sums.mass, o, o, o];
    let velocity = &moved[i].velocity;
    let (w, u) = (&velocity.angular, &velocity.linear);
    let linear = cross_add(w, &sums.moment, &scale(u, sums.mass));
    let angular = symmetric_add(&rigid.angular, w, &cross(&sums.moment, u));
    rigid.bias = velocity.cross_wrench(&Spatial { angular, linear });
    rigid
}

impl<D: Scalar> Articulated<D> {
    /// x from I^A x = b, by elimination without pivoting: I^A is positive definite.
    #[inline(always)]
    fn solve(&self, b: &Spatial<D>) -> Spatial<D> {
        let mut m = [[D::zero(); 7]; 6];
        let order = [[0, 3, 4], [3, 1, 5], [4, 5, 2]];
        for i in 0..3 {
            for j in 0..3 {
                m[i][j] = self.angular[order[i][j]];
                m[i][j + 3] = self.mixed[j][i];
                m[i + 3][j] = self.mixed[i][j];
                m[i + 3][j + 3] = self.linear[order[i][j]];
            }
            m[i][6] = b.angular[i];
            m[i + 3][6] = b.linear[i];
        }
        for k in 0..6 {
            let pivot = D::constant(1.0) / m[k][k];
            let row = m[k];
            for lower in m.iter_mut().skip(k + 1) {
                let ratio = -(lower[k] * pivot);
                for j in k + 1..7 {
                    lower[j] = ratio.times_plus(row[j], lower[j]);
                }
            }
        }
        let mut x = [D::zero(); 6];
        for k in (0..6).rev() {
            let mut sum = m[k][6];
            for j in k + 1..6 {
                sum = (-m[k][j]).times_plus(x[j], sum);
            }
            x[k] = sum / m[k][k];
        }
        Spatial {
            angular: [x[0], x[1], x[2]],
            linear: [x[3], x[4], x[5]],
        }
    }
}

/// A x + c for a symmetric A.
#[inline(always)]
fn symmetric_add<D: Scalar>(a: &[D; 6], x: &Vector<D>, c: &Vector<D>) -> Vector<D> {
    let [xx, yy, zz, xy, xz, yz] = *a;
    super::vector::times_add(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], x, c)
}

/// A + a bᵀ, where that is symmetric.
#[inline(always)]
fn outer_add<D: Scalar>(a: &Vector<D>, b: &Vector<D>, m: &[D; 6]) -> [D; 6] {
    [
        a[0].times_plus(b[0], m[0]),
        a[1].times_plus(b[1], m[1]),
        a[2].times_plus(b[2], m[2]),
        a[0].times_plus(b[1], m[3]),
        a[0].times_plus(b[2], m[4]),
        a[1].times_plus(b[2], m[5]),
    ]
}
