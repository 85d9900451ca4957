//! One body of the recursions: what moves it, and the steps from its parent to it.
//!
//! Inlined by order: motions that are handed over in memory cost more time than their formulas. Free bodies are rare and stay out of
//! line, so that the steps of the others remain short.

use std::ops::{Mul, Range};

use super::shortcuts::{Shortcuts, Spin};
use crate::Scalar;

/// The motion that a joint, or one of the single motions that it is made of, allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Freedom {
    /// Rotation about z.
    Turn,
    /// Translation along z.
    Slide,
    /// Any motion. In q, seven numbers: position p (m) and unit quaternion w x y z of the moved frame in the joint's; in v, six:
    /// velocity and angular velocity of the moved frame against the joint's, in the axes of the moved frame.
    Free,
}

impl Freedom {
    /// Entries in v.
    pub fn dof(self) -> usize {
        match self {
            Freedom::Turn | Freedom::Slide => 1,
            Freedom::Free => 6,
        }
    }
}

/// What the recursions need of a body, or of one of the massless frames between a planar joint's motions. Unless the body is free,
/// its frame has z along the joint's axis.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub parent: Option<usize>,
    /// Columns: the axes of this frame at joint position 0, in the parent body's frame.
    pub rotation: Rotation,
    /// Origin of this frame at joint position 0, in the parent body's frame, m.
    pub translation: Option<[f64; 3]>,
    pub freedom: Freedom,
    /// First index in q.
    pub q: usize,
    /// First index in v.
    pub v: usize,
    /// Joint position = ratio · coordinate + offset; none for the coordinate itself.
    pub follow: Option<(f64, f64)>,
    pub mass: f64,
    /// m c, kg·m.
    pub moment: [f64; 3],
    /// xx, yy, zz, xy, xz, yz about the origin, kg·m².
    pub inertia: [f64; 6],
    /// Index of the mass scale; none where there is no mass.
    pub parameter: Option<usize>,
    /// Into `Tree::children`; the child with the largest subtree last.
    pub children: Range<usize>,
    pub(super) short: Shortcuts,
}

/// A constant rotation, as rows of its transpose; none for the identity.
pub(crate) type Rotation = Option<[[f64; 3]; 3]>;

/// Angular velocity of a body and velocity of its frame's origin, in that frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion<D> {
    pub w: [D; 3],
    pub v: [D; 3],
}

/// Gravity in a body's frame, and g·p of the frame's origin p.
#[derive(Clone, Copy)]
pub(super) struct Fall<D> {
    pub g: [D; 3],
    pub at_origin: D,
}

impl Node {
    /// Joint position from the coordinate.
    pub(super) fn position<D: Scalar>(&self, q: &[D]) -> D {
        self.position_at(q[self.q])
    }
    pub(super) fn position_at<D: Scalar>(&self, coordinate: D) -> D {
        match self.follow {
            None => coordinate,
            Some((ratio, offset)) => coordinate * ratio + offset,
        }
    }
    /// Velocity of a joint that turns or slides.
    pub(super) fn rate<D: Scalar>(&self, v: &[D]) -> D {
        match self.follow {
            None => v[self.v],
            Some((ratio, _)) => v[self.v] * ratio,
        }
    }

    fn turns(&self) -> bool {
        self.freedom == Freedom::Turn
    }

    /// The position p of a free body, and the rotation that its quaternion stands for.
    pub(super) fn pose<D: Scalar>(&self, q: &[D]) -> ([D; 3], Turn<D>) {
        pose_at(&q[self.q..])
    }
    /// The motion of a free body against its joint's frame.
    fn twist<D: Scalar>(&self, v: &[D]) -> Motion<D> {
        let at = &v[self.v..self.v + 6];
        Motion {
            w: [at[3], at[4], at[5]],
            v: [at[0], at[1], at[2]],
        }
    }

