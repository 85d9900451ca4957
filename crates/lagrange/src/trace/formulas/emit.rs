//! The formulas for compilers: one function, without dependencies.

use std::fmt::Write;

use super::Formulas;
use super::form::{Form, Symbol};
use super::names::function_name;
use super::write::{LARGER, Notation, SMALLER, Writer};
use crate::expression::{Binary, Function};

/// One line of what the function computes: where to, and what.
struct Assignment<'a> {
    target: String,
    form: &'a Form,
}

impl Formulas {
    /// A stand-alone Rust file with a struct `Equations` and a function `name(q, v, p) -> Equations`: M, C (where there is one), G,
    /// C v + G and the energies. It needs nothing but `std`. `p` are the constants that have kept their names, in their order; without
    /// any there is no such argument. A `name` that is a keyword, or a function of `math.h`, gets `_model` behind it.
    pub fn emit_rust(&self, name: &str) -> String {
        let (n, nq) = (self.sizes.nv, self.sizes.nq);
        let name = function_name(name);
        let mut text = self.header("//");
        let field =
            |doc: &str, name: &str, kind: &str| format!("    /// {doc}\n    pub {name}: {kind},\n");
        let (square, line) = (format!("[[f64; {n}]; {n}]"), format!("[f64; {n}]"));
        text += "/// The equations of motion at one state.\n#[derive(Debug, Clone, Copy, PartialEq)]\npub struct Equations {\n";
        text += &field("M, row by row.", "mass_matrix", &square);
        if self.quadratic {
            text += &field("C, row by row.", "coriolis_matrix", &square);
        }
        text += &field("G, on the left-hand side.", "gravity_force", &line);
        text += &field(self.bias_words(), "bias_force", &line);
        text += &field("T, J.", "kinetic_energy", "f64");
        text += &field("V, J.", "potential_energy", "f64");
        text += "}\n\n/// M, C, G and the energies at (q, v).\n";
        text += "#[allow(unused_variables, clippy::approx_constant)]\n";
        let free = self.free_constants().len();
        let p = if free > 0 {
            format!(", p: &[f64; {free}]")
        } else {
            String::new()
        };
        let one_line = format!("pub fn {name}(q: &[f64; {nq}], v: &[f64; {n}]{p}) -> Equations {{");
        if one_line.len() <= 100 {
            let _ = writeln!(text, "{one_line}");
        } else {
            let p = if free > 0 {
                format!("    p: &[f64; {free}],\n")
            } else {
                String::new()
            };
            let _ = write!(
                text,
                "pub fn {name}(\n    q: &[f64; {nq}],\n    v: &[f64; {n}],\n{p}) -> Equations {{\n"
            );
        }
        text += "    let mut e = Equations {\n";
        let _ = writeln!(text, "        mass_matrix: [[0.0; {n}]; {n}],");
        if self.quadratic {
            let _ = writeln!(text, "        coriolis_matrix: [[0.0; {n}]; {n}],");
        }
        let _ = writeln!(
            text,
            "        gravity_force: [0.0; {n}],\n        bias_force: [0.0; {n}],"
        );
        text += "        kinetic_energy: 0.0,\n        potential_energy: 0.0,\n    };\n";
        for (function, name, relation) in
            [(Binary::Min, SMALLER, "<="), (Binary::Max, LARGER, ">=")]
        {
            if self.code.calls(Function::Two(function)) {
                let _ = writeln!(
                    text,
                    "    let {name} = |a: f64, b: f64| if a {relation} b || a.is_nan() {{ a }} else {{ b }};"
                );
            }
        }
        let symbol = |symbol: Symbol| self.code_name(symbol);
        let writer = Writer {
            notation: Notation::Rust,
            symbol: &symbol,
        };
        for (i, form) in self.code.definitions.iter().enumerate() {
            let _ = writeln!(
                text,
                "    let {} = {};",
                symbol(Symbol::Named(i)),
                writer.write(form)
            );
        }
        for Assignment { target, form } in self.assignments([
            "e.mass_matrix",
            "e.coriolis_matrix",
            "e.gravity_force",
            "e.bias_force",
            "e.kinetic_energy",
            "e.potential_energy",
        ]) {
            let _ = writeln!(text, "    {target} = {};", writer.write(form));
        }
        text += "    e\n}\n";
        text
    }

