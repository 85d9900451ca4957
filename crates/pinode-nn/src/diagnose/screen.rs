//! Every candidate seen from one linearisation at the fitted model.
//!
//! A probe's column is the change of the roll-outs by a small step into the effect, a secant. After elimination of the windows' initial
//! states and of the constants already free, each column has a score e_w in every window and an information D:
//!
//! one-step gain = (Σ e_w)² / 2D,  t² = (Σ e_w)² / Σ e_w²,  step = Σ e_w / D.
//!
//! t² counts windows, not samples: residuals within a window are correlated.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use super::candidate::Candidate;
use crate::effect::Scales;
use crate::hybrid::{DrivenInputs, Hybrid};
use crate::shooting::problem::Problem;
use crate::shooting::{Accumulator, Fit, Observations, Roller, Trajectory, Window, fill_row};

/// What the screen says of one candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// The candidate.
    pub candidate: Candidate,
    /// Parameters to start a fit from: the best probe's step.
    pub start: Vec<f64>,
    /// Gain in log-likelihood that the linearisation promises, nats.
    pub gain: f64,
    /// Cluster-robust t².
    pub t2: f64,
    /// The share of its information that the constants already free span: near 1 for what they can imitate.
    pub spanned: f64,
}

/// Two candidates that promise more together.
#[derive(Debug, Clone, PartialEq)]
pub struct ScreenedPair {
    /// The two, each with the step it takes beside the other.
    pub members: [(Candidate, Vec<f64>); 2],
    /// Joint one-step gain, nats.
    pub gain: f64,
}

/// The screen's result.
#[derive(Debug, Clone)]
pub struct Screen {
    /// Candidates in the order of their promised gain; those whose only steps are unphysical are left out.
    pub ranked: Vec<Screened>,
    columns: Vec<Column>,
    /// Efficient scores of all columns, one vector a window.
    scores: Vec<DVector<f64>>,
    /// Efficient information of all columns.
    information: DMatrix<f64>,
    /// Information of each column by itself.
    alone: Vec<f64>,
}

#[derive(Debug, Clone)]
struct Column {
    candidate: Candidate,
    neutral: Vec<f64>,
    perturbed: Vec<f64>,
}

impl Column {
    /// The parameters a step of `factor` probes away, within their bounds; `None` when the bounds allow no step that way.
    fn start(&self, factor: f64) -> Option<Vec<f64>> {
        let specs = self.candidate.kind.parameters;
        let start: Vec<f64> = specs
            .iter()
            .zip(self.neutral.iter().zip(&self.perturbed))
            .map(|(spec, (n, p))| match n == p {
                true => *n,
                false => (n + factor * (p - n)).clamp(spec.lower, spec.upper),
            })
            .collect();
        let moved = start.iter().zip(&self.neutral).any(|(a, b)| a != b);
        let mut entries = start.iter().zip(specs);
        let is_there = entries.all(|(x, spec)| x.is_finite() || *x == spec.neutral);
        (moved && is_there).then_some(start)
    }
}

