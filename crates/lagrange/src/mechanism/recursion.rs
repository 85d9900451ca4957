//! The recursions over a tree, from the base outward: motion for T, gravity for V.
//!
//! The formulas are those of [`Tree`]. What is constant or zero by the tree's shape is found once, at construction
//! ([`Shortcuts`]), and not carried along: most mechanisms are planar, and all have bodies on the base.
//!
//! Inlined by order: motions that are handed over in memory cost more time than their formulas.

use std::ops::Range;

use super::Tree;
use super::shortcuts::{Shortcuts, Spin};
use crate::{Lagrangian, Parameter, Scalar};

/// What the recursions need of a body; its frame has z along the joint's axis.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub parent: Option<usize>,
    /// Columns: the axes of this frame at joint position 0, in the parent body's frame.
    pub rotation: Rotation,
    /// Origin of this frame at joint position 0, in the parent body's frame, m.
    pub translation: Option<[f64; 3]>,
    /// Rotation about z, else translation along z.
    pub turns: bool,
    pub coordinate: usize,
    /// Joint position = ratio · coordinate + offset.
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
    pub short: Shortcuts,
}

/// A constant rotation, as rows of its transpose; none for the identity.
pub(crate) type Rotation = Option<[[f64; 3]; 3]>;

impl Tree {
    /// T of all bodies, each weighed by `weight`.
    fn kinetic_sum<D: Scalar>(&self, q: &[D], v: &[D], weight: &impl Fn(&Node, D) -> D) -> D {
        let mut sum = D::zero();
        for &first in &self.children[self.base_children.clone()] {
            let node = &self.nodes[first];
            let rate = node.rate(v);
            if node.parameter.is_some() {
                sum = sum + weight(node, node.kinetic_on_base(rate));
            }
            let motion = node.joint_motion(rate);
            for &child in &self.children[node.children.clone()] {
                sum = sum + self.kinetic_from(child, node, motion, q, v, weight);
            }
        }
        sum
    }

    /// T of body `i`, whose `parent` moves with `carrier`, and of all that it carries.
    fn kinetic_from<'a, D: Scalar>(
        &'a self,
        mut i: usize,
        mut parent: &'a Node,
        mut carrier: Motion<D>,
        q: &[D],
        v: &[D],
        weight: &impl Fn(&Node, D) -> D,
    ) -> D {
        let mut sum = D::zero();
        loop {
            let node = &self.nodes[i];
            let motion = node.motion(parent, &carrier, q, v);
            if node.parameter.is_some() {
                sum = sum + weight(node, node.kinetic(&motion));
            }
            let Some((&heaviest, others)) = self.children[node.children.clone()].split_last()
            else {
                return sum;
            };
            for &child in others {
                sum = sum + self.kinetic_from(child, node, motion, q, v, weight);
            }
            (i, parent, carrier) = (heaviest, node, motion);
        }
    }

    /// V of all bodies, each weighed by `weight`.
    fn potential_sum<D: Scalar>(&self, q: &[D], weight: &impl Fn(&Node, D) -> D) -> D {
        let base = Fall {
            g: [D::zero(); 3], // constant here, and so not read
            at_origin: D::zero(),
        };
        let mut sum = D::zero();
        for &child in &self.children[self.base_children.clone()] {
            sum = sum + self.potential_from(child, base, q, weight);
        }
        sum
    }

    /// V of body `i`, in whose parent's frame gravity is `above`, and of all that it carries.
    fn potential_from<D: Scalar>(
        &self,
        mut i: usize,
        mut above: Fall<D>,
        q: &[D],
        weight: &impl Fn(&Node, D) -> D,
    ) -> D {
        let mut sum = D::zero();
        loop {
            let node = &self.nodes[i];
            let fall = node.fall(&above, q);
            if node.parameter.is_some() {
                let along = fall.at_origin * node.mass + dot(&fall.g, &node.moment);
                sum = sum + weight(node, -along);
            }
            let Some((&heaviest, others)) = self.children[node.children.clone()].split_last()
            else {
                return sum;
            };
            for &child in others {
                sum = sum + self.potential_from(child, fall, q, weight);
            }
            (i, above) = (heaviest, fall);
        }
    }
}