    /// The motion of a joint that turns or slides at `rate`, alone.
    #[inline(always)]
    pub(super) fn joint_motion<D: Scalar>(&self, rate: D) -> Motion<D> {
        let zero = [D::zero(); 3];
        let along = [D::zero(), D::zero(), rate];
        if self.turns() {
            Motion { w: along, v: zero }
        } else {
            Motion { w: zero, v: along }
        }
    }

    /// The motion of a body on the base.
    #[inline(always)]
    pub(super) fn motion_on_base<D: Scalar>(&self, v: &[D]) -> Motion<D> {
        match self.freedom {
            Freedom::Turn | Freedom::Slide => self.joint_motion(self.rate(v)),
            Freedom::Free => self.twist(v),
        }
    }

    /// ω and v that this body's `motion` brings to the joint of its child: Rᵀ ω and Rᵀ (v + ω × p).
    #[inline(always)]
    pub(super) fn at_joint_of<D: Scalar>(
        &self,
        child: &Node,
        motion: &Motion<D>,
    ) -> ([D; 3], [D; 3]) {
        let Motion { w, v } = motion;
        let v = match (&child.translation, child.short.carried) {
            (None, _) | (_, Spin::None) => *v,
            (Some(p), Spin::Axial) => [v[0] - w[2] * p[1], v[1] + w[2] * p[0], v[2]],
            (Some(p), Spin::Full) => add(v, &cross(w, p)),
        };
        let w = match child.short.carried {
            Spin::Full => unrotate(&child.rotation, w),
            Spin::None | Spin::Axial => *w,
        };
        (w, unrotate(&child.rotation, &v))
    }

    /// The motion, given what the parent brings to the joint.
    #[inline(always)]
    fn moved<D: Scalar>(&self, (w, v): ([D; 3], [D; 3]), q: &[D], rate: D) -> Motion<D> {
        let position = self.position(q);
        if self.turns() {
            let (sin, cos) = position.sin_cos();
            let w = match self.short.carried {
                Spin::None => [w[0], w[1], rate],
                Spin::Axial => [w[0], w[1], w[2] + rate],
                Spin::Full => {
                    let w = unturn(&w, sin, cos);
                    [w[0], w[1], w[2] + rate]
                }
            };
            let v = unturn(&v, sin, cos);
            Motion { w, v }
        } else if self.short.carried == Spin::Full {
            // v + ω × z q + z q̇
            let v = [v[0] + w[1] * position, v[1] - w[0] * position, v[2] + rate];
            Motion { w, v }
        } else {
            let v = [v[0], v[1], v[2] + rate];
            Motion { w, v }
        }
    }

    /// The motion of this body on `parent`, which moves with `carrier`.
    #[inline(always)]
    pub(super) fn motion<D: Scalar>(
        &self,
        parent: &Node,
        carrier: &Motion<D>,
        q: &[D],
        v: &[D],
    ) -> Motion<D> {
        if self.freedom == Freedom::Free {
            return self.moved_freely(parent.at_joint_of(self, carrier), q, v);
        }
        let rate = self.rate(v);
        match &self.short.by_rate {
            Some(unit) => {
                let (of_turn, of_slide) = (carrier.w[2], carrier.v[2]);
                let carried = if parent.turns() { of_turn } else { of_slide };
                self.moved_by_rate(unit, carried, q, rate)
            }
            None => self.moved(parent.at_joint_of(self, carrier), q, rate),
        }
    }

    /// The motion of a free body: Rᵀ ω_joint + ω and Rᵀ (v_joint + ω_joint × p) + v.
    #[inline(never)]
    fn moved_freely<D: Scalar>(&self, (w, v): ([D; 3], [D; 3]), q: &[D], rates: &[D]) -> Motion<D> {
        let (p, turn) = self.pose(q);
        let own = self.twist(rates);
        Motion {
            w: add(&turn.unturn(&w), &own.w),
            v: add(&turn.unturn(&add(&v, &cross(&w, &p))), &own.v),
        }
    }

