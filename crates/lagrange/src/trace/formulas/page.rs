//! The formulas for people.

use super::Formulas;
use super::form::{Form, Symbol};
use super::latex::latex;
use super::write::{Notation, Writer};

/// How formulas are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Style {
    /// The notation of [`Expression`](crate::Expression), which parses them again.
    Text,
    /// LaTeX's math mode.
    Latex,
}

/// Formulas, written.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Written {
    /// Names of the entries of q.
    pub coordinates: Vec<String>,
    /// Names of the entries of v.
    pub velocities: Vec<String>,
    /// Names of all constants, also of those that have become numbers.
    pub parameters: Vec<String>,
    /// Names and formulas of shared subexpressions; each uses earlier ones alone.
    pub definitions: Vec<(String, String)>,
    /// M, row by row, both halves.
    pub mass_matrix: Vec<Vec<String>>,
    /// Christoffel's C, row by row; none where T is not quadratic in v.
    pub coriolis_matrix: Option<Vec<Vec<String>>>,
    /// G = +∂V/∂q, on the left-hand side.
    pub gravity_force: Vec<String>,
    /// C v + G, on the left-hand side.
    pub bias_force: Vec<String>,
    /// T, J.
    pub kinetic_energy: String,
    /// V, J.
    pub potential_energy: String,
}

/// Widest line of a text on which a whole matrix is written.
const WIDTH: usize = 110;

/// The parts of the outputs of a block.
pub(super) struct Parts<'a> {
    pub mass: &'a [Form],
    pub coriolis: Option<&'a [Form]>,
    pub gravity: &'a [Form],
    pub bias: &'a [Form],
    /// T and V.
    pub energies: &'a [Form],
}

