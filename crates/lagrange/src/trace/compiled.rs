//! The equations of motion of one mechanism as programs.

use nalgebra::{DMatrix, DVector};

use super::derivative::{TooLarge, derivative, mark_arguments};
use super::graph::{Graph, Id, Node};
use super::program::Program;
use super::traced::{Traced, trace, variable};
use crate::lanes::{LANES, Lanes};
use crate::processor::Processor;
use crate::{InverseDynamicsDerivatives, Lagrangian, Scalar};

/// A graph larger than this is given up.
const MOST_NODES: usize = 60_000;
/// A program longer than this is no faster than dual numbers.
const LONGEST: usize = 6_000;

/// What programs compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quantity {
    Mass,
    Gravity,
    /// ∂T/∂v.
    Momentum,
    Coriolis,
    /// M, C and G.
    Terms,
    Bias,
    /// M a + C v + G.
    Force,
    /// M and the bias force.
    Equations,
    Derivatives,
}

/// The terms of M a + C v + G and their derivatives, each a program from (q, v, a, p), in this order of variables; T is quadratic
/// in v. Matrices column by column.
#[derive(Debug, Clone)]
pub(crate) struct Compiled {
    nv: usize,
    np: usize,
    /// M.
    mass: Program,
    /// G.
    gravity: Program,
    /// ∂T/∂v.
    momentum: Program,
    /// C.
    coriolis: Program,
    /// M, C, G.
    terms: Program,
    /// C v + G.
    bias: Program,
    /// M a + C v + G.
    force: Program,
    /// M, C v + G.
    equations: Program,
    /// ∂Q/∂q, ∂Q/∂v, ∂Q/∂p.
    derivatives: Program,
}

/// Registers of the programs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Registers {
    mass: Vec<f64>,
    gravity: Vec<f64>,
    momentum: Vec<f64>,
    coriolis: Vec<f64>,
    terms: Vec<f64>,
    bias: Vec<f64>,
    force: Vec<f64>,
    equations: Vec<f64>,
    derivatives: Vec<f64>,
}

/// The arguments of the programs; what one does not read may be empty.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Arguments<'a, T = f64> {
    pub q: &'a [T],
    pub v: &'a [T],
    pub a: &'a [T],
    pub p: &'a [f64],
}

/// The registers of the programs for eight states, one program's at a time; they grow when they are first asked for.
#[derive(Debug, Clone, Default)]
pub(crate) struct LaneRegisters(Vec<Lanes<true>>);

impl Compiled {
    /// Compiles the equations; `None` when the energies branch on their arguments or the programs grow too long.
    pub fn of<L: Lagrangian>(lagrangian: &L) -> Option<Self> {
        let (nv, np) = (lagrangian.dof(), lagrangian.parameters().len());
        let (graph, (kinetic, potential)) = trace(|| {
            let range =
                |from: usize, n: usize| -> Vec<Traced> { (from..from + n).map(variable).collect() };
            let (q, v, p) = (range(0, nv), range(nv, nv), range(3 * nv, np));
            // Accelerations are numbered here so that all variables exist before they are asked for.
            range(2 * nv, nv);
            let kinetic = lagrangian.kinetic_with(&q, &v, &p).0;
            (kinetic, lagrangian.potential_with(&q, &p).0)
        });
        if graph.branched {
            return None;
        }
        Self::differentiate(graph, (kinetic, potential), (nv, np)).ok()
    }

    fn differentiate(
        mut graph: Graph,
        (kinetic, potential): (Id, Id),
        (nv, np): (usize, usize),
    ) -> Result<Self, TooLarge> {
        let graph = &mut graph;
        let by = |graph: &mut Graph, roots: &[Id], variables: std::ops::Range<usize>| {
            variables
                .map(|x| derivative(graph, roots, x as u32, MOST_NODES))
                .collect::<Result<Vec<_>, TooLarge>>()
        };
        let (q, v, p) = (0..nv, nv..2 * nv, 3 * nv..3 * nv + np);
        // momentum_i = ∂T/∂v_i; column j of M is ∂momentum/∂v_j.
        let momentum: Vec<Id> = by(graph, &[kinetic], v.clone())?.concat();
        let mass = by(graph, &momentum, v.clone())?;
        let transport = by(graph, &momentum, q.clone())?;
        let kinetic_by_q = by(graph, &[kinetic], q.clone())?.concat();
        let potential_by_q = by(graph, &[potential], q.clone())?.concat();
        let mut bias = Vec::with_capacity(nv);
        let mut force = Vec::with_capacity(nv);
        for i in 0..nv {
            // bias_i = Σ_j ∂momentum_i/∂q_j v_j − ∂T/∂q_i + ∂V/∂q_i
            let mut sum = graph.subtract(potential_by_q[i], kinetic_by_q[i]);
            for (j, column) in transport.iter().enumerate() {
                let velocity = graph.variable((nv + j) as u32);
                let term = graph.multiply(column[i], velocity);
                sum = graph.add(sum, term);
            }
            bias.push(sum);
            for (j, column) in mass.iter().enumerate() {
                let acceleration = graph.variable((2 * nv + j) as u32);
                let term = graph.multiply(column[i], acceleration);
                sum = graph.add(sum, term);
            }
            force.push(sum);
        }
        let inputs = 3 * nv + np;
        let mut columns = by(graph, &force, q.clone())?;
        columns.extend(by(graph, &force, v)?);
        columns.extend(by(graph, &force, p)?);
        let mass = mass.concat();
        let mass_by_q = by(graph, &mass, q)?;
        let coriolis = christoffel(graph, &mass_by_q, nv);
        let program = |outputs: &[&[Id]]| Program::new(graph, inputs, &outputs.concat());
        let compiled = Compiled {
            nv,
            np,
            mass: program(&[&mass]),
            gravity: program(&[&potential_by_q]),
            momentum: program(&[&momentum]),
            coriolis: program(&[&coriolis]),
            terms: program(&[&mass, &coriolis, &potential_by_q]),
            bias: program(&[&bias]),
            force: program(&[&force]),
            equations: program(&[&mass, &bias]),
            derivatives: program(&[&columns.concat()]),
        };
        if compiled.equations.len() + compiled.derivatives.len() > LONGEST {
            return Err(TooLarge);
        }
        Ok(compiled)
    }

