use std::ops::Range;

use super::Space;

/// The product of two spaces: points (x, y), tangents (ξ, η), each part by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Product<A, B> {
    /// The space of x.
    pub first: A,
    /// The space of y.
    pub second: B,
}

impl<A: Space, B: Space> Space for Product<A, B> {
    fn dim(&self) -> usize {
        self.first.dim() + self.second.dim()
    }
    fn tangent_dim(&self) -> usize {
        self.first.tangent_dim() + self.second.tangent_dim()
    }
    fn is_flat(&self) -> bool {
        self.first.is_flat() && self.second.is_flat()
    }
    fn curved(&self) -> Range<usize> {
        let (x, y) = (self.first.curved(), self.second.curved());
        let n = self.first.tangent_dim();
        match (x.is_empty(), y.is_empty()) {
            (_, true) => x,
            (true, false) => n + y.start..n + y.end,
            (false, false) => x.start..n + y.end,
        }
    }
    fn move_into(&self, point: &[f64], motion: &[f64], out: &mut [f64]) {
        let (x, y) = point.split_at(self.first.dim());
        let (a, b) = motion.split_at(self.first.tangent_dim());
        let (x_out, y_out) = out.split_at_mut(self.first.dim());
        self.first.move_into(x, a, x_out);
        self.second.move_into(y, b, y_out);
    }
    fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]) {
        let (x_from, y_from) = from.split_at(self.first.dim());
        let (x_to, y_to) = to.split_at(self.first.dim());
        let (a, b) = out.split_at_mut(self.first.tangent_dim());
        self.first.difference_into(x_from, x_to, a);
        self.second.difference_into(y_from, y_to, b);
    }
    fn bracket_into(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        let n = self.first.tangent_dim();
        let (first, second) = out.split_at_mut(n);
        self.first.bracket_into(&a[..n], &b[..n], first);
        self.second.bracket_into(&a[n..], &b[n..], second);
    }
    fn cobracket_into(&self, a: &[f64], m: &[f64], out: &mut [f64]) {
        let n = self.first.tangent_dim();
        let (first, second) = out.split_at_mut(n);
        self.first.cobracket_into(&a[..n], &m[..n], first);
        self.second.cobracket_into(&a[n..], &m[n..], second);
    }
    fn distance(&self, point: &[f64]) -> f64 {
        let (x, y) = point.split_at(self.first.dim());
        self.first.distance(x).max(self.second.distance(y))
    }
    fn scale_into(&self, point: &[f64], out: &mut [f64]) {
        let (x, y) = point.split_at(self.first.dim());
        let (a, b) = out.split_at_mut(self.first.tangent_dim());
        self.first.scale_into(x, a);
        self.second.scale_into(y, b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Flat, PhaseSpace, Rotation};

    #[test]
    fn a_difference_undoes_a_motion_of_a_turning_body_beside_numbers() {
        let space = Product {
            first: PhaseSpace {
                positions: Rotation,
            },
            second: Flat::new(2),
        };
        assert_eq!((space.dim(), space.tangent_dim()), (9, 8));
        let x = [1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 5.0, -6.0];
        let motion = [0.3, -0.2, 0.5, 1.0, 2.0, 3.0, 0.25, 0.5];
        let mut moved = [0.0; 9];
        space.move_into(&x, &motion, &mut moved);
        let mut back = [0.0; 8];
        space.difference_into(&x, &moved, &mut back);
        for (a, b) in motion.iter().zip(back) {
            assert!((a - b).abs() < 1e-14, "{a} and {b}");
        }
        assert_eq!(moved[7..], [5.25, -5.5]);
        let mut scale = [0.0; 8];
        space.scale_into(&x, &mut scale);
        assert_eq!(scale[6..], [5.0, -6.0]);
        assert!(!space.is_flat());
        assert_eq!(space.curved(), 0..3);
        assert!(
            (space.distance(&[2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0, 9.0]) - 1.0).abs() < 1e-15
        );
    }
}
