//! The model that is simulated and fitted: known mechanics and every effect.
//!
//! M(q) v̇ = Σ_i B_i g_i ū_i + Σ_e Q_e(q, v, f, h; p_e) − C(q, v) v − G(q),  ḣ = Σ_e rate_e(q, v, f, h; p_e)
//!
//! To Q come the networks of the model, as functions of (q, v, f). ū_i is input i after the drive effects on it, g_i its gain, B_i picks its coordinate, or is the b(q) of a link that it pushes ([`LinkForce`]), f = g ū; Q_e are the effects that are forces, h
//! the states of those with a memory. A state of the model is x = (q, v, h), h effect after effect.
//! M, C and G are those of the mechanics and of the effects that change it, see [`Inertial`].
//! What can be estimated is one vector θ of [`Constant`]s: the constants of the mechanics, the input gains, the zeros of the
//! sensors, the parameters of the effects, and those of networks that are open to fits.

mod contacts;
mod dynamics;
mod eight;
mod extra;
mod forces;
mod hidden;
mod jumps;
mod motion;
mod networks;
mod on_links;
mod reading;
mod settled;

use std::ops::Range;
use std::sync::Arc;

use integrators::{Flat, PhaseSpace, Product, Space};
use lagrange::mechanism::{Link, LinkForce, Tree};
use lagrange::{LANES, Mechanics, Role};

use crate::effect::{Action, ActsOn, Between, Grid, Inertial, Kind, Signal, default_smoothing};
use crate::entries::{Start, starts};
use crate::learnt::{LearntForce, Quantity};
use crate::model::{Input, Model, Pushes, Target};
use crate::motion::Positions;

pub use contacts::{HybridContacts, Touch};
pub use dynamics::Memory;
pub(crate) use eight::{Eight, EightMemory, Lane};
pub use hidden::HiddenPath;
pub use jumps::HeldInputs;
pub use motion::HybridMotion;
pub(crate) use reading::behind;
pub use reading::{Predicted, Reading};

use extra::{Extra, Variants};

/// Friction with a faster rate about rest than this, 1/s at the usual pace, is stepped implicitly: explicit steps would have to be shorter than a millisecond.
const STIFF: f64 = 2.5e3;
/// Fits sharpen friction up to this part of it, so that what they move does not take it beyond.
const CLOSE_TO_STIFF: f64 = 0.8;
/// The velocity over which friction changes its sign is no more than this part of the speed of what is slow, and no less than this part of the usual one: what is
/// nearly always at rest has no speed.
const OF_SPEED: f64 = 0.1;
const LEAST_SLOW: f64 = 1e-3;
/// Implicit steps follow friction whose change of sign is spread over so many times less: on what is light and is often held, creeping shows most.
const SHARPER: f64 = 0.1;

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
}

/// What an entry of θ is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ConstantId {
    /// Constant of the mechanics, by its index in [`Mechanics::parameters`].
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

/// An effect in place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// What it is.
    pub kind: &'static Kind,
    /// The coordinate it sits on (or whose sensor it sits on), the input, or the link: see [`Kind::acts_on`].
    pub target: usize,
    /// Velocity over which a sign change of friction is spread, m/s or rad/s.
    pub smoothing: f64,
    /// Whether its parameters are exact: no fit moves them, and nothing takes its place.
    pub fixed: bool,
}

impl Placed {
    /// Whether it is the same kind on the same target, by what is known of it or by what a fit has to find.
    pub fn is_same(&self, other: &Placed) -> bool {
        self.kind == other.kind && self.target == other.target && self.fixed == other.fixed
    }
}

/// A state of the model, taken apart.
#[derive(Debug, Clone, Copy)]
pub struct State<'a> {
    /// Positions, nq.
    pub q: &'a [f64],
    /// Velocities, nv.
    pub v: &'a [f64],
    /// States of the effects with a memory, nh.
    pub h: &'a [f64],
}

