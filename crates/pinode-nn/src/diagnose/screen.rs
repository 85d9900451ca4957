//! Every candidate seen from one linearisation at the fitted model.
//!
//! A probe's column is the change of the roll-outs by a small step into the effect, a secant. After elimination of the windows' initial
//! states and of the constants already free, each column has a score e_w in every window and an information D:
//!
//! one-step gain = (Σ e_w)² / 2D,  t² = (Σ e_w)² / Σ e_w²,  step = Σ e_w / D.
//!
//! t² counts windows, not samples: residuals within a window are correlated.

use lagrange::LANES;
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use super::candidate::Candidate;
use super::study::{Fitted, Study};
use crate::effect::{Action, Kind};
use crate::hybrid::{DrivenInputs, HiddenPath, Hybrid, Placed, Reading};
use crate::shooting::problem::Problem;
use crate::shooting::{Accumulator, Member, ObservedRun, Roller, SmallForce};
use crate::shooting::{Trajectory, Variation, Window, roll_all};

/// So many windows have their normal equations in memory at once.
const AT_ONCE: usize = 16;

/// What the screen says of one candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// The candidate.
    pub candidate: Candidate,
    /// Parameters to start a fit from: the best probe's step; of a law with a memory every probe that explains anything, the best first.
    pub starts: Vec<Vec<f64>>,
    /// Gain in log-likelihood that the linearisation promises, nats.
    pub gain: f64,
    /// Cluster-robust t².
    pub t2: f64,
    /// The share of its information that the constants already free span: near 1 for what they can imitate.
    pub spanned: f64,
    /// Gain that the linearisation promises when what the free constants are stretched by counts as well, nats.
    pub relief: f64,
    /// The step that gives it, where there is one.
    pub relieving: Option<Relieving>,
}

/// A step by which a candidate takes over from stretched constants.
#[derive(Debug, Clone, PartialEq)]
pub struct Relieving {
    /// Its parameters.
    pub start: Vec<f64>,
    /// What it moves the free constants by.
    pub shift: Vec<f64>,
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
    /// Score of each column by itself. At the fit the pull of the data on the free constants is that of their priors, so this is the
    /// efficient score when the priors count.
    pull: Vec<f64>,
    /// How the free constants follow a step of each column, with the opposite sign: S_nn⁻¹ S_nc.
    by_nuisance: DMatrix<f64>,
}

#[derive(Debug, Clone)]
struct Column {
    candidate: Candidate,
    neutral: Vec<f64>,
    perturbed: Vec<f64>,
}

