//! The same operations for plain numbers: straight-line code that computes every value once.

use super::Binary;
use super::tape::{Op, Operator, Tape};
use crate::trace::{Graph, Id, Node, Program};

/// Programs of more registers than these are left to the tape.
const MOST: usize = 128;

/// A tape as a program on f64. It makes the operations of the tape, each of them once, and none but those: the values are the tape's to
/// the last bit. (x² and x³ are products, which is what `powi` makes of them.)
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Flat {
    program: Program,
    /// The slots of the variables that it reads, in the order of its inputs.
    slots: Vec<usize>,
}

impl Flat {
    /// The program of a tape; none for a long one, and for one with a constant power that is no integer.
    pub fn of(tape: &Tape) -> Option<Self> {
        let mut slots: Vec<usize> = Vec::new();
        let mut graph = Graph::default();
        let mut stack: Vec<Id> = Vec::new();
        for &op in tape.ops() {
            let node = match op {
                Op::Constant(c) => {
                    stack.push(graph.constant(c));
                    continue;
                }
                Op::Variable(slot) => {
                    let slot = slot as usize;
                    let known = slots.iter().position(|&s| s == slot);
                    let input = known.unwrap_or_else(|| {
                        slots.push(slot);
                        slots.len() - 1
                    });
                    Node::Variable(input as u32)
                }
                Op::Operator(f) => {
                    let (b, a) = (stack.pop()?, stack.pop()?);
                    operation(f, a, b)
                }
                Op::Negate => Node::Negate(stack.pop()?),
                Op::Unary(f) => Node::One(f, stack.pop()?),
                Op::AddConstant(c) => Node::Add(stack.pop()?, graph.constant(c)),
                Op::MulConstant(c) => Node::Multiply(stack.pop()?, graph.constant(c)),
                Op::DivConstant(c) => Node::Divide(stack.pop()?, graph.constant(c)),
                Op::Powi(2) => {
                    let x = stack.pop()?;
                    Node::Multiply(x, x)
                }
                Op::Powi(3) => {
                    let x = stack.pop()?;
                    Node::Multiply(x, graph.put(Node::Multiply(x, x)))
                }
                Op::Powi(n) => Node::Powi(stack.pop()?, n),
                Op::Powf(_) => return None,
            };
            stack.push(graph.put(node));
        }
        let program = Program::new(&graph, slots.len(), &[stack.pop()?]);
        (program.size() <= MOST).then_some(Flat { program, slots })
    }

    /// The value, with `variable(slot)` for the variables.
    #[inline]
    pub fn value(&self, variable: impl Fn(usize) -> f64) -> f64 {
        // Registers on the stack of the thread; several sizes, because filling them costs as much as a short program.
        match self.program.size() {
            0..=16 => self.run(&mut [0.0; 16], variable),
            17..=32 => self.run(&mut [0.0; 32], variable),
            33..=64 => self.run(&mut [0.0; 64], variable),
            _ => self.run(&mut [0.0; MOST], variable),
        }
    }

    #[inline]
    fn run(&self, registers: &mut [f64], variable: impl Fn(usize) -> f64) -> f64 {
        for (register, &slot) in registers.iter_mut().zip(&self.slots) {
            *register = variable(slot);
        }
        self.program.put_constants(registers);
        self.program.run(registers);
        self.program.outputs(registers).next().unwrap_or(f64::NAN)
    }
}

/// Sums and products with their arguments in one order, so that equal ones are one.
fn operation(f: Operator, a: Id, b: Id) -> Node {
    match f {
        Operator::Add => Node::Add(a.min(b), a.max(b)),
        Operator::Mul => Node::Multiply(a.min(b), a.max(b)),
        Operator::Sub => Node::Subtract(a, b),
        Operator::Div => Node::Divide(a, b),
        Operator::Two(f @ (Binary::Atan2 | Binary::Min | Binary::Max | Binary::Pow)) => {
            Node::Two(f, a, b)
        }
    }
}

#[cfg(test)]
#[allow(clippy::panic)] // of tests
mod tests {
    use super::super::FUNCTIONS;
    use super::super::parser::parse;
    use super::*;

    const NAMES: [&str; 3] = ["x", "y", "z"];

    /// The tape of a text over x, y, z.
    fn tape(text: &str) -> Tape {
        parse(text, &NAMES)
            .map(|(tape, _)| tape)
            .unwrap_or_else(|e| panic!("{text}: {e:?}"))
    }

    /// Energies, every function, shared parts, and values that are no numbers.
    fn texts() -> Vec<String> {
        let mut texts: Vec<String> = [
            "x",
            "2",
            "0.5*(x + y)*z^2",
            "0.5*(3 + 0.2)*x^2 + 0.2*0.7*cos(y)*x*z + 0.5*(0.01 + 0.2*0.7^2)*z^2",
            "(x*cos(y) + (x + z)*cos(y + z))^2 + (x*sin(y) + (x + z)*sin(y + z))^2",
            "x^3 + (x + y)^3 - x^(-2) + (y*z)^7 + z^y",
            "0*ln(x) + (y - y)/(x - x)",
            "-x - (-y) + 1 - z - x/3 + 3/x - (2 - y)*(y - 2)",
            "x - 0 + 0*y",
        ]
        .map(String::from)
        .to_vec();
        for (name, function) in FUNCTIONS {
            let arguments = if function.arity() == 1 {
                "x - y"
            } else {
                "x - y, z"
            };
            texts.push(format!("1 + {name}({arguments})*{name}({arguments})"));
        }
        texts
    }

    #[test]
    fn a_program_gives_the_bits_of_the_tape() {
        let special = [0.0, -0.0, 1.0, f64::NAN, f64::INFINITY, 1e-310];
        for text in texts() {
            let tape = tape(&text);
            let flat = Flat::of(&tape).unwrap_or_else(|| panic!("{text}"));
            for k in 0..60 {
                let mut at = [0.7, 1.9, 3.1].map(|s: f64| 1.5 * (s * (k as f64 + 1.0)).sin());
                if k >= 48 {
                    at[k % 3] = special[k % special.len()];
                }
                let (a, b) = (flat.value(|slot| at[slot]), tape.evaluate(|slot| at[slot]));
                // The sign of a zero that is a constant is not kept.
                let same = a.to_bits() == b.to_bits()
                    || (a.is_nan() && b.is_nan())
                    || (a == 0.0 && b == 0.0);
                assert!(same, "{text} at {at:?}: {a:e}, {b:e} by the tape");
            }
        }
    }

    #[test]
    fn what_stands_twice_is_computed_once() {
        let flat = Flat::of(&tape("sin(x + y)^2 + cos(x + y)*sin(y + x)"));
        // x + y, sin, its square, cos, the product, the sum
        assert_eq!(flat.map(|flat| flat.program.len()), Some(6));
    }

    #[test]
    fn long_formulas_and_roots_by_power_are_left_to_the_tape() {
        let long: Vec<String> = (0..200).map(|k| format!("sin({k}*x)")).collect();
        assert_eq!(Flat::of(&tape(&long.join(" + "))), None);
        assert_eq!(Flat::of(&tape("x^0.5")), None);
    }
}
