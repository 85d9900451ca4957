use integrators::{
    Differentiable, Flat, Gradient, Jacobian, Mechanical, PhaseSpace, Product, System,
};

use super::{DrivenInputs, Hybrid, Memory, State};
use crate::motion::{Positions, not_separable};
use crate::shooting::Diverged;

/// The hybrid model at one θ under the inputs of one recording, as a system for `integrators`: its input is the number of an
/// integration step in [`DrivenInputs::grid`].
///
/// States are (q, v, h), h those of the effects with a memory. Derivatives are in the state and in θ_free; of the inputs there are none, whose gains and drives are in θ. As a mechanical system
/// it is for mechanics without constraints and with T = ½ vᵀ M(q) v, and without effects that have a memory; friction and all other
/// effects are forces in Q.
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

/// (v, v̇, ḣ).
fn write_rate(state: State<'_>, memory: &Memory, dx: &mut [f64]) {
    let n = state.v.len();
    dx[..n].copy_from_slice(state.v);
    dx[n..2 * n].copy_from_slice(memory.acceleration.as_slice());
    dx[2 * n..].copy_from_slice(memory.rates.as_slice());
}

impl System for HybridMotion<'_> {
    type Space = Product<PhaseSpace<Positions>, Flat>;
    type Input = usize;
    type Memory = Memory;
    type Error = Diverged;

    fn space(&self) -> &Self::Space {
        &self.hybrid.space
    }

    fn memory(&self) -> Memory {
        self.hybrid.memory(self.free)
    }

    /// (v, v̇, ḣ).
    fn rate(
        &self,
        _t: f64,
        x: &[f64],
        step: &usize,
        memory: &mut Memory,
        dx: &mut [f64],
    ) -> Result<(), Diverged> {
        let state = self.hybrid.parts(x);
        self.hybrid
            .acceleration(state, self.theta, self.inputs, *step, memory)
            .map_err(fault(x))?;
        write_rate(state, memory, dx);
        Ok(())
    }
}

impl Mechanical for HybridMotion<'_> {
    type Positions = Positions;

    fn positions(&self) -> &Positions {
        &self.hybrid.space.first.positions
    }

    fn acceleration(
        &self,
        _t: f64,
        (q, v): (&[f64], &[f64]),
        step: &usize,
        memory: &mut Memory,
        out: &mut [f64],
    ) -> Result<(), Diverged> {
        let state = State { q, v, h: &[] };
        self.hybrid
            .acceleration(state, self.theta, self.inputs, *step, memory)
            .map_err(fault(q))?;
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
        let Memory {
            momenta,
            work,
            extra,
            ..
        } = memory;
        momenta.momentum(mechanics, state, p, work, out);
        if let (Some(added), Some(room)) = (&self.hybrid.extra, extra) {
            added.add_momentum(state, self.theta, room, out);
        }
        Ok(())
    }

    fn velocity(&self, q: &[f64], memory: &mut Memory, out: &mut [f64]) -> Result<(), Diverged> {
        let (mechanics, p) = (self.hybrid.mechanics(), self.constants());
        let Memory {
            momenta,
            work,
            extra,
            ..
        } = memory;
        match (&self.hybrid.extra, extra) {
            (Some(added), Some(room)) => {
                added.velocity((mechanics, p), q, self.theta, work, room, out)
            }
            _ => momenta.velocity(mechanics, q, p, work, out),
        }
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
        let (q, v) = state;
        let h = &[];
        self.hybrid
            .load(State { q, v, h }, self.theta, self.inputs, *step, memory);
        out.copy_from_slice(memory.acceleration.as_slice());
        let Memory {
            momenta,
            work,
            extra,
            ..
        } = memory;
        momenta.position_force(mechanics, self.positions(), state, p, work, out);
        if let (Some(added), Some(room)) = (&self.hybrid.extra, extra) {
            let at = self.positions();
            added.add_position_force(at, state, (self.theta, p), momenta, room, out);
        }
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
        let state = self.hybrid.parts(x);
        let n = state.v.len();
        let directions = self.hybrid.directions();
        self.hybrid
            .linearize(state, self.theta, self.free, self.inputs, *step, memory)
            .map_err(fault(x))?;
        write_rate(state, memory, dx);
        by.state.rows_mut(0, n).fill(0.0);
        by.state.view_mut((0, n), (n, n)).fill_with_identity();
        let below = directions - n;
        by.state
            .rows_mut(n, below)
            .copy_from(&memory.linear.columns(0, directions));
        by.parameters.rows_mut(0, n).fill(0.0);
        by.parameters
            .rows_mut(n, below)
            .copy_from(&memory.linear.columns(directions, self.free.len()));
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
        let state = self.hybrid.parts(x);
        let n = state.v.len();
        let (of_q, of_rates) = weight.split_at(n);
        let (by_q, rest) = by.state.split_at_mut(n);
        let (by_v, by_h) = rest.split_at_mut(n);
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
                of_rates,
                memory,
                (by_q, by_v, by_h, &mut by.parameters),
            )
            .map_err(fault(x))?;
        write_rate(state, memory, dx);
        Ok(())
    }
}
