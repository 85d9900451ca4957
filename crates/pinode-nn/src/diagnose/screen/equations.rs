//! The columns of all candidates, windows rolled out once, and what is free eliminated.

use lagrange::LANES;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::Screen;
use super::probed::{Change, Column, Probed};
use crate::diagnose::candidate::Candidate;
use crate::diagnose::duals::is_told_as_gain;
use crate::diagnose::linear::{AtWindow, Linearisation};
use crate::diagnose::study::{Fitted, Study};
use crate::diagnose::twins::is_told_as_another;
use crate::effect::Kind;
use crate::hybrid::Hybrid;
use crate::shooting::{SmallForce, Trajectory};

/// The probes of the candidates of the kinds that `counts` keeps, at θ of a model.
pub fn columns(
    study: &Study,
    (hybrid, theta): (&Hybrid, &[f64]),
    counts: impl Fn(&Kind) -> bool,
) -> Vec<Column> {
    let mut all = Candidate::all(hybrid);
    all.retain(|candidate| !study.without.contains(&candidate.kind));
    let columns = all
        .iter()
        .filter(|candidate| !is_told_as_another(candidate, &all, hybrid))
        .filter(|candidate| !is_told_as_gain(candidate, &all, hybrid))
        .filter(|candidate| counts(candidate.kind))
        .filter(|candidate| !candidate.winds_up(hybrid, &study.scales))
        .flat_map(|&candidate| {
            let contained = candidate.contained(hybrid, theta);
            let known = hybrid.known_strength(candidate.kind, candidate.target);
            (candidate.kind.probes)(&candidate.scales(hybrid, &study.scales), &contained)
                .into_iter()
                .map(move |probe| {
                    let specs = candidate.kind.parameters.iter();
                    Column {
                        candidate,
                        known,
                        pace: study.pace.times(),
                        neutral: probe.neutral,
                        // What goes with the inertia may be more than a model file can hold.
                        perturbed: specs
                            .zip(probe.perturbed)
                            .map(|(s, x)| s.within(x))
                            .collect(),
                    }
                })
        });
    columns.collect()
}

/// Screens the candidates of the kinds that `counts` keeps at the fitted model.
pub fn screen(study: &Study, fitted: &Fitted, counts: impl Fn(&Kind) -> bool) -> Screen {
    let hybrid = &fitted.hybrid;
    let columns = columns(study, (hybrid, &fitted.inside.theta), counts);
    let mut screen = of_columns(study, fitted, columns);
    let mut candidates: Vec<Candidate> = screen.columns.iter().map(|c| c.candidate).collect();
    candidates.dedup();
    let suggested = |c: Candidate| {
        let starts = c.kind.suggested(&c.scales(hybrid, &study.scales));
        (!starts.is_empty()).then_some((c, starts))
    };
    screen.suggested = candidates.into_iter().filter_map(suggested).collect();
    screen.look_between_probes();
    screen.rank();
    screen
}

/// By how many standard errors the scores of the seen windows of a study ask for a candidate that a fit gave these parameters: t of the whole step into
/// it, to first order about a model without it. `None` where the samples do not follow it.
pub fn asked(
    study: &Study,
    fitted: &Fitted,
    candidate: Candidate,
    parameters: &[f64],
) -> Option<f64> {
    let column = Column {
        candidate,
        known: 0.0,
        pace: study.pace.times(),
        neutral: Vec::new(),
        perturbed: parameters.to_vec(),
    };
    let screen = of_columns(study, fitted, vec![column]);
    let own = screen.scores.iter().map(|e| e.get(0).copied());
    let own: Vec<f64> = own.collect::<Option<_>>()?;
    let squares: f64 = own.iter().map(|e| e * e).sum();
    (squares > 0.0).then(|| own.iter().sum::<f64>() / squares.sqrt())
}

/// A screen of these columns, its candidates still to be ranked.
fn of_columns(study: &Study, fitted: &Fitted, columns: Vec<Column>) -> Screen {
    let fit = &fitted.inside;
    let windows = &study.windows.fit;
    let linear = Linearisation::new(study, fitted);
    let (columns, probed): (Vec<Column>, Vec<Probed>) = columns
        .into_par_iter()
        .filter_map(|column| {
            let probed = Probed::new(study, fitted, &column)?;
            Some((column, probed))
        })
        .unzip();

    let moved: Vec<Vec<Option<Trajectory>>> = probed
        .iter()
        .map(|with| with.moved(windows, &fit.states, linear.inputs()))
        .collect();
    // The change of what is read by each probe; nothing where it diverges.
    let changes = |at: &AtWindow| -> Vec<Vec<f64>> {
        let under = forces_along(&probed, at);
        let of_probe = probed.iter().zip(under).zip(&moved);
        of_probe
            .map(|((with, under), moved)| {
                let states = match with.change {
                    Change::Reading => Some(at.states.to_vec()),
                    Change::Forces(_) => under,
                    Change::Motion => moved[at.index].as_ref().map(|t| t.states.clone()),
                };
                match states.filter(|x| x.iter().all(|x| x.is_finite())) {
                    Some(states) => linear.change(at, (&with.hybrid, &with.readings), &states),
                    None => vec![0.0; at.residuals.len()],
                }
            })
            .collect()
    };
    let nuisances = fit.free.len();
    let total = nuisances + columns.len();
    let mut s = DMatrix::zeros(total, total);
    let mut gradients = Vec::with_capacity(windows.len());
    linear.each_window(columns.len(), changes, |window_s, g| {
        s += window_s;
        gradients.push(g);
    });
    let by_nuisance = linear.by_nuisance(&s);
    let s_nc = s.view((0, nuisances), (nuisances, columns.len()));
    let s_cc = s.view((nuisances, nuisances), (columns.len(), columns.len()));
    let information = s_cc - s_nc.transpose() * &by_nuisance;
    let scores: Vec<DVector<f64>> = gradients
        .iter()
        .map(|g| g.rows(nuisances, columns.len()) - by_nuisance.transpose() * g.rows(0, nuisances))
        .collect();
    let strain = by_nuisance.transpose() * linear.strain();
    Screen {
        ranked: Vec::new(),
        suggested: Vec::new(),
        alone: s_cc.into_owned(),
        strain,
        columns,
        scores,
        information,
        by_nuisance,
    }
}

/// The states of a window under each probe that is but a force along its roll-out, to first order; eight at a time.
fn forces_along(probed: &[Probed], at: &AtWindow) -> Vec<Option<Vec<f64>>> {
    let mut under: Vec<Option<Vec<f64>>> = vec![None; probed.len()];
    let forces: Vec<(usize, SmallForce)> = probed
        .iter()
        .enumerate()
        .filter_map(|(k, with)| {
            let Change::Forces(by) = with.change else {
                return None;
            };
            let own = with.inputs.as_ref();
            let force = SmallForce {
                with: &with.hybrid,
                theta: &with.theta,
                inputs: own.map_or(at.inputs, |own| &own[at.window.run]),
                by,
            };
            Some((k, force))
        })
        .collect();
    // What is but a force has the same states: one memory does for all.
    let Some(mut memory) = forces.first().map(|(_, force)| force.with.memory(&[])) else {
        return under;
    };
    for eight in forces.chunks(LANES) {
        let own: Vec<SmallForce> = eight.iter().map(|(_, force)| *force).collect();
        let mut found = vec![Vec::new(); eight.len()];
        at.steps.under(at.states, &own, &mut memory, &mut found);
        for ((k, _), found) in eight.iter().zip(found) {
            under[*k] = Some(found);
        }
    }
    under
}
