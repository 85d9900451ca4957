//! The normal equations of all columns: windows are rolled out once, and what is free is eliminated.

use lagrange::LANES;
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use super::Screen;
use super::probed::{Change, Column, Probed};
use crate::diagnose::candidate::Candidate;
use crate::diagnose::study::{Fitted, Study};
use crate::effect::Kind;
use crate::hybrid::DrivenInputs;
use crate::shooting::problem::Problem;
use crate::shooting::{Accumulator, Roller, SmallForce, Trajectory, Variation, Window};

/// So many windows have their normal equations in memory at once.
const AT_ONCE: usize = 16;

/// Screens the candidates of the kinds that `counts` keeps at the fitted model.
pub fn screen(study: &Study, fitted: &Fitted, counts: impl Fn(&Kind) -> bool) -> Screen {
    let (hybrid, fit) = (&fitted.hybrid, &fitted.inside);
    let windows = &study.windows.fit;
    let channels = &study.observations.channels;
    let paths = study.hidden_paths(hybrid, &fit.theta, fitted.substeps);
    let hidden = study.hidden_prior(hybrid, &fit.theta, windows, &paths);
    let problem = Problem::new(
        hybrid,
        &study.observations,
        windows,
        &fit.free,
        &hidden,
        fitted.substeps,
    );
    let columns: Vec<Column> = Candidate::all(hybrid)
        .into_iter()
        .filter(|candidate| counts(candidate.kind))
        .filter(|candidate| !study.without.contains(&candidate.kind))
        .flat_map(|candidate| {
            let contained = candidate.contained(hybrid, &fit.theta);
            (candidate.kind.probes)(&candidate.scales(hybrid, &study.scales), &contained)
                .into_iter()
                .map(move |probe| {
                    let specs = candidate.kind.parameters.iter();
                    Column {
                        candidate,
                        neutral: probe.neutral,
                        // What goes with the inertia may be more than a model file can hold.
                        perturbed: specs
                            .zip(probe.perturbed)
                            .map(|(s, x)| s.within(x))
                            .collect(),
                    }
                })
        })
        .collect();
    let (columns, probed): (Vec<Column>, Vec<Probed>) = columns
        .into_par_iter()
        .filter_map(|column| {
            let probed = Probed::new(study, fitted, &column)?;
            Some((column, probed))
        })
        .unzip();

    let nuisances = fit.free.len();
    let total = nuisances + columns.len();
    let nx = hybrid.nx();
    let inputs = problem.drive(&fit.theta);
    let readings = problem.readings(&fit.theta);
    let moved: Vec<Vec<Option<Trajectory>>> = probed
        .iter()
        .map(|with| with.moved(windows, &fit.states, &inputs))
        .collect();
    let of_window = |index: usize| -> Option<(DMatrix<f64>, DVector<f64>)> {
        let (window, state) = (&windows[index], &fit.states[index]);
        let span = (window.first, window.count);
        let t = &study.observations.runs[window.run].t[window.first..][..window.count];
        let mut null = Trajectory::default();
        let mut steps = Variation::default();
        Roller::new(hybrid, &fit.free)
            .roll_step_by_step(
                &fit.theta,
                &inputs[window.run],
                span,
                state,
                &mut null,
                &mut steps,
            )
            .ok()?;
        let residuals: Vec<_> = problem.residuals(window, &readings, &null.states).collect();
        let under = forces_along(&probed, &inputs[window.run], window, (&null.states, &steps));
        // The change of what is read by each probe; nothing where it diverges.
        let changes: Vec<Vec<f64>> = probed
            .iter()
            .zip(under)
            .zip(&moved)
            .map(|((with, under), moved)| {
                let states = match with.change {
                    Change::Reading => Some(null.states.clone()),
                    Change::Forces(_) => under,
                    Change::Motion => moved[index].as_ref().map(|t| t.states.clone()),
                };
                let Some(states) = states.filter(|x| x.iter().all(|x| x.is_finite())) else {
                    return vec![0.0; residuals.len()];
                };
                let sizes = (with.hybrid.nv(), with.hybrid.nx());
                let change = residuals.iter().map(|r| {
                    let channel = &channels[r.channel];
                    let reading = &with.readings[channel.coordinate];
                    let there = channel.predict(reading, sizes, &states, t, r.sample);
                    there.value - r.predicted.value
                });
                change.collect()
            })
            .collect();
        let mut normal = Accumulator::new(nx, total);
        let mut row = vec![0.0; nx + total];
        for (i, r) in residuals.iter().enumerate() {
            let scale = 1.0 / fit.sigma[r.channel];
            problem.fill_row(&mut row[..nx + nuisances], r, &readings, scale, &null);
            for (entry, change) in row[nx + nuisances..].iter_mut().zip(&changes) {
                *entry = change[i] * scale;
            }
            normal.add(&row, r.value * scale);
        }
        problem.add_prior(index, state, &mut normal);
        let reduced = normal.finish().reduce()?;
        Some((reduced.s, reduced.g))
    };
    // A few windows at once, summed in their order: the matrices of all would fill the memory.
    let mut s = DMatrix::zeros(total, total);
    let mut gradients = Vec::with_capacity(windows.len());
    for first in (0..windows.len()).step_by(AT_ONCE) {
        let some = first..windows.len().min(first + AT_ONCE);
        let reduced: Vec<_> = some.into_par_iter().map(of_window).collect();
        for (window_s, g) in reduced.into_iter().flatten() {
            s += window_s;
            gradients.push(g);
        }
    }

    for (k, &i) in fit.free.iter().enumerate() {
        let tolerance = hybrid.constants()[i].tolerance;
        if tolerance.is_finite() {
            s[(k, k)] += tolerance.powi(-2);
        }
        // A constant that moves nothing must not spoil the elimination.
        s[(k, k)] += f64::MIN_POSITIVE.sqrt();
    }
    let s_nn = s.view((0, 0), (nuisances, nuisances)).into_owned();
    let s_nc = s.view((0, nuisances), (nuisances, columns.len()));
    let s_cc = s.view((nuisances, nuisances), (columns.len(), columns.len()));
    let by_nuisance = solve_scaled(&s_nn, &s_nc.into_owned());
    let information = s_cc - s_nc.transpose() * &by_nuisance;
    let mut pull = vec![0.0; columns.len()];
    for g in &gradients {
        for (pull, g) in pull.iter_mut().zip(g.rows(nuisances, columns.len()).iter()) {
            *pull += g;
        }
    }
    let scores: Vec<DVector<f64>> = gradients
        .iter()
        .map(|g| g.rows(nuisances, columns.len()) - by_nuisance.transpose() * g.rows(0, nuisances))
        .collect();
    let mut screen = Screen {
        ranked: Vec::new(),
        alone: s_cc.diagonal().iter().copied().collect(),
        pull,
        columns,
        scores,
        information,
        by_nuisance,
    };
    screen.rank();
    screen
}