    /// Whether a program is so short that on a tree of two joints nothing else is likely to be faster. The lengths are chosen from
    /// timings of the cart-pole and the double pendulum in `benches/robots.rs`.
    pub fn is_short(&self, quantity: Quantity) -> bool {
        let most = match quantity {
            Quantity::Mass | Quantity::Gravity | Quantity::Momentum => 70,
            Quantity::Bias | Quantity::Force => 70,
            Quantity::Equations => 90,
            Quantity::Coriolis => 110,
            Quantity::Terms => 120,
            Quantity::Derivatives => 150,
        };
        self.of_quantity(quantity).len() <= most
    }

    fn of_quantity(&self, quantity: Quantity) -> &Program {
        match quantity {
            Quantity::Mass => &self.mass,
            Quantity::Gravity => &self.gravity,
            Quantity::Momentum => &self.momentum,
            Quantity::Coriolis => &self.coriolis,
            Quantity::Terms => &self.terms,
            Quantity::Bias => &self.bias,
            Quantity::Force => &self.force,
            Quantity::Equations => &self.equations,
            Quantity::Derivatives => &self.derivatives,
        }
    }

    /// A quantity at eight states at once; its numbers go to the slots, one after the other.
    pub fn lanes<'a>(
        &self,
        quantity: Quantity,
        at: Arguments<[f64; LANES]>,
        processor: Processor,
        registers: &mut LaneRegisters,
        slots: impl Iterator<Item = &'a mut [f64; LANES]>,
    ) {
        self.run_lanes(quantity, at, processor, registers);
        let outputs = self.of_quantity(quantity).lane_outputs(&registers.0);
        for (slot, output) in slots.zip(outputs) {
            *slot = output;
        }
    }

    /// Not generic, so that it is compiled once, in this crate.
    fn run_lanes(
        &self,
        quantity: Quantity,
        at: Arguments<[f64; LANES]>,
        processor: Processor,
        LaneRegisters(lanes): &mut LaneRegisters,
    ) {
        let (n, program) = (self.nv, self.of_quantity(quantity));
        if lanes.len() < program.size() {
            lanes.resize(program.size(), Lanes::constant(0.0));
        }
        for (first, values) in [(0, at.q), (n, at.v), (2 * n, at.a)] {
            for (to, from) in lanes[first..].iter_mut().zip(values) {
                *to = Lanes(*from);
            }
        }
        for (to, from) in lanes[3 * n..].iter_mut().zip(at.p) {
            *to = Lanes::constant(*from);
        }
        program.run_on(processor, lanes);
    }

    pub fn registers(&self) -> Registers {
        Registers {
            mass: self.mass.registers(),
            gravity: self.gravity.registers(),
            momentum: self.momentum.registers(),
            coriolis: self.coriolis.registers(),
            terms: self.terms.registers(),
            bias: self.bias.registers(),
            force: self.force.registers(),
            equations: self.equations.registers(),
            derivatives: self.derivatives.registers(),
        }
    }

    /// Runs a program; its outputs go to the slots, one after the other.
    fn run<'a>(
        &self,
        program: &Program,
        at: Arguments,
        registers: &mut [f64],
        slots: impl Iterator<Item = &'a mut f64>,
    ) {
        let Arguments { q, v, a, p } = at;
        let n = self.nv;
        for (first, values) in [(0, q), (n, v), (2 * n, a), (3 * n, p)] {
            registers[first..first + values.len()].copy_from_slice(values);
        }
        debug_assert!(p.len() == self.np);
        program.run(registers);
        for (slot, output) in slots.zip(program.outputs(registers)) {
            *slot = output;
        }
    }

    /// M.
    pub fn mass_matrix(&self, at: Arguments, registers: &mut Registers, out: &mut DMatrix<f64>) {
        self.run(&self.mass, at, &mut registers.mass, out.iter_mut());
    }

    /// G.
    pub fn gravity_force(&self, at: Arguments, registers: &mut Registers, out: &mut DVector<f64>) {
        self.run(&self.gravity, at, &mut registers.gravity, out.iter_mut());
    }

    /// ∂T/∂v.
    pub fn momentum(&self, at: Arguments, registers: &mut Registers, out: &mut DVector<f64>) {
        self.run(&self.momentum, at, &mut registers.momentum, out.iter_mut());
    }

    /// C.
    pub fn coriolis_matrix(
        &self,
        at: Arguments,
        registers: &mut Registers,
        out: &mut DMatrix<f64>,
    ) {
        self.run(&self.coriolis, at, &mut registers.coriolis, out.iter_mut());
    }

    /// M, C and G.
    pub fn terms(
        &self,
        at: Arguments,
        registers: &mut Registers,
        mass: &mut DMatrix<f64>,
        coriolis: &mut DMatrix<f64>,
        gravity: &mut DVector<f64>,
    ) {
        let slots = mass.iter_mut().chain(coriolis.iter_mut());
        let slots = slots.chain(gravity.iter_mut());
        self.run(&self.terms, at, &mut registers.terms, slots);
    }

    /// C v + G.
    pub fn bias_force(&self, at: Arguments, registers: &mut Registers, out: &mut DVector<f64>) {
        self.run(&self.bias, at, &mut registers.bias, out.iter_mut());
    }

    /// M a + C v + G.
    pub fn inverse_dynamics(
        &self,
        at: Arguments,
        registers: &mut Registers,
        out: &mut DVector<f64>,
    ) {
        self.run(&self.force, at, &mut registers.force, out.iter_mut());
    }

    /// M and the bias force.
    pub fn equations(
        &self,
        at: Arguments,
        registers: &mut Registers,
        mass: &mut DMatrix<f64>,
        bias: &mut DVector<f64>,
    ) {
        let slots = mass.iter_mut().chain(bias.iter_mut());
        self.run(&self.equations, at, &mut registers.equations, slots);
    }

    /// Derivatives of the inverse dynamics; of those in p, the columns `constants`.
    pub fn derivatives(
        &self,
        at: Arguments,
        constants: &[usize],
        registers: &mut Registers,
        out: &mut InverseDynamicsDerivatives,
    ) {
        let nv = self.nv;
        let r = &mut registers.derivatives;
        let slots = out.by_q.iter_mut().chain(out.by_v.iter_mut());
        self.run(&self.derivatives, at, r, slots);
        let by_p = self.derivatives.outputs(r).skip(2 * nv * nv);
        for (k, output) in by_p.enumerate() {
            if let Some(column) = constants.iter().position(|&c| c == k / nv) {
                out.by_p[(k % nv, column)] = output;
            }
        }
    }
}

