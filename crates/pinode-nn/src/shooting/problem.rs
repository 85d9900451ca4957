//! What every part of a fit needs: the model, the windows, and the loss over them.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::eight::{Member, roll_all};
use super::normal::{Accumulator, Residual, fill_row, huber_loss};
use super::{Observations, Reduced, Trajectory, Window};
use crate::hybrid::{DrivenInputs, Hybrid, Reading};

/// The loss of a window whose roll-out diverges.
const DIVERGED_LOSS: f64 = 1e9;
/// The acceleration before a window is taken to be that of its first interval for this part of one.
const GOES_ON: f64 = 0.1;
/// No more than this part of a window is lost to a late sensor.
const MOST_LOST: f64 = 0.5;
/// A step of θ that lowers the loss may raise that of a window by so many nats and this share of it: the others gain more.
const RISE: (f64, f64) = (3.0, 0.05);

/// A window's initial state and the roll-out from it.
#[derive(Debug, Clone)]
pub(crate) struct Rolled {
    pub state: Vec<f64>,
    /// Channel and y − ŷ of every valid measurement; none where the roll-out diverges.
    pub residuals: Option<Vec<(usize, f64)>>,
    /// What the initial state costs by its prior: ½ Σ ((h − mean)/spread)².
    pub prior: f64,
    /// The roll-out with its derivatives, where it was taken with them.
    pub trajectory: Option<Trajectory>,
}

/// What is known of the states h of effects with a memory at the start of windows: means and standard deviations.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HiddenPrior {
    /// nh numbers a window.
    pub means: Vec<Vec<f64>>,
    /// nh numbers a window.
    pub spreads: Vec<Vec<f64>>,
}

impl HiddenPrior {
    /// Nothing is hidden in any of the windows.
    pub fn none(windows: usize) -> Self {
        HiddenPrior {
            means: vec![Vec::new(); windows],
            spreads: vec![Vec::new(); windows],
        }
    }

    /// Nothing of what effects with a memory remember is fitted: it stays as it is in these states, of which the first `visible` entries are q and v.
    pub(crate) fn kept(states: &[Vec<f64>], visible: usize) -> Self {
        let width = |h: &f64| 1e-6 * h.abs() + 1e-12;
        let hidden = states.iter().map(|state| &state[visible..]);
        HiddenPrior {
            means: hidden.clone().map(<[f64]>::to_vec).collect(),
            spreads: hidden.map(|h| h.iter().map(width).collect()).collect(),
        }
    }

    /// What is known in some of the windows.
    pub(crate) fn some(&self, windows: &[usize]) -> Self {
        let of = |all: &[Vec<f64>]| windows.iter().map(|&window| all[window].clone()).collect();
        HiddenPrior {
            means: of(&self.means),
            spreads: of(&self.spreads),
        }
    }

    /// (entry of h, 1/spread, (mean − h)/spread) for a window with these h.
    fn of<'a>(
        &'a self,
        window: usize,
        h: &'a [f64],
    ) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
        let spreads = &self.spreads[window];
        let own = self.means[window].iter().zip(spreads).zip(h);
        own.enumerate()
            .map(|(i, ((mean, spread), h))| (i, 1.0 / spread, (mean - h) / spread))
    }
}

impl Rolled {
    pub fn loss(&self, sigma: &[f64]) -> f64 {
        match &self.residuals {
            Some(residuals) => {
                residuals
                    .iter()
                    .map(|&(c, r)| huber_loss(r / sigma[c]))
                    .sum::<f64>()
                    + self.prior
            }
            None => DIVERGED_LOSS,
        }
    }

    /// Sum of squared residuals and their number, one a channel; infinite where the roll-out diverges.
    pub fn squares(&self, channels: usize) -> Vec<(f64, usize)> {
        let Some(residuals) = &self.residuals else {
            return vec![(f64::INFINITY, 0); channels];
        };
        let mut squares = vec![(0.0, 0); channels];
        for &(c, r) in residuals {
            squares[c].0 += r * r;
            squares[c].1 += 1;
        }
        squares
    }
}

/// One fit's fixed surroundings.
pub(crate) struct Problem<'a> {
    pub hybrid: &'a Hybrid,
    pub observations: &'a Observations,
    pub windows: &'a [Window],
    pub free: &'a [usize],
    pub hidden: &'a HiddenPrior,
    pub substeps: usize,
    /// How late each coordinate is read, s: what was before a window's first sample is not known, and what is read of it does not count. Empty where all
    /// counts. It stays as it is while a fit moves the delay.
    pub late: &'a [f64],
}

