//! What all inputs may have in common: motors of one make are late, slow or weak alike.

use super::{Candidate, Screen};
use crate::effect::{Action, ActsOn};

/// One kind on every input, alike on all.
#[derive(Debug, Clone, PartialEq)]
pub struct ScreenedFleet {
    /// The candidates, one an input, each with the step that they take together.
    pub members: Vec<(Candidate, Vec<f64>)>,
    /// Gain that the linearisation promises to that one step, nats.
    pub gain: f64,
}

impl Screen {
    /// Drive effects of one parameter on all inputs at once that promise more, by one step that they share, than any candidate by itself: x = Σ b_i / Σ D_ij
    /// over their columns gains (Σ b_i)² / 2 Σ D_ij. The best first.
    pub fn fleets(&self) -> Vec<ScreenedFleet> {
        let leading = self.ranked.first().map_or(0.0, |s| s.gain);
        let mut fleets: Vec<ScreenedFleet> = Vec::new();
        for (k, column) in self.columns.iter().enumerate() {
            let kind = column.candidate.kind;
            let drives = matches!(kind.action, Action::Drive(_)) && kind.acts_on() == ActsOn::Input;
            let first = !self.columns[..k].iter().any(|c| c.candidate.kind == kind);
            if drives && kind.parameters.len() == 1 && first {
                let own = self.best_columns(k);
                let fleet = self.fleet(&own).filter(|fleet| fleet.gain > leading);
                fleets.extend(fleet);
            }
        }
        fleets.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        fleets
    }

    /// The columns of the kind of column `k` that promise most, one a target.
    fn best_columns(&self, k: usize) -> Vec<usize> {
        let gain = |k: usize| self.total(k).powi(2) / self.information[(k, k)];
        let mut best: Vec<usize> = Vec::new();
        for (j, column) in self.columns.iter().enumerate() {
            if column.candidate.kind != self.columns[k].candidate.kind {
                continue;
            }
            let same = |i: &&mut usize| self.columns[**i].candidate == column.candidate;
            match best.iter_mut().find(same) {
                Some(known) if gain(j) > gain(*known) => *known = j,
                Some(_) => {}
                None => best.push(j),
            }
        }
        best
    }

    /// `None` of a single one, and where the bounds of one allow no such step.
    fn fleet(&self, columns: &[usize]) -> Option<ScreenedFleet> {
        if columns.len() < 2 {
            return None;
        }
        let b: f64 = columns.iter().map(|&i| self.total(i)).sum();
        let pairs = columns
            .iter()
            .flat_map(|&i| columns.iter().map(move |&j| (i, j)));
        let d: f64 = pairs.map(|at| self.information[at]).sum();
        let step = (d > 0.0).then(|| b / d)?;
        let member = |&k: &usize| {
            let column = &self.columns[k];
            Some((column.candidate, column.start(step)?))
        };
        let members = columns.iter().map(member).collect::<Option<Vec<_>>>()?;
        Some(ScreenedFleet {
            members,
            gain: 0.5 * step * b,
        })
    }
}
