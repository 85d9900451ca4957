//! Joints: what lets one link move against another.

use nalgebra::Vector3;

/// A joint between two links, as the model's source gives it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Joint {
    /// Name.
    pub name: String,
    /// What motion it allows.
    pub kind: JointKind,
    /// The link on the base's side.
    pub parent: String,
    /// The link that it moves.
    pub child: String,
    /// Axis of rotation or translation, of length 1, in the joint's frame. Not used by fixed joints.
    pub axis: Vector3<f64>,
    /// Range and ratings, where given.
    pub limits: Option<Limits>,
    /// Viscous damping, N·m·s/rad or N·s/m: Q = −damping · v.
    pub damping: f64,
    /// Coulomb friction, N·m or N: |Q| at any speed.
    pub friction: f64,
    /// The joint that this one follows, where the model says so (even where it is ignored).
    pub mimic: Option<Mimic>,
    /// Index of the coordinate that moves it: its own, or its leader's; none for fixed joints.
    pub coordinate: Option<usize>,
    /// d(joint position)/d(coordinate): 1 unless the joint follows another.
    pub ratio: f64,
    /// Joint position at coordinate 0, rad or m: 0 unless the joint follows another.
    pub offset: f64,
    /// Whether the coordinate is a leader's.
    pub follows: bool,
}

impl Joint {
    /// Whether the joint has a coordinate of its own: neither fixed nor moved by a leader's.
    pub fn is_independent(&self) -> bool {
        self.coordinate.is_some() && !self.follows
    }
}

/// The motion that a joint allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum JointKind {
    /// None.
    Fixed,
    /// Rotation about the axis, with a range.
    Revolute,
    /// Rotation about the axis, without end.
    Continuous,
    /// Translation along the axis.
    Prismatic,
}

impl JointKind {
    /// Whether its coordinate is an angle.
    pub fn is_angular(self) -> bool {
        matches!(self, JointKind::Revolute | JointKind::Continuous)
    }
    /// The URDF's word for it.
    pub fn name(self) -> &'static str {
        match self {
            JointKind::Fixed => "fixed",
            JointKind::Revolute => "revolute",
            JointKind::Continuous => "continuous",
            JointKind::Prismatic => "prismatic",
        }
    }
}

/// Range and ratings of a joint; infinite where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lowest position, rad or m.
    pub lower: f64,
    /// Highest position, rad or m.
    pub upper: f64,
    /// Greatest force, N·m or N.
    pub effort: f64,
    /// Greatest speed, rad/s or m/s.
    pub velocity: f64,
}

/// A joint follows another: position = multiplier · leader's position + offset.
#[derive(Debug, Clone, PartialEq)]
pub struct Mimic {
    /// The joint that is followed.
    pub leader: String,
    /// Multiplier.
    pub multiplier: f64,
    /// Offset, rad or m.
    pub offset: f64,
}
