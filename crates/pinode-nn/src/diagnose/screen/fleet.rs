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

#[cfg(test)]
mod tests {
    #![allow(clippy::panic)]

    use nalgebra::{DMatrix, DVector};

    use super::super::probed::Column;
    use super::*;

    /// A delay of one sample on each of two inputs, in two windows with these scores a column, and this information.
    fn screen(scores: [[f64; 2]; 2], information: [f64; 4]) -> Screen {
        let column = |target| Column {
            candidate: Candidate::named("input_delay", target),
            neutral: vec![0.0],
            perturbed: vec![0.02],
            known: 0.0,
            pace: 1.0,
        };
        let mut screen = Screen {
            ranked: Vec::new(),
            suggested: Vec::new(),
            columns: vec![column(0), column(1)],
            scores: scores.map(|s| DVector::from_column_slice(&s)).to_vec(),
            information: DMatrix::from_row_slice(2, 2, &information),
            alone: DMatrix::from_diagonal_element(2, 2, 4.0),
            strain: DVector::zeros(2),
            by_nuisance: DMatrix::zeros(0, 2),
        };
        screen.rank();
        screen
    }

    #[test]
    fn what_all_inputs_have_in_common_is_promised_by_one_shared_step() {
        // b = (3, 5), Σ D = 4 + 2·1 + 4: x = 0.8 samples, ½ b x = 3.2; by themselves ½ 9/4 and ½ 25/4.
        let alike = screen([[1.0, 2.0], [2.0, 3.0]], [4.0, 1.0, 1.0, 4.0]);
        let fleets = alike.fleets();
        let [fleet] = &fleets[..] else {
            panic!("{fleets:?}")
        };
        assert!((fleet.gain - 3.2).abs() < 1e-12, "{}", fleet.gain);
        for (target, (candidate, start)) in fleet.members.iter().enumerate() {
            assert_eq!(*candidate, Candidate::named("input_delay", target));
            assert!((start[0] - 0.016).abs() < 1e-12, "{start:?}");
        }
    }

    #[test]
    fn nothing_is_common_where_one_input_promises_more_by_itself_or_the_other_way() {
        let one = screen([[1.0, 0.1], [4.0, -0.1]], [4.0, 1.0, 1.0, 4.0]);
        assert!(one.fleets().is_empty());
        // A delay cannot be negative.
        let early = screen([[-1.0, -2.0], [-2.0, -3.0]], [4.0, 1.0, 1.0, 4.0]);
        assert!(early.fleets().is_empty());
    }
}
