//! From observations to a fitted null model: windows, scales, integration step.

use std::sync::Arc;

use super::Means;
use super::audit::{Masked, excitation};
use super::comparison::Comparison;
use super::idle;
use super::numerics::sharp;
use super::pace::Pace;
use super::scales::scales;
use super::smooth::{Smoothed, smooth};
use super::step_length::StepLength;
use super::study::{Fitted, Study};
use super::verdict::Excitation;
use crate::Error;
use crate::effect::Between;
use crate::hybrid::Hybrid;
use crate::model::{Input, Model};
use crate::shooting::{Observations, Window, Windows};
use crate::smoothing::VISIBLE;

/// A window of fewer intervals between samples shows no motion.
const FEWEST_INTERVALS: f64 = 3.0;
/// At least so many windows are needed on the seen side, and half as many on the other.
pub const FEWEST_WINDOWS: usize = 8;
/// More windows than this are not fitted, and a third as many not held out: those taken are spread evenly over the log.
const MOST_WINDOWS: usize = 300;

/// All that the search needs.
pub struct Prepared {
    /// The data.
    pub study: Study,
    /// The model as given, fitted.
    pub null: Fitted,
    /// The recordings, smoothed.
    pub smoothed: Vec<Smoothed>,
    /// What the data excite.
    pub excitation: Excitation,
}

/// Cuts the windows and fits the model as given. What is masked is in no window. Of a short recording, which has too few of the length that shows most, they are
/// shorter.
pub fn prepare(
    model: &Model,
    observations: Observations,
    fit_runs: usize,
    masked: &Masked,
    means: &Means,
) -> Result<Prepared, Error> {
    let pace = Pace::of(&observations);
    let interval = observations.typical_interval();
    if pace.window() < FEWEST_INTERVALS * interval {
        return Err(Error::TooCoarse {
            interval,
            window: pace.window(),
        });
    }
    let observations = thinned(model, observations, &pace);
    let cut = |pace: &Pace| cut(&observations, fit_runs, masked, pace);
    let interval = observations.typical_interval();
    let (pace, windows) = pace.shortened(interval, cut, are_enough);
    if !are_enough(&windows) {
        return Err(Error::TooShort {
            window: pace.window(),
            fit: windows.fit.len(),
            held_out: windows.held_out.len(),
            needed: (FEWEST_WINDOWS, FEWEST_WINDOWS / 2),
        });
    }
    let hybrid = Hybrid::at_pace(model, pace.times(), pace.speeds());
    let wraps = hybrid.wraps();
    let smoothed: Vec<Smoothed> = observations
        .runs
        .iter()
        .map(|run| smooth(run, &wraps, pace.half_width()))
        .collect();
    let scales = scales(&hybrid, (&smoothed, &pace), &observations);
    let names: Vec<String> = model.inputs.iter().map(|i| i.name.clone()).collect();
    let excitation = excitation(
        &hybrid,
        &observations,
        &smoothed,
        &scales,
        &windows.fit,
        &names,
    );
    let interval = observations.typical_interval();
    let moving = (&observations, &scales[..]);
    let steps = StepLength::first(&hybrid, &smoothed, moving, &pace, interval);
    let study = Study {
        pace,
        scales,
        smoothed: Arc::new(smoothed.clone()),
        interval,
        steps: steps.clone(),
        finer: 1,
        may_sharpen: model.effects.iter().all(|e| e.smoothing.is_none()),
        without: means.without.clone(),
        kept: means.kept.clone(),
        work: Arc::default(),
        observations,
        windows,
    };
    let mut study = study.with_steps(steps);
    let start = study.measured(&hybrid, hybrid.theta());
    let mut null = study.fit(hybrid, start, 6, 20);
    // The step: fine enough that half of it changes nothing.
    while let Some(shorter) = study.with_shorter_steps(&null, &study.observations.noise()) {
        study = shorter;
        let start = null.start(null.inside.theta.clone());
        null = study.fit(null.hybrid.clone(), start, 2, 20);
    }
    // What known friction that sticks does and smoothed friction does not, is no disagreement.
    if study.may_sharpen
        && let Some((finer, sharp)) = sharp(&study, &null, VISIBLE)
        && Comparison::of(&sharp, &null).total() > 0.0
    {
        (study, null) = (finer, sharp);
    }
    let diverged = null.inside_scores.iter().filter(|s| !s.is_finite()).count();
    if 2 * diverged > null.inside_scores.len() {
        return Err(Error::Unfittable {
            diverged,
            windows: null.inside_scores.len(),
        });
    }
    Ok(Prepared {
        study,
        null,
        smoothed,
        excitation,
    })
}

/// What was observed, as it is fitted: samples much closer than the motion needs cost time and say little more, since their errors are the model's, not the
/// sensor's. Means of an input that is smooth between its samples are no samples of it.
pub fn thinned(model: &Model, observations: Observations, pace: &Pace) -> Observations {
    let passes = |input: &Input| input.between == Between::Smooth;
    match model.inputs.iter().any(passes) {
        true => observations,
        false => observations.thinned(pace.closest_samples()),
    }
}

/// The windows of what was observed. Of a log that rests most of the time, those in which something happens, the last quarter of them held out unless the
/// recordings say which; all of them where those are too few.
fn cut(observations: &Observations, fit_runs: usize, masked: &Masked, pace: &Pace) -> Windows {
    let mut windows = Windows::cut(observations, fit_runs, pace.window());
    for part in [&mut windows.fit, &mut windows.held_out] {
        *part = masked.leave(std::mem::take(part), observations);
    }
    if pace.rests() {
        let mut busy = Windows {
            fit: idle::busy(observations, &windows.fit),
            held_out: idle::busy(observations, &windows.held_out),
        };
        if Windows::are_split_in_time(observations.runs.len(), fit_runs) {
            busy = busy.split_by_number();
        }
        if are_enough(&busy) {
            windows = busy;
        }
    }
    Windows {
        fit: spread_over(windows.fit, MOST_WINDOWS),
        held_out: spread_over(windows.held_out, MOST_WINDOWS / 3),
    }
}

fn are_enough(windows: &Windows) -> bool {
    windows.fit.len() >= FEWEST_WINDOWS && windows.held_out.len() >= FEWEST_WINDOWS / 2
}

/// At most `most` of the windows, evenly spread in pairs.
fn spread_over(windows: Vec<Window>, most: usize) -> Vec<Window> {
    let (pairs, most) = (windows.len().div_ceil(2), most / 2);
    if pairs <= most {
        return windows;
    }
    let pair = |i: usize| windows.iter().skip(2 * (i * pairs / most)).take(2);
    (0..most).flat_map(pair).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_of_long_logs_are_taken_in_neighbouring_pairs_from_all_of_it() {
        let all = |n: usize| -> Vec<Window> {
            (0..n)
                .map(|k| Window {
                    run: 0,
                    first: 10 * k,
                    count: 10,
                })
                .collect()
        };
        assert_eq!(spread_over(all(9), 10), all(9));
        let taken: Vec<usize> = spread_over(all(25), 6).iter().map(|w| w.first).collect();
        assert_eq!(taken, [0, 10, 80, 90, 160, 170]);
    }
}
