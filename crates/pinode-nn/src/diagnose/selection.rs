//! Which of many columns explain a vector together.
//!
//! The set grows by the column that explains most. One that another does better in the place of gives way to that, and what the others make needless goes (sequential
//! replacement: Miller, *Subset Selection in Regression*, 2002, ch. 3): what is taken first for parts of two laws would else stay beside one of them.

use std::iter::repeat_n;

use nalgebra::{Cholesky, DMatrix, DVector};

/// Samples of a smoothed log have their noise in common, and so many of them count as one.
const ALIKE: f64 = 3.0;
/// A column is taken for so many nats, by ln n of the samples that count …
const WORTH: f64 = 4.0;
/// … and if it explains this share of what is left.
const SHARE: f64 = 0.03;

/// Least squares over any of the columns: y = X x + noise, with some of them always there.
pub struct Regression {
    /// XᵀX.
    products: DMatrix<f64>,
    /// Xᵀy.
    with: DVector<f64>,
    /// yᵀy.
    square: f64,
    /// How many of the first columns are always there, and by how much each of them is held at 0 by what is known of it, in residual variances.
    held: Vec<f64>,
    /// The variance of what all columns together leave.
    variance: f64,
    /// Rows that count.
    rows: f64,
}

impl Regression {
    /// `y` over columns of which as many as are `held` are always there.
    pub fn of<'a>(
        y: &DVector<f64>,
        columns: impl Iterator<Item = &'a DVector<f64>>,
        held: Vec<f64>,
    ) -> Self {
        let columns: Vec<&DVector<f64>> = columns.collect();
        let n = columns.len();
        let mut products = DMatrix::zeros(n, n);
        for (i, a) in columns.iter().enumerate() {
            for (j, b) in columns.iter().enumerate().take(i + 1) {
                let product = a.dot(b);
                (products[(i, j)], products[(j, i)]) = (product, product);
            }
        }
        Regression {
            products,
            with: DVector::from_iterator(n, columns.iter().map(|column| column.dot(y))),
            square: y.norm_squared(),
            held,
            // In units of the noise, until more is known.
            variance: 1.0,
            rows: (y.len() as f64 / ALIKE).max(1.0),
        }
    }

    /// The steps along what is always there and along `chosen`, of those after them, and what they leave: Σ r² + Σ x² held.
    fn solve(&self, chosen: &[usize]) -> Option<(DVector<f64>, f64)> {
        let always = self.held.len();
        let columns: Vec<usize> = (0..always)
            .chain(chosen.iter().map(|k| always + k))
            .collect();
        let held = self.held.iter().map(|held| held * self.variance);
        let held: Vec<f64> = held.chain(repeat_n(0.0, chosen.len())).collect();
        let diagonal = |a: usize| self.products[(columns[a], columns[a])] + held[a];
        let unit: Vec<f64> = (0..columns.len()).map(|a| diagonal(a).sqrt()).collect();
        if !unit.iter().all(|unit| *unit > 0.0) {
            return None;
        }
        let scaled = DMatrix::from_fn(columns.len(), columns.len(), |a, b| match a == b {
            // What others span has no step of its own.
            true => 1.0 + f64::EPSILON.sqrt(),
            false => self.products[(columns[a], columns[b])] / (unit[a] * unit[b]),
        });
        let with = DVector::from_fn(columns.len(), |a, _| self.with[columns[a]] / unit[a]);
        let x = Cholesky::new(scaled)?.solve(&with);
        let left = self.square - x.dot(&with);
        Some((
            x.zip_map(&DVector::from_vec(unit), |x, unit| x / unit),
            left,
        ))
    }

    /// The columns that earn their place, at most so many, each with its step; only with steps that are `allowed`.
    pub fn choose(
        &mut self,
        most: usize,
        allowed: &dyn Fn(usize, f64) -> bool,
    ) -> Vec<(usize, f64)> {
        let all: Vec<usize> = (0..self.products.nrows() - self.held.len()).collect();
        if let Some((_, left)) = self.solve(&all) {
            self.variance = (left / (ALIKE * self.rows)).max(1.0);
        }
        let mut chosen = Vec::new();
        let mut steps = Vec::new();
        let mut at = self.set(Vec::new(), allowed);
        while let Some(set) = at {
            at = self.better(&set, most, allowed);
            (chosen, steps) = (set.columns, set.steps);
        }
        chosen.into_iter().zip(steps).collect()
    }

    /// A set next to this one that is better: with another column in the place of one, or with one more, and without what that makes needless.
    fn better(&self, set: &Set, most: usize, allowed: &dyn Fn(usize, f64) -> bool) -> Option<Set> {
        let all = 0..self.products.nrows() - self.held.len();
        let others: Vec<usize> = all.filter(|k| !set.columns.contains(k)).collect();
        let best = |sets: &mut dyn Iterator<Item = Vec<usize>>| {
            let sets = sets.filter_map(|columns| self.set(columns, allowed));
            sets.min_by(|a, b| a.left.total_cmp(&b.left))
        };
        let exchange = |(k, new): (usize, usize)| {
            let mut columns = set.columns.clone();
            columns[k] = new;
            columns
        };
        let places = 0..set.columns.len();
        let exchanges = places.flat_map(|k| others.iter().map(move |&new| (k, new)));
        let exchanged = best(&mut exchanges.map(exchange));
        let exchanged = exchanged.filter(|new| new.left < (1.0 - SHARE) * set.left);
        let grown = || {
            let grown = others.iter().map(|&k| [&set.columns[..], &[k]].concat());
            let grown = best(&mut grown.filter(|columns| columns.len() <= most));
            grown.filter(|new| self.earns(new.left, set.left))
        };
        let mut new = exchanged.or_else(grown)?;
        // What came before the newest and is missed least.
        let without = |set: &Set| {
            let older = 0..set.columns.len().saturating_sub(1);
            best(&mut older.map(|k| [&set.columns[..k], &set.columns[k + 1..]].concat()))
        };
        while let Some(less) = without(&new).filter(|less| !self.earns(new.left, less.left)) {
            new = less;
        }
        Some(new)
    }

    /// Whether one column is worth what it takes away of what is left.
    fn earns(&self, with: f64, without: f64) -> bool {
        let nats = 0.5 * self.rows * (without / with).ln();
        nats > WORTH * self.rows.ln() && with < (1.0 - SHARE) * without
    }

    /// These columns, if their steps are allowed.
    fn set(&self, columns: Vec<usize>, allowed: &dyn Fn(usize, f64) -> bool) -> Option<Set> {
        let (x, left) = self.solve(&columns)?;
        let steps: Vec<f64> = x.iter().skip(self.held.len()).copied().collect();
        let are_allowed = columns.iter().zip(&steps).all(|(&k, &x)| allowed(k, x));
        (left > 0.0 && are_allowed).then_some(Set {
            columns,
            steps,
            left,
        })
    }
}

