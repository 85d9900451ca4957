//! Inputs that push links: Q = b(q) f, see [`LinkForce`].

use lagrange::mechanism::{LinkForce, LinkForceEntry, LinkForceMemory};

use super::eight::{Eight, Lane};
use super::forces::{By, Of};
use super::{DrivenInputs, Hybrid};

impl Hybrid {
    /// The inputs that push links, with what they do per unit.
    fn on_links(&self) -> impl Iterator<Item = (usize, &LinkForce)> {
        let all = self.link_forces.iter().zip(&self.carried).enumerate();
        all.filter(|(_, (_, carried))| !**carried)
            .filter_map(|(input, (law, _))| Some((input, law.as_deref()?)))
    }

    /// Whether input `input` pushes a link.
    pub fn is_on_link(&self, input: usize) -> bool {
        self.link_forces[input].is_some()
    }

    /// Whether input `input` moves a coordinate.
    pub fn moves(&self, input: usize, coordinate: usize) -> bool {
        match &self.link_forces[input] {
            None => self.input_coordinates[input] == coordinate,
            Some(law) => law.moves(self.starts[coordinate].v),
        }
    }

    /// Adds their forces to Q.
    pub(super) fn add_link_forces(
        &self,
        q: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        force: &mut [f64],
    ) {
        for (input, law) in self.on_links() {
            let strength = inputs.forces[input].value[step];
            law.each(q, |v, part: f64| force[v] += part * strength);
        }
    }

    /// Gives every part of their forces and of the derivatives to `add`, which sums them up.
    pub(super) fn link_parts(
        &self,
        q: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut LinkForceMemory,
        mut add: impl FnMut(Of, By, f64),
    ) {
        for (input, law) in self.on_links() {
            let signal = &inputs.forces[input];
            let strength = signal.value[step];
            law.each_derivative(q, memory, |entry, part| match entry {
                LinkForceEntry::Value(v) => {
                    add(Of::Force(v), By::Value, part * strength);
                    for (index, derivative) in &signal.by_parameter {
                        add(Of::Force(v), By::Constant(*index), part * derivative[step]);
                    }
                }
                LinkForceEntry::ByPosition(v, k) => {
                    add(Of::Force(v), By::Position(k), part * strength);
                }
            });
        }
    }

    /// [`add_link_forces`](Self::add_link_forces) of eight states.
    pub(super) fn add_link_forces_of_eight(&self, q: &[Lane], at: &Eight<'_>, force: &mut [Lane]) {
        for (input, law) in self.on_links() {
            let strength = at.signal(input);
            law.each_of_eight(q, |v, part| {
                for ((to, part), strength) in force[v].iter_mut().zip(part).zip(strength) {
                    *to += part * strength;
                }
            });
        }
    }

    /// [`link_parts`](Self::link_parts) of eight states.
    pub(super) fn link_parts_of_eight(
        &self,
        q: &[Lane],
        at: &Eight<'_>,
        memory: &mut LinkForceMemory,
        mut add: impl FnMut(usize, By, &Lane),
    ) {
        for (input, law) in self.on_links() {
            let strength = at.signal(input);
            let times =
                |part: &Lane, by: &Lane| -> Lane { std::array::from_fn(|k| part[k] * by[k]) };
            law.each_derivative_of_eight(q, memory, |entry, part| match entry {
                LinkForceEntry::Value(v) => {
                    add(v, By::Value, &times(part, &strength));
                    // What a signal depends on is the same in every recording.
                    let parameters = &at.inputs[0].forces[input].by_parameter;
                    for (k, (index, _)) in parameters.iter().enumerate() {
                        let derivative = at.derivative(input, k);
                        add(v, By::Constant(*index), &times(part, &derivative));
                    }
                }
                LinkForceEntry::ByPosition(v, k) => {
                    add(v, By::Position(k), &times(part, &strength));
                }
            });
        }
    }
}
