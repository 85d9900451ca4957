//! Which equations are independent: the rank of J on φ = 0.

use std::fmt;

use nalgebra::DMatrix;

use super::Constraint;
use super::kinematics::Kinematics;
use super::project::{Open, Search, moved, spread};
use crate::{Error, Mechanics};

/// Configurations from which φ = 0 is sought, beside the first.
const STARTS: usize = 4;
/// An equation depends on others where the square of the sine between its row of J and their span is less than this.
const DEPENDENT: f64 = 1e-12;
/// A row shorter than this, and than this part of the longest, is 0: that is what rounding leaves of a loop across a plane.
const SHORTEST: f64 = 1e-10;
/// Where all of ∂φ/∂q is smaller, or some of it is larger, φ cannot be told from rounding or its squares are beyond the range of numbers.
const GRADIENTS: (f64, f64) = (1e-12, 1e100);

/// An equation that the others imply, and that is therefore left out.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Dropped {
    /// Its index among all equations of the constraint.
    pub equation: usize,
    /// Its name.
    pub name: String,
    /// Whether no motion changes it: its row of J is 0, or next to the others' nothing but rounding. Else the other equations imply it.
    pub always: bool,
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let why = if self.always {
            "no motion of the mechanism changes it"
        } else {
            "the other equations imply it"
        };
        write!(f, "`{}` is redundant and left out: {why}", self.name)
    }
}

/// The equations in force, and the others.
pub(super) struct Independent {
    pub kept: Vec<usize>,
    pub dropped: Vec<Dropped>,
}

/// φ = 0 from `start`; where the search stalls there (by symmetry, say), from some places around it.
pub(super) fn from_nearby<M: Mechanics, C: Constraint>(
    search: &mut Search<M, C>,
    start: &[f64],
) -> Result<Vec<f64>, Open> {
    let first = search.position(start);
    let Err(mut best) = first else {
        return first;
    };
    for seed in 1..=STARTS {
        let aside = aside(search, start, seed, 0.1 * seed as f64);
        match search.position(&aside) {
            Ok(q) => return Ok(q),
            Err(open) if open.residual.norm() < best.residual.norm() => best = open,
            Err(_) => {}
        }
    }
    Err(best)
}

/// `q` moved by up to `far` in every direction that may move.
fn aside<M: Mechanics, C: Constraint>(
    search: &Search<M, C>,
    q: &[f64],
    seed: usize,
    far: f64,
) -> Vec<f64> {
    let nv = search.free.nv();
    let mut step = vec![0.0; nv];
    let numbers = spread(seed, nv);
    for &j in &search.movable {
        if let (Some(step), Some(x)) = (step.get_mut(j), numbers.get(j)) {
            *step = far * x;
        }
    }
    moved(search.free.coordinates(), q, &step)
}

/// Rank and independent equations, at `start` and elsewhere on φ = 0.
pub(super) fn find<M: Mechanics, C: Constraint>(
    free: &M,
    constraint: &C,
    start: &[f64],
) -> Result<Independent, Error> {
    let all: Vec<usize> = (0..constraint.len()).collect();
    let kinematics = Kinematics {
        constraint,
        coordinates: free.coordinates(),
        kept: &all,
    };
    let p = free.nominal();
    let mut search = Search::new(free, &kinematics, &[], &p);

    let starts: Vec<Vec<f64>> = (0..=STARTS)
        .map(|seed| match seed {
            0 => start.to_vec(),
            // Over the whole circle for the later ones.
            _ => aside(&search, start, seed, 0.8 * seed as f64),
        })
        .collect();
    measurable(&mut search, &starts)?;

    let mut closed = Vec::new();
    let mut best: Option<Open> = None;
    for from in &starts {
        match search.position(from) {
            Ok(q) => closed.push(q),
            Err(open) => {
                let norm = open.residual.norm();
                if best.as_ref().is_none_or(|b| norm < b.residual.norm()) {
                    best = Some(open);
                }
            }
        }
    }
    if closed.is_empty()
        && let Some(open) = best
    {
        return Err(open.error(&kinematics));
    }
    // A closed configuration can be a singular one (drawn at a dead centre): its surroundings are not.
    for (seed, q) in closed.clone().iter().enumerate() {
        let from = aside(&search, q, seed + STARTS, 0.2);
        closed.extend(search.position(&from));
    }

    let rows: Vec<DMatrix<f64>> = closed.iter().map(|q| search.rows(q)).collect();
    let rank = |rows: &DMatrix<f64>| pivots(std::slice::from_ref(rows)).len();
    let largest = rows.iter().map(rank).max().unwrap_or(0);
    let regular: Vec<DMatrix<f64>> = rows.into_iter().filter(|r| rank(r) == largest).collect();
    let mut kept = pivots(&regular);
    kept.sort_unstable();
    let dropped = all.iter().filter(|e| !kept.contains(e)).map(|&equation| {
        let still = |r: &DMatrix<f64>| {
            let longest = r.row_iter().map(|row| row.norm()).fold(0.0, f64::max);
            r.row(equation).norm() <= SHORTEST * longest.min(1.0)
        };
        Dropped {
            equation,
            name: constraint.name(equation),
            always: regular.iter().all(still),
        }
    });
    Ok(Independent {
        dropped: dropped.collect(),
        kept,
    })
}

