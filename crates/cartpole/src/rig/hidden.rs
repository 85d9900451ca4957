//! What the rig hides: one effect, by kind, target and size.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::Error;
use crate::config::{Config, Range};

/// What an effect sits on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Target {
    /// The cart's joint.
    Slider,
    /// The pole's joint.
    Pole,
    /// The input.
    Motor,
}

impl Target {
    /// Its name in models and logs.
    pub fn name(self) -> &'static str {
        match self {
            Target::Slider => "slider",
            Target::Pole => "pole",
            Target::Motor => "motor",
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
            | Hidden::Backlash { target, .. } => Some(target),
        }
    }

    /// Its parameters by name, SI units.
    pub fn parameters(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Hidden::Nothing => vec![],
            Hidden::ViscousFriction { coefficient, .. }
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
        let on_input = matches!(
            self,
            Hidden::InputGainError { .. } | Hidden::InputDelay { .. } | Hidden::Backlash { .. }
        );
        if on_input != (target == Target::Motor) {
            return refuse(if on_input {
                "it acts on an input: the target is `motor`".into()
            } else {
                "it acts on a joint: the target is `slider` or `pole`".into()
            });
        }
        for (name, value) in self.parameters() {
            let either_sign =
                matches!(name, "rest" | "gain") || matches!(self, Hidden::ConstantForce { .. });
            if !value.is_finite() || (value < 0.0 && !either_sign) {
                let domain = if either_sign { "finite" } else { "at least 0" };
                return refuse(format!("{name} is {value}: it must be {domain}"));
            }
        }
        match *self {
            Hidden::StribeckFriction {
                coulomb_force,
                static_force,
                stribeck_velocity,
                ..
            } if static_force < coulomb_force || stribeck_velocity == 0.0 => refuse(format!(
                "static_force {static_force} must not be below coulomb_force {coulomb_force}, and stribeck_velocity \
                 {stribeck_velocity} must be above 0"
            )),
            Hidden::InputDelay { delay, .. } if delay > 10.0 => {
                refuse(format!("delay is {delay} s: give at most 10 s"))
            }
            Hidden::Backlash { restitution, .. } if restitution > 1.0 => refuse(format!(
                "restitution is {restitution}: it must be at most 1"
            )),
            Hidden::Backlash {
                gap, motor_inertia, ..
            } if gap == 0.0 || motor_inertia == 0.0 => refuse(format!(
                "gap {gap} m and motor_inertia {motor_inertia} kg must both be above 0"
            )),
            _ => Ok(()),
        }
    }
}

/// The number of different (kind, target) pairs that are drawn.
pub const CASES: usize = 13;

/// Cases that can be asked for: the drawn ones, then backlash.
pub const CHOICES: usize = 14;

/// Draws an effect: uniform over kinds and targets, sizes uniform in the ranges of the settings, signs by a fair coin. Never
/// nothing.
///
/// ```
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/cartpole/rig.toml");
/// let config = cartpole::config::Config::read(path.as_ref())?;
/// assert_eq!(cartpole::rig::draw(&config, 7), cartpole::rig::draw(&config, 7));
/// # Ok::<(), cartpole::config::ConfigError>(())
/// ```
pub fn draw(config: &Config, seed: u64) -> Hidden {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(super::stream::DRAW);
    let case = rng.random_range(0..CASES);
    draw_case(config, case, &mut rng)
}

/// An effect of the given case, 0 to [`CHOICES`] − 1 (taken modulo), with sizes drawn as in [`draw`].
pub fn draw_of(config: &Config, case: usize, seed: u64) -> Hidden {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(super::stream::DRAW);
    draw_case(config, case % CHOICES, &mut rng)
}

fn draw_case(config: &Config, case: usize, rng: &mut ChaCha8Rng) -> Hidden {
    use Target::{Motor, Pole, Slider};
    let mut size = |[from, to]: Range| rng.random_range(from..=to);
    let ranges = &config.hidden;
    let known = config.known.slider_coulomb_friction;
    let mut effect = match case {
        0 => Hidden::ViscousFriction {
            target: Slider,
            coefficient: size(ranges.viscous_friction.slider),
        },
        1 => Hidden::ViscousFriction {
            target: Pole,
            coefficient: size(ranges.viscous_friction.pole),
        },
        2 => Hidden::CoulombFriction {
            target: Slider,
            force: size(ranges.coulomb_friction.slider),
        },
        3 => Hidden::CoulombFriction {
            target: Pole,
            force: size(ranges.coulomb_friction.pole),
        },
        4 => {
            let difference = size(ranges.asymmetric_coulomb_friction.slider);
            Hidden::AsymmetricCoulombFriction {
                target: Slider,
                force_positive: known + difference,
                force_negative: known - difference,
            }
        }
        5 => Hidden::StribeckFriction {
            target: Slider,
            coulomb_force: known,
            static_force: known + size(ranges.stribeck_friction.slider),
            stribeck_velocity: size(ranges.stribeck_friction.velocity),
        },
        6 => Hidden::QuadraticDrag {
            target: Slider,
            coefficient: size(ranges.quadratic_drag.slider),
        },
        7 => Hidden::QuadraticDrag {
            target: Pole,
            coefficient: size(ranges.quadratic_drag.pole),
        },
        8 => Hidden::LinearSpring {
            target: Slider,
            stiffness: size(ranges.linear_spring.slider),
            rest: size(ranges.linear_spring.rest),
        },
        9 => Hidden::CubicSpring {
            target: Slider,
            stiffness: size(ranges.cubic_spring.slider),
        },
        10 => Hidden::ConstantForce {
            target: Slider,
            force: size(ranges.constant_force.slider),
        },
        11 => Hidden::InputGainError {
            target: Motor,
            gain: size(ranges.input_gain_error.motor),
        },
        12 => Hidden::InputDelay {
            target: Motor,
            delay: size(ranges.input_delay.motor),
        },
        _ => Hidden::Backlash {
            target: Motor,
            gap: size(ranges.backlash.motor),
            restitution: size(ranges.backlash.restitution),
            motor_inertia: size(ranges.backlash.motor_inertia),
        },
    };
    if rng.random_bool(0.5) {
        match &mut effect {
            Hidden::AsymmetricCoulombFriction {
                force_positive,
                force_negative,
                ..
            } => std::mem::swap(force_positive, force_negative),
            Hidden::ConstantForce { force, .. } => *force = -*force,
            Hidden::InputGainError { gain, .. } => *gain = -*gain,
            _ => {}
        }
    }
    effect
}
