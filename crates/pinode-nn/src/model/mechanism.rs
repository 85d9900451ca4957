//! The mechanism of a model file: a URDF beside it, or energies as text in it.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lagrange::constraint::Constraint;
use lagrange::mechanism::{Angles, Axis, PoseForm, Tree};
use lagrange::{Dynamics, Mechanics, Position, Problem, Problems, TextLagrangian, TextSource};
use lagrange::{Field, TextProblem, urdf};

use super::constraints::{self, ConstraintEntry, Joined};
use super::document::{Faults, Placed, Section, number};
use crate::naming::{hint, nearest, quoted};
use crate::poses::with_poses;

/// A larger URDF is refused.
const LARGEST_URDF: u64 = 64 << 20;
/// Acceleration of free fall, m/s², where the file gives none.
const STANDARD_GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// A URDF as it was read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct UrdfFile {
    pub path: PathBuf,
    pub text: String,
}

/// Viscous and Coulomb friction of one coordinate, from `<dynamics>`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct JointFriction {
    pub coordinate: usize,
    /// N·s/m or N·m·s/rad.
    pub damping: f64,
    /// N or N·m.
    pub friction: f64,
}

pub(super) struct Mechanism {
    pub name: Option<String>,
    pub mechanics: Arc<dyn Mechanics>,
    pub constraints: Vec<ConstraintEntry>,
    pub urdf: Option<UrdfFile>,
    pub tree: Option<Tree>,
    pub pose: PoseForm,
    pub friction: Vec<JointFriction>,
}

/// Reads the mechanism that `root` describes. `foreign` takes the problems of other files, `warnings` those of all.
pub(super) fn read(
    root: &Section,
    source: &Path,
    text: &str,
    strict: bool,
    faults: &mut Faults,
    foreign: &mut Vec<Problems>,
    warnings: &mut Vec<Problems>,
) -> Option<Mechanism> {
    match (root.get("urdf"), root.get("lagrangian")) {
        (Some(urdf), Some(_)) => {
            faults.at(
                urdf.span().start,
                "both `urdf` and [lagrangian] are given: a model has one mechanism, remove one",
            );
            None
        }
        (None, None) => {
            faults.at(
                0,
                "no mechanism: give `urdf = \"file.urdf\"` or a [lagrangian] table",
            );
            None
        }
        (Some(_), None) => from_urdf(root, source, text, strict, faults, foreign, warnings),
        (None, Some(_)) => from_text(root, source, text, faults, warnings),
    }
}

fn from_urdf(
    root: &Section,
    source: &Path,
    text: &str,
    strict: bool,
    faults: &mut Faults,
    foreign: &mut Vec<Problems>,
    warnings: &mut Vec<Problems>,
) -> Option<Mechanism> {
    let gravity = root.triple("gravity", "in m/s², such as [0.0, 0.0, -9.81]", faults);
    let floating_base = match root.string("base", faults) {
        None => false,
        Some(base) => {
            if !["fixed", "floating"].contains(&base.value) {
                faults.at(
                    base.offset(),
                    format!(
                        "`base` is {}: it must be \"fixed\" or \"floating\"",
                        quoted(base.value)
                    ),
                );
            }
            base.value == "floating"
        }
    };
    let pose = pose_form(root, faults);
    let ignore_mimic = match root.string("mimic", faults) {
        None => false,
        Some(mimic) => {
            if !["follow", "ignore"].contains(&mimic.value) {
                faults.at(
                    mimic.offset(),
                    format!(
                        "`mimic` is {}: it must be \"follow\" or \"ignore\"",
                        quoted(mimic.value)
                    ),
                );
            }
            mimic.value == "ignore"
        }
    };
    let use_friction = root.boolean("urdf_dynamics", faults).unwrap_or(true);
    let given = root.string("urdf", faults)?;
    let file = read_urdf(&given, source, faults)?;

    let options = urdf::Options {
        source: file.path.display().to_string(),
        gravity: gravity.unwrap_or(STANDARD_GRAVITY),
        floating_base,
        pose,
        ignore_mimic,
        strict,
    };
    let read = match urdf::read(&file.text, &options) {
        Ok(read) => read,
        Err(problems) => {
            foreign.push(problems);
            return None;
        }
    };
    if !read.warnings.is_empty() {
        warnings.push(Problems {
            source: options.source.clone(),
            list: read.warnings,
        });
    }
    let coordinates = read.tree.coordinates().to_vec();
    if pose != PoseForm::Quaternion
        && with_poses(&coordinates) == coordinates
        && let Some(key) = root.get("pose")
    {
        faults.at(
            key.span().start,
            "`pose` says how a body that floats is written, and none floats: add `base = \"floating\"`, or leave it out",
        );
    }
    let mut friction: Vec<JointFriction> = Vec::new();
    for joint in read.joint_dynamics.iter().filter(|_| use_friction) {
        // A joint that follows another one brakes the coordinate of its leader.
        let damping = joint.damping * joint.ratio * joint.ratio;
        let coulomb = joint.friction * joint.ratio.abs();
        match friction
            .iter_mut()
            .find(|f| f.coordinate == joint.coordinate)
        {
            Some(sum) => {
                sum.damping += damping;
                sum.friction += coulomb;
            }
            None => friction.push(JointFriction {
                coordinate: joint.coordinate,
                damping,
                friction: coulomb,
            }),
        }
    }
    let free = match Dynamics::new(read.tree.clone(), coordinates) {
        Ok(free) => free,
        Err(e) => {
            faults.at(given.offset(), e.to_string());
            return None;
        }
    };
    let joined = constraints::close_loops(free, &read.tree, root, text, faults)?;
    Some(Mechanism {
        name: Some(read.name),
        mechanics: joined.mechanics(source, warnings),
        constraints: joined.entries,
        urdf: Some(file),
        tree: Some(read.tree),
        pose,
        friction,
    })
}

