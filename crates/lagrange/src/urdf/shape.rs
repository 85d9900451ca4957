//! The tree that the joints make of the links.

use std::collections::{HashMap, HashSet};

use super::names::{Names, names};
use super::report::{Report, shown};
use super::source::{At, Source};

/// The tree: the joint above every link, and the links from the root outward.
pub(super) struct Shape {
    pub above: Vec<Option<usize>>,
    pub parent: Vec<Option<usize>>,
    pub outward: Vec<usize>,
}

/// The tree that the joints make of the links; nothing when they make none.
pub(super) fn shape(source: &Source, links: &Names, report: &mut Report) -> Option<Shape> {
    let count = source.links.len();
    let mut above: Vec<Option<usize>> = vec![None; count];
    let mut parent: Vec<Option<usize>> = vec![None; count];
    let mut sound = links.count() == count;
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
