//! What a URDF must be before a tree is made of it; every fault is reported, with its place.

use std::collections::{HashMap, HashSet};

use nalgebra::Matrix3;

use super::Options;
use super::source::{At, InertialText, JointText, Report, Source, shown};
use crate::mechanism::BASE;

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
    coordinate_names(source, options.floating_base, report);
    if source.links.is_empty() {
        report.error(0, "<robot> has no <link>: there is nothing to move");
    } else if let Some(shape) = shape(source, &links, report) {
        masses(source, &shape, &joints, options, report);
    }
}

/// Where every name stands in its list; only the first of several.
struct Names<'s>(HashMap<&'s str, usize>);

impl<'s> Names<'s> {
    fn of(what: &str, names: impl Iterator<Item = &'s At<String>>, report: &mut Report) -> Self {
        let mut known: HashMap<&str, (usize, usize)> = HashMap::new();
        for (index, name) in names.enumerate() {
            if name.value.is_empty() {
                continue; // reported where it was read
            }
            if let Some(&(_, first)) = known.get(name.value.as_str()) {
                let line = report.line(first);
                report.error(
                    name.at,
                    format!(
                        "{what} {} is there already{line}: every {what} needs a name of its own",
                        shown(&name.value)
                    ),
                );
            } else {
                known.insert(&name.value, (index, name.at));
            }
        }
        Names(
            known
                .into_iter()
                .map(|(name, (index, _))| (name, index))
                .collect(),
        )
    }
    fn get(&self, name: &str) -> Option<usize> {
        self.0.get(name).copied()
    }
    fn nearest(&self, name: &str, report: &Report) -> String {
        if report.is_long() {
            return String::new();
        }
        let mut sorted: Vec<&str> = self.0.keys().copied().collect();
        sorted.sort_unstable();
        nearest(name, sorted.into_iter())
    }
}

/// `; did you mean …?`, or nothing when no name is close.
pub fn nearest<'n>(name: &str, known: impl Iterator<Item = &'n str>) -> String {
    if name.len() > 200 {
        return String::new();
    }
    known
        .filter(|k| k.len() <= 200)
        .map(|k| (strsim::normalized_damerau_levenshtein(name, k), k))
        .filter(|&(likeness, _)| likeness >= 0.5)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or_else(String::new, |(_, k)| {
            format!("; did you mean {}?", shown(k))
        })
}

