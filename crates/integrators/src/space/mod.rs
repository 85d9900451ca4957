//! Where states live: x ⊕ ξ.
//!
//! A state is a point x of a Lie group, a product of a vector space and of groups of motions; a tangent ξ is a small or large motion
//! from there, in the axes of what moves: x ⊕ ξ = x ∘ exp ξ. Velocities are tangents a second. In a vector space all of this is
//! addition; for a quaternion it keeps the length 1.

use std::ops::Range;

mod phase;
mod product;
mod rotation;
pub(crate) mod series;

pub use phase::PhaseSpace;
pub use product::Product;
pub use rotation::Rotation;

/// A vector space, a group of motions, or a product of them.
///
/// The slices have the lengths [`dim`](Self::dim) (points) and [`tangent_dim`](Self::tangent_dim) (motions); else the calls panic.
pub trait Space: Send + Sync {
    /// Numbers that make a point.
    fn dim(&self) -> usize;

    /// Directions of motion.
    fn tangent_dim(&self) -> usize;

    /// Whether x ⊕ ξ = x + ξ for all.
    fn is_flat(&self) -> bool;

    /// The directions of motion that do not commute with all others: brackets and cobrackets are zero elsewhere and depend on no other
    /// entries of their arguments. Series of brackets are summed over these alone, and gradients of roll-outs keep no rates elsewhere.
    fn curved(&self) -> Range<usize> {
        if self.is_flat() {
            0..0
        } else {
            0..self.tangent_dim()
        }
    }

    /// x ⊕ ξ = x ∘ exp ξ.
    fn move_into(&self, point: &[f64], motion: &[f64], out: &mut [f64]);

    /// The ξ, by the shortest way, with from ⊕ ξ = to.
    fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]);

    /// The bracket [a, b] = ad_a b; zero where motions commute.
    fn bracket_into(&self, a: &[f64], b: &[f64], out: &mut [f64]);

    /// ad_aᵀ m for a covector m: m · [a, b] = (ad_aᵀ m) · b for every b.
    fn cobracket_into(&self, a: &[f64], m: &[f64], out: &mut [f64]);

    /// How far `point` is from the space: by how much the length of a quaternion differs from 1; 0 where every point is in it, as by
    /// default.
    fn distance(&self, _point: &[f64]) -> f64 {
        0.0
    }

    /// What a relative tolerance for each direction of motion is relative to: the number itself where states add, 1 for a turn.
    fn scale_into(&self, point: &[f64], out: &mut [f64]) {
        if self.is_flat() {
            out.copy_from_slice(point);
        } else {
            out.fill(1.0);
        }
    }
}

impl<S: Space> Space for &S {
    fn dim(&self) -> usize {
        (**self).dim()
    }
    fn tangent_dim(&self) -> usize {
        (**self).tangent_dim()
    }
    fn is_flat(&self) -> bool {
        (**self).is_flat()
    }
    fn curved(&self) -> Range<usize> {
        (**self).curved()
    }
    fn move_into(&self, point: &[f64], motion: &[f64], out: &mut [f64]) {
        (**self).move_into(point, motion, out);
    }
    fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]) {
        (**self).difference_into(from, to, out);
    }
    fn bracket_into(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        (**self).bracket_into(a, b, out);
    }
    fn cobracket_into(&self, a: &[f64], m: &[f64], out: &mut [f64]) {
        (**self).cobracket_into(a, m, out);
    }
    fn distance(&self, point: &[f64]) -> f64 {
        (**self).distance(point)
    }
    fn scale_into(&self, point: &[f64], out: &mut [f64]) {
        (**self).scale_into(point, out);
    }
}

/// The vector space ℝⁿ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flat {
    dim: usize,
}

impl Flat {
    /// Of `dim` entries.
    pub const fn new(dim: usize) -> Self {
        Flat { dim }
    }
}

impl Space for Flat {
    fn dim(&self) -> usize {
        self.dim
    }
    fn tangent_dim(&self) -> usize {
        self.dim
    }
    fn is_flat(&self) -> bool {
        true
    }
    fn move_into(&self, point: &[f64], motion: &[f64], out: &mut [f64]) {
        for ((out, x), d) in out.iter_mut().zip(point).zip(motion) {
            *out = x + d;
        }
    }
    fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]) {
        for ((out, a), b) in out.iter_mut().zip(from).zip(to) {
            *out = b - a;
        }
    }
    fn bracket_into(&self, _a: &[f64], _b: &[f64], out: &mut [f64]) {
        out.fill(0.0);
    }
    fn cobracket_into(&self, _a: &[f64], _m: &[f64], out: &mut [f64]) {
        out.fill(0.0);
    }
}
