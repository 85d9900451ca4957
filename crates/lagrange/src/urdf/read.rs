//! From the text to the tree.

use nalgebra::Vector3;

use super::report::{Report, shown};
use super::source::{self, Source};
use super::validate::validate;
use super::xml;
use super::{JointDynamics, Options, Urdf};
use crate::mechanism::{
    Inertial, Joint, JointKind, JointSpec, Limits, LinkSpec, Mimic, Placement, Tree,
};
use crate::{Lagrangian, Problem};

pub fn read(text: &str, options: &Options) -> Result<Urdf, Vec<Problem>> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut report = Report::new(text);
    if options.gravity.iter().any(|g| !g.is_finite()) {
        report.error(
            0,
            format!(
                "gravity is {:?}: every entry must be finite",
                options.gravity
            ),
        );
    }
    let Some(document) = xml::parse(text, &mut report) else {
        return Err(report.into_errors());
    };
    let source = source::collect(&document, &mut report);
    if !source.abandoned {
        validate(&source, options, &mut report);
    }
    if report.failed() {
        return Err(report.into_errors());
    }

    let robot = match urdf_rs::read_from_string(text) {
        Ok(robot) => robot,
        Err(error) => {
            report.error(0, format!("not a URDF: {error}"));
            return Err(report.into_errors());
        }
    };
    // Two parsers have read the text: they must agree on what there is.
    if robot.links.len() != source.links.len()
        || robot.joints.len() != source.joints.len()
        || robot
            .links
            .iter()
            .zip(&source.links)
            .any(|(a, b)| a.name != b.name.value)
        || robot
            .joints
            .iter()
            .zip(&source.joints)
            .any(|(a, b)| a.name != b.name.value)
    {
        report.error(0, "the links and joints cannot be told apart: remove namespaces and unusual XML from the file");
        return Err(report.into_errors());
    }
    let tree = tree(&robot, &source, options).map_err(|problem| vec![problem])?;
    still(&tree, &source, &mut report);
    if report.failed() {
        return Err(report.into_errors());
    }
    Ok(Urdf {
        name: robot.name,
        joint_dynamics: joint_dynamics(&tree),
        tree,
        warnings: report.into_warnings(),
    })
}

fn tree(robot: &urdf_rs::Robot, source: &Source, options: &Options) -> Result<Tree, Problem> {
    let links: Vec<LinkSpec> = robot
        .links
        .iter()
        .zip(&source.links)
        .map(|(link, text)| LinkSpec {
            name: link.name.clone(),
            inertial: text.inertial.as_ref().map(|_| inertial(&link.inertial)),
        })
        .collect();
    let index: std::collections::HashMap<&str, usize> = robot
        .links
        .iter()
        .enumerate()
        .map(|(i, link)| (link.name.as_str(), i))
        .collect();
    let find = |name: &str| {
        index
            .get(name)
            .copied()
            .ok_or_else(|| Problem::general(format!("there is no link {}", shown(name))))
    };
    let joints: Vec<JointSpec> = robot
        .joints
        .iter()
        .zip(&source.joints)
        .map(|(joint, text)| {
            Ok(JointSpec {
                parent: find(&joint.parent.link)?,
                child: find(&joint.child.link)?,
                joint: self::joint(joint, text.limit.is_some())?,
            })
        })
        .collect::<Result<_, Problem>>()?;
    let rest = (!options.ignore_mimic, options.pose);
    Tree::assemble(
        &links,
        &joints,
        options.gravity,
        options.floating_base,
        rest,
    )
}

fn placement(pose: &urdf_rs::Pose) -> Placement {
    Placement {
        xyz: pose.xyz.0,
        rpy: pose.rpy.0,
    }
}

fn inertial(inertial: &urdf_rs::Inertial) -> Inertial {
    let i = &inertial.inertia;
    Inertial {
        origin: placement(&inertial.origin),
        mass: inertial.mass.value,
        inertia: [i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz],
    }
}

