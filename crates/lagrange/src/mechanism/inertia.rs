//! Mass, centre of mass and rotational inertia of a rigid body.

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::Placement;

/// The inertia of a rigid body, expressed in and about the origin of one frame.
///
/// Kept as mass m, first moment h = m c and the rotational inertia about the *origin*, because in this form bodies that are
/// welded together add, entry by entry.
///
/// ```
/// use lagrange::mechanism::Inertia;
/// use nalgebra::{Isometry3, Matrix3, Vector3};
///
/// // A dumb-bell: two point masses of 1 kg, 0.5 m to either side of the origin.
/// let point = Inertia::about_centre(1.0, Vector3::zeros(), Matrix3::zeros());
/// let dumb_bell = point.in_frame(&Isometry3::translation(0.5, 0.0, 0.0)) + point.in_frame(&Isometry3::translation(-0.5, 0.0, 0.0));
/// assert_eq!(dumb_bell.mass, 2.0);
/// assert_eq!(dumb_bell.centre(), Vector3::zeros());
/// assert_eq!(dumb_bell.rotational[(2, 2)], 2.0 * 0.25);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Mass m, kg.
    pub mass: f64,
    /// First moment of mass h = m c, kg·m, with c from the frame's origin to the centre of mass.
    pub moment: Vector3<f64>,
    /// Rotational inertia about the frame's origin, kg·m².
    pub rotational: Matrix3<f64>,
}

impl Inertia {
    /// No mass at all.
    pub fn zero() -> Self {
        Inertia {
            mass: 0.0,
            moment: Vector3::zeros(),
            rotational: Matrix3::zeros(),
        }
    }

    /// From the mass, the centre of mass and the rotational inertia about that centre (in the frame's axes).
    ///
    /// Parallel-axis theorem: I_origin = I_centre + m (c·c 1 − c cᵀ).
    pub fn about_centre(mass: f64, centre: Vector3<f64>, rotational: Matrix3<f64>) -> Self {
        Inertia {
            mass,
            moment: centre * mass,
            rotational: rotational + parallel_axis(mass, &centre),
        }
    }

    /// The same body seen from another frame; `pose` is the pose of this frame in that one.
    ///
    /// With h' = R h: h_new = h' + m p and I_new = R I Rᵀ + 2 (p·h') 1 − p h'ᵀ − h' pᵀ + m (p·p 1 − p pᵀ).
    #[must_use]
    pub fn in_frame(&self, pose: &Isometry3<f64>) -> Self {
        let rotation = pose.rotation.to_rotation_matrix();
        self.rotated(rotation.matrix())
            .shifted(&pose.translation.vector)
    }

    /// The same body in a frame of the same origin; `rotation` takes this frame's components to that one's.
    pub(crate) fn rotated(&self, rotation: &Matrix3<f64>) -> Self {
        let turned = rotation * self.rotational * rotation.transpose();
        Inertia {
            mass: self.mass,
            moment: rotation * self.moment,
            rotational: (turned + turned.transpose()) * 0.5,
        }
    }

    /// The same body in a frame of the same axes in which this frame's origin stands at `p`.
    pub(crate) fn shifted(&self, p: &Vector3<f64>) -> Self {
        let h = &self.moment;
        let cross = Matrix3::identity() * (2.0 * p.dot(h)) - p * h.transpose() - h * p.transpose();
        Inertia {
            mass: self.mass,
            moment: h + p * self.mass,
            rotational: self.rotational + cross + parallel_axis(self.mass, p),
        }
    }

    /// Centre of mass, m; the origin for a body without mass.
    pub fn centre(&self) -> Vector3<f64> {
        if self.mass > 0.0 {
            self.moment / self.mass
        } else {
            Vector3::zeros()
        }
    }

    /// Rotational inertia about the centre of mass, kg·m².
    pub fn rotational_about_centre(&self) -> Matrix3<f64> {
        self.rotational - parallel_axis(self.mass, &self.centre())
    }

