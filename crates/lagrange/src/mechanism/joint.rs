//! Joints: what lets one link move against another.

use std::collections::HashMap;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{Placement, PoseForm};
use crate::{Coordinate, Problem};

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
    /// The joint's frame, which is the child link's at joint position 0, in the parent link's.
    pub origin: Placement,
    /// Axis of rotation or translation, or normal of the plane, of length 1, in the joint's frame. Not used by fixed and floating
    /// joints.
    pub axis: Vector3<f64>,
    /// Range and ratings, where given.
    pub limits: Option<Limits>,
    /// Viscous damping, N·m·s/rad or N·s/m: Q = −damping · v. Without a meaning, and not used, for planar and floating joints.
    pub damping: f64,
    /// Coulomb friction, N·m or N: |Q| at any speed.
    pub friction: f64,
    /// The joint that this one follows, where the model says so (even where it is ignored).
    pub mimic: Option<Mimic>,
    /// Index, among the tree's coordinates, of the one that moves it: its own (the first of three, for a planar joint), or its
    /// leader's; none for fixed joints.
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
    /// Displacement in the plane normal to the axis, then rotation about the axis: three coordinates `<joint>.x`, `<joint>.y` (m)
    /// and `<joint>.theta` (rad).
    ///
    /// The displacement is measured on the parent's side, along the joint frame's x and y after the smallest rotation that takes its
    /// z to the axis: along x and y themselves for the axis z, along −z and y for the axis x, along x and −z for the axis y, along
    /// x and −y for the axis −z. The velocities are the rates of the coordinates.
    Planar,
    /// Any motion: one coordinate entry, with seven numbers in q and six in v (see [`Coordinate::floating`]), or six of one number each
    /// where the tree is read with [`PoseForm::Angles`].
    Floating,
}

