//! The model put together: of a file, or effect by effect.

use std::sync::Arc;

use integrators::{Flat, PhaseSpace, Product};
use lagrange::{Mechanics, Role};

use super::extra::{Extra, Variants};
use super::sharpness::{LEAST_SLOW, OF_SPEED, SHARPER};
use super::{Constant, ConstantId, Hybrid, Placed, carrier};
use crate::effect::{Action, Between, Kind, Law};
use crate::entries::starts;
use crate::model::{Input, Model, Pushes, Target};
use crate::motion::Positions;
use crate::typical::typical;

impl Hybrid {
    /// A model file's mechanics, inputs and effects, with its tolerances, for fits and roll-outs: [stepped implicitly](Self::is_stiff) where its
    /// friction asks for it.
    pub fn of(model: &Model) -> Self {
        Hybrid::at_pace(model, 1.0, &[])
    }

    /// The same for a motion in which everything takes so many times as long as usual, if that is more than 1, with these speeds of its coordinates, infinite of one
    /// at rest: fits look for delays that are as much longer, steps are longer, and the velocity over which a sign change of friction is spread is no more than a
    /// tenth of the speed where the file does not say it.
    pub(crate) fn at_pace(model: &Model, times: f64, speeds: &[f64]) -> Self {
        let mut hybrid = Hybrid::built(model, times.max(1.0), speeds);
        hybrid.stiff = hybrid.fastest_friction(&hybrid.theta()) > hybrid.stiff_rate();
        if hybrid.stiff {
            hybrid.sharpness.0 = SHARPER;
            for (placed, entry) in hybrid.effects.iter_mut().zip(&model.effects) {
                if entry.smoothing.is_none() {
                    placed.smoothing *= SHARPER;
                }
            }
        }
        hybrid
    }

    /// The same for methods that choose their steps themselves or are told them: never stiff, friction smoothed as the file says.
    pub fn explicit(model: &Model) -> Self {
        Hybrid::built(model, 1.0, &[])
    }

    fn built(model: &Model, pace: f64, speeds: &[f64]) -> Self {
        let mechanics = model.mechanics.clone();
        let tolerance = &model.tolerance;
        let within = |id, value: f64, relative: f64| Constant {
            id,
            value,
            lower: (0.02 * value).min(50.0 * value),
            upper: (0.02 * value).max(50.0 * value),
            tolerance: relative * value.abs(),
            is_said: true,
        };
        let mut constants = Vec::new();
        for (k, parameter) in mechanics.parameters().iter().enumerate() {
            let mut said = tolerance.parameters.iter();
            let relative = match parameter.role {
                Role::MassScale => Some(tolerance.mass),
                _ => said.find(|(index, _)| *index == k).map(|said| said.1),
            };
            let (id, value) = (ConstantId::Mechanics(k), model.parameter_values[k]);
            constants.push(Constant {
                is_said: relative.is_some(),
                ..within(id, value, relative.unwrap_or(0.0))
            });
        }
        for (i, input) in model.inputs.iter().enumerate() {
            constants.push(within(ConstantId::Gain(i), input.gain, tolerance.gain));
        }
        for (c, sensor) in model.sensors.iter().enumerate() {
            let two_quanta = 2.0 * sensor.resolution.unwrap_or(0.0);
            constants.push(Constant {
                id: ConstantId::Zero(c),
                value: sensor.zero,
                lower: f64::NEG_INFINITY,
                upper: f64::INFINITY,
                tolerance: tolerance.zero[c].unwrap_or(two_quanta),
                is_said: true,
            });
        }
        let tree = model.tree.as_ref();
        let coordinate = |input: &Input| match input.pushes {
            Pushes::Coordinate(c) => c,
            Pushes::Link(on) => tree.and_then(|tree| carrier(tree, on.link)).unwrap_or(0),
        };
        let coordinates = model.inputs.iter().map(coordinate).collect();
        let mut hybrid = Hybrid::new(mechanics, coordinates, constants);
        hybrid.pace = pace;
        for (c, &speed) in speeds.iter().enumerate() {
            let usual = hybrid.default_smoothing(c);
            if let Some(slow) = hybrid.slow.get_mut(c) {
                *slow = (OF_SPEED * speed / usual).clamp(LEAST_SLOW, 1.0);
            }
        }
        let law = |input: &Input| match input.pushes {
            Pushes::Coordinate(_) => None,
            Pushes::Link(on) => tree?.link_force(on.link, on.point, on.force, on.torque),
        };
        hybrid.link_forces = model.inputs.iter().map(|i| law(i).map(Arc::new)).collect();
        hybrid.between = model.inputs.iter().map(|input| input.between).collect();
        hybrid.variants = model.tree.clone().map(|tree| Arc::new(Variants::new(tree)));
        for entry in &model.effects {
            let target = match entry.target {
                Target::Coordinate(c) => c,
                Target::Input(i) => i,
                Target::Link(l) => l,
            };
            let placed = Placed {
                kind: entry.kind,
                target,
                smoothing: entry
                    .smoothing
                    .unwrap_or(hybrid.default_smoothing(hybrid.coordinate_of(entry.kind, target))),
                fixed: entry.fixed,
            };
            hybrid.add(placed, &entry.values);
        }
        for entry in &model.networks {
            hybrid.add_network(entry.shared());
        }
        hybrid
    }

