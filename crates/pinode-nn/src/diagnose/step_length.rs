//! How long integration steps are, and where they are shorter.
//!
//! Dry friction turns round with its joint within a small part of the time between two samples. Steps that follow it are many times shorter than those that
//! everything else asks for, and they are needed about rests alone: from samples between which a joint turns round, or nearly, they are shorter by a factor
//! of their own. Those alone are halved, or the others alone, where that does as well as half of all; until half of all moves the roll-outs by a small part of
//! the noise.

use std::sync::Arc;

use super::pace::Pace;
use super::smooth::Smoothed;
use super::study::{Fitted, MOST_SUBSTEPS, Study};
use crate::hybrid::Hybrid;
use crate::shooting::{Member, ObservedRun, Trajectory, roll_all};

/// The integration step is halved until that moves the roll-outs by less than this part of the noise.
const STEP_ERROR: f64 = 0.3;
/// … some of them alone where that leaves no more than this part of what half of all changes, as much as is left of that by half of it again.
const AS_WELL: f64 = 0.1;
/// A joint rests that is slower than so many times the speed over which its friction changes sign …
const SLOW: f64 = 4.0;
/// … and what rests in more than this part of the samples has no steps of its own there.
const MOSTLY: f64 = 0.5;

/// The lengths of the steps.
#[derive(Debug, Clone, PartialEq)]
pub struct StepLength {
    /// Steps per log sample.
    pub substeps: usize,
    /// So many times as many about rests.
    pub about_rests: usize,
    /// From which samples of each recording a joint rests or turns round before the next one; none where that is most of them.
    rests: Arc<Vec<Vec<bool>>>,
}

impl StepLength {
    /// That of a first fit to what was observed `interval` s apart.
    pub fn first(hybrid: &Hybrid, smoothed: &[Smoothed], pace: &Pace, interval: f64) -> Self {
        let rests: Vec<Vec<bool>> = smoothed.iter().map(|run| rests(hybrid, run)).collect();
        let count = |which: fn(&bool) -> bool| rests.iter().flatten().filter(|r| which(r)).count();
        let (at_rest, all) = (count(|rests| *rests), count(|_| true));
        let seldom = at_rest > 0 && (at_rest as f64) < MOSTLY * all as f64;
        let substeps = pace.first_steps(interval, hybrid.is_stiff());
        StepLength {
            substeps: substeps.min(MOST_SUBSTEPS),
            about_rests: 1,
            rests: Arc::new(if seldom { rests } else { Vec::new() }),
        }
    }

    /// How many times as many steps are taken from each sample of a recording as from others.
    fn times(&self, run: usize) -> Vec<usize> {
        let of = |rests: &bool| if *rests { self.about_rests } else { 1 };
        match self.rests.get(run) {
            Some(rests) if self.about_rests > 1 => rests.iter().map(of).collect(),
            _ => Vec::new(),
        }
    }
}

/// From which samples on a joint rests or turns round, or is about to.
fn rests(hybrid: &Hybrid, smoothed: &Smoothed) -> Vec<bool> {
    let intervals = smoothed.v.first().map_or(0, |v| v.len().saturating_sub(1));
    let mut rests = vec![false; intervals];
    for (c, v) in smoothed.v.iter().enumerate() {
        let slow = SLOW * hybrid.default_smoothing(c);
        for (rests, pair) in rests.iter_mut().zip(v.windows(2)) {
            let (a, b) = (pair[0], pair[1]);
            *rests |= a * b <= 0.0 || a.abs().min(b.abs()) < slow + 0.5 * (b - a).abs();
        }
    }
    rests
}

impl Study {
    /// The same with so many steps, and times as many about rests.
    pub fn stepped(&self, substeps: usize, about_rests: usize) -> Self {
        let mut study = self.clone();
        (study.steps.substeps, study.steps.about_rests) = (substeps, about_rests);
        for (k, run) in study.observations.runs.iter_mut().enumerate() {
            run.finer = study.steps.times(k);
        }
        study
    }