impl JointKind {
    /// Whether it has one coordinate, an angle.
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
            JointKind::Planar => "planar",
            JointKind::Floating => "floating",
        }
    }
    /// Whether it has one coordinate: whether it can follow another joint and be followed.
    pub fn is_single(self) -> bool {
        matches!(
            self,
            JointKind::Revolute | JointKind::Continuous | JointKind::Prismatic
        )
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

/// A joint on the way into `Tree::assemble`, with the indices of its links.
pub(crate) struct JointSpec {
    pub joint: Joint,
    pub parent: usize,
    pub child: usize,
}

/// How a joint moves: position = ratio · coordinate + offset.
#[derive(Clone, Copy)]
pub(crate) struct Drive {
    /// Index of its first coordinate, and first indices in q and v.
    pub coordinate: usize,
    pub q: usize,
    pub v: usize,
    pub ratio: f64,
    pub offset: f64,
    pub follows: bool,
}

impl Drive {
    /// By the coordinate that comes after those of `list`.
    pub fn next(list: &[Coordinate]) -> Self {
        Drive {
            coordinate: list.len(),
            q: list.iter().map(Coordinate::nq).sum(),
            v: list.iter().map(Coordinate::nv).sum(),
            ratio: 1.0,
            offset: 0.0,
            follows: false,
        }
    }
}

/// The coordinates that a joint has when it follows none.
fn own_coordinates(joint: &Joint, form: PoseForm) -> Vec<Coordinate> {
    let single = |suffix: &str, angular: bool, wraps: bool| Coordinate {
        name: format!("{}{suffix}", joint.name),
        joint: joint.name.clone(),
        angular,
        wraps,
        floating: false,
    };
    match joint.kind {
        JointKind::Fixed => Vec::new(),
        JointKind::Revolute => vec![single("", true, false)],
        JointKind::Continuous => vec![single("", true, true)],
        JointKind::Prismatic => vec![single("", false, false)],
        JointKind::Planar => vec![
            single(".x", false, false),
            single(".y", false, false),
            single(".theta", true, true),
        ],
        JointKind::Floating => form.coordinates(&joint.name),
    }
}

/// The coordinates in the order of the joints, after those that there are (a free base), and what drives each joint; chains of mimics
/// are composed.
pub(crate) fn coordinates(
    mut list: Vec<Coordinate>,
    joints: &[JointSpec],
    (follow, form): (bool, PoseForm),
) -> Result<(Vec<Coordinate>, Vec<Option<Drive>>), Problem> {
    fn followed(joint: &Joint, follow: bool) -> Option<&Mimic> {
        let single = joint.kind.is_single();
        joint.mimic.as_ref().filter(|_| follow && single)
    }
    let by_name: HashMap<&str, usize> = joints
        .iter()
        .enumerate()
        .map(|(j, spec)| (spec.joint.name.as_str(), j))
        .collect();
    let mut drives: Vec<Option<Drive>> = Vec::with_capacity(joints.len());
    let mut next = Drive::next(&list);
    for JointSpec { joint, .. } in joints {
        let moves = joint.kind != JointKind::Fixed && followed(joint, follow).is_none();
        drives.push(moves.then_some(next));
        if moves {
            for coordinate in own_coordinates(joint, form) {
                next.coordinate += 1;
                next.q += coordinate.nq();
                next.v += coordinate.nv();
                list.push(coordinate);
            }
        }
    }
    for j in 0..joints.len() {
        // Up the chain of leaders: q = a · leader + b.
        let (mut a, mut b, mut at, mut steps) = (1.0, 0.0, j, 0);
        while let Some(mimic) = followed(&joints[at].joint, follow) {
            b += a * mimic.offset;
            a *= mimic.multiplier;
            at = *by_name.get(mimic.leader.as_str()).ok_or_else(not_a_tree)?;
            steps += 1;
            if steps > joints.len() {
                return Err(not_a_tree());
            }
        }
        if steps > 0 {
            let single = joints[at].joint.kind.is_single();
            let leader = drives[at].filter(|_| single).ok_or_else(not_a_tree)?;
            drives[j] = Some(Drive {
                ratio: a,
                offset: b,
                follows: true,
                ..leader
            });
        }
    }
    Ok((list, drives))
}

/// A rotation that takes z to `axis`; exact where the axis is a coordinate axis.
pub(crate) fn z_to(axis: &Vector3<f64>) -> Rotation3<f64> {
    let columns = |x: Vector3<f64>, y: Vector3<f64>| {
        Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]))
    };
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    match (axis.x, axis.y, axis.z) {
        (0.0, 0.0, 1.0) => Rotation3::identity(),
        (0.0, 0.0, -1.0) => columns(x, -y),
        (0.0, 1.0, 0.0) => columns(z, x),
        (0.0, -1.0, 0.0) => columns(x, z),
        (1.0, 0.0, 0.0) => columns(y, z),
        (-1.0, 0.0, 0.0) => columns(z, y),
        _ => Rotation3::rotation_between(&z, axis).unwrap_or_else(|| columns(x, -y)),
    }
}

/// The smallest rotation that takes z to `axis`, about x for −z; exact where the axis is a coordinate axis.
pub(crate) fn plane_of(axis: &Vector3<f64>) -> Rotation3<f64> {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let columns = |x, y| Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, *axis]));
    match (axis.x, axis.y, axis.z) {
        (0.0, 0.0, 1.0) => Rotation3::identity(),
        (0.0, 0.0, -1.0) => columns(x, -y),
        (1.0, 0.0, 0.0) => columns(-z, y),
        (-1.0, 0.0, 0.0) => columns(z, y),
        (0.0, 1.0, 0.0) => columns(x, -z),
        (0.0, -1.0, 0.0) => columns(x, z),
        _ => Rotation3::rotation_between(&z, axis).unwrap_or_else(|| columns(x, -y)),
    }
}

pub(crate) fn not_a_tree() -> Problem {
    Problem::general(
        "the joints do not connect all links to one root as a tree, or a mimic joint has no leader of one coordinate",
    )
}
