//! The windows of an evaluation, and their roll-outs.

use rayon::prelude::*;

use super::{GAP, Options, WORK};
use crate::Error;
use crate::entries::refuse_poses;
use crate::free_run::{FreeRun, Initial, initial_states};
use crate::hybrid::{DrivenInputs, Hybrid, Reading};
use crate::log::{Log, Run, typical_interval};
use crate::model::{Model, Velocity};
use crate::past::{States, states_by_the_past};
use crate::shooting::{Trajectory, wrap_angle};

/// A measured signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Channel {
    pub coordinate: usize,
    pub velocity: bool,
}

impl Channel {
    /// Its place in the state (q, v) of a mechanism with so many velocities, as many as it has positions.
    pub fn entry(self, nv: usize) -> usize {
        self.coordinate + usize::from(self.velocity) * nv
    }

    /// As logs call it.
    pub fn name(self, model: &Model) -> String {
        let what = if self.velocity { "v" } else { "q" };
        let coordinate = model.mechanics.coordinates().get(self.coordinate);
        format!("{what}.{}", coordinate.map_or("", |c| c.name.as_str()))
    }
}

/// All positions, and the velocities that every recording has.
fn channels(model: &Model, runs: &[&Run]) -> Vec<Channel> {
    let n = model.mechanics.nv();
    let channel = |velocity| {
        move |coordinate| Channel {
            coordinate,
            velocity,
        }
    };
    let measured = |c: &usize| {
        runs.iter()
            .all(|run| run.v.get(*c).is_some_and(Option::is_some))
    };
    (0..n)
        .map(channel(false))
        .chain((0..n).filter(measured).map(channel(true)))
        .collect()
}

/// Where a window is: run, first sample, number of samples.
type Place = (usize, usize, usize);

/// The places of the windows: evenly spread over all that are possible, of which none begins before the `earliest` sample of its recording. No window
/// spans a gap.
pub(crate) fn places(
    runs: &[&Run],
    options: &Options,
    earliest: impl Fn(&Run) -> usize,
) -> Vec<Place> {
    let mut possible = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        let Some(typical) = typical_interval(&run.t) else {
            continue;
        };
        let steps = steps(options.horizon, typical);
        if steps >= run.len() as f64 {
            continue;
        }
        let count = steps as usize + 1;
        let mut since_gap = 0; // samples since the last gap, this one included
        for k in earliest(run)..run.len() {
            let gap = k > 0 && run.t[k] - run.t[k - 1] > GAP * typical;
            since_gap = if gap { 1 } else { since_gap + 1 };
            if since_gap >= count {
                possible.push((index, k + 1 - count, count));
            }
        }
    }
    let n = options.windows.min(possible.len());
    (0..n)
        .filter_map(|i| possible.get(i * possible.len() / n).copied())
        .collect()
}

/// Whole intervals in a horizon, at least one.
fn steps(horizon: f64, typical: f64) -> f64 {
    (horizon / typical).round().max(1.0)
}

/// How long the windows of a horizon are in a recording, s: of whole intervals.
pub(super) fn whole_horizon(run: &Run, horizon: f64) -> Option<f64> {
    let typical = typical_interval(&run.t)?;
    let whole = steps(horizon, typical) * typical;
    // Times of samples are rounded.
    let same = (whole - horizon).abs() < 1e-3 * typical;
    Some(if same { horizon } else { whole })
}

/// The windows of an evaluation, and where they begin.
pub(super) struct Windows<'a> {
    model: &'a Model,
    longest_step: f64,
    pub runs: Vec<&'a Run>,
    pub places: Vec<Place>,
    /// What is measured in all of them.
    pub channels: Vec<Channel>,
    begun: States,
}

impl<'a> Windows<'a> {
    /// Windows of `logs`, of which none begins before the `earliest` sample of its recording.
    ///
    /// # Errors
    /// [`Error::NoWindow`] where there is none; [`Error::Floating`] and [`Error::OtherModel`].
    pub fn new(
        model: &'a Model,
        logs: &'a [Log],
        options: &Options,
        earliest: impl Fn(&Run) -> usize,
    ) -> Result<Self, Error> {
        refuse_poses(model.mechanics.coordinates(), WORK)?;
        logs.iter().try_for_each(|log| log.check(model))?;
        let runs: Vec<&Run> = logs.iter().flat_map(|log| &log.runs).collect();
        let places = places(&runs, options, earliest);
        if places.is_empty() {
            return Err(Error::NoWindow {
                horizon: options.horizon,
            });
        }
        Ok(Windows {
            model,
            longest_step: options.longest_step,
            channels: channels(model, &runs),
            begun: beginnings(model, logs, options, &places),
            runs,
            places,
        })
    }

