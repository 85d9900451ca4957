//! Noise that is none: what swings within a few samples looks like scatter to differences of readings, until a model follows it.

use super::super::study::{Fitted, Study};
use super::noise;
use super::{LEAST_OF_POSITIONS, LEAST_OF_VELOCITIES, of_sensor};
use crate::diagnose::smooth::unwrapped;
use crate::model::Model;
use crate::shooting::Observations;

/// Residuals of less than this part of a sensor's noise are that noise. Less is harmless: beside noise that is three times too large a cubic spring has its name and its size,
/// and smaller effects are not asked for; beside 50 times an elastic drive was 70 % off.
const FAR_LESS: f64 = 0.25;

/// What was observed with the noise of each sensor that a fitted model's residuals leave it, where that is far less than its readings seemed to have. What a model file
/// declares is believed. `None`: of none.
///
/// A window of n readings takes two of them for the initial state of their coordinate: σ² = Σ r² / Σ (n − 2).
pub fn overstated(model: &Model, study: &Study, fitted: &Fitted) -> Option<Observations> {
    let mut observations = study.observations.clone();
    let squares = || fitted.inside.squares.iter().chain(&fitted.outside.squares);
    let mut lowered = false;
    for (c, channel) in observations.channels.iter_mut().enumerate() {
        let sensor = &model.sensors[channel.coordinate];
        if sensor.position_noise.is_some() && !channel.velocity {
            continue;
        }
        let own = squares().map(|window| window[c]).filter(|own| own.1 > 2);
        let (sum, count) = own.fold((0.0, 0), |all, (sum, n)| (all.0 + sum, all.1 + n - 2));
        let left = (sum / count.max(1) as f64).sqrt();
        if count == 0 || left.is_nan() {
            continue;
        }
        let readings = study
            .observations
            .runs
            .iter()
            .map(|run| match channel.wraps {
                true => unwrapped(&run.y[c]),
                false => run.y[c].clone(),
            });
        let readings: Vec<Vec<f64>> = readings.collect();
        let step = match channel.velocity {
            true => 0.0,
            false => noise::quantum(&readings)
                .unwrap_or(0.0)
                .max(sensor.resolution.unwrap_or(0.0)),
        };
        let least = match channel.velocity {
            true => LEAST_OF_VELOCITIES,
            false => LEAST_OF_POSITIONS,
        };
        let noise = of_sensor(left, None, step / 12.0_f64.sqrt(), (&readings, least));
        if noise < FAR_LESS * channel.noise {
            channel.noise = noise;
            lowered = true;
        }
    }
    lowered.then_some(observations)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::diagnose::pushes::tests::prepared;
    use crate::diagnose::setup::Prepared;

    #[test]
    fn noise_that_is_ten_times_too_large_is_what_a_model_leaves_and_right_noise_stays() {
        let (dir, Prepared { study, null, .. }) = prepared(0.0);
        let model = std::fs::read_to_string(dir.path().join("sledge.toml")).unwrap();
        let undeclared: Vec<&str> = model
            .lines()
            .filter(|line| !line.starts_with("position_noise"))
            .collect();
        let [declared, undeclared] = [model.clone(), undeclared.join("\n")]
            .map(|text| Model::parse(&dir.path().join("sledge.toml"), text).unwrap());
        let right = study.observations.channels[0].noise;
        assert!(overstated(&undeclared, &study, &null).is_none());
        let mut loud = study.clone();
        loud.observations.channels[0].noise *= 10.0;
        let lowered = overstated(&undeclared, &loud, &null).unwrap().channels[0].noise;
        assert!((lowered / right - 1.0).abs() < 0.1, "{lowered} {right}");
        assert!(overstated(&declared, &loud, &null).is_none());
    }
}
