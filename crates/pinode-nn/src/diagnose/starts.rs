//! States at the start of windows, as measured.
//!
//! Smoothing knows no blows. Where one is near the start of a window the smoothed velocity is neither that before it nor that behind it, and from the wrong
//! side of a blow no small steps lead to the right one. A model with stops starts at what its roll-outs explain best: what is smooth on both sides, ahead or
//! behind.

use super::smooth::polynomial;
use super::study::{Start, Study};
use crate::hybrid::Hybrid;
use crate::shooting::{Channel, FitOptions, Window, fit, wrap_angle};

/// A blow so long before or behind the start of a window, s at the usual pace, is in what is smoothed there.
const NEAR_S: f64 = 0.1;
/// Iterations after which guesses are compared.
const COMPARING: usize = 4;
/// Residuals at first, in units of the noise.
const NOISES: f64 = 3.0;
/// Samples ahead or behind, with the one at the start.
const ONE_SIDE: usize = 5;

impl Study {
    /// A start of a model at θ from what was measured.
    pub fn measured(&self, hybrid: &Hybrid, theta: Vec<f64>) -> Start {
        let states = |windows: &[Window]| self.starts(hybrid, &theta, windows, None);
        let noises = self.observations.channels.iter().map(|c| c.noise);
        Start {
            hidden: Vec::new(),
            inside: states(&self.windows.fit),
            outside: states(&self.windows.held_out),
            sigma: noises.map(|noise| NOISES * noise).collect(),
            theta,
        }
    }

    /// States (q, v) at the start of windows for a model at θ, none of them in a stop: those `known`, which may have more to them, or else the measured ones; where
    /// a blow may be near, those of all these that explain their window best.
    pub fn starts(
        &self,
        hybrid: &Hybrid,
        theta: &[f64],
        windows: &[Window],
        known: Option<&[Vec<f64>]>,
    ) -> Vec<Vec<f64>> {
        let visible = hybrid.nx() - hybrid.nh();
        let smoothed = |w: &Window| self.smoothed[w.run].state(w.first);
        let smoothed: Vec<Vec<f64>> = windows.iter().map(smoothed).collect();
        let mut states = match known {
            Some(known) => known.iter().map(|x| x[..visible].to_vec()).collect(),
            None => smoothed.clone(),
        };
        let is_near = |&i: &usize| self.is_near_a_stop(hybrid, theta, &smoothed[i]);
        let near: Vec<usize> = (0..windows.len()).filter(is_near).collect();
        let near_windows: Vec<Window> = near.iter().map(|&i| windows[i]).collect();
        let of_near = |states: &[Vec<f64>]| near.iter().map(|&i| states[i].clone()).collect();
        let one_sided = |ahead: bool| -> Vec<Vec<f64>> {
            let guess = |&i: &usize| {
                let guess = self.one_sided(&windows[i], ahead, &smoothed[i]);
                guess.unwrap_or_else(|| smoothed[i].clone())
            };
            near.iter().map(guess).collect()
        };
        let mut guesses = vec![of_near(&states), one_sided(true), one_sided(false)];
        if known.is_some() {
            guesses.push(of_near(&smoothed));
        }
        let best = self.explaining(hybrid, theta, &near_windows, &guesses);
        for (&i, best) in near.iter().zip(best) {
            states[i] = best[..visible].to_vec();
        }
        for state in &mut states {
            hybrid.keep_before_stops(theta, state);
        }
        states
    }

    /// Whether a coordinate may be or have been at its stop within [`NEAR_S`] of a state (q, v).
    fn is_near_a_stop(&self, hybrid: &Hybrid, theta: &[f64], state: &[f64]) -> bool {
        let mut places = hybrid.stops(theta);
        places.any(|(c, places)| {
            let near = |place: f64| {
                (state[c] - place).abs() < self.pace.long(NEAR_S) * self.scales[c].speed
            };
            places.into_iter().flatten().any(near)
        })
    }

    /// Of some guesses of the states (q, v) at the start of all windows, those from which a model at θ explains each window best: fitted a little, with the
    /// hidden states.
    fn explaining(
        &self,
        hybrid: &Hybrid,
        theta: &[f64],
        windows: &[Window],
        guesses: &[Vec<Vec<f64>>],
    ) -> Vec<Vec<f64>> {
        if windows.is_empty() {
            return Vec::new();
        }
        let substeps = self.substeps_for(hybrid, theta);
        let paths = self.hidden_paths(hybrid, theta, substeps);
        let hidden = self.hidden_prior(hybrid, (theta, true), windows, &paths);
        let channels = &self.observations.channels;
        let options = FitOptions {
            substeps,
            iterations: 0,
            state_iterations: COMPARING,
        };
        let mut best: Vec<(f64, Vec<f64>)> = vec![(f64::INFINITY, Vec::new()); windows.len()];
        for guess in guesses {
            let whole = |(guess, h): (&Vec<f64>, &Vec<f64>)| {
                let mut state = [&guess[..], h].concat();
                hybrid.keep_before_stops(theta, &mut state);
                state
            };
            let fitted = fit(
                hybrid,
                &self.observations,
                windows,
                &[],
                theta.to_vec(),
                guess.iter().zip(&hidden.means).map(whole).collect(),
                self.observations.noise(),
                &hidden,
                &options,
            );
            let found = fitted.squares.iter().zip(fitted.states);
            for ((squares, state), best) in found.zip(&mut best) {
                let of_channel =
                    |((sum, _), channel): (&(f64, usize), &Channel)| sum / channel.noise.powi(2);
                let misfit: f64 = squares.iter().zip(channels).map(of_channel).sum();
                if best.1.is_empty() || misfit < best.0 {
                    *best = (misfit, state);
                }
            }
        }
        best.into_iter().map(|(_, state)| state).collect()
    }

