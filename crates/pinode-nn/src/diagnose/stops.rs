//! Stops as hard as the data see them.

use super::candidate::Candidate;
use super::found::position;
use super::search::Search;
use super::shown::begin;
use super::study::{Fitted, MOST_SUBSTEPS, RESOLVED_BLOWS, Study};

/// Stops are fitted once more with steps that are shorter by up to this, and with these iterations.
const FINER: usize = 4;
const ITERATIONS: usize = 16;
/// Less than this is gained by no fit.
const WORTH_A_FIT: f64 = 1.25;

/// By how much the constants of a fitted model's stops may be off for what the samples do not resolve, one a free constant: nobody sees how long a blow lasts, and
/// a stop that is hard is struck where a softer one begins, or as far behind that as a body goes while the softer one turns it back; half of the way in between.
pub fn unresolved(study: &Study, fitted: &Fitted) -> Vec<f64> {
    let (hybrid, theta) = (&fitted.hybrid, &fitted.inside.theta);
    let mut off = vec![0.0; fitted.inside.free.len()];
    for (index, placed) in hybrid.effects().iter().enumerate() {
        let (kind, target) = (placed.kind, placed.target);
        let Some(stop) = kind.stop() else {
            continue;
        };
        let scales = Candidate { kind, target }.scales(hybrid, &study.scales);
        let own = hybrid.range(index);
        let p = &theta[own.clone()];
        let hard = stop.harder(&scales, p, f64::INFINITY);
        for ((i, hard), soft) in own.zip(hard).zip(p) {
            let free = fitted.inside.free.iter().position(|&free| free == i);
            let half = 0.5 * (hard - soft).abs();
            if let Some(k) = free.filter(|_| half.is_finite()) {
                off[k] = half;
            }
        }
    }
    off
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
    let (mut finer, mut steps) = (
        study.clone(),
        fitted.substeps * study.steps_of_blows(hybrid),
    );
    let most = MOST_SUBSTEPS.min(FINER * steps);
    while 2 * steps <= most && shows(steps) {
        finer = finer.with_shorter_blows();
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
