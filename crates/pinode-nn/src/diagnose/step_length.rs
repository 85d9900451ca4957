//! How long integration steps are, and where they are shorter.
//!
//! Dry friction turns round with its joint within a small part of the time between two samples. Steps that follow it are many times shorter than those that
//! everything else asks for, and they are needed about rests alone: from samples between which a joint turns round, or nearly, they are shorter by a factor
//! of their own. Those alone are halved, or the others alone, where that does as well as half of all; until half of all moves the roll-outs by a small part of
//! the noise. Blows on an end of a range are shorter still, and where they are the log says: there models with stops take shorter steps from the beginning.

use std::sync::Arc;

use super::pace::Pace;
use super::smooth::Smoothed;
use super::study::{Fitted, MOST_SUBSTEPS, Study};
use crate::effect::Scales;
use crate::hybrid::{Hybrid, Placed};
use crate::shooting::{Finer, Member, Observations, ObservedRun, Trajectory, roll_all};

/// The integration step is halved until that moves the roll-outs by less than this part of the noise.
const STEP_ERROR: f64 = 0.3;
/// … some of them alone where that leaves no more than this part of what half of all changes, as much as is left of that by half of it again.
const AS_WELL: f64 = 0.1;
/// A joint rests that is slower than so many times the speed over which its friction changes sign …
const SLOW: f64 = 4.0;
/// … and what rests, or is struck, in more than this part of the samples has no steps of its own there.
const MOSTLY: f64 = 0.5;
/// Runge-Kutta steps of order 4 follow what comes to rest at a rate of so many of them (Hairer & Wanner, *Solving ODEs II*, IV.2: 2.785).
const STABLE: f64 = 2.7;
/// Where blows are, models with stops begin with so many times as many steps as are taken elsewhere at first: from samples no further from the end than what
/// strikes it goes in so many intervals, and so many times the noise.
const ABOUT_BLOWS: usize = 8;
const NEAR: (f64, f64) = (1.5, 5.0);

/// The lengths of the steps.
#[derive(Debug, Clone, PartialEq)]
pub struct StepLength {
    /// Steps per log sample.
    pub substeps: usize,
    /// So many times as many about rests.
    pub about_rests: usize,
    /// Of models with stops, per log sample where blows are, with these steps elsewhere: of shorter ones there are in proportion. As many as elsewhere where there
    /// are none, or hardly anything else.
    of_blows: usize,
    /// From which samples of each recording a joint rests or turns round before the next one; none where that is most of them.
    rests: Arc<Vec<Vec<bool>>>,
    /// From which a joint may strike an end of its range before the next one; the same.
    blows: Arc<Vec<Vec<bool>>>,
}

impl StepLength {
    /// That of a first fit to what was observed `interval` s apart, in which coordinates move on these scales.
    pub fn first(
        hybrid: &Hybrid,
        smoothed: &[Smoothed],
        (observations, scales): (&Observations, &[Scales]),
        pace: &Pace,
        interval: f64,
    ) -> Self {
        let rests = smoothed.iter().map(|run| rests(hybrid, run)).collect();
        let blows = observations.runs.iter().map(|run| blows(run, scales));
        let blows = seldom(blows.collect());
        let substeps = pace
            .first_steps(interval, hybrid.is_stiff())
            .min(MOST_SUBSTEPS);
        StepLength {
            substeps,
            about_rests: 1,
            of_blows: MOST_SUBSTEPS.min(ABOUT_BLOWS * substeps),
            rests: Arc::new(seldom(rests)),
            blows: Arc::new(blows),
        }
    }

    /// So many times as many where blows are as elsewhere.
    fn about_blows(&self) -> usize {
        match self.blows.is_empty() {
            true => 1,
            false => self.of_blows.div_ceil(self.substeps).max(1),
        }
    }

    /// From which samples of a recording steps are shorter.
    fn finer(&self, run: usize) -> Finer {
        let of = |there: &[Vec<bool>], times: usize| -> Vec<usize> {
            let of = |there: &bool| if *there { times } else { 1 };
            match there.get(run) {
                Some(there) if times > 1 => there.iter().map(of).collect(),
                _ => Vec::new(),
            }
        };
        let usual = of(&self.rests, self.about_rests);
        let mut of_stops = of(&self.blows, self.about_blows());
        match of_stops.is_empty() {
            true => of_stops.clone_from(&usual),
            false => {
                let both = of_stops.iter_mut().zip(&usual);
                both.for_each(|(blow, rest)| *blow = (*blow).max(*rest));
            }
        }
        Finer { usual, of_stops }
    }
}

