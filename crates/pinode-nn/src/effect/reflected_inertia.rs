//! Reflected inertia: I v̇_j on the left-hand side of the equation of one coordinate j.
//!
//! ID(q, v, v̇) + I v̇_j e_j = Q
//!
//! I in kg or kg·m². A rotor behind a gear of ratio N counts as N² times its own inertia; it turns about its own axis as fast as the
//! joint says, and its coupling to the turning of what carries it (1/N of the effect) is left out. Negative where the model has more
//! inertia than there is. Confused with the mass of the body
//! that the joint moves, but for the coupling to other coordinates and the weight; and with a smaller gain of the input where nothing
//! else acts on the coordinate.

use super::{
    Action, Family, Inertial, Kind, ParameterSpec, Quantity, inertial::PROBE, kind::from_zero,
};

/// The kind `reflected_inertia`.
pub static KIND: Kind = Kind {
    name: "reflected_inertia",
    family: Family::Inertia,
    summary: "inertia that accelerates with one coordinate alone, as of a motor's rotor behind its gear",
    parameters: &[ParameterSpec::new(
        "inertia",
        Quantity::Inertia,
        (0.0, f64::INFINITY),
        0.0,
    )],
    action: Action::Inertial(Inertial::Rotor),
    contains: &[],
    probes: |scales, _| from_zero(PROBE * scales.mass),
};
