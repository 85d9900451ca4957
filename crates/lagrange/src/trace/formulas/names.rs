//! What the symbols of formulas are called.

use std::collections::HashSet;

use super::form::Symbol;
use super::latex::latex_name;
use crate::expression::{is_identifier, reserved};
use crate::{Coordinate, Parameter, Role};

/// Names for texts: letters, digits and `_`, each once.
#[derive(Debug, Clone)]
pub struct Names {
    /// One for every entry of q.
    pub coordinates: Vec<String>,
    /// One for every entry of v.
    pub velocities: Vec<String>,
    /// One for every constant.
    pub parameters: Vec<String>,
    /// What named subexpressions begin with.
    pub prefix: &'static str,
}

impl Names {
    pub fn of(coordinates: &[Coordinate], parameters: &[Parameter]) -> Self {
        let mut taken = HashSet::new();
        let mut names = Names {
            coordinates: Vec::new(),
            velocities: Vec::new(),
            parameters: Vec::new(),
            prefix: "t",
        };
        // Constants that the energies name keep their names first.
        for parameter in parameters {
            let wanted = match parameter.role {
                Role::MassScale => format!("scale_{}", parameter.name),
                _ => parameter.name.clone(),
            };
            names.parameters.push(free(&wanted, &mut taken));
        }
        for coordinate in coordinates {
            let stem = free(&coordinate.name, &mut taken);
            if coordinate.floating {
                let of = |part: &&str| format!("{stem}_{part}");
                names.coordinates.extend(POSE.iter().map(of));
                names.velocities.extend(TWIST.iter().map(of));
            } else {
                names
                    .velocities
                    .push(free(&format!("{stem}_dot"), &mut taken));
                names.coordinates.push(stem);
            }
        }
        let clashes = |prefix: &str| {
            taken.iter().any(|name: &String| {
                name.strip_prefix(prefix)
                    .is_some_and(|rest| rest.chars().all(|c| c.is_ascii_digit()))
            })
        };
        let prefixes = ["t", "s", "w", "common_"];
        names.prefix = prefixes
            .into_iter()
            .find(|p| !clashes(p))
            .unwrap_or("named_expression_");
        names
    }

    /// As a text has it.
    pub fn text(&self, symbol: Symbol) -> String {
        let name = match symbol {
            Symbol::Parameter(i) => self.parameters.get(i),
            Symbol::Coordinate(i) => self.coordinates.get(i),
            Symbol::Velocity(i) => self.velocities.get(i),
            Symbol::Named(i) => return format!("{}{}", self.prefix, i + 1),
        };
        name.cloned().unwrap_or_default()
    }

    /// As LaTeX has it; the velocity of a coordinate gets its dot.
    pub fn latex(&self, symbol: Symbol) -> String {
        if let Symbol::Velocity(i) = symbol {
            let name = self.text(symbol);
            let coordinate = self.coordinates.iter().find(|c| format!("{c}_dot") == name);
            return match coordinate {
                Some(coordinate) => dotted(&latex_name(coordinate)),
                None => latex_name(self.velocities.get(i).map_or("", String::as_str)),
            };
        }
        latex_name(&self.text(symbol))
    }
}

/// The dot stands on the letter, not on its index.
fn dotted(name: &str) -> String {
    match name.split_once("_{") {
        Some((stem, index)) => format!(r"\dot{{{stem}}}_{{{index}"),
        None => format!(r"\dot{{{name}}}"),
    }
}

const POSE: [&str; 7] = ["x", "y", "z", "qw", "qx", "qy", "qz"];
const TWIST: [&str; 6] = ["vx", "vy", "vz", "wx", "wy", "wz"];

/// `wanted` as a name that a text can have and that is not taken yet.
fn free(wanted: &str, taken: &mut HashSet<String>) -> String {
    let name = identifier(wanted);
    let mut free = name.clone();
    let mut count = 1;
    while !taken.insert(free.clone()) {
        count += 1;
        free = format!("{name}_{count}");
    }
    free
}

/// `wanted` with `_` for everything that no name has.
pub fn identifier(wanted: &str) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = wanted.chars().map(allowed).collect();
    if is_identifier(&name) && reserved(&name).is_none() {
        name
    } else {
        format!("q_{name}")
    }
}
