//! Normal equations of one window, and the elimination of its initial state.

use nalgebra::{Cholesky, DMatrix, DVector};
use pulp::NullaryFnOnce;

use super::Trajectory;
use crate::hybrid::{Predicted, Reading};
use crate::processor::Processor;

/// Residuals beyond this many standard deviations count linearly (Huber).
const HUBER: f64 = 3.0;

/// The Gauss–Newton normal equations of one window. With the residuals r = (y − ŷ)/σ, their Huber weights W, and the Jacobians of ŷ/σ
/// in the initial state, J_l, and in θ_free, J_g:
///
/// A = J_lᵀ W J_l, B = J_lᵀ W J_g, C = J_gᵀ W J_g, g_l = J_lᵀ W r, g_g = J_gᵀ W r.
#[derive(Debug, Clone)]
pub struct WindowNormal {
    /// A, nx × nx.
    pub a: DMatrix<f64>,
    /// B, nx × P.
    pub b: DMatrix<f64>,
    /// C, P × P.
    pub c: DMatrix<f64>,
    /// g_l, nx.
    pub gl: DVector<f64>,
    /// g_g, P.
    pub gg: DVector<f64>,
    /// Information of the priors on single entries of the initial state, nx; part of A.
    pub prior: Vec<f64>,
}

/// A window's equations in θ_free alone: S = C − Bᵀ A⁻¹ B, g = g_g − Bᵀ A⁻¹ g_l.
#[derive(Debug, Clone)]
pub struct Reduced {
    /// S, P × P.
    pub s: DMatrix<f64>,
    /// g, P.
    pub g: DVector<f64>,
    /// A⁻¹ g_l: the step of the initial state at fixed θ.
    pub state_step: DVector<f64>,
    /// A⁻¹ B: how the initial state follows θ.
    pub state_by_theta: DMatrix<f64>,
    /// ½ g_lᵀ A⁻¹ g_l: what the step of the initial state promises at fixed θ, nats.
    pub state_gain: f64,
    /// How many of the states with a prior the window itself determines, between none and all of them.
    pub determined: f64,
}

/// One residual with its place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Residual {
    /// Sample in the window.
    pub sample: usize,
    /// Channel.
    pub channel: usize,
    /// y − ŷ, in the channel's unit.
    pub value: f64,
    /// ŷ, and what it depends on.
    pub predicted: Predicted,
}

/// Huber's weight of a residual in standard deviations.
pub fn huber_weight(r: f64) -> f64 {
    if r.abs() <= HUBER {
        1.0
    } else {
        HUBER / r.abs()
    }
}

/// Huber's loss, ½ r² near zero.
pub fn huber_loss(r: f64) -> f64 {
    if r.abs() <= HUBER {
        0.5 * r * r
    } else {
        HUBER * (r.abs() - 0.5 * HUBER)
    }
}

/// Rows that are added at a time.
const ROWS: usize = 8;

/// Adds up a window's normal equations row by row.
#[derive(Debug, Clone)]
pub struct Accumulator {
    nx: usize,
    all: DMatrix<f64>,
    gradient: DVector<f64>,
    prior: Vec<f64>,
    /// Rows √w (∂ŷ/σ) that are still to be added.
    rows: [Vec<f64>; ROWS],
    waiting: usize,
    processor: Processor,
}

impl Accumulator {
    /// For `nx` entries of the initial state and `free` further columns.
    pub fn new(nx: usize, free: usize) -> Self {
        Accumulator {
            nx,
            all: DMatrix::zeros(nx + free, nx + free),
            gradient: DVector::zeros(nx + free),
            prior: vec![0.0; nx],
            rows: std::array::from_fn(|_| vec![0.0; nx + free]),
            waiting: 0,
            processor: Processor::here(),
        }
    }

    /// Adds what is known of entry `i` of the initial state: it is `r` standard deviations below its mean, and one of them is
    /// 1/√`information`.
    pub fn add_prior(&mut self, i: usize, information: f64, r: f64) {
        self.all[(i, i)] += information;
        self.gradient[i] += information.sqrt() * r;
        self.prior[i] += information;
    }

    /// Adds one residual `r` in standard deviations, whose derivative −∂r in all columns is `row`.
    pub fn add(&mut self, row: &[f64], r: f64) {
        let weight = huber_weight(r);
        let root = weight.sqrt();
        let waiting = self.rows[self.waiting].iter_mut();
        for ((waiting, gradient), &entry) in waiting.zip(self.gradient.iter_mut()).zip(row) {
            *gradient += weight * r * entry;
            *waiting = root * entry;
        }
        self.waiting += 1;
        if self.waiting == ROWS {
            self.add_waiting();
        }
    }