    /// The study with half of those steps that are too long for a fitted model to be rolled out to a part of these units, one a channel. `None` where none are,
    /// or may be shorter.
    pub fn with_shorter_steps(&self, fitted: &Fitted, units: &[f64]) -> Option<Study> {
        let substeps = self.substeps_for(&fitted.hybrid, &fitted.inside.theta);
        let (each, times) = (self.steps.substeps, self.steps.about_rests);
        // What has a memory or a stop may take more of them than all others: twice those.
        let doubled = 2 * substeps / self.finer;
        if 2 * substeps * times > MOST_SUBSTEPS {
            return None;
        }
        let halved = rolled(self, fitted, 2 * substeps);
        let left = |by: &Study, substeps: usize| {
            let with = rolled(by, fitted, substeps);
            largest_change(self, fitted, (&with, &halved), units)
        };
        let error = left(self, substeps);
        if error <= STEP_ERROR {
            return None;
        }
        // Those of some samples, where that does as well as all.
        let about_rests = self.stepped(each, 2 * times);
        if !self.steps.rests.is_empty() && left(&about_rests, substeps) <= AS_WELL * error {
            return Some(about_rests);
        }
        let elsewhere = self.stepped(doubled, times / 2);
        if times > 1 && left(&elsewhere, 2 * substeps) <= AS_WELL * error {
            return Some(elsewhere);
        }
        Some(self.stepped(doubled, times))
    }

    /// The study with steps as short as they have to be for the same; `None` where it has them, or may have none that are shorter.
    pub fn with_short_steps(&self, fitted: &Fitted, units: &[f64]) -> Option<Study> {
        let shorter = |study: &Study| study.with_shorter_steps(fitted, units);
        std::iter::successors(shorter(self), shorter).last()
    }
}

/// The seen windows with so many steps a sample, where a fitted model has them begin.
pub fn rolled(study: &Study, fitted: &Fitted, substeps: usize) -> Vec<Option<Trajectory>> {
    let (hybrid, theta) = (&fitted.hybrid, &fitted.inside.theta);
    let drive = |run: &ObservedRun| run.drive(hybrid, substeps, theta, &[]);
    let inputs: Vec<_> = study.observations.runs.iter().map(drive).collect();
    let windows = study.windows.fit.iter().zip(&fitted.inside.states);
    let members: Vec<Member> = windows
        .map(|(window, initial)| Member {
            inputs: &inputs[window.run],
            span: (window.first, window.count),
            initial,
        })
        .collect();
    roll_all((hybrid, theta, &[]), &members, false)
}

/// The largest change of a simulated measurement in these units, in all but one window of ten: those near an unstable point magnify every error, and every
/// finding is tried again with half the step. Of a stiff model in half of the windows: the moments at which joints stick take steps that are many times
/// shorter, of order 1.5, for what is in few samples.
fn largest_change(
    study: &Study,
    fitted: &Fitted,
    (one, other): (&[Option<Trajectory>], &[Option<Trajectory>]),
    units: &[f64],
) -> f64 {
    let (nq, nx) = (fitted.hybrid.nq(), fitted.hybrid.nx());
    let channels = &study.observations.channels;
    let of_window = |(a, b): (&Trajectory, &Trajectory)| {
        let mut worst = 0.0_f64;
        for (channel, unit) in channels.iter().zip(units) {
            let place = channel.coordinate + if channel.velocity { nq } else { 0 };
            for (a, b) in a.states.chunks_exact(nx).zip(b.states.chunks_exact(nx)) {
                worst = worst.max((a[place] - b[place]).abs() / unit);
            }
        }
        worst
    };
    let pairs = one.iter().zip(other);
    let both = pairs.filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?)));
    let mut errors: Vec<f64> = both.map(of_window).collect();
    errors.sort_by(f64::total_cmp);
    let counts = match fitted.hybrid.is_stiff() {
        true => errors.len() / 2,
        false => errors.len() * 9 / 10,
    };
    errors.get(counts).copied().unwrap_or(0.0)
}