/// The states of a window under each probe that is but a force along its roll-out, to first order; eight at a time. `inputs` are those of
/// the fitted model.
fn forces_along(
    probed: &[Probed],
    inputs: &DrivenInputs,
    window: &Window,
    (states, steps): (&[f64], &Variation),
) -> Vec<Option<Vec<f64>>> {
    let mut under: Vec<Option<Vec<f64>>> = vec![None; probed.len()];
    let forces: Vec<(usize, SmallForce)> = probed
        .iter()
        .enumerate()
        .filter_map(|(k, with)| {
            let Change::Forces(only) = with.change else {
                return None;
            };
            let own = with.inputs.as_ref();
            let force = SmallForce {
                with: &with.hybrid,
                theta: &with.theta,
                inputs: own.map_or(inputs, |own| &own[window.run]),
                only,
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
        steps.under(states, &own, &mut memory, &mut found);
        for ((k, _), found) in eight.iter().zip(found) {
            under[*k] = Some(found);
        }
    }
    under
}

/// A⁻¹ B for a positive A whose rows differ widely in unit.
fn solve_scaled(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    let scale: Vec<f64> = (0..n).map(|i| a[(i, i)].sqrt()).collect();
    let unit = DMatrix::from_fn(n, n, |i, j| {
        a[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-10 } else { 0.0 }
    });
    let rhs = DMatrix::from_fn(n, b.ncols(), |i, j| b[(i, j)] / scale[i]);
    match Cholesky::new(unit) {
        Some(factor) => {
            let x = factor.solve(&rhs);
            DMatrix::from_fn(n, b.ncols(), |i, j| x[(i, j)] / scale[i])
        }
        None => DMatrix::zeros(n, b.ncols()),
    }
}