impl Formulas {
    pub(super) fn parts<'a>(&self, outputs: &'a [Form]) -> Parts<'a> {
        let n = self.sizes.nv;
        let (mass, rest) = outputs.split_at((n * n).min(outputs.len()));
        let square = if self.quadratic { n * n } else { 0 };
        let (coriolis, rest) = rest.split_at(square.min(rest.len()));
        let (gravity, rest) = rest.split_at(n.min(rest.len()));
        let (bias, energies) = rest.split_at(n.min(rest.len()));
        Parts {
            mass,
            coriolis: self.quadratic.then_some(coriolis),
            gravity,
            bias,
            energies,
        }
    }

    /// What the equations leave out, and what v is where it is not q̇; a line each, in ASCII.
    pub(super) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if !self.constraints.is_empty() {
            notes.push(format!(
                "The mechanism has constraints phi(q) = 0: {}.",
                self.constraints.join(", ")
            ));
            notes.push(
                "With them, M dv/dt + C v + G = Q + J^T lambda and J = dphi/dq; phi and J are not written here.".into(),
            );
        }
        for name in &self.names.floating {
            notes.push(format!(
                "{name} floats: v is in the body's axes (linear, then angular), its quaternion w x y z has length 1, and dq/dt is not v."
            ));
        }
        notes
    }

    /// All formulas, one by one.
    pub fn written(&self, style: Style) -> Written {
        let text = |symbol: Symbol| self.names.text(symbol);
        let in_latex = |symbol: Symbol| self.names.latex(symbol);
        let writer = Writer {
            notation: Notation::Text,
            symbol: &text,
        };
        let write = |form: &Form| match style {
            Style::Text => writer.write(form),
            Style::Latex => latex(form, &in_latex),
        };
        let name = |symbol: Symbol| match style {
            Style::Text => text(symbol),
            Style::Latex => in_latex(symbol),
        };
        let all = |forms: &[Form]| -> Vec<String> { forms.iter().map(write).collect() };
        let rows = |forms: &[Form]| -> Vec<Vec<String>> {
            forms.chunks(self.sizes.nv.max(1)).map(all).collect()
        };
        let parts = self.parts(&self.readable.outputs);
        let definitions = self.readable.definitions.iter().enumerate();
        let mut energies = all(parts.energies).into_iter();
        Written {
            coordinates: (0..self.sizes.nq)
                .map(|i| name(Symbol::Coordinate(i)))
                .collect(),
            velocities: (0..self.sizes.nv)
                .map(|i| name(Symbol::Velocity(i)))
                .collect(),
            parameters: (0..self.parameters.len())
                .map(|i| name(Symbol::Parameter(i)))
                .collect(),
            definitions: definitions
                .map(|(i, form)| (name(Symbol::Named(i)), write(form)))
                .collect(),
            mass_matrix: rows(parts.mass),
            coriolis_matrix: parts.coriolis.map(rows),
            gravity_force: all(parts.gravity),
            bias_force: all(parts.bias),
            kinetic_energy: energies.next().unwrap_or_default(),
            potential_energy: energies.next().unwrap_or_default(),
        }
    }

    /// The formulas as a page of text.
    pub fn to_text(&self) -> String {
        let written = self.written(Style::Text);
        let mut text = String::from(if self.quadratic {
            "M(q) v̇ + C(q, v) v + G(q) = Q\n\n"
        } else {
            "M(q, v) v̇ + b(q, v) = Q\n\nT is not quadratic in the velocities: M may depend on them, and there is no matrix C. The bias force b = \
             (∂²T/∂v∂q) v − ∂T/∂q + G stands for C v + G.\n\n"
        });
        for note in self.notes() {
            let symbols = [
                ("J^T lambda", "Jᵀ λ"),
                ("dv/dt", "v̇"),
                ("dphi/dq", "∂φ/∂q"),
                ("phi(q)", "φ(q)"),
                ("phi and J", "φ and J"),
                ("dq/dt", "q̇"),
            ];
            // Names of coordinates and constraints stay as they are: none has these symbols in it but by intent.
            text += &symbols
                .iter()
                .fold(note, |note, (ascii, symbol)| note.replace(ascii, symbol));
            text.push('\n');
        }
        if !self.notes().is_empty() {
            text.push('\n');
        }
        text += &format!("q = [{}]\n", written.coordinates.join(", "));
        text += &format!("v = [{}]\n", written.velocities.join(", "));
        if !self.parameters.is_empty() {
            let constants: Vec<String> = self.constants().collect();
            text += &format!("constants: {}\n", constants.join(", "));
        }
        text.push('\n');
        for (name, formula) in &written.definitions {
            text += &format!("{name} = {formula}\n");
        }
        if !written.definitions.is_empty() {
            text.push('\n');
        }
        let rows = &written.velocities;
        text += &matrix("M", &written.mass_matrix, rows, true);
        match &written.coriolis_matrix {
            Some(coriolis) => text += &matrix("C", coriolis, rows, false),
            None => text += &vector("b", &written.bias_force, rows),
        }
        text += &vector("G", &written.gravity_force, rows);
        text += &format!("T = {}\n", written.kinetic_energy);
        text += &format!("V = {}\n", written.potential_energy);
        text
    }

    /// `name = number` of every constant that stays a name, or stood for a number in the formulas.
    fn constants(&self) -> impl Iterator<Item = String> + '_ {
        let constants = self.parameters.iter().zip(&self.bound).enumerate();
        constants.map(|(i, (parameter, bound))| {
            let name = self.names.text(Symbol::Parameter(i));
            match bound {
                Some(number) => format!("{name} = {number} (as a number)"),
                None => format!("{name} = {}", parameter.nominal),
            }
        })
    }

    /// The formulas as lines for a LaTeX document with the package `amsmath`: displayed equations, without a preamble.
    pub fn to_latex(&self) -> String {
        let written = self.written(Style::Latex);
        let mut text = String::new();
        let column = |name: &str, entries: &[String]| {
            format!(
                "\\[\n{name} = \\begin{{bmatrix}} {} \\end{{bmatrix}}\n\\]\n",
                entries.join(r" \\ ")
            )
        };
        text += &format!(
            "% {}\n",
            if self.quadratic {
                "M(q) dv/dt + C(q, v) v + G(q) = Q"
            } else {
                "M(q, v) dv/dt + b(q, v) = Q; T is not quadratic in v, so that there is no matrix C"
            }
        );
        for note in self.notes() {
            text += &format!("% {note}\n");
        }
        text += &column("q", &written.coordinates);
        text += &column("v", &written.velocities);
        for (name, formula) in &written.definitions {
            text += &format!("\\[\n{name} = {formula}\n\\]\n");
        }
        let small = |rows: &[Vec<String>]| {
            rows.iter()
                .all(|row| row.iter().map(String::len).sum::<usize>() < 4 * WIDTH)
        };
        let mut matrix = |name: &str, rows: &[Vec<String>]| {
            if small(rows) {
                let rows: Vec<String> = rows.iter().map(|row| row.join(" & ")).collect();
                let rows = rows.join(" \\\\\n");
                text +=
                    &format!("\\[\n{name} = \\begin{{bmatrix}}\n{rows}\n\\end{{bmatrix}}\n\\]\n");
                return;
            }
            for (i, row) in rows.iter().enumerate() {
                for (j, entry) in row.iter().enumerate().filter(|(_, e)| *e != "0") {
                    let (i, j) = (i + 1, j + 1);
                    text += &format!("\\[\n{name}_{{{i},{j}}} = {entry}\n\\]\n");
                }
            }
        };
        matrix("M", &written.mass_matrix);
        match &written.coriolis_matrix {
            Some(coriolis) => matrix("C", coriolis),
            None => text += &column("b", &written.bias_force),
        }
        text += &column("G", &written.gravity_force);
        text += &format!("\\[\nT = {}\n\\]\n", written.kinetic_energy);
        text += &format!("\\[\nV = {}\n\\]\n", written.potential_energy);
        text
    }
}

