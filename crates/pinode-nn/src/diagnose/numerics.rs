//! What the final model owes to its numerics.

use super::half_steps::with_steps_as_short_as_it_shows;
use super::search::Search;
use super::stops::hardened;
use super::study::{Fitted, Study};
use super::width::soft;
use crate::shooting::Window;
use crate::smoothing::{SmoothingError, VISIBLE, compare};

/// Dry friction that a search goes on beside is fitted again when sticking would move a coordinate by more than what shows, that of its result when it would
/// by this, in units of the noise: half its square, 0.05 nats a sample, is the least gain that counts for an effect. Beside residuals that are
/// larger than the noise the same is true of them.
pub const COUNTS: f64 = 0.316;
/// … and so much of that is aimed at.
const AIM: f64 = 0.5;
/// … but not by more than this at once.
const SHARPEST: f64 = 0.02;
/// Less than this is gained by no fit.
const WORTH_A_FIT: f64 = 0.8;
/// Its iterations.
const ITERATIONS: usize = 12;
/// The check is over so many windows of the log, spread evenly: a few fits' worth of roll-outs.
const MOST_WINDOWS: usize = 24;

/// How far smoothing the dry friction of a fitted model moves its roll-outs over windows of the log, from the states that it was fitted
/// with. `None` without dry friction, and under constraints, for which there are no set-valued laws. End stops give on both sides as
/// fitted.
pub fn set_valued(study: &Study, fitted: &Fitted) -> Option<SmoothingError> {
    moved_by_sticking(study, fitted, &study.observations.noise())
}

/// The same in these units, one a channel.
fn moved_by_sticking(study: &Study, fitted: &Fitted, units: &[f64]) -> Option<SmoothingError> {
    let (hybrid, theta) = (&fitted.hybrid, &fitted.inside.theta);
    if hybrid.rubbing().is_empty() {
        return None;
    }
    let seen = study.windows.fit.iter().zip(&fitted.inside.states);
    let unseen = study.windows.held_out.iter().zip(&fitted.outside.states);
    let all: Vec<(Window, &[f64])> = seen
        .chain(unseen)
        .map(|(&window, state)| (window, state.as_slice()))
        .collect();
    let windows: Vec<_> = (0..all.len().min(MOST_WINDOWS))
        .filter_map(|i| {
            all.get(i * all.len() / all.len().min(MOST_WINDOWS))
                .copied()
        })
        .collect();
    let observations = &study.observations;
    let inputs: Vec<_> = observations
        .runs
        .iter()
        .map(|run| run.drive(hybrid, fitted.substeps, theta, &[]))
        .collect();
    compare(hybrid, theta, &inputs, &windows, units).ok()
}

/// Units, one a channel, of which `limit` is so many times the noise, or [`COUNTS`] times what a fitted model leaves, if that is more: friction as sharp
/// as the noise would see it takes many times the time, and changes nothing where other things are missing that move more.
fn units(study: &Study, fitted: &Fitted, limit: f64) -> Vec<f64> {
    let observations = &study.observations;
    let excess = fitted.excess(observations).into_iter();
    let channels = excess.zip(&observations.channels);
    channels
        .map(|(excess, channel)| channel.noise * (excess * COUNTS / limit).max(1.0))
        .collect()
}

/// A study with shorter steps and what was found as a fit in it has it, where that is better.
type Refined = Option<(Study, Fitted)>;

/// What was found, with its stops as hard and its dry friction as sharp as the data see them where that explains them better, and with steps as short as its
/// constants show: in the study with the steps that this takes; and the studies and fits before that, the last one last.
pub fn finer(search: &mut Search, report: &dyn Fn(&str)) -> (Study, Vec<(Study, Fitted)>) {
    let mut study = search.study.clone();
    let mut before: Vec<(Study, Fitted)> = search.smooth.take().into_iter().collect();
    let may_sharpen = study.may_sharpen;
    let has_stops = search
        .found
        .iter()
        .any(|f| f.candidate.kind.stop().is_some());
    let mut take = |what: &str, refined: fn(&Study, &Search) -> Refined| {
        report(&format!("asking whether {what} would do the same"));
        if let Some((finer, fitted)) = refined(&study, search) {
            let fitted = search.refitted(&finer, fitted);
            before.push((std::mem::replace(&mut study, finer), fitted));
        }
    };
    if has_stops {
        take("harder stops", hardened);
    }
    if may_sharpen {
        take("friction that sticks", sharpened);
    }
    take("shorter steps", with_steps_as_short_as_it_shows);
    (study, before)
}

