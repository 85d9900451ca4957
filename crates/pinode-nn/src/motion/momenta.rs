//! Momenta, and how they change.

use integrators::Space;
use lagrange::{Error, Mechanics, Workspace};
use nalgebra::{Cholesky, DMatrix, DVector};

use super::Positions;

/// Least part of a diagonal entry of M that the rows before may leave.
const LEAST_PIVOT: f64 = 1e-13;

/// Memory for what [`integrators::Mechanical`] asks of a free mechanism with T = ½ vᵀ M v.
#[derive(Debug, Clone)]
pub(crate) struct Momenta {
    mass: DMatrix<f64>,
    coriolis: DMatrix<f64>,
    gravity: DVector<f64>,
    vector: DVector<f64>,
    turned: Vec<f64>,
}

impl Momenta {
    pub fn new(nv: usize) -> Self {
        Momenta {
            mass: DMatrix::zeros(nv, nv),
            coriolis: DMatrix::zeros(nv, nv),
            gravity: DVector::zeros(nv),
            vector: DVector::zeros(nv),
            turned: vec![0.0; nv],
        }
    }

    /// ∂T/∂v = M v.
    pub fn momentum<M: Mechanics + ?Sized>(
        &mut self,
        mechanics: &M,
        (q, v): (&[f64], &[f64]),
        p: &[f64],
        work: &mut Workspace,
        out: &mut [f64],
    ) {
        mechanics.momentum_into(q, v, p, work, &mut self.vector);
        out.copy_from_slice(self.vector.as_slice());
    }

    /// M⁻¹ of what `out` holds.
    pub fn velocity<M: Mechanics + ?Sized>(
        &mut self,
        mechanics: &M,
        q: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [f64],
    ) -> Result<(), Error> {
        mechanics.mass_matrix_into(q, p, work, &mut self.mass);
        let sound = match Cholesky::new(std::mem::take(&mut self.mass)) {
            Some(factor) => {
                // Row i of the factor has the square of M_ii.
                let rows = factor.l_dirty();
                let sound = (0..out.len()).all(|i| {
                    let pivot = rows[(i, i)].powi(2);
                    let rest: f64 = (0..i).map(|k| rows[(i, k)].powi(2)).sum();
                    pivot > LEAST_PIVOT * (pivot + rest)
                });
                self.vector.copy_from_slice(out);
                factor.solve_mut(&mut self.vector);
                out.copy_from_slice(self.vector.as_slice());
                self.mass = factor.unpack_dirty();
                sound
            }
            None => false,
        };
        if sound {
            return Ok(());
        }
        Err(self.singular(mechanics, q, p, work))
    }

    /// Which velocity moves no mass of its own: the cold path behind a failed factorisation.
    fn singular<M: Mechanics + ?Sized>(
        &mut self,
        mechanics: &M,
        q: &[f64],
        p: &[f64],
        work: &mut Workspace,
    ) -> Error {
        if let Some(index) = q.iter().position(|x| !x.is_finite()) {
            let value = q[index];
            return Error::NotFinite {
                what: "q",
                index,
                value,
            };
        }
        let n = self.vector.len();
        self.mass = DMatrix::zeros(n, n);
        mechanics.mass_matrix_into(q, p, work, &mut self.mass);
        // What the velocities before k leave of M_kk.
        let left = |k: usize| {
            let before = Cholesky::new(self.mass.view((0, 0), (k, k)).into_owned());
            let column = self.mass.view((0, k), (k, 1)).into_owned();
            before.map_or(f64::NAN, |before| {
                self.mass[(k, k)] - column.dot(&before.solve(&column))
            })
        };
        let parts = (0..n).map(|k| (k, left(k)));
        let first =
            |&(k, left): &(usize, f64)| left.is_nan() || left <= LEAST_PIVOT * self.mass[(k, k)];
        let (pivot, value) = parts.clone().find(first).unwrap_or((0, f64::NAN));
        Error::singular_mass_matrix(mechanics.coordinates(), q, pivot, value)
    }

    /// Adds ∂L/∂q to Q in `out`: with Christoffel's C, for which Ṁ = C + Cᵀ, d/dt(M v) = Cᵀ v − G + Q, of which ad_vᵀ(M v) is not
    /// of ∂L/∂q.
    pub fn position_force<M: Mechanics + ?Sized>(
        &mut self,
        mechanics: &M,
        positions: &Positions,
        (q, v): (&[f64], &[f64]),
        p: &[f64],
        work: &mut Workspace,
        out: &mut [f64],
    ) {
        let Momenta {
            mass,
            coriolis,
            gravity,
            vector,
            turned,
        } = self;
        mechanics.equations_into(q, v, p, work, mass, coriolis, gravity);
        for ((out, column), g) in out
            .iter_mut()
            .zip(coriolis.column_iter())
            .zip(gravity.iter())
        {
            *out += dot(column.as_slice(), v) - g;
        }
        if positions.is_flat() {
            return;
        }
        // M is symmetric: its columns are its rows.
        for (m, column) in vector.iter_mut().zip(mass.column_iter()) {
            *m = dot(column.as_slice(), v);
        }
        positions.cobracket_into(v, vector.as_slice(), turned);
        for (out, t) in out.iter_mut().zip(turned) {
            *out -= *t;
        }
    }
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
