//! A graph flattened to a list of instructions on f64.

use super::derivative::mark_arguments;
use super::graph::{Graph, Id, Node};
use crate::Scalar;
use crate::expression::{Binary, Unary};
use crate::lanes::{LANES, Lanes};
use crate::processor::{Processor, Task};

/// Straight-line code. Registers: the inputs, the constants, then one result an instruction.
///
/// Instructions of one kind stand together as far as what they need is there, so that the kind is asked for once a run of them: in a
/// long program without this order, most of the time goes into jumps that the processor cannot foresee.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    inputs: usize,
    constants: Vec<f64>,
    runs: Vec<Run>,
    /// The registers that each instruction reads; an exponent in place of the second one for an integer power.
    operands: Vec<[u32; 2]>,
    outputs: Vec<u32>,
}

/// Instructions of one kind, up to `end` of the operands.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Run {
    kind: Kind,
    end: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Add,
    Subtract,
    Multiply,
    Divide,
    Negate,
    Powi,
    One(Unary),
    Two(Binary),
}

impl Kind {
    /// The kind of a node that is computed.
    fn of(node: Node) -> Option<Kind> {
        match node {
            Node::Constant(_) | Node::Variable(_) => None,
            Node::Add(..) => Some(Kind::Add),
            Node::Subtract(..) => Some(Kind::Subtract),
            Node::Multiply(..) => Some(Kind::Multiply),
            Node::Divide(..) => Some(Kind::Divide),
            Node::Negate(_) => Some(Kind::Negate),
            Node::Powi(..) => Some(Kind::Powi),
            Node::One(f, _) => Some(Kind::One(f)),
            Node::Two(f, ..) => Some(Kind::Two(f)),
        }
    }
}

