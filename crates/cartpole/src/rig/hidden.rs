//! What the rig hides: one effect, by kind, target and size.

use serde::{Deserialize, Serialize};

use super::Error;

/// What an effect sits on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Target {
    /// The cart's joint, or its sensor.
    Slider,
    /// The pole's joint, or its sensor, or the pole itself.
    Pole,
    /// The input.
    Motor,
    /// The cart itself.
    Cart,
}

impl Target {
    /// Its name in models and logs.
    pub fn name(self) -> &'static str {
        match self {
            Target::Slider => "slider",
            Target::Pole => "pole",
            Target::Motor => "motor",
            Target::Cart => "cart",
        }
    }
}

/// An effect of the rig that the user's model lacks. Q is the generalized force on the target's joint, v its velocity, in
/// N, m/s or N·m, rad/s; names are those of the model files.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Hidden {
    /// Nothing: the user's model is complete.
    Nothing,
    /// Q = −c v.
    ViscousFriction {
        /// Joint.
        target: Target,
        /// c, N·s/m or N·m·s/rad.
        coefficient: f64,
    },
    /// Q = −F sgn v while it moves; holds it at rest up to F.
    CoulombFriction {
        /// Joint.
        target: Target,
        /// F, N or N·m.
        force: f64,
    },
    /// Coulomb friction with F₊ against v > 0 and F₋ against v < 0.
    AsymmetricCoulombFriction {
        /// Joint.
        target: Target,
        /// F₊, N or N·m.
        force_positive: f64,
        /// F₋, N or N·m.
        force_negative: f64,
    },
    /// Q = −[F_c + (F_s − F_c) exp(−(v/v_s)²)] sgn v; holds at rest up to F_s.
    StribeckFriction {
        /// Joint.
        target: Target,
        /// F_c, N or N·m.
        coulomb_force: f64,
        /// F_s, N or N·m.
        static_force: f64,
        /// v_s, m/s or rad/s.
        stribeck_velocity: f64,
    },
    /// Q = −d |v| v.
    QuadraticDrag {
        /// Joint.
        target: Target,
        /// d, N·s²/m² or N·m·s²/rad².
        coefficient: f64,
    },
    /// Q = −k (q − q₀).
    LinearSpring {
        /// Joint.
        target: Target,
        /// k, N/m or N·m/rad.
        stiffness: f64,
        /// q₀, m or rad.
        rest: f64,
    },
    /// Q = −k q³.
    CubicSpring {
        /// Joint.
        target: Target,
        /// k, N/m³ or N·m/rad³.
        stiffness: f64,
    },
    /// Q = F.
    ConstantForce {
        /// Joint.
        target: Target,
        /// F, N or N·m.
        force: f64,
    },
    /// (1 + g) u arrives instead of u.
    InputGainError {
        /// Input.
        target: Target,
        /// g.
        gain: f64,
    },
    /// u(t − T) arrives instead of u(t).
    InputDelay {
        /// Input.
        target: Target,
        /// T, s.
        delay: f64,
    },
    /// The input drives the motor, the motor the cart through flanks with a gap between them.
    Backlash {
        /// Input.
        target: Target,
        /// Way of the motor from one flank to the other, m.
        gap: f64,
        /// e of the blows.
        restitution: f64,
        /// The motor's part of the mass that slides, kg.
        motor_inertia: f64,
    },
    /// Q = −c₊ v for v > 0, −c₋ v for v < 0.
    AsymmetricViscousFriction {
        /// Joint.
        target: Target,
        /// c₊, N·s/m or N·m·s/rad.
        coefficient_positive: f64,
        /// c₋, N·s/m or N·m·s/rad.
        coefficient_negative: f64,
    },
    /// Coulomb friction of the size F₀ + s q, none where that is below 0.
    PositionDependentFriction {
        /// Joint.
        target: Target,
        /// F₀, N or N·m.
        force: f64,
        /// s, N/m or N·m/rad.
        slope: f64,
    },
    /// Q = −μ |f| sgn v beside the known friction, f the motor's force; holds at rest up to μ |f| more.
    LoadDependentFriction {
        /// The cart's joint.
        target: Target,
        /// μ.
        coefficient: f64,
    },
    /// Q = A sin(2π q/λ + φ).
    PeriodicForce {
        /// Joint.
        target: Target,
        /// A, N or N·m.
        amplitude: f64,
        /// λ, m or rad.
        period: f64,
        /// φ, rad.
        phase: f64,
    },
    /// u + b arrives instead of u.
    InputOffset {
        /// Input.
        target: Target,
        /// b, N.
        offset: f64,
    },
    /// f arrives instead of u, with T ḟ = u − f and f = 0 at the start.
    ActuatorLag {
        /// Input.
        target: Target,
        /// T, s.
        time_constant: f64,
    },
    /// Nothing arrives while |u| ≤ w, u − w sgn u beyond.
    InputDeadZone {
        /// Input.
        target: Target,
        /// w, half of the zone, N.
        width: f64,
    },
    /// u clipped to ± L arrives.
    InputSaturation {
        /// Input.
        target: Target,
        /// L, N.
        limit: f64,
    },
    /// The input drives the motor, J z̈ = u − k (z − x) − c (ż − ẋ); the string pulls the cart.
    ElasticTransmission {
        /// Input.
        target: Target,
        /// k, N/m.
        stiffness: f64,
        /// c, N·s/m.
        damping: f64,
        /// J, kg, beside the mass that slides.
        motor_inertia: f64,
    },
    /// The sensor reads q + b.
    SensorOffset {
        /// The sensor's joint.
        target: Target,
        /// b, m or rad.
        offset: f64,
    },
    /// The sensor reads (1 + s) q.
    SensorScale {
        /// The sensor's joint.
        target: Target,
        /// s.
        scale: f64,
    },
    /// At t the sensor reads q(t − T).
    SensorDelay {
        /// The sensor's joint.
        target: Target,
        /// T, s.
        delay: f64,
    },
    /// Q = −σ z, ż = v − σ z |v|/F.
    DahlFriction {
        /// The cart's joint.
        target: Target,
        /// σ, N/m.
        stiffness: f64,
        /// F, N.
        coulomb_force: f64,
    },
    /// Q = −(σ₀ z + σ₁ ż), ż = v − σ₀ z |v|/g, g = F_c + (F_s − F_c) exp(−(v/v_s)²).
    LugreFriction {
        /// The cart's joint.
        target: Target,
        /// σ₀, N/m.
        stiffness: f64,
        /// σ₁, N·s/m.
        damping: f64,
        /// F_c, N.
        coulomb_force: f64,
        /// F_s, N.
        static_force: f64,
        /// v_s, m/s.
        stribeck_velocity: f64,
    },
    /// A spring with its other end on a slider with dry friction: Q = −k e, |e| ≤ w, ė = v but where it slips.
    Hysteresis {
        /// The cart's joint.
        target: Target,
        /// k, N/m.
        stiffness: f64,
        /// w, half width of the loop, m.
        width: f64,
    },
    /// A point mass that nobody weighed, at the centre of mass of the cart or of the pole with its tip.
    AddedMass {
        /// The body: cart or pole.
        target: Target,
        /// kg.
        mass: f64,
    },
    /// I v̇ on the left-hand side: something that turns with the joint and goes nowhere.
    ReflectedInertia {
        /// Joint.
        target: Target,
        /// I, kg or kg·m².
        inertia: f64,
    },
    /// The rail is not level: its positive end is higher.
    GravityTilt {
        /// The cart's joint.
        target: Target,
        /// Slope of the rail, rad.
        angle: f64,
    },
    /// Hard stops nearer than the ends of the rail.
    EndStop {
        /// The cart's joint.
        target: Target,
        /// Where the way ends towards −x, m; minus `upper`.
        lower: f64,
        /// Where it ends towards +x, m.
        upper: f64,
        /// Speed after a blow over the speed before.
        restitution: f64,
    },
}