/// Mechanics, inputs and effects, without the values of θ.
#[derive(Clone)]
pub struct Hybrid {
    mechanics: Arc<dyn Mechanics>,
    /// Where each coordinate stands in q and in v.
    starts: Vec<Start>,
    /// Where the states (q, v, h) live.
    space: Product<PhaseSpace<Positions>, Flat>,
    /// The coordinate each input acts on; of one that pushes a link, that of the link's joint.
    input_coordinates: Vec<usize>,
    /// What the inputs that push links do per unit.
    link_forces: Vec<Option<Arc<LinkForce>>>,
    /// Whether an entry of v is left to a network alone: they do not push it.
    left: Vec<bool>,
    /// What each input does between two samples of a log.
    between: Vec<Between>,
    effects: Vec<Placed>,
    /// Where the parameters of each effect lie in θ.
    ranges: Vec<Range<usize>>,
    /// Where the states of each effect lie in h.
    state_ranges: Vec<Range<usize>>,
    /// Whether an input does not act on its joint itself: a transmission stands between, or they act through a network alone.
    carried: Vec<bool>,
    /// What was learnt of Q.
    networks: Vec<Arc<LearntForce>>,
    /// Where the parameters of each network lie in θ, of those that are open to fits.
    open: Vec<Option<Range<usize>>>,
    constants: Vec<Constant>,
    /// The mechanisms that effects add, of a model made of rigid bodies.
    variants: Option<Arc<Variants>>,
    /// What the effects add to M, C and G.
    extra: Option<Arc<Extra>>,
    /// Whether its friction is too fast for explicit steps.
    stiff: bool,
    /// How many times as long as usual everything may take; at least 1.
    pace: f64,
    /// Factors, one a coordinate, on the smoothing of friction of which nothing is said: what moves slowly would creep.
    slow: Vec<f64>,
    /// Factors on the smoothing of friction of which nothing is said: what a model file means by that, and by how much sharper it was made since.
    sharpness: (f64, f64),
}

