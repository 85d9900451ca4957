//! Which of many columns explain a vector together.
//!
//! The set grows by the column that explains most. One that another does better in the place of gives way to that, and what the others make needless goes (sequential
//! replacement: Miller, *Subset Selection in Regression*, 2002, ch. 3): what is taken first for parts of two laws would else stay beside one of them.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Samples of a smoothed log have their noise in common, and so many of them count as one.
const ALIKE: f64 = 3.0;
/// A column is taken for so many nats, by ln n of the samples that count …
const WORTH: f64 = 4.0;
/// … and if it explains this share of what is left.
const SHARE: f64 = 0.03;
/// A column of which the others leave less than this share is spanned by them.
const SPANNED: f64 = 1e-8;

/// Least squares over any of the columns: y = X x + noise.
pub struct Regression {
    /// [X y]ᵀ[X y], of what the columns that are always there leave of both.
    products: DMatrix<f64>,
    /// Rows that count.
    rows: f64,
}

/// Columns beside those that are always there.
struct Set {
    columns: Vec<usize>,
    steps: Vec<f64>,
    /// y of which they leave this square.
    left: f64,
}

/// Whether a set of columns may have these steps.
pub type Allowed<'a> = &'a dyn Fn(&[usize], &[f64]) -> bool;

impl Regression {
    /// `y`, in units of its noise, over columns of which the first are always there. These have a variance of 1 about 0 where they are `held`. `None` where anything
    /// is not finite, or a column is 0.
    pub fn of(y: &DVector<f64>, columns: &[DVector<f64>], held: &[bool]) -> Option<Self> {
        let all: Vec<&DVector<f64>> = columns.iter().chain([y]).collect();
        let n = all.len();
        let mut products = DMatrix::zeros(n, n);
        for (i, a) in all.iter().enumerate() {
            for (j, b) in all.iter().enumerate().take(i + 1) {
                let product = a.dot(b);
                (products[(i, j)], products[(j, i)]) = (product, product);
            }
        }
        if !products.iter().all(|p| p.is_finite()) {
            return None;
        }
        // In units of the noise, the variance of what all columns together leave.
        let left = beside(&products, n - 1)?[(0, 0)];
        let variance = (left / y.len() as f64).max(1.0);
        for (k, held) in held.iter().enumerate() {
            products[(k, k)] += ALIKE * variance * f64::from(u8::from(*held));
        }
        Some(Regression {
            products: beside(&products, held.len())?,
            rows: (y.len() as f64 / ALIKE).max(1.0),
        })
    }

    /// The columns, of those that are not always there, that earn their place, at most so many, each with its step; only with steps that are `allowed`.
    pub fn choose(&self, most: usize, allowed: Allowed) -> Vec<(usize, f64)> {
        let (mut chosen, mut steps) = (Vec::new(), Vec::new());
        let mut next = self.set(Vec::new(), allowed);
        while let Some(set) = next {
            next = self.better(&set, most, allowed);
            (chosen, steps) = (set.columns, set.steps);
        }
        chosen.into_iter().zip(steps).collect()
    }

    /// A set next to this one that is better: with another column in the place of one, or with one more, and without what that makes needless.
    fn better(&self, set: &Set, most: usize, allowed: Allowed) -> Option<Set> {
        let without = |columns: &[usize], k: usize| [&columns[..k], &columns[k + 1..]].concat();
        let places = set.columns.iter().enumerate();
        let exchanged = places
            .filter_map(|(k, old)| self.grown(&without(&set.columns, k), Some(*old), allowed));
        let exchanged = least(exchanged).filter(|new| new.left < (1.0 - SHARE) * set.left);
        let grown = || {
            let grown = self.grown(&set.columns, None, allowed);
            grown.filter(|new| set.columns.len() < most && self.earns(new.left, set.left))
        };
        let mut new = exchanged.or_else(grown)?;
        // What came before the newest and is missed least.
        let shrunk = |set: &Set| {
            let older = 0..set.columns.len().saturating_sub(1);
            least(older.filter_map(|k| self.set(without(&set.columns, k), allowed)))
        };
        while let Some(less) = shrunk(&new).filter(|less| !self.earns(new.left, less.left)) {
            new = less;
        }
        Some(new)
    }

