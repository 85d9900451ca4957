//! Types, axes, limits and friction of joints.

use super::names::nearest;
use super::report::{Report, shown};
use super::source::{At, JointText};

/// A limit of a rotation from here on, rad, is more likely meant in degrees: 90° are common, 14 turns are not.
const DEGREES: f64 = 90.0;

/// Joint types that are read.
const READ: [&str; 6] = [
    "revolute",
    "continuous",
    "prismatic",
    "fixed",
    "planar",
    "floating",
];

/// Types whose joints have one coordinate: they can follow another joint and be followed.
const SINGLE: [&str; 3] = ["revolute", "continuous", "prismatic"];

pub(super) fn is_single(joint: &JointText) -> bool {
    // A type that is not read is reported already.
    joint
        .kind
        .as_ref()
        .is_none_or(|k| SINGLE.contains(&k.value.as_str()) || !READ.contains(&k.value.as_str()))
}

pub(super) fn is_moving(joint: &JointText) -> bool {
    joint.kind.as_ref().is_some_and(|k| k.value != "fixed")
}

/// Type, axis, limits and friction of one joint.
pub(super) fn motion(joint: &JointText, report: &mut Report) {
    let name = shown(&joint.name.value);
    let Some(kind) = &joint.kind else {
        return; // reported where it was read
    };
    match kind.value.as_str() {
        known if READ.contains(&known) => {}
        "spherical" => report.error(
            kind.at,
            format!(
                "joint {name} is of type spherical, which is not in URDF: use three continuous joints, with links without mass between them"
            ),
        ),
        other => {
            let hint = nearest(other, READ.into_iter());
            report.error(
                kind.at,
                format!(
                    "joint {name}: there is no joint type {}{hint}",
                    shown(other)
                ),
            );
        }
    }
    if let Some(axis) = &joint.axis
        && is_moving(joint)
        && kind.value != "floating"
    {
        let length = axis.value.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        if length == 0.0 {
            report.error(
                axis.at,
                format!("joint {name}: the axis is zero: give it a direction"),
            );
        }
    }
    if matches!(kind.value.as_str(), "revolute" | "prismatic") {
        match &joint.limit {
            None => report.warning(joint.name.at, format!("joint {name} is {} but has no <limit>, which URDF requires: it is taken to have none", kind.value)),
            Some(At { value: (Some(lower), Some(upper)), at }) if lower > upper => {
                report.warning(*at, format!("joint {name}: its lower limit {lower} is above the upper one, {upper}"));
            }
            Some(At { value: (lower, upper), at }) if kind.value == "revolute" => {
                let ends = [lower, upper].into_iter().flatten();
                if let Some(end) = ends.copied().find(|end| end.is_finite() && end.abs() >= DEGREES) {
                    report.warning(*at, format!(
                        "joint {name}: a limit of {end} rad is {:.0} turns: if these are degrees, write {:.4} rad",
                        end / std::f64::consts::TAU, end.to_radians()
                    ));
                }
            }
            Some(_) => {}
        }
    }
    if kind.value == "planar" && joint.axis.is_none() {
        report.warning(
            joint.name.at,
            format!(
                "joint {name} is planar but has no <axis>: its plane is normal to x, as URDF has it"
            ),
        );
    }
    if let Some(dynamics) = &joint.dynamics {
        if is_moving(joint) && !is_single(joint) && dynamics.value != [0.0; 2] {
            report.warning(
                dynamics.at,
                format!(
                    "joint {name} is {}: its <dynamics> is not used, one damping has no meaning for several coordinates",
                    kind.value
                ),
            );
        }
        for (what, value) in ["damping", "friction"].iter().zip(dynamics.value) {
            if value < 0.0 {
                report.error(
                    dynamics.at,
                    format!("joint {name}: its {what} is {value}: it must not be negative"),
                );
            }
        }
    }
}
