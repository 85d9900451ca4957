//! The pose of a floating body as six numbers: where it is, and three angles.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use crate::Coordinate;

/// How the pose of a floating body is written in q and v.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PoseForm {
    /// One coordinate: position and unit quaternion in q, velocities in the body's axes in v (see [`Coordinate::floating`]). Good everywhere.
    #[default]
    Quaternion,
    /// Six coordinates of one number each, whose velocities are their rates. Not where the roll axis is vertical.
    Angles(Angles),
}

impl PoseForm {
    /// The coordinates of a joint that floats.
    pub(crate) fn coordinates(self, joint: &str) -> Vec<Coordinate> {
        let of = |name: String, angular: bool, wraps: bool, floating: bool| Coordinate {
            name,
            joint: joint.to_owned(),
            angular,
            wraps,
            floating,
        };
        match self {
            PoseForm::Quaternion => vec![of(joint.to_owned(), false, false, true)],
            PoseForm::Angles(_) => {
                let named = Angles::NAMES.iter().enumerate();
                let single = |(k, name)| {
                    let wraps = matches!(k, 3 | 5);
                    of(format!("{joint}.{name}"), k >= 3, wraps, false)
                };
                named.map(single).collect()
            }
        }
    }
}

/// A pose as position and angles: p = (x, y, z) and R = R_z(yaw) R_y(pitch) R_x(roll) P, where p is the origin of the moved frame and R takes its axes to
/// those of the frame that it floats in; P permutes the body's axes cyclically, so that the [`roll_axis`](Self::roll_axis) is the first.
///
/// Yaw is about z, which is vertical for a floating base; then pitch; then roll about an axis of the body. Where that axis is along z, yaw and roll are the same
/// and the rates of some motions infinite: [`steepness`](Self::steepness) tells how far it is from there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Angles {
    /// The axis of the body that roll is about.
    pub roll_axis: Axis,
}

/// An axis of a body's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Axis {
    /// The first.
    #[default]
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl Axis {
    /// All three.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// `x`, `y` or `z`.
    pub fn name(self) -> &'static str {
        match self {
            Axis::X => "x",
            Axis::Y => "y",
            Axis::Z => "z",
        }
    }
}

/// y, z and x as the first, second and third axis.
pub(super) fn next_axes() -> Rotation3<f64> {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y, z, x]))
}

impl Angles {
    /// The suffixes of the coordinates' names, in their order: `base.x` to `base.roll`. m, then rad.
    pub const NAMES: [&'static str; 6] = ["x", "y", "z", "yaw", "pitch", "roll"];

    /// P: takes the roll axis to x.
    fn permutation(self) -> Rotation3<f64> {
        match self.roll_axis {
            Axis::X => Rotation3::identity(),
            Axis::Y => next_axes().inverse(),
            Axis::Z => next_axes(),
        }
    }

    /// The axes, in the body's frame, of a frame whose z is the roll axis.
    pub(super) fn last_frame(self) -> Rotation3<f64> {
        self.permutation().inverse() * next_axes()
    }

    fn permuted(self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_rotation_matrix(&self.permutation())
    }

    /// The sine of the angle between the roll axis and z: |cos pitch|, 0 where these angles fail.
    ///
    /// `pose` is position and quaternion w x y z, which need not be of length 1.
    pub fn steepness(self, pose: &[f64; 7]) -> f64 {
        let axis = self.permutation().inverse() * Vector3::x();
        let carried = turn_of(pose) * axis;
        carried.x.hypot(carried.y)
    }

    /// x, y, z, yaw, pitch and roll of a pose; pitch in [−π/2, π/2], yaw and roll in [−π, π].
    ///
    /// ```
    /// use lagrange::mechanism::Angles;
    ///
    /// // A quarter turn to the left.
    /// let half = 0.5_f64.sqrt();
    /// let found = Angles::default().of_pose(&[1.0, 2.0, 3.0, half, 0.0, 0.0, half]);
    /// assert_eq!(found[..3], [1.0, 2.0, 3.0]);
    /// assert!((found[3] - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    /// ```
    pub fn of_pose(self, pose: &[f64; 7]) -> [f64; 6] {
        let (roll, pitch, yaw) = (turn_of(pose) * self.permuted().inverse()).euler_angles();
        [pose[0], pose[1], pose[2], yaw, pitch, roll]
    }

    /// Position and quaternion w x y z at these coordinates.
    pub fn pose(self, at: &[f64; 6]) -> [f64; 7] {
        let [x, y, z, yaw, pitch, roll] = *at;
        let turn = UnitQuaternion::from_euler_angles(roll, pitch, yaw) * self.permuted();
        [x, y, z, turn.w, turn.i, turn.j, turn.k]
    }

    /// The rates of the coordinates of a body at `pose` that moves with the `twist` (v, ω) in its own axes; infinite or not a number where the angles fail:
    ///
    /// ṗ = R v; with ω' = P ω: yaẇ = (ω'_y sin roll + ω'_z cos roll)/cos pitch, pitcḣ = ω'_y cos roll − ω'_z sin roll,
    /// roll̇ = ω'_x + yaẇ sin pitch.
    pub fn rates(self, pose: &[f64; 7], twist: &[f64; 6]) -> [f64; 6] {
        let [.., pitch, roll] = self.of_pose(pose);
        let velocity = turn_of(pose) * Vector3::from_column_slice(&twist[..3]);
        let w = self.permutation() * Vector3::from_column_slice(&twist[3..]);
        let (sin, cos) = roll.sin_cos();
        let yaw = (w.y * sin + w.z * cos) / pitch.cos();
        [
            velocity.x,
            velocity.y,
            velocity.z,
            yaw,
            w.y * cos - w.z * sin,
            w.x + yaw * pitch.sin(),
        ]
    }

    /// The twist (v, ω), in the body's axes, at these coordinates and rates: the inverse of [`rates`](Self::rates).
    pub fn twist(self, at: &[f64; 6], rates: &[f64; 6]) -> [f64; 6] {
        let [.., pitch, roll] = *at;
        let [.., yaw_rate, pitch_rate, roll_rate] = *rates;
        let velocity = turn_of(&self.pose(at)).inverse() * Vector3::from_column_slice(&rates[..3]);
        let ((sin, cos), cos_pitch) = (roll.sin_cos(), pitch.cos());
        let w = Vector3::new(
            roll_rate - yaw_rate * pitch.sin(),
            pitch_rate * cos + yaw_rate * cos_pitch * sin,
            yaw_rate * cos_pitch * cos - pitch_rate * sin,
        );
        let w = self.permutation().inverse() * w;
        [velocity.x, velocity.y, velocity.z, w.x, w.y, w.z]
    }
}

fn turn_of(pose: &[f64; 7]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(pose[3], pose[4], pose[5], pose[6]))
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    use super::*;
    use crate::state;

