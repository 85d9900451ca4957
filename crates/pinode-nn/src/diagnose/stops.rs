//! Fits of stops that the blows in a log show.
//!
//! What lacks a stop passes through it: the states it is fitted with are as far from the truth as its roll-outs. Fits of stops start at the measured
//! states, none of them behind the stop, whose spring would throw it back.

use rayon::prelude::*;

use super::candidate::Candidate;
use super::refine::best;
use super::study::{Fitted, Start, Study};
use crate::hybrid::Hybrid;

/// Iterations by which starts are compared, of the initial states and of all: soft stops do better than hard ones at first.
const COMPARING: (usize, usize) = (6, 16);

/// The model with the stop `candidate`, fitted from the best of its `starts`; `None` without one.
pub fn fit_struck(
    study: &Study,
    current: &Fitted,
    candidate: Candidate,
    starts: &[Vec<f64>],
    iterations: usize,
) -> Option<Fitted> {
    let (seen, there) = study.some_windows(current, 1);
    let tried = starts.par_iter().map(|start| {
        let (hybrid, theta) = candidate.place(&current.hybrid, &current.inside.theta, start);
        let from = measured(&seen, &there, &hybrid, theta);
        seen.fit(hybrid, from, COMPARING.0, COMPARING.1)
    });
    let best = best(tried.collect())?;
    let start = Start {
        inside: best.inside.states,
        ..measured(study, current, &best.hybrid, best.inside.theta)
    };
    Some(study.fit(best.hybrid, start, COMPARING.0, iterations))
}

/// A start of `hybrid` at θ from the measured states (q, v).
fn measured(study: &Study, current: &Fitted, hybrid: &Hybrid, theta: Vec<f64>) -> Start {
    let put = |states: &mut [Vec<f64>], windows| {
        for (state, measured) in states
            .iter_mut()
            .zip(study.measured(hybrid, &theta, windows))
        {
            state[..measured.len()].copy_from_slice(&measured);
        }
    };
    let mut start = current.start(theta.clone());
    put(&mut start.inside, &study.windows.fit);
    put(&mut start.outside, &study.windows.held_out);
    start
}
