//! What acts on the rig's joints beside M, C and G: the rig's own formulas, written for simulating the truth and for nothing else.

use integrators::event::Direction;

use super::{Error, Hidden, Target};
use crate::config::{Known, Rail};

/// The forces on one joint: smooth ones, and dry friction, which is set-valued at rest.
///
/// F, v, q in N, m/s, m or N·m, rad/s, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointForces {
    /// c in Q = −c v.
    pub viscous: f64,
    /// d in Q = −d |v| v.
    pub quadratic: f64,
    /// k in Q = −k (q − rest).
    pub spring: f64,
    /// Where the spring pulls to.
    pub rest: f64,
    /// k₃ in Q = −k₃ q³.
    pub cubic: f64,
    /// F in Q = F.
    pub constant: f64,
    /// Dry friction.
    pub dry: DryFriction,
}

impl JointForces {
    /// The smooth part of Q at (q, v).
    pub fn smooth(&self, q: f64, v: f64) -> f64 {
        self.constant
            - self.spring * (q - self.rest)
            - self.cubic * q.powi(3)
            - (self.viscous + self.quadratic * v.abs()) * v
    }
}

/// Dry friction: opposes motion with a force of its own size for each direction, raised at low speed; at rest it takes any value
/// between the two breakaway forces.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DryFriction {
    /// Size of the force against v > 0.
    pub against_positive: f64,
    /// Size of the force against v < 0.
    pub against_negative: f64,
    /// What rest adds to either: F_s − F_c.
    pub stribeck: f64,
    /// v_s in exp(−(v/v_s)²); taken for ∞ where there is no Stribeck force.
    pub stribeck_velocity: f64,
}

impl DryFriction {
    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        self.against_positive == 0.0 && self.against_negative == 0.0 && self.stribeck == 0.0
    }

    /// The size of Q on a body that slides in the given direction with the speed |v|; at speed 0, what rest holds.
    pub fn size(&self, direction: Direction, speed: f64) -> f64 {
        let hump = if self.stribeck == 0.0 {
            0.0
        } else {
            self.stribeck * (-(speed / self.stribeck_velocity).powi(2)).exp()
        };
        match direction {
            Direction::Positive => self.against_positive + hump,
            Direction::Negative => self.against_negative + hump,
        }
    }
}

/// The way of the input to the cart: F(t) = (1 + gain) u(t − delay).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drive {
    /// Relative error of the gain.
    pub gain: f64,
    /// Delay, s, at least 0.
    pub delay: f64,
}

/// A gap between the motor and the cart: |z − x| ≤ gap/2 for the motor's place z and the cart's x, m. The motor's inertia is a part
/// of the mass that slides in the model, so that with a gap of 0 the rig is that of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Backlash {
    /// m.
    pub gap: f64,
    /// e of the blows on the flanks.
    pub restitution: f64,
    /// kg.
    pub motor_inertia: f64,
}

/// Everything that acts on the rig.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Effects {
    /// On `slider` and `pole`.
    pub joints: [JointForces; 2],
    /// From the logged input to the cart.
    pub drive: Drive,
    /// Between the motor, on which the input then acts, and the cart.
    pub backlash: Option<Backlash>,
    /// The ends of the rail, where it has some.
    pub rail: Option<Rail>,
}

impl Effects {
    /// The known friction and the hidden effect. A hidden friction takes the place of the known one of its kind and joint;
    /// asymmetric and Stribeck friction take the place of the Coulomb friction of their joint.
    pub fn of(known: &Known, hidden: &Hidden) -> Result<Self, Error> {
        hidden.check()?;
        let mut effects = Effects::default();
        let symmetric = |force| DryFriction {
            against_positive: force,
            against_negative: force,
            ..DryFriction::default()
        };
        effects.joints[0].dry = symmetric(known.slider_coulomb_friction);
        effects.joints[1].viscous = known.pole_viscous_friction;
        let Effects {
            joints,
            drive,
            backlash,
            ..
        } = &mut effects;
        let [slider, pole] = joints;
        let joint = if hidden.target() == Some(Target::Pole) {
            pole
        } else {
            slider
        };
        match *hidden {
            Hidden::Nothing => {}
            Hidden::ViscousFriction { coefficient, .. } => joint.viscous = coefficient,
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
        }
        Ok(effects)
    }
}
