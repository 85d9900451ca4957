//! Columns between the probes of a candidate.
//!
//! To first order in its size the effect of a payload is a parabola in its place x, and three probes tell all of it: with Lagrange's polynomials L_i the column at x is Σ L_i(x) c_i, and
//! so are its scores and its information. Where it explains most, or relieves most, is seldom where a probe was.

use nalgebra::{DMatrix, DVector};

use super::Screen;
use super::probed::Column;

/// So many places between the nearest and the farthest, each as many times as far as the one before.
const PLACES: usize = 60;
/// The nearest of them, in parts of the farthest.
const NEAREST: f64 = 0.01;
/// A place is as good as a probe where it promises no more than so many times as much.
const BETTER: f64 = 1.01;

impl Screen {
    /// Adds columns where candidates that are known between their probes promise most, and relieve most.
    pub(super) fn look_between_probes(&mut self) {
        let mut known: Vec<Vec<usize>> = Vec::new();
        for (k, column) in self.columns.iter().enumerate() {
            let same = |group: &&mut Vec<usize>| {
                let first = group.first().and_then(|&first| self.columns.get(first));
                first.is_some_and(|first| first.candidate == column.candidate)
            };
            match known.iter_mut().find(same) {
                Some(group) => group.push(k),
                None if column.candidate.kind.place().is_some() => known.push(vec![k]),
                None => {}
            }
        }
        for probes in known {
            let between = self.between(&probes);
            for (column, weights) in between {
                self.append(column, &weights);
            }
        }
    }

    /// The columns between these that promise more, or relieve more, than any of them, each with its weights. None where they do not know it everywhere: beside what
    /// is there already, one probe is left.
    fn between(&self, probes: &[usize]) -> Vec<(Column, DVector<f64>)> {
        let first = &self.columns[probes[0]];
        let Some(place) = first.candidate.kind.place() else {
            return Vec::new();
        };
        let others = probes.iter().map(|&k| &self.columns[k]);
        let is_held = |c: &Column| c.neutral[place] == c.perturbed[place];
        if probes.len() < 3 || !others.clone().all(is_held) {
            return Vec::new();
        }
        let nodes: Vec<f64> = others.map(|c| c.perturbed[place]).collect();
        let farthest = first.candidate.kind.parameters[place].upper;
        let at = |i: usize| {
            let part = i as f64 / PLACES as f64;
            farthest * NEAREST.powf(1.0 - part)
        };
        let places = (0..PLACES).map(at).map(|x| (x, lagrange(&nodes, x)));
        let all: Vec<(f64, DVector<f64>)> = places
            .map(|(x, weights)| {
                let mut spread = DVector::zeros(self.columns.len());
                for (&k, weight) in probes.iter().zip(weights) {
                    spread[k] = weight;
                }
                (x, spread)
            })
            .collect();
        let scores = self.scores.iter();
        let total = scores.fold(DVector::zeros(self.columns.len()), |sum, e| sum + e);
        let promised = [total.clone(), self.strain.clone(), total + &self.strain];
        let mut chosen: Vec<(Column, DVector<f64>)> = Vec::new();
        for pull in &promised {
            // Half the square of the pull along a column, where it pulls into it, over its information.
            let worth = |weights: &DVector<f64>| {
                let along = pull.dot(weights).max(0.0);
                let information = weights.dot(&(&self.information * weights));
                match information > 0.0 {
                    true => 0.5 * along * along / information,
                    false => 0.0,
                }
            };
            let unit = |k: &usize| {
                let mut weights = DVector::zeros(self.columns.len());
                weights[*k] = 1.0;
                worth(&weights)
            };
            let reached = probes.iter().map(unit).fold(0.0, f64::max);
            let best = all
                .iter()
                .max_by(|a, b| worth(&a.1).total_cmp(&worth(&b.1)));
            let better = best.filter(|(_, weights)| worth(weights) > BETTER * reached);
            let Some((x, weights)) = better else {
                continue;
            };
            let mut column = first.clone();
            column.neutral[place] = *x;
            column.perturbed[place] = *x;
            if chosen.iter().all(|(c, _)| c.perturbed != column.perturbed) {
                chosen.push((column, weights.clone()));
            }
        }
        chosen
    }

    /// Adds a column that is a sum of those that are there.
    fn append(&mut self, column: Column, weights: &DVector<f64>) {
        let n = self.columns.len();
        let weights = DVector::from_fn(n, |k, _| weights.get(k).copied().unwrap_or(0.0));
        self.information = bordered(&self.information, &weights);
        self.alone = bordered(&self.alone, &weights);
        for scores in &mut self.scores {
            let new = scores.dot(&weights);
            *scores = std::mem::take(scores).push(new);
        }
        let new = self.strain.dot(&weights);
        self.strain = std::mem::take(&mut self.strain).push(new);
        let new = &self.by_nuisance * &weights;
        let mut wider = std::mem::take(&mut self.by_nuisance).insert_column(n, 0.0);
        wider.set_column(n, &new);
        self.by_nuisance = wider;
        self.columns.push(column);
    }
}

