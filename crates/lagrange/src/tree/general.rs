//! M, C and G on any scalar: for numbers that are no numbers yet, such as those of an expression graph.

use super::common::{VELOCITY, composite, gravity, motion};
use super::dispatch::TreeMemory;
use super::matrices;
use super::plan::Plan;
use super::sink::Sink;
use crate::Scalar;
use crate::mechanism::Tree;

/// M and C row after row, and G.
pub struct General<D> {
    pub mass: Vec<D>,
    pub coriolis: Vec<D>,
    pub gravity: Vec<D>,
}

/// M, C and G of `tree` at (q, v), with the factors `p` on the masses. Allocates.
pub fn equations<D: Scalar>(tree: &Tree, q: &[D], v: &[D], p: &[D]) -> General<D> {
    let plan = Plan::of(tree);
    let TreeMemory {
        mut state,
        mut moved,
        mut axes,
        mut sums,
        ..
    } = TreeMemory::new(&plan, false);
    state.q.copy_from_slice(q);
    state.v.copy_from_slice(v);
    state.p.copy_from_slice(p);
    state.turn(&plan);
    motion::<_, VELOCITY>(&plan, &state, &mut moved, &mut axes);
    composite::<_, VELOCITY>(&plan, &state, &moved, &mut sums);
    let n = plan.nv;
    let mut out = General {
        mass: vec![D::zero(); n * n],
        coriolis: vec![D::zero(); n * n],
        gravity: vec![D::zero(); n],
    };
    matrices::mass_and_coriolis(&plan, &axes, &sums, &mut out);
    let downward = gravity(&plan, &state);
    matrices::gravity_force(&plan, &downward, &axes, &sums, &mut out);
    out
}

impl<D: Scalar> Sink<D> for General<D> {
    fn mass(&mut self, row: usize, column: usize, entry: D) {
        let to = &mut self.mass[row * self.gravity.len() + column];
        *to = *to + entry;
    }
    fn coriolis(&mut self, row: usize, column: usize, entry: D) {
        let to = &mut self.coriolis[row * self.gravity.len() + column];
        *to = *to + entry;
    }
    fn gravity(&mut self, row: usize, entry: D) {
        self.gravity[row] = self.gravity[row] + entry;
    }
}