/// The model that was found with its dry friction as sharp as the data see it, and the study with the steps that this takes. `None` where that was found
/// beside pushes, where it would do nothing, and where the sharper model explains the windows no better or is no longer what was found.
fn sharpened(study: &Study, search: &Search) -> Refined {
    // Without the pushes that they were found beside, the constants would take these for their own.
    if search.pushed {
        return None;
    }
    let (study, sharp) = sharp(study, &search.model, COUNTS)?;
    search.improves(&study, &sharp).then_some((study, sharp))
}

/// By how much sticking would move a coordinate from where the smoothed friction of a fitted model has it where that is beyond a `limit`, in units of the
/// noise, and counts beside what the model leaves.
pub fn shows(study: &Study, fitted: &Fitted, limit: f64) -> Option<f64> {
    // Where some of it is known not to stick, what sticking would do is no error.
    if soft(&fitted.hybrid).next().is_some() {
        return None;
    }
    let error = moved_by_sticking(study, fitted, &units(study, fitted, limit))?;
    let worst = error.coordinates.iter().map(|c| c.rms).fold(0.0, f64::max);
    (worst > limit).then_some(worst)
}

/// A model with its dry friction as sharp as the data see it, fitted anew, and the study with the steps that this takes: where sticking would move a
/// coordinate by more than a `limit` from where the smoothed friction has it, the forces at low speed come out wrong for it. `None` where it would
/// not, and where next to no sharper friction is asked for.
pub fn sharp(study: &Study, fitted: &Fitted, limit: f64) -> Refined {
    let worst = shows(study, fitted, limit)?;
    let theta = &fitted.inside.theta;
    let (aimed, explicit) = (AIM * limit / worst, fitted.hybrid.sharpest(theta));
    // Implicit steps take several times as long: only where explicit ones would leave it in sight.
    let factor = match explicit * worst < limit {
        true => aimed.max(explicit).max(SHARPEST),
        false => aimed.max(SHARPEST),
    };
    if factor > WORTH_A_FIT {
        return None;
    }
    let hybrid = fitted.hybrid.sharpened(factor, theta);
    let mut study = study.clone();
    let fit = |study: &Study, from: &Fitted| {
        let start = from.start(from.inside.theta.clone());
        study.fit(hybrid.clone(), start, 1, ITERATIONS)
    };
    let visible = units(&study, fitted, VISIBLE);
    // The steps that it will need are known before it is fitted, or nearly.
    let mut sharp = Fitted {
        hybrid: hybrid.clone(),
        ..fitted.clone()
    };
    study = study.with_short_steps(&sharp, &visible).unwrap_or(study);
    sharp = fit(&study, &sharp);
    while let Some(shorter) = study.with_shorter_steps(&sharp, &visible) {
        study = shorter;
        sharp = fit(&study, &sharp);
    }
    Some((study, sharp))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::candidate::Candidate;
    use super::super::pushes::tests::prepared;
    use super::super::setup::Prepared;
    use super::*;

    /// A cart whose encoder sees micrometres took ever shorter steps for its friction, while far more than that was missing.
    #[test]
    fn friction_is_as_sharp_as_what_the_model_leaves_can_see() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        let coulomb = Candidate::named("coulomb_friction", 0);
        let (hybrid, theta) = coulomb.place(&null.hybrid, &null.inside.theta, &[2.0]);
        let mut fitted = study.fit(hybrid, null.start(theta), 1, 0);
        let moved = set_valued(&study, &fitted).unwrap().coordinates[0].rms;
        assert!(moved > VISIBLE, "{moved} times the noise");
        let noise = study.observations.channels[0].noise;
        for limit in [VISIBLE, COUNTS] {
            // Residuals of the noise, of as much as leaves it in sight, and of more.
            for (left, seen) in [
                (1.0, true),
                (0.8 * moved / COUNTS, true),
                (1.2 * moved / COUNTS, false),
            ] {
                fitted.inside.sigma = vec![left * noise];
                let shown = shows(&study, &fitted, limit);
                assert_eq!(shown.is_some(), seen, "{left} times the noise: {shown:?}");
            }
        }
        // What is told stays in units of the noise.
        assert_eq!(
            set_valued(&study, &fitted).unwrap().coordinates[0].rms,
            moved
        );
    }
}
