//! v̇ of the hybrid model, and its derivatives.

use lagrange::mechanism::LinkForceMemory;
use lagrange::{ForwardDynamicsDerivatives, ForwardDynamicsGradient, Workspace};
use nalgebra::{DMatrix, DVector};

use super::extra::{ExtraMemory, RowMemory};
use super::forces::{By, Of};
use super::networks::NetworkMemory;
use super::{DrivenInputs, Hybrid, State};
use crate::effect::Room;
use crate::motion::Momenta;

impl Memory {
    /// ∂v̇/∂Q of the last [`Hybrid::linearize`].
    pub(crate) fn response(&self) -> &DMatrix<f64> {
        &self.by.by_force
    }
}

impl Hybrid {
    /// Memory for [`acceleration`](Self::acceleration) and [`linearize`](Self::linearize) for one thread.
    pub fn memory(&self, free: &[usize]) -> Memory {
        let (n, nh) = (self.nv(), self.nh());
        let mechanics = self.free_of_mechanics(free);
        let columns = 2 * n + nh + free.len();
        Memory {
            work: self.mechanics.workspace(),
            acceleration: DVector::zeros(n),
            rates: DVector::zeros(nh),
            driven: DVector::zeros(n),
            bias: DVector::zeros(n),
            extra: self.extra.as_ref().map(|e| e.memory(n, mechanics.len())),
            extra_row: self
                .extra
                .as_ref()
                .map(|e| e.row_memory(n, self.mechanics_range().len())),
            by: ForwardDynamicsDerivatives::zeros(n, mechanics.len()),
            mechanics,
            forces: DMatrix::zeros(n, columns),
            linear: DMatrix::zeros(n + nh, columns),
            accelerations: DMatrix::zeros(n, columns),
            laws: Room::default(),
            gradient: ForwardDynamicsGradient::zeros(n, self.mechanics_range().len()),
            momenta: Momenta::new(n),
            networks: self.network_memory(),
            links: LinkForceMemory::default(),
        }
    }

    /// The free constants of the mechanics.
    pub(super) fn free_of_mechanics(&self, free: &[usize]) -> Vec<usize> {
        let own = self.mechanics_range();
        free.iter().copied().filter(|i| own.contains(i)).collect()
    }

    /// v̇ and ḣ at a state under the input forces of integration step `step`; left in `memory.acceleration` and `memory.rates`.
    pub fn acceleration(
        &self,
        state: State<'_>,
        theta: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut Memory,
    ) -> Result<(), lagrange::Error> {
        self.load(state, theta, inputs, step, memory);
        let p = &theta[self.mechanics_range()];
        let Memory {
            work,
            acceleration,
            extra,
            ..
        } = memory;
        match (&self.extra, extra) {
            (Some(added), Some(memory)) => {
                let mechanics = (self.mechanics(), p);
                let (state, out) = ((state.q, state.v), acceleration.as_mut_slice());
                added.forward_dynamics(mechanics, state, theta, work, memory, out)
            }
            _ => self
                .mechanics
                .forward_dynamics_into(state.q, state.v, p, work, acceleration),
        }
    }

