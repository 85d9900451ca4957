//! Added mass: the equations of motion of a point mass m at the centre of mass of the body that the link belongs to.
//!
//! ID(q, v, v̇) + m ID₁(q, v, v̇) = Q, with ID₁ = M v̇ + C v + G of the same joints with 1 kg at that point and nothing else.
//!
//! m in kg. The screw, the cable, the load that nobody weighed; negative where the body is lighter than the model has it. Confused with a smaller gain of the input where one input moves one
//! body on a level rail, with reflected inertia where the body only slides along a level line, and with the mass scale that the model's
//! `[tolerance]` leaves free: that one moves the rotational inertia in the same proportion.

use super::{
    Action, Family, Inertial, Kind, ParameterSpec, Quantity, inertial::PROBE, kind::from_zero,
};

/// The kind `added_mass`.
pub static KIND: Kind = Kind {
    name: "added_mass",
    family: Family::Inertia,
    summary: "a point mass at the centre of mass of a body",
    parameters: &[ParameterSpec::new(
        "mass",
        Quantity::Inertia,
        (0.0, f64::INFINITY),
        0.0,
    )],
    action: Action::Inertial(Inertial::PointMass),
    contains: &[],
    probes: |scales, _| from_zero(PROBE * scales.mass),
};
