//! Q of inputs and effects and ḣ of the effects with a memory, and their derivatives.

use std::ops::Range;

use lagrange::LANES;
use nalgebra::DVector;

use super::{DrivenInputs, Hybrid, Memory, Placed, State};
use crate::effect::{Action, JointForce, MemoryDerivatives, Seen, Signal};
use crate::entries::Start;

/// What is derived.
#[derive(Clone, Copy)]
pub(super) enum Of {
    /// The entry of Q.
    Force(usize),
    /// The entry of ḣ.
    Rate(usize),
}

/// In what.
#[derive(Clone, Copy)]
pub(super) enum By {
    /// In nothing: the quantity itself.
    Value,
    /// A displacement along this entry of v.
    Position(usize),
    /// The entry of v.
    Velocity(usize),
    /// The entry of h.
    State(usize),
    /// The entry of θ.
    Constant(usize),
}

/// Where forces are taken: state, θ, inputs and integration step.
pub(super) type At<'a> = (State<'a>, &'a [f64], &'a DrivenInputs, usize);

impl Hybrid {
    /// Whether an input acts on its joint itself.
    fn is_direct(&self, input: usize) -> bool {
        !self.carried[input] && !self.is_on_link(input)
    }

    /// The inputs that act on their joints themselves, with the entry of v that each acts on.
    pub(super) fn direct<'a>(
        &'a self,
        inputs: &'a DrivenInputs,
    ) -> impl Iterator<Item = (&'a Signal, usize)> {
        let all = inputs.forces.iter().enumerate();
        all.filter(|(input, _)| self.is_direct(*input))
            .map(|(input, signal)| (signal, self.starts[self.input_coordinates[input]].v))
    }

    /// Forces of the inputs that act on their joints themselves, into `driven`.
    pub(super) fn drive_directly(
        &self,
        inputs: &DrivenInputs,
        step: usize,
        driven: &mut DVector<f64>,
    ) {
        driven.fill(0.0);
        for (signal, v) in self.direct(inputs) {
            driven[v] += signal.value[step];
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
            networks,
            ..
        } = memory;
        self.drive_directly(inputs, step, driven);
        acceleration.copy_from(driven);
        let at = (inputs, step);
        self.add_networks(state, theta, at, networks, acceleration.as_mut_slice());
        self.add_link_forces(state.q, inputs, step, acceleration.as_mut_slice());
        for (index, effect) in self.effects.iter().enumerate() {
            let p = &theta[self.ranges[index].clone()];
            let smoothing = effect.smoothing;
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

    /// The entry of Q that effect `index` acts on, and its force at each of `states`, nx numbers each; none where it is no force without a
    /// memory.
    pub(crate) fn joint_forces(
        &self,
        index: usize,
        states: &[f64],
        theta: &[f64],
    ) -> Option<(usize, Vec<f64>)> {
        let effect = &self.effects[index];
        let Action::Joint(law) = effect.kind.action else {
            return None;
        };
        let (at, p) = (
            self.starts[effect.target],
            &theta[self.ranges[index].clone()],
        );
        let (nx, nq) = (self.nx(), self.nq());
        let mut forces = Vec::with_capacity(states.len() / nx);
        for eight in states.chunks(nx * LANES) {
            // Lanes that are left over repeat the last state.
            let last = (eight.len() / nx).saturating_sub(1);
            let entry = |i: usize| std::array::from_fn(|lane| eight[lane.min(last) * nx + i]);
            let force = law.force_of_eight(&entry(at.q), &entry(nq + at.v), p, effect.smoothing);
            forces.extend_from_slice(&force[..=last]);
        }
        Some((at.v, forces))
    }

    /// The force f that effect `index`, which has a memory, sees, and where it acts.
    pub(super) fn force_seen(
        &self,
        index: usize,
        inputs: &DrivenInputs,
        step: usize,
        driven: &DVector<f64>,
    ) -> (Start, f64) {
        let Placed { kind, target, .. } = self.effects[index];
        let at = self.starts[self.coordinate_of(kind, target)];
        match kind.is_transmission() {
            true => (at, inputs.forces[target].value[step]),
            false => (at, driven[at.v]),
        }
    }

    /// Where effect `index`, which has a memory, acts, what it sees there and which states are its own.
    fn seen<'a>(
        &self,
        index: usize,
        state: State<'a>,
        inputs: &DrivenInputs,
        step: usize,
        driven: &DVector<f64>,
    ) -> (Start, Seen<'a, f64>, Range<usize>) {
        let (at, f) = self.force_seen(index, inputs, step, driven);
        let range = self.state_ranges[index].clone();
        let seen = Seen {
            q: state.q[at.q],
            v: state.v[at.v],
            f,
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
                false => self.input_coordinates[input] == target && self.is_direct(input),
            })
            .map(|(_, signal)| signal)
    }

    /// Gives every part of Q and ḣ, and every derivative of them that is not zero by the shape of the model, to `add`, which sums them up;
    /// `driven` is what [`drive_directly`](Self::drive_directly) has left.
    pub(super) fn each_part(
        &self,
        (state, theta, inputs, step): At<'_>,
        driven: &DVector<f64>,
        (by_parameter, with_memory): (&mut [f64], &mut MemoryDerivatives),
        mut add: impl FnMut(Of, By, f64),
    ) {
        for (signal, v) in self.direct(inputs) {
            add(Of::Force(v), By::Value, signal.value[step]);
            for (index, derivative) in &signal.by_parameter {
                add(Of::Force(v), By::Constant(*index), derivative[step]);
            }
        }
        for (index, effect) in self.effects.iter().enumerate() {
            let range = self.ranges[index].clone();
            let p = &theta[range.clone()];
            let smoothing = effect.smoothing;
            if let Action::Joint(law) = effect.kind.action {
                let by_p = &mut by_parameter[..range.len()];
                let Start { q, v } = self.starts[effect.target];
                let at = law.derivatives(state.q[q], state.v[v], p, smoothing, by_p);
                add(Of::Force(v), By::Value, at.force);
                add(Of::Force(v), By::Position(v), at.by_q);
                add(Of::Force(v), By::Velocity(v), at.by_v);
                for (index, derivative) in range.zip(by_p) {
                    add(Of::Force(v), By::Constant(index), *derivative);
                }
            } else if let Some(law) = effect.kind.memory() {
                let (at, seen, _) = self.seen(index, state, inputs, step, driven);
                law.derivatives(&seen, p, smoothing, with_memory);
                self.memory_parts(index, at, with_memory, &mut add);
                self.input_parts(index, inputs, step, |k, derivative| {
                    for (row, of) in self.rows(index, at).enumerate() {
                        let part = with_memory.by_f(row) * derivative;
                        add(of, By::Constant(k), part);
                    }
                });
            }
        }
    }

    /// What the rows of the derivatives of effect `index` are of, one with a memory that acts at `at`.
    pub(super) fn rows(&self, index: usize, at: Start) -> impl Iterator<Item = Of> {
        let rates = self.state_ranges[index].clone().map(Of::Rate);
        std::iter::once(Of::Force(at.v)).chain(rates)
    }

    /// The parts of effect `index`, one with a memory that acts at `at`, but for what it hands on of the inputs.
    pub(super) fn memory_parts<T: Copy>(
        &self,
        index: usize,
        at: Start,
        d: &MemoryDerivatives<T>,
        mut add: impl FnMut(Of, By, T),
    ) {
        for (row, of) in self.rows(index, at).enumerate() {
            add(of, By::Value, d.value(row));
            add(of, By::Position(at.v), d.by_q(row));
            add(of, By::Velocity(at.v), d.by_v(row));
            for (k, &derivative) in self.state_ranges[index].clone().zip(d.by_h(row)) {
                add(of, By::State(k), derivative);
            }
            for (index, &derivative) in self.ranges[index].clone().zip(d.by_p(row)) {
                add(of, By::Constant(index), derivative);
            }
        }
    }

    /// The derivatives in entries of θ of the force f that effect `index` sees, one with a memory.
    pub(super) fn input_parts(
        &self,
        index: usize,
        inputs: &DrivenInputs,
        step: usize,
        mut add: impl FnMut(usize, f64),
    ) {
        for signal in self.sources(index, inputs) {
            for (index, derivative) in &signal.by_parameter {
                add(*index, derivative[step]);
            }
        }
    }
}