fn joint(joint: &urdf_rs::Joint, has_limit: bool) -> Result<Joint, Problem> {
    let kind = match joint.joint_type {
        urdf_rs::JointType::Fixed => JointKind::Fixed,
        urdf_rs::JointType::Revolute => JointKind::Revolute,
        urdf_rs::JointType::Continuous => JointKind::Continuous,
        urdf_rs::JointType::Prismatic => JointKind::Prismatic,
        urdf_rs::JointType::Planar => JointKind::Planar,
        urdf_rs::JointType::Floating => JointKind::Floating,
        urdf_rs::JointType::Spherical => {
            return Err(Problem::general(format!(
                "joint {} is spherical, which is not read",
                shown(&joint.name)
            )));
        }
    };
    // Divided by the largest entry first: a length neither overflows nor vanishes.
    let axis = Vector3::from(joint.axis.xyz.0);
    let largest = axis.amax();
    let axis = if (axis.norm_squared() - 1.0).abs() <= 4.0 * f64::EPSILON {
        axis // of length 1 as it is: what was written by this crate is read as the same
    } else if largest > 0.0 {
        (axis / largest).normalize()
    } else {
        Vector3::x()
    };
    let limit = &joint.limit;
    let dynamics = joint.dynamics.clone().unwrap_or_default();
    Ok(Joint {
        name: joint.name.clone(),
        kind,
        parent: joint.parent.link.clone(),
        child: joint.child.link.clone(),
        origin: placement(&joint.origin),
        axis,
        limits: has_limit.then_some(Limits {
            lower: limit.lower,
            upper: limit.upper,
            effort: limit.effort,
            velocity: limit.velocity,
        }),
        damping: dynamics.damping,
        friction: dynamics.friction,
        mimic: joint.mimic.as_ref().map(|mimic| Mimic {
            leader: mimic.joint.clone(),
            multiplier: mimic.multiplier.unwrap_or(1.0),
            offset: mimic.offset.unwrap_or(0.0),
        }),
        coordinate: None,
        ratio: 1.0,
        offset: 0.0,
        follows: false,
    })
}

/// Reports coordinates along which nothing has inertia, wherever the mechanism stands: point masses on the axis.
fn still(tree: &Tree, source: &Source, report: &mut Report) {
    let n = tree.nv();
    // The test costs n evaluations of T; large trees are left to the mass matrix's own check.
    if n > 256 {
        return;
    }
    let mut q: Vec<f64> = (0..tree.nq())
        .map(|i| 0.3 + 0.7 * (i as f64 * 1.7).sin())
        .collect();
    crate::state::normalize(tree.coordinates(), &mut q);
    let mut first = 0;
    for coordinate in tree.coordinates() {
        let own = first..first + coordinate.nv();
        first = own.end;
        let energy = own
            .map(|i| {
                let v: Vec<f64> = (0..n).map(|j| f64::from(u8::from(i == j))).collect();
                tree.kinetic(&q, &v)
            })
            .find(|energy| !(*energy > 0.0 && energy.is_finite()));
        let Some(energy) = energy else { continue };
        let at = source
            .joints
            .iter()
            .find(|j| j.name.value == coordinate.joint)
            .map(|j| (j.name.at, format!("joint {}", shown(&coordinate.joint))));
        let (at, what) = at.unwrap_or((0, "the floating base".to_owned()));
        report.error(at, if energy.is_finite() {
            format!("{what} moves no inertia, all mass that it turns lies on its axis: there is nothing to accelerate; give the links an inertia")
        } else {
            format!("{what}: the kinetic energy overflows; masses, inertias or lengths are too large")
        });
    }
}

fn joint_dynamics(tree: &Tree) -> Vec<JointDynamics> {
    tree.joints()
        .iter()
        .filter(|joint| joint.kind.is_single())
        .filter(|joint| joint.damping != 0.0 || joint.friction != 0.0)
        .filter_map(|joint| {
            Some(JointDynamics {
                joint: joint.name.clone(),
                coordinate: joint.coordinate?,
                ratio: joint.ratio,
                damping: joint.damping,
                friction: joint.friction,
            })
        })
        .collect()
}