/// `pose` and `roll_axis`: how poses are written.
fn pose_form(root: &Section, faults: &mut Faults) -> PoseForm {
    let pose = root.string("pose", faults);
    let by_angles = match &pose {
        None => false,
        Some(pose) => {
            if !["quaternion", "angles"].contains(&pose.value) {
                faults.at(
                    pose.offset(),
                    format!(
                        "`pose` is {}: it must be \"quaternion\" or \"angles\"",
                        quoted(pose.value)
                    ),
                );
            }
            pose.value == "angles"
        }
    };
    let mut roll_axis = Axis::default();
    if let Some(axis) = root.string("roll_axis", faults) {
        match Axis::ALL.into_iter().find(|a| a.name() == axis.value) {
            Some(axis) => roll_axis = axis,
            None => faults.at(
                axis.offset(),
                format!(
                    "`roll_axis` is {}: it must be \"x\", \"y\" or \"z\", an axis of the body that floats",
                    quoted(axis.value)
                ),
            ),
        }
        if !by_angles {
            faults.at(
                axis.offset(),
                "`roll_axis` goes with `pose = \"angles\"`: a quaternion has none",
            );
        }
    }
    match by_angles {
        true => PoseForm::Angles(Angles { roll_axis }),
        false => PoseForm::Quaternion,
    }
}

fn read_urdf(given: &Placed<&str>, source: &Path, faults: &mut Faults) -> Option<UrdfFile> {
    let name = given.value;
    if name.is_empty() {
        faults.at(given.offset(), "`urdf` is empty: give the path of a URDF");
        return None;
    }
    if name.contains("://") {
        faults.at(
            given.offset(),
            format!(
                "{} is a URL or package path: no packages are searched; give a path relative to this file",
                quoted(name)
            ),
        );
        return None;
    }
    if Path::new(name).extension().is_some_and(|e| e == "xacro") {
        faults.at(
            given.offset(),
            format!(
                "{} is a xacro, which must be expanded first: `xacro robot.xacro > robot.urdf`",
                quoted(name)
            ),
        );
        return None;
    }
    let folder = source.parent().unwrap_or(Path::new(""));
    let path = folder.join(name);
    let mut bytes = Vec::new();
    let result =
        File::open(&path).and_then(|file| file.take(LARGEST_URDF + 1).read_to_end(&mut bytes));
    if let Err(e) = result {
        let neighbours = urdf_files(path.parent().unwrap_or(folder));
        let neighbours: Vec<&str> = neighbours.iter().map(String::as_str).collect();
        faults.at(
            given.offset(),
            format!(
                "cannot read {}: {e}{}",
                quoted(&path.display().to_string()),
                hint(name, "URDFs there", &neighbours)
            ),
        );
        return None;
    }
    if bytes.len() as u64 > LARGEST_URDF {
        faults.at(
            given.offset(),
            format!("{} is larger than 64 MiB: it is no URDF", quoted(name)),
        );
        return None;
    }
    match String::from_utf8(bytes) {
        Ok(text) => Some(UrdfFile { path, text }),
        Err(e) => {
            faults.at(
                given.offset(),
                format!(
                    "{} is not UTF-8 text at byte {}: save it as UTF-8",
                    quoted(name),
                    e.utf8_error().valid_up_to()
                ),
            );
            None
        }
    }
}

/// Names of some URDFs in `folder`.
fn urdf_files(folder: &Path) -> Vec<String> {
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let Ok(entries) = folder.read_dir() else {
        return Vec::new();
    };
    let mut names: Vec<String> = entries
        .take(1000)
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".urdf"))
        .collect();
    names.sort();
    names
}

