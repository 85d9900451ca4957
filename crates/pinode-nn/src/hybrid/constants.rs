//! The constants of the model: one vector θ.

use std::ops::Range;

use lagrange::Role;

use super::{Hybrid, Placed};

/// One entry of θ.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    /// What it is.
    pub id: ConstantId,
    /// Its value in the model.
    pub value: f64,
    /// Physical lower bound.
    pub lower: f64,
    /// Physical upper bound.
    pub upper: f64,
    /// Standard deviation of what is known of it around `value`; 0: exact; infinite: nothing is known.
    pub tolerance: f64,
    /// Whether the model says so, by itself or by its defaults. Of a constant in energies that has no tolerance it does not: it is exact until a name would be given for
    /// what it is off by.
    pub is_said: bool,
}

/// What an entry of θ is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ConstantId {
    /// Constant of the mechanics, by its index in [`Mechanics::parameters`](lagrange::Mechanics::parameters).
    Mechanics(usize),
    /// Gain of an input.
    Gain(usize),
    /// Zero of a coordinate's sensor: it reads q + zero.
    Zero(usize),
    /// Parameter of an effect: which effect, which parameter.
    Effect(usize, usize),
    /// Parameter of a network that is open to fits: which network, which parameter.
    Network(usize, usize),
}

impl Hybrid {
    /// θ, described.
    pub fn constants(&self) -> &[Constant] {
        &self.constants
    }

    /// θ, described, to be changed in value and tolerance.
    pub fn constants_mut(&mut self) -> &mut [Constant] {
        &mut self.constants
    }

    /// θ with the values of the model.
    pub fn theta(&self) -> Vec<f64> {
        self.constants.iter().map(|c| c.value).collect()
    }

    /// Sets the values of the model to θ.
    pub fn set_theta(&mut self, theta: &[f64]) {
        for (constant, &value) in self.constants.iter_mut().zip(theta) {
            constant.value = value;
        }
    }

    /// The entries of θ that a fit moves: those that are not exact.
    pub fn free(&self) -> Vec<usize> {
        (0..self.constants.len())
            .filter(|&i| self.constants[i].tolerance > 0.0)
            .collect()
    }

    /// What entry `index` of θ is called, for people.
    pub fn describe(&self, index: usize, inputs: &[String]) -> String {
        match self.constants[index].id {
            ConstantId::Mechanics(k) => {
                let parameter = &self.mechanics.parameters()[k];
                match parameter.role {
                    Role::MassScale => format!("mass scale of `{}`", parameter.name),
                    _ => format!("`{}`", parameter.name),
                }
            }
            ConstantId::Gain(i) => format!("gain of input `{}`", inputs[i]),
            ConstantId::Zero(c) => {
                format!("sensor zero of `{}`", self.mechanics.coordinates()[c].name)
            }
            ConstantId::Effect(e, k) => {
                let Placed { kind, target, .. } = self.effects[e];
                let on = self.target_name(kind, target, inputs);
                format!("{} of {} on `{on}`", kind.parameters[k].name, kind.name)
            }
            ConstantId::Network(_, k) => format!("parameter {k} of a network"),
        }
    }

    pub(super) fn mechanics_range(&self) -> Range<usize> {
        0..self.mechanics.parameters().len()
    }

    pub(crate) fn gain_index(&self, input: usize) -> usize {
        self.mechanics.parameters().len() + input
    }

    /// Index in θ of the zero of coordinate `c`.
    pub fn zero_index(&self, c: usize) -> usize {
        self.mechanics.parameters().len() + self.input_coordinates.len() + c
    }
}