/// How late each coordinate is read at θ, s.
pub(crate) fn late(hybrid: &Hybrid, theta: &[f64]) -> Vec<f64> {
    let readings = hybrid.readings(theta, &[]);
    readings.into_iter().map(|reading| reading.delay).collect()
}

impl<'a> Problem<'a> {
    pub fn new(
        hybrid: &'a Hybrid,
        observations: &'a Observations,
        windows: &'a [Window],
        free: &'a [usize],
        hidden: &'a HiddenPrior,
        substeps: usize,
    ) -> Self {
        Problem {
            hybrid,
            observations,
            windows,
            free,
            hidden,
            substeps,
            late: &[],
        }
    }

    /// The same where coordinates are read so late.
    pub fn read_late(self, late: &'a [f64]) -> Self {
        Problem { late, ..self }
    }

    pub fn drive(&self, theta: &[f64]) -> Vec<DrivenInputs> {
        self.observations
            .runs
            .iter()
            .map(|run| run.drive(self.hybrid, self.substeps, theta, self.free))
            .collect()
    }

    pub fn readings(&self, theta: &[f64]) -> Vec<Reading> {
        self.hybrid.readings(theta, self.free)
    }

    /// Whether a channel reads, at a sample of a window, what was before it: further before than the acceleration there may be taken to go on.
    fn reads_before(&self, t: &[f64], sample: usize, channel: usize) -> bool {
        let coordinate = self.observations.channels[channel].coordinate;
        match (self.late.get(coordinate), t) {
            (Some(&late), [first, second, .., last]) => {
                let late = late.min(MOST_LOST * (last - first));
                t[sample] - late < first - GOES_ON * (second - first)
            }
            _ => false,
        }
    }

    /// Squares of a window's residuals as if all that is valid had been read: what does not count is as far off, in the mean, as what does.
    pub fn of_all(&self, window: &Window, squares: Vec<(f64, usize)>) -> Vec<(f64, usize)> {
        if self.late.iter().all(|late| *late == 0.0) {
            return squares;
        }
        let valid = &self.observations.runs[window.run].valid;
        let within = window.first..window.first + window.count;
        let all = |(channel, (sum, n)): (usize, (f64, usize))| match n {
            0 => (sum, n),
            _ => {
                let all = valid[channel][within.clone()]
                    .iter()
                    .filter(|v| **v)
                    .count();
                (sum * all as f64 / n as f64, all)
            }
        };
        squares.into_iter().enumerate().map(all).collect()
    }