fn from_text(
    root: &Section,
    source: &Path,
    text: &str,
    faults: &mut Faults,
    warnings: &mut Vec<Problems>,
) -> Option<Mechanism> {
    if let Some(first) = root.sections("loop", faults).first() {
        faults.at(
            first.offset,
            "[[loop]] goes with `urdf`: write the loop as φ(q) = 0 into `constraints` of [lagrangian]",
        );
    }
    for key in [
        "gravity",
        "base",
        "pose",
        "roll_axis",
        "mimic",
        "urdf_dynamics",
    ] {
        if let Some(value) = root.get(key) {
            faults.at(
                value.span().start,
                format!("`{key}` goes with `urdf`; [lagrangian] says all in its energies"),
            );
        }
    }
    let section = root.section("lagrangian", "[lagrangian]", faults)?;
    section.check_keys(
        &[
            "coordinates",
            "angles",
            "unwrapped",
            "kinetic",
            "potential",
            "constraints",
            "parameters",
        ],
        faults,
    );
    let coordinates = section.strings("coordinates", faults);
    if coordinates.is_none() && section.get("coordinates").is_none() {
        faults.at(
            section.offset,
            "[lagrangian] has no `coordinates`, an array of names",
        );
    }
    let coordinates = coordinates.unwrap_or_default();
    let angles = section.strings("angles", faults).unwrap_or_default();
    let unwrapped = section.strings("unwrapped", faults).unwrap_or_default();
    for name in &unwrapped {
        if !angles.iter().any(|angle| angle.value == name.value) {
            faults.at(
                name.offset(),
                format!(
                    "{} is none of `angles`: `unwrapped` are those of them that do not wrap",
                    quoted(name.value)
                ),
            );
        }
    }
    let formulas = section.strings("constraints", faults).unwrap_or_default();
    let kinetic = section.needed_string("kinetic", faults);
    let potential = section.needed_string("potential", faults);
    let mut constants = Vec::new();
    if let Some(table) = section.section("parameters", "[lagrangian.parameters]", faults) {
        for (key, value) in table.entries() {
            // A parameter whose number is faulty keeps its name, so that the formulas are not blamed.
            let value = number(key.value, value, faults).map_or(1.0, |n| n.value);
            constants.push((key, value));
        }
    }
    let (kinetic, potential) = (kinetic?, potential?);
    let energies = TextSource {
        coordinates: coordinates.iter().map(|c| c.value.to_owned()).collect(),
        angles: angles.iter().map(|c| c.value.to_owned()).collect(),
        kinetic: kinetic.value.to_owned(),
        potential: potential.value.to_owned(),
        constraints: formulas.iter().map(|c| c.value.to_owned()).collect(),
        parameters: constants
            .iter()
            .map(|(key, value)| (key.value.to_owned(), *value))
            .collect(),
    };
    let place = |problem: &TextProblem| -> usize {
        let of = |list: &[Placed<&str>], i: usize| list.get(i).map(Placed::offset);
        let offset = match problem.field {
            Field::Coordinates(i) => of(&coordinates, i),
            Field::Angles(i) => of(&angles, i),
            Field::Kinetic => Some(within(text, &kinetic, problem.column)),
            Field::Potential => Some(within(text, &potential, problem.column)),
            Field::Constraint(i) => formulas
                .get(i)
                .map(|formula| within(text, formula, problem.column)),
            Field::Parameter(i) => constants.get(i).map(|(key, _)| key.offset()),
            _ => None,
        };
        offset.unwrap_or(section.offset)
    };
    let lagrangian = match TextLagrangian::new(&energies) {
        Ok(lagrangian) => lagrangian,
        Err(problems) => {
            for problem in &problems {
                faults.at(place(problem), problem.message.clone());
            }
            return None;
        }
    };
    if !lagrangian.warnings().is_empty() {
        warnings.push(Problems {
            source: source.display().to_string(),
            list: lagrangian
                .warnings()
                .iter()
                .map(|w| Problem::at(Position::of(text, place(w)), w.message.clone()))
                .collect(),
        });
    }
    let equations = lagrangian.constraints().clone();
    let mut names = lagrangian.coordinates().to_vec();
    for coordinate in &mut names {
        coordinate.wraps &= !unwrapped.iter().any(|name| name.value == coordinate.name);
    }
    let free = match Dynamics::new(lagrangian, names) {
        Ok(free) => free,
        Err(e) => {
            faults.at(section.offset, e.to_string());
            return None;
        }
    };
    let joined = if equations.is_empty() {
        Joined::free(free)
    } else {
        let describe = |equation: usize| match formulas.get(equation) {
            Some(formula) => (formula.value.to_owned(), formula.offset()),
            None => (String::new(), section.offset),
        };
        constraints::join(free, equations, describe, text, faults)?
    };
    Some(Mechanism {
        name: None,
        mechanics: joined.mechanics(source, warnings),
        constraints: joined.entries,
        urdf: None,
        tree: None,
        pose: PoseForm::Quaternion,
        friction: Vec::new(),
    })
}

