//! The sizes of hidden effects.

use serde::{Deserialize, Serialize};

use super::{Check, Known, Rail, Range};

/// Ranges of the sizes of hidden effects, as `[smallest, largest]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HiddenRanges {
    /// Coefficients, N·s/m and N·m·s/rad.
    pub viscous_friction: BothJoints,
    /// Forces, N and N·m.
    pub coulomb_friction: BothJoints,
    /// Force added one way and taken the other, N; either sign.
    pub asymmetric_coulomb_friction: Slider,
    /// Static force above the sliding one, N, and the Stribeck velocity, m/s.
    pub stribeck_friction: Stribeck,
    /// Coefficients, N·s²/m² and N·m·s²/rad².
    pub quadratic_drag: BothJoints,
    /// Stiffness, N/m, and rest position, m.
    pub linear_spring: Spring,
    /// Stiffness, N/m³.
    pub cubic_spring: Slider,
    /// Force, N; either sign.
    pub constant_force: Slider,
    /// Share of the input; either sign.
    pub input_gain_error: Motor,
    /// Delay, s.
    pub input_delay: Motor,
    /// Between motor and cart.
    pub backlash: Backlash,
    /// Mean coefficients, N·s/m and N·m·s/rad, and how far the two directions are from it.
    pub asymmetric_viscous_friction: AsymmetricViscous,
    /// Slope along the rail, N/m; either sign.
    pub position_dependent_friction: Slider,
    /// Ratio of friction to the motor's force.
    pub load_dependent_friction: Slider,
    /// Amplitude, N, and period, m.
    pub periodic_force: Periodic,
    /// N of the input; either sign.
    pub input_offset: Motor,
    /// Time constant, s.
    pub actuator_lag: Motor,
    /// Half width, N of the input.
    pub input_dead_zone: Motor,
    /// Largest force, N of the input.
    pub input_saturation: Motor,
    /// The string between motor and cart.
    pub elastic_transmission: ElasticTransmission,
    /// Zeros of the sensors, m and rad; either sign.
    pub sensor_offset: BothJoints,
    /// Share of the reading; either sign.
    pub sensor_scale: Slider,
    /// Delay, s.
    pub sensor_delay: BothJoints,
    /// Coulomb force, N, in place of the known one, and stiffness.
    pub dahl_friction: Dahl,
    /// Static force above the known sliding one, N, and what the bristles are like.
    pub lugre_friction: LuGre,
    /// Stiffness, N/m, of a spring that slips, and the half width of its loop.
    pub hysteresis: Hysteresis,
    /// Masses, kg.
    pub added_mass: Bodies,
    /// kg and kg·m².
    pub reflected_inertia: BothJoints,
    /// Slope of the rail, rad; either sign.
    pub gravity_tilt: Slider,
    /// Hard stops on the rail.
    pub end_stop: EndStop,
}

/// A range for each joint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BothJoints {
    /// On the cart.
    pub slider: Range,
    /// On the pole.
    pub pole: Range,
}

/// A range on the cart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slider {
    /// On the cart.
    pub slider: Range,
}

/// A range on the input.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// On the motor.
    pub motor: Range,
}

/// Ranges of Stribeck friction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stribeck {
    /// Static force above the sliding one, N.
    pub slider: Range,
    /// Stribeck velocity, m/s.
    pub velocity: Range,
}

/// Ranges of backlash.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backlash {
    /// Way of the motor from one flank to the other with the cart at rest, m.
    pub motor: Range,
    /// Relative speed after a blow over that before.
    pub restitution: Range,
    /// The part of the mass that slides that is the motor's, kg.
    pub motor_inertia: Range,
}

/// Ranges of a linear spring.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spring {
    /// Stiffness, N/m.
    pub slider: Range,
    /// Where it pulls to, m.
    pub rest: Range,
}

/// Ranges of viscous friction that depends on the direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AsymmetricViscous {
    /// Mean of the two coefficients on the cart, N·s/m.
    pub slider: Range,
    /// Mean of the two coefficients on the pole, N·m·s/rad.
    pub pole: Range,
    /// Share of the mean that one direction has more and the other less; either sign.
    pub difference: Range,
}

/// Ranges of a force that repeats along the rail.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Periodic {
    /// Amplitude, N.
    pub slider: Range,
    /// Period, m.
    pub period: Range,
}

/// Ranges of an elastic string between motor and cart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElasticTransmission {
    /// √(k/J)/2π, the motor's frequency on its string with the cart held, Hz.
    pub frequency: Range,
    /// c/(2 √(k J)), its damping ratio with the cart held.
    pub damping_ratio: Range,
    /// J, beside the mass that slides, kg.
    pub motor_inertia: Range,
}

/// Ranges of Dahl's friction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dahl {
    /// Coulomb force, N.
    pub slider: Range,
    /// Stiffness at rest, N/m.
    pub stiffness: Range,
}

/// Ranges of LuGre friction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LuGre {
    /// Static force above the sliding one, N.
    pub slider: Range,
    /// Stribeck velocity, m/s.
    pub velocity: Range,
    /// Stiffness of the bristles, N/m.
    pub stiffness: Range,
    /// Damping of the bristles, N·s/m.
    pub damping: Range,
}

/// Ranges of hard stops on both sides of the middle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndStop {
    /// How far from the middle, m.
    pub slider: Range,
    /// Speed after a blow over the speed before.
    pub restitution: Range,
}

/// A range for each body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bodies {
    /// On the cart.
    pub cart: Range,
    /// On the pole with its tip.
    pub pole: Range,
}

/// Ranges of a spring that slips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hysteresis {
    /// Stiffness, N/m.
    pub slider: Range,
    /// Half width of its loop, m: it slips where it is stretched by this.
    pub width: Range,
}

