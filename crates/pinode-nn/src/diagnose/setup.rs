//! From observations to a fitted null model: windows, scales, integration step.

use std::sync::Arc;

use super::Means;
use super::audit::{Masked, excitation};
use super::numerics::{is_coarse, sharp};
use super::scales::scales;
use super::smooth::{Smoothed, smooth};
use super::study::{Comparison, Fitted, MOST_SUBSTEPS, Start, Study};
use super::verdict::Excitation;
use crate::Error;
use crate::effect::Between;
use crate::hybrid::Hybrid;
use crate::model::{Input, Model};
use crate::shooting::{Observations, Window, Windows};
use crate::smoothing::VISIBLE;

/// Length of a window, s, unless the motion is fast: then five of its periods.
pub const WINDOW_S: f64 = 0.6;
/// A window of fewer intervals between samples shows no motion.
const FEWEST_INTERVALS: f64 = 3.0;
/// At least so many windows are needed on the seen side, and half as many on the other.
pub const FEWEST_WINDOWS: usize = 8;
/// More windows than this are not fitted, and a third as many not held out: those taken are spread evenly over the log.
const MOST_WINDOWS: usize = 300;
/// The integration step starts at or below this, s.
pub const COARSEST_STEP: f64 = 5e-3;
/// That of stiff models.
pub const STIFF_STEP: f64 = 2.5e-3;
/// Samples of a period of the motion that are kept, at least.
const SAMPLES_PER_PERIOD: f64 = 24.0;

/// All that the search needs.
pub struct Prepared {
    /// The data.
    pub study: Study,
    /// The model as given, fitted.
    pub null: Fitted,
    /// The recordings, smoothed.
    pub smoothed: Vec<Smoothed>,
    /// Half width of the smoothing, s.
    pub half_width: f64,
    /// Length of a window, s.
    pub window: f64,
    /// What the data excite.
    pub excitation: Excitation,
}

/// Cuts the windows and fits the model as given. What is masked is in no window.
pub fn prepare(
    model: &Model,
    observations: Observations,
    fit_runs: usize,
    masked: &Masked,
    means: &Means,
) -> Result<Prepared, Error> {
    let hybrid = Hybrid::of(model);
    let nv = hybrid.nv();
    let frequency = (0..nv)
        .map(|c| dominant_frequency(&observations, c))
        .fold(0.0, f64::max);
    let window = WINDOW_S.min(5.0 / frequency);
    let interval = observations.typical_interval();
    if window < FEWEST_INTERVALS * interval {
        return Err(Error::TooCoarse { interval, window });
    }
    let half_width = 0.06_f64.min(0.15 / frequency);
    // Samples much closer than the motion needs cost time and say little more: their errors are the model's, not the sensor's. Means of
    // an input that is smooth between its samples are no samples of it.
    let passes = |input: &Input| input.between == Between::Smooth;
    let observations = match model.inputs.iter().any(passes) {
        true => observations,
        false => observations.thinned(COARSEST_STEP.min(1.0 / (SAMPLES_PER_PERIOD * frequency))),
    };
    let windows = Windows::cut(&observations, fit_runs, window);
    let taken = |windows, most| spread_over(masked.leave(windows, &observations), most);
    let windows = Windows {
        fit: taken(windows.fit, MOST_WINDOWS),
        held_out: taken(windows.held_out, MOST_WINDOWS / 3),
    };
    let needed = (FEWEST_WINDOWS, FEWEST_WINDOWS / 2);
    if windows.fit.len() < needed.0 || windows.held_out.len() < needed.1 {
        return Err(Error::TooShort {
            window,
            fit: windows.fit.len(),
            held_out: windows.held_out.len(),
            needed,
        });
    }
    let wraps = hybrid.wraps();
    let smoothed: Vec<Smoothed> = observations
        .runs
        .iter()
        .map(|run| smooth(run, &wraps, half_width))
        .collect();
    let scales = scales(&hybrid, (&smoothed, half_width), &observations);
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
    let coarsest = match hybrid.is_stiff() {
        true => STIFF_STEP,
        false => COARSEST_STEP,
    };
    let substeps = ((interval / coarsest).ceil() as usize).clamp(1, MOST_SUBSTEPS);

    let mut study = Study {
        scales,
        smoothed: Arc::new(smoothed.clone()),
        interval,
        substeps,
        finer: 1,
        may_sharpen: model.effects.iter().all(|e| e.smoothing.is_none()),
        without: means.without.clone(),
        kept: means.kept.clone(),
        work: Arc::default(),
        observations,
        windows,
    };
    let theta = hybrid.theta();
    let measured = |windows: &[Window]| study.starts(&hybrid, &theta, windows, None);
    let start = Start {
        hidden: Vec::new(),
        inside: measured(&study.windows.fit),
        outside: measured(&study.windows.held_out),
        sigma: study
            .observations
            .channels
            .iter()
            .map(|c| 3.0 * c.noise)
            .collect(),
        theta: theta.clone(),
    };
    let mut null = study.fit(hybrid, start, 6, 20);
    // The step: fine enough that half of it changes nothing.
    while is_coarse(&study, &null) {
        study.substeps *= 2;
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
        half_width,
        window,
        excitation,
    })
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

/// Crossings of the middle by a position, per second and halved; a crossing counts when the motion leaves a fifth of its deviation.
pub fn dominant_frequency(observations: &Observations, coordinate: usize) -> f64 {
    let mut crossings = 0;
    let mut time = 0.0;
    for run in &observations.runs {
        let y = super::smooth::unwrapped(&run.y[coordinate]);
        let y = if observations.channels[coordinate].wraps {
            &y
        } else {
            &run.y[coordinate]
        };
        let n = y.len().max(1) as f64;
        let mean = y.iter().sum::<f64>() / n;
        let deviation = (y.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / n).sqrt();
        let mut side = 0.0;
        for y in y {
            let now = y - mean;
            if now.abs() > 0.2 * deviation {
                if side * now < 0.0 {
                    crossings += 1;
                }
                side = now;
            }
        }
        time += run.t.last().unwrap_or(&0.0) - run.t.first().unwrap_or(&0.0);
    }
    (0.5 * crossings as f64 / time.max(f64::MIN_POSITIVE)).max(1e-3)
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
