//! What the rest of the program knows of a kind of effect.

use super::{
    Distortion, DriveLaw, DryFriction, Inertial, JointForce, MemoryForce, Motor, RigidStop,
};

/// A kind of effect: its name in model files, its parameters and what it does.
#[derive(Clone, Copy)]
pub struct Kind {
    /// Name in model files and reports.
    pub name: &'static str,
    /// The family it belongs to; a tie within a family is reported as the family.
    pub family: Family,
    /// What it is, in a few words.
    pub summary: &'static str,
    /// Its parameters, in the order in which the law takes them.
    pub parameters: &'static [ParameterSpec],
    /// What it does.
    pub action: Action,
    /// Kinds that this one contains as a special case: where it joins them on a target, it takes their place.
    pub contains: &'static [&'static str],
    /// First steps away from its absence, by which a screen sees what the kind could do. Takes the scales of the motion and, where
    /// it would take the place of a contained effect, that one's parameters (else none).
    pub probes: fn(&Scales, &[f64]) -> Vec<Probe>,
}

/// A small step from the absence of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// Parameters at which the model is as it was.
    pub neutral: Vec<f64>,
    /// Parameters a step away.
    pub perturbed: Vec<f64>,
}

/// How large the motion on a target is, in the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scales {
    /// Middle of the range of q, m or rad.
    pub centre: f64,
    /// Half the range of q, m or rad.
    pub reach: f64,
    /// Speed exceeded in one sample of twenty, m/s or rad/s.
    pub speed: f64,
    /// Generalized force that moves the coordinate, root mean square, N or N·m.
    pub force: f64,
    /// Its own entry of the mass matrix, mean, kg or kg·m².
    pub mass: f64,
    /// What of that moves where all other coordinates give way, 1/(M⁻¹)_jj, mean, kg or kg·m², with the motors that the model has by themselves: what swings on springs in its drive.
    pub free_mass: f64,
    /// The input as logged, root mean square; 0 for a joint without one.
    pub input: f64,
    /// The largest size of the input as logged.
    pub largest_input: f64,
    /// Standard deviation of the noise of its position sensor, m or rad.
    pub noise: f64,
    /// What turns it back at the lower and the upper end of its range, where the log shows blows.
    pub struck: [Option<Struck>; 2],
    /// The generalized force that holds it where the log shows it at rest, N or N·m; 0 where it shows none.
    pub held: f64,
    /// How many times as long as on a laboratory's cart-pole, which turns round about once a second, everything takes.
    pub pace: f64,
}

/// An end of the range at which blows turn the motion back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Struck {
    /// Where it is, m or rad.
    pub place: f64,
    /// With what speed it is struck, m/s or rad/s.
    pub speed: f64,
    /// The part of it that is left behind a blow, 0 to 1.
    pub restitution: f64,
    /// A blow lasts no longer than about this, s.
    pub within: f64,
}

impl Struck {
    /// How far before its place a blow has to begin that lasts so long, s, so that it sends a body back as one would that took no time: with the part e of its
    /// speed, at this speed.
    pub fn ahead(&self, e: f64, lasting: f64) -> f64 {
        e / (1.0 + e) * self.speed * lasting
    }
}

impl Scales {
    /// Round numbers, for tests.
    #[cfg(test)]
    pub(crate) fn example() -> Self {
        Scales {
            centre: 0.0,
            reach: 1.0,
            speed: 1.0,
            force: 1.0,
            mass: 1.0,
            free_mass: 1.0,
            input: 1.0,
            largest_input: 1.0,
            noise: 1e-3,
            struck: [None; 2],
            held: 0.0,
            pace: 1.0,
        }
    }

    /// A force that is small beside those at work.
    pub fn small_force(&self) -> f64 {
        0.05 * self.force
    }
}

/// The one probe of a kind with one parameter, in which it is linear and vanishes at 0.
pub(super) fn from_zero(perturbed: f64) -> Vec<Probe> {
    vec![Probe {
        neutral: vec![0.0],
        perturbed: vec![perturbed],
    }]
}

