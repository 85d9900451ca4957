//! A graph flattened to a list of instructions on f64.

use super::derivative::mark_arguments;
use super::graph::{Graph, Id, Node};
use crate::expression::{Binary, Unary};

/// Straight-line code. Registers: the inputs, the constants, then one result an instruction.
#[derive(Debug, Clone)]
pub struct Program {
    inputs: usize,
    constants: Vec<f64>,
    instructions: Vec<Instruction>,
    outputs: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
enum Instruction {
    Add(u32, u32),
    Subtract(u32, u32),
    Multiply(u32, u32),
    Divide(u32, u32),
    Negate(u32),
    Powi(u32, i32),
    One(Unary, u32),
    Two(Binary, u32, u32),
}

impl Program {
    /// The program that computes `outputs` from `inputs` variables.
    pub fn new(graph: &Graph, inputs: usize, outputs: &[Id]) -> Self {
        let mut needed = vec![false; outputs.iter().max().map_or(0, |&id| id as usize + 1)];
        for &output in outputs {
            needed[output as usize] = true;
        }
        mark_arguments(graph, &mut needed);
        let ids = || (0..needed.len() as Id).filter(|&id| needed[id as usize]);
        let mut register = vec![0_u32; needed.len()];
        let mut constants = Vec::new();
        let mut next = inputs as u32;
        let mut place = |constant: f64, constants: &mut Vec<f64>| {
            constants.push(constant);
            next += 1;
            next - 1
        };
        for id in ids() {
            match graph.node(id) {
                Node::Variable(index) => register[id as usize] = index,
                Node::Constant(bits) => {
                    register[id as usize] = place(f64::from_bits(bits), &mut constants);
                }
                _ => {}
            }
        }
        let mut instructions = Vec::new();
        for id in ids() {
            let r = |a: Id| register[a as usize];
            let instruction = match graph.node(id) {
                Node::Constant(_) | Node::Variable(_) => continue,
                Node::Add(a, b) => Instruction::Add(r(a), r(b)),
                Node::Subtract(a, b) => Instruction::Subtract(r(a), r(b)),
                Node::Multiply(a, b) => Instruction::Multiply(r(a), r(b)),
                Node::Divide(a, b) => Instruction::Divide(r(a), r(b)),
                Node::Negate(a) => Instruction::Negate(r(a)),
                Node::Powi(a, n) => Instruction::Powi(r(a), n),
                Node::One(f, a) => Instruction::One(f, r(a)),
                Node::Two(f, a, b) => Instruction::Two(f, r(a), r(b)),
            };
            register[id as usize] = (inputs + constants.len() + instructions.len()) as u32;
            instructions.push(instruction);
        }
        Program {
            inputs,
            constants,
            instructions,
            outputs: outputs.iter().map(|&id| register[id as usize]).collect(),
        }
    }

    /// Number of instructions.
    pub fn len(&self) -> usize {
        self.instructions.len()
    }

    /// Registers with the constants in place.
    pub fn registers(&self) -> Vec<f64> {
        let mut registers = vec![0.0; self.inputs];
        registers.extend_from_slice(&self.constants);
        registers.resize(registers.len() + self.instructions.len(), 0.0);
        registers
    }

    /// Runs the program on the inputs that stand in the first registers.
    pub fn run(&self, registers: &mut [f64]) {
        let first = self.inputs + self.constants.len();
        for (k, instruction) in self.instructions.iter().enumerate() {
            let r = |a: u32| registers[a as usize];
            registers[first + k] = match *instruction {
                Instruction::Add(a, b) => r(a) + r(b),
                Instruction::Subtract(a, b) => r(a) - r(b),
                Instruction::Multiply(a, b) => r(a) * r(b),
                Instruction::Divide(a, b) => r(a) / r(b),
                Instruction::Negate(a) => -r(a),
                Instruction::Powi(a, n) => r(a).powi(n),
                Instruction::One(f, a) => f.of(r(a)),
                Instruction::Two(f, a, b) => f.of(r(a), r(b)),
            };
        }
    }

    /// The outputs of the last [`run`](Self::run), in the order they were asked for.
    pub fn outputs<'a>(&'a self, registers: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.outputs.iter().map(|&o| registers[o as usize])
    }
}
