//! The configuration manifold of a list of coordinates.

use crate::Coordinate;

/// The configuration of all zeros, with quaternions 1 0 0 0.
pub fn neutral(coordinates: &[Coordinate]) -> Vec<f64> {
    let mut q = Vec::new();
    for coordinate in coordinates {
        let start = q.len();
        q.resize(start + coordinate.nq(), 0.0);
        if coordinate.floating {
            q[start + 3] = 1.0;
        }
    }
    q
}

/// Makes the quaternions of length 1; one that is zero or not finite becomes 1 0 0 0.
pub fn normalize(coordinates: &[Coordinate], q: &mut [f64]) {
    let mut rest = q;
    for coordinate in coordinates {
        let (own, after) = rest.split_at_mut(coordinate.nq());
        rest = after;
        if coordinate.floating {
            let quaternion = &mut own[3..];
            // Divided by the largest entry first: the length neither overflows nor vanishes.
            let largest = quaternion.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let unit = quaternion.iter().all(|x| x.is_finite()) && largest > 0.0;
            if !unit {
                quaternion.copy_from_slice(&[1.0, 0.0, 0.0, 0.0]);
                continue;
            }
            quaternion.iter_mut().for_each(|x| *x /= largest);
            let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
            quaternion.iter_mut().for_each(|x| *x /= length);
        }
    }
}