    /// Whether there is anything to accelerate: mass, or inertia without mass.
    pub fn is_zero(&self) -> bool {
        self.mass == 0.0 && self.rotational == Matrix3::zeros()
    }
}

/// The inertia of a link, as URDF gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertial {
    /// Centre of mass, and axes of the inertia, in the link's frame.
    pub origin: Placement,
    /// Mass, kg.
    pub mass: f64,
    /// ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, kg·m².
    pub inertia: [f64; 6],
}

impl Inertial {
    /// In and about the origin of the link's frame.
    pub fn in_link(&self) -> Inertia {
        let [xx, xy, xz, yy, yz, zz] = self.inertia;
        let matrix = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        Inertia::about_centre(self.mass, Vector3::zeros(), matrix).in_frame(&self.origin.pose())
    }
}

/// m (p·p 1 − p pᵀ).
fn parallel_axis(mass: f64, p: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * p.dot(p) - p * p.transpose()) * mass
}

impl std::ops::Add for Inertia {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Inertia {
            mass: self.mass + other.mass,
            moment: self.moment + other.moment,
            rotational: self.rotational + other.rotational,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::{Translation3, UnitQuaternion};

    /// m/12 (b² + c²), … of a box with sides along the axes.
    fn cuboid(mass: f64, a: f64, b: f64, c: f64) -> Matrix3<f64> {
        let (a, b, c) = (a * a, b * b, c * c);
        Matrix3::from_diagonal(&Vector3::new(b + c, a + c, a + b)) * (mass / 12.0)
    }

    #[test]
    fn two_half_bricks_make_a_brick() {
        let half = Inertia::about_centre(1.5, Vector3::zeros(), cuboid(1.5, 0.2, 0.3, 0.1));
        let pair = half.in_frame(&Isometry3::translation(0.1, 0.0, 0.0))
            + half.in_frame(&Isometry3::translation(-0.1, 0.0, 0.0));
        let whole = Inertia::about_centre(3.0, Vector3::zeros(), cuboid(3.0, 0.4, 0.3, 0.1));
        assert_relative_eq!(pair.rotational, whole.rotational, epsilon = 1e-15);
        assert_relative_eq!(pair.moment, whole.moment, epsilon = 1e-15);
    }

    #[test]
    fn a_quarter_turn_swaps_two_moments() {
        let inertia = Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, 2.5));
        let body = Inertia::about_centre(1.0, Vector3::new(0.3, 0.0, 0.0), inertia);
        let quarter = Isometry3::rotation(Vector3::z() * std::f64::consts::FRAC_PI_2);
        let turned = body.in_frame(&quarter);
        assert_relative_eq!(
            turned.centre(),
            Vector3::new(0.0, 0.3, 0.0),
            epsilon = 1e-15
        );
        assert_relative_eq!(
            turned.rotational_about_centre(),
            Matrix3::from_diagonal(&Vector3::new(2.0, 1.0, 2.5)),
            epsilon = 1e-14
        );
    }

    #[test]
    fn moving_the_frame_there_and_back_changes_nothing() {
        let body = Inertia::about_centre(
            2.0,
            Vector3::new(0.1, -0.2, 0.3),
            cuboid(2.0, 0.1, 0.2, 0.3),
        );
        let pose = Isometry3::from_parts(
            Translation3::new(1.0, 2.0, -3.0),
            UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0),
        );
        let back = body.in_frame(&pose).in_frame(&pose.inverse());
        assert_relative_eq!(back.rotational, body.rotational, epsilon = 1e-12);
        assert_relative_eq!(back.centre(), body.centre(), epsilon = 1e-14);
    }

    #[test]
    fn the_inertia_about_the_centre_does_not_depend_on_where_the_origin_is() {
        let inertia = cuboid(2.0, 0.1, 0.2, 0.3);
        let body = Inertia::about_centre(2.0, Vector3::new(5.0, -4.0, 3.0), inertia);
        assert_relative_eq!(body.rotational_about_centre(), inertia, epsilon = 1e-13);
    }
}
