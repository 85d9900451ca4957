//! Joints that follow others.

use std::collections::HashSet;

use super::Options;
use super::motion::{is_moving, is_single};
use super::names::{Names, names};
use super::report::{Report, shown};
use super::source::Source;

/// Leaders exist, move, and are not led by their followers.
pub(super) fn mimics(source: &Source, joints: &Names, follow: bool, report: &mut Report) {
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

/// The joint whose coordinate moves joint `j`, with the chain's multipliers not zero.
pub(super) fn leader(
    source: &Source,
    mut j: usize,
    joints: &Names,
    options: &Options,
) -> Option<usize> {
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
