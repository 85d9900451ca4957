//! Effects beside each other, and effects of another size.

use super::{Hidden, Target};
use crate::config::Known;

/// What of the rig an effect is: two effects cannot be the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// What rubs between a joint and its guide at every speed.
    DryFriction(Target),
    ViscousFriction(Target),
    /// What is between motor and cart.
    Transmission,
}

impl Hidden {
    fn place(&self) -> Option<Place> {
        let target = self.target()?;
        match self {
            Hidden::ViscousFriction { .. } | Hidden::AsymmetricViscousFriction { .. } => {
                Some(Place::ViscousFriction(target))
            }
            Hidden::CoulombFriction { .. }
            | Hidden::AsymmetricCoulombFriction { .. }
            | Hidden::StribeckFriction { .. }
            | Hidden::PositionDependentFriction { .. }
            | Hidden::LoadDependentFriction { .. }
            | Hidden::DahlFriction { .. }
            | Hidden::LugreFriction { .. } => Some(Place::DryFriction(target)),
            Hidden::Backlash { .. } | Hidden::ElasticTransmission { .. } => {
                Some(Place::Transmission)
            }
            _ => None,
        }
    }

    /// Whether the rig cannot have both.
    pub fn excludes(&self, other: &Hidden) -> bool {
        let same = self.kind() == other.kind() && self.target() == other.target();
        let place = self.place().is_some() && self.place() == other.place();
        same || place
    }

    /// Whether the sum of both can be told from neither: two forces that are constant while the cart slides one way, two that make
    /// the input late, or two that make the cart heavy.
    pub fn is_twin_of(&self, other: &Hidden) -> bool {
        let offset = |h: &Hidden| {
            matches!(
                h,
                Hidden::ConstantForce { .. }
                    | Hidden::InputOffset { .. }
                    | Hidden::AsymmetricCoulombFriction { .. }
                    | Hidden::GravityTilt { .. }
            )
        };
        let heavy = |h: &Hidden| {
            matches!(
                h,
                Hidden::AddedMass { .. }
                    | Hidden::ReflectedInertia { .. }
                    | Hidden::InputGainError { .. }
            )
        };
        let late = |h: &Hidden| {
            matches!(
                h,
                Hidden::InputDelay { .. }
                    | Hidden::ActuatorLag { .. }
                    | Hidden::ElasticTransmission { .. }
                    | Hidden::Backlash { .. }
                    | Hidden::SensorDelay { .. }
            )
        };
        [
            (offset(self), offset(other)),
            (late(self), late(other)),
            (heavy(self), heavy(other)),
        ]
        .contains(&(true, true))
    }

    /// `coulomb_friction on slider`.
    pub fn in_short(&self) -> String {
        let target = self.target().map_or("", Target::name);
        format!("{} on {target}", self.kind())
    }

    /// The same effect, `factor` times as strong: its distance from the known friction that it replaces, its force, its delay, its gap, its
    /// compliance. Speeds, periods, places of rest and widths of loops stay. None where strength is no such number: a saturation,
    /// bristles, stops.
    pub fn scaled(&self, factor: f64, known: &Known) -> Option<Hidden> {
        let from = |origin: f64, x: f64| origin + factor * (x - origin);
        let coulomb = known.slider_coulomb_friction;
        let mut scaled = *self;
        match &mut scaled {
            Hidden::Nothing => {}
            Hidden::InputSaturation { .. }
            | Hidden::DahlFriction { .. }
            | Hidden::LugreFriction { .. }
            | Hidden::EndStop { .. } => return None,
            // Stiffer than the rig's steps follow.
            Hidden::ElasticTransmission { .. } if factor < 0.1 => return None,
            Hidden::ViscousFriction { coefficient: x, .. }
            | Hidden::LoadDependentFriction { coefficient: x, .. }
            | Hidden::QuadraticDrag { coefficient: x, .. }
            | Hidden::CoulombFriction { force: x, .. }
            | Hidden::ConstantForce { force: x, .. }
            | Hidden::LinearSpring { stiffness: x, .. }
            | Hidden::CubicSpring { stiffness: x, .. }
            | Hidden::InputGainError { gain: x, .. }
            | Hidden::InputDelay { delay: x, .. }
            | Hidden::Backlash { gap: x, .. }
            | Hidden::PositionDependentFriction { slope: x, .. }
            | Hidden::PeriodicForce { amplitude: x, .. }
            | Hidden::InputOffset { offset: x, .. }
            | Hidden::ActuatorLag {
                time_constant: x, ..
            }
            | Hidden::InputDeadZone { width: x, .. }
            | Hidden::SensorOffset { offset: x, .. }
            | Hidden::SensorScale { scale: x, .. }
            | Hidden::SensorDelay { delay: x, .. }
            | Hidden::Hysteresis { stiffness: x, .. }
            | Hidden::AddedMass { mass: x, .. }
            | Hidden::ReflectedInertia { inertia: x, .. }
            | Hidden::GravityTilt { angle: x, .. } => *x *= factor,
            Hidden::AsymmetricCoulombFriction {
                force_positive,
                force_negative,
                ..
            } => {
                *force_positive = from(coulomb, *force_positive);
                *force_negative = from(coulomb, *force_negative);
            }
            Hidden::AsymmetricViscousFriction {
                coefficient_positive: a,
                coefficient_negative: b,
                target,
            } => {
                let mean = match target {
                    Target::Pole => known.pole_viscous_friction,
                    _ => 0.0,
                };
                (*a, *b) = (from(mean, *a), from(mean, *b));
            }
            Hidden::StribeckFriction {
                coulomb_force,
                static_force,
                ..
            } => *static_force = from(*coulomb_force, *static_force),
            Hidden::ElasticTransmission {
                stiffness,
                motor_inertia,
                ..
            } => {
                *stiffness /= factor;
                *motor_inertia *= factor;
            }
        }
        Some(scaled)
    }
}
