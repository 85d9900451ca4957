//! A model through an experiment: what its sensors read, and how long it stays where the log has been.

use std::f64::consts::{FRAC_PI_2, PI};

use super::super::study::Study;
use super::menu::Trial;
use crate::contact_run::roll_system;
use crate::hybrid::{DrivenInputs, Hybrid, HybridContacts};
use crate::shooting::{Roller, Trajectory};

/// The logged reach ends so much further out, in its own size.
const SLACK: f64 = 0.05;

/// Whether the reach is left is asked every so many samples.
const STRETCH: usize = 33;

/// What a simulation gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// Readings of the positions, one column a coordinate.
    pub readings: Vec<Vec<f64>>,
    /// So many samples, from the first on, are within the logged reach.
    pub within: usize,
}

/// A model set up for a trial.
pub struct Simulator<'a> {
    study: &'a Study,
    trial: &'a Trial,
    hybrid: Hybrid,
    substeps: usize,
}

impl<'a> Simulator<'a> {
    /// For `trial`, with so many integration steps a sample.
    pub fn new(study: &'a Study, hybrid: &Hybrid, trial: &'a Trial, substeps: usize) -> Self {
        Simulator {
            study,
            trial,
            hybrid: trial.setup.applied(hybrid),
            substeps,
        }
    }

    /// The trial at θ, from rest where the sensors read its start, until it leaves the logged reach or fails. Friction sticks where the
    /// mechanism has laws for that. `None` where nothing is simulated.
    pub fn run(&self, theta: &[f64]) -> Option<Simulated> {
        let hybrid = &self.hybrid;
        let theta = self.trial.setup.constants(hybrid, theta);
        let t: Vec<f64> = (0..self.trial.samples)
            .map(|k| k as f64 * self.study.interval)
            .collect();
        let inputs = hybrid.drive(&t, &self.trial.u, self.substeps, &theta, &[]);
        let readings = hybrid.readings(&theta, &[]);
        let nv = hybrid.nv();
        let mut start: Vec<f64> = readings
            .iter()
            .zip(&self.trial.start)
            .map(|(reading, y)| reading.position_of(*y, 0.0))
            .collect();
        start.resize(2 * nv, 0.0);
        let rest = vec![0.0; nv];
        start.extend(hybrid.hidden_start(&rest, &theta, &inputs, 0));
        hybrid.put_behind_motors(&theta, &mut start);
        let states = self.states(hybrid, &theta, &inputs, start);
        let nx = hybrid.nx();
        let t = t.get(..states.len() / nx)?;
        let read = |c: usize| -> Option<Vec<f64>> {
            let channel = self.study.observations.channels.get(c)?;
            let reading = readings.get(c)?;
            let at = |k| channel.predict(reading, (nv, nx), &states, t, k).value;
            Some((0..t.len()).map(at).collect())
        };
        Some(Simulated {
            readings: (0..nv).map(read).collect::<Option<_>>()?,
            within: states
                .chunks_exact(nx)
                .take_while(|x| self.is_within(&x[..nv]))
                .count(),
        })
    }

    /// Whether all positions are where the log has been. What goes round may be within a quarter turn of its rest, and where
    /// the log or the start has it up to half a turn.
    fn is_within(&self, q: &[f64]) -> bool {
        let coordinates = self.hybrid.mechanics().coordinates().iter();
        let scales = coordinates.zip(self.study.scales.iter());
        let places = self.trial.rest.iter().zip(&self.trial.start);
        q.iter()
            .zip(scales.zip(places))
            .all(
                |(q, ((coordinate, scales), (rest, start)))| match coordinate.wraps {
                    true => {
                        let reach = scales.reach.clamp(FRAC_PI_2, PI).max((start - rest).abs());
                        (q - rest).abs() <= (1.0 + SLACK) * reach
                    }
                    false => (q - scales.centre).abs() <= (1.0 + SLACK) * scales.reach,
                },
            )
    }

    /// The states at the samples from `start` on, until some while after they leave the reach; set-valued friction wherever there are laws
    /// for it.
    fn states(
        &self,
        hybrid: &Hybrid,
        theta: &[f64],
        inputs: &DrivenInputs,
        start: Vec<f64>,
    ) -> Vec<f64> {
        let (nx, nv) = (hybrid.nx(), hybrid.nv());
        let sticking = match hybrid.rubbing().is_empty() {
            true => None,
            false => HybridContacts::new(hybrid, theta, inputs).ok(),
        };
        let sticking = sticking.map(HybridContacts::with_compliant_stops);
        let mut roller = Roller::new(hybrid, &[]);
        let mut part = Trajectory::default();
        let mut states = start;
        let mut first = 0;
        while first + 1 < self.trial.samples {
            let count = STRETCH.min(self.trial.samples - first);
            let from = states[first * nx..].to_vec();
            if !self.is_within(&from[..nv]) {
                break;
            }
            let span = (first, count);
            match &sticking {
                Some(system) => match roll_system(system, inputs, span, &from) {
                    Ok(rolled) => states.extend(rolled.states.iter().skip(1).flatten()),
                    Err(_) => break,
                },
                None => match roller.roll(theta, inputs, span, &from, &mut part) {
                    Ok(()) => states.extend_from_slice(&part.states[nx..]),
                    Err(_) => break,
                },
            }
            first += count - 1;
        }
        states
    }
}