    /// The residuals of a window that count.
    pub fn residuals<'b>(
        &'b self,
        window: &'b Window,
        readings: &'b [Reading],
        states: &'b [f64],
    ) -> impl Iterator<Item = Residual> + 'b {
        let run = &self.observations.runs[window.run];
        let channels = &self.observations.channels;
        let sizes = (self.hybrid.nv(), self.hybrid.nx());
        let t = &run.t[window.first..window.first + window.count];
        (0..window.count)
            .flat_map(move |sample| (0..channels.len()).map(move |channel| (sample, channel)))
            .filter(move |&(sample, channel)| run.valid[channel][window.first + sample])
            .filter(move |&(sample, channel)| !self.reads_before(t, sample, channel))
            .map(move |(sample, channel)| {
                let own = &channels[channel];
                let predicted = own.predict(&readings[own.coordinate], sizes, states, t, sample);
                let measured = run.y[channel][window.first + sample];
                Residual {
                    sample,
                    channel,
                    value: own.difference(measured, predicted.value),
                    predicted,
                }
            })
    }

    /// The roll-outs of windows from the given initial states, in their order.
    fn roll_out(&self, at: &At, starts: Vec<(usize, Vec<f64>)>, derivatives: bool) -> Vec<Rolled> {
        let members: Vec<Member> = starts
            .iter()
            .map(|(index, initial)| {
                let Window { run, first, count } = self.windows[*index];
                Member {
                    inputs: &at.inputs[run],
                    span: (first, count),
                    initial,
                }
            })
            .collect();
        let trajectories = roll_all((self.hybrid, at.theta, self.free), &members, derivatives);
        starts
            .into_par_iter()
            .zip(trajectories)
            .map(|((index, state), trajectory)| {
                let residuals = trajectory.as_ref().map(|trajectory| {
                    self.residuals(&self.windows[index], &at.readings, &trajectory.states)
                        .map(|r| (r.channel, r.value))
                        .collect()
                });
                let hidden = &state[self.hybrid.nx() - self.hybrid.nh()..];
                let prior = self.hidden.of(index, hidden);
                Rolled {
                    prior: prior.map(|(.., r)| 0.5 * r * r).sum(),
                    trajectory: trajectory.filter(|_| derivatives),
                    residuals,
                    state,
                }
            })
            .collect()
    }

    /// Reduced equations of all windows at (θ, states), from the roll-outs of `present`, which are taken with derivatives where they are
    /// without; `None` where they diverge.
    pub fn reduced(
        &self,
        theta: &[f64],
        present: &mut [Rolled],
        sigma: &[f64],
    ) -> Vec<Option<Reduced>> {
        let nx = self.hybrid.nx();
        let columns = nx + self.free.len();
        let without: Vec<(usize, Vec<f64>)> = present
            .iter()
            .enumerate()
            .filter(|(_, rolled)| rolled.trajectory.is_none() && rolled.residuals.is_some())
            .map(|(index, rolled)| (index, rolled.state.clone()))
            .collect();
        let places: Vec<usize> = without.iter().map(|(index, _)| *index).collect();
        let at = self.at(theta);
        for (index, rolled) in places.into_iter().zip(self.roll_out(&at, without, true)) {
            present[index].trajectory = rolled.trajectory;
        }
        self.windows
            .par_iter()
            .enumerate()
            .zip(&*present)
            .map_init(
                || vec![0.0; columns],
                |row, ((index, window), present)| {
                    let trajectory = present.trajectory.as_ref()?;
                    let mut normal = Accumulator::new(nx, self.free.len());
                    for r in self.residuals(window, &at.readings, &trajectory.states) {
                        let scale = 1.0 / sigma[r.channel];
                        self.fill_row(row, &r, &at.readings, scale, trajectory);
                        normal.add(row, r.value * scale);
                    }
                    self.add_prior(index, &present.state, &mut normal);
                    normal.finish().reduce()
                },
            )
            .collect()
    }

    /// ∂ŷ/σ of one residual in the initial state and in θ_free.
    pub fn fill_row(
        &self,
        row: &mut [f64],
        residual: &Residual,
        readings: &[Reading],
        scale: f64,
        trajectory: &Trajectory,
    ) {
        let channel = &self.observations.channels[residual.channel];
        let reading = &readings[channel.coordinate];
        let nx = self.hybrid.nx();
        fill_row(
            row,
            residual,
            reading,
            !channel.velocity,
            (nx, scale),
            trajectory,
        );
    }

    /// Adds what is known of the hidden part of the initial `state` of a window.
    pub fn add_prior(&self, window: usize, state: &[f64], normal: &mut Accumulator) {
        let first = self.hybrid.nx() - self.hybrid.nh();
        for (i, weight, r) in self.hidden.of(window, &state[first..]) {
            normal.add_prior(first + i, weight * weight, r);
        }
    }

    /// The roll-outs from the given initial states, with derivatives where these stay within bounds.
    pub fn rolled(&self, theta: &[f64], states: Vec<Vec<f64>>) -> Vec<Rolled> {
        let at = self.at(theta);
        let starts = states.into_iter().enumerate().collect();
        let mut rolled = self.roll_out(&at, starts, true);
        let without: Vec<(usize, Vec<f64>)> = rolled
            .iter()
            .enumerate()
            .filter(|(_, rolled)| rolled.residuals.is_none())
            .map(|(index, rolled)| (index, rolled.state.clone()))
            .collect();
        let places: Vec<usize> = without.iter().map(|(index, _)| *index).collect();
        for (index, own) in places.into_iter().zip(self.roll_out(&at, without, false)) {
            rolled[index] = own;
        }
        rolled
    }

    /// The roll-outs after a step of every initial state: the full one where it does not raise the loss above the present one, or not by more
    /// than [`RISE`] in a step that lowers all together, else the best of full, short and none. A full step is rolled out with derivatives: most
    /// often the next equations are made there.
    ///
    /// `relief` is by how much θ has come closer to what was known of it, nats; none where θ has made no step, and each window has to gain
    /// by itself.
    pub fn stepped(
        &self,
        theta: &[f64],
        present: &[Rolled],
        steps: &[Option<DVector<f64>>],
        sigma: &[f64],
        relief: Option<f64>,
    ) -> Vec<Rolled> {
        let at = self.at(theta);
        let mut limits: Vec<f64> = present.iter().map(|rolled| rolled.loss(sigma)).collect();
        let mut best: Vec<Option<(f64, Rolled)>> = vec![None; present.len()];
        for fraction in [1.0, 0.3, 0.0] {
            let starts: Vec<(usize, Vec<f64>)> = present
                .iter()
                .zip(steps)
                .enumerate()
                .filter(|(index, _)| {
                    let best = best[*index].as_ref();
                    best.is_none_or(|(loss, _)| *loss > limits[*index])
                })
                .filter_map(|(index, (present, step))| {
                    let mut state = present.state.clone();
                    match step {
                        Some(step) => {
                            for (x, d) in state.iter_mut().zip(step.iter()) {
                                *x += fraction * d;
                            }
                        }
                        None if fraction > 0.0 => return None,
                        None => {}
                    }
                    Some((index, state))
                })
                .collect();
            let indices: Vec<usize> = starts.iter().map(|(index, _)| *index).collect();
            let rolled = self.roll_out(&at, starts, fraction == 1.0);
            for (index, rolled) in indices.into_iter().zip(rolled) {
                let loss = rolled.loss(sigma);
                if best[index].as_ref().is_none_or(|(least, _)| loss < *least) {
                    best[index] = Some((loss, rolled));
                }
            }
            if fraction == 1.0 && relief.is_some_and(|relief| lowers(&best, &limits, relief)) {
                limits.iter_mut().for_each(|l| *l += RISE.0 + RISE.1 * *l);
            }
        }
        best.into_iter()
            .zip(present)
            .map(|(best, present)| match best {
                Some((_, rolled)) => rolled,
                // Its derivatives may be in other columns.
                None => Rolled {
                    trajectory: None,
                    ..present.clone()
                },
            })
            .collect()
    }

    /// The roll-outs after a step of every initial state by its reduced equations, while θ stays.
    pub fn stepped_alone(
        &self,
        theta: &[f64],
        present: &[Rolled],
        reduced: Vec<Option<Reduced>>,
        sigma: &[f64],
    ) -> Vec<Rolled> {
        let steps: Vec<_> = reduced
            .into_iter()
            .map(|r| r.map(|r| r.state_step))
            .collect();
        self.stepped(theta, present, &steps, sigma, None)
    }

    fn at<'b>(&self, theta: &'b [f64]) -> At<'b> {
        At {
            theta,
            inputs: self.drive(theta),
            readings: self.readings(theta),
        }
    }

    /// Loss of all windows, and of the priors.
    pub fn total(&self, theta: &[f64], now: &[Rolled], sigma: &[f64]) -> f64 {
        self.prior_loss(theta) + now.iter().map(|w| w.loss(sigma)).sum::<f64>()
    }

    /// Loss of the priors: Σ ½ ((θ − θ₀)/tolerance)².
    pub fn prior_loss(&self, theta: &[f64]) -> f64 {
        self.free
            .iter()
            .map(|&i| {
                let constant = &self.hybrid.constants()[i];
                0.5 * ((theta[i] - constant.value) / constant.tolerance).powi(2)
            })
            .sum()
    }

    /// Information and gradient in θ_free over all windows, priors included.
    pub fn assemble(
        &self,
        theta: &[f64],
        reduced: &[Option<Reduced>],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.free.len();
        let mut s = DMatrix::zeros(n, n);
        let mut g = DVector::zeros(n);
        for window in reduced.iter().flatten() {
            s += &window.s;
            g += &window.g;
        }
        for (k, &i) in self.free.iter().enumerate() {
            let constant = &self.hybrid.constants()[i];
            if constant.tolerance.is_finite() {
                let weight = 1.0 / constant.tolerance.powi(2);
                s[(k, k)] += weight;
                g[k] -= weight * (theta[i] - constant.value);
            }
        }
        (s, g)
    }
}

/// Whether all windows together have lost less than `relief`.
fn lowers(stepped: &[Option<(f64, Rolled)>], present: &[f64], relief: f64) -> bool {
    let losses = stepped.iter().zip(present);
    let rise = losses.map(|(stepped, present)| stepped.as_ref().map_or(0.0, |s| s.0 - present));
    rise.sum::<f64>() < relief
}

/// θ, and what follows from it for all windows.
struct At<'a> {
    theta: &'a [f64],
    inputs: Vec<DrivenInputs>,
    readings: Vec<Reading>,
}