/// Columns beside those that are always there.
struct Set {
    columns: Vec<usize>,
    steps: Vec<f64>,
    /// What they leave.
    left: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::pseudo;

    const ROWS: usize = 900;
    /// What a known constant of the mechanism does to the accelerations, one tolerance of it; then a spring, two frictions and what looks much like both of them.
    fn columns() -> Vec<DVector<f64>> {
        let wave = |phase: f64| {
            DVector::from_fn(ROWS, |k, _| {
                40.0 * (0.05 * k as f64 + phase * k as f64).sin()
            })
        };
        let (known, spring, viscous, dry) = (wave(0.0), wave(0.31), wave(0.57), wave(0.83));
        let both = 0.7 * &viscous + 0.7 * &dry + 0.2 * wave(0.71);
        vec![known, spring, viscous, dry, both]
    }

    /// The laws that are chosen, after the known constant, of what holds so many tolerances of that, of the spring and of the frictions.
    fn chosen(x: [f64; 4], allowed: &dyn Fn(usize, f64) -> bool) -> Vec<(usize, f64)> {
        let columns = columns();
        let noise = DVector::from_fn(ROWS, |k, _| 2.0 * pseudo(k, 0.3));
        let y = x.iter().zip(&columns).map(|(x, column)| *x * column);
        let y = y.fold(noise, |sum, part| sum + part);
        let mut regression = Regression::of(&y, columns.iter(), vec![1.0]);
        let mut chosen = regression.choose(4, allowed);
        chosen.sort_by_key(|(k, _)| *k);
        chosen
    }

    #[test]
    fn what_stood_for_two_laws_goes_when_both_are_there() {
        let found = chosen([0.5, 0.0, 1.0, 0.8], &|_, _| true);
        let names: Vec<usize> = found.iter().map(|(k, _)| *k).collect();
        assert_eq!(names, [1, 2], "{found:?}");
        for ((_, x), expected) in found.into_iter().zip([1.0, 0.8]) {
            assert!((x - expected).abs() < 0.01, "{x} for {expected}");
        }
    }

    #[test]
    fn what_a_known_constant_explains_within_its_tolerance_is_no_law() {
        assert_eq!(chosen([0.5, 0.0, 0.0, 0.0], &|_, _| true), []);
    }

    #[test]
    fn no_law_is_taken_with_a_constant_that_it_cannot_have() {
        let found = chosen([0.0, -1.0, 1.0, 0.0], &|k, x| k != 0 || x > 0.0);
        assert!(found.iter().all(|(k, _)| *k != 0), "{found:?}");
        assert!(found.iter().any(|(k, _)| *k == 1), "{found:?}");
    }
}