    /// How many begin at the measured state after all.
    pub fn fallen_back(&self) -> usize {
        self.begun.fallen_back
    }

    /// Every window rolled out from its state, and what `of` makes of it, in their order: the same for any number of threads.
    pub fn roll_out<T: Send>(&self, of: impl Fn(&RolledWindow<'_>) -> T + Sync) -> Vec<T> {
        let hybrid = Hybrid::of(self.model);
        let readings = hybrid.readings(&hybrid.theta(), &[]);
        let driven = |run: &&'a Run| FreeRun::new(&hybrid, &run.t, &run.u, self.longest_step);
        let free_runs: Vec<FreeRun> = self.runs.iter().map(driven).collect();
        self.places
            .par_iter()
            .zip(&self.begun.states)
            .map_init(
                Trajectory::default,
                |trajectory, (&(index, first, count), initial)| {
                    let free_run = &free_runs[index];
                    let mut roller = free_run.roller();
                    let rolled = free_run.roll(&mut roller, (first, count), initial, trajectory);
                    of(&RolledWindow {
                        model: self.model,
                        index,
                        run: self.runs[index],
                        inputs: free_run.inputs(),
                        first,
                        count,
                        initial,
                        nx: hybrid.nx(),
                        arrived: rolled.is_ok(),
                        states: &trajectory.states,
                        readings: &readings,
                    })
                },
            )
            .collect()
    }
}

/// The states that the windows start from.
fn beginnings(model: &Model, logs: &[Log], options: &Options, places: &[Place]) -> States {
    if options.initial == Initial::Past {
        let at: Vec<_> = places.iter().map(|place| (place.0, place.1)).collect();
        return states_by_the_past(model, logs, &at, options);
    }
    let hybrid = Hybrid::of(model);
    let states = |run: &Run| {
        let free_run = FreeRun::new(&hybrid, &run.t, &run.u, options.longest_step);
        free_run.with_hidden(initial_states(model, run, options.initial))
    };
    let runs = logs.iter().flat_map(|log| &log.runs);
    let all: Vec<_> = runs.map(states).collect();
    let one = |&(run, first, _): &Place| all[run][first].clone();
    States {
        states: places.iter().map(one).collect(),
        fallen_back: 0,
    }
}

/// A window that has been rolled out.
pub(super) struct RolledWindow<'a> {
    pub model: &'a Model,
    /// Its recording.
    pub index: usize,
    pub run: &'a Run,
    pub inputs: &'a DrivenInputs,
    /// Its first sample, and their number.
    pub first: usize,
    pub count: usize,
    /// Where it begins.
    pub initial: &'a [f64],
    /// Whether it has not diverged.
    pub arrived: bool,
    /// `nx` numbers each, as far as it got.
    pub nx: usize,
    pub states: &'a [f64],
    pub readings: &'a [Reading],
}

impl RolledWindow<'_> {
    /// Time from its first sample to sample `k`, s.
    pub fn since(&self, k: usize) -> f64 {
        self.run.t[self.first + k] - self.run.t[self.first]
    }

    /// What the sensor of a channel would read at sample `k` of the window, from the second on: a velocity that is a backward difference of
    /// positions is one.
    pub fn reads(&self, channel: Channel, k: usize) -> f64 {
        let n = self.model.mechanics.nv();
        let c = channel.coordinate;
        let (reading, places) = (&self.readings[c], (c, n + c));
        let t = &self.run.t[self.first..];
        let position = |k| reading.position(places, self.nx, self.states, t, k).value;
        let velocity = self.model.sensors[c].velocity;
        match channel.velocity {
            false => position(k),
            true if velocity == Velocity::BackwardDifference => {
                (position(k) - position(k - 1)) / (t[k] - t[k - 1])
            }
            true => reading.velocity(places, self.nx, self.states, t, k).value,
        }
    }

    /// Errors of a channel at every sample but the first, simulated less measured, each after its place in the window.
    pub fn errors(&self, channel: Channel, mut each: impl FnMut(usize, f64)) {
        let c = channel.coordinate;
        let wraps = self.model.mechanics.coordinates()[c].wraps;
        for k in 1..self.states.len() / self.nx {
            let reads = self.reads(channel, k);
            let error = match (channel.velocity, &self.run.v[c]) {
                (true, Some(measured)) => reads - measured[self.first + k],
                _ => {
                    let error = reads - self.run.q[c][self.first + k];
                    if wraps { wrap_angle(error) } else { error }
                }
            };
            each(k, error);
        }
    }
}
