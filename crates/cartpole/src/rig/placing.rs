//! Where the hidden effects act on the rig.

use super::effects::{
    Backlash, Bristles, DryFriction, Effects, ElasticString, Ripple, SlippingSpring,
};
use super::{Error, Hidden, Target};
use crate::config::{Known, Rail};

/// The centre of mass of the pole with its tip, m from the pivot: (60 g · 100.5 mm + 12 g · 201 mm)/72 g (Table 2 of the paper).
const POLE_CENTRE: f64 = 0.117_25;

impl Effects {
    /// The known friction and the hidden effect; see [`add`](Self::add).
    pub fn of(known: &Known, hidden: &Hidden) -> Result<Self, Error> {
        let mut effects = Self::known(known);
        effects.add(hidden)?;
        Ok(effects)
    }

    /// The known friction alone.
    pub fn known(known: &Known) -> Self {
        let mut effects = Effects::default();
        effects.joints[0].dry = symmetric(known.slider_coulomb_friction);
        effects.joints[1].viscous = [known.pole_viscous_friction; 2];
        effects
    }

    /// Adds an effect. A hidden friction takes the place of the known one of its kind and joint;
    /// asymmetric viscous friction takes the place of the viscous one of its joint; asymmetric, Stribeck, position-dependent, Dahl's
    /// and LuGre friction take the place of the Coulomb friction of theirs. All others come beside it.
    pub fn add(&mut self, hidden: &Hidden) -> Result<(), Error> {
        hidden.check()?;
        let Effects {
            joints,
            drive,
            backlash,
            string,
            bristles,
            slipping_spring,
            sensors,
            mechanics,
            rail,
        } = self;
        let [slider, pole] = joints;
        let sensor = usize::from(hidden.target() == Some(Target::Pole));
        let joint = if hidden.target() == Some(Target::Pole) {
            pole
        } else {
            slider
        };
        match *hidden {
            Hidden::Nothing => {}
            Hidden::ViscousFriction { coefficient, .. } => joint.viscous = [coefficient; 2],
            Hidden::CoulombFriction { force, .. } => joint.dry = symmetric(force),
            Hidden::AsymmetricCoulombFriction {
                force_positive,
                force_negative,
                ..
            } => {
                joint.dry = DryFriction {
                    against_positive: force_positive,
                    against_negative: force_negative,
                    ..DryFriction::default()
                };
            }
            Hidden::StribeckFriction {
                coulomb_force,
                static_force,
                stribeck_velocity,
                ..
            } => {
                joint.dry = DryFriction {
                    stribeck: static_force - coulomb_force,
                    stribeck_velocity,
                    ..symmetric(coulomb_force)
                };
            }
            Hidden::QuadraticDrag { coefficient, .. } => joint.quadratic = coefficient,
            Hidden::LinearSpring {
                stiffness, rest, ..
            } => {
                joint.spring = stiffness;
                joint.rest = rest;
            }
            Hidden::CubicSpring { stiffness, .. } => joint.cubic = stiffness,
            Hidden::ConstantForce { force, .. } => joint.constant = force,
            Hidden::InputGainError { gain, .. } => drive.gain = gain,
            Hidden::InputDelay { delay, .. } => drive.delay = delay,
            Hidden::Backlash {
                gap,
                restitution,
                motor_inertia,
                ..
            } => {
                *backlash = Some(Backlash {
                    gap,
                    restitution,
                    motor_inertia,
                });
            }
            Hidden::AsymmetricViscousFriction {
                coefficient_positive,
                coefficient_negative,
                ..
            } => joint.viscous = [coefficient_positive, coefficient_negative],
            Hidden::PositionDependentFriction { force, slope, .. } => {
                joint.dry = DryFriction {
                    slope,
                    ..symmetric(force)
                };
            }
            Hidden::LoadDependentFriction { coefficient, .. } => joint.dry.load = coefficient,
            Hidden::PeriodicForce {
                amplitude,
                period,
                phase,
                ..
            } => {
                joint.ripple = Some(Ripple {
                    amplitude,
                    period,
                    phase,
                    second: 0.0,
                });
            }
            Hidden::InputOffset { offset, .. } => drive.offset = offset,
            Hidden::ActuatorLag { time_constant, .. } => drive.lag = Some(time_constant),
            Hidden::InputDeadZone { width, .. } => drive.dead_zone = width,
            Hidden::InputSaturation { limit, .. } => drive.limit = Some(limit),
            Hidden::ElasticTransmission {
                stiffness,
                damping,
                motor_inertia,
                ..
            } => {
                *string = Some(ElasticString {
                    stiffness,
                    damping,
                    motor_inertia,
                    hardening: 0.0,
                    free_play: 0.0,
                });
            }
            Hidden::SensorOffset { offset, .. } => sensors.offset[sensor] = offset,
            Hidden::SensorScale { scale, .. } => sensors.scale[sensor] = scale,
            Hidden::SensorDelay { delay, .. } => sensors.delay[sensor] = delay,
            Hidden::DahlFriction {
                stiffness,
                coulomb_force,
                ..
            } => {
                joint.dry = DryFriction::default();
                *bristles = Some(Bristles {
                    stiffness,
                    damping: 0.0,
                    slip: symmetric(coulomb_force),
                });
            }
            Hidden::LugreFriction {
                stiffness,
                damping,
                coulomb_force,
                static_force,
                stribeck_velocity,
                ..
            } => {
                joint.dry = DryFriction::default();
                *bristles = Some(Bristles {
                    stiffness,
                    damping,
                    slip: DryFriction {
                        stribeck: static_force - coulomb_force,
                        stribeck_velocity,
                        ..symmetric(coulomb_force)
                    },
                });
            }
            Hidden::Hysteresis {
                stiffness, width, ..
            } => *slipping_spring = Some(SlippingSpring { stiffness, width }),
            Hidden::AddedMass {
                target: Target::Pole,
                mass,
            } => (mechanics.on_pole, mechanics.arm) = (mass, POLE_CENTRE),
            Hidden::AddedMass { mass, .. } => mechanics.on_cart = mass,
            Hidden::ReflectedInertia { inertia, .. } => mechanics.inertia[sensor] = inertia,
            Hidden::GravityTilt { angle, .. } => mechanics.tilt = angle,
            Hidden::EndStop {
                upper, restitution, ..
            } => {
                *rail = Some(Rail {
                    limit: upper,
                    restitution,
                });
            }
        }
        Ok(())
    }
}

/// Coulomb friction of one size both ways.
fn symmetric(force: f64) -> DryFriction {
    DryFriction {
        against_positive: force,
        against_negative: force,
        ..DryFriction::default()
    }
}
