//! What moves a mechanism: `[[input]]`.

use std::fmt;

use super::Target;
use super::document::{Faults, Section};
use super::mechanism::{Mechanism, find_coordinate, find_link};
use crate::effect::Between;
use crate::naming::quoted;

/// An actuator: gain · u on a coordinate or a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Name; column `u.<name>` of a log.
    pub name: String,
    /// What it pushes.
    pub pushes: Pushes,
    /// Per unit of u: N or N·m on a coordinate; on a link the factor on its force and its torque.
    pub gain: f64,
    /// What it does between two samples of a log.
    pub between: Between,
}

/// What an input pushes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pushes {
    /// The coordinate with this index, a single number and no pose: the generalized force gain · u.
    Coordinate(usize),
    /// A link.
    Link(OnLink),
}

/// A force and a torque that turn with a link, as those of a propeller: gain · u times Jᵀ (R f, R n), see
/// [`LinkForce`](lagrange::mechanism::LinkForce).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnLink {
    /// Index of the link.
    pub link: usize,
    /// Where the force acts, m in the link's frame.
    pub point: [f64; 3],
    /// f at gain · u = 1, N in the link's axes.
    pub force: [f64; 3],
    /// n at gain · u = 1, N·m in the link's axes.
    pub torque: [f64; 3],
}

/// Such as “force [0, 0, 1] N at [0.2, 0, 0] m, torque [0, 0, 0.016] N·m, in its axes”.
impl fmt::Display for OnLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let OnLink {
            point,
            force,
            torque,
            ..
        } = self;
        if *force != [0.0; 3] {
            write!(f, "force {force:?} N at {point:?} m, ")?;
        }
        if *torque != [0.0; 3] {
            write!(f, "torque {torque:?} N·m, ")?;
        }
        f.write_str("in its axes")
    }
}

impl Input {
    /// What it pushes.
    pub fn target(&self) -> Target {
        match self.pushes {
            Pushes::Coordinate(coordinate) => Target::Coordinate(coordinate),
            Pushes::Link(on) => Target::Link(on.link),
        }
    }

    /// Index of the coordinate that it acts on; none where it acts on a link.
    pub fn coordinate(&self) -> Option<usize> {
        match self.pushes {
            Pushes::Coordinate(coordinate) => Some(coordinate),
            Pushes::Link(_) => None,
        }
    }
}

/// The `[[input]]` tables with their byte offsets; a faulty one keeps its name, so that who refers to it is not blamed.
pub(super) fn read(
    root: &Section,
    mechanism: Option<&Mechanism>,
    faults: &mut Faults,
) -> Vec<(Input, usize)> {
    let mut inputs: Vec<(Input, usize)> = Vec::new();
    for table in root.sections("input", faults) {
        let name = table.needed_string("name", faults);
        let pushes = pushes(&table, mechanism, faults);
        let gain = table.number_that("gain", "different from 0", |x| x != 0.0, faults);
        let between = between_samples(&table, faults);
        let Some(name) = name else {
            continue;
        };
        let unfit = |c: char| c.is_control() || matches!(c, ',' | '"');
        if name.value.is_empty() || name.value.trim() != name.value || name.value.contains(unfit) {
            faults.at(
                name.offset(),
                format!(
                    "the input's name {} cannot head the column u.<name> of a log: no blanks around it, no comma, quote or control character",
                    quoted(name.value)
                ),
            );
        }
        if inputs.iter().any(|(other, _)| other.name == name.value) {
            faults.at(
                name.offset(),
                format!("two inputs are called {}: rename one", quoted(name.value)),
            );
        }
        inputs.push((
            Input {
                name: name.value.to_owned(),
                pushes: pushes.unwrap_or(Pushes::Coordinate(0)),
                gain: gain.unwrap_or(1.0),
                between,
            },
            table.offset,
        ));
    }
    inputs
}

/// The keys of an input on a link.
pub(super) const OF_LINK: [&str; 3] = ["point", "force", "torque"];

/// `joint`, or `link` with `force`, `torque` and `point`.
fn pushes(table: &Section, mechanism: Option<&Mechanism>, faults: &mut Faults) -> Option<Pushes> {
    let all = ["name", "joint", "link", "gain", "between_samples"];
    table.check_keys(&[&all[..], &OF_LINK[..]].concat(), faults);
    match (table.get("joint"), table.get("link")) {
        (Some(joint), Some(_)) => {
            faults.at(
                joint.span().start,
                "an input has a `joint` or a `link`: leave one of them out",
            );
            on_link(table, mechanism, faults)
        }
        (None, Some(_)) => on_link(table, mechanism, faults),
        (joint, None) => {
            if joint.is_none() {
                faults.at(
                    table.offset,
                    "[[input]] has neither `joint` nor `link`: write `joint = \"…\"`, or `link = \"…\"` with the `force` and the `torque` that turn \
                     with it",
                );
            }
            for (key, value) in OF_LINK
                .iter()
                .filter_map(|key| Some((key, table.get(key)?)))
            {
                faults.at(
                    value.span().start,
                    format!("`{key}` goes with a `link = \"…\"`, which it turns with, and not with a joint"),
                );
            }
            let joint = table.string("joint", faults)?;
            find_coordinate(mechanism?, joint.value, joint.offset(), faults).map(Pushes::Coordinate)
        }
    }
}

fn on_link(table: &Section, mechanism: Option<&Mechanism>, faults: &mut Faults) -> Option<Pushes> {
    let name = table.string("link", faults);
    let mut vector = |key, meaning| match table.get(key) {
        None => Some([0.0; 3]),
        Some(_) => table.triple(key, meaning, faults),
    };
    let point = vector("point", "in m in the link's frame");
    let force = vector("force", "in N in the link's axes, at gain · u = 1");
    let torque = vector("torque", "in N·m in the link's axes, at gain · u = 1");
    let (name, mechanism) = (name?, mechanism?);
    let Some(tree) = &mechanism.tree else {
        faults.at(
            name.offset(),
            "an input on a `link` needs a URDF, and this mechanism is given by its energies: write `joint = \"…\"`",
        );
        return None;
    };
    let link = find_link(tree, &name, faults);
    if (force, torque) == (Some([0.0; 3]), Some([0.0; 3])) {
        faults.at(
            name.offset(),
            "an input on a link needs a `force = [x, y, z]` or a `torque = [x, y, z]` in the link's axes, of which one is not 0",
        );
    }
    let on = OnLink {
        link: link?,
        point: point?,
        force: force?,
        torque: torque?,
    };
    let fault = match tree.link_force(on.link, on.point, on.force, on.torque) {
        None => Some(format!(
            "link {} does not move: what pushes it moves nothing",
            quoted(name.value)
        )),
        Some(law) if !law.is_finite() => Some(
            "the moment of this input, point × force + torque, is too large for a number"
                .to_owned(),
        ),
        Some(_) => None,
    };
    if let Some(fault) = fault {
        faults.at(name.offset(), fault);
    }
    Some(Pushes::Link(on))
}

/// What an `[[input]]` does between two samples.
fn between_samples(table: &Section, faults: &mut Faults) -> Between {
    let Some(word) = table.string("between_samples", faults) else {
        return Between::default();
    };
    let known = Between::ALL.into_iter().find(|b| b.name() == word.value);
    known.unwrap_or_else(|| {
        let fault = format!(
            "`between_samples` is {}: it must be \"held\" or \"smooth\"",
            quoted(word.value)
        );
        faults.at(word.offset(), fault);
        Between::default()
    })
}