    /// The model with inputs that stay as they are between samples, whatever it says of them.
    pub(crate) fn held(mut self) -> Self {
        self.between.fill(Between::Held);
        self
    }

    /// The model of `mechanics` with inputs that act on the given coordinates with the given gains, held between samples, without effects.
    /// `constants` holds the entries of θ for mechanics, gains and zeros, in this order.
    pub fn new(
        mechanics: Arc<dyn Mechanics>,
        input_coordinates: Vec<usize>,
        constants: Vec<Constant>,
    ) -> Self {
        debug_assert_eq!(
            constants.len(),
            mechanics.parameters().len() + input_coordinates.len() + mechanics.coordinates().len()
        );
        Hybrid {
            slow: vec![1.0; mechanics.coordinates().len()],
            starts: starts(mechanics.coordinates()),
            left: vec![false; mechanics.nv()],
            typical: typical(&*mechanics).0,
            space: Product {
                first: PhaseSpace {
                    positions: Positions::new(mechanics.coordinates()),
                },
                second: Flat::new(0),
            },
            mechanics,
            carried: vec![false; input_coordinates.len()],
            networks: Vec::new(),
            open: Vec::new(),
            between: vec![Between::Held; input_coordinates.len()],
            link_forces: vec![None; input_coordinates.len()],
            input_coordinates,
            effects: Vec::new(),
            laws: Vec::new(),
            ranges: Vec::new(),
            state_ranges: Vec::new(),
            constants,
            variants: None,
            extra: None,
            stiff: false,
            pace: 1.0,
            sharpness: (1.0, 1.0),
        }
    }