/// The inputs of one recording on its integration grid, after the drives, times their gains.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivenInputs {
    /// The integration steps.
    pub grid: Grid,
    /// One signal an input, N or N·m, with derivatives in θ.
    pub forces: Vec<Signal>,
}

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
        };
        let mut constants = Vec::new();
        for (k, parameter) in mechanics.parameters().iter().enumerate() {
            let relative = match parameter.role {
                Role::MassScale => tolerance.mass,
                _ => tolerance
                    .parameters
                    .iter()
                    .find(|(index, _)| *index == k)
                    .map_or(0.0, |(_, relative)| *relative),
            };
            let value = model.parameter_values[k];
            constants.push(within(ConstantId::Mechanics(k), value, relative));
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

    /// How long ago, s, what an input was may still matter to the motion, `interval` s a sample; `None` where a law of its drive does not know.
    pub(crate) fn past(&self, interval: f64, theta: &[f64]) -> Option<f64> {
        let mut drives = vec![0.0; self.inputs()];
        for (effect, range) in self.effects.iter().zip(&self.ranges) {
            if let Action::Drive(law) = effect.kind.action {
                drives[effect.target] += law.past(&theta[range.clone()])?;
            }
        }
        let back = self
            .networks
            .iter()
            .flat_map(|network| network.features())
            .map(|feature| match feature.quantity {
                Quantity::Input { back, .. } => back,
                _ => 0,
            })
            .max();
        let longest = drives.into_iter().fold(0.0, f64::max);
        Some(longest + back.unwrap_or(0) as f64 * interval)
    }

    /// The velocity over which a sign change of friction of a coordinate is spread unless a model says otherwise, m/s or, of an angle, rad/s; in a fitted model as
    /// much sharper as its own friction was made.
    pub fn default_smoothing(&self, coordinate: usize) -> f64 {
        let own = self.mechanics.coordinates().get(coordinate);
        let slow = self.slow.get(coordinate).copied().unwrap_or(1.0);
        self.unsaid_smoothing(own.is_some_and(|c| c.angular)) * slow * self.sharpness.1
    }

    /// The same as the model's file has it where it says nothing.
    pub(crate) fn unsaid_smoothing(&self, angular: bool) -> f64 {
        default_smoothing(angular) * self.sharpness.0
    }

    /// The fastest rate of dry friction at rest where all coordinates are 0, −(M⁻¹)_jj ∂Q_j/∂v_j, 1/s; 0 where M has no inverse there, where a body
    /// floats and under constraints.
    fn fastest_friction(&self, theta: &[f64]) -> f64 {
        let n = self.nv();
        if self.nq() != n || self.mechanics.constraints().is_some() {
            return 0.0;
        }
        let rest = vec![[0.0; LANES]; self.nx()];
        let zeros = vec![0.0; n];
        let mut mass = nalgebra::DMatrix::zeros(n, n);
        self.mass_matrix_into(&zeros, theta, &mut self.memory(&[]), &mut mass);
        let Some(mass) = nalgebra::Cholesky::new(mass) else {
            return 0.0;
        };
        let response = mass.inverse().diagonal();
        let mut slopes = zeros;
        for (index, effect) in self.effects.iter().enumerate() {
            if let Action::Joint(law) = effect.kind.action
                && law.dry().is_some()
            {
                let [_, slope] = self.slope_of_eight(law, index, &rest, theta);
                slopes[self.starts[effect.target].v] += slope[0];
            }
        }
        let rates = response.iter().zip(&slopes).map(|(r, slope)| -r * slope);
        rates.fold(0.0, f64::max)
    }

    fn stiff_rate(&self) -> f64 {
        STIFF / self.pace
    }

    /// The least factor on the smoothing of dry friction at θ that leaves it slow enough for explicit steps; 0 where the steps are implicit already.
    pub(crate) fn sharpest(&self, theta: &[f64]) -> f64 {
        match self.stiff {
            true => 0.0,
            false => self.fastest_friction(theta) / (CLOSE_TO_STIFF * self.stiff_rate()),
        }
    }

    /// The model with the smoothing of all friction that may stick times `factor`, with implicit steps if it is too fast for others at θ.
    pub(crate) fn sharpened(&self, factor: f64, theta: &[f64]) -> Self {
        let mut sharp = self.smoothed_by(factor, |placed| placed.kind.dry().is_some());
        sharp.stiff |= sharp.fastest_friction(theta) > sharp.stiff_rate();
        sharp.sharpness.1 *= factor;
        sharp
    }

    /// The same with implicit steps or without, whatever its friction.
    #[cfg(test)]
    pub(crate) fn stepped_implicitly(mut self, stiff: bool) -> Self {
        self.stiff = stiff;
        self
    }

    /// Whether roll-outs take steps that are implicit: dry friction brings a joint to rest at a rate of more than 2500 1/s.
    pub fn is_stiff(&self) -> bool {
        self.stiff
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
    /// With an effect that changes the mechanics where [`Inertial::check`] refuses it, there is no motion: accelerations are NaN, and
    /// an error.
    pub fn add(&mut self, effect: Placed, values: &[f64]) {
        let first = self.constants.len();
        let index = self.effects.len();
        let known = self.known_strength(effect.kind, effect.target);
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
        self.ranges.push(first..self.constants.len());
        // One that was there before may take from what is known from now on.
        let known = self.known_strength(effect.kind, effect.target);
        let beside = |placed: &Placed| placed.kind == effect.kind && placed.target == effect.target;
        for (placed, range) in self.effects.iter().zip(&self.ranges) {
            if beside(placed) && !placed.fixed && effect.fixed {
                self.constants[range.start].lower = placed.kind.lower_bound(0, known);
            }
        }
        if effect.kind.inertial().is_some() {
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

    /// Adds a learnt force.
    pub fn add_network(&mut self, force: Arc<LearntForce>) {
        if force.is_alone() {
            let joints: Vec<usize> = force.outputs().iter().map(|o| o.coordinate).collect();
            self.leave_to_network(&joints);
        }
        self.networks.push(force);
        self.open.push(None);
    }

    /// Adds a learnt force whose parameters are entries of θ, around what they are with this standard deviation.
    pub fn add_open_network(&mut self, force: Arc<LearntForce>, tolerance: f64) {
        let index = self.networks.len();
        let parameters = force.network().parameters().iter().enumerate();
        let first = self.constants.len();
        self.constants
            .extend(parameters.map(|(k, &value)| Constant {
                id: ConstantId::Network(index, k),
                value,
                lower: f64::NEG_INFINITY,
                upper: f64::INFINITY,
                tolerance,
            }));
        self.add_network(force);
        self.open[index] = Some(first..self.constants.len());
    }

    /// The learnt forces with the parameters that open ones have at θ.
    pub fn networks_at(&self, theta: &[f64]) -> Vec<Arc<LearntForce>> {
        let own = self.networks.iter().zip(&self.open);
        own.map(|(network, open)| match open {
            Some(range) => Arc::new(network.with_parameters(&theta[range.clone()])),
            None => network.clone(),
        })
        .collect()
    }

    /// Inputs do not act on these coordinates by themselves any more, but through a network alone; effects of the model do.
    pub(crate) fn leave_to_network(&mut self, coordinates: &[usize]) {
        for (carried, own) in self.carried.iter_mut().zip(&self.input_coordinates) {
            *carried |= coordinates.contains(own);
        }
        for start in coordinates.iter().filter_map(|&c| self.starts.get(c)) {
            self.left[start.v] = true;
        }
    }

    /// Where a coordinate starts in q and in v.
    pub(crate) fn start_of(&self, coordinate: usize) -> Start {
        self.starts[coordinate]
    }

    /// What was learnt of Q.
    pub fn networks(&self) -> &[Arc<LearntForce>] {
        &self.networks
    }

    /// The model without effect `index`; the later ones move up.
    pub fn without(&self, index: usize) -> Self {
        let mut rest = Hybrid {
            effects: Vec::new(),
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

    /// The model with all smoothing velocities times `factor`.
    pub fn with_smoothing_scale(&self, factor: f64) -> Self {
        self.smoothed_by(factor, |_| true)
    }

    /// The model with the smoothing velocities of these effects times `factor`.
    pub(crate) fn smoothed_by(&self, factor: f64, counts: impl Fn(&Placed) -> bool) -> Self {
        let mut scaled = self.clone();
        for placed in scaled.effects.iter_mut().filter(|e| counts(e)) {
            placed.smoothing *= factor;
        }
        scaled
    }

    fn base_len(&self) -> usize {
        self.mechanics.parameters().len() + self.input_coordinates.len() + self.starts.len()
    }

    /// The known mechanics.
    pub fn mechanics(&self) -> &dyn Mechanics {
        &*self.mechanics
    }

    /// Length of q: more than [`nv`](Self::nv) where a body floats.
    pub fn nq(&self) -> usize {
        self.space.first.positions.dim()
    }

    /// Degrees of freedom: as many as coordinates, unless a body floats.
    pub fn nv(&self) -> usize {
        self.space.first.positions.tangent_dim()
    }

    /// Which coordinates are angles on the circle.
    pub fn wraps(&self) -> Vec<bool> {
        let coordinates = self.mechanics.coordinates().iter();
        coordinates.map(|c| c.wraps).collect()
    }

    /// Number of states of effects with a memory.
    pub fn nh(&self) -> usize {
        self.space.second.dim()
    }

    /// Length of a state (q, v, h).
    pub fn nx(&self) -> usize {
        self.space.dim()
    }

    /// Directions of motion of a state: 2 nv + nh.
    pub fn directions(&self) -> usize {
        self.space.tangent_dim()
    }

    /// A state (q, v, h) taken apart.
    pub fn parts<'a>(&self, x: &'a [f64]) -> State<'a> {
        let (q, rest) = x.split_at(self.nq());
        let (v, h) = rest.split_at(self.nv());
        State { q, v, h }
    }

    /// The coordinate that an effect of this kind on this target moves or reads.
    pub fn coordinate_of(&self, kind: &Kind, target: usize) -> usize {
        match kind.acts_on() {
            ActsOn::Joint | ActsOn::Sensor => target,
            ActsOn::Input => self.input_coordinates[target],
            ActsOn::Link => {
                let tree = self.variants.as_ref().map(|v| v.tree());
                tree.and_then(|tree| carrier(tree, target)).unwrap_or(0)
            }
        }
    }

    /// Whether the quantities of an effect of this kind on this target are those of an angle.
    pub fn is_angular(&self, kind: &Kind, target: usize) -> bool {
        let own_units = !matches!(kind.action, Action::Drive(_)) && kind.acts_on() != ActsOn::Link;
        own_units && self.mechanics.coordinates()[self.coordinate_of(kind, target)].angular
    }

    /// The name of what an effect sits on.
    pub fn target_name<'a>(&'a self, kind: &Kind, target: usize, inputs: &'a [String]) -> &'a str {
        match kind.acts_on() {
            ActsOn::Joint | ActsOn::Sensor => &self.mechanics.coordinates()[target].name,
            ActsOn::Input => &inputs[target],
            ActsOn::Link => self.links().get(target).map_or("", |link| &link.name),
        }
    }

    /// The links of a mechanism that is made of rigid bodies; none of another one.
    pub fn links(&self) -> &[Link] {
        self.variants.as_ref().map_or(&[], |v| v.tree().links())
    }

    /// The mass of the body that link `link` belongs to, kg, where this is the first link of a body that has mass.
    pub fn mass_of_body(&self, link: usize) -> Option<f64> {
        let tree = self.variants.as_ref()?.tree();
        let link = tree.links().get(link)?;
        let body = tree.bodies().get(link.body?)?;
        (body.name == link.name && body.mass > 0.0).then_some(body.mass)
    }

    /// The way from the joint of the body that link `link` belongs to, to its centre of mass, m.
    pub fn way_to_centre(&self, link: usize) -> Option<f64> {
        let tree = self.variants.as_ref()?.tree();
        let body = tree.links().get(link)?.body?;
        Some(tree.bodies().get(body)?.centre.norm())
    }

    /// Whether an effect that changes the mechanics may be looked for on `target` (of an input, its coordinate): a rotor on every joint,
    /// for gears, flywheels and encoders have inertia as motors have; a mass once in each body that has some, a tilt where a joint is on the base.
    pub fn may_change(&self, change: Inertial, target: usize) -> bool {
        let tree = self.variants.as_ref().map(|v| v.tree());
        let theta = self.theta();
        let p = &theta[self.mechanics_range()];
        let sensible = match change {
            Inertial::Rotor | Inertial::Motor => true,
            Inertial::PointMass | Inertial::Payload => self.mass_of_body(target).is_some(),
            Inertial::Tilt => tree.is_some_and(|tree| {
                let on_base = tree.bodies().iter().filter(|body| body.parent.is_none());
                let mut joints = on_base.filter_map(|body| tree.joints().get(body.joint?));
                joints.any(|joint| joint.is_independent() && joint.coordinate == Some(target))
            }),
        };
        sensible && change.check(target, self.mechanics(), p, tree).is_ok()
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.input_coordinates.len()
    }

    /// The coordinate each input acts on; of one that pushes a link, that of the link's joint.
    pub fn input_coordinates(&self) -> &[usize] {
        &self.input_coordinates
    }

    /// The effects in place.
    pub fn effects(&self) -> &[Placed] {
        &self.effects
    }

    /// Where the states of effect `index` lie in h.
    pub fn state_range(&self, index: usize) -> Range<usize> {
        self.state_ranges[index].clone()
    }

    /// Where the parameters of effect `index` lie in θ.
    pub fn range(&self, index: usize) -> Range<usize> {
        self.ranges[index].clone()
    }

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

    fn mechanics_range(&self) -> Range<usize> {
        0..self.mechanics.parameters().len()
    }

    fn gain_index(&self, input: usize) -> usize {
        self.mechanics.parameters().len() + input
    }

    /// Index in θ of the zero of coordinate `c`.
    pub fn zero_index(&self, c: usize) -> usize {
        self.mechanics.parameters().len() + self.input_coordinates.len() + c
    }

    /// The inputs of a recording sampled at `t` with values `u` (one column an input), as forces on the integration grid, with
    /// derivatives in those entries of θ that are in `free`.
    pub fn drive(
        &self,
        t: &[f64],
        u: &[Vec<f64>],
        substeps: usize,
        theta: &[f64],
        free: &[usize],
    ) -> DrivenInputs {
        let grid = Grid::new(t, substeps);
        let forces = u
            .iter()
            .enumerate()
            .map(|(input, u)| {
                let mut signal = Signal {
                    value: self.between[input].over_steps(&grid, u),
                    by_parameter: Vec::new(),
                };
                for (effect, range) in self.effects.iter().zip(&self.ranges) {
                    if let Action::Drive(law) = effect.kind.action
                        && effect.target == input
                    {
                        let first = free.contains(&range.start).then_some(range.start);
                        law.pass(&grid, &theta[range.clone()], first, &mut signal);
                    }
                }
                self.amplify(input, theta, free, &mut signal);
                signal
            })
            .collect();
        DrivenInputs { grid, forces }
    }

    /// Times the gain.
    fn amplify(&self, input: usize, theta: &[f64], free: &[usize], signal: &mut Signal) {
        let index = self.gain_index(input);
        let gain = theta[index];
        for (_, derivative) in &mut signal.by_parameter {
            derivative.iter_mut().for_each(|d| *d *= gain);
        }
        if free.contains(&index) {
            signal.by_parameter.push((index, signal.value.clone()));
        }
        signal.value.iter_mut().for_each(|u| *u *= gain);
    }
}

/// The coordinate that moves the body of a link.
fn carrier(tree: &Tree, link: usize) -> Option<usize> {
    let body = tree.bodies().get(tree.links().get(link)?.body?)?;
    match body.joint {
        Some(joint) => tree.joints().get(joint)?.coordinate,
        // A base that floats comes first.
        None => Some(0),
    }
}
