//! Which effect the rig hides, and of what size, when nobody says it.

use std::f64::consts::{PI, TAU};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Hidden, Target};
use crate::config::{Config, Range};

/// The number of different (kind, target) pairs that are drawn.
pub const CASES: usize = 13;

/// The number of pairs that [`draw_any`] draws from: those of [`draw`] come first.
pub const CASES_ALL: usize = 31;

/// Cases that can be asked for: those of [`draw_any`], then the one that no log of this rig can show, then those that change the
/// mechanics, and stops.
pub const CHOICES: usize = 38;

/// The case among them that no log of this rig can show: where the cart's sensor has its zero.
pub const UNSEEN: usize = 31;

/// Draws an effect of the first [`CASES`]: uniform over kinds and targets, sizes uniform in the ranges of the settings, signs by a fair coin. Never
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

/// [`draw`] among all effects that a log can show, the first [`CASES_ALL`].
pub fn draw_any(config: &Config, seed: u64) -> Hidden {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(super::stream::DRAW);
    let case = rng.random_range(0..CASES_ALL);
    draw_case(config, case, &mut rng)
}

/// An effect of the given case, 0 to [`CHOICES`] − 1 (taken modulo), with sizes drawn as in [`draw`].
pub fn draw_of(config: &Config, case: usize, seed: u64) -> Hidden {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(super::stream::DRAW);
    draw_case(config, case % CHOICES, &mut rng)
}

pub(super) fn draw_case(config: &Config, case: usize, rng: &mut ChaCha8Rng) -> Hidden {
    use Target::{Cart, Motor, Pole, Slider};
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
        13 => Hidden::Backlash {
            target: Motor,
            gap: size(ranges.backlash.motor),
            restitution: size(ranges.backlash.restitution),
            motor_inertia: size(ranges.backlash.motor_inertia),
        },
        14 | 15 => {
            let r = &ranges.asymmetric_viscous_friction;
            let (target, mean) = match case {
                14 => (Slider, r.slider),
                _ => (Pole, r.pole),
            };
            let (mean, difference) = (size(mean), size(r.difference));
            Hidden::AsymmetricViscousFriction {
                target,
                coefficient_positive: mean * (1.0 + difference),
                coefficient_negative: mean * (1.0 - difference),
            }
        }
        16 => Hidden::PositionDependentFriction {
            target: Slider,
            force: known,
            slope: size(ranges.position_dependent_friction.slider),
        },
        17 => Hidden::LoadDependentFriction {
            target: Slider,
            coefficient: size(ranges.load_dependent_friction.slider),
        },
        18 => Hidden::PeriodicForce {
            target: Slider,
            amplitude: size(ranges.periodic_force.slider),
            period: size(ranges.periodic_force.period),
            phase: size([-PI, PI]),
        },
        19 => Hidden::InputOffset {
            target: Motor,
            offset: size(ranges.input_offset.motor),
        },
        20 => Hidden::ActuatorLag {
            target: Motor,
            time_constant: size(ranges.actuator_lag.motor),
        },
        21 => Hidden::InputDeadZone {
            target: Motor,
            width: size(ranges.input_dead_zone.motor),
        },
        22 => Hidden::InputSaturation {
            target: Motor,
            limit: size(ranges.input_saturation.motor),
        },
        23 => {
            let r = &ranges.elastic_transmission;
            let (rate, ratio) = (TAU * size(r.frequency), size(r.damping_ratio));
            let motor_inertia = size(r.motor_inertia);
            Hidden::ElasticTransmission {
                target: Motor,
                stiffness: motor_inertia * rate * rate,
                damping: 2.0 * ratio * motor_inertia * rate,
                motor_inertia,
            }
        }
        24 => Hidden::SensorOffset {
            target: Pole,
            offset: size(ranges.sensor_offset.pole),
        },
        25 => Hidden::SensorScale {
            target: Slider,
            scale: size(ranges.sensor_scale.slider),
        },
        26 => Hidden::SensorDelay {
            target: Slider,
            delay: size(ranges.sensor_delay.slider),
        },
        27 => Hidden::SensorDelay {
            target: Pole,
            delay: size(ranges.sensor_delay.pole),
        },
        28 => Hidden::DahlFriction {
            target: Slider,
            coulomb_force: size(ranges.dahl_friction.slider),
            stiffness: size(ranges.dahl_friction.stiffness),
        },
        29 => Hidden::LugreFriction {
            target: Slider,
            coulomb_force: known,
            static_force: known + size(ranges.lugre_friction.slider),
            stribeck_velocity: size(ranges.lugre_friction.velocity),
            stiffness: size(ranges.lugre_friction.stiffness),
            damping: size(ranges.lugre_friction.damping),
        },
        30 => Hidden::Hysteresis {
            target: Slider,
            stiffness: size(ranges.hysteresis.slider),
            width: size(ranges.hysteresis.width),
        },
        UNSEEN => Hidden::SensorOffset {
            target: Slider,
            offset: size(ranges.sensor_offset.slider),
        },
        32 => Hidden::AddedMass {
            target: Cart,
            mass: size(ranges.added_mass.cart),
        },
        33 => Hidden::AddedMass {
            target: Pole,
            mass: size(ranges.added_mass.pole),
        },
        34 => Hidden::ReflectedInertia {
            target: Slider,
            inertia: size(ranges.reflected_inertia.slider),
        },
        35 => Hidden::ReflectedInertia {
            target: Pole,
            inertia: size(ranges.reflected_inertia.pole),
        },
        36 => Hidden::GravityTilt {
            target: Slider,
            angle: size(ranges.gravity_tilt.slider),
        },
        _ => {
            let upper = size(ranges.end_stop.slider);
            Hidden::EndStop {
                target: Slider,
                lower: -upper,
                upper,
                restitution: size(ranges.end_stop.restitution),
            }
        }
    };
    if rng.random_bool(0.5) {
        match &mut effect {
            Hidden::AsymmetricCoulombFriction {
                force_positive: a,
                force_negative: b,
                ..
            }
            | Hidden::AsymmetricViscousFriction {
                coefficient_positive: a,
                coefficient_negative: b,
                ..
            } => std::mem::swap(a, b),
            Hidden::ConstantForce { force: x, .. }
            | Hidden::InputGainError { gain: x, .. }
            | Hidden::PositionDependentFriction { slope: x, .. }
            | Hidden::InputOffset { offset: x, .. }
            | Hidden::SensorOffset { offset: x, .. }
            | Hidden::SensorScale { scale: x, .. }
            | Hidden::GravityTilt { angle: x, .. } => *x = -*x,
            _ => {}
        }
    }
    effect
}
