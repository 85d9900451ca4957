//! Every candidate seen from one linearisation at the fitted model.
//!
//! A probe's column is the change of the roll-outs by a small step into the effect, a secant. After elimination of the windows' initial
//! states and of the constants already free, each column has a score e_w in every window and an information D:
//!
//! one-step gain = (Σ e_w)² / 2D,  t² = (Σ e_w)² / Σ e_w²,  step = Σ e_w / D.
//!
//! t² counts windows, not samples: residuals within a window are correlated.

mod between;
mod equations;
mod fleet;
mod probed;

use nalgebra::{DMatrix, DVector};

use super::candidate::Candidate;

pub use equations::{asked, columns, screen};
pub use probed::Column;

/// What the screen says of one candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// The candidate.
    pub candidate: Candidate,
    /// Parameters to start a fit from: the best probe's step; of what starts at its probes every one that the data ask for, of what the motion
    /// suggests what that shows, the best first. None where the bounds allow no step; then there is a relieving one.
    pub starts: Vec<Vec<f64>>,
    /// Whether the motion itself shows it: then it is worth a fit whatever the linearisation promises.
    pub shown: bool,
    /// Gain in log-likelihood that the linearisation promises, nats.
    pub gain: f64,
    /// Cluster-robust t².
    pub t2: f64,
    /// The share of its information that the constants already free span: near 1 for what they can imitate.
    pub spanned: f64,
    /// By how much less it promises to stretch the tolerances of the free constants, nats; never more than they are stretched by.
    pub relief: f64,
    /// The step that gives it, where there is one.
    pub relieving: Option<Relieving>,
}

impl Screened {
    /// What it promises in all, where bounds allow its steps, nats.
    fn worth(&self) -> f64 {
        let relief = self.relieving.as_ref().map_or(0.0, |_| self.relief);
        self.gain + relief
    }
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
    /// What the motion itself suggests, and where fits of it start.
    suggested: Vec<(Candidate, Vec<Vec<f64>>)>,
    columns: Vec<Column>,
    /// Efficient scores of all columns, one vector a window.
    scores: Vec<DVector<f64>>,
    /// Efficient information of all columns.
    information: DMatrix<f64>,
    /// Information of all columns by themselves.
    alone: DMatrix<f64>,
    /// What the priors of the free constants add to the efficient score of each column: S_cn S_nn⁻¹ P (θ − θ₀), P their weights.
    strain: DVector<f64>,
    /// How the free constants follow a step of each column, with the opposite sign: S_nn⁻¹ S_nc.
    by_nuisance: DMatrix<f64>,
}

impl Screen {
    fn total(&self, column: usize) -> f64 {
        self.scores.iter().map(|e| e[column]).sum()
    }

    /// Where fits start of what the motion itself suggests.
    fn suggestion(&self, candidate: &Candidate) -> Option<&[Vec<f64>]> {
        let mut suggested = self.suggested.iter();
        let found = suggested.find(|(c, _)| c == candidate);
        found.map(|(_, starts)| starts.as_slice())
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
            let strain = self.strain[k];
            let step = (b + strain) / d;
            let taken = match column.candidate.kind.starts_at_probes() {
                true => 1.0,
                false => step,
            };
            let relieving = column.start(step).map(|start| Relieving {
                start,
                shift: self
                    .by_nuisance
                    .column(k)
                    .iter()
                    .map(|x| -taken * x)
                    .collect(),
            });
            let start = column.start(b / d);
            // Where the bounds allow no step, none is promised.
            let score = if start.is_none() { 0.0 } else { b };
            let suggested = self.suggestion(&column.candidate);
            let starts: Vec<Vec<f64>> = match suggested {
                Some(starts) => starts.to_vec(),
                None => start.into_iter().collect(),
            };
            if starts.is_empty() && relieving.is_none() {
                continue;
            }
            let screened = Screened {
                candidate: column.candidate,
                starts,
                shown: suggested.is_some(),
                gain: 0.5 * score * score / d,
                t2: score * score / squares,
                spanned: 1.0 - d / self.alone[(k, k)],
                relief: 0.5 * strain * strain / d,
                relieving,
            };
            let Some(known) = best.iter_mut().find(|s| s.candidate == column.candidate) else {
                best.push(screened);
                continue;
            };
            let (better, other) = match known.worth() < screened.worth() {
                true => {
                    let other = std::mem::replace(known, screened);
                    (known, other)
                }
                false => (known, screened),
            };
            if suggested.is_none() && column.candidate.kind.starts_from_each_probe() {
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
                    && (a.candidate.contains(&b.candidate)
                        || b.candidate.contains(&a.candidate)
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