/// Refuses equations whose gradients no search can work with, as seen at `places`; rows of zeros are left to the rank.
fn measurable<M: Mechanics, C: Constraint>(
    search: &mut Search<M, C>,
    places: &[Vec<f64>],
) -> Result<(), Error> {
    let constraint = search.kinematics.constraint;
    let mut largest = vec![0.0_f64; constraint.len()];
    for q in places {
        let jacobian = search.jacobian(q);
        for (largest, row) in largest.iter_mut().zip(jacobian.row_iter()) {
            let finite = row.iter().filter(|x| x.is_finite());
            *largest = finite.fold(*largest, |most, x| most.max(x.abs()));
        }
    }
    let (equation, most) = largest
        .into_iter()
        .enumerate()
        .fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
    if most == 0.0 || (GRADIENTS.0..=GRADIENTS.1).contains(&most) {
        return Ok(());
    }
    Err(Error::ConstraintScale {
        name: constraint.name(equation),
        gradient: most,
    })
}

/// Rows that span all others, chosen alike at every place in `places`: Gram-Schmidt with pivots. An earlier row is taken before a later
/// one unless that one is much more independent of those taken.
fn pivots(places: &[DMatrix<f64>]) -> Vec<usize> {
    let count = places.first().map_or(0, DMatrix::nrows);
    let squares = |rows: &DMatrix<f64>| -> Vec<f64> {
        rows.row_iter().map(|row| row.norm_squared()).collect()
    };
    let whole: Vec<Vec<f64>> = places.iter().map(squares).collect();
    let mut rest = places.to_vec();
    let mut taken = Vec::new();
    while taken.len() < count {
        // Mean over the places of the squared sine between a row and the span of those taken.
        let mut scores = vec![0.0_f64; count];
        for (rest, whole) in rest.iter().zip(&whole) {
            let longest = whole.iter().copied().fold(0.0, f64::max);
            for (i, row) in rest.row_iter().enumerate() {
                if whole[i] > SHORTEST * SHORTEST * longest.min(1.0) {
                    scores[i] += row.norm_squared() / whole[i] / places.len() as f64;
                }
            }
        }
        taken.iter().for_each(|&i: &usize| scores[i] = 0.0);
        let best = scores.iter().copied().fold(0.0, f64::max);
        let Some(next) = scores
            .iter()
            .position(|&s| s > DEPENDENT && s >= 0.25 * best)
        else {
            break;
        };
        taken.push(next);
        for rest in &mut rest {
            let direction = rest.row(next).into_owned();
            let square = direction.norm_squared();
            if square > 0.0 {
                // Twice: what rounding leaves of the first pass would pass for independence.
                for _ in 0..2 {
                    for i in 0..count {
                        let part = rest.row(i).dot(&direction) / square;
                        let mut row = rest.row_mut(i);
                        row -= &direction * part;
                    }
                }
            }
        }
    }
    taken
}