/// Whether ∂²T/∂v∂v holds a velocity, as far as a graph of T can tell: not when T branches on its arguments or is too large. Where it
/// does, T is not quadratic in v, however quadratic it is at the states that one tries.
pub(crate) fn mass_depends_on_velocity<L: Lagrangian>(lagrangian: &L) -> bool {
    let nv = lagrangian.dof();
    let (mut graph, kinetic) = trace(|| {
        let range = |from: usize| -> Vec<Traced> { (from..from + nv).map(variable).collect() };
        let (q, v) = (range(0), range(nv));
        lagrangian.kinetic(&q, &v).0
    });
    if graph.branched {
        return false;
    }
    let velocities = || (nv..2 * nv).map(|x| x as u32);
    let mut mass = vec![kinetic];
    for _ in 0..2 {
        let slopes: Result<Vec<_>, TooLarge> = velocities()
            .map(|x| derivative(&mut graph, &mass, x, MOST_NODES))
            .collect();
        match slopes {
            Ok(slopes) => mass = slopes.concat(),
            Err(TooLarge) => return false,
        }
    }
    let mut needed = vec![false; graph.len()];
    for id in mass {
        needed[id as usize] = true;
    }
    mark_arguments(&graph, &mut needed);
    (0..graph.len()).any(|id| match graph.node(id as Id) {
        Node::Variable(x) => needed[id] && velocities().any(|v| v == x),
        _ => false,
    })
}

/// C_ij = Σ_k ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i) v_k, column by column, from ∂M/∂q_k, each column by column.
fn christoffel(graph: &mut Graph, mass_by_q: &[Vec<Id>], nv: usize) -> Vec<Id> {
    let at = |i: usize, j: usize| j * nv + i;
    let mut coriolis = Vec::with_capacity(nv * nv);
    for j in 0..nv {
        for i in 0..nv {
            let mut sum = graph.constant(0.0);
            for k in 0..nv {
                let two = graph.add(mass_by_q[k][at(i, j)], mass_by_q[j][at(i, k)]);
                let symbol = graph.subtract(two, mass_by_q[i][at(j, k)]);
                let half = graph.constant(0.5);
                let symbol = graph.multiply(half, symbol);
                let velocity = graph.variable((nv + k) as u32);
                let term = graph.multiply(symbol, velocity);
                sum = graph.add(sum, term);
            }
            coriolis.push(sum);
        }
    }
    coriolis
}
