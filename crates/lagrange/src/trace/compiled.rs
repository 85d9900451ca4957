//! The equations of motion of one mechanism as programs.

use nalgebra::{DMatrix, DVector};

use super::derivative::{TooLarge, derivative};
use super::graph::{Graph, Id};
use super::program::Program;
use super::traced::{Traced, trace, variable};
use crate::{InverseDynamicsDerivatives, Lagrangian};

/// A graph larger than this is given up.
const MOST_NODES: usize = 60_000;
/// A program longer than this is no faster than dual numbers.
const LONGEST: usize = 6_000;

/// M and C v + G from (q, v, p), and the derivatives of Q = M a + C v + G from (q, v, a, p). The variables are q, v, a, p, in this
/// order; T is quadratic in v.
#[derive(Debug, Clone)]
pub(crate) struct Compiled {
    nv: usize,
    np: usize,
    /// M row by row, then C v + G.
    equations: Program,
    /// ∂Q/∂q, ∂Q/∂v, ∂Q/∂p, column by column.
    derivatives: Program,
}

/// Registers of the two programs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Registers {
    equations: Vec<f64>,
    derivatives: Vec<f64>,
}

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
        let mut columns = by(graph, &force, q)?;
        columns.extend(by(graph, &force, v)?);
        columns.extend(by(graph, &force, p)?);
        let equations = Program::new(graph, inputs, &[mass.concat(), bias].concat());
        let derivatives = Program::new(graph, inputs, &columns.concat());
        if equations.len() + derivatives.len() > LONGEST {
            return Err(TooLarge);
        }
        Ok(Compiled {
            nv,
            np,
            equations,
            derivatives,
        })
    }

    pub fn registers(&self) -> Registers {
        Registers {
            equations: self.equations.registers(),
            derivatives: self.derivatives.registers(),
        }
    }

    /// M and the bias force.
    pub fn equations(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        registers: &mut Registers,
        mass: &mut DMatrix<f64>,
        bias: &mut DVector<f64>,
    ) {
        let nv = self.nv;
        let r = &mut registers.equations;
        r[..nv].copy_from_slice(q);
        r[nv..2 * nv].copy_from_slice(v);
        r[3 * nv..3 * nv + self.np].copy_from_slice(p);
        self.equations.run(r);
        let slots = mass.as_mut_slice().iter_mut().chain(bias.as_mut_slice());
        for (slot, output) in slots.zip(self.equations.outputs(r)) {
            *slot = output;
        }
    }

    /// Derivatives of the inverse dynamics; of those in p, the columns `constants`.
    pub fn derivatives(
        &self,
        (q, v, a): (&[f64], &[f64], &[f64]),
        p: &[f64],
        constants: &[usize],
        registers: &mut Registers,
        out: &mut InverseDynamicsDerivatives,
    ) {
        let nv = self.nv;
        let r = &mut registers.derivatives;
        r[..nv].copy_from_slice(q);
        r[nv..2 * nv].copy_from_slice(v);
        r[2 * nv..3 * nv].copy_from_slice(a);
        r[3 * nv..3 * nv + self.np].copy_from_slice(p);
        self.derivatives.run(r);
        let square = nv * nv;
        let outputs = self.derivatives.outputs(r);
        let by_q = out.by_q.as_mut_slice();
        let by_v = out.by_v.as_mut_slice();
        for (k, output) in outputs.enumerate() {
            if k < square {
                by_q[k] = output;
            } else if k < 2 * square {
                by_v[k - square] = output;
            } else {
                let constant = (k - 2 * square) / nv;
                if let Some(column) = constants.iter().position(|&c| c == constant) {
                    out.by_p[((k - 2 * square) % nv, column)] = output;
                }
            }
        }
    }
}