    /// The motion when the parent is on the base: its joint rate `carried` brings `unit` times itself to this joint.
    #[inline(always)]
    fn moved_by_rate<D: Scalar>(
        &self,
        unit: &Motion<f64>,
        carried: D,
        q: &[D],
        rate: D,
    ) -> Motion<D> {
        let Motion { w, v } = unit;
        if !self.turns() {
            let at_joint = (w.map(|x| carried * x), v.map(|x| carried * x));
            return self.moved(at_joint, q, rate);
        }
        let (sin, cos) = self.position(q).sin_cos();
        let turned = |x: &[f64; 3]| {
            let [a, b, _] = unturn_constant(x, sin, cos);
            [a * carried, b * carried, carried * x[2]]
        };
        let w = match self.short.carried {
            Spin::None => [D::zero(), D::zero(), rate],
            Spin::Axial => [D::zero(), D::zero(), carried * w[2] + rate],
            Spin::Full => {
                let w = turned(w);
                [w[0], w[1], w[2] + rate]
            }
        };
        Motion { w, v: turned(v) }
    }

    /// Gravity in this body's frame, where it is constant.
    pub(super) fn constant_gravity(&self) -> Option<[f64; 3]> {
        self.short.gravity.filter(|g| match self.freedom {
            Freedom::Turn => Spin::of(g) != Spin::Full,
            Freedom::Slide => true,
            Freedom::Free => false,
        })
    }

    /// Gravity here, given gravity in the parent body.
    #[inline(always)]
    pub(super) fn fall<D: Scalar>(&self, parent: &Fall<D>, q: &[D]) -> Fall<D> {
        if self.freedom == Freedom::Free {
            return self.fall_freely(parent, q);
        }
        let position = self.position(q);
        if let Some(g) = &self.short.gravity {
            let at_joint = parent.at_origin + self.short.drop;
            return if !self.turns() {
                Fall {
                    g: g.map(D::constant),
                    at_origin: at_joint + position * g[2],
                }
            } else {
                let (sin, cos) = position.sin_cos();
                Fall {
                    g: unturn_constant(g, sin, cos),
                    at_origin: at_joint,
                }
            };
        }
        let at_joint = match &self.translation {
            None => parent.at_origin,
            Some(p) => parent.at_origin + dot(&parent.g, p),
        };
        let g = unrotate(&self.rotation, &parent.g);
        if self.turns() {
            let (sin, cos) = position.sin_cos();
            Fall {
                g: unturn(&g, sin, cos),
                at_origin: at_joint,
            }
        } else {
            Fall {
                at_origin: at_joint + g[2] * position,
                g,
            }
        }
    }

    /// Gravity in a free body: Rᵀ g, and g·p more at its origin.
    #[inline(never)]
    fn fall_freely<D: Scalar>(&self, parent: &Fall<D>, q: &[D]) -> Fall<D> {
        let (g, at_joint) = match &self.short.gravity {
            Some(g) => (g.map(D::constant), parent.at_origin + self.short.drop),
            None => {
                let drop = self.translation.map(|p| dot(&parent.g, &p));
                let g = unrotate(&self.rotation, &parent.g);
                (g, drop.map_or(parent.at_origin, |d| parent.at_origin + d))
            }
        };
        let (p, turn) = self.pose(q);
        Fall {
            at_origin: at_joint + inner(&g, &p),
            g: turn.unturn(&g),
        }
    }

    /// ½ m q̇² or ½ I_zz q̇² of a body on the base.
    #[inline(always)]
    pub(super) fn kinetic_on_base<D: Scalar>(&self, v: &[D]) -> D {
        let inertia = match self.freedom {
            Freedom::Turn => self.inertia[2],
            Freedom::Slide => self.mass,
            Freedom::Free => return self.kinetic(&self.twist(v)),
        };
        let rate = self.rate(v);
        rate * rate * (0.5 * inertia)
    }

