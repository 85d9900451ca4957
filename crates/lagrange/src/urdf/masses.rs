//! Masses and inertias that real bodies can have, and mass for every coordinate to move.

use std::collections::HashSet;

use nalgebra::Matrix3;

use super::Options;
use super::mimics::leader;
use super::motion::is_moving;
use super::names::Names;
use super::report::{Report, shown};
use super::shape::Shape;
use super::source::{At, InertialText, Source};

/// Mass ≥ 0, inertia positive semidefinite, principal moments A + B ≥ C.
pub(super) fn inertia(link: &str, inertial: &InertialText, strict: bool, report: &mut Report) {
    let link = shown(link);
    if let Some(mass) = &inertial.mass
        && mass.value < 0.0
    {
        report.error(
            mass.at,
            format!(
                "link {link}: the mass is {} kg: it must not be negative",
                mass.value
            ),
        );
    }
    let Some(At {
        value: [xx, xy, xz, yy, yz, zz],
        at,
    }) = inertial.inertia
    else {
        return;
    };
    let scale = [xx, xy, xz, yy, yz, zz]
        .iter()
        .fold(0.0_f64, |m, x| m.max(x.abs()));
    if scale == 0.0 {
        return;
    }
    // Scaled to about 1, so that no finite entry overflows on the way.
    let matrix = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) / scale;
    let mut moments: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
    moments.sort_by(f64::total_cmp);
    let &[a, b, c] = moments.as_slice() else {
        return;
    };
    // Entries are written with some digits only: what rounding explains is no fault.
    const ROUNDING: f64 = 1e-6;
    let show = |x: f64| format!("{:.4e}", x * scale);
    if a.is_nan() || a < -ROUNDING * c.abs().max(b.abs()) {
        report.error(at, format!(
            "link {link}: the inertia is not positive semidefinite (principal moments {}, {}, {} kg·m²): check the signs and sizes of its entries",
            show(a), show(b), show(c)
        ));
    } else if a + b < c * (1.0 - ROUNDING) {
        let message = format!(
            "link {link}: no real body has this inertia: of the principal moments A = {}, B = {}, C = {} kg·m², A + B < C",
            show(a),
            show(b),
            show(c)
        );
        if strict {
            report.error(
                at,
                format!("{message}; correct it, or read the file without `strict`"),
            );
        } else {
            report.warning(at, message);
        }
    }
    if inertial.mass.as_ref().is_some_and(|m| m.value == 0.0) {
        report.warning(
            inertial.at,
            format!("link {link} has an inertia but no mass"),
        );
    }
}

/// Every coordinate moves some mass. Links without mass are legal inside of a chain.
pub(super) fn masses(
    source: &Source,
    shape: &Shape,
    joints: &Names,
    options: &Options,
    report: &mut Report,
) {
    let mut massive: Vec<bool> = source
        .links
        .iter()
        .map(|link| {
            link.inertial.as_ref().is_some_and(|i| {
                // What cannot be read is reported already, and no mass is missed here.
                i.mass.as_ref().is_none_or(|m| m.value != 0.0)
                    || i.inertia.as_ref().is_none_or(|i| i.value != [0.0; 6])
            })
        })
        .collect();
    // Whether a link has mass, or something that is welded to it.
    let mut welded = massive.clone();
    for &link in shape.outward.iter().rev() {
        if let (Some(parent), Some(joint)) = (shape.parent[link], shape.above[link])
            && source
                .joints
                .get(joint)
                .is_some_and(|joint| !is_moving(joint))
        {
            welded[parent] |= welded[link];
        }
        if let Some(parent) = shape.parent[link] {
            massive[parent] |= massive[link];
        }
    }
    if options.floating_base
        && let Some(&root) = shape.outward.first()
        && let Some(link) = source.links.get(root)
    {
        let name = shown(&link.name.value);
        if !massive[root] {
            report.error(link.name.at, format!(
                "the root link {name} floats, but it has no mass, nor has anything that it carries: there is nothing to accelerate; give it an <inertial> with a mass"
            ));
        } else if link.inertial.is_none() {
            report.warning(
                link.name.at,
                format!(
                    "the root link {name} floats but has no <inertial>: {}",
                    what_counts(welded[root])
                ),
            );
        }
    }
    // A coordinate moves what its joint moves and what the joints that follow it move.
    let mut moves_mass: HashSet<usize> = HashSet::new();
    let mut child = vec![None; source.joints.len()];
    for (link, above) in shape.above.iter().enumerate() {
        let Some(j) = *above else { continue };
        child[j] = Some(link);
        if massive[link]
            && let Some(leader) = leader(source, j, joints, options)
        {
            moves_mass.insert(leader);
        }
    }
    for (j, joint) in source
        .joints
        .iter()
        .enumerate()
        .filter(|(_, joint)| is_moving(joint))
    {
        let Some(link) = child[j].and_then(|l: usize| source.links.get(l)) else {
            continue;
        };
        let (joint_name, link_name) = (shown(&joint.name.value), shown(&link.name.value));
        let carries = child[j].is_some_and(|l: usize| welded[l]);
        let own = options.ignore_mimic || joint.mimic.is_none();
        if own && !moves_mass.contains(&j) {
            report.error(link.name.at, format!(
                "link {link_name}, which joint {joint_name} moves, has no mass, nor has anything that it carries: there is nothing to accelerate; give it an <inertial> with a mass, or make the joint fixed"
            ));
        } else if link.inertial.is_none() {
            report.warning(
                link.name.at,
                format!(
                    "link {link_name} is moved by joint {joint_name} but has no <inertial>: {}",
                    what_counts(carries)
                ),
            );
        }
    }
}

/// What a link without <inertial> weighs.
fn what_counts(welded: bool) -> &'static str {
    match welded {
        true => "only what is welded to it has mass",
        false => "it counts as massless",
    }
}
