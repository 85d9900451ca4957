//! What the final model owes to its numerics.

use super::study::{Fitted, Study};
use crate::shooting::Window;
use crate::smoothing::{SmoothingError, compare};

/// The check is over so many windows of the log, spread evenly: a few fits' worth of roll-outs.
const MOST_WINDOWS: usize = 24;

/// How far smoothing the dry friction of a fitted model moves its roll-outs over windows of the log, from the states that it was fitted
/// with. `None` without dry friction, and under constraints, for which there are no set-valued laws. End stops give on both sides as
/// fitted.
pub fn set_valued(study: &Study, fitted: &Fitted) -> Option<SmoothingError> {
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
        .map(|run| hybrid.drive(&run.t, &run.u, fitted.substeps, theta, &[]))
        .collect();
    let noise: Vec<f64> = observations.channels.iter().map(|c| c.noise).collect();
    compare(hybrid, theta, &inputs, &windows, &noise).ok()
}
