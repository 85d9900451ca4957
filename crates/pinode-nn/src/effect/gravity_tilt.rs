//! Gravity tilt: the base does not stand level.
//!
//! ID(q, v, v̇; g) + sin α G(q; |g| d) + (cos α − 1) G(q; g) = Q, which is ID under the gravity cos α g + |g| sin α d
//!
//! α in rad. d is horizontal: for a joint that slides, against the horizontal part of its axis, so that a positive α raises the
//! positive end of the rail; for one that turns, −axis × g, so that a positive α turns the base about the joint's axis. Tilts on two
//! joints add, which is right to the first order in the angles. Confused with a constant force on a level slider, and with an offset of the
//! sensor of a joint that hangs; the two together are the tilt.

use super::{Action, Family, Inertial, Kind, ParameterSpec, Quantity, kind::from_zero};

/// The kind `gravity_tilt`.
pub static KIND: Kind = Kind {
    name: "gravity_tilt",
    family: Family::Conservative,
    summary: "a base that is not level",
    parameters: &[ParameterSpec::new(
        "angle",
        Quantity::Angle,
        (-0.5, 0.5),
        0.0,
    )],
    action: Action::Inertial(Inertial::Tilt),
    contains: &[],
    probes: |_, _| from_zero(0.01),
};