    fn floating() -> Vec<Coordinate> {
        PoseForm::Quaternion.coordinates("base")
    }

    fn all() -> impl Strategy<Value = Angles> {
        (0..3_usize).prop_map(|k| Angles {
            roll_axis: Axis::ALL[k],
        })
    }

    proptest! {
        #[test]
        fn a_pose_comes_back_from_its_angles(angles in all(), draws in proptest::array::uniform7(0.0..1.0)) {
            let mut draws = draws.into_iter();
            let pose: [f64; 7] = state::random(&floating(), || draws.next().unwrap_or(0.5)).try_into().unwrap();
            let again = angles.pose(&angles.of_pose(&pose));
            let apart = state::difference(&floating(), &pose, &again).unwrap();
            prop_assert!(apart.iter().all(|d| d.abs() < 1e-7), "{apart:?}");
        }

        /// The rates against differences of the angles along a short motion.
        #[test]
        fn rates_are_those_of_a_motion(
            angles in all(),
            draws in proptest::array::uniform7(0.0..1.0),
            twist in proptest::array::uniform6(-1.0..1.0),
        ) {
            let mut draws = draws.into_iter();
            let pose: [f64; 7] = state::random(&floating(), || draws.next().unwrap_or(0.5)).try_into().unwrap();
            prop_assume!(angles.steepness(&pose) > 0.1);
            let h = 1e-5;
            let moved = |h: f64| -> [f64; 6] {
                let motion: Vec<f64> = twist.iter().map(|x| h * x).collect();
                let there = state::integrate(&floating(), &pose, &motion).unwrap();
                angles.of_pose(&there.try_into().unwrap())
            };
            let (ahead, behind) = (moved(h), moved(-h));
            let rates = angles.rates(&pose, &twist);
            for k in 0..6 {
                let turns = ((ahead[k] - behind[k]) / std::f64::consts::TAU).round();
                let apart = ahead[k] - behind[k] - turns * std::f64::consts::TAU;
                assert_relative_eq!(apart / (2.0 * h), rates[k], epsilon = 1e-6, max_relative = 1e-5);
            }
            let again = angles.twist(&angles.of_pose(&pose), &rates);
            for (found, expected) in again.iter().zip(twist) {
                assert_relative_eq!(*found, expected, epsilon = 1e-11);
            }
        }
    }

    #[test]
    fn the_roll_axis_must_not_be_vertical() {
        let (half, z) = (0.5_f64.sqrt(), 0.0);
        let level = [z, z, z, 1.0, z, z, z];
        let nose_up = [z, z, z, half, z, -half, z];
        let of = |pose| Axis::ALL.map(|roll_axis| Angles { roll_axis }.steepness(pose));
        assert_eq!(of(&level), [1.0, 1.0, 0.0]);
        let [x, y, z] = of(&nose_up);
        assert!(x < 1e-15 && (y - 1.0).abs() < 1e-15 && (z - 1.0).abs() < 1e-15);
    }
}