impl Column {
    /// The parameters a step of `factor` probes away, within their bounds; `None` when the bounds allow no step that way. Laws with a memory
    /// are far from linear in theirs: the probe itself is the start, unless the data ask for its opposite.
    fn start(&self, factor: f64) -> Option<Vec<f64>> {
        if self.candidate.kind.states() > 0 {
            return (factor > 0.0).then(|| self.perturbed.clone());
        }
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

/// What a probe changes.
#[derive(Clone, Copy, PartialEq)]
enum Change {
    /// Only what is read of the fitted model's states.
    Reading,
    /// Forces along them: to first order about the fitted model's roll-out. Where one on a joint is all there is, its effect.
    Forces(Option<usize>),
    /// The states themselves, or the mechanics: it is rolled out.
    Motion,
}

/// A candidate a probe's step into the model.
struct Probed {
    hybrid: Hybrid,
    theta: Vec<f64>,
    /// The inputs after its drives; none where they are those of the fitted model.
    inputs: Option<Vec<DrivenInputs>>,
    readings: Vec<Reading>,
    /// Where the recordings take its hidden states.
    paths: Vec<HiddenPath>,
    change: Change,
    /// The states of the fitted model that it has too, by their place in h.
    kept: Vec<Option<usize>>,
}

impl Probed {
    /// `None` where the samples do not follow it.
    fn new(study: &Study, fitted: &Fitted, column: &Column) -> Option<Self> {
        let (hybrid, theta) =
            column
                .candidate
                .place(&fitted.hybrid, &fitted.inside.theta, &column.perturbed);
        if !study.resolves(&hybrid, &theta) {
            return None;
        }
        let substeps = study.substeps_for(&hybrid, &theta);
        let kind = column.candidate.kind;
        let same_states = kind.states() == 0
            && kind.inertial().is_none()
            && hybrid.nh() == fitted.hybrid.nh()
            && substeps == fitted.substeps;
        let beside = column.candidate.replaces(&fitted.hybrid).is_none();
        let change = match kind.action {
            Action::Sensor(_) if same_states && beside => Change::Reading,
            Action::Joint(_) if same_states && beside => {
                Change::Forces(hybrid.effects().len().checked_sub(1))
            }
            _ if same_states => Change::Forces(None),
            _ => Change::Motion,
        };
        let same_inputs = substeps == fitted.substeps && !matches!(kind.action, Action::Drive(_));
        let drive = |run: &ObservedRun| hybrid.drive(&run.t, &run.u, substeps, &theta, &[]);
        let runs = &study.observations.runs;
        Some(Probed {
            inputs: (!same_inputs).then(|| runs.iter().map(drive).collect()),
            readings: hybrid.readings(&theta, &[]),
            paths: study.hidden_paths(&hybrid, &theta, substeps),
            change,
            kept: kept_states(&hybrid, &fitted.hybrid),
            hybrid,
            theta,
        })
    }

    /// The inputs, where `fitted` are those of the fitted model.
    fn inputs<'a>(&'a self, fitted: &'a [DrivenInputs]) -> &'a [DrivenInputs] {
        self.inputs.as_deref().unwrap_or(fitted)
    }

    /// Where it is rolled out, its states at the samples of each window that starts at the fitted model's `states`.
    fn moved(
        &self,
        windows: &[Window],
        states: &[Vec<f64>],
        fitted: &[DrivenInputs],
    ) -> Vec<Option<Trajectory>> {
        if self.change != Change::Motion {
            return Vec::new();
        }
        let inputs = self.inputs(fitted);
        let starts: Vec<Vec<f64>> = windows
            .iter()
            .zip(states)
            .map(|(window, state)| self.start(window, state))
            .collect();
        let members: Vec<Member> = windows
            .iter()
            .zip(&starts)
            .map(|(window, initial)| Member {
                inputs: &inputs[window.run],
                span: (window.first, window.count),
                initial,
            })
            .collect();
        roll_all((&self.hybrid, &self.theta, &[]), &members, false)
    }

    /// The initial state (q, v, h) of a window that starts at `state` in the fitted model.
    fn start(&self, window: &Window, state: &[f64]) -> Vec<f64> {
        let visible = self.hybrid.nx() - self.hybrid.nh();
        let mut start = state[..visible].to_vec();
        let found = self.kept.iter().enumerate();
        start.extend(found.map(|(k, kept)| match kept {
            Some(old) => state[visible + old],
            None => self.paths[window.run].at(window.first)[k],
        }));
        start
    }
}

/// For each of h of `new` its place in h of `old`.
fn kept_states(new: &Hybrid, old: &Hybrid) -> Vec<Option<usize>> {
    let mut kept = Vec::with_capacity(new.nh());
    for (index, effect) in new.effects().iter().enumerate() {
        let same = |e: &Placed| e.kind == effect.kind && e.target == effect.target;
        let place = old.effects().iter().position(same);
        let first = place.map(|k| old.state_range(k).start);
        kept.extend((0..new.state_range(index).len()).map(|k| first.map(|first| first + k)));
    }
    kept
}

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
                .map(move |probe| Column {
                    candidate,
                    neutral: probe.neutral,
                    perturbed: probe.perturbed,
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
            let step = self.pull[k] / d;
            let relieving = column.start(step).map(|start| Relieving {
                start,
                shift: self
                    .by_nuisance
                    .column(k)
                    .iter()
                    .map(|x| -step * x)
                    .collect(),
            });
            let starts: Vec<Vec<f64>> = column.start(b / d).into_iter().collect();
            if starts.is_empty() && relieving.is_none() {
                continue;
            }
            // Where the bounds allow no step, none is promised.
            let score = if starts.is_empty() { 0.0 } else { b };
            let screened = Screened {
                candidate: column.candidate,
                starts,
                gain: 0.5 * score * score / d,
                t2: score * score / squares,
                spanned: 1.0 - d / self.alone[k],
                relief: 0.5 * self.pull[k].powi(2) / d,
                relieving,
            };
            let Some(known) = best.iter_mut().find(|s| s.candidate == column.candidate) else {
                best.push(screened);
                continue;
            };
            let (better, other) =
                match (known.gain, known.relief) < (screened.gain, screened.relief) {
                    true => {
                        let other = std::mem::replace(known, screened);
                        (known, other)
                    }
                    false => (known, screened),
                };
            if column.candidate.kind.states() > 0 {
                better.starts.extend(other.starts);
            }
        }
        best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        self.ranked = best;
    }

    /// Candidates whose probes change the roll-outs almost as a probe of `candidate` does, once initial states and free constants have
    /// given what they can: 1 − ρ² below `distance`. The most alike first.
    pub fn lookalikes(&self, candidate: &Candidate, distance: f64) -> Vec<&Screened> {
        let own = |c: &Candidate| {
            let columns = self.columns.iter().enumerate();
            let own: Vec<usize> = columns
                .filter(|(_, column)| column.candidate == *c)
                .map(|(k, _)| k)
                .collect();
            own
        };
        let far = |i: usize, j: usize| {
            let product = self.information[(i, i)] * self.information[(j, j)];
            1.0 - self.information[(i, j)].powi(2) / product
        };
        let here = own(candidate);
        let mut alike: Vec<(f64, &Screened)> = Vec::new();
        for other in self.ranked.iter().filter(|s| s.candidate != *candidate) {
            let there = own(&other.candidate);
            let pairs = here
                .iter()
                .flat_map(|&i| there.iter().map(move |&j| (i, j)));
            let nearest = pairs.map(|(i, j)| far(i, j)).fold(1.0, f64::min);
            if nearest < distance {
                alike.push((nearest, other));
            }
        }
        alike.sort_by(|a, b| a.0.total_cmp(&b.0));
        alike.into_iter().map(|(_, screened)| screened).collect()
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