    /// ½ m v·v + v·(ω × h) + ½ ω·I ω.
    #[inline(always)]
    pub(super) fn kinetic<D: Scalar>(&self, motion: &Motion<D>) -> D {
        let Motion { w, v } = motion;
        let h = &self.moment;
        let [xx, yy, zz, xy, xz, yz] = self.inertia;
        let linear = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) * (0.5 * self.mass);
        match self.short.spin {
            Spin::None => linear,
            Spin::Axial => linear + w[2] * (v[1] * h[0] - v[0] * h[1] + w[2] * (0.5 * zz)),
            Spin::Full => {
                let wh = cross(w, h);
                let mixed = v[0] * wh[0] + v[1] * wh[1] + v[2] * wh[2];
                let angular = w[0] * (w[0] * (0.5 * xx) + w[1] * xy + w[2] * xz)
                    + w[1] * (w[1] * (0.5 * yy) + w[2] * yz)
                    + w[2] * w[2] * (0.5 * zz);
                linear + mixed + angular
            }
        }
    }

    /// The energy of this body with its mass scale from `p`.
    pub(super) fn scaled<D: Scalar>(&self, energy: D, p: &[D]) -> D {
        match self.parameter {
            Some(k) => energy * p[k],
            None => energy,
        }
    }
}

/// The position and the rotation that seven numbers stand for.
pub(super) fn pose_at<D: Scalar>(at: &[D]) -> ([D; 3], Turn<D>) {
    let turn = Turn {
        w: at[3],
        u: [at[4], at[5], at[6]],
    };
    ([at[0], at[1], at[2]], turn)
}

/// The rotation of a unit quaternion w + u: R x = x + 2 u × (u × x + w x). On a quaternion that is not of length 1 this is taken
/// as it stands.
#[derive(Clone, Copy)]
pub(super) struct Turn<D> {
    pub w: D,
    pub u: [D; 3],
}

impl<D: Scalar> Turn<D> {
    /// R x.
    pub(super) fn turn(&self, x: &[D; 3]) -> [D; 3] {
        let Turn { w, u } = self;
        let [a, b, c] = cross(u, x);
        let inner = [a + *w * x[0], b + *w * x[1], c + *w * x[2]];
        add(x, &cross(u, &inner).map(|x| x * 2.0))
    }
    /// Rᵀ x.
    pub(super) fn unturn(&self, x: &[D; 3]) -> [D; 3] {
        let u = self.u.map(|x| -x);
        Turn { w: self.w, u }.turn(x)
    }
}

/// a · b.
#[inline(always)]
pub(super) fn dot<D: Scalar>(a: &[D; 3], b: &[f64; 3]) -> D {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a · b of two vectors that both move.
#[inline(always)]
fn inner<D: Scalar>(a: &[D; 3], b: &[D; 3]) -> D {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a × b.
#[inline(always)]
pub(super) fn cross<D: Scalar + Mul<E, Output = D>, E: Copy>(a: &[D; 3], b: &[E; 3]) -> [D; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
pub(super) fn add<D: Scalar>(a: &[D; 3], b: &[D; 3]) -> [D; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Rᵀ x for a constant rotation R.
#[inline(always)]
pub(super) fn unrotate<D: Scalar>(rotation: &Rotation, x: &[D; 3]) -> [D; 3] {
    match rotation {
        None => *x,
        Some([a, b, c]) => [dot(x, a), dot(x, b), dot(x, c)],
    }
}

/// Rᵀ x for the rotation about z by the angle of this sine and cosine.
#[inline(always)]
fn unturn<D: Scalar>(x: &[D; 3], sin: D, cos: D) -> [D; 3] {
    [cos * x[0] + sin * x[1], cos * x[1] - sin * x[0], x[2]]
}

/// [`unturn`] of a constant vector.
#[inline(always)]
fn unturn_constant<D: Scalar>(x: &[f64; 3], sin: D, cos: D) -> [D; 3] {
    [
        cos * x[0] + sin * x[1],
        cos * x[1] - sin * x[0],
        D::constant(x[2]),
    ]
}
