//! Inputs that push links: Q = b(q) f, see [`LinkForce`].

use lagrange::mechanism::{LinkForce, LinkForceEntry, LinkForceMemory};

use super::eight::{Eight, Lane};
use super::forces::{By, Of};
use super::{DrivenInputs, Hybrid};

impl Hybrid {
    /// The inputs that push links, with what they do per unit.
    fn on_links(&self) -> impl Iterator<Item = (usize, &LinkForce)> {
        let all = self.link_forces.iter().enumerate();
        all.filter_map(|(input, law)| Some((input, law.as_deref()?)))
    }

    /// Whether input `input` acts on the joint of a coordinate itself, whatever stands between.
    pub fn acts_on_joint(&self, input: usize, coordinate: usize) -> bool {
        !self.is_on_link(input) && self.input_coordinates[input] == coordinate
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
            law.each(q, |v, part: f64| {
                if !self.left[v] {
                    force[v] += part * strength;
                }
            });
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
                LinkForceEntry::Value(v) | LinkForceEntry::ByPosition(v, _) if self.left[v] => {}
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
                if self.left[v] {
                    return;
                }
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
                LinkForceEntry::Value(v) | LinkForceEntry::ByPosition(v, _) if self.left[v] => {}
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use super::super::State;
    use super::*;
    use crate::model::Model;

    #[test]
    fn what_is_left_to_a_network_alone_is_not_pushed() {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let model = Model::load(&models.join("hovercraft/hovercraft.toml")).unwrap();
        let mut hybrid = Hybrid::of(&model);
        let theta = hybrid.theta();
        let inputs = hybrid.drive(&[0.0, 1.0], &[vec![1.0; 2], vec![-0.5; 2]], 1, &theta, &[]);
        let pushed = |hybrid: &Hybrid| {
            let state = State {
                q: &[0.3, 0.1, 0.7],
                v: &[0.0; 3],
                h: &[],
            };
            let mut memory = hybrid.memory(&[]);
            let (force, _) = hybrid.forces(state, &theta, &inputs, 0, &mut memory);
            let mut parts = vec![0.0; 3];
            hybrid.link_parts(
                state.q,
                &inputs,
                0,
                &mut LinkForceMemory::default(),
                |of, by, part| {
                    if let (Of::Force(v), By::Value) = (of, by) {
                        parts[v] += part;
                    }
                },
            );
            let at = Eight {
                inputs: [&inputs; lagrange::LANES],
                steps: [0; lagrange::LANES],
            };
            let q: Vec<Lane> = state.q.iter().map(|&q| [q; lagrange::LANES]).collect();
            let mut eight = vec![[0.0; lagrange::LANES]; 3];
            hybrid.add_link_forces_of_eight(&q, &at, &mut eight);
            for v in 0..3 {
                assert!((force[v] - parts[v]).abs() < 1e-14);
                assert!((force[v] - eight[v][5]).abs() < 1e-14);
            }
            parts
        };
        let before = pushed(&hybrid);
        // 1.5 N and −0.75 N, 0.08 m to the left and to the right.
        assert!((before[2] + 0.08 * 2.25).abs() < 1e-14, "{before:?}");
        hybrid.leave_to_network(&[2]);
        assert_eq!(pushed(&hybrid), [before[0], before[1], 0.0]);
    }
}