/// Screens all candidates at the fitted model.
pub fn screen(
    hybrid: &Hybrid,
    fit: &Fit,
    observations: &Observations,
    windows: &[Window],
    scales: &[Scales],
    substeps: usize,
) -> Screen {
    let problem = Problem::new(hybrid, observations, windows, &fit.free, substeps);
    let columns: Vec<Column> = Candidate::all(hybrid)
        .into_iter()
        .flat_map(|candidate| {
            let contained = candidate.contained(hybrid, &fit.theta);
            (candidate.kind.probes)(&candidate.scales(hybrid, scales), &contained)
                .into_iter()
                .map(move |probe| Column {
                    candidate,
                    neutral: probe.neutral,
                    perturbed: probe.perturbed,
                })
        })
        .collect();
    let probed: Vec<(Hybrid, Vec<f64>, Vec<DrivenInputs>)> = columns
        .iter()
        .map(|column| {
            let (with, theta) = column
                .candidate
                .place(hybrid, &fit.theta, &column.perturbed);
            let inputs = observations
                .runs
                .iter()
                .map(|run| with.drive(&run.t, &run.u, substeps, &theta, &[]))
                .collect();
            (with, theta, inputs)
        })
        .collect();

    let nuisances = fit.free.len();
    let total = nuisances + columns.len();
    let nx = 2 * hybrid.nv();
    let inputs = problem.drive(&fit.theta);
    let zeros = problem.zeros(&fit.theta);
    let per_window: Vec<Option<(DMatrix<f64>, DVector<f64>)>> = windows
        .par_iter()
        .zip(&fit.states)
        .map(|(window, state)| {
            let span = (window.first, window.count);
            let mut null = Trajectory::default();
            Roller::new(hybrid, &fit.free)
                .roll_with_sensitivities(&fit.theta, &inputs[window.run], span, state, &mut null)
                .ok()?;
            // The change of the states by each probe; nothing where it diverges.
            let changes: Vec<Vec<f64>> = probed
                .iter()
                .map(|(with, theta, inputs)| {
                    let mut out = Trajectory::default();
                    match Roller::new(with, &[]).roll(
                        theta,
                        &inputs[window.run],
                        span,
                        state,
                        &mut out,
                    ) {
                        Ok(()) => out
                            .states
                            .iter()
                            .zip(&null.states)
                            .map(|(x, n)| x - n)
                            .collect(),
                        Err(_) => vec![0.0; null.states.len()],
                    }
                })
                .collect();
            let mut normal = Accumulator::new(nx, total);
            let mut row = vec![0.0; nx + total];
            for r in problem.residuals(window, &zeros, &null.states) {
                let scale = 1.0 / fit.sigma[r.channel];
                let state = observations.channels[r.channel].state(nx / 2);
                let zero = problem.zero_column[r.channel];
                fill_row(
                    &mut row[..nx + nuisances],
                    &r,
                    state,
                    nx,
                    scale,
                    zero,
                    &null,
                );
                for (entry, change) in row[nx + nuisances..].iter_mut().zip(&changes) {
                    *entry = change[r.sample * nx + state] * scale;
                }
                normal.add(&row, r.value * scale);
            }
            let reduced = normal.finish().reduce()?;
            Some((reduced.s, reduced.g))
        })
        .collect();

    let mut s = DMatrix::zeros(total, total);
    for (window_s, _) in per_window.iter().flatten() {
        s += window_s;
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
    let scores: Vec<DVector<f64>> = per_window
        .into_iter()
        .flatten()
        .map(|(_, g)| {
            g.rows(nuisances, columns.len()) - by_nuisance.transpose() * g.rows(0, nuisances)
        })
        .collect();
    let mut screen = Screen {
        ranked: Vec::new(),
        alone: s_cc.diagonal().iter().copied().collect(),
        columns,
        scores,
        information,
    };
    screen.rank();
    screen
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

impl Screen {
    fn total(&self, column: usize) -> f64 {
        self.scores.iter().map(|e| e[column]).sum()
    }

    fn rank(&mut self) {
        let mut best: Vec<Screened> = Vec::new();
        for (k, column) in self.columns.iter().enumerate() {
            let (b, d) = (self.total(k), self.information[(k, k)]);
            let squares: f64 = self.scores.iter().map(|e| e[k] * e[k]).sum();
            // A column that the free constants already span has no information of its own.
            if !(d > 0.0 && squares > 0.0) {
                continue;
            }
            let Some(start) = column.start(b / d) else {
                continue;
            };
            let screened = Screened {
                candidate: column.candidate,
                start,
                gain: 0.5 * b * b / d,
                t2: b * b / squares,
                spanned: 1.0 - d / self.alone[k],
            };
            match best.iter_mut().find(|s| s.candidate == column.candidate) {
                Some(known) if known.gain < screened.gain => *known = screened,
                Some(_) => {}
                None => best.push(screened),
            }
        }
        best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        self.ranked = best;
    }

    /// The pairs that promise most beyond the better of their members, at most `most`: effects that mask one another.
    pub fn pairs(&self, most: usize) -> Vec<ScreenedPair> {
        let mut pairs = Vec::new();
        for (i, a) in self.columns.iter().enumerate() {
            for (j, b) in self.columns.iter().enumerate().skip(i + 1) {
                let same = a.candidate == b.candidate;
                let rivals = a.candidate.target == b.candidate.target
                    && (a.candidate.kind.contains.contains(&b.candidate.kind.name)
                        || b.candidate.kind.contains.contains(&a.candidate.kind.name)
                        || (!a.candidate.kind.contains.is_empty()
                            && a.candidate.kind.contains == b.candidate.kind.contains));
                if same || rivals {
                    continue;
                }
                let (dii, djj) = (self.information[(i, i)], self.information[(j, j)]);
                let dij = self.information[(i, j)];
                let determinant = dii * djj - dij * dij;
                if determinant.is_nan() || determinant <= 1e-8 * dii * djj {
                    continue;
                }
                let (bi, bj) = (self.total(i), self.total(j));
                let x = (djj * bi - dij * bj) / determinant;
                let y = (dii * bj - dij * bi) / determinant;
                if let (Some(p), Some(q)) = (a.start(x), b.start(y)) {
                    pairs.push(ScreenedPair {
                        members: [(a.candidate, p), (b.candidate, q)],
                        gain: 0.5 * (x * bi + y * bj),
                    });
                }
            }
        }
        pairs.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        // One pair of candidates once, with its best probes.
        let mut kept: Vec<ScreenedPair> = Vec::new();
        for pair in pairs {
            let same = |k: &ScreenedPair| {
                k.members[0].0 == pair.members[0].0 && k.members[1].0 == pair.members[1].0
            };
            if !kept.iter().any(same) {
                kept.push(pair);
            }
            if kept.len() == most {
                break;
            }
        }
        kept
    }
}