/// Lagrange's polynomials over the `nodes` at x.
fn lagrange(nodes: &[f64], x: f64) -> Vec<f64> {
    let at = |(i, xi): (usize, &f64)| {
        let others = nodes.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, xj)| (x - xj) / (xi - xj)).product()
    };
    nodes.iter().enumerate().map(at).collect()
}

/// A symmetric matrix of products of columns with another one that is a sum of them.
fn bordered(products: &DMatrix<f64>, weights: &DVector<f64>) -> DMatrix<f64> {
    let n = products.nrows();
    let across = products * weights;
    let mut wider = products.clone().insert_row(n, 0.0).insert_column(n, 0.0);
    wider.view_mut((n, 0), (1, n)).tr_copy_from(&across);
    wider.view_mut((0, n), (n, 1)).copy_from(&across);
    wider[(n, n)] = across.dot(weights);
    wider
}

#[cfg(test)]
mod tests {
    #![allow(clippy::panic)]

    use super::*;
    use crate::diagnose::candidate::Candidate;

    const PROBES: [f64; 3] = [0.5, 2.0, 4.0];

    /// What 1 kg at a place changes of twelve residuals.
    fn change(x: f64) -> DVector<f64> {
        let moment =
            |k: i32| move |i: usize, _: usize| (0.7 * (i as f64 + 1.0) * f64::from(k)).sin();
        let [a, b, c] = [1, 2, 3].map(|k| DVector::from_fn(12, moment(k)));
        a + b * x + c * (x * x)
    }

    fn payload(place: f64) -> Column {
        Column {
            candidate: Candidate::named("payload", 1),
            neutral: vec![0.0, place],
            perturbed: vec![1.0, place],
            known: 0.0,
            pace: 1.0,
        }
    }

    /// A screen of these columns, where the residuals of two windows are those that 3 kg at this place would leave.
    fn screen(columns: &[Column], truth: f64) -> Screen {
        let place = |column: &Column| column.perturbed[1];
        let changes: Vec<DVector<f64>> = columns.iter().map(|c| change(place(c))).collect();
        let changes = DMatrix::from_columns(&changes);
        let left = change(truth) * 3.0;
        let half = |first: usize| changes.rows(first, 6).transpose() * left.rows(first, 6);
        let information = changes.transpose() * &changes;
        let mut screen = Screen {
            ranked: Vec::new(),
            suggested: Vec::new(),
            columns: columns.to_vec(),
            scores: vec![half(0), half(6)],
            alone: information.clone(),
            information,
            strain: DVector::zeros(columns.len()),
            by_nuisance: DMatrix::zeros(0, columns.len()),
        };
        screen.look_between_probes();
        screen.rank();
        screen
    }

    #[test]
    fn a_load_between_two_probes_is_promised_all_that_it_explains() {
        let screen = screen(&PROBES.map(payload), 1.3);
        let promised = &screen.ranked[0];
        let all = 0.5 * change(1.3).norm_squared() * 9.0;
        assert!(
            (promised.gain / all - 1.0).abs() < 1e-3,
            "{promised:?}, {all}"
        );
        let [mass, place] = promised.starts[0][..] else {
            panic!("{promised:?}")
        };
        assert!((place - 1.3).abs() < 0.06, "{place}");
        assert!((mass - 3.0).abs() < 0.2, "{mass}");
    }

    #[test]
    fn a_column_between_probes_is_that_of_a_probe_there() {
        let between = screen(&PROBES.map(payload), 1.3);
        let place = between.columns[3].perturbed[1];
        let [a, b, c] = PROBES;
        let probed = screen(&[a, b, c, place].map(payload), place);
        for (found, wanted) in [
            (&between.information, &probed.information),
            (&between.alone, &probed.alone),
        ] {
            let wanted = wanted.view((0, 0), found.shape());
            assert!((found - wanted).norm() < 1e-9 * wanted.norm());
        }
    }

    #[test]
    fn probes_that_move_the_place_know_it_nowhere_else() {
        assert_eq!(screen(&[payload(2.0)], 1.3).columns.len(), 1);
        let mut moved = PROBES.map(payload);
        moved[1].neutral[1] = 1.0;
        assert_eq!(screen(&moved, 1.3).columns.len(), 3);
    }
}