    /// The state (q, v) at the start of a window by parabolas through the samples on one side, angles near those of `smoothed`.
    fn one_sided(&self, window: &Window, ahead: bool, smoothed: &[f64]) -> Option<Vec<f64>> {
        let (run, k) = (&self.observations.runs[window.run], window.first);
        let samples = match ahead {
            true => k..(k + ONE_SIDE).min(run.t.len()),
            false => (k + 1).saturating_sub(ONE_SIDE)..k + 1,
        };
        let n = smoothed.len() / 2;
        let mut state = smoothed.to_vec();
        for c in 0..n {
            let wraps = self.observations.channels[c].wraps;
            let near = |j: usize| match wraps {
                true => wrap_angle(run.y[c][j] - smoothed[c]),
                false => run.y[c][j] - smoothed[c],
            };
            let valid = samples.clone().filter(|&j| run.valid[c][j]);
            let x = polynomial::<3>(valid.map(|j| (run.t[j] - run.t[k], near(j))))?;
            state[c] += x[0];
            state[n + c] = x[1];
        }
        Some(state)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::fmt::Write as _;

    use super::super::setup::prepare;
    use super::super::{Means, audit};
    use super::*;
    use crate::bins::pseudo;
    use crate::log::Log;
    use crate::model::Model;

    const DT: f64 = 0.02;
    const SPEED: f64 = 0.3;

    /// Place and velocity of what goes to and fro between hard stops at ±0.1 m without loss.
    fn triangle(t: f64) -> (f64, f64) {
        let way = SPEED * t % 0.4;
        match way < 0.2 {
            true => (way - 0.1, SPEED),
            false => (0.3 - way, -SPEED),
        }
    }

    #[test]
    fn a_window_that_begins_beside_a_blow_starts_with_the_speed_on_its_side() {
        let dir = tempfile::tempdir().unwrap();
        let (model, data) = (dir.path().join("slide.toml"), dir.path().join("log.csv"));
        let mut log = "t,q.x\n".to_owned();
        for k in 0..1500 {
            let t = DT * k as f64;
            writeln!(log, "{t},{}", triangle(t).0 + 1e-4 * pseudo(k, 0.1)).unwrap();
        }
        let text = "name = \"slide\"\n\
            lagrangian = { coordinates = [\"x\"], kinetic = \"0.5*x_dot^2\", potential = \"0\" }\n\
            [sensor.x]\nposition_noise = 1e-4\nvelocity = \"none\"\n\
            [[effect]]\nkind = \"end_stop\"\njoint = \"x\"\nlower = -0.1\nupper = 0.1\nstiffness = 1e6\ndamping = 0.0\n";
        std::fs::write(&model, text).unwrap();
        std::fs::write(&data, log).unwrap();
        let model = Model::load(&model).unwrap();
        let log = Log::read(&data, &model).unwrap();
        let audited = audit::audit(&model, &[log], &[]);
        let means = Means::default();
        let prepared = prepare(&model, audited.observations, 1, &audited.masked, &means);
        let study = prepared.unwrap().study;
        let hybrid = Hybrid::of(&model);
        let windows: Vec<Window> = (20..60)
            .map(|first| Window {
                run: 0,
                first,
                count: 25,
            })
            .collect();
        let starts = study.starts(&hybrid, &hybrid.theta(), &windows, None);
        let (mut wrong, mut smoothed_wrong) = (0, 0);
        for (window, start) in windows.iter().zip(starts) {
            let (x, v) = triangle(DT * window.first as f64);
            let is_wrong = |state: &[f64]| (state[1] - v).abs() > 0.03;
            wrong += usize::from(is_wrong(&start));
            smoothed_wrong += usize::from(is_wrong(&study.smoothed[0].state(window.first)));
            assert!((start[0] - x).abs() < 2e-3, "{start:?} for {x}, {v}");
        }
        assert!(smoothed_wrong >= 3, "{smoothed_wrong}");
        assert_eq!(wrong, 0);
    }
}