    /// Adds an effect with these parameter values; they are free, or exact when it is [`fixed`](Placed::fixed). Beside one of its kind that is, it may take from
    /// that: [`Kind::lower_bound`].
    ///
    /// With an effect that changes the mechanics where [`Inertial::check`](crate::effect::Inertial::check) refuses it, there is no motion: accelerations are NaN, and
    /// an error.
    pub fn add(&mut self, effect: Placed, values: &[f64]) {
        let first = self.constants.len();
        let index = self.effects.len();
        let known = self.known_strength(effect.kind, effect.target);
        debug_assert_eq!(values.len(), effect.kind.parameters.len());
        for (k, (spec, &value)) in effect.kind.parameters.iter().zip(values).enumerate() {
            self.constants.push(Constant {
                id: ConstantId::Effect(index, k),
                value,
                lower: effect.kind.lower_bound(k, known),
                upper: match spec.upper_at(self.pace) {
                    upper if value > upper => 2.0 * value,
                    upper => upper,
                },
                // What is left out does not come into being by a fit.
                tolerance: match effect.fixed || spec.held || !value.is_finite() {
                    true => 0.0,
                    false => f64::INFINITY,
                },
                is_said: true,
            });
        }
        let first_state = self.nh();
        let states = effect.kind.states();
        self.space.second = Flat::new(first_state + states);
        self.state_ranges.push(first_state..first_state + states);
        if effect.kind.is_transmission()
            && let Some(carried) = self.carried.get_mut(effect.target)
        {
            *carried = true;
        }
        self.effects.push(effect);
        self.laws.push(Law::of(effect.kind));
        self.ranges.push(first..self.constants.len());
        // One that was there before may take from what is known from now on.
        let known = self.known_strength(effect.kind, effect.target);
        let beside = |placed: &Placed| placed.kind == effect.kind && placed.target == effect.target;
        for (placed, range) in self.effects.iter().zip(&self.ranges) {
            if beside(placed) && !placed.fixed && effect.fixed {
                self.constants[range.start].lower = placed.kind.lower_bound(0, known);
            }
        }
        if effect.kind.changes(values).is_some() {
            self.extra = Extra::of(self).map(Arc::new);
        }
    }

    /// What the model has of the strength of a kind on a target: what effects of this kind that are known exactly have as their first parameter, or what
    /// masses there are to take from.
    pub(crate) fn known_strength(&self, kind: &Kind, target: usize) -> f64 {
        let known =
            |placed: &Placed| placed.kind == kind && placed.target == target && placed.fixed;
        let effects = self.effects.iter().zip(&self.ranges);
        let strengths = effects
            .filter(|(placed, _)| known(placed))
            .map(|(_, range)| self.constants[range.start].value);
        let inertia = match kind.action {
            Action::Inertial(change) if kind.adds_up() => {
                let tree = self.variants.as_ref().map(|v| v.tree());
                change.may_take(target, self.mechanics(), tree)
            }
            _ => 0.0,
        };
        strengths.sum::<f64>() + inertia
    }

    /// The model without effect `index`; the later ones move up.
    pub fn without(&self, index: usize) -> Self {
        let mut rest = Hybrid {
            effects: Vec::new(),
            laws: Vec::new(),
            ranges: Vec::new(),
            state_ranges: Vec::new(),
            carried: vec![false; self.carried.len()],
            left: vec![false; self.left.len()],
            networks: Vec::new(),
            open: Vec::new(),
            space: Product {
                second: Flat::new(0),
                ..self.space.clone()
            },
            constants: self.constants[..self.base_len()].to_vec(),
            extra: None,
            ..self.clone()
        };
        for (i, effect) in self.effects.iter().enumerate() {
            if i != index {
                let own = self.constants[self.ranges[i].clone()].iter();
                let values: Vec<f64> = own.map(|c| c.value).collect();
                rest.add(*effect, &values);
                // Fits go on with what they were given.
                let new = rest.ranges.last().cloned().unwrap_or_default();
                let own = &self.constants[self.ranges[i].clone()];
                for (new, old) in rest.constants[new].iter_mut().zip(own) {
                    new.tolerance = old.tolerance;
                }
            }
        }
        for (network, open) in self.networks.iter().zip(&self.open) {
            match open {
                Some(range) => {
                    let own = &self.constants[range.clone()];
                    let values: Vec<f64> = own.iter().map(|c| c.value).collect();
                    let tolerance = own.first().map_or(0.0, |c| c.tolerance);
                    rest.add_open_network(Arc::new(network.with_parameters(&values)), tolerance);
                }
                None => rest.add_network(network.clone()),
            }
        }
        rest
    }

    fn base_len(&self) -> usize {
        self.mechanics.parameters().len() + self.input_coordinates.len() + self.starts.len()
    }
}
