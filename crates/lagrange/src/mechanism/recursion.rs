//! The recursions over a tree, from the base outward: motion for T, gravity for V.
//!
//! The formulas are those of [`Tree`]. What is constant or zero by the tree's shape is found once, at construction
//! ([`Shortcuts`](super::shortcuts::Shortcuts)), and not carried along: most mechanisms are planar, and all have bodies on the base.

use super::Tree;
use super::node::{Fall, Motion, Node, dot};
use crate::{Lagrangian, Parameter, Scalar};

impl Tree {
    /// T of all bodies, each weighed by `weight`.
    fn kinetic_sum<D: Scalar>(&self, q: &[D], v: &[D], weight: &impl Fn(&Node, D) -> D) -> D {
        let mut sum = D::zero();
        for &first in &self.children[self.base_children.clone()] {
            let node = &self.nodes[first];
            if node.parameter.is_some() {
                sum = sum + weight(node, node.kinetic_on_base(v));
            }
            let motion = node.motion_on_base(v);
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
    /// Length of v; q is longer where a joint floats.
    fn dof(&self) -> usize {
        self.nv()
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
