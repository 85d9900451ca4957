//! What a URDF must be before a tree is made of it; every fault is reported, with its place.

use super::Options;
use super::masses::{inertia, masses};
use super::mimics::mimics;
use super::motion::motion;
use super::names::{Names, coordinate_names};
use super::report::Report;
use super::shape::shape;
use super::source::Source;

/// Reports all that is wrong with the links and joints, and all that looks wrong.
pub fn validate(source: &Source, options: &Options, report: &mut Report) {
    for link in &source.links {
        if let Some(inertial) = &link.inertial {
            inertia(&link.name.value, inertial, options.strict, report);
        }
    }
    for joint in &source.joints {
        motion(joint, report);
    }
    let links = Names::of("link", source.links.iter().map(|l| &l.name), report);
    let joints = Names::of("joint", source.joints.iter().map(|j| &j.name), report);
    mimics(source, &joints, !options.ignore_mimic, report);
    coordinate_names(source, &joints, options.floating_base, report);
    if source.links.is_empty() {
        report.error(0, "<robot> has no <link>: there is nothing to move");
    } else if let Some(shape) = shape(source, &links, report) {
        masses(source, &shape, &joints, options, report);
    }
}
