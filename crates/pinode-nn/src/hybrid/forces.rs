//! Q of inputs and effects and ḣ of the effects with a memory, and their derivatives.

use std::ops::Range;

use lagrange::LANES;
use nalgebra::DVector;

use super::{DrivenInputs, Hybrid, Memory, Placed, State};
use crate::effect::{Action, At, Column, JointForce, Room, Seen, Signal};
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
pub(super) type Here<'a> = (State<'a>, &'a [f64], &'a DrivenInputs, usize);

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
        let law = self.laws[index].as_ref()?;
        if effect.kind.memory().is_some() {
            return None;
        }
        let v = self.starts[effect.target].v;
        let nx = self.nx();
        let mut forces = Vec::with_capacity(states.len() / nx);
        let (mut x, mut room) = (vec![[0.0; LANES]; nx], Room::default());
        for eight in states.chunks(nx * LANES) {
            // Lanes that are left over repeat the last state.
            let last = (eight.len() / nx).saturating_sub(1);
            for (i, x) in x.iter_mut().enumerate() {
                *x = std::array::from_fn(|lane| eight[lane.min(last) * nx + i]);
            }
            let from = forces.len();
            forces.resize(from + last + 1, 0.0);
            let at = self.at_joint(index, &x, theta);
            law.values_of_eight(&at, &mut room, |_, force| {
                for (to, force) in forces[from..].iter_mut().zip(force) {
                    *to += force;
                }
            });
        }
        Some((v, forces))
    }

    /// The force f that the law of effect `index` sees, and where it acts.
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

    /// Where the law of effect `index` acts, what it sees there and which states are its own.
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
        (state, theta, inputs, step): Here<'_>,
        driven: &DVector<f64>,
        room: &mut Room,
        mut add: impl FnMut(Of, By, f64),
    ) {
        for (signal, v) in self.direct(inputs) {
            add(Of::Force(v), By::Value, signal.value[step]);
            for (index, derivative) in &signal.by_parameter {
                add(Of::Force(v), By::Constant(*index), derivative[step]);
            }
        }
        for (index, effect) in self.effects.iter().enumerate() {
            let Some(law) = &self.laws[index] else {
                continue;
            };
            let (start, seen, _) = self.seen(index, state, inputs, step, driven);
            let (p, smoothing) = (&theta[self.ranges[index].clone()], effect.smoothing);
            let at = At { seen, p, smoothing };
            law.parts(&at, room, |row, column, part| {
                let of = self.row(index, start, row);
                match self.by(index, start, column) {
                    Some(by) => add(of, by, part),
                    None => self.input_parts(index, inputs, step, |k, derivative| {
                        add(of, By::Constant(k), part * derivative);
                    }),
                }
            });
        }
    }

    /// What a row of the law of effect `index`, which acts at `start`, is of.
    pub(super) fn row(&self, index: usize, start: Start, row: usize) -> Of {
        match row.checked_sub(1) {
            None => Of::Force(start.v),
            Some(k) => Of::Rate(self.state_ranges[index].start + k),
        }
    }

    /// In what a column of it is derived; `None`: in the force of the inputs.
    pub(super) fn by(&self, index: usize, start: Start, column: Option<Column>) -> Option<By> {
        Some(match column {
            None => By::Value,
            Some(Column::Position) => By::Position(start.v),
            Some(Column::Velocity) => By::Velocity(start.v),
            Some(Column::Input) => return None,
            Some(Column::State(k)) => By::State(self.state_ranges[index].start + k),
            Some(Column::Parameter(k)) => By::Constant(self.ranges[index].start + k),
        })
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
