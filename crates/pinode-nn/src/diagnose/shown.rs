//! Fits of what the motion in a log itself shows: stops by their blows, dry friction by its rests.
//!
//! What lacks a stop passes through it, and what lacks friction moves on: the states it is fitted with are as far from the truth as its roll-outs. These fits
//! start at the measured states, none of them behind a stop, whose spring would throw it back.

use rayon::prelude::*;

use super::candidate::Candidate;
use super::refine::best;
use super::study::{Fitted, Start, Study};
use crate::hybrid::Hybrid;
use crate::shooting::Window;

/// Iterations by which starts are compared, of the initial states and of all: soft stops do better than hard ones at first.
const COMPARING: (usize, usize) = (6, 16);

/// The model with `candidate`, fitted from the best of its `starts`; `None` without one.
pub fn fit_shown(
    study: &Study,
    current: &Fitted,
    candidate: Candidate,
    starts: &[Vec<f64>],
    iterations: usize,
) -> Option<Fitted> {
    let begun = |start: &Vec<f64>| -> (Hybrid, Start) {
        let (hybrid, theta) = candidate.place(&current.hybrid, &current.inside.theta, start);
        let mut from = current.start(theta);
        let model = (&hybrid, &from.theta[..]);
        begin(study, model, &study.windows.fit, &mut from.inside, false);
        (hybrid, from)
    };
    let (hybrid, mut start) = match starts {
        [only] => begun(only),
        _ => {
            let (seen, _) = study.some_windows(current, 1);
            let tried = starts.par_iter().map(|start| {
                let (hybrid, mut from) = begun(start);
                from.outside.clear();
                seen.fit(hybrid, from, COMPARING.0, COMPARING.1)
            });
            let best = best(tried.collect())?;
            let start = Start {
                inside: best.inside.states,
                ..current.start(best.inside.theta)
            };
            (best.hybrid, start)
        }
    };
    let model = (&hybrid, &start.theta[..]);
    begin(
        study,
        model,
        &study.windows.held_out,
        &mut start.outside,
        false,
    );
    Some(study.fit(hybrid, start, COMPARING.0, iterations))
}

/// Puts the states (q, v) from which a model at θ explains some windows best in the place of `states`: of the measured ones, and of those that are there if
/// they are `known` to be good.
pub fn begin(
    study: &Study,
    (hybrid, theta): (&Hybrid, &[f64]),
    windows: &[Window],
    states: &mut [Vec<f64>],
    known: bool,
) {
    let known = known.then_some(&*states);
    let best = study.starts(hybrid, theta, windows, known);
    for (state, best) in states.iter_mut().zip(best) {
        state[..best.len()].copy_from_slice(&best);
    }
}
