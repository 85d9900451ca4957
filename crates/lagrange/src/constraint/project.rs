//! Consistent states: φ(q) = 0 and J v = 0.

use nalgebra::{Cholesky, DMatrix, DVector, SVD};

use super::kinematics::{Kinematics, Room, Sizes, position_rate};
use super::{Constraint, independent};
use crate::state::normalize;
use crate::{Coordinate, Error, Mechanics};

/// Gauss-Newton steps before the search is given up.
const MOST_STEPS: usize = 100;
/// φ counts as 0 below this, relative to 1 and to what a change of q by its own size does to φ.
const CLOSED: f64 = 1e-12;
/// Singular values of J (in the metric of M) below this part of the largest are taken as 0.
const SMALLEST_SINGULAR: f64 = 1e-10;

/// q moved along the velocity `step` for one second, to first order; quaternions stay unit.
pub(super) fn moved(coordinates: &[Coordinate], q: &[f64], step: &[f64]) -> Vec<f64> {
    let mut rate = vec![0.0; q.len()];
    position_rate(coordinates, q, step, &mut rate);
    let mut moved: Vec<f64> = q.iter().zip(&rate).map(|(q, rate)| q + rate).collect();
    normalize(coordinates, &mut moved);
    moved
}

/// Numbers in (−1, 1), spread by the golden ratio: fixed, and in no special relation to one another.
pub(super) fn spread(seed: usize, n: usize) -> Vec<f64> {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    (1..=n)
        .map(|i| 2.0 * (GOLDEN * i as f64 + 0.754_877_666 * seed as f64).fract() - 1.0)
        .collect()
}

/// A search that ended away from φ = 0.
pub(super) struct Open {
    pub q: Vec<f64>,
    pub residual: DVector<f64>,
}

impl Open {
    /// Names the equation with the largest residual.
    pub fn error<C: Constraint>(&self, kinematics: &Kinematics<C>) -> Error {
        let (row, value) = self.residual.iter().copied().enumerate().fold(
            (0, 0.0_f64),
            |(worst, most), (row, x)| {
                if x.abs() > most.abs() || x.is_nan() {
                    (row, x)
                } else {
                    (worst, most)
                }
            },
        );
        let equation = kinematics.kept.get(row).copied().unwrap_or(0);
        Error::Inconsistent {
            name: kinematics.constraint.name(equation),
            residual: value,
            q: self.q.clone(),
        }
    }
}

/// Searches q and v on φ = 0 and J v = 0.
pub(super) struct Search<'a, M, C> {
    pub free: &'a M,
    pub kinematics: &'a Kinematics<'a, C>,
    pub p: &'a [f64],
    /// The velocities that may change.
    pub movable: Vec<usize>,
    pub room: Room,
}

impl<'a, M: Mechanics, C: Constraint> Search<'a, M, C> {
    pub fn new(
        free: &'a M,
        kinematics: &'a Kinematics<'a, C>,
        held: &[usize],
        p: &'a [f64],
    ) -> Self {
        let size = Sizes {
            nq: free.nq(),
            nv: free.nv(),
            np: p.len(),
        };
        Search {
            free,
            kinematics,
            p,
            movable: (0..size.nv).filter(|j| !held.contains(j)).collect(),
            room: Room::new(size, kinematics.constraint.len(), kinematics.kept.len()),
        }
    }

    pub fn residual(&mut self, q: &[f64]) -> DVector<f64> {
        let mut out = DVector::zeros(self.kinematics.kept.len());
        self.kinematics
            .residual(q, self.p, &mut self.room, &mut out);
        out
    }

    /// J at `q`, the columns that may move.
    pub fn jacobian(&mut self, q: &[f64]) -> DMatrix<f64> {
        self.kinematics.jacobian(q, self.p, &mut self.room);
        self.room.jacobian.select_columns(&self.movable)
    }

    /// The factor of M of what may move; the identity where there is none.
    fn metric(&self, q: &[f64]) -> DMatrix<f64> {
        let nv = self.free.nv();
        let mut mass = DMatrix::zeros(nv, nv);
        self.free
            .mass_matrix_into(q, self.p, &mut self.free.workspace(), &mut mass);
        let mass = mass
            .select_rows(&self.movable)
            .select_columns(&self.movable);
        let n = mass.nrows();
        if mass.iter().any(|x| !x.is_finite()) {
            return DMatrix::identity(n, n);
        }
        match Cholesky::new(mass) {
            Some(factor) => factor.unpack(),
            None => DMatrix::identity(n, n),
        }
    }

