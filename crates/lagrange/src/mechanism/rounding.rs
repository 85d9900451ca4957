//! Numbers of a body that are nothing but rounding.

use super::node::{Node, Rotation};

/// Rounding of a few rotations after one another, relative to the largest number beside it.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl Node {
    /// Makes zeros of the numbers that cannot be told from 0 in floating point. A frame turned by π/2 has cos(π/2) = 6·10⁻¹⁷ in it, and
    /// whatever is turned with it, which would stand in every formula and be multiplied at every state:
    ///
    /// - of a rotation, entries within 8 ε of 0, 1 or −1 are that;
    /// - of a translation, entries of at most 8 ε of the largest are 0;
    /// - of a rotational inertia I, entries of at most 8 ε ½ tr I (= 8 ε ∫ r² dm) are 0;
    /// - of a first moment h, entries of at most 8 ε √(m ½ tr I) are 0, which is the largest that h can be.
    ///
    /// ε is the distance from 1 to the next number, 2.2·10⁻¹⁶. An angle of 10⁻⁸ rad that is one stays.
    pub(super) fn drop_rounding(&mut self) {
        self.rotation = self.rotation.and_then(exact);
        if let Some(p) = &mut self.translation {
            let largest = p.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            drop_below(p, ROUNDING * largest);
        }
        let [xx, yy, zz, ..] = self.inertia;
        let second = 0.5 * (xx + yy + zz);
        drop_below(&mut self.inertia, ROUNDING * second);
        drop_below(&mut self.moment, ROUNDING * (self.mass * second).sqrt());
    }
}

/// The rotation with exact zeros and ones; none if it is the identity.
fn exact(rotation: [[f64; 3]; 3]) -> Rotation {
    let near = |x: f64| {
        let whole = [0.0, 1.0, -1.0];
        let close = |n: &f64| (x - n).abs() <= ROUNDING;
        whole.into_iter().find(close).unwrap_or(x)
    };
    let rotation = rotation.map(|row| row.map(near));
    let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    (rotation != identity).then_some(rotation)
}

fn drop_below(numbers: &mut [f64], least: f64) {
    for x in numbers {
        if x.abs() <= least {
            *x = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::{Rotation3, UnitQuaternion, Vector3};

    use super::*;

    fn rows(turn: Rotation3<f64>) -> [[f64; 3]; 3] {
        let m = *turn.matrix();
        [0, 1, 2].map(|i| [m[(i, 0)], m[(i, 1)], m[(i, 2)]])
    }

    #[test]
    fn quarter_turns_one_after_another_are_exact() {
        let quarter = |axis| UnitQuaternion::from_axis_angle(&axis, FRAC_PI_2);
        let mut pose = UnitQuaternion::identity();
        for k in 0..8 {
            let axis = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()][k % 3];
            pose *= quarter(axis);
            let found = exact(rows(pose.to_rotation_matrix()));
            let exact = found.unwrap_or(rows(Rotation3::identity()));
            for x in exact.as_flattened() {
                assert!([0.0, 1.0, -1.0].contains(x), "{k}: {x:e}");
            }
        }
    }

    #[test]
    fn a_small_angle_stays() {
        let turn = rows(Rotation3::from_axis_angle(&Vector3::z_axis(), 1e-14));
        assert_eq!(exact(turn).map(|turn| turn[0][1]), Some(turn[0][1]));
    }
}