impl Kind {
    /// The set-valued law behind it, where it is dry friction that fits smooth.
    pub fn dry(&self) -> Option<&'static dyn DryFriction> {
        match self.action {
            Action::Joint(law) => law.dry(),
            _ => None,
        }
    }

    /// The rigid stops behind it, where it is stops that give.
    pub fn stop(&self) -> Option<&'static dyn RigidStop> {
        match self.action {
            Action::Joint(law) => law.stop(),
            _ => None,
        }
    }

    /// Whether these parameters make it what it is called, in a motion of these scales.
    pub fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        match self.action {
            Action::Joint(law) => law.is_itself(scales, p),
            Action::Memory(law) | Action::Transmission(law) => law.is_itself(scales, p),
            Action::Inertial(change) => change.is_itself(p),
            Action::Drive(_) | Action::Sensor(_) => true,
        }
    }

    /// What it sits on.
    pub fn acts_on(&self) -> ActsOn {
        match self.action {
            Action::Joint(_) | Action::Memory(_) => ActsOn::Joint,
            Action::Sensor(_) => ActsOn::Sensor,
            Action::Drive(_) | Action::Transmission(_) => ActsOn::Input,
            Action::Inertial(change) if change.is_on_link() => ActsOn::Link,
            Action::Inertial(_) => ActsOn::Joint,
        }
    }

    /// What it does to the mechanics whatever its parameters are, if it changes them.
    pub fn inertial(&self) -> Option<Inertial> {
        match (self.action, self.motor()) {
            (Action::Inertial(change), _) => Some(change),
            (_, Some(Motor { within: None, .. })) => Some(Inertial::Motor),
            _ => None,
        }
    }

    /// What it does to the mechanics with the parameters `p`.
    pub fn changes(&self, p: &[f64]) -> Option<Inertial> {
        let within = self.motor().and_then(|motor| motor.inertia_within(p));
        self.inertial().or(within.map(|_| Inertial::Motor))
    }

    /// The parameter by which it changes the mechanics.
    pub fn inertial_parameter(&self) -> usize {
        self.motor().map_or(0, |motor| motor.inertia)
    }

    /// The motor of a transmission that has one.
    pub fn motor(&self) -> Option<Motor> {
        match self.action {
            Action::Transmission(law) => law.motor(),
            _ => None,
        }
    }

    /// Its law with a memory, if it has one.
    pub fn memory(&self) -> Option<&'static dyn MemoryForce> {
        match self.action {
            Action::Memory(law) | Action::Transmission(law) => Some(law),
            _ => None,
        }
    }

    /// Its parameters as people write them, where several sets of them are the same law: see
    /// [`ForceLaw::normalise`](super::ForceLaw::normalise).
    pub fn normalise(&self, p: &mut [f64]) {
        if let Action::Joint(law) = self.action {
            law.normalise(p);
        }
    }

    /// Number of its states.
    pub fn states(&self) -> usize {
        self.memory().map_or(0, MemoryForce::states)
    }

    /// Whether what it does follows from what was, and not from the state and the inputs of the moment alone.
    pub fn remembers(&self) -> bool {
        match self.action {
            Action::Memory(_) | Action::Transmission(_) => true,
            Action::Sensor(distortion) => distortion == Distortion::Delay,
            Action::Drive(law) => {
                let neutral: Vec<f64> = self.parameters.iter().map(|p| p.neutral).collect();
                law.remembers() || law.delay(&neutral).is_some()
            }
            Action::Joint(_) | Action::Inertial(_) => false,
        }
    }

    /// Whether fits have to start from its probes themselves: it is far from linear in its parameters, as what has a memory and what cuts an
    /// input off are.
    pub fn starts_at_probes(&self) -> bool {
        let cuts_off = self.parameters.iter().any(|p| p.neutral.is_infinite());
        self.states() > 0 || (matches!(self.action, Action::Drive(_)) && cuts_off)
    }

    /// Whether fits start from each of its probes: from those themselves, or from where each of them leads. Over which speeds dry friction has a hump, no small step tells.
    pub fn starts_from_each_probe(&self) -> bool {
        let is_speed = |spec: &ParameterSpec| spec.quantity == Quantity::Velocity;
        let has_hump = self.dry().is_some() && self.parameters.iter().any(is_speed);
        self.starts_at_probes() || has_hump
    }

    /// The parameter in which its first-order effect is a polynomial of a degree less than it has probes, where these differ in nothing else: a payload's moments
    /// go with the square of its place.
    pub fn place(&self) -> Option<usize> {
        (self.inertial() == Some(Inertial::Payload)).then_some(1)
    }

    /// Where fits start of what the motion itself shows to be there, whatever a screen says: stops by their blows, dry friction by what it holds. Else
    /// none.
    pub fn suggested(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let stops = self.stop().map(|stop| stop.struck(scales));
        let holds = self.dry().map(|dry| dry.holding(scales));
        stops.or(holds).unwrap_or_default()
    }

    /// Whether a model file may say over which velocity it spreads a change of sign.
    pub fn is_smoothed(&self) -> bool {
        self.acts_on() == ActsOn::Joint && self.inertial().is_none()
    }

    /// Whether one of it on a target leaves no room for one of `other`: an input has one transmission, and the angles of two tilts do not add.
    pub fn excludes(&self, other: &Kind) -> bool {
        let tilts = |kind: &Kind| kind.inertial() == Some(Inertial::Tilt);
        (self.is_transmission() && other.is_transmission()) || (tilts(self) && tilts(other))
    }

    /// Whether two of it on a target are one with the sum of their first parameters, their strengths, which are not negative together: where the model has some
    /// that is known exactly, or masses, an effect may take from that, down to nothing in all.
    pub fn adds_up(&self) -> bool {
        let free = |spec: &ParameterSpec| spec.lower.is_infinite() && spec.upper.is_infinite();
        match (self.action, self.parameters) {
            (Action::Joint(_), [strength, others @ ..]) => {
                strength.lower == 0.0 && strength.neutral == 0.0 && others.iter().all(free)
            }
            (Action::Inertial(change), _) => {
                matches!(
                    change,
                    Inertial::PointMass | Inertial::Rotor | Inertial::OfLink
                )
            }
            _ => false,
        }
    }

    /// The lower bound of parameter `k` beside what the model has of the same strength on the same target, `known`.
    pub fn lower_bound(&self, k: usize, known: f64) -> f64 {
        let lower = self
            .parameters
            .get(k)
            .map_or(f64::NEG_INFINITY, |spec| spec.lower);
        match k == 0 && self.adds_up() {
            true => lower - known,
            false => lower,
        }
    }

    /// Whether it stands between an input and its joint.
    pub fn is_transmission(&self) -> bool {
        matches!(self.action, Action::Transmission(_))
    }
}

