//! The states that recordings go through, behind their sensors: (q, v) smoothed, h where that takes the effects with a memory.

use super::Start;
use super::data::{MOST_SUBSTEPS, Recordings};
use super::loss::Target;
use crate::Error;
use crate::diagnose::smooth::Smoothed;
use crate::hybrid::Reading;
use crate::shooting::{HiddenPrior, Window};

/// The fastest memory, in units of a step of classical Runge-Kutta, which is unstable from 2.8 on.
const FASTEST: f64 = 1.5;
/// Steps are made shorter for a memory by themselves, to so many times as many.
const MOST_REFINED: usize = 16;

impl Recordings {
    /// What was measured and where the states go, at the constants as they are.
    pub(super) fn look_behind_sensors(&mut self) {
        self.readings = self.hybrid.readings(&self.theta, &[]);
        for (target, smoothed) in self.targets.iter_mut().zip(&self.smoothed) {
            for (c, reading) in self.readings.iter().enumerate() {
                put_behind(target, smoothed, c, reading);
            }
        }
        let runs = self
            .smoothed
            .iter()
            .zip(&self.observations.runs)
            .zip(&self.inputs);
        self.paths = runs
            .map(|((smoothed, run), inputs)| {
                let state = |k| smoothed.behind(&self.readings, &run.t, k);
                self.hybrid.hidden_path(&self.theta, inputs, &state)
            })
            .collect();
    }

    /// (q, v, h) of a recording at a sample.
    pub(super) fn state(&self, run: usize, sample: usize) -> Vec<f64> {
        let t = &self.observations.runs[run].t;
        let mut state = self.smoothed[run].behind(&self.readings, t, sample);
        state.extend(self.paths[run].at(sample));
        state
    }

    /// The same at the beginning of windows.
    pub(super) fn states(&self, windows: &[Window]) -> Vec<Vec<f64>> {
        let of = |window: &Window| self.state(window.run, window.first);
        windows.iter().map(of).collect()
    }

    /// What is known of h at the beginning of windows, while constants are fitted that it depends on.
    pub(super) fn hidden_prior(&self, windows: &[Window]) -> HiddenPrior {
        let spread = self.hybrid.hidden_spread(&self.theta, &self.scales, false);
        let mean = |window: &Window| self.paths[window.run].at(window.first).to_vec();
        HiddenPrior {
            means: windows.iter().map(mean).collect(),
            spreads: vec![spread; windows.len()],
        }
    }

    /// The starts of all windows remember what the recordings before them say.
    pub(super) fn remember(&mut self) {
        for side in [&mut self.seen, &mut self.held_out] {
            for (window, start) in side.windows.iter().zip(&mut side.starts) {
                let h = self.paths[window.run].at(window.first);
                start[side.visible..].copy_from_slice(h);
            }
        }
    }

    /// More integration steps in a sample interval, where effects with a memory are fast.
    ///
    /// # Errors
    /// [`Error::Training`] where they are too fast.
    pub(super) fn refine_for_memory(&mut self) -> Result<(), Error> {
        let rate = self.hybrid.fastest_memory(&self.theta, &self.scales);
        let needed = self.interval * rate / FASTEST;
        let most = (MOST_REFINED * self.substeps) as f64;
        if needed <= most {
            self.substeps = self.substeps.max(needed.ceil() as usize);
            return Ok(());
        }
        let cure = match needed < MOST_SUBSTEPS {
            true => format!("give --step {:.1e}, or take it out", 0.9 * FASTEST / rate),
            false => "take it out".to_owned(),
        };
        Err(Error::Training(format!(
            "an effect of the model that has a memory changes by itself within {:.1e} s, which takes {needed:.0} steps in a sample interval: {cure}, or \
             fit it by `pinode diagnose`",
            1.0 / rate
        )))
    }

    /// The states at the beginning of windows: as measured, or smoothed.
    pub(super) fn first_states(&self, windows: &[Window], start: &Start) -> Vec<Vec<f64>> {
        let mut states = self.states(windows);
        if *start == Start::Fitted {
            return states;
        }
        let n = self.hybrid.nv();
        for (window, state) in windows.iter().zip(&mut states) {
            let target = &self.targets[window.run];
            for (c, (q, v)) in target.q.iter().zip(&target.v).enumerate() {
                state[c] = q[window.first];
                if let Some(&v) = v.get(window.first) {
                    state[n + c] = v;
                }
            }
        }
        states
    }
}

/// q(t) = (y(t) − offset)/factor + v d + ½ a d², where the sensor of coordinate `c` reads what was d before; v(t) likewise.
fn put_behind(target: &mut Target, smoothed: &Smoothed, c: usize, reading: &Reading) {
    let Reading {
        offset,
        factor,
        delay: d,
        ..
    } = *reading;
    let (v, a) = (&smoothed.v[c], &smoothed.a[c]);
    let since = |k: usize| match d {
        0.0 => [0.0; 2],
        _ => [d * (v[k] + 0.5 * d * a[k]), d * a[k]],
    };
    for (k, (q, y)) in target.q[c].iter_mut().zip(&target.read[c]).enumerate() {
        *q = (y - offset + since(k)[0]) / factor;
    }
    for (k, (v, y)) in target.v[c].iter_mut().zip(&target.read_v[c]).enumerate() {
        *v = (y + since(k)[1]) / factor;
    }
}