/// Byte offset in the file of character `column` (from 1) of a formula; the formula's start where escapes make that unclear.
fn within(text: &str, formula: &Placed<&str>, column: Option<usize>) -> usize {
    let start = formula.offset();
    let Some(column) = column else {
        return start;
    };
    let raw = text.get(formula.span.clone()).unwrap_or("");
    let Some(inside) = raw
        .find(formula.value)
        .filter(|_| !formula.value.is_empty())
    else {
        return start;
    };
    let ahead: usize = formula
        .value
        .chars()
        .take(column.saturating_sub(1))
        .map(char::len_utf8)
        .sum();
    start + inside + ahead
}

/// The link called `name`.
pub(super) fn find_link(tree: &Tree, name: &Placed<&str>, faults: &mut Faults) -> Option<usize> {
    let links = tree.links();
    let index = links.iter().position(|link| link.name == name.value);
    if index.is_none() {
        let names: Vec<&str> = links.iter().map(|link| link.name.as_str()).collect();
        faults.at(
            name.offset(),
            format!(
                "unknown link {}{}",
                quoted(name.value),
                hint(name.value, "links", &names)
            ),
        );
    }
    index
}

/// The coordinate of one number called `name`; a joint with one coordinate gives it its name.
pub(super) fn find_coordinate(
    mechanism: &Mechanism,
    name: &str,
    offset: usize,
    faults: &mut Faults,
) -> Option<usize> {
    let coordinates = mechanism.mechanics.coordinates();
    if let Some(index) = coordinates.iter().position(|c| c.name == name) {
        if coordinates.get(index).is_some_and(|c| c.floating) {
            let single: Vec<&str> = coordinates
                .iter()
                .filter(|c| !c.floating)
                .map(|c| c.name.as_str())
                .collect();
            let others = match single.is_empty() {
                true => "this model has none".to_owned(),
                false => format!("name one of {}", single.join(", ")),
            };
            faults.at(
                offset,
                format!(
                    "{} is the pose of a body that floats, which has three forces and three moments, a position and an orientation: \
                     inputs, effects, sensors and tolerances belong to coordinates of one number; {others}, or write `pose = \"angles\"` for six of them; an input may push a `link` instead",
                    quoted(name)
                ),
            );
            return None;
        }
        return Some(index);
    }
    let of_joint: Vec<&str> = coordinates
        .iter()
        .filter(|c| c.joint == name)
        .map(|c| c.name.as_str())
        .collect();
    if let Some(message) = mechanism
        .tree
        .as_ref()
        .and_then(|tree| not_of_its_own(tree, name))
    {
        faults.at(offset, message);
    } else if of_joint.is_empty() {
        let names: Vec<&str> = coordinates.iter().map(|c| c.name.as_str()).collect();
        faults.at(
            offset,
            format!(
                "unknown joint {}{}",
                quoted(name),
                hint(name, "joints", &names)
            ),
        );
    } else {
        faults.at(
            offset,
            format!(
                "joint {} has the coordinates {}: name one, such as {}",
                quoted(name),
                of_joint.join(", "),
                quoted(nearest(name, of_joint.iter().copied()).unwrap_or(name))
            ),
        );
    }
    None
}

/// Why the joint `name` of the tree has no coordinate of its own, if it has none.
fn not_of_its_own(tree: &Tree, name: &str) -> Option<String> {
    let joint = tree.joints().iter().find(|joint| joint.name == name)?;
    match (joint.coordinate, &joint.mimic) {
        (None, _) => {
            let coordinates = tree.coordinates().iter();
            let names: Vec<&str> = coordinates.map(|c| c.name.as_str()).collect();
            Some(format!(
                "joint {} is fixed: it has no coordinate that an input, an effect, a sensor or a tolerance could belong to{}",
                quoted(name),
                hint(name, "joints that move", &names)
            ))
        }
        (Some(leader), Some(mimic)) if joint.follows => {
            let leader = tree.coordinates().get(leader);
            let leader = quoted(leader.map_or(mimic.leader.as_str(), |c| c.name.as_str()));
            let (name, ratio) = (quoted(name), joint.ratio);
            Some(format!(
                "joint {name} follows {leader} and has no coordinate of its own: put it on {leader}, where a force x on {name} counts \
                 as {ratio} x; with mimic = \"ignore\" every joint has its own coordinate"
            ))
        }
        _ => None,
    }
}