    /// J L⁻ᵀ with M = L Lᵀ: its rows are those of J as lengths in the metric of M⁻¹ see them.
    pub fn rows(&mut self, q: &[f64]) -> DMatrix<f64> {
        let mut transposed = self.jacobian(q).transpose();
        self.metric(q).solve_lower_triangular_mut(&mut transposed);
        transposed.transpose()
    }

    /// The least velocity, in the metric of M, with J x = `goal` (in the sense of least squares), over all velocities.
    fn least(&mut self, q: &[f64], goal: &DVector<f64>) -> Option<DVector<f64>> {
        let metric = self.metric(q);
        let rows = self.rows(q);
        if rows.iter().chain(goal.iter()).any(|x| !x.is_finite()) {
            return None;
        }
        if rows.is_empty() {
            // No equation in force, or nothing that may move: the least velocity is none.
            return Some(DVector::zeros(self.free.nv()));
        }
        let svd = SVD::new(rows, true, true);
        let largest = svd.singular_values.iter().copied().fold(0.0, f64::max);
        let mut step = svd.solve(goal, SMALLEST_SINGULAR * largest).ok()?;
        metric.tr_solve_lower_triangular_mut(&mut step);
        let mut all = DVector::zeros(self.free.nv());
        for (&j, &x) in self.movable.iter().zip(step.iter()) {
            if let Some(entry) = all.get_mut(j) {
                *entry = x;
            }
        }
        Some(all)
    }

    /// Whether every residual is zero to rounding.
    fn closed(&mut self, q: &[f64], residual: &DVector<f64>) -> bool {
        let jacobian = self.jacobian(q);
        let size = q.iter().fold(1.0_f64, |size, x| size.max(x.abs()));
        let mut rows = residual.iter().zip(jacobian.row_iter());
        rows.all(|(phi, row)| phi.abs() <= CLOSED * (1.0 + size * row.norm()))
    }

    /// q on φ = 0: Gauss-Newton steps, shortened until |φ| falls.
    pub fn position(&mut self, start: &[f64]) -> Result<Vec<f64>, Open> {
        let mut q = start.to_vec();
        let mut residual = self.residual(&q);
        for _ in 0..MOST_STEPS {
            let closed = self.closed(&q, &residual);
            let Some(step) = self.least(&q, &-&residual) else {
                break;
            };
            let mut part = 1.0;
            let better = loop {
                let along = &step * part;
                let next = moved(self.free.coordinates(), &q, along.as_slice());
                let then = self.residual(&next);
                if then.norm() < (1.0 - 1e-4 * part) * residual.norm() {
                    break Some((next, then));
                }
                part *= 0.5;
                // Where φ is zero to rounding, one whole step is all that can help.
                if closed || part < 1e-6 {
                    break None;
                }
            };
            match better {
                Some((next, then)) => (q, residual) = (next, then),
                None if closed => return Ok(q),
                None => break,
            }
        }
        if self.closed(&q, &residual) {
            Ok(q)
        } else {
            Err(Open { q, residual })
        }
    }

    /// v with J v = 0.
    pub fn velocity(&mut self, q: &[f64], v: &[f64]) -> Result<Vec<f64>, Open> {
        let mut v = DVector::from_column_slice(v);
        self.kinematics.jacobian(q, self.p, &mut self.room);
        // The second pass takes what rounding left.
        for _ in 0..2 {
            let rate = &self.room.jacobian * &v;
            if let Some(change) = self.least(q, &-rate) {
                v += change;
            }
        }
        let rate = &self.room.jacobian * &v;
        let size = 1.0 + v.norm() * self.room.jacobian.norm();
        if rate.iter().all(|x| x.abs() <= 1e-9 * size) {
            Ok(v.as_slice().to_vec())
        } else {
            Err(Open {
                q: q.to_vec(),
                residual: rate,
            })
        }
    }
}

/// The consistent state that belongs to (q, v).
pub(super) fn state<M: Mechanics, C: Constraint>(
    free: &M,
    kinematics: &Kinematics<C>,
    (q, v): (&[f64], &[f64]),
    held: &[usize],
    p: &[f64],
) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let mut search = Search::new(free, kinematics, held, p);
    let q = independent::from_nearby(&mut search, q).map_err(|open| open.error(kinematics))?;
    let v = search
        .velocity(&q, v)
        .map_err(|open| open.error(kinematics))?;
    Ok((q, v))
}
