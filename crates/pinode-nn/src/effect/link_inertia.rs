//! Inertia of a link: a body that turns more or less easily than the model says.
//!
//! ID(q, v, v̇) + I (M_r v̇ + C_r v) = Q, with M_r and C_r of the same joints with nothing but a body without mass that has 1 kg·m² about every axis normal to the line
//! from the joint through the centre of mass, and none about that line.
//!
//! I in kg·m², about the centre of mass, which stays where it is, as does the mass; negative where the body has less than its model. The inertia of a rod whose
//! thickness does not count. It has no weight. Confused with `reflected_inertia` where the body turns about one axis with one joint, with `centre_of_mass` and
//! `payload` where their weight does not show, and with the mass scale of the body.

use super::{
    Action, Family, Inertial, Kind, ParameterSpec, Quantity, inertial::PROBE, kind::from_zero,
};

/// The kind `link_inertia`.
pub static KIND: Kind = Kind {
    name: "link_inertia",
    family: Family::Inertia,
    summary: "inertia of a body about its centre of mass, that has no weight",
    parameters: &[ParameterSpec::new(
        "inertia",
        Quantity::RotationalInertia,
        (0.0, f64::INFINITY),
        0.0,
    )],
    action: Action::Inertial(Inertial::OfLink),
    contains: &[],
    probes: |scales, _| from_zero(PROBE * scales.mass),
};