impl HiddenRanges {
    /// Notes every range outside of its domain.
    pub(super) fn check(&self, known: &Known, rail: &Rail, check: &mut Check) {
        let h = self;
        let sizes = [
            ("viscous_friction.slider", h.viscous_friction.slider),
            ("viscous_friction.pole", h.viscous_friction.pole),
            ("coulomb_friction.slider", h.coulomb_friction.slider),
            ("coulomb_friction.pole", h.coulomb_friction.pole),
            ("stribeck_friction.slider", h.stribeck_friction.slider),
            ("quadratic_drag.slider", h.quadratic_drag.slider),
            ("quadratic_drag.pole", h.quadratic_drag.pole),
            ("linear_spring.slider", h.linear_spring.slider),
            ("cubic_spring.slider", h.cubic_spring.slider),
            ("constant_force.slider", h.constant_force.slider),
        ];
        for (key, range) in sizes {
            check.range(&format!("hidden.{key}"), range, 0.0, 1e6);
        }
        check.range(
            "hidden.asymmetric_coulomb_friction.slider",
            h.asymmetric_coulomb_friction.slider,
            0.0,
            known.slider_coulomb_friction, // neither side may push
        );
        check.range(
            "hidden.stribeck_friction.velocity",
            h.stribeck_friction.velocity,
            1e-4,
            1e3,
        );
        let rest = h.linear_spring.rest;
        check.range("hidden.linear_spring.rest", rest, -1e3, 1e3);
        let gain = h.input_gain_error.motor;
        check.range("hidden.input_gain_error.motor", gain, 0.0, 0.99);
        let delay = h.input_delay.motor;
        check.range("hidden.input_delay.motor", delay, 0.0, 10.0);
        let b = h.backlash;
        check.range("hidden.backlash.motor", b.motor, 1e-6, 1.0);
        check.range("hidden.backlash.restitution", b.restitution, 0.0, 1.0);
        check.range("hidden.backlash.motor_inertia", b.motor_inertia, 1e-6, 1e6);
        let (a, e, g) = (
            h.asymmetric_viscous_friction,
            h.elastic_transmission,
            h.lugre_friction,
        );
        let (delay, lag) = (h.sensor_delay, h.actuator_lag.motor);
        let steepest = known.slider_coulomb_friction / rail.limit; // friction may not push at the end of the rail
        let bounded = [
            ("asymmetric_viscous_friction.slider", a.slider, 0.0, 1e6),
            ("asymmetric_viscous_friction.pole", a.pole, 0.0, 1e6),
            (
                "asymmetric_viscous_friction.difference",
                a.difference,
                0.0,
                1.0,
            ),
            (
                "position_dependent_friction.slider",
                h.position_dependent_friction.slider,
                0.0,
                steepest,
            ),
            (
                "load_dependent_friction.slider",
                h.load_dependent_friction.slider,
                0.0,
                0.99,
            ),
            ("periodic_force.slider", h.periodic_force.slider, 0.0, 1e6),
            ("periodic_force.period", h.periodic_force.period, 1e-3, 1e3),
            ("input_offset.motor", h.input_offset.motor, 0.0, 1e6),
            ("actuator_lag.motor", lag, 1e-3, 10.0),
            ("input_dead_zone.motor", h.input_dead_zone.motor, 0.0, 1e6),
            (
                "input_saturation.motor",
                h.input_saturation.motor,
                1e-3,
                1e6,
            ),
            ("elastic_transmission.frequency", e.frequency, 1e-2, 100.0),
            (
                "elastic_transmission.damping_ratio",
                e.damping_ratio,
                0.0,
                1.0,
            ),
            (
                "elastic_transmission.motor_inertia",
                e.motor_inertia,
                1e-4,
                1e6,
            ),
            ("sensor_offset.slider", h.sensor_offset.slider, 0.0, 1e3),
            ("sensor_offset.pole", h.sensor_offset.pole, 0.0, 1e3),
            ("sensor_scale.slider", h.sensor_scale.slider, 0.0, 0.99),
            ("sensor_delay.slider", delay.slider, 0.0, 10.0),
            ("sensor_delay.pole", delay.pole, 0.0, 10.0),
            ("dahl_friction.slider", h.dahl_friction.slider, 1e-6, 1e6),
            (
                "dahl_friction.stiffness",
                h.dahl_friction.stiffness,
                1e-6,
                1e6,
            ),
            ("lugre_friction.slider", g.slider, 0.0, 1e6),
            ("lugre_friction.velocity", g.velocity, 1e-4, 1e3),
            ("lugre_friction.stiffness", g.stiffness, 1e-6, 1e6),
            ("lugre_friction.damping", g.damping, 0.0, 1e6),
            ("hysteresis.slider", h.hysteresis.slider, 1e-6, 1e6),
            ("hysteresis.width", h.hysteresis.width, 1e-6, 1e3),
            ("added_mass.cart", h.added_mass.cart, 0.0, 1e6),
            ("added_mass.pole", h.added_mass.pole, 0.0, 1e6),
            (
                "reflected_inertia.slider",
                h.reflected_inertia.slider,
                0.0,
                1e6,
            ),
            ("reflected_inertia.pole", h.reflected_inertia.pole, 0.0, 1e6),
            ("gravity_tilt.slider", h.gravity_tilt.slider, 0.0, 0.5),
            ("end_stop.slider", h.end_stop.slider, 1e-2, rail.limit),
            ("end_stop.restitution", h.end_stop.restitution, 0.0, 1.0),
        ];
        for (key, range, least, most) in bounded {
            check.range(&format!("hidden.{key}"), range, least, most);
        }
    }
}