impl Program {
    /// The program that computes `outputs` from `inputs` variables.
    pub fn new(graph: &Graph, inputs: usize, outputs: &[Id]) -> Self {
        let mut needed = vec![false; outputs.iter().max().map_or(0, |&id| id as usize + 1)];
        for &output in outputs {
            needed[output as usize] = true;
        }
        mark_arguments(graph, &mut needed);
        let mut register = vec![0_u32; needed.len()];
        let mut constants = Vec::new();
        for id in (0..needed.len() as Id).filter(|&id| needed[id as usize]) {
            match graph.node(id) {
                Node::Variable(index) => register[id as usize] = index,
                Node::Constant(bits) => {
                    register[id as usize] = (inputs + constants.len()) as u32;
                    constants.push(f64::from_bits(bits));
                }
                _ => {}
            }
        }
        let mut runs: Vec<Run> = Vec::new();
        let mut operands = Vec::new();
        for (kind, id) in in_runs(graph, &needed) {
            let r = |a: Id| register[a as usize];
            let arguments = match graph.node(id) {
                Node::Powi(a, n) => [r(a), n.cast_unsigned()],
                _ => {
                    let mut arguments = graph.arguments(id).map(r);
                    [arguments.next(), arguments.next()].map(|a| a.unwrap_or(0))
                }
            };
            register[id as usize] = (inputs + constants.len() + operands.len()) as u32;
            operands.push(arguments);
            let end = operands.len() as u32;
            match runs.last_mut() {
                Some(run) if run.kind == kind => run.end = end,
                _ => runs.push(Run { kind, end }),
            }
        }
        Program {
            inputs,
            constants,
            runs,
            operands,
            outputs: outputs.iter().map(|&id| register[id as usize]).collect(),
        }
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of outputs.
    pub fn outputs_len(&self) -> usize {
        self.outputs.len()
    }

    /// Number of instructions.
    pub fn len(&self) -> usize {
        self.operands.len()
    }

    /// Number of registers.
    pub fn size(&self) -> usize {
        self.inputs + self.constants.len() + self.operands.len()
    }

    /// Registers with the constants in place.
    pub fn registers(&self) -> Vec<f64> {
        let mut registers = vec![0.0; self.size()];
        self.put_constants(&mut registers);
        registers
    }

    /// Puts the constants in their place.
    #[inline]
    pub fn put_constants(&self, registers: &mut [f64]) {
        let places = registers.iter_mut().skip(self.inputs);
        for (place, constant) in places.zip(&self.constants) {
            *place = *constant;
        }
    }

    /// Runs the program on the inputs that stand in the first registers.
    #[inline]
    pub fn run(&self, registers: &mut [f64]) {
        let mut start = 0;
        let mut to = self.inputs + self.constants.len();
        for run in &self.runs {
            let operands = &self.operands[start..run.end as usize];
            let all = (registers as &mut [f64], to, operands);
            match run.kind {
                Kind::Add => each(all, |a, b| a + b),
                Kind::Subtract => each(all, |a, b| a - b),
                Kind::Multiply => each(all, |a, b| a * b),
                Kind::Divide => each(all, |a, b| a / b),
                Kind::Negate => each(all, |a, _| -a),
                Kind::One(Unary::Sin) => each(all, |a, _| a.sin()),
                Kind::One(Unary::Cos) => each(all, |a, _| a.cos()),
                Kind::One(f) => each(all, |a, _| f.of(a)),
                Kind::Two(f) => each(all, |a, b| f.of(a, b)),
                Kind::Powi => {
                    let (registers, to, operands) = all;
                    for (k, &[a, n]) in operands.iter().enumerate() {
                        registers[to + k] = registers[a as usize].powi(n.cast_signed());
                    }
                }
            }
            to += operands.len();
            start = run.end as usize;
        }
    }

    /// Runs the program on eight states at once, from inputs that stand in the first registers of `lanes`; writes the constants, too.
    pub fn run_on(&self, processor: Processor, lanes: &mut [Lanes<true>]) {
        let program = self;
        processor.run(RunLanes { program, lanes });
    }

    #[inline(always)]
    fn run_lanes<const F: bool>(&self, lanes: &mut [Lanes<true>]) {
        let mut to = self.inputs;
        for constant in &self.constants {
            lanes[to] = Lanes::constant(*constant);
            to += 1;
        }
        let mut start = 0;
        for run in &self.runs {
            let operands = &self.operands[start..run.end as usize];
            // Loops and no closures, which may be compiled without the instructions that are wanted here.
            macro_rules! each {
                ($result:ident = |$a:ident, $b:ident| $value:expr) => {
                    for (k, &[a, b]) in operands.iter().enumerate() {
                        let ($a, $b) = (at::<F>(lanes, a), at::<F>(lanes, b));
                        let $result: Lanes<F> = $value;
                        lanes[to + k] = Lanes($result.0);
                    }
                };
            }
            match run.kind {
                Kind::Add => each!(x = |a, b| a + b),
                Kind::Subtract => each!(x = |a, b| a - b),
                Kind::Multiply => each!(x = |a, b| a * b),
                Kind::Divide => each!(x = |a, b| a / b),
                Kind::Negate => each!(x = |a, _b| -a),
                Kind::One(Unary::Sin) => each!(x = |a, _b| a.sin_cos().0),
                Kind::One(Unary::Cos) => each!(x = |a, _b| a.sin_cos().1),
                Kind::One(Unary::Sqrt) => each!(x = |a, _b| a.sqrt()),
                Kind::One(Unary::Abs) => each!(x = |a, _b| a.abs()),
                Kind::One(Unary::Sign) => each!(x = |a, _b| a.sign()),
                Kind::One(Unary::Exp) => each!(x = |a, _b| a.exp()),
                Kind::One(Unary::Tanh) => each!(x = |a, _b| a.tanh()),
                Kind::One(f) => each!(x = |a, _b| one_by_library(f, a)),
                Kind::Two(f) => each!(x = |a, b| two_by_library(f, a, b)),
                Kind::Powi => {
                    for (k, &[a, n]) in operands.iter().enumerate() {
                        let power = at::<F>(lanes, a).powi(n.cast_signed());
                        lanes[to + k] = Lanes(power.0);
                    }
                }
            }
            to += operands.len();
            start = run.end as usize;
        }
    }

    /// The outputs of the last [`run_on`](Self::run_on), in the order they were asked for.
    pub fn lane_outputs<'a>(
        &'a self,
        lanes: &'a [Lanes<true>],
    ) -> impl Iterator<Item = [f64; LANES]> + 'a {
        self.outputs.iter().map(|&o| lanes[o as usize].0)
    }

    /// The outputs of the last [`run`](Self::run), in the order they were asked for.
    pub fn outputs<'a>(&'a self, registers: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.outputs.iter().map(|&o| registers[o as usize])
    }
}