/// What a kind of effect sits on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ActsOn {
    /// A coordinate that is a single number.
    Joint,
    /// The sensor of such a coordinate, which has its name.
    Sensor,
    /// An input.
    Input,
    /// A link of a mechanism that is made of rigid bodies.
    Link,
}

/// Kinds are the same when their names are.
impl PartialEq for Kind {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl std::fmt::Debug for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

/// Families of effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Family {
    /// Against the velocity.
    Friction,
    /// Of the position alone.
    Conservative,
    /// Between the input and the joint.
    Drive,
    /// Of the acceleration.
    Inertia,
    /// Between the position and its reading.
    Sensor,
    /// Of the past of the motion.
    Memory,
}

/// What a kind does.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub enum Action {
    /// Adds a generalized force to one coordinate; its target is a joint.
    Joint(&'static dyn JointForce),
    /// Changes an input before it acts; its target is an input.
    Drive(&'static dyn DriveLaw),
    /// Adds to one coordinate a generalized force with states of its own, or one of the force of its inputs; its target is a joint.
    Memory(&'static dyn MemoryForce),
    /// Stands between an input and its joint, with states of its own; its target is an input.
    Transmission(&'static dyn MemoryForce),
    /// Changes what is read of a position; its target is the sensor of a joint, which goes by the joint's name.
    Sensor(Distortion),
    /// Adds to M, C and G; its target is a joint, or a link.
    Inertial(Inertial),
}

/// No effect takes longer, s: a day.
const LONGEST: f64 = 86_400.0;

/// One parameter of a kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterSpec {
    /// Name in model files.
    pub name: &'static str,
    /// What it measures; gives the unit.
    pub quantity: Quantity,
    /// Physical lower bound.
    pub lower: f64,
    /// Physical upper bound; of a time, up to where fits look for it at the usual [pace](Scales::pace), and no bound of what a model file may say.
    pub upper: f64,
    /// The value at which the effect vanishes, or where a fit starts when it never does.
    pub neutral: f64,
    /// What it is where a model file does not say. `None`: a file has to give it.
    pub default: Option<LeftOut>,
    /// Whether fits leave it alone; of an effect that was found, a diagnosis may ask for it all the same.
    pub held: bool,
    /// Whether it is a yes or a no, 1 or 0; a model file says `true` or `false`.
    pub is_flag: bool,
}

impl ParameterSpec {
    /// A parameter that a model file has to give, and that fits move between `bounds`.
    pub const fn new(
        name: &'static str,
        quantity: Quantity,
        (lower, upper): (f64, f64),
        neutral: f64,
    ) -> Self {
        ParameterSpec {
            name,
            quantity,
            lower,
            upper,
            neutral,
            default: None,
            held: false,
            is_flag: false,
        }
    }

    /// A yes or a no, no where a model file leaves it out; fits leave it alone.
    pub const fn flag(name: &'static str) -> Self {
        ParameterSpec {
            default: Some(LeftOut::Value(0.0)),
            held: true,
            is_flag: true,
            ..ParameterSpec::new(name, Quantity::Ratio, (0.0, 1.0), 0.0)
        }
    }

    /// Whether a value says anything: a part that is not there has none, and what fits leave alone goes without saying where it is what a model file means by
    /// nothing.
    pub fn is_told(&self, value: f64) -> bool {
        value.is_finite() && !(self.held && self.default == Some(LeftOut::Value(value)))
    }

    /// The physical value next to `x`.
    pub fn within(&self, x: f64) -> f64 {
        x.clamp(self.lower, self.largest())
    }

    /// Up to where fits look for it where everything takes `pace` times as long as usual, if that is more than 1.
    pub fn upper_at(&self, pace: f64) -> f64 {
        match self.quantity {
            Quantity::Time => (self.upper * pace.max(1.0)).min(LONGEST),
            _ => self.upper,
        }
    }

    /// The largest value that a model file may say.
    pub fn largest(&self) -> f64 {
        match self.quantity {
            Quantity::Time => LONGEST,
            _ => self.upper,
        }
    }

    /// The same, but fits leave it alone.
    #[must_use]
    pub const fn held(self) -> Self {
        ParameterSpec { held: true, ..self }
    }

    /// The same with a value that a model file means by leaving it out.
    #[must_use]
    pub const fn left_out_as(self, value: LeftOut) -> Self {
        ParameterSpec {
            default: Some(value),
            ..self
        }
    }
}

/// What a model file means by leaving out a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum LeftOut {
    /// This value. An infinite one stands for a part of the effect that is not there, which no fit brings about.
    Value(f64),
    /// So much for each kg or kg·m² of the joint's own entry of M where its mechanism is neutral; of an input, its joint's.
    OfInertia(f64),
}

impl LeftOut {
    /// The value on a joint of this inertia, kg or kg·m².
    pub fn value(self, inertia: f64) -> f64 {
        match self {
            LeftOut::Value(value) => value,
            LeftOut::OfInertia(factor) => factor * inertia,
        }
    }
}

/// What a parameter measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Quantity {
    /// N or N·m.
    Force,
    /// Force per velocity.
    Damping,
    /// Force per velocity squared.
    QuadraticDamping,
    /// Force per displacement.
    Stiffness,
    /// Force per displacement cubed.
    CubicStiffness,
    /// m or rad.
    Displacement,
    /// m/s or rad/s.
    Velocity,
    /// s.
    Time,
    /// kg or kg·m².
    Inertia,
    /// kg·m².
    RotationalInertia,
    /// Of an input as it is logged: no unit is known of it.
    Input,
    /// rad.
    Angle,
    /// No unit.
    Ratio,
}

