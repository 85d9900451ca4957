//! The model that is simulated and fitted: known mechanics and every effect.
//!
//! M(q) v̇ = Σ_i B_i g_i ū_i + Σ_e Q_e(q, v, f, h; p_e) − C(q, v) v − G(q),  ḣ = Σ_e rate_e(q, v, f, h; p_e)
//!
//! To Q come the networks of the model, as functions of (q, v, f). ū_i is input i after the drive effects on it, g_i its gain, B_i picks its coordinate, or is the b(q) of a link that it pushes ([`LinkForce`]), f = g ū; Q_e are the effects that are forces, h
//! the states of those with a memory. A state of the model is x = (q, v, h), h effect after effect.
//! M, C and G are those of the mechanics and of the effects that change it, see [`Inertial`].
//! What can be estimated is one vector θ of [`Constant`]s: the constants of the mechanics, the input gains, the zeros of the
//! sensors, the parameters of the effects, and those of networks that are open to fits.

mod build;
mod constants;
mod contacts;
mod drive;
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
mod sharpness;

use std::ops::Range;
use std::sync::Arc;

use integrators::{Flat, PhaseSpace, Product, Space};
use lagrange::Mechanics;
use lagrange::mechanism::{Body, JointKind, Link, LinkForce, Tree};

use crate::effect::{Action, ActsOn, Between, Inertial, Kind, Law, about_joint, tilts};
use crate::entries::Start;
use crate::learnt::LearntForce;
use crate::motion::Positions;

pub use constants::{Constant, ConstantId};
pub use contacts::{HybridContacts, Touch};
pub use drive::DrivenInputs;
pub use dynamics::Memory;
pub(crate) use eight::{Eight, EightMemory, Lane};
pub use hidden::HiddenPath;
pub use jumps::HeldInputs;
pub use motion::HybridMotion;
pub(crate) use reading::behind;
pub use reading::{Predicted, Reading};

use extra::{Extra, Variants};

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
    /// Where it is taken to be where nobody says.
    typical: Vec<f64>,
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
    /// Their laws, of those that are forces on joints.
    laws: Vec<Option<Arc<Law>>>,
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

impl Hybrid {
    /// Where a coordinate starts in q and in v.
    pub(crate) fn start_of(&self, coordinate: usize) -> Start {
        self.starts[coordinate]
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

    /// The body that link `link` belongs to.
    fn body_of(&self, link: usize) -> Option<&Body> {
        let tree = self.variants.as_ref()?.tree();
        tree.bodies().get(tree.links().get(link)?.body?)
    }

    /// The mass of the body that link `link` belongs to, kg, where this is the first link of a body that has mass.
    pub fn mass_of_body(&self, link: usize) -> Option<f64> {
        let (body, name) = (self.body_of(link)?, &self.links().get(link)?.name);
        (body.name == *name && body.mass > 0.0).then_some(body.mass)
    }

    /// The mass of that body, kg, or what a kind of effect changes of its inertia: that about its joint, kg·m².
    pub fn inertia_of_body(&self, kind: &Kind, link: usize) -> Option<f64> {
        let mass = self.mass_of_body(link)?;
        match kind.inertial() {
            Some(Inertial::OfLink) => self.body_of(link).map(about_joint),
            _ => Some(mass),
        }
    }

    /// The way from the joint of the body that link `link` belongs to, to its centre of mass, m.
    pub fn way_to_centre(&self, link: usize) -> Option<f64> {
        self.body_of(link).map(|body| body.centre.norm())
    }

    /// Whether an effect that changes the mechanics may be looked for on `target` (of an input, its coordinate): a rotor on every joint,
    /// for gears, flywheels and encoders have inertia as motors have; a mass once in each body that has some, a tilt where a joint on the base, or the first one of a horizontal direction, tells that.
    pub fn may_change(&self, change: Inertial, target: usize) -> bool {
        let tree = self.variants.as_ref().map(|v| v.tree());
        let theta = self.theta();
        let p = &theta[self.mechanics_range()];
        let sensible = match change {
            Inertial::Rotor | Inertial::Motor => true,
            Inertial::PointMass | Inertial::Payload => self.mass_of_body(target).is_some(),
            Inertial::Centre | Inertial::OfLink => {
                self.mass_of_body(target).is_some() && tree.is_some_and(|tree| turns(tree, target))
            }
            Inertial::Tilt => tree.is_some_and(|tree| tilts(tree).contains(&target)),
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
}

/// Whether the body that a link belongs to turns with any joint: else where its mass is in it does not show.
fn turns(tree: &Tree, link: usize) -> bool {
    let mut at = tree.links().get(link).and_then(|link| link.body);
    while let Some(body) = at.and_then(|at| tree.bodies().get(at)) {
        let joint = body.joint.and_then(|joint| tree.joints().get(joint));
        // A base that floats turns as it likes.
        if joint.is_none_or(|joint| joint.kind != JointKind::Prismatic) {
            return true;
        }
        at = body.parent;
    }
    false
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