/// A matrix in its rows, or, where these are long, its entries other than 0 by the names of row and column.
fn matrix(name: &str, rows: &[Vec<String>], names: &[String], symmetric: bool) -> String {
    let n = rows.len();
    let widths: Vec<usize> = (0..n)
        .map(|j| {
            rows.iter()
                .filter_map(|row| row.get(j))
                .map(|e| e.chars().count())
                .max()
        })
        .map(Option::unwrap_or_default)
        .collect();
    let mut text = String::new();
    if widths.iter().map(|w| w + 2).sum::<usize>() <= WIDTH {
        for (i, row) in rows.iter().enumerate() {
            let last = row.len().saturating_sub(1);
            let cells: Vec<String> = row
                .iter()
                .zip(&widths)
                .enumerate()
                .map(|(j, (entry, &width))| match j == last {
                    true => entry.clone(),
                    false => format!("{:<width$}", format!("{entry},"), width = width + 1),
                })
                .collect();
            let open = if i == 0 {
                format!("{name} = [[")
            } else {
                format!("{:>1$}", "[", name.len() + 5)
            };
            let close = if i + 1 == n { "]]" } else { "]," };
            text += &format!("{open}{}{close}\n", cells.join(" "));
        }
    } else {
        for (i, row) in rows.iter().enumerate() {
            for (j, entry) in row.iter().enumerate() {
                let (Some(a), Some(b)) = (names.get(i), names.get(j)) else {
                    continue;
                };
                if entry == "0" || (symmetric && j > i) {
                    continue;
                }
                let mirrored = if symmetric && i != j {
                    format!(" = {name}[{b}, {a}]")
                } else {
                    String::new()
                };
                text += &format!("{name}[{a}, {b}]{mirrored} = {entry}\n");
            }
        }
        text += &format!("all other entries of {name} are 0\n");
    }
    text.push('\n');
    text
}

fn vector(name: &str, entries: &[String], names: &[String]) -> String {
    if entries.iter().map(|e| e.chars().count() + 2).sum::<usize>() <= WIDTH {
        return format!("{name} = [{}]\n\n", entries.join(", "));
    }
    let mut text = String::new();
    for (entry, of) in entries.iter().zip(names) {
        text += &format!("{name}[{of}] = {entry}\n");
    }
    text + "\n"
}
