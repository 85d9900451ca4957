//! What acts on the rig's joints beside M, C and G: the rig's own formulas, written for simulating the truth and for nothing else.

use std::f64::consts::TAU;

use integrators::event::Direction;

use super::{Error, Hidden, Target};
use crate::config::{Known, Rail};

/// The forces on one joint: smooth ones, and dry friction, which is set-valued at rest.
///
/// F, v, q in N, m/s, m or N·m, rad/s, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointForces {
    /// c₊ in Q = −c₊ v for v > 0, c₋ in Q = −c₋ v for v < 0.
    pub viscous: [f64; 2],
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
    /// A force that repeats along the way.
    pub ripple: Option<Ripple>,
    /// Dry friction.
    pub dry: DryFriction,
}

impl JointForces {
    /// The smooth part of Q at (q, v).
    pub fn smooth(&self, q: f64, v: f64) -> f64 {
        let [forwards, backwards] = self.viscous;
        let viscous = if v > 0.0 { forwards } else { backwards };
        let smooth = self.constant
            - self.spring * (q - self.rest)
            - self.cubic * q.powi(3)
            - (viscous + self.quadratic * v.abs()) * v;
        match self.ripple {
            None => smooth,
            Some(ripple) => {
                smooth + ripple.amplitude * (TAU * q / ripple.period + ripple.phase).sin()
            }
        }
    }
}

/// Q = A sin(2π q/λ + φ), with the potential A λ/2π cos(2π q/λ + φ).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ripple {
    /// A.
    pub amplitude: f64,
    /// λ.
    pub period: f64,
    /// φ, rad.
    pub phase: f64,
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
    /// s: either force is larger by s q; where that makes it negative there is none.
    pub slope: f64,
    /// μ: either force is larger by μ |f|, f the motor's force.
    pub load: f64,
}

impl DryFriction {
    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        let Self {
            against_positive,
            against_negative,
            stribeck,
            slope,
            load,
            ..
        } = *self;
        [against_positive, against_negative, stribeck, slope, load] == [0.0; 5]
    }

    /// The size of Q at the place q under the motor's force f; see [`size`](Self::size).
    pub fn size_at(&self, direction: Direction, speed: f64, q: f64, f: f64) -> f64 {
        let size = self.size(direction, speed);
        if self.slope == 0.0 && self.load == 0.0 {
            return size;
        }
        (size + self.slope * q).max(0.0) + self.load * f.abs()
    }

    /// The size of Q on a body that slides in the given direction with the speed |v|, in the middle of its way and without load; at
    /// speed 0, what rest holds.
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

/// Bristles between cart and rail, which bend before they slip: Q = −(σ₀ z + σ₁ ż), ż = v − σ₀ z |v|/g(v), g the size of the friction
/// when they slip steadily. With σ₁ = 0 and g constant it is Dahl's friction, else that of Canudas de Wit et al. (LuGre).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bristles {
    /// σ₀, N/m.
    pub stiffness: f64,
    /// σ₁, N·s/m.
    pub damping: f64,
    /// g, the same in both directions; above 0.
    pub slip: DryFriction,
}

impl Bristles {
    /// ż and Q at the deflection z.
    pub fn bend(&self, z: f64, v: f64) -> (f64, f64) {
        let slip = self.slip.size(Direction::Positive, v.abs());
        let rate = v - self.stiffness * z * v.abs() / slip;
        (rate, -(self.stiffness * z + self.damping * rate))
    }
}

/// A spring between the cart and a block on the rail that holds up to k w and slides under that: Q = −k e with the stretch e = x − y
/// within ± w, y the place of the block, which has no mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlippingSpring {
    /// k, N/m.
    pub stiffness: f64,
    /// w, m.
    pub width: f64,
}

impl SlippingSpring {
    /// Q with the cart at x that has come from where the block was at y, without turning around while the block slid.
    pub fn force(&self, x: f64, y: f64) -> f64 {
        -self.stiffness * (x - y).clamp(-self.width, self.width)
    }

    /// Where the block is then.
    pub fn drag(&self, x: f64, y: f64) -> f64 {
        y.clamp(x - self.width, x + self.width)
    }
}

/// The way of the input to the motor: what is asked for at t − delay, times 1 + gain, without its dead zone, clipped, offset, and
/// then late by a lag.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drive {
    /// Relative error of the gain.
    pub gain: f64,
    /// Delay, s, at least 0.
    pub delay: f64,
    /// Half width of the dead zone, N.
    pub dead_zone: f64,
    /// Largest force, N.
    pub limit: Option<f64>,
    /// N.
    pub offset: f64,
    /// T in T ḟ = (what arrives) − f, s; f = 0 at the start.
    pub lag: Option<f64>,
}

impl Drive {
    /// The force that arrives, N, but for delay and lag, where u is asked for.
    pub fn force(&self, u: f64) -> f64 {
        let mut force = (1.0 + self.gain) * u;
        if self.dead_zone > 0.0 {
            force -= force.clamp(-self.dead_zone, self.dead_zone);
        }
        if let Some(limit) = self.limit {
            force = force.clamp(-limit, limit);
        }
        if self.offset == 0.0 {
            force
        } else {
            force + self.offset
        }
    }
}

/// An elastic string between the motor and the cart: J z̈ = f − k (z − x) − c (ż − ẋ), and the same k (z − x) + c (ż − ẋ) on the cart.
/// J is not a part of the mass that slides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElasticString {
    /// k, N/m.
    pub stiffness: f64,
    /// c, N·s/m.
    pub damping: f64,
    /// J, kg.
    pub motor_inertia: f64,
}

/// What is wrong with the two position sensors, beside noise: at t they read (1 + scale) q(t − delay) + offset.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SensorFaults {
    /// m, rad.
    pub offset: [f64; 2],
    /// Share of the reading.
    pub scale: [f64; 2],
    /// s, at least 0.
    pub delay: [f64; 2],
}

impl SensorFaults {
    /// The readings, without noise, where q(t − delay) is given.
    pub fn read(&self, q: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| (1.0 + self.scale[i]) * q[i] + self.offset[i])
    }
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
    /// Between the motor, on which the input then acts, and the cart.
    pub string: Option<ElasticString>,
    /// Between cart and rail.
    pub bristles: Option<Bristles>,
    /// Between cart and rail.
    pub slipping_spring: Option<SlippingSpring>,
    /// Of the position sensors.
    pub sensors: SensorFaults,
    /// The ends of the rail, where it has some.
    pub rail: Option<Rail>,
}

impl Effects {
    /// The known friction and the hidden effect. A hidden friction takes the place of the known one of its kind and joint;
    /// asymmetric viscous friction takes the place of the viscous one of its joint; asymmetric, Stribeck, position-dependent, Dahl's
    /// and LuGre friction take the place of the Coulomb friction of theirs. All others come beside it.
    pub fn of(known: &Known, hidden: &Hidden) -> Result<Self, Error> {
        hidden.check()?;
        let mut effects = Effects::default();
        let symmetric = |force| DryFriction {
            against_positive: force,
            against_negative: force,
            ..DryFriction::default()
        };
        effects.joints[0].dry = symmetric(known.slider_coulomb_friction);
        effects.joints[1].viscous = [known.pole_viscous_friction; 2];
        let Effects {
            joints,
            drive,
            backlash,
            string,
            bristles,
            slipping_spring,
            sensors,
            ..
        } = &mut effects;
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
        }
        Ok(effects)
    }
}
