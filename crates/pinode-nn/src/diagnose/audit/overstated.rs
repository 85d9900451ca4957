//! Noise that is none: what swings within a few samples looks like scatter to differences of readings, until a model follows it.

use super::super::study::{Fitted, Study};
use super::super::verdict::DataFault;
use super::noise;
use super::{
    LEAST_OF_POSITIONS, LEAST_OF_VELOCITIES, MORE_THAN_DECLARED, NOISE, column_name, noise_fault,
    of_sensor,
};
use crate::diagnose::smooth::unwrapped;
use crate::model::Model;
use crate::shooting::Observations;

/// Residuals of less than this part of a sensor's noise are that noise. Less is harmless: beside noise that is three times too large a cubic spring has its name and its size,
/// and smaller effects are not asked for; beside 50 times an elastic drive was 70 % off.
const FAR_LESS: f64 = 0.25;

/// Sensors of less noise than their readings seemed to have.
pub struct Overstated {
    /// What was observed, with the noise that is left of it.
    pub observations: Observations,
    /// What the audit said of their noise, where it does not hold any more.
    withdrawn: Vec<String>,
    /// What is to be said instead.
    faults: Vec<DataFault>,
}

impl Overstated {
    /// Corrects what was said of the noise of these sensors.
    pub fn correct(&self, faults: &mut Vec<DataFault>) {
        faults.retain(|fault| fault.kind != NOISE || !self.withdrawn.contains(&fault.column));
        faults.extend(self.faults.iter().cloned());
    }
}

/// The noise of each sensor that a fitted model's residuals leave it, where that is far less than its readings seemed to have, or where it is what the model file
/// declares and the readings seemed to contradict. `None`: of none.
///
/// A window of n readings takes two of them for the initial state of their coordinate: σ² = Σ r² / Σ (n − 2).
pub fn overstated(model: &Model, study: &Study, fitted: &Fitted) -> Option<Overstated> {
    let mut found = Overstated {
        observations: study.observations.clone(),
        withdrawn: Vec::new(),
        faults: Vec::new(),
    };
    let squares = || fitted.inside.squares.iter().chain(&fitted.outside.squares);
    for (c, channel) in found.observations.channels.iter_mut().enumerate() {
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
        let sensor = &model.sensors[channel.coordinate];
        let declared = sensor.position_noise.filter(|_| !channel.velocity);
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
        let quantum = step / 12.0_f64.sqrt();
        let noise = of_sensor(left, declared, quantum, (&readings, least));
        let as_declared = declared.is_some_and(|declared| {
            let most = MORE_THAN_DECLARED * declared.hypot(quantum);
            channel.noise > most && left <= MORE_THAN_DECLARED * declared
        });
        if as_declared || noise < FAR_LESS * channel.noise {
            channel.noise = noise;
            let (column, unit) = column_name(model, channel);
            found
                .faults
                .extend(noise_fault(left, declared, (&column, &unit)));
            found.withdrawn.push(column);
        }
    }
    (!found.withdrawn.is_empty()).then_some(found)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::diagnose::pushes::tests::prepared;
    use crate::diagnose::setup::Prepared;

    /// The sledge's model file, with another line for the noise of its sensor.
    fn with_noise(text: &str, dir: &std::path::Path, declared: &str) -> Model {
        let lines = text.lines().map(|line| match line {
            line if line.starts_with("position_noise") => declared,
            line => line,
        });
        let text = lines.collect::<Vec<_>>().join("\n");
        Model::parse(&dir.join("sledge.toml"), text).unwrap()
    }

    fn noise_of(found: Option<Overstated>) -> f64 {
        found.unwrap().observations.channels[0].noise
    }

    #[test]
    fn noise_that_is_ten_times_too_large_is_what_a_model_leaves_and_right_noise_stays() {
        let (dir, Prepared { study, null, .. }) = prepared(0.0);
        let text = std::fs::read_to_string(dir.path().join("sledge.toml")).unwrap();
        let undeclared = with_noise(&text, dir.path(), "");
        let right = study.observations.channels[0].noise;
        assert!(overstated(&undeclared, &study, &null).is_none());
        let mut loud = study.clone();
        loud.observations.channels[0].noise *= 10.0;
        let lowered = noise_of(overstated(&undeclared, &loud, &null));
        assert!((lowered / right - 1.0).abs() < 0.1, "{lowered} {right}");
    }

    #[test]
    fn what_a_model_file_declares_is_believed_again_where_a_model_leaves_no_more() {
        let (dir, Prepared { study, null, .. }) = prepared(0.0);
        let text = std::fs::read_to_string(dir.path().join("sledge.toml")).unwrap();
        let right = study.observations.channels[0].noise;
        let said = |model: &Model, study: &Study| {
            let column = column_name(model, &study.observations.channels[0]);
            let noise = study.observations.channels[0].noise;
            let declared = model.sensors[0].position_noise;
            noise_fault(noise, declared, (&column.0, &column.1))
        };
        // Twice as much is within what residuals alone would not deny.
        for times in [2.0, 10.0] {
            let declared = Model::parse(&dir.path().join("sledge.toml"), text.clone()).unwrap();
            let mut loud = study.clone();
            loud.observations.channels[0].noise *= times;
            let mut faults: Vec<DataFault> = said(&declared, &loud).into_iter().collect();
            assert_eq!(faults.len(), 1);
            let found = overstated(&declared, &loud, &null).unwrap();
            found.correct(&mut faults);
            assert!(faults.is_empty(), "{faults:?}");
            assert_eq!(noise_of(Some(found)), right);
        }
        // A hundredth of what there is stays contradicted, by what is left and not by what the readings seemed to scatter.
        let declaration = format!("position_noise = {:e}", 0.01 * right);
        let too_little = with_noise(&text, dir.path(), &declaration);
        let mut loud = study.clone();
        loud.observations.channels[0].noise *= 10.0;
        let mut faults: Vec<DataFault> = said(&too_little, &loud).into_iter().collect();
        let before = faults.clone();
        let found = overstated(&too_little, &loud, &null).unwrap();
        found.correct(&mut faults);
        assert!(faults.len() == 1 && faults != before, "{faults:?}");
        let lowered = noise_of(Some(found));
        assert!((lowered / right - 1.0).abs() < 0.1, "{lowered} {right}");
        assert!(overstated(&too_little, &study, &null).is_none());
    }
}