    /// Q of inputs and effects, and ḣ, at a state under the input forces of integration step `step`.
    pub fn forces<'m>(
        &self,
        state: State<'_>,
        theta: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        memory: &'m mut Memory,
    ) -> (&'m [f64], &'m [f64]) {
        self.load(state, theta, inputs, step, memory);
        (memory.acceleration.as_slice(), memory.rates.as_slice())
    }

    /// M(q), with what the effects add to it.
    pub fn mass_matrix_into(
        &self,
        q: &[f64],
        theta: &[f64],
        memory: &mut Memory,
        out: &mut DMatrix<f64>,
    ) {
        let p = &theta[self.mechanics_range()];
        let Memory { work, extra, .. } = memory;
        match (&self.extra, extra) {
            (Some(added), Some(memory)) => {
                added.mass_matrix((self.mechanics(), p), q, theta, work, memory, out);
            }
            _ => self.mechanics.mass_matrix_into(q, p, work, out),
        }
    }

    /// C v + G, with what the effects add to it, into `memory.bias`.
    pub(super) fn bias(&self, (q, v): (&[f64], &[f64]), theta: &[f64], memory: &mut Memory) {
        let p = &theta[self.mechanics_range()];
        let Memory {
            work, extra, bias, ..
        } = memory;
        self.mechanics.bias_force_into(q, v, p, work, bias);
        if let (Some(added), Some(memory)) = (&self.extra, extra) {
            added.add_bias((q, v), (theta, p), memory, bias);
        }
    }

    /// What the effects add to ID(q, v, v̇ = `a`) = M v̇ + C v + G; zeros where none changes the mechanics.
    pub(crate) fn added_inverse_dynamics<'m>(
        &self,
        state: State<'_>,
        a: &[f64],
        theta: &[f64],
        memory: &'m mut Memory,
    ) -> &'m [f64] {
        let p = &theta[self.mechanics_range()];
        let Memory { extra, bias, .. } = memory;
        match (&self.extra, extra) {
            (Some(added), Some(memory)) => {
                added.inverse_dynamics((state.q, state.v, a), (theta, p), memory, bias);
            }
            _ => bias.fill(0.0),
        }
        bias.as_slice()
    }

    /// v̇ and ḣ as [`acceleration`](Self::acceleration), and in `memory.linear` the derivatives of (v̇, ḣ), row after row, in
    /// (q, v, h, θ_free):
    ///
    /// ∂v̇/∂x = ∂v̇/∂Q ∂Q/∂x + ∂v̇/∂x at fixed Q.
    pub fn linearize(
        &self,
        state: State<'_>,
        theta: &[f64],
        free: &[usize],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut Memory,
    ) -> Result<(), lagrange::Error> {
        self.load(state, theta, inputs, step, memory);
        let n = self.nv();
        let first_constant = 2 * n + self.nh();
        let p = &theta[self.mechanics_range()];
        let by = &mut memory.by;
        match (&self.extra, &mut memory.extra) {
            (Some(added), Some(room)) => added.derivatives(
                (&*self.mechanics, p),
                (state.q, state.v),
                theta,
                memory.acceleration.as_slice(),
                &memory.mechanics,
                &mut memory.work,
                room,
                by,
            )?,
            _ => self.mechanics.forward_dynamics_derivatives_into(
                state.q,
                state.v,
                memory.acceleration.as_slice(),
                p,
                &memory.mechanics,
                &mut memory.work,
                by,
            )?,
        }
        memory.acceleration.copy_from(&by.acceleration);
        // First ∂Q/∂x of what makes Q, and ∂ḣ/∂x.
        let rhs = &mut memory.forces;
        rhs.fill(0.0);
        memory.linear.fill(0.0);
        let column = |index: usize| {
            let place = free.binary_search(&index).ok();
            place.map(|k| first_constant + k)
        };
        let linear = &mut memory.linear;
        let at = (state, theta, inputs, step);
        let mut enter = |of, by, derivative: f64| {
            let column = match by {
                By::Value => None,
                By::Position(i) => Some(i),
                By::Velocity(i) => Some(n + i),
                By::State(k) => Some(2 * n + k),
                By::Constant(index) => column(index),
            };
            match (of, column) {
                (Of::Force(i), Some(column)) => rhs[(i, column)] += derivative,
                (Of::Rate(k), Some(column)) => linear[(n + k, column)] += derivative,
                (_, None) => {}
            }
        };
        self.each_part(at, &memory.driven, &mut memory.laws, &mut enter);
        self.network_parts(inputs, step, &mut memory.networks, &mut enter);
        self.link_parts(state.q, inputs, step, &mut memory.links, enter);
        // ∂v̇/∂p = −M⁻¹ ∂ID/∂p.
        if let (Some(added), Some(room)) = (&self.extra, &memory.extra) {
            for (&index, by_slot) in added.parameters.iter().zip(room.by_slot.column_iter()) {
                if let Some(column) = column(index) {
                    let mut to = rhs.column_mut(column);
                    to -= by_slot;
                }
            }
        }
        // ∂v̇/∂x = ∂v̇/∂Q ∂Q/∂x, and what the mechanics adds.
        let linear = &mut memory.accelerations;
        by.by_force.mul_to(rhs, linear);
        for (first, block) in [(0, &by.by_q), (n, &by.by_v)] {
            let mut columns = linear.columns_mut(first, n);
            columns += block;
        }
        for (k, &index) in memory.mechanics.iter().enumerate() {
            if let Some(column) = column(index) {
                let mut to = linear.column_mut(column);
                to += by.by_p.column(k);
            }
        }
        memory.linear.rows_mut(0, n).copy_from(linear);
        Ok(())
    }

    /// v̇ and ḣ as [`acceleration`](Self::acceleration), and *adds* the row w = `weight` = (w_v, w_h) times ∂(v̇, ḣ)/∂(q, v, h, θ_free)
    /// to `by`: ∂v̇/∂x = ∂v̇/∂Q ∂Q/∂x + ∂v̇/∂x at fixed Q.
    #[allow(clippy::too_many_arguments)]
    pub fn pull_back(
        &self,
        state: State<'_>,
        theta: &[f64],
        free: &[usize],
        inputs: &DrivenInputs,
        step: usize,
        weight: &[f64],
        memory: &mut Memory,
        (by_q, by_v, by_h, by_theta): (&mut [f64], &mut [f64], &mut [f64], &mut [f64]),
    ) -> Result<(), lagrange::Error> {
        self.load(state, theta, inputs, step, memory);
        let (of_v, of_h) = weight.split_at(self.nv());
        let p = &theta[self.mechanics_range()];
        let by = &mut memory.gradient;
        match (&self.extra, &mut memory.extra, &mut memory.extra_row) {
            (Some(added), Some(room), Some(rows)) => added.gradient(
                (&*self.mechanics, p),
                state,
                theta,
                memory.acceleration.as_slice(),
                of_v,
                &mut memory.work,
                (room, rows),
                by,
            )?,
            _ => self.mechanics.forward_dynamics_gradient_into(
                state.q,
                state.v,
                memory.acceleration.as_slice(),
                p,
                of_v,
                &mut memory.work,
                by,
            )?,
        }
        memory.acceleration.copy_from(&by.acceleration);
        let mut add_to_theta = |index: usize, part: f64| {
            if let Ok(k) = free.binary_search(&index) {
                by_theta[k] += part;
            }
        };
        for &index in &memory.mechanics {
            add_to_theta(index, by.by_p[index]);
        }
        if let (Some(added), Some(rows)) = (&self.extra, &memory.extra_row) {
            for (&index, of_slot) in added.parameters.iter().zip(&rows.of_slots) {
                add_to_theta(index, -of_slot);
            }
        }
        let at = (state, theta, inputs, step);
        let mut enter = |of, in_what, derivative: f64| {
            let weight = match of {
                Of::Force(i) => by.by_force[i],
                Of::Rate(k) => of_h[k],
            };
            match in_what {
                By::Value => {}
                // A coordinate with an effect is one number in q and in v.
                By::Position(i) => by_q[i] += weight * derivative,
                By::Velocity(i) => by_v[i] += weight * derivative,
                By::State(k) => by_h[k] += weight * derivative,
                By::Constant(index) => add_to_theta(index, weight * derivative),
            }
        };
        self.each_part(at, &memory.driven, &mut memory.laws, &mut enter);
        self.network_parts(inputs, step, &mut memory.networks, &mut enter);
        self.link_parts(state.q, inputs, step, &mut memory.links, enter);
        for (to, by) in [(by_q, &by.by_q), (by_v, &by.by_v)] {
            for (to, by) in to.iter_mut().zip(by.iter()) {
                *to += by;
            }
        }
        Ok(())
    }
}

