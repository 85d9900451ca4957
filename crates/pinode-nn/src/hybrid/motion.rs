use integrators::{Differentiable, Gradient, Jacobian, Mechanical, PhaseSpace, System};

use super::{DrivenInputs, Hybrid, Memory};
use crate::motion::{Positions, not_separable};
use crate::shooting::Diverged;

/// The hybrid model at one θ under the inputs of one recording, as a system for `integrators`: its input is the number of an
/// integration step in [`DrivenInputs::grid`].
///
/// Derivatives are in the state and in θ_free; of the inputs there are none, whose gains and drives are in θ. As a mechanical system
/// it is for mechanics without constraints and with T = ½ vᵀ M(q) v; friction and all other effects are forces in Q.
#[derive(Clone, Copy)]
pub struct HybridMotion<'a> {
    hybrid: &'a Hybrid,
    theta: &'a [f64],
    free: &'a [usize],
    inputs: &'a DrivenInputs,
}

impl<'a> HybridMotion<'a> {
    /// With derivatives in the entries `free` of θ, in increasing order.
    pub fn new(
        hybrid: &'a Hybrid,
        theta: &'a [f64],
        free: &'a [usize],
        inputs: &'a DrivenInputs,
    ) -> Self {
        HybridMotion {
            hybrid,
            theta,
            free,
            inputs,
        }
    }

    fn constants(&self) -> &'a [f64] {
        &self.theta[self.hybrid.mechanics_range()]
    }
}

/// What the dynamics refuse; beyond the range of any mechanism it is the state that is at fault.
fn fault(x: &[f64]) -> impl FnOnce(lagrange::Error) -> Diverged {
    let in_range = Diverged::check(x);
    move |cause| match in_range {
        Ok(()) => Diverged::Dynamics(cause),
        Err(out_of_range) => out_of_range,
    }
}

impl System for HybridMotion<'_> {
    type Space = PhaseSpace<Positions>;
    type Input = usize;
    type Memory = Memory;
    type Error = Diverged;

    fn space(&self) -> &Self::Space {
        &self.hybrid.space
    }

    fn memory(&self) -> Memory {
        self.hybrid.memory(self.free)
    }

    /// (v, v̇).
    fn rate(
        &self,
        _t: f64,
        x: &[f64],
        step: &usize,
        memory: &mut Memory,
        dx: &mut [f64],
    ) -> Result<(), Diverged> {
        let state = x.split_at(self.hybrid.nq());
        self.hybrid
            .acceleration(state, self.theta, self.inputs, *step, memory)
            .map_err(fault(x))?;
        let (dq, dv) = dx.split_at_mut(state.1.len());
        dq.copy_from_slice(state.1);
        dv.copy_from_slice(memory.acceleration.as_slice());
        Ok(())
    }
}

impl Mechanical for HybridMotion<'_> {
    type Positions = Positions;

    fn positions(&self) -> &Positions {
        &self.hybrid.space.positions
    }

    fn acceleration(
        &self,
        _t: f64,
        state: (&[f64], &[f64]),
        step: &usize,
        memory: &mut Memory,
        out: &mut [f64],
    ) -> Result<(), Diverged> {
        self.hybrid
            .acceleration(state, self.theta, self.inputs, *step, memory)
            .map_err(fault(state.0))?;
        out.copy_from_slice(memory.acceleration.as_slice());
        Ok(())
    }

    fn momentum(
        &self,
        state: (&[f64], &[f64]),
        memory: &mut Memory,
        out: &mut [f64],
    ) -> Result<(), Diverged> {
        let (mechanics, p) = (self.hybrid.mechanics(), self.constants());
        let Memory { momenta, work, .. } = memory;
        momenta.momentum(mechanics, state, p, work, out);
        Ok(())
    }

    fn velocity(&self, q: &[f64], memory: &mut Memory, out: &mut [f64]) -> Result<(), Diverged> {
        let (mechanics, p) = (self.hybrid.mechanics(), self.constants());
        let Memory { momenta, work, .. } = memory;
        momenta
            .velocity(mechanics, q, p, work, out)
            .map_err(fault(q))
    }

    fn position_force(
        &self,
        _t: f64,
        state: (&[f64], &[f64]),
        step: &usize,
        memory: &mut Memory,
        out: &mut [f64],
    ) -> Result<(), Diverged> {
        let (mechanics, p) = (self.hybrid.mechanics(), self.constants());
        self.hybrid
            .load(state, self.theta, self.inputs, *step, memory);
        out.copy_from_slice(memory.acceleration.as_slice());
        let Memory { momenta, work, .. } = memory;
        momenta.position_force(mechanics, self.positions(), state, p, work, out);
        Ok(())
    }

    fn not_separable(&self) -> Option<String> {
        match self.hybrid.effects().first() {
            Some(effect) => Some(format!("`{}` may depend on the velocity", effect.kind.name)),
            None => not_separable(self.hybrid.mechanics(), self.constants()),
        }
    }
}

impl Differentiable for HybridMotion<'_> {
    /// None: the inputs are data.
    fn input_count(&self) -> usize {
        0
    }

    fn parameter_count(&self) -> usize {
        self.free.len()
    }

    fn linearize(
        &self,
        (_, x, step): (f64, &[f64], &usize),
        memory: &mut Memory,
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Diverged> {
        let state = x.split_at(self.hybrid.nq());
        let n = state.1.len();
        self.hybrid
            .linearize(state, self.theta, self.free, self.inputs, *step, memory)
            .map_err(fault(x))?;
        dx[..n].copy_from_slice(state.1);
        dx[n..].copy_from_slice(memory.acceleration.as_slice());
        by.state.rows_mut(0, n).fill(0.0);
        by.state.view_mut((0, n), (n, n)).fill_with_identity();
        by.state
            .rows_mut(n, n)
            .copy_from(&memory.linear.columns(0, 2 * n));
        by.parameters.rows_mut(0, n).fill(0.0);
        by.parameters
            .rows_mut(n, n)
            .copy_from(&memory.linear.columns(2 * n, self.free.len()));
        Ok(())
    }

    fn pull_back(
        &self,
        (_, x, step): (f64, &[f64], &usize),
        memory: &mut Memory,
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Diverged> {
        let state = x.split_at(self.hybrid.nq());
        let n = state.1.len();
        let (of_q, of_v) = weight.split_at(n);
        let (by_q, by_v) = by.state.split_at_mut(n);
        for (to, w) in by_v.iter_mut().zip(of_q) {
            *to += w;
        }
        self.hybrid
            .pull_back(
                state,
                self.theta,
                self.free,
                self.inputs,
                *step,
                of_v,
                memory,
                (by_q, by_v, &mut by.parameters),
            )
            .map_err(fault(x))?;
        dx[..n].copy_from_slice(state.1);
        dx[n..].copy_from_slice(memory.acceleration.as_slice());
        Ok(())
    }
}