impl Quantity {
    /// SI unit on a linear or an angular coordinate.
    pub fn unit(self, angular: bool) -> &'static str {
        match (self, angular) {
            (Quantity::Force, false) => "N",
            (Quantity::Force, true) => "N·m",
            (Quantity::Damping, false) => "N·s/m",
            (Quantity::Damping, true) => "N·m·s/rad",
            (Quantity::QuadraticDamping, false) => "N·s²/m²",
            (Quantity::QuadraticDamping, true) => "N·m·s²/rad²",
            (Quantity::Stiffness, false) => "N/m",
            (Quantity::Stiffness, true) => "N·m/rad",
            (Quantity::CubicStiffness, false) => "N/m³",
            (Quantity::CubicStiffness, true) => "N·m/rad³",
            (Quantity::Displacement, false) => "m",
            (Quantity::Displacement, true) => "rad",
            (Quantity::Velocity, false) => "m/s",
            (Quantity::Velocity, true) => "rad/s",
            (Quantity::Inertia, false) => "kg",
            (Quantity::Inertia, true) | (Quantity::RotationalInertia, _) => "kg·m²",
            (Quantity::Time, _) => "s",
            (Quantity::Angle, _) => "rad",
            (Quantity::Ratio | Quantity::Input, _) => "1",
        }
    }
}