impl Lagrangian for Tree {
    fn dof(&self) -> usize {
        self.coordinates.len()
    }
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        self.kinetic_sum(q, v, &|_, energy| energy)
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        self.potential_sum(q, &|_, energy| energy)
    }
    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }
    fn rigid_bodies(&self) -> Option<&Tree> {
        Some(self)
    }
    fn kinetic_with<D: Scalar>(&self, q: &[D], v: &[D], p: &[D]) -> D {
        self.kinetic_sum(q, v, &|node, energy| node.scaled(energy, p))
    }
    fn potential_with<D: Scalar>(&self, q: &[D], p: &[D]) -> D {
        self.potential_sum(q, &|node, energy| node.scaled(energy, p))
    }
}

/// Angular velocity of a body and velocity of its frame's origin, in that frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion<D> {
    pub w: [D; 3],
    pub v: [D; 3],
}

/// Gravity in a body's frame, and g·p of the frame's origin p.
#[derive(Clone, Copy)]
struct Fall<D> {
    g: [D; 3],
    at_origin: D,
}

impl Node {
    /// Joint position (or, without its offset, velocity) from the coordinates.
    pub fn position<D: Scalar>(&self, q: &[D]) -> D {
        match self.follow {
            None => q[self.coordinate],
            Some((ratio, offset)) => q[self.coordinate] * ratio + offset,
        }
    }
    fn rate<D: Scalar>(&self, v: &[D]) -> D {
        match self.follow {
            None => v[self.coordinate],
            Some((ratio, _)) => v[self.coordinate] * ratio,
        }
    }

    /// The motion of the joint alone.
    #[inline(always)]
    pub fn joint_motion<D: Scalar>(&self, rate: D) -> Motion<D> {
        let zero = [D::zero(); 3];
        let along = [D::zero(), D::zero(), rate];
        if self.turns {
            Motion { w: along, v: zero }
        } else {
            Motion { w: zero, v: along }
        }
    }

    /// ω and v that this body's `motion` brings to the joint of its child: Rᵀ ω and Rᵀ (v + ω × p).
    #[inline(always)]
    pub fn at_joint_of<D: Scalar>(&self, child: &Node, motion: &Motion<D>) -> ([D; 3], [D; 3]) {
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
        if self.turns {
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
    fn motion<D: Scalar>(&self, parent: &Node, carrier: &Motion<D>, q: &[D], v: &[D]) -> Motion<D> {
        let rate = self.rate(v);
        match &self.short.by_rate {
            Some(unit) => {
                let (of_turn, of_slide) = (carrier.w[2], carrier.v[2]);
                let carried = if parent.turns { of_turn } else { of_slide };
                self.moved_by_rate(unit, carried, q, rate)
            }
            None => self.moved(parent.at_joint_of(self, carrier), q, rate),
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
        if !self.turns {
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
    pub fn constant_gravity(&self) -> Option<[f64; 3]> {
        let along = |g: &[f64; 3]| !self.turns || Spin::of(g) != Spin::Full;
        self.short.gravity.filter(along)
    }

    /// Gravity here, given gravity in the parent body.
    #[inline(always)]
    fn fall<D: Scalar>(&self, parent: &Fall<D>, q: &[D]) -> Fall<D> {
        let position = self.position(q);
        if let Some(g) = &self.short.gravity {
            let at_joint = parent.at_origin + self.short.drop;
            return if !self.turns {
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
        if self.turns {
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

    /// ½ m q̇² or ½ I_zz q̇² of a body on the base.
    #[inline(always)]
    fn kinetic_on_base<D: Scalar>(&self, rate: D) -> D {
        let inertia = if self.turns {
            self.inertia[2]
        } else {
            self.mass
        };
        rate * rate * (0.5 * inertia)
    }

    /// ½ m v·v + v·(ω × h) + ½ ω·I ω.
    #[inline(always)]
    fn kinetic<D: Scalar>(&self, motion: &Motion<D>) -> D {
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
    fn scaled<D: Scalar>(&self, energy: D, p: &[D]) -> D {
        match self.parameter {
            Some(k) => energy * p[k],
            None => energy,
        }
    }
}

/// a · b.
#[inline(always)]
pub(super) fn dot<D: Scalar>(a: &[D; 3], b: &[f64; 3]) -> D {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a × b.
#[inline(always)]
fn cross<D: Scalar>(a: &[D; 3], b: &[f64; 3]) -> [D; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
fn add<D: Scalar>(a: &[D; 3], b: &[D; 3]) -> [D; 3] {
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
