//! Sensor offset: the reading is q + b.
//!
//! b in m or rad. As the `zero` of the model's sensor, but without its tolerance: a finding. Seen where gravity or a spring tells where the
//! zero is.

use super::{Action, Distortion, Family, Kind, ParameterSpec, Quantity, kind::from_zero};

/// The kind `sensor_offset`.
pub static KIND: Kind = Kind {
    name: "sensor_offset",
    family: Family::Sensor,
    summary: "something is added to the reading of the position",
    parameters: &[ParameterSpec::new(
        "offset",
        Quantity::Displacement,
        (f64::NEG_INFINITY, f64::INFINITY),
        0.0,
    )],
    action: Action::Sensor(Distortion::Offset),
    contains: &[],
    probes: |scales, _| from_zero(0.02 * scales.reach),
};