    /// These columns and the one of the others, but for one, that leaves least beside them.
    fn grown(&self, columns: &[usize], but: Option<usize>, allowed: Allowed) -> Option<Set> {
        let y = self.products.nrows() - 1;
        let others = (0..y).filter(|k| !columns.contains(k) && but != Some(*k));
        let others: Vec<usize> = others.chain([y]).collect();
        let of = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |a, b| {
                self.products[(rows[a], columns[b])]
            })
        };
        let shared = of(columns, &others);
        let spanned = Normal::of(&of(columns, columns))?.solve(&shared);
        let with_y = others.len() - 1;
        // What the columns leave of the product of another with itself, or with y.
        let left = |a: usize, b: usize| {
            self.products[(others[a], others[b])] - shared.column(a).dot(&spanned.column(b))
        };
        let mut gains: Vec<(f64, usize)> = (0..with_y)
            .filter_map(|a| {
                let (own, whole) = (left(a, a), self.products[(others[a], others[a])]);
                (own > SPANNED * whole).then(|| (left(a, with_y).powi(2) / own, others[a]))
            })
            .collect();
        gains.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut sets = gains.into_iter();
        sets.find_map(|(_, k)| self.set([columns, &[k]].concat(), allowed))
    }

    /// Whether one column is worth what it takes away of what is left.
    fn earns(&self, with: f64, without: f64) -> bool {
        let nats = 0.5 * self.rows * (without / with).ln();
        nats > WORTH * self.rows.ln() && with < (1.0 - SHARE) * without
    }

    /// These columns, if their steps are allowed.
    fn set(&self, columns: Vec<usize>, allowed: Allowed) -> Option<Set> {
        let (n, y) = (columns.len(), self.products.nrows() - 1);
        let products = DMatrix::from_fn(n, n, |a, b| self.products[(columns[a], columns[b])]);
        let with = DMatrix::from_fn(n, 1, |a, _| self.products[(columns[a], y)]);
        let x = Normal::of(&products)?.solve(&with);
        let left = self.products[(y, y)] - x.dot(&with);
        let steps: Vec<f64> = x.iter().copied().collect();
        (left > 0.0 && allowed(&columns, &steps)).then_some(Set {
            columns,
            steps,
            left,
        })
    }
}

/// The set that leaves least.
fn least(sets: impl Iterator<Item = Set>) -> Option<Set> {
    sets.min_by(|a, b| a.left.total_cmp(&b.left))
}

/// What the first columns leave of the products of the others.
fn beside(products: &DMatrix<f64>, first: usize) -> Option<DMatrix<f64>> {
    let others = products.nrows() - first;
    let own = products.view((0, 0), (first, first)).into_owned();
    let shared = products.view((0, first), (first, others)).into_owned();
    let rest = products.view((first, first), (others, others));
    Some(rest - shared.transpose() * Normal::of(&own)?.solve(&shared))
}

/// Normal equations, with a diagonal of 1.
struct Normal {
    unit: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl Normal {
    /// `None` where a column is 0.
    fn of(products: &DMatrix<f64>) -> Option<Self> {
        let unit = products.diagonal().map(f64::sqrt);
        if !unit.iter().all(|unit| *unit > 0.0) {
            return None;
        }
        let n = unit.len();
        let scaled = DMatrix::from_fn(n, n, |a, b| match a == b {
            // What others span has no step of its own.
            true => 1.0 + f64::EPSILON.sqrt(),
            false => products[(a, b)] / (unit[a] * unit[b]),
        });
        let factor = Cholesky::new(scaled)?;
        Some(Normal { unit, factor })
    }

    fn solve(&self, with: &DMatrix<f64>) -> DMatrix<f64> {
        let in_units = |of: &DMatrix<f64>| {
            DMatrix::from_fn(of.nrows(), of.ncols(), |a, b| of[(a, b)] / self.unit[a])
        };
        in_units(&self.factor.solve(&in_units(with)))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

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
    fn chosen(x: [f64; 4], allowed: Allowed) -> Vec<(usize, f64)> {
        let columns = columns();
        let noise = DVector::from_fn(ROWS, |k, _| 2.0 * pseudo(k, 0.3));
        let y = x.iter().zip(&columns).map(|(x, column)| *x * column);
        let y = y.fold(noise, |sum, part| sum + part);
        let regression = Regression::of(&y, &columns, &[true]).unwrap();
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
        let are_positive = |columns: &[usize], steps: &[f64]| {
            let mut all = columns.iter().zip(steps);
            all.all(|(&k, &x)| k != 0 || x > 0.0)
        };
        let found = chosen([0.0, -1.0, 1.0, 0.0], &are_positive);
        assert!(found.iter().all(|(k, _)| *k != 0), "{found:?}");
        assert!(found.iter().any(|(k, _)| *k == 1), "{found:?}");
    }
}
