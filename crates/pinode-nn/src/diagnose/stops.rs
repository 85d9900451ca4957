//! Fits of stops that the blows in a log show.
//!
//! What lacks a stop passes through it: the states it is fitted with are as far from the truth as its roll-outs. Fits of stops start at the measured
//! states, none of them behind the stop, whose spring would throw it back.

use rayon::prelude::*;

use super::candidate::Candidate;
use super::found::position;
use super::refine::best;
use super::search::Search;
use super::study::{Fitted, MOST_SUBSTEPS, RESOLVED_BLOWS, Start, Study};
use crate::hybrid::Hybrid;
use crate::shooting::Window;

/// Iterations by which starts are compared, of the initial states and of all: soft stops do better than hard ones at first.
const COMPARING: (usize, usize) = (6, 16);
/// Stops are fitted once more with steps that are shorter by up to this, and with these iterations.
const FINER: usize = 4;
const ITERATIONS: usize = 16;
/// Less than this is gained by no fit.
const WORTH_A_FIT: f64 = 1.25;

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
        let mut from = there.start(theta);
        begin(
            &seen,
            (&hybrid, &from.theta),
            &seen.windows.fit,
            &mut from.inside,
            false,
        );
        seen.fit(hybrid, from, COMPARING.0, COMPARING.1)
    });
    let best = best(tried.collect())?;
    let mut start = Start {
        inside: best.inside.states,
        ..current.start(best.inside.theta)
    };
    let (model, windows) = ((&best.hybrid, &start.theta[..]), &study.windows.held_out);
    begin(study, model, windows, &mut start.outside, false);
    Some(study.fit(best.hybrid, start, COMPARING.0, iterations))
}

/// Puts the states (q, v) from which a model at θ explains some windows best in the place of `states`: of the measured ones, and of those that are there if
/// they are `known` to be good.
fn begin(
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

/// The model that was found with its stops harder, and the study with the shorter steps that this takes: what is softer than the stop was strikes too
/// early, by a way that is right for one speed. `None` where no stop was found that the log shows, where that was beside pushes, where those found are as hard as shows,
/// and where harder ones explain the windows no better.
pub fn hardened(study: &Study, search: &Search) -> Option<(Study, Fitted)> {
    let fitted = &search.model;
    let (hybrid, mut theta) = (&fitted.hybrid, fitted.inside.theta.clone());
    let stops = search.found.iter().filter_map(|found| {
        let scales = found.candidate.scales(hybrid, &study.scales);
        let own = hybrid.range(position(fitted, &found.candidate)?);
        let stop = found.candidate.kind.stop()?;
        (scales.struck != [None; 2]).then_some((stop, scales, own))
    });
    let stops: Vec<_> = stops.collect();
    if search.pushed || stops.is_empty() {
        return None;
    }
    // As hard as the steps resolve, 1/s.
    let rate = |steps: usize| RESOLVED_BLOWS * steps as f64 / study.interval;
    // Blows of half the speed begin too early by half of the way.
    let shows = |steps: usize| {
        stops.iter().any(|(stop, scales, own)| {
            let e = stop.restitution(scales.mass, &theta[own.clone()]);
            let lasting = std::f64::consts::PI / rate(steps);
            let mut ends = scales.struck.iter().flatten();
            ends.any(|end| 0.5 * end.ahead(e, lasting) > scales.noise)
        })
    };
    let (mut finer, mut steps) = (study.clone(), fitted.substeps);
    while finer.finer < FINER * study.finer && 2 * steps <= MOST_SUBSTEPS && shows(steps) {
        finer.finer *= 2;
        steps *= 2;
    }
    let mut harder = false;
    for (stop, scales, own) in stops {
        let p = &mut theta[own];
        let factor = rate(steps) / stop.rate(scales.mass, p);
        if factor > WORTH_A_FIT && factor.is_finite() {
            let of_them = stop.harder(&scales, p, factor);
            p.copy_from_slice(&of_them);
            harder = true;
        }
    }
    if !harder {
        return None;
    }
    let mut start = fitted.start(theta);
    let (model, windows) = ((hybrid, &start.theta[..]), &finer.windows);
    begin(&finer, model, &windows.fit, &mut start.inside, true);
    begin(&finer, model, &windows.held_out, &mut start.outside, true);
    let hard = finer.fit(hybrid.clone(), start, 2, ITERATIONS);
    search.improves(&finer, &hard).then_some((finer, hard))
}
