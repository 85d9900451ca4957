//! Sensor delay: the reading at t is q(t − T).
//!
//! T in s, not a whole number of samples in general: between samples a cubic through positions and velocities is read. An input delay makes
//! the motion of every joint late, this one only the reading of its own.

use super::{Action, Distortion, Family, Kind, ParameterSpec, Probe, Quantity};

/// The kind `sensor_delay`.
pub static KIND: Kind = Kind {
    name: "sensor_delay",
    family: Family::Sensor,
    summary: "the reading of the position is late",
    parameters: &[ParameterSpec::new("delay", Quantity::Time, (0.0, 0.2), 0.0)],
    action: Action::Sensor(Distortion::Delay),
    contains: &[],
    probes: |scales, _| {
        [0.005, 0.03]
            .map(|delay| Probe {
                neutral: vec![0.0],
                perturbed: vec![delay * scales.pace],
            })
            .to_vec()
    },
};
