use std::ops::Range;
use std::sync::Arc;

use integrators::Space;
use lagrange::{Coordinate, state};

use crate::entries::{Start, starts};

/// Entries of a pose in q, and of its twist in v.
const POSE: usize = 7;
const TWIST: usize = 6;

/// The configurations of a mechanism: coordinates of one number add, poses are moved by twists (linear, angular) in the axes of the
/// moved body ([`lagrange::state`]).
///
/// The bracket of two twists is [a, b] = (ω_a × v_b + v_a × ω_b, ω_a × ω_b), that of the group of rigid motions.
///
/// ```
/// use integrators::Space;
/// use lagrange::Coordinate;
/// use pinode_nn::motion::Positions;
///
/// let base = Coordinate { name: "base".into(), joint: "base".into(), angular: false, wraps: false, floating: true };
/// let positions = Positions::new(&[base]);
/// assert_eq!((positions.dim(), positions.tangent_dim()), (7, 6));
/// // 1 m along the body's x axis, which points along the world's y axis.
/// let half = 0.5_f64.sqrt();
/// let mut moved = [0.0; 7];
/// positions.move_into(&[0.0, 0.0, 0.0, half, 0.0, 0.0, half], &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0], &mut moved);
/// assert!(moved[0].abs() < 1e-15 && (moved[1] - 1.0).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Positions {
    coordinates: Arc<[Coordinate]>,
    /// Which coordinates are poses, and where they stand.
    poses: Vec<(usize, Start)>,
    nq: usize,
    nv: usize,
}

impl Positions {
    /// Of a mechanism with these coordinates.
    pub fn new(coordinates: &[Coordinate]) -> Self {
        let poses = starts(coordinates).into_iter().enumerate();
        Positions {
            poses: poses.filter(|&(i, _)| coordinates[i].floating).collect(),
            nq: state::nq(coordinates),
            nv: state::nv(coordinates),
            coordinates: coordinates.into(),
        }
    }

    /// Where the poses stand.
    pub(crate) fn poses(&self) -> impl Iterator<Item = Start> {
        self.poses.iter().map(|&(_, start)| start)
    }
}

impl Space for Positions {
    fn dim(&self) -> usize {
        self.nq
    }
    fn tangent_dim(&self) -> usize {
        self.nv
    }
    fn is_flat(&self) -> bool {
        self.poses.is_empty()
    }
    fn curved(&self) -> Range<usize> {
        match (self.poses.first(), self.poses.last()) {
            (Some((_, first)), Some((_, last))) => first.v..last.v + TWIST,
            _ => 0..0,
        }
    }
    fn move_into(&self, point: &[f64], motion: &[f64], out: &mut [f64]) {
        let mut at = Start { q: 0, v: 0 };
        for &(i, pose) in &self.poses {
            add(
                &point[at.q..pose.q],
                &motion[at.v..pose.v],
                &mut out[at.q..pose.q],
            );
            at = Start {
                q: pose.q + POSE,
                v: pose.v + TWIST,
            };
            state::integrate_into(
                &self.coordinates[i..=i],
                &point[pose.q..at.q],
                &motion[pose.v..at.v],
                &mut out[pose.q..at.q],
            );
        }
        add(&point[at.q..], &motion[at.v..], &mut out[at.q..]);
    }
    fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]) {
        state::difference_into(&self.coordinates, from, to, out);
    }
    fn bracket_into(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for pose in self.poses() {
            let of = pose.v..pose.v + TWIST;
            let (linear, angular) = out[of.clone()].split_at_mut(3);
            let (a, b) = (&a[of.clone()], &b[of]);
            add_cross(&a[3..], &b[..3], linear);
            add_cross(&a[..3], &b[3..], linear);
            add_cross(&a[3..], &b[3..], angular);
        }
    }
    fn cobracket_into(&self, a: &[f64], m: &[f64], out: &mut [f64]) {
        // m · [a, b] = f · (ω_a × v_b + v_a × ω_b) + n · (ω_a × ω_b) = (f × ω_a) · v_b + (f × v_a + n × ω_a) · ω_b
        out.fill(0.0);
        for pose in self.poses() {
            let of = pose.v..pose.v + TWIST;
            let (linear, angular) = out[of.clone()].split_at_mut(3);
            let (a, m) = (&a[of.clone()], &m[of]);
            add_cross(&m[..3], &a[3..], linear);
            add_cross(&m[..3], &a[..3], angular);
            add_cross(&m[3..], &a[3..], angular);
        }
    }
    /// The number itself for a coordinate of one number; 1 m and 1 rad for a pose, wherever it is.
    fn scale_into(&self, point: &[f64], out: &mut [f64]) {
        let mut at = Start { q: 0, v: 0 };
        for pose in self.poses() {
            out[at.v..pose.v].copy_from_slice(&point[at.q..pose.q]);
            out[pose.v..pose.v + TWIST].fill(1.0);
            at = Start {
                q: pose.q + POSE,
                v: pose.v + TWIST,
            };
        }
        out[at.v..].copy_from_slice(&point[at.q..]);
    }
    fn distance(&self, point: &[f64]) -> f64 {
        let length = |pose: Start| {
            let quaternion = point.get(pose.q + 3..pose.q + POSE).unwrap_or_default();
            quaternion.iter().map(|x| x * x).sum::<f64>().sqrt()
        };
        let off = self.poses().map(|pose| (length(pose) - 1.0).abs());
        off.fold(0.0, f64::max)
    }
}

