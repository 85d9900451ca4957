//! The accelerations, and the forces, that are needed and not modelled, at the smoothed states of the seen windows.
//!
//! v̇ − v̇_model, and F = M(q) (v̇ − v̇_model), which is to be added to Q in M v̇ + C v + G = Q. Nothing is integrated: what is far off is seen as well as what is near. Their noise is
//! high, and smoothed velocities are biased: it is where a fit starts.

use nalgebra::{DMatrix, DVector};

use super::accelerations::{Seen, missing, modelled, states};
use super::study::Study;
use crate::hybrid::Hybrid;
use crate::shooting::ObservedRun;

/// The samples that count, recording by recording.
pub struct Needed<'a> {
    pub study: &'a Study,
    runs: Vec<(Seen, Vec<usize>)>,
}

impl<'a> Needed<'a> {
    /// Those whose polynomials lie in a seen window, with nothing in them that is not valid.
    pub fn of(study: &'a Study) -> Self {
        let runs = study.observations.runs.iter().enumerate();
        let of = |(r, run): (usize, &ObservedRun)| {
            let seen = Seen::of(&run.t, study.pace.half_width());
            let windows = study.windows.fit.iter().filter(|w| w.run == r);
            let samples = windows.flat_map(|w| {
                let inside = (0..w.count).step_by(seen.stride);
                let inside = inside.filter(|&k| seen.reaches(k, w.count));
                inside.map(|k| w.first + k).collect::<Vec<_>>()
            });
            let is_valid = |&k: &usize| {
                let mut channels = run.valid.iter();
                channels.all(|valid| valid[seen.samples(k)].iter().all(|valid| *valid))
            };
            let samples = samples.filter(is_valid).collect();
            (seen, samples)
        };
        let runs = runs.map(of).collect();
        Needed { study, runs }
    }

    /// v̇ − v̇_model at θ, sample by sample, in units of the noise of a smoothed acceleration.
    pub fn missing(&self, hybrid: &Hybrid, theta: &[f64]) -> DVector<f64> {
        let mut all = Vec::new();
        for (r, (seen, samples)) in self.runs.iter().enumerate() {
            let (run, smooth) = (&self.study.observations.runs[r], &self.study.smoothed[r]);
            let modelled = modelled((hybrid, theta), run, smooth);
            for &k in samples {
                let missing = missing(smooth, k, &seen.averaged(&modelled, k));
                let channels = self.study.observations.channels.iter();
                let scaled = missing.iter().zip(channels);
                all.extend(scaled.map(|(a, channel)| a / (channel.noise * seen.noise)));
            }
        }
        DVector::from_vec(all)
    }

    /// The samples of each recording.
    pub fn samples(&self) -> impl Iterator<Item = &[usize]> {
        self.runs.iter().map(|(_, samples)| samples.as_slice())
    }

    /// F at θ, one column a coordinate, N or N·m; NaN where the model has no acceleration.
    pub fn forces(&self, hybrid: &Hybrid, theta: &[f64]) -> Vec<Vec<f64>> {
        let nv = hybrid.nv();
        let mut forces = vec![Vec::new(); nv];
        let mut memory = hybrid.memory(&[]);
        let mut mass = DMatrix::zeros(nv, nv);
        for (r, (seen, samples)) in self.runs.iter().enumerate() {
            let (run, smooth) = (&self.study.observations.runs[r], &self.study.smoothed[r]);
            let read = states((hybrid, theta), smooth);
            let modelled = modelled((hybrid, theta), run, smooth);
            for &k in samples {
                let missing = missing(smooth, k, &seen.averaged(&modelled, k));
                hybrid.mass_matrix_into(&read(k)[..nv], theta, &mut memory, &mut mass);
                let force = &mass * missing;
                for (all, force) in forces.iter_mut().zip(&force) {
                    all.push(*force);
                }
            }
        }
        forces
    }
}
