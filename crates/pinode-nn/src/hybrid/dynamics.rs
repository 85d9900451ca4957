//! v̇ of the hybrid model, and its derivatives.

use std::ops::Range;

use lagrange::{ForwardDynamicsDerivatives, ForwardDynamicsGradient, Workspace};
use nalgebra::{DMatrix, DVector};

use super::extra::ExtraMemory;
use super::{DrivenInputs, Hybrid, Placed, State};
use crate::effect::{Action, JointForce, MemoryDerivatives, Seen, Signal};
use crate::entries::Start;
use crate::motion::Momenta;

impl Hybrid {
    /// Memory for [`acceleration`](Self::acceleration) and [`linearize`](Self::linearize) for one thread.
    pub fn memory(&self, free: &[usize]) -> Memory {
        let (n, nh) = (self.nv(), self.nh());
        let mechanics: Vec<usize> = free
            .iter()
            .copied()
            .filter(|i| self.mechanics_range().contains(i))
            .collect();
        let columns = 2 * n + nh + free.len();
        Memory {
            work: self.mechanics.workspace(),
            acceleration: DVector::zeros(n),
            rates: DVector::zeros(nh),
            driven: DVector::zeros(n),
            bias: DVector::zeros(n),
            extra: self
                .extra
                .as_ref()
                .map(|e| e.memory(n, self.mechanics_range().len(), mechanics.len())),
            by: ForwardDynamicsDerivatives::zeros(n, mechanics.len()),
            mechanics,
            forces: DMatrix::zeros(n, columns),
            linear: DMatrix::zeros(n + nh, columns),
            accelerations: DMatrix::zeros(n, columns),
            by_parameter: vec![0.0; 8],
            with_memory: Box::default(),
            gradient: ForwardDynamicsGradient::zeros(n, self.mechanics_range().len()),
            momenta: Momenta::new(n),
        }
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
                added.forward_dynamics(mechanics, state, theta, work, memory, acceleration)
            }
            _ => self
                .mechanics
                .forward_dynamics_into(state.q, state.v, p, work, acceleration),
        }
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

    /// Q of inputs and effects, into `memory.acceleration`, and ḣ.
    pub(super) fn load(
        &self,
        state: State<'_>,
        theta: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut Memory,
    ) {
        self.load_where(|_| true, state, theta, inputs, step, memory);
    }

    /// Q of inputs and effects, of those without a memory only those that `counts` keeps, into `memory.acceleration`, and ḣ.
    pub(super) fn load_where(
        &self,
        counts: impl Fn(&dyn JointForce) -> bool,
        state: State<'_>,
        theta: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut Memory,
    ) {
        let Memory {
            acceleration,
            driven,
            rates,
            ..
        } = memory;
        driven.fill(0.0);
        for ((signal, &coordinate), carried) in inputs
            .forces
            .iter()
            .zip(&self.input_coordinates)
            .zip(&self.carried)
        {
            if !carried {
                driven[self.starts[coordinate].v] += signal.value[step];
            }
        }
        acceleration.copy_from(driven);
        for (index, effect) in self.effects.iter().enumerate() {
            let p = &theta[self.ranges[index].clone()];
            let smoothing = effect.smoothing * self.smoothing_scale;
            if let Action::Joint(law) = effect.kind.action {
                if counts(law) {
                    let at = self.starts[effect.target];
                    acceleration[at.v] += law.force(state.q[at.q], state.v[at.v], p, smoothing);
                }
            } else if let Some(law) = effect.kind.memory() {
                let (at, seen, range) = self.seen(index, state, inputs, step, driven);
                let rates = &mut rates.as_mut_slice()[range];
                acceleration[at.v] += law.evaluate(&seen, p, smoothing, rates);
            }
        }
    }

    /// Where effect `index`, which has a memory, acts, what it sees there and which states are its own.
    pub(super) fn seen<'a>(
        &self,
        index: usize,
        state: State<'a>,
        inputs: &DrivenInputs,
        step: usize,
        driven: &DVector<f64>,
    ) -> (Start, Seen<'a, f64>, Range<usize>) {
        let Placed { kind, target, .. } = self.effects[index];
        let at = self.starts[self.coordinate_of(kind, target)];
        let range = self.state_ranges[index].clone();
        let seen = Seen {
            q: state.q[at.q],
            v: state.v[at.v],
            f: match kind.is_transmission() {
                true => inputs.forces[target].value[step],
                false => driven[at.v],
            },
            h: &state.h[range.clone()],
        };
        (at, seen, range)
    }

    /// The input signals that make up the force f which effect `index` sees.
    fn sources<'a>(
        &'a self,
        index: usize,
        inputs: &'a DrivenInputs,
    ) -> impl Iterator<Item = &'a Signal> {
        let Placed { kind, target, .. } = self.effects[index];
        let transmission = kind.is_transmission();
        inputs
            .forces
            .iter()
            .enumerate()
            .filter(move |&(input, _)| match transmission {
                true => input == target,
                false => self.input_coordinates[input] == target && !self.carried[input],
            })
            .map(|(_, signal)| signal)
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
                state,
                theta,
                &memory.acceleration,
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
        for ((signal, &coordinate), carried) in inputs
            .forces
            .iter()
            .zip(&self.input_coordinates)
            .zip(&self.carried)
        {
            for (index, derivative) in signal.by_parameter.iter().filter(|_| !carried) {
                if let Some(column) = column(*index) {
                    rhs[(self.starts[coordinate].v, column)] += derivative[step];
                }
            }
        }
        for (index, effect) in self.effects.iter().enumerate() {
            let range = self.ranges[index].clone();
            let p = &theta[range.clone()];
            let smoothing = effect.smoothing * self.smoothing_scale;
            if let Action::Joint(law) = effect.kind.action {
                let by_parameter = &mut memory.by_parameter[..range.len()];
                let Start { q: iq, v: iv } = self.starts[effect.target];
                let at = law.derivatives(state.q[iq], state.v[iv], p, smoothing, by_parameter);
                rhs[(iv, iv)] += at.by_q;
                rhs[(iv, n + iv)] += at.by_v;
                for (index, derivative) in range.zip(by_parameter) {
                    if let Some(column) = column(index) {
                        rhs[(iv, column)] += *derivative;
                    }
                }
            } else if let Some(law) = effect.kind.memory() {
                let (at, seen, states) = self.seen(index, state, inputs, step, &memory.driven);
                let d = &mut memory.with_memory;
                law.derivatives(&seen, p, smoothing, d);
                let mut put = |row: usize, column: usize, value: f64| match row {
                    0 => rhs[(at.v, column)] += value,
                    _ => memory.linear[(n + states.start + row - 1, column)] += value,
                };
                for row in 0..=states.len() {
                    put(row, at.v, d.by_q(row));
                    put(row, n + at.v, d.by_v(row));
                    for (k, &value) in states.clone().zip(d.by_h(row)) {
                        put(row, 2 * n + k, value);
                    }
                    for (index, &value) in range.clone().zip(d.by_p(row)) {
                        if let Some(column) = column(index) {
                            put(row, column, value);
                        }
                    }
                    for signal in self.sources(index, inputs) {
                        for (index, derivative) in &signal.by_parameter {
                            if let Some(column) = column(*index) {
                                put(row, column, d.by_f(row) * derivative[step]);
                            }
                        }
                    }
                }
            }
        }
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
        match (&self.extra, &mut memory.extra) {
            (Some(added), Some(room)) => added.gradient(
                (&*self.mechanics, p),
                state,
                theta,
                &memory.acceleration,
                of_v,
                &mut memory.work,
                room,
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
        if let (Some(added), Some(room)) = (&self.extra, &memory.extra) {
            for (&index, of_slot) in added.parameters.iter().zip(&room.of_slots) {
                add_to_theta(index, -of_slot);
            }
        }
        for ((signal, &coordinate), carried) in inputs
            .forces
            .iter()
            .zip(&self.input_coordinates)
            .zip(&self.carried)
        {
            let of_force = by.by_force[self.starts[coordinate].v];
            for (index, derivative) in signal.by_parameter.iter().filter(|_| !carried) {
                add_to_theta(*index, of_force * derivative[step]);
            }
        }
        for (index, effect) in self.effects.iter().enumerate() {
            let range = self.ranges[index].clone();
            let p = &theta[range.clone()];
            let smoothing = effect.smoothing * self.smoothing_scale;
            // A coordinate with an effect is one number in q and in v.
            if let Action::Joint(law) = effect.kind.action {
                let by_parameter = &mut memory.by_parameter[..range.len()];
                let Start { q: iq, v: iv } = self.starts[effect.target];
                let at = law.derivatives(state.q[iq], state.v[iv], p, smoothing, by_parameter);
                let of_force = by.by_force[iv];
                by_q[iv] += of_force * at.by_q;
                by_v[iv] += of_force * at.by_v;
                for (index, derivative) in range.zip(by_parameter) {
                    add_to_theta(index, of_force * *derivative);
                }
            } else if let Some(law) = effect.kind.memory() {
                let (at, seen, states) = self.seen(index, state, inputs, step, &memory.driven);
                let d = &mut memory.with_memory;
                law.derivatives(&seen, p, smoothing, d);
                for row in 0..=states.len() {
                    let w = match row {
                        0 => by.by_force[at.v],
                        _ => of_h[states.start + row - 1],
                    };
                    by_q[at.v] += w * d.by_q(row);
                    by_v[at.v] += w * d.by_v(row);
                    for (to, value) in by_h[states.clone()].iter_mut().zip(d.by_h(row)) {
                        *to += w * value;
                    }
                    for (index, value) in range.clone().zip(d.by_p(row)) {
                        add_to_theta(index, w * value);
                    }
                    for signal in self.sources(index, inputs) {
                        for (index, derivative) in &signal.by_parameter {
                            add_to_theta(*index, w * d.by_f(row) * derivative[step]);
                        }
                    }
                }
            }
        }
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
    by: ForwardDynamicsDerivatives,
    /// ∂Q/∂(q, v, h, θ_free) of inputs and effects.
    forces: DMatrix<f64>,
    /// ∂v̇/∂(q, v, h, θ_free).
    accelerations: DMatrix<f64>,
    /// The free constants of the mechanics.
    mechanics: Vec<usize>,
    /// ∂(v̇, ḣ)/∂(q, v, h, θ_free) of the last [`Hybrid::linearize`].
    pub linear: DMatrix<f64>,
    by_parameter: Vec<f64>,
    with_memory: Box<MemoryDerivatives>,
    gradient: ForwardDynamicsGradient,
    pub(super) momenta: Momenta,
}
