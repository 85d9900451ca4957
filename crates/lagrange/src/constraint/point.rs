//! The position of a point of a link, over any scalar.

use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::mechanism::{JointKind, Tree};
use crate::{Error, Lagrangian, Scalar};

/// A point of a link and the joints between it and the world, from the point inward.
#[derive(Debug, Clone)]
pub(super) struct PointOfLink {
    /// In the frame of the last joint's child.
    point: Vector3<f64>,
    joints: Vec<Moving>,
}

/// A joint that moves: its child's frame is `at_zero` · motion(axis, ratio · q) in the frame of the next joint's child, or the world's.
#[derive(Debug, Clone)]
struct Moving {
    axis: Vector3<f64>,
    turns: bool,
    coordinate: usize,
    ratio: f64,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

impl PointOfLink {
    /// `point` in the frame of the link of index `link`, m.
    pub fn new(tree: &Tree, link: usize, point: [f64; 3]) -> Result<Self, Error> {
        let poses = tree.link_poses(&vec![0.0; tree.dof()])?;
        let index = |name: &str| tree.links().iter().position(|l| l.name == name);
        let mut joints: Vec<Moving> = Vec::new();
        let mut point = Vector3::from(point);
        // Pose of what has been passed in the frame of the present link.
        let mut passed = Isometry3::identity();
        let mut at = link;
        while let Some(link) = tree.links().get(at)
            && let Some(joint) = tree.joints().iter().find(|j| j.child == link.name)
            && let Some(parent) = index(&joint.parent)
        {
            let (Some(outer), Some(inner)) = (poses.get(parent), poses.get(at)) else {
                break;
            };
            if let (Some(coordinate), true) = (joint.coordinate, joint.kind != JointKind::Fixed) {
                match joints.last_mut() {
                    Some(last) => last.place(&passed),
                    None => point = (passed * nalgebra::Point3::from(point)).coords,
                }
                passed = Isometry3::identity();
                joints.push(Moving {
                    axis: joint.axis,
                    turns: joint.kind.is_angular(),
                    coordinate,
                    ratio: joint.ratio,
                    rotation: Matrix3::identity(),
                    translation: Vector3::zeros(),
                });
            }
            passed = outer.inv_mul(inner) * passed;
            at = parent;
        }
        // The root link is the world.
        match joints.last_mut() {
            Some(last) => last.place(&passed),
            None => point = (passed * nalgebra::Point3::from(point)).coords,
        }
        Ok(PointOfLink { point, joints })
    }

    /// In the world at `q`, m.
    pub fn position<D: Scalar>(&self, q: &[D]) -> [D; 3] {
        let mut p = [self.point.x, self.point.y, self.point.z].map(D::constant);
        for joint in &self.joints {
            p = joint.carry(&p, q[joint.coordinate] * joint.ratio);
        }
        p
    }
}

impl Moving {
    fn place(&mut self, at_zero: &Isometry3<f64>) {
        self.rotation = *at_zero.rotation.to_rotation_matrix().matrix();
        self.translation = at_zero.translation.vector;
    }

    /// The point `p` of the child, in the frame that carries the joint.
    fn carry<D: Scalar>(&self, p: &[D; 3], position: D) -> [D; 3] {
        let u = &self.axis;
        let moved = if self.turns {
            // p cos + (u × p) sin + u (u·p) (1 − cos)
            let (sin, cos) = position.sin_cos();
            let along = (p[0] * u.x + p[1] * u.y + p[2] * u.z) * (-cos + 1.0);
            let across = [
                p[2] * u.y - p[1] * u.z,
                p[0] * u.z - p[2] * u.x,
                p[1] * u.x - p[0] * u.y,
            ];
            [0, 1, 2].map(|i| p[i] * cos + across[i] * sin + along * u[i])
        } else {
            [0, 1, 2].map(|i| p[i] + position * u[i])
        };
        let r = &self.rotation;
        [0, 1, 2].map(|i| {
            moved[0] * r[(i, 0)] + moved[1] * r[(i, 1)] + moved[2] * r[(i, 2)] + self.translation[i]
        })
    }
}
