//! The members of an ensemble beside the windows of an evaluation.

use super::Options;
use super::windows::{Channel, RolledWindow, Windows};
use crate::Error;
use crate::free_run::FreeRun;
use crate::hybrid::Hybrid;
use crate::log::{Log, Run};
use crate::model::Model;
use crate::shooting::Trajectory;
use crate::spread::spread;

/// The members of the ensemble of a model; none where it has none.
pub(super) fn members(model: &Model) -> Vec<Hybrid> {
    match model.has_ensemble() {
        true => model.members().iter().map(Hybrid::of).collect(),
        false => Vec::new(),
    }
}

/// Members under the inputs of recordings.
pub(super) struct Driven<'a> {
    /// One a member and recording.
    of_members: Vec<Vec<FreeRun<'a>>>,
}

impl<'a> Driven<'a> {
    pub fn new(members: &'a [Hybrid], runs: &[&'a Run], longest_step: f64) -> Self {
        let of = |member: &'a Hybrid| {
            let driven = |run: &&'a Run| FreeRun::new(member, &run.t, &run.u, longest_step);
            runs.iter().map(driven).collect()
        };
        Driven {
            of_members: members.iter().map(of).collect(),
        }
    }

    /// How far the members are apart in a window, one row of states a sample from the second on: the first state is given. None where one of them diverges.
    pub fn apart(&self, window: &RolledWindow<'_>) -> Vec<Vec<f64>> {
        let mut rolled = Vec::new();
        let mut trajectory = Trajectory::default();
        let span = (window.first, window.count);
        for free_run in self.of_members.iter().filter_map(|m| m.get(window.index)) {
            let mut roller = free_run.roller();
            let arrived = free_run.roll(&mut roller, span, window.initial, &mut trajectory);
            if arrived.is_err() {
                return Vec::new();
            }
            let states = trajectory.states.chunks_exact(window.nx);
            rolled.push(states.map(<[f64]>::to_vec).collect::<Vec<_>>());
        }
        spread(&rolled).into_iter().skip(1).collect()
    }
}

/// A sample of a free run of an ensemble.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Deviation {
    /// Time since the run began, s.
    pub since: f64,
    /// How far the members are apart.
    pub spread: f64,
    /// What is simulated less what is measured.
    pub error: f64,
}

/// The free runs of an ensemble over windows of logs.
pub(crate) struct Deviations {
    /// What is measured, and its samples in all windows.
    pub of_channels: Vec<(Channel, Vec<Deviation>)>,
    /// The windows in which the mean and all members arrive, and the others.
    pub arrived: usize,
    pub diverged: usize,
    /// So many windows fit into the logs that share no sample.
    pub apart: usize,
}

/// Rolls the ensemble of `model` out over windows of `logs`, of which none begins before the `earliest` sample of its recording.
///
/// # Errors
/// [`Error::NoEnsemble`], [`Error::NoWindow`] and those of [`evaluate`](super::evaluate) about logs of other models.
pub(crate) fn deviations(
    model: &Model,
    logs: &[Log],
    options: &Options,
    earliest: impl Fn(&Run) -> usize,
) -> Result<Deviations, Error> {
    if !model.has_ensemble() {
        return Err(Error::NoEnsemble {
            path: model.path.clone(),
        });
    }
    let windows = Windows::new(model, logs, options, earliest)?;
    let members = members(model);
    let driven = Driven::new(&members, &windows.runs, options.longest_step);
    let nv = model.mechanics.nv();
    let of_windows = windows.roll_out(|window| {
        let apart = driven.apart(window);
        if !window.arrived || apart.is_empty() {
            return None;
        }
        let list = |channel: &Channel| {
            let mut list = Vec::with_capacity(apart.len());
            window.errors(*channel, |k, error| {
                list.push(Deviation {
                    since: window.since(k),
                    spread: apart[k - 1][channel.entry(nv)],
                    error,
                });
            });
            list
        };
        Some(windows.channels.iter().map(list).collect::<Vec<_>>())
    });
    let channels = windows.channels.iter();
    let mut of_channels: Vec<_> = channels.map(|c| (*c, Vec::new())).collect();
    let (mut arrived, mut apart) = (0, 0);
    let mut last = (usize::MAX, 0);
    for (window, &(run, first, count)) in of_windows.iter().zip(&windows.places) {
        if last.0 != run || first >= last.1 {
            apart += 1;
            last = (run, first + count);
        }
        let Some(window) = window else {
            continue;
        };
        arrived += 1;
        for ((_, all), own) in of_channels.iter_mut().zip(window) {
            all.extend(own);
        }
    }
    Ok(Deviations {
        of_channels,
        arrived,
        diverged: windows.places.len() - arrived,
        apart,
    })
}