fn add(x: &[f64], y: &[f64], out: &mut [f64]) {
    for ((out, x), y) in out.iter_mut().zip(x).zip(y) {
        *out = x + y;
    }
}

/// out += a × b.
fn add_cross(a: &[f64], b: &[f64], out: &mut [f64]) {
    out[0] += a[1] * b[2] - a[2] * b[1];
    out[1] += a[2] * b[0] - a[0] * b[2];
    out[2] += a[0] * b[1] - a[1] * b[0];
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hinge, a pose, a slider.
    fn positions() -> Positions {
        let new = |name: &str, floating| Coordinate {
            name: name.into(),
            joint: name.into(),
            angular: false,
            wraps: false,
            floating,
        };
        Positions::new(&[new("hinge", false), new("base", true), new("slider", false)])
    }

    fn numbers(seed: f64, count: u32) -> Vec<f64> {
        (0..count)
            .map(|i| (seed + 1.3 * f64::from(i)).sin())
            .collect()
    }

    fn point() -> Vec<f64> {
        let space = positions();
        let mut out = vec![0.0; 9];
        let mut zero = vec![0.0; 9];
        zero[4] = 1.0;
        space.move_into(&zero, &numbers(0.4, 8), &mut out);
        out
    }

    #[test]
    fn two_small_motions_differ_from_their_sum_by_half_their_bracket() {
        // exp(a) exp(b) = exp(a + b + ½ [a, b] + O(3))
        let (space, start) = (positions(), point());
        let scale = 1e-3;
        let scaled = |seed| -> Vec<f64> { numbers(seed, 8).iter().map(|x| scale * x).collect() };
        let (a, b) = (scaled(0.0), scaled(2.0));
        let (mut first, mut both) = (vec![0.0; 9], vec![0.0; 9]);
        let (mut found, mut bracket) = (vec![0.0; 8], vec![0.0; 8]);
        space.move_into(&start, &a, &mut first);
        space.move_into(&first, &b, &mut both);
        space.difference_into(&start, &both, &mut found);
        space.bracket_into(&a, &b, &mut bracket);
        assert!(bracket.iter().any(|x| x.abs() > 0.1 * scale * scale));
        for i in 0..8 {
            let expected = a[i] + b[i] + 0.5 * bracket[i];
            approx::assert_abs_diff_eq!(found[i], expected, epsilon = scale.powi(3));
        }
    }

    #[test]
    fn the_cobracket_is_the_transpose_of_the_bracket() {
        let space = positions();
        let (a, b, m) = (numbers(0.0, 8), numbers(1.0, 8), numbers(2.0, 8));
        let (mut bracket, mut cobracket) = (vec![0.0; 8], vec![0.0; 8]);
        space.bracket_into(&a, &b, &mut bracket);
        space.cobracket_into(&a, &m, &mut cobracket);
        let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        approx::assert_abs_diff_eq!(dot(&m, &bracket), dot(&cobracket, &b), epsilon = 1e-14);
    }

    #[test]
    fn a_pose_counts_as_one_wherever_it_is_and_a_number_as_itself() {
        let (space, mut scale) = (positions(), vec![0.0; 8]);
        let far: Vec<f64> = [-3.0, 1e3, 2e3, -1e3, 1.0, 0.0, 0.0, 0.0, 0.2].into();
        space.scale_into(&far, &mut scale);
        assert_eq!(scale, [-3.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.2]);
    }

    #[test]
    fn motions_commute_but_for_those_in_the_curved_directions() {
        let space = positions();
        let curved = space.curved();
        assert_eq!(curved, 1..7);
        let (a, b) = (numbers(0.0, 8), numbers(1.0, 8));
        let only = |x: &[f64]| -> Vec<f64> {
            let kept = |(i, &x)| if curved.contains(&i) { x } else { 0.0 };
            x.iter().enumerate().map(kept).collect()
        };
        let (mut whole, mut part) = (vec![1.0; 8], vec![2.0; 8]);
        for apply in [Space::bracket_into, Space::cobracket_into] {
            apply(&space, &a, &b, &mut whole);
            apply(&space, &only(&a), &only(&b), &mut part);
            assert_eq!(whole, part);
            assert_eq!(whole, only(&whole));
        }
    }

    #[test]
    fn moving_is_that_of_the_configuration_manifold() {
        let (space, start, motion) = (positions(), point(), numbers(0.7, 8));
        let mut found = vec![0.0; 9];
        space.move_into(&start, &motion, &mut found);
        let expected = state::integrate(&space.coordinates, &start, &motion).unwrap();
        assert_eq!(found, expected);
    }
}