/// Mass ≥ 0, inertia positive semidefinite, principal moments A + B ≥ C.
fn inertia(link: &str, inertial: &InertialText, strict: bool, report: &mut Report) {
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

fn is_single(joint: &JointText) -> bool {
    // A type that is not read is reported already.
    joint
        .kind
        .as_ref()
        .is_none_or(|k| SINGLE.contains(&k.value.as_str()) || !READ.contains(&k.value.as_str()))
}

fn is_moving(joint: &JointText) -> bool {
    joint.kind.as_ref().is_some_and(|k| k.value != "fixed")
}

/// Type, axis, limits and friction of one joint.
fn motion(joint: &JointText, report: &mut Report) {
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

/// Leaders exist, move, and are not led by their followers.
fn mimics(source: &Source, joints: &Names, follow: bool, report: &mut Report) {
    let leader = |j: usize| -> Option<usize> {
        let mimic = source.joints.get(j)?.mimic.as_ref()?;
        joints.get(&mimic.value.0)
    };
    let mut settled: HashSet<usize> = HashSet::new();
    for (j, joint) in source.joints.iter().enumerate() {
        let Some(mimic) = &joint.mimic else { continue };
        let (name, followed) = (shown(&joint.name.value), &mimic.value.0);
        let Some(first) = joints.get(followed) else {
            let hint = joints.nearest(followed, report);
            report.error(
                mimic.at,
                format!(
                    "joint {name} mimics {}, but there is no such joint{hint}",
                    shown(followed)
                ),
            );
            continue;
        };
        if first == j {
            report.error(
                mimic.at,
                format!("joint {name} mimics itself: remove <mimic>, or name another joint"),
            );
            continue;
        }
        if !is_moving(joint) {
            report.warning(
                mimic.at,
                format!("joint {name} is fixed: its <mimic> has no effect"),
            );
            continue;
        }
        if source.joints.get(first).is_some_and(|l| !is_moving(l)) {
            report.error(mimic.at, format!("joint {name} mimics {}, which is fixed: make {name} fixed too, or name a joint that moves", shown(followed)));
        }
        for single in [Some(joint), source.joints.get(first)]
            .into_iter()
            .flatten()
        {
            if !follow || is_single(single) || !is_moving(single) {
                continue;
            }
            let (other, kind) = (shown(&single.name.value), single.kind.as_ref());
            report.error(mimic.at, format!(
                "joint {name} mimics {}, but {other} is {}: only joints of one coordinate, revolute, continuous and prismatic ones, can follow and be followed; remove <mimic>, or ignore mimic joints",
                shown(followed), kind.map_or("", |k| &k.value)
            ));
        }
        // Up the chain; a cycle is reported once, at the first joint of it in the text.
        let mut chain = vec![j];
        let mut seen = HashSet::from([j]);
        let mut at = leader(j);
        while let Some(next) = at.filter(|next| !settled.contains(next)) {
            if !seen.insert(next) {
                let start = chain.iter().position(|&k| k == next).unwrap_or(0);
                // A joint that mimics itself was reported as such.
                if chain.len() - start > 1 {
                    let list: Vec<String> = names(source, chain.get(start..).unwrap_or(&[]), next);
                    report.error(mimic.at, format!("mimic joints follow one another in a circle: {}; one of them must move on its own", list.join(" → ")));
                }
                break;
            }
            chain.push(next);
            at = leader(next);
        }
        settled.extend(chain);
    }
}

/// Coordinates take their names from the joints: those of a planar joint, and of a base that floats, must be left to them.
fn coordinate_names(source: &Source, floating_base: bool, report: &mut Report) {
    let moving = |name: &str| {
        let found = source.joints.iter().filter(|j| is_moving(j));
        found.into_iter().find(|j| j.name.value == name)
    };
    if floating_base && let Some(joint) = moving(BASE) {
        report.error(
            joint.name.at,
            format!("joint `{BASE}` has the name of the floating base's coordinates: give it another one, or read the file with a fixed base"),
        );
    }
    let planar = |joint: &&JointText| joint.kind.as_ref().is_some_and(|k| k.value == "planar");
    for joint in source.joints.iter().filter(planar) {
        for suffix in [".x", ".y", ".theta"] {
            let name = format!("{}{suffix}", joint.name.value);
            if let Some(other) = moving(&name) {
                report.error(
                    other.name.at,
                    format!(
                        "joint {} has the name of a coordinate of the planar joint {}: give it another one",
                        shown(&name),
                        shown(&joint.name.value)
                    ),
                );
            }
        }
    }
}

/// Names of joints for a message, at most ten, and the one that closes the circle.
fn names(source: &Source, chain: &[usize], last: usize) -> Vec<String> {
    let name = |j: &usize| {
        source
            .joints
            .get(*j)
            .map_or_else(String::new, |joint| shown(&joint.name.value))
    };
    let mut list: Vec<String> = chain.iter().take(10).map(name).collect();
    if chain.len() > 10 {
        list.push("…".to_owned());
    }
    list.push(name(&last));
    list
}

/// The tree: the joint above every link, and the links from the root outward.
struct Shape {
    above: Vec<Option<usize>>,
    parent: Vec<Option<usize>>,
    outward: Vec<usize>,
}

/// The tree that the joints make of the links; nothing when they make none.
fn shape(source: &Source, links: &Names, report: &mut Report) -> Option<Shape> {
    let count = source.links.len();
    let mut above: Vec<Option<usize>> = vec![None; count];
    let mut parent: Vec<Option<usize>> = vec![None; count];
    let mut sound = links.0.len() == count;
    for (j, joint) in source.joints.iter().enumerate() {
        let name = shown(&joint.name.value);
        let mut find = |end: &Option<At<String>>| -> Option<(usize, usize)> {
            let end = end.as_ref()?;
            let found = links.get(&end.value);
            if found.is_none() {
                let hint = links.nearest(&end.value, report);
                report.error(
                    end.at,
                    format!("joint {name}: there is no link {}{hint}", shown(&end.value)),
                );
            }
            found.map(|link| (link, end.at))
        };
        let (from, to) = (find(&joint.parent), find(&joint.child));
        let (Some((from, _)), Some((to, at))) = (from, to) else {
            sound = false;
            continue;
        };
        let child = || shown(&source.links[to].name.value);
        if from == to {
            report.error(
                at,
                format!("joint {name} connects the link {} with itself", child()),
            );
            sound = false;
        } else if let Some(other) = above[to] {
            let other = shown(&source.joints[other].name.value);
            report.error(at, format!("link {} has several parents: joint {name} and joint {other} both move it; a URDF is a tree, loops are closed outside of it", child()));
            sound = false;
        } else {
            above[to] = Some(j);
            parent[to] = Some(from);
        }
    }
    // Without the above, further findings would only be echoes of it.
    if !sound {
        return None;
    }
    let roots: Vec<usize> = (0..count).filter(|&l| above[l].is_none()).collect();
    if let [_, second, ..] = roots.as_slice() {
        let mut list: Vec<String> = roots
            .iter()
            .take(10)
            .map(|&l| shown(&source.links[l].name.value))
            .collect();
        if roots.len() > 10 {
            list.push("…".to_owned());
        }
        report.error(source.links[*second].name.at, format!(
            "there are {} root links ({}): connect them by joints, so that one is the root of all",
            roots.len(), list.join(", ")
        ));
        sound = false;
    }
    let mut below = vec![Vec::new(); count];
    for (link, parent) in parent.iter().enumerate() {
        if let Some(parent) = *parent {
            below[parent].push(link);
        }
    }
    let mut outward = roots;
    let mut done = 0;
    while let Some(&link) = outward.get(done) {
        outward.extend(&below[link]);
        done += 1;
    }
    if outward.len() < count {
        circles(source, &parent, &above, &outward, report);
        sound = false;
    }
    sound.then_some(Shape {
        above,
        parent,
        outward,
    })
}

/// Reports every circle among the links that no root reaches.
fn circles(
    source: &Source,
    parent: &[Option<usize>],
    above: &[Option<usize>],
    reached: &[usize],
    report: &mut Report,
) {
    let mut settled: HashSet<usize> = reached.iter().copied().collect();
    for start in 0..parent.len() {
        let mut chain: Vec<usize> = Vec::new();
        let mut seen = HashMap::new();
        let mut at = Some(start).filter(|l| !settled.contains(l));
        while let Some(link) = at {
            if let Some(&first) = seen.get(&link) {
                let circle: Vec<usize> = chain
                    .get(first..)
                    .unwrap_or(&[])
                    .iter()
                    .filter_map(|&l| above[l])
                    .collect();
                let place = circle
                    .iter()
                    .filter_map(|&j| source.joints.get(j))
                    .map(|j| j.name.at)
                    .min()
                    .unwrap_or(0);
                let last = circle.first().copied().unwrap_or(0);
                report.error(place, format!("the joints {} close a circle (a cycle of links): a URDF is a tree, loops are closed outside of it", names(source, &circle, last).join(" → ")));
                break;
            }
            seen.insert(link, chain.len());
            chain.push(link);
            at = parent[link].filter(|l| !settled.contains(l));
        }
        settled.extend(chain);
    }
}

/// Every coordinate moves some mass. Links without mass are legal inside of a chain.
fn masses(source: &Source, shape: &Shape, joints: &Names, options: &Options, report: &mut Report) {
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
    for &link in shape.outward.iter().rev() {
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
                format!("the root link {name} floats but has no <inertial>: it counts as massless"),
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
        let own = options.ignore_mimic || joint.mimic.is_none();
        if own && !moves_mass.contains(&j) {
            report.error(link.name.at, format!(
                "link {link_name}, which joint {joint_name} moves, has no mass, nor has anything that it carries: there is nothing to accelerate; give it an <inertial> with a mass, or make the joint fixed"
            ));
        } else if link.inertial.is_none() {
            report.warning(link.name.at, format!("link {link_name} is moved by joint {joint_name} but has no <inertial>: it counts as massless"));
        }
    }
}

/// The joint whose coordinate moves joint `j`, with the chain's multipliers not zero.
fn leader(source: &Source, mut j: usize, joints: &Names, options: &Options) -> Option<usize> {
    for _ in 0..=source.joints.len() {
        let joint = source.joints.get(j)?;
        match joint.mimic.as_ref().filter(|_| !options.ignore_mimic) {
            None => return Some(j),
            Some(mimic) if mimic.value.1 == 0.0 => return None,
            Some(mimic) => j = joints.get(&mimic.value.0)?,
        }
    }
    None
}
