//! The constraints of a model file: `[[loop]]` tables of a URDF, `constraints` of `[lagrangian]`.

use std::path::Path;
use std::sync::Arc;

use lagrange::constraint::{Constrained, Constraint, LinkPoint, Loop, LoopField, Loops};
use lagrange::mechanism::Tree;
use lagrange::{Mechanics, Position, Problem, Problems};

use super::document::{Faults, Section};
use crate::naming::{hint, quoted};

const COMPONENTS: [&str; 3] = ["x", "y", "z"];

/// One equation φ = 0 of a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConstraintEntry {
    /// Its name in errors and outputs.
    pub name: String,
    /// What it says, for people.
    pub description: String,
    /// Whether it is in force; else it follows from the others and is left out.
    pub in_force: bool,
}

/// A mechanism, with its constraints where it has some.
pub(super) struct Joined {
    mechanics: Arc<dyn Mechanics>,
    pub entries: Vec<ConstraintEntry>,
    /// Redundant equations.
    warnings: Vec<Problem>,
}

impl Joined {
    /// Without constraints.
    pub fn free(mechanics: impl Mechanics + 'static) -> Self {
        Joined {
            mechanics: Arc::new(mechanics),
            entries: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// The mechanics; `warnings` get what is redundant, as of the model file `source`.
    pub fn mechanics(&self, source: &Path, warnings: &mut Vec<Problems>) -> Arc<dyn Mechanics> {
        if !self.warnings.is_empty() {
            warnings.push(Problems {
                source: source.display().to_string(),
                list: self.warnings.clone(),
            });
        }
        self.mechanics.clone()
    }
}

/// `free` with the loops of the `[[loop]]` tables.
pub(super) fn close_loops<M: Mechanics + 'static>(
    free: M,
    tree: &Tree,
    root: &Section,
    text: &str,
    faults: &mut Faults,
) -> Option<Joined> {
    if root.get("loop").is_none() {
        return Some(Joined::free(free));
    }
    let (loops, offsets) = loops(root, tree, faults)?;
    let shown = loops.clone();
    let described = |equation: usize| {
        let (description, of) = describe(&shown, equation);
        (description, offsets.get(of).copied().unwrap_or(0))
    };
    join(free, loops, described, text, faults)
}

/// `free` under `constraint`; `describe(equation)` says what it says and at which byte of `text` it stands.
pub(super) fn join<M: Mechanics + 'static, C: Constraint + 'static>(
    free: M,
    constraint: C,
    describe: impl Fn(usize) -> (String, usize),
    text: &str,
    faults: &mut Faults,
) -> Option<Joined> {
    let whole: Vec<String> = (0..constraint.len()).map(|i| constraint.name(i)).collect();
    let constrained = match Constrained::new(free, constraint) {
        Ok(constrained) => constrained,
        Err(e) => {
            // The equation that the error names is the place to look at.
            let culprit = match &e {
                lagrange::Error::Inconsistent { name, .. }
                | lagrange::Error::ConstraintScale { name, .. } => {
                    whole.iter().position(|n| n == name)
                }
                _ => None,
            };
            faults.at(describe(culprit.unwrap_or(0)).1, e.to_string());
            return None;
        }
    };
    let dropped = constrained.dropped();
    let entries = whole
        .into_iter()
        .enumerate()
        .map(|(i, name)| ConstraintEntry {
            name,
            description: describe(i).0,
            in_force: dropped.iter().all(|d| d.equation != i),
        });
    let warnings = dropped
        .iter()
        .map(|d| Problem::at(Position::of(text, describe(d.equation).1), d.to_string()));
    Some(Joined {
        entries: entries.collect(),
        warnings: warnings.collect(),
        mechanics: Arc::new(constrained),
    })
}

/// The `[[loop]]` tables, and the byte at which each stands; `None` when one is faulty.
fn loops(root: &Section, tree: &Tree, faults: &mut Faults) -> Option<(Loops, Vec<usize>)> {
    let tables = root.sections("loop", faults);
    let count = tables.len();
    let read: Vec<Loop> = tables
        .iter()
        .filter_map(|table| read_loop(table, faults))
        .collect();
    if read.len() != count {
        return None;
    }
    match Loops::new(tree, read) {
        Ok(loops) => Some((loops, tables.iter().map(|table| table.offset).collect())),
        Err(problems) => {
            for problem in problems {
                let place = tables.get(problem.index).map(|table| {
                    let key = match problem.field {
                        LoopField::Name => "name",
                        LoopField::A => "a",
                        LoopField::B => "b",
                        LoopField::Components => "components",
                        _ => return table.offset,
                    };
                    let value = table.get(key);
                    value.map_or(table.offset, |value| value.span().start)
                });
                faults.at(place.unwrap_or(0), problem.message);
            }
            None
        }
    }
}

/// What equation `equation` of `loops` says, and which loop it belongs to.
fn describe(loops: &Loops, equation: usize) -> (String, usize) {
    let (of, component) = loops.equation(equation).unwrap_or((0, 0));
    let description = loops.loops().get(of).map_or(String::new(), |l| {
        let point = |p: &LinkPoint| {
            let [x, y, z] = p.point;
            format!("{} ({x}, {y}, {z}) m", p.link)
        };
        let axis = COMPONENTS.get(component).copied().unwrap_or("");
        format!("{} and {} have the same {axis}", point(&l.a), point(&l.b))
    });
    (description, of)
}

fn read_loop(table: &Section, faults: &mut Faults) -> Option<Loop> {
    table.check_keys(&["name", "a", "b", "components"], faults);
    let name = table
        .string("name", faults)
        .map(|name| name.value.to_owned());
    let components = components(table, faults);
    let (a, b) = (point(table, "a", faults), point(table, "b", faults));
    let (a, b) = (a?, b?);
    Some(Loop {
        name: name.unwrap_or_else(|| format!("{}-{}", a.link, b.link)),
        a,
        b,
        components: components?,
    })
}

fn components(table: &Section, faults: &mut Faults) -> Option<[bool; 3]> {
    if table.get("components").is_none() {
        return Some([true; 3]);
    }
    let mut closed = [false; 3];
    for word in table.strings("components", faults)? {
        match COMPONENTS.iter().position(|c| *c == word.value) {
            Some(index) => closed[index] = true,
            None => faults.at(
                word.offset(),
                format!(
                    "unknown component {}{}",
                    quoted(word.value),
                    hint(word.value, "components", &COMPONENTS)
                ),
            ),
        }
    }
    Some(closed)
}

/// `a` or `b`: { link = "…", point = [x, y, z] }; the link's origin where there is no point.
fn point(table: &Section, key: &str, faults: &mut Faults) -> Option<LinkPoint> {
    if table.get(key).is_none() {
        faults.at(
            table.offset,
            format!(
                "{} has no `{key}`, the point {{ link = \"…\", point = [x, y, z] }} in m in the link's frame",
                table.title
            ),
        );
        return None;
    }
    let place = table.section(key, &format!("`{key}` of {}", table.title), faults)?;
    place.check_keys(&["link", "point"], faults);
    let link = place.needed_string("link", faults);
    let point = match place.get("point") {
        None => Some([0.0; 3]),
        Some(_) => place.triple("point", "in m in the link's frame", faults),
    };
    Some(LinkPoint {
        link: link?.value.to_owned(),
        point: point?,
    })
}