impl Hidden {
    /// Its kind, as in a model file; `nothing` for nothing.
    pub fn kind(&self) -> &'static str {
        match self {
            Hidden::Nothing => "nothing",
            Hidden::ViscousFriction { .. } => "viscous_friction",
            Hidden::CoulombFriction { .. } => "coulomb_friction",
            Hidden::AsymmetricCoulombFriction { .. } => "asymmetric_coulomb_friction",
            Hidden::StribeckFriction { .. } => "stribeck_friction",
            Hidden::QuadraticDrag { .. } => "quadratic_drag",
            Hidden::LinearSpring { .. } => "linear_spring",
            Hidden::CubicSpring { .. } => "cubic_spring",
            Hidden::ConstantForce { .. } => "constant_force",
            Hidden::InputGainError { .. } => "input_gain_error",
            Hidden::InputDelay { .. } => "input_delay",
            Hidden::Backlash { .. } => "backlash",
            Hidden::AsymmetricViscousFriction { .. } => "asymmetric_viscous_friction",
            Hidden::PositionDependentFriction { .. } => "position_dependent_friction",
            Hidden::LoadDependentFriction { .. } => "load_dependent_friction",
            Hidden::PeriodicForce { .. } => "periodic_force",
            Hidden::InputOffset { .. } => "input_offset",
            Hidden::ActuatorLag { .. } => "actuator_lag",
            Hidden::InputDeadZone { .. } => "input_dead_zone",
            Hidden::InputSaturation { .. } => "input_saturation",
            Hidden::ElasticTransmission { .. } => "elastic_transmission",
            Hidden::SensorOffset { .. } => "sensor_offset",
            Hidden::SensorScale { .. } => "sensor_scale",
            Hidden::SensorDelay { .. } => "sensor_delay",
            Hidden::DahlFriction { .. } => "dahl_friction",
            Hidden::LugreFriction { .. } => "lugre_friction",
            Hidden::Hysteresis { .. } => "hysteresis",
            Hidden::AddedMass { .. } => "added_mass",
            Hidden::ReflectedInertia { .. } => "reflected_inertia",
            Hidden::GravityTilt { .. } => "gravity_tilt",
            Hidden::EndStop { .. } => "end_stop",
        }
    }

    /// What it sits on; nothing has no target.
    pub fn target(&self) -> Option<Target> {
        match *self {
            Hidden::Nothing => None,
            Hidden::ViscousFriction { target, .. }
            | Hidden::CoulombFriction { target, .. }
            | Hidden::AsymmetricCoulombFriction { target, .. }
            | Hidden::StribeckFriction { target, .. }
            | Hidden::QuadraticDrag { target, .. }
            | Hidden::LinearSpring { target, .. }
            | Hidden::CubicSpring { target, .. }
            | Hidden::ConstantForce { target, .. }
            | Hidden::InputGainError { target, .. }
            | Hidden::InputDelay { target, .. }
            | Hidden::Backlash { target, .. }
            | Hidden::AsymmetricViscousFriction { target, .. }
            | Hidden::PositionDependentFriction { target, .. }
            | Hidden::LoadDependentFriction { target, .. }
            | Hidden::PeriodicForce { target, .. }
            | Hidden::InputOffset { target, .. }
            | Hidden::ActuatorLag { target, .. }
            | Hidden::InputDeadZone { target, .. }
            | Hidden::InputSaturation { target, .. }
            | Hidden::ElasticTransmission { target, .. }
            | Hidden::SensorOffset { target, .. }
            | Hidden::SensorScale { target, .. }
            | Hidden::SensorDelay { target, .. }
            | Hidden::DahlFriction { target, .. }
            | Hidden::LugreFriction { target, .. }
            | Hidden::Hysteresis { target, .. }
            | Hidden::AddedMass { target, .. }
            | Hidden::ReflectedInertia { target, .. }
            | Hidden::GravityTilt { target, .. }
            | Hidden::EndStop { target, .. } => Some(target),
        }
    }

    /// Its parameters by name, SI units.
    pub fn parameters(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Hidden::Nothing => vec![],
            Hidden::ViscousFriction { coefficient, .. }
            | Hidden::LoadDependentFriction { coefficient, .. }
            | Hidden::QuadraticDrag { coefficient, .. } => vec![("coefficient", coefficient)],
            Hidden::CoulombFriction { force, .. } | Hidden::ConstantForce { force, .. } => {
                vec![("force", force)]
            }
            Hidden::AsymmetricCoulombFriction {
                force_positive,
                force_negative,
                ..
            } => vec![
                ("force_positive", force_positive),
                ("force_negative", force_negative),
            ],
            Hidden::StribeckFriction {
                coulomb_force,
                static_force,
                stribeck_velocity,
                ..
            } => vec![
                ("coulomb_force", coulomb_force),
                ("static_force", static_force),
                ("stribeck_velocity", stribeck_velocity),
            ],
            Hidden::LinearSpring {
                stiffness, rest, ..
            } => vec![("stiffness", stiffness), ("rest", rest)],
            Hidden::CubicSpring { stiffness, .. } => vec![("stiffness", stiffness)],
            Hidden::InputGainError { gain, .. } => vec![("gain", gain)],
            Hidden::InputDelay { delay, .. } => vec![("delay", delay)],
            Hidden::Backlash {
                gap,
                restitution,
                motor_inertia,
                ..
            } => vec![
                ("gap", gap),
                ("restitution", restitution),
                ("motor_inertia", motor_inertia),
            ],
            Hidden::AsymmetricViscousFriction {
                coefficient_positive,
                coefficient_negative,
                ..
            } => vec![
                ("coefficient_positive", coefficient_positive),
                ("coefficient_negative", coefficient_negative),
            ],
            Hidden::PositionDependentFriction { force, slope, .. } => {
                vec![("force", force), ("slope", slope)]
            }
            Hidden::PeriodicForce {
                amplitude,
                period,
                phase,
                ..
            } => vec![
                ("amplitude", amplitude),
                ("period", period),
                ("phase", phase),
            ],
            Hidden::InputOffset { offset, .. } | Hidden::SensorOffset { offset, .. } => {
                vec![("offset", offset)]
            }
            Hidden::ActuatorLag { time_constant, .. } => vec![("time_constant", time_constant)],
            Hidden::InputDeadZone { width, .. } => vec![("width", width)],
            Hidden::InputSaturation { limit, .. } => vec![("limit", limit)],
            Hidden::ElasticTransmission {
                stiffness,
                damping,
                motor_inertia,
                ..
            } => vec![
                ("stiffness", stiffness),
                ("damping", damping),
                ("motor_inertia", motor_inertia),
            ],
            Hidden::SensorScale { scale, .. } => vec![("scale", scale)],
            Hidden::SensorDelay { delay, .. } => vec![("delay", delay)],
            Hidden::DahlFriction {
                stiffness,
                coulomb_force,
                ..
            } => vec![("stiffness", stiffness), ("coulomb_force", coulomb_force)],
            Hidden::LugreFriction {
                stiffness,
                damping,
                coulomb_force,
                static_force,
                stribeck_velocity,
                ..
            } => vec![
                ("stiffness", stiffness),
                ("damping", damping),
                ("coulomb_force", coulomb_force),
                ("static_force", static_force),
                ("stribeck_velocity", stribeck_velocity),
            ],
            Hidden::Hysteresis {
                stiffness, width, ..
            } => vec![("stiffness", stiffness), ("width", width)],
            Hidden::AddedMass { mass, .. } => vec![("mass", mass)],
            Hidden::ReflectedInertia { inertia, .. } => vec![("inertia", inertia)],
            Hidden::GravityTilt { angle, .. } => vec![("angle", angle)],
            Hidden::EndStop {
                lower,
                upper,
                restitution,
                ..
            } => vec![
                ("lower", lower),
                ("upper", upper),
                ("restitution", restitution),
            ],
        }
    }

    /// Refuses what no rig can have: a target of the wrong sort, numbers that are not finite, friction that pushes.
    pub fn check(&self) -> Result<(), Error> {
        let Some(target) = self.target() else {
            return Ok(());
        };
        let refuse = |reason: String| {
            Err(Error::Effect {
                kind: self.kind(),
                target: target.name(),
                reason,
            })
        };
        use Target::{Cart, Motor, Pole, Slider};
        let (place, allowed): (&str, &[Target]) = match self {
            Hidden::InputGainError { .. }
            | Hidden::InputDelay { .. }
            | Hidden::Backlash { .. }
            | Hidden::InputOffset { .. }
            | Hidden::ActuatorLag { .. }
            | Hidden::InputDeadZone { .. }
            | Hidden::InputSaturation { .. }
            | Hidden::ElasticTransmission { .. } => {
                ("acts on an input: the target is `motor`", &[Motor])
            }
            Hidden::LoadDependentFriction { .. }
            | Hidden::DahlFriction { .. }
            | Hidden::LugreFriction { .. }
            | Hidden::Hysteresis { .. }
            | Hidden::GravityTilt { .. }
            | Hidden::EndStop { .. } => ("acts on the cart: the target is `slider`", &[Slider]),
            Hidden::AddedMass { .. } => (
                "sits on a body: the target is `cart` or `pole`",
                &[Cart, Pole],
            ),
            Hidden::SensorScale { .. } => (
                "is of a sensor with an end: the target is `slider`",
                &[Slider],
            ),
            _ => (
                "acts on a joint: the target is `slider` or `pole`",
                &[Slider, Pole],
            ),
        };
        if !allowed.contains(&target) {
            return refuse(format!("it {place}"));
        }
        for (name, value) in self.parameters() {
            let either_sign = matches!(
                name,
                "rest" | "gain" | "offset" | "phase" | "slope" | "scale" | "angle" | "lower"
            ) || matches!(self, Hidden::ConstantForce { .. });
            if !value.is_finite() || (value < 0.0 && !either_sign) {
                let domain = if either_sign { "finite" } else { "at least 0" };
                return refuse(format!("{name} is {value}: it must be {domain}"));
            }
            let divides = matches!(
                (self, name),
                (Hidden::PeriodicForce { .. }, "period")
                    | (Hidden::ActuatorLag { .. }, "time_constant")
                    | (Hidden::ElasticTransmission { .. }, "motor_inertia")
                    | (Hidden::DahlFriction { .. }, "coulomb_force")
                    | (Hidden::LugreFriction { .. }, "coulomb_force")
            );
            if value == 0.0 && divides {
                return refuse(format!("{name} is 0: it must be above 0"));
            }
        }
        match *self {
            Hidden::StribeckFriction {
                coulomb_force,
                static_force,
                stribeck_velocity,
                ..
            }
            | Hidden::LugreFriction {
                coulomb_force,
                static_force,
                stribeck_velocity,
                ..
            } if static_force < coulomb_force || stribeck_velocity == 0.0 => refuse(format!(
                "static_force {static_force} must not be below coulomb_force {coulomb_force}, and stribeck_velocity \
                 {stribeck_velocity} must be above 0"
            )),
            Hidden::InputDelay { delay, .. } | Hidden::SensorDelay { delay, .. }
                if delay > 10.0 =>
            {
                refuse(format!("delay is {delay} s: give at most 10 s"))
            }
            Hidden::GravityTilt { angle, .. } if angle.abs() > 0.5 => {
                refuse(format!("angle is {angle} rad: give one between ± 0.5 rad"))
            }
            Hidden::EndStop { lower, upper, .. } if upper == 0.0 || lower != -upper => {
                refuse(format!(
                    "lower is {lower} m and upper {upper} m: give an upper above 0 and its negative for lower"
                ))
            }
            Hidden::Backlash { restitution, .. } | Hidden::EndStop { restitution, .. }
                if restitution > 1.0 =>
            {
                refuse(format!(
                    "restitution is {restitution}: it must be at most 1"
                ))
            }
            Hidden::Backlash {
                gap, motor_inertia, ..
            } if gap == 0.0 || motor_inertia == 0.0 => refuse(format!(
                "gap {gap} m and motor_inertia {motor_inertia} kg must both be above 0"
            )),
            _ => Ok(()),
        }
    }
}
