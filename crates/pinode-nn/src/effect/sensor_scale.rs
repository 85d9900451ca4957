//! Sensor scale: the reading is (1 + s) q.
//!
//! s is a ratio. A velocity that the sensor measures is scaled as well. Confused with masses and gains where nothing tells the length of
//! the way.

use super::{Action, Distortion, Family, Kind, ParameterSpec, Quantity, kind::from_zero};

/// The kind `sensor_scale`.
pub static KIND: Kind = Kind {
    name: "sensor_scale",
    family: Family::Sensor,
    summary: "the reading of the position has another scale",
    parameters: &[ParameterSpec::new(
        "scale",
        Quantity::Ratio,
        (-0.9, 10.0),
        0.0,
    )],
    action: Action::Sensor(Distortion::Scale),
    contains: &[],
    probes: |_, _| from_zero(0.02),
};