    fn add_waiting(&mut self) {
        for row in &mut self.rows[self.waiting..] {
            row.fill(0.0);
        }
        self.waiting = 0;
        self.processor.run(Squared {
            rows: &self.rows,
            all: self.all.as_mut_slice(),
        });
    }

    /// The equations.
    pub fn finish(mut self) -> WindowNormal {
        self.add_waiting();
        self.all.fill_lower_triangle_with_upper_triangle();
        let nx = self.nx;
        let free = self.gradient.len() - nx;
        WindowNormal {
            a: self.all.view((0, 0), (nx, nx)).into_owned(),
            b: self.all.view((0, nx), (nx, free)).into_owned(),
            c: self.all.view((nx, nx), (free, free)).into_owned(),
            gl: self.gradient.rows(0, nx).into_owned(),
            gg: self.gradient.rows(nx, free).into_owned(),
            prior: self.prior,
        }
    }
}

/// The columns of ŷ/σ for one residual: its derivatives in the initial state and in θ_free.
pub(crate) fn fill_row(
    row: &mut [f64],
    residual: &Residual,
    reading: &Reading,
    position: bool,
    (nx, scale): (usize, f64),
    trajectory: &Trajectory,
) {
    let columns = row.len();
    row.fill(0.0);
    let used = residual.predicted.terms.iter();
    for &(sample, state, weight) in used.filter(|(.., weight)| *weight != 0.0) {
        let block = &trajectory.sensitivities[sample * nx * columns..];
        for (column, entry) in row.iter_mut().enumerate() {
            *entry += weight * block[column * nx + state] * scale;
        }
    }
    reading.add_by_theta(&residual.predicted, scale, position, &mut row[nx..]);
}

/// Adds Rᵀ R to the upper triangle of a matrix, column after column.
struct Squared<'a> {
    rows: &'a [Vec<f64>; ROWS],
    all: &'a mut [f64],
}

impl NullaryFnOnce for Squared<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let n = self.rows[0].len();
        for (j, column) in self.all.chunks_exact_mut(n.max(1)).enumerate() {
            let column = &mut column[..=j];
            let rows: [&[f64]; ROWS] = std::array::from_fn(|k| &self.rows[k][..=j]);
            let last: [f64; ROWS] = std::array::from_fn(|k| rows[k][j]);
            for (i, to) in column.iter_mut().enumerate() {
                let mut sum = *to;
                for k in 0..ROWS {
                    sum += rows[k][i] * last[k];
                }
                *to = sum;
            }
        }
    }
}

impl WindowNormal {
    /// A⁻¹ applied to `rhs`; what the window does not determine is held by a relative ridge.
    pub fn solve_a(&self, rhs: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let mut a = self.a.clone();
        for i in 0..a.nrows() {
            a[(i, i)] += 1e-9 * a[(i, i)] + f64::MIN_POSITIVE;
        }
        Cholesky::new(a).map(|factor| factor.solve(rhs))
    }

    /// Eliminates the initial state; `None` when the window does not determine it.
    pub fn reduce(&self) -> Option<Reduced> {
        let (nx, free) = self.b.shape();
        let mut rhs = DMatrix::zeros(nx, free + 1);
        rhs.columns_mut(0, free).copy_from(&self.b);
        rhs.column_mut(free).copy_from(&self.gl);
        let solved = self.solve_a(&rhs)?;
        let known: Vec<usize> = (0..nx).filter(|&i| self.prior[i] > 0.0).collect();
        let mut determined = 0.0;
        if !known.is_empty() {
            let mut units = DMatrix::zeros(nx, known.len());
            for (column, &i) in known.iter().enumerate() {
                units[(i, column)] = 1.0;
            }
            let inverse = self.solve_a(&units)?;
            for (column, &i) in known.iter().enumerate() {
                determined += 1.0 - (self.prior[i] * inverse[(i, column)]).clamp(0.0, 1.0);
            }
        }
        let state_by_theta = solved.columns(0, free).into_owned();
        let state_step = solved.column(free).into_owned();
        Some(Reduced {
            s: &self.c - self.b.transpose() * &state_by_theta,
            g: &self.gg - self.b.transpose() * &state_step,
            state_gain: 0.5 * self.gl.dot(&state_step),
            state_step,
            state_by_theta,
            determined,
        })
    }
}