struct RunLanes<'a> {
    program: &'a Program,
    lanes: &'a mut [Lanes<true>],
}

impl Task for RunLanes<'_> {
    #[inline(always)]
    fn run<const F: bool>(self) {
        self.program.run_lanes::<F>(self.lanes);
    }
}

/// One operation after another, to the registers from `to` on.
#[inline(always)]
fn each((registers, to, operands): (&mut [f64], usize, &[[u32; 2]]), f: impl Fn(f64, f64) -> f64) {
    for (k, &[a, b]) in operands.iter().enumerate() {
        registers[to + k] = f(registers[a as usize], registers[b as usize]);
    }
}

/// Whatever the register was written with, its numbers.
#[inline(always)]
fn at<const F: bool>(lanes: &[Lanes<true>], register: u32) -> Lanes<F> {
    Lanes(lanes[register as usize].0)
}

/// A call of its own, so that the loops of the common instructions stay short.
#[inline(never)]
fn one_by_library<const F: bool>(f: Unary, x: Lanes<F>) -> Lanes<F> {
    f.of(x)
}

/// As [`one_by_library`].
#[inline(never)]
fn two_by_library<const F: bool>(f: Binary, x: Lanes<F>, y: Lanes<F>) -> Lanes<F> {
    f.of(x, y)
}

/// The needed nodes that are computed, every one after its arguments: always the kind next of which most can be computed by now, and
/// all that can be of this kind.
fn in_runs(graph: &Graph, needed: &[bool]) -> Vec<(Kind, Id)> {
    let computed = |id: Id| Kind::of(graph.node(id));
    let mut missing = vec![0_usize; needed.len()];
    let mut used_by: Vec<Vec<Id>> = vec![Vec::new(); needed.len()];
    let mut ready: Vec<(Kind, Vec<Id>)> = Vec::new();
    let put = |ready: &mut Vec<(Kind, Vec<Id>)>, kind: Kind, id: Id| match ready
        .iter_mut()
        .find(|(known, _)| *known == kind)
    {
        Some((_, ids)) => ids.push(id),
        None => ready.push((kind, vec![id])),
    };
    for id in (0..needed.len() as Id).filter(|&id| needed[id as usize]) {
        let Some(kind) = computed(id) else { continue };
        for argument in graph.arguments(id).filter(|&a| computed(a).is_some()) {
            missing[id as usize] += 1;
            used_by[argument as usize].push(id);
        }
        if missing[id as usize] == 0 {
            put(&mut ready, kind, id);
        }
    }
    let mut order = Vec::new();
    while let Some(most) = (0..ready.len()).max_by_key(|&k| (ready[k].1.len(), ready.len() - k)) {
        if ready[most].1.is_empty() {
            break;
        }
        let kind = ready[most].0;
        let mut done = 0;
        while let Some(&id) = ready[most].1.get(done) {
            done += 1;
            order.push((kind, id));
            for &user in &used_by[id as usize] {
                missing[user as usize] -= 1;
                if missing[user as usize] == 0
                    && let Some(kind) = computed(user)
                {
                    put(&mut ready, kind, user);
                }
            }
        }
        ready[most].1.clear();
    }
    order
}
