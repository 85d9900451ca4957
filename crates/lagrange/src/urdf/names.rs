//! Names of links, joints and coordinates: each there once, and the nearest ones for messages.

use std::collections::HashMap;

use super::motion::is_moving;
use super::report::{Report, shown};
use super::source::{At, JointText, Source};
use crate::mechanism::BASE;

/// Where every name stands in its list; only the first of several.
pub(super) struct Names<'s>(HashMap<&'s str, usize>);

impl<'s> Names<'s> {
    pub(super) fn of(
        what: &str,
        names: impl Iterator<Item = &'s At<String>>,
        report: &mut Report,
    ) -> Self {
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
    pub(super) fn get(&self, name: &str) -> Option<usize> {
        self.0.get(name).copied()
    }
    pub(super) fn count(&self) -> usize {
        self.0.len()
    }
    pub(super) fn nearest(&self, name: &str, report: &Report) -> String {
        if report.is_long() {
            return String::new();
        }
        let mut sorted: Vec<&str> = self.0.keys().copied().collect();
        sorted.sort_unstable();
        nearest(name, sorted.into_iter())
    }
}

/// `; did you mean …?`, or nothing when no name is close.
pub(super) fn nearest<'n>(name: &str, known: impl Iterator<Item = &'n str>) -> String {
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

/// Coordinates take their names from the joints: those of a planar joint, and of a base that floats, must be left to them.
pub(super) fn coordinate_names(
    source: &Source,
    joints: &Names,
    floating_base: bool,
    report: &mut Report,
) {
    let moving = |name: &str| {
        let found = joints.get(name).and_then(|j| source.joints.get(j));
        found.filter(|joint| is_moving(joint))
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
pub(super) fn names(source: &Source, chain: &[usize], last: usize) -> Vec<String> {
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