    /// A stand-alone C99 file with a function `void name(q, v, p, M, C, G, bias, energy)`, which needs `math.h` alone. Without a C, or
    /// without constants that have kept their names, there is no such argument; `energy` holds T and V. The name is
    /// the one that [`emit_rust`](Self::emit_rust) gives.
    pub fn emit_c(&self, name: &str) -> String {
        let (n, nq) = (self.sizes.nv, self.sizes.nq);
        let name = function_name(name);
        let mut text = self.header("//");
        let free = self.free_constants().len();
        let p = if free > 0 {
            format!("const double p[{free}], ")
        } else {
            String::new()
        };
        let c = if self.quadratic {
            format!("double C[{n}][{n}], ")
        } else {
            String::new()
        };
        text += "#include <math.h>\n\n";
        let _ = write!(
            text,
            "void {name}(const double q[{nq}], const double v[{n}], {p}double M[{n}][{n}],\n    {c}double G[{n}], double bias[{n}], \
             double energy[2])\n{{\n"
        );
        let p = if free > 0 { "    (void)p;\n" } else { "" };
        text += "    (void)q;\n    (void)v;\n";
        text += p;
        let symbol = |symbol: Symbol| self.code_name(symbol);
        let writer = Writer {
            notation: Notation::C,
            symbol: &symbol,
        };
        for (i, form) in self.code.definitions.iter().enumerate() {
            let name = symbol(Symbol::Named(i));
            let _ = writeln!(text, "    const double {name} = {};", writer.write(form));
        }
        let parts = self.parts(&self.code.outputs);
        let squares = [("M", Some(parts.mass)), ("C", parts.coriolis)];
        for (matrix, entries) in squares {
            for (at, form) in entries.unwrap_or(&[]).iter().enumerate() {
                let (i, j) = (at / n, at % n);
                let _ = writeln!(text, "    {matrix}[{i}][{j}] = {};", writer.write(form));
            }
        }
        for (vector, entries) in [
            ("G", parts.gravity),
            ("bias", parts.bias),
            ("energy", parts.energies),
        ] {
            for (i, form) in entries.iter().enumerate() {
                let _ = writeln!(text, "    {vector}[{i}] = {};", writer.write(form));
            }
        }
        text += "}\n";
        text
    }

    /// What the file is, in comments.
    fn header(&self, comment: &str) -> String {
        let mut text = String::new();
        let mut line = |words: &str| {
            let _ = writeln!(text, "{}", format!("{comment} {words}").trim_end());
        };
        line("Equations of motion, written by pinode; SI units.");
        line(if self.quadratic {
            if self.names.floating.is_empty() {
                "M(q) dv/dt + C(q, v) v + G(q) = Q, with Christoffel's C and G = +dV/dq on the left-hand side."
            } else {
                "M(q) dv/dt + C(q, v) v + G(q) = Q, with dM/dt - 2 C skew; G, the slope of V along v, is on the left-hand side."
            }
        } else {
            "M(q, v) dv/dt + bias(q, v) = Q. T is not quadratic in v: there is no matrix C."
        });
        for note in self.notes() {
            line(&note);
        }
        line("");
        let list = |names: &[String]| names.join(", ");
        for (name, names) in [
            ("q", &self.names.coordinates),
            ("v", &self.names.velocities),
        ] {
            line(&format!("{name}: {}", list(names)));
        }
        let free = self.free_constants();
        if !free.is_empty() {
            let constant = |&i: &usize| {
                let nominal = self.parameters.get(i).map_or(f64::NAN, |p| p.nominal);
                format!("{} ({nominal})", self.names.text(Symbol::Parameter(i)))
            };
            let constants: Vec<String> = free.iter().map(constant).collect();
            line(&format!("p, with nominal values: {}", constants.join(", ")));
        }
        text.push('\n');
        text
    }

    fn bias_words(&self) -> &'static str {
        if self.quadratic {
            "C v + G, on the left-hand side."
        } else {
            "What stands for C v + G, on the left-hand side."
        }
    }

    /// Indices of the constants that have kept their names.
    fn free_constants(&self) -> Vec<usize> {
        let bound = self.bound.iter().enumerate();
        bound.filter(|(_, b)| b.is_none()).map(|(i, _)| i).collect()
    }

    fn code_name(&self, symbol: Symbol) -> String {
        match symbol {
            Symbol::Coordinate(i) => format!("q[{i}]"),
            Symbol::Velocity(i) => format!("v[{i}]"),
            Symbol::Parameter(i) => {
                let place = self.free_constants().iter().position(|&k| k == i);
                format!("p[{}]", place.unwrap_or(0))
            }
            Symbol::Named(i) => format!("t{}", i + 1),
        }
    }

    /// The outputs other than 0, with where they go to: M, C, G, bias, T, V.
    fn assignments(&self, targets: [&str; 6]) -> Vec<Assignment<'_>> {
        let n = self.sizes.nv;
        let parts = self.parts(&self.code.outputs);
        let [mass, coriolis, gravity, bias, kinetic, potential] = targets;
        let mut list = Vec::new();
        for (name, forms) in [(mass, Some(parts.mass)), (coriolis, parts.coriolis)] {
            for (at, form) in forms.unwrap_or(&[]).iter().enumerate() {
                let target = format!("{name}[{}][{}]", at / n, at % n);
                list.push(Assignment { target, form });
            }
        }
        for (name, forms) in [(gravity, parts.gravity), (bias, parts.bias)] {
            for (i, form) in forms.iter().enumerate() {
                let target = format!("{name}[{i}]");
                list.push(Assignment { target, form });
            }
        }
        for (name, form) in [kinetic, potential].into_iter().zip(parts.energies) {
            let target = name.to_owned();
            list.push(Assignment { target, form });
        }
        list.retain(|a| !a.form.is_zero());
        list
    }
}