/// Of each recording what is in some of the samples, but not in most; else nothing.
fn seldom(there: Vec<Vec<bool>>) -> Vec<Vec<bool>> {
    let count = |which: fn(&bool) -> bool| there.iter().flatten().filter(|t| which(t)).count();
    let (some, all) = (count(|there| *there), count(|_| true));
    match some > 0 && (some as f64) < MOSTLY * all as f64 {
        true => there,
        false => Vec::new(),
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

/// From which samples on a joint may strike what its log shows it to strike.
fn blows(run: &ObservedRun, scales: &[Scales]) -> Vec<bool> {
    let mut blows = vec![false; run.t.len().saturating_sub(1)];
    for (scales, y) in scales.iter().zip(&run.y) {
        for end in scales.struck.iter().flatten() {
            for (k, blows) in blows.iter_mut().enumerate() {
                let way = NEAR.0 * end.speed * (run.t[k + 1] - run.t[k]);
                let near = |y: f64| (y - end.place).abs() < way + NEAR.1 * scales.noise;
                *blows |= near(y[k]) || near(y[k + 1]);
            }
        }
    }
    blows
}

impl Study {
    /// The same with steps of these lengths.
    pub fn with_steps(&self, steps: StepLength) -> Self {
        let mut study = self.clone();
        study.steps = steps;
        for (k, run) in study.observations.runs.iter_mut().enumerate() {
            run.finer = study.steps.finer(k);
        }
        study
    }

    /// The same with so many steps, and times as many about rests.
    fn stepped(&self, substeps: usize, about_rests: usize) -> Self {
        self.with_steps(StepLength {
            substeps,
            about_rests,
            ..self.steps.clone()
        })
    }

    /// The same with half of the steps where blows are.
    pub fn with_shorter_blows(&self) -> Self {
        match self.steps.blows.is_empty() {
            true => self.with_half_the_steps(),
            false => self.with_steps(StepLength {
                of_blows: 2 * self.steps.of_blows,
                ..self.steps.clone()
            }),
        }
    }

    /// So many times as many steps a model takes where it is struck as elsewhere: its stops may be where the log shows no blows.
    pub fn steps_of_blows(&self, hybrid: &Hybrid) -> usize {
        let mut stops = hybrid.effects().iter().filter(|e| e.kind.stop().is_some());
        let scales = |e: &Placed| &self.scales[hybrid.coordinate_of(e.kind, e.target)];
        match hybrid.has_stops() && stops.all(|stop| scales(stop).struck != [None; 2]) {
            true => self.steps.about_blows(),
            false => 1,
        }
    }

    /// The study with half of those steps that are too long for a fitted model to rest, or to be rolled out to a part of these units, one a channel. `None` where none are,
    /// or may be shorter.
    pub fn with_shorter_steps(&self, fitted: &Fitted, units: &[f64]) -> Option<Study> {
        let (hybrid, theta) = (&fitted.hybrid, &fitted.inside.theta);
        if let Some(shorter) = self.at_rest(hybrid, theta) {
            return Some(shorter);
        }
        let substeps = self.substeps_for(hybrid, theta);
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

    /// Whether explicit steps about rests are too long for the dry friction of a model at θ. Beyond [`STABLE`] a joint that sticks goes to and fro in them within the range of speeds
    /// over which its friction changes sign: that moves it by little, but what follows of it is chance, and derivatives of that grow beyond all measure.
    fn is_restless(&self, hybrid: &Hybrid, theta: &[f64]) -> bool {
        let finest = self.substeps_for(hybrid, theta) * self.steps.about_rests;
        let rate = self.interval * hybrid.fastest_friction(theta);
        let is_too_fast = rate > STABLE * MOST_SUBSTEPS as f64;
        !hybrid.is_stiff() && rate > STABLE * finest as f64 && !is_too_fast
    }

    /// The study with steps about rests that are short enough for the dry friction of a model at θ; `None` where they are, and where none would be.
    pub fn at_rest(&self, hybrid: &Hybrid, theta: &[f64]) -> Option<Study> {
        let shorter = |study: &Study| {
            let (each, times) = (study.steps.substeps, study.steps.about_rests);
            let shorter = || match study.steps.rests.is_empty() {
                true => study.stepped(2 * each, times),
                false => study.stepped(each, 2 * times),
            };
            study.is_restless(hybrid, theta).then(shorter)
        };
        std::iter::successors(shorter(self), shorter).last()
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::candidate::Candidate;
    use super::super::pushes::tests::prepared;
    use super::super::setup::Prepared;
    use super::*;
    use crate::effect::Struck;

    /// Beyond 2.785 rates a step the sledge went to and fro about rest, and the derivatives of that were chance.
    #[test]
    fn steps_about_rests_are_short_enough_for_the_friction_there_and_no_shorter() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        let coulomb = Candidate::named("coulomb_friction", 0);
        let (hybrid, theta) = coulomb.place(&null.hybrid, &null.inside.theta, &[2.0]);
        // 2 N on 2 kg, its sign spread over so many m/s: a rate of 1/width 1/s.
        let with = |width: f64| {
            let usual = hybrid.effects()[0].smoothing;
            hybrid.smoothed_by(width / usual, |_| true)
        };
        let finest = |study: &Study, hybrid: &Hybrid| {
            study.substeps_for(hybrid, &theta) * study.steps.about_rests
        };
        let soft = with(1.0);
        assert!(study.at_rest(&soft, &theta).is_none());
        for width in [2e-3, 1e-3] {
            let sharp = with(width);
            let rate = study.interval * sharp.fastest_friction(&theta);
            assert!(rate > STABLE * finest(&study, &sharp) as f64, "{rate}");
            let shorter = study.at_rest(&sharp, &theta).unwrap();
            let steps = finest(&shorter, &sharp) as f64;
            assert!(
                rate <= STABLE * steps && rate > 0.5 * STABLE * steps,
                "{rate} {steps}"
            );
        }
        // No explicit steps would do, and implicit ones need none of this.
        assert!(study.at_rest(&with(1e-5), &theta).is_none());
        let implicit = with(1e-3).stepped_implicitly(true);
        assert!(study.at_rest(&implicit, &theta).is_none());
    }

    /// A ball between walls at ±1, at 1 m/s and 20 readings a second: four seconds from wall to wall and back.
    #[test]
    fn steps_are_shorter_where_the_log_shows_blows_and_nowhere_else() {
        let t: Vec<f64> = (0..400).map(|k| 0.05 * f64::from(k)).collect();
        let place = |t: &f64| 1.0 - (t.rem_euclid(4.0) - 2.0).abs();
        let run = ObservedRun {
            y: vec![t.iter().map(place).collect()],
            valid: vec![vec![true; t.len()]],
            u: Vec::new(),
            finer: Finer::default(),
            t,
        };
        let wall = |place| Struck {
            place,
            speed: 1.0,
            restitution: 1.0,
            within: 0.05,
        };
        let scales = |struck| Scales {
            struck,
            ..Scales::example()
        };
        let steps = |struck| {
            let blows = seldom(vec![blows(&run, &[scales(struck)])]);
            StepLength {
                substeps: 2,
                about_rests: 1,
                of_blows: 15,
                rests: Arc::default(),
                blows: Arc::new(blows),
            }
        };
        let Finer { usual, of_stops } = steps([Some(wall(-1.0)), Some(wall(1.0))]).finer(0);
        assert!(usual.is_empty());
        for (k, times) in of_stops.iter().enumerate() {
            let to_next = |t: f64| (t.rem_euclid(2.0)).min(2.0 - t.rem_euclid(2.0));
            let (from, to) = (to_next(0.05 * k as f64), to_next(0.05 * (k + 1) as f64));
            match from.min(to) {
                near if near < 0.04 => assert_eq!(*times, 8, "{k}"),
                far if far > 0.1 => assert_eq!(*times, 1, "{k}"),
                _ => {}
            }
        }
        assert_eq!(steps([None; 2]).finer(0), Finer::default());
        // About a wall in the middle of where it mostly is, all steps are as short.
        let everywhere = Struck {
            speed: 20.0,
            ..wall(0.0)
        };
        assert_eq!(steps([Some(everywhere), None]).finer(0), Finer::default());
    }
}
