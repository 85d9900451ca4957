//! What is known of the sensors: `[sensor.<joint>]`.

use super::document::{Faults, Section};
use super::mechanism::{Mechanism, find_coordinate};
use crate::naming::quoted;

/// The sensor of one coordinate. What is `None` is estimated from the log.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sensor {
    /// Standard deviation of the position noise, m or rad.
    pub position_noise: Option<f64>,
    /// Quantisation step, m or rad.
    pub resolution: Option<f64>,
    /// Where the log's velocities come from.
    pub velocity: Velocity,
    /// The sensor reads q + zero, m or rad.
    pub zero: f64,
}

/// Where the velocity column of a log comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Velocity {
    /// From a sensor of its own.
    #[default]
    Measured,
    /// (q_k − q_{k−1}) / (t_k − t_{k−1}) of the measured positions.
    BackwardDifference,
    /// There is none, or none that should be used.
    None,
}

impl Velocity {
    const ALL: [Velocity; 3] = [
        Velocity::Measured,
        Velocity::BackwardDifference,
        Velocity::None,
    ];

    /// The word for it in model files.
    pub fn name(self) -> &'static str {
        match self {
            Velocity::Measured => "measured",
            Velocity::BackwardDifference => "backward_difference",
            Velocity::None => "none",
        }
    }
}

/// The `[sensor]` table: one sensor per coordinate.
pub(super) fn read(
    root: &Section,
    mechanism: Option<&Mechanism>,
    faults: &mut Faults,
) -> Vec<Sensor> {
    let mut sensors =
        vec![Sensor::default(); mechanism.map_or(0, |m| m.mechanics.coordinates().len())];
    let Some(section) = root.section("sensor", "[sensor]", faults) else {
        return sensors;
    };
    for (name, table) in section.named_sections("sensor", faults) {
        table.check_keys(
            &["position_noise", "resolution", "velocity", "zero"],
            faults,
        );
        let mut positive = |key| table.number_that(key, "positive", |x| x > 0.0, faults);
        let position_noise = positive("position_noise");
        let resolution = positive("resolution");
        let zero = table.number("zero", faults).map_or(0.0, |zero| zero.value);
        let velocity = match table.string("velocity", faults) {
            None => Velocity::default(),
            Some(word) => Velocity::ALL
                .into_iter()
                .find(|v| v.name() == word.value)
                .unwrap_or_else(|| {
                    faults.at(
                        word.offset(),
                        format!(
                            "`velocity` is {}: it must be \"measured\", \"backward_difference\" or \"none\"",
                            quoted(word.value)
                        ),
                    );
                    Velocity::default()
                }),
        };
        if let Some(index) =
            mechanism.and_then(|m| find_coordinate(m, name.value, name.offset(), faults))
            && let Some(sensor) = sensors.get_mut(index)
        {
            *sensor = Sensor {
                position_noise,
                resolution,
                velocity,
                zero,
            };
        }
    }
    sensors
}
