//! Where one frame stands in another, in the numbers of the source.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// A frame in another one, as URDF gives it.
///
/// ```
/// use lagrange::mechanism::Placement;
///
/// let quarter = Placement { xyz: [1.0, 0.0, 0.0], rpy: [0.0, 0.0, std::f64::consts::FRAC_PI_2] };
/// let point = quarter.pose() * nalgebra::point![2.0, 0.0, 0.0];
/// assert!((point - nalgebra::point![1.0, 2.0, 0.0]).norm() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Placement {
    /// Its origin, m.
    pub xyz: [f64; 3],
    /// Roll, pitch and yaw, rad: turned about the fixed axes x, y, z, in this order.
    pub rpy: [f64; 3],
}

impl Placement {
    /// As a rigid motion: takes coordinates in the frame to those in the other.
    pub fn pose(&self) -> Isometry3<f64> {
        let [roll, pitch, yaw] = self.rpy;
        Isometry3::from_parts(
            Translation3::from(Vector3::from(self.xyz)),
            UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        )
    }
}