/// Memory of one thread for one set of free constants.
pub struct Memory {
    pub(super) work: Workspace,
    /// v̇ of the last call.
    pub acceleration: DVector<f64>,
    /// ḣ of the last call.
    pub rates: DVector<f64>,
    /// Forces of the inputs that act on the coordinates themselves.
    pub(super) driven: DVector<f64>,
    /// C v + G.
    pub(super) bias: DVector<f64>,
    /// What the effects that change the mechanics need.
    pub(super) extra: Option<ExtraMemory>,
    extra_row: Option<RowMemory>,
    by: ForwardDynamicsDerivatives,
    /// ∂Q/∂(q, v, h, θ_free) of inputs and effects.
    forces: DMatrix<f64>,
    /// ∂v̇/∂(q, v, h, θ_free).
    accelerations: DMatrix<f64>,
    /// The free constants of the mechanics.
    pub(super) mechanics: Vec<usize>,
    /// ∂(v̇, ḣ)/∂(q, v, h, θ_free) of the last [`Hybrid::linearize`].
    pub linear: DMatrix<f64>,
    pub(super) laws: Room,
    gradient: ForwardDynamicsGradient,
    pub(super) momenta: Momenta,
    pub(super) networks: NetworkMemory,
    links: LinkForceMemory,
}
