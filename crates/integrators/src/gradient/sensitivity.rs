//! Derivatives of all states in some numbers, forwards along a roll-out.

use nalgebra::DMatrix;

use super::record::{Linearized, Stages};
use super::reverse::charts;
use super::schedule::Step;
use super::{Column, Explicit, GradientError, Schedule};
use crate::fixed::{check_arguments, check_finite, check_initial};
use crate::space::series::{Work, chart_rate, chart_rate_change, displaced};
use crate::{Differentiable, Jacobian, RollOutError, Space, System};

/// Forward sensitivities ∂x_k/∂(x_0, p, u) of a roll-out: every column is carried through the very steps by the derivatives of the
/// stages, which [`linearize`](Differentiable::linearize) gives, once a stage for all columns.
///
/// The states are those of [`roll_out`](crate::roll_out), to the bit where `linearize` gives the same bits of f as
/// [`rate`](System::rate) does. Rows and [`Column::Initial`] are along the directions of motion. The equations are those of the
/// [module](crate::gradient). Columns of inputs cost nothing before their interval. A second roll-out takes no memory.
///
/// ```
/// use integrators::gradient::{Column, DualOde, DualRate, Schedule, Sensitivity};
/// use integrators::Rk4;
/// use num_dual::DualNum;
///
/// /// ẍ = −p x, x = (x, ẋ)
/// struct Spring;
/// impl DualRate for Spring {
///     type Error = std::convert::Infallible;
///     fn rate<D: DualNum<Primitive = f64> + Copy>(
///         &self, _t: f64, x: &[D], _u: &[D], p: &[D], dx: &mut [D],
///     ) -> Result<(), Self::Error> {
///         dx[0] = x[1];
///         dx[1] = -p[0] * x[0];
///         Ok(())
///     }
/// }
///
/// let spring = DualOde::new(2, Spring, vec![4.0]);
/// let schedule = Schedule { times: &[0.0, 1.0], inputs: &[[]], substeps: 200 };
/// let columns = [Column::Initial(0), Column::Parameter(0)];
/// let mut last = None;
/// Sensitivity::new(&spring, Rk4::default()).roll_out(&spring, schedule, &[1.0, 0.0], &columns, |_k, _x, by| {
///     last = Some(by.clone_owned());
/// })?;
/// // x = cos √p t, ∂x/∂p = −t/(2√p) sin √p t
/// let by = last.unwrap_or_default();
/// assert!((by[(0, 0)] - 2.0_f64.cos()).abs() < 1e-8);
/// assert!((by[(0, 1)] + 0.25 * 2.0_f64.sin()).abs() < 1e-8);
/// # Ok::<(), integrators::gradient::GradientError<std::convert::Infallible>>(())
/// ```
pub struct Sensitivity<S: Differentiable, M: Explicit> {
    method: M,
    stages: Stages<S::Memory>,
    x: Vec<f64>,
    by: DMatrix<f64>,
    /// δXᵢ, δfᵢ, δkᵢ and h Σ bᵢ δkᵢ of one column.
    state: Vec<f64>,
    rate: Vec<f64>,
    slope: Vec<f64>,
    sum: Vec<f64>,
    /// δξᵢ.
    chart: Vec<f64>,
    charts: Vec<f64>,
    work: Work,
}

impl<S: Differentiable, M: Explicit> std::fmt::Debug for Sensitivity<S, M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sensitivity").finish_non_exhaustive()
    }
}

impl<S, M> Sensitivity<S, M>
where
    S: Differentiable,
    S::Input: Sized,
    M: Explicit,
{
    /// With memory for a system.
    pub fn new(system: &S, method: M) -> Self {
        let nt = system.space().tangent_dim();
        let stages = M::LINKS.len();
        Sensitivity {
            method,
            stages: Stages {
                rates: vec![vec![0.0; nt]; stages],
                by: vec![Jacobian::zeros(system); stages],
                ..Linearized(system).memory()
            },
            x: vec![0.0; system.space().dim()],
            by: DMatrix::zeros(nt, 0),
            state: vec![0.0; nt],
            rate: vec![0.0; nt],
            slope: vec![0.0; nt],
            sum: vec![0.0; nt],
            chart: vec![0.0; nt],
            charts: vec![0.0; (stages + 1) * nt],
            work: Work::new(nt),
        }
    }

    /// Rolls out from `initial` and calls `at_sample(k, x_k, ∂x_k/∂columns)` at every sample, the first one included; the matrix has nt
    /// rows and a column for each of `columns`.
    ///
    /// A system of other sizes than the one that this was made for is given new memory.
    ///
    /// # Errors
    /// Those of [`roll_out`](crate::roll_out), [`GradientError::Column`] before the first step, and [`GradientError::NotFinite`].
    pub fn roll_out(
        &mut self,
        system: &S,
        schedule: Schedule<'_, S::Input>,
        initial: &[f64],
        columns: &[Column],
        mut at_sample: impl FnMut(usize, &[f64], &DMatrix<f64>),
    ) -> Result<(), GradientError<S::Error>> {
        check_arguments(schedule.times, schedule.inputs.len(), schedule.substeps)?;
        check_initial(system.space(), initial)?;
        let Some(&start) = schedule.times.first() else {
            return Ok(());
        };
        check_columns(system, schedule.intervals(), columns)?;
        if !self.fits(system) {
            *self = Self::new(system, self.method.clone());
        }
        check_finite(start, initial)?;
        self.x.copy_from_slice(initial);
        let nt = system.space().tangent_dim();
        if self.by.shape() == (nt, columns.len()) {
            self.by.fill(0.0);
        } else {
            self.by = DMatrix::zeros(nt, columns.len());
        }
        for (c, column) in columns.iter().enumerate() {
            if let Column::Initial(direction) = *column {
                self.by[(direction, c)] = 1.0;
            }
        }
        at_sample(0, &self.x, &self.by);
        let linearized = Linearized(system);
        for held in schedule.held(0..schedule.steps()) {
            for step in held.steps.clone().map(|i| held.step(i)) {
                let (time, x) = (step.t, &mut self.x);
                self.stages.at = 0;
                self.method
                    .step(&linearized, time, step.h, step.u, &mut self.stages, x)
                    .map_err(|source| RollOutError::Step { time, source })?;
                check_finite(time + step.h, x)?;
                self.carry(system.space(), &step, columns);
            }
            check_derivatives(&self.by)?;
            at_sample(held.interval + 1, &self.x, &self.by);
        }
        Ok(())
    }

    /// Whether the memory has the sizes of a system.
    fn fits(&self, system: &S) -> bool {
        let nt = system.space().tangent_dim();
        let sizes = |by: &Jacobian| (by.state.nrows(), by.input.ncols(), by.parameters.ncols());
        self.x.len() == system.space().dim()
            && self
                .stages
                .by
                .iter()
                .all(|by| sizes(by) == (nt, system.input_count(), system.parameter_count()))
    }

    /// All columns from the beginning of a step to its end.
    fn carry(&mut self, space: &S::Space, step: &Step<'_, S::Input>, columns: &[Column]) {
        let flat = space.is_flat();
        if !flat {
            let rates = &self.stages.rates;
            charts::<S::Space, M>(
                space,
                step.h,
                |i| &rates[i],
                &mut self.work,
                &mut self.slope,
                &mut self.charts,
            );
        }
        for (c, column) in columns.iter().enumerate() {
            match column {
                Column::Input { interval, .. } if *interval > step.interval => {}
                _ if flat => self.carry_flat(step, c, column),
                _ => self.carry_curved(space, step, c, column),
            }
        }
    }

    /// δfᵢ for δXᵢ in `state`, into `rate`.
    fn rate_of(&mut self, i: usize, interval: usize, column: &Column) {
        let by = &self.stages.by[i];
        times(&by.state, &self.state, &mut self.rate);
        match *column {
            Column::Parameter(p) => add_column(&by.parameters, p, &mut self.rate),
            Column::Input {
                interval: own,
                entry,
            } if own == interval => add_column(&by.input, entry, &mut self.rate),
            _ => {}
        }
    }

    fn carry_flat(&mut self, step: &Step<'_, S::Input>, c: usize, column: &Column) {
        let nt = self.state.len();
        let own = c * nt..(c + 1) * nt;
        self.sum.fill(0.0);
        self.state.copy_from_slice(&self.by.as_slice()[own.clone()]);
        for i in 0..M::LINKS.len() {
            if i > 0 {
                let (link, eta) = (step.h * M::LINKS[i], &self.by.as_slice()[own.clone()]);
                for ((state, eta), rate) in self.state.iter_mut().zip(eta).zip(&self.rate) {
                    *state = eta + link * rate;
                }
            }
            self.rate_of(i, step.interval, column);
            add_scaled(step.h * M::WEIGHTS[i], &self.rate, &mut self.sum);
        }
        add_scaled(1.0, &self.sum, &mut self.by.as_mut_slice()[own]);
    }

    fn carry_curved(
        &mut self,
        space: &S::Space,
        step: &Step<'_, S::Input>,
        c: usize,
        column: &Column,
    ) {
        let nt = self.state.len();
        let own = c * nt..(c + 1) * nt;
        self.sum.fill(0.0);
        for i in 0..M::LINKS.len() {
            let eta = &self.by.as_slice()[own.clone()];
            if i == 0 {
                self.state.copy_from_slice(eta);
                self.rate_of(i, step.interval, column);
                self.slope.copy_from_slice(&self.rate);
            } else {
                for (chart, k) in self.chart.iter_mut().zip(self.slope.iter()) {
                    *chart = step.h * M::LINKS[i] * k;
                }
                let at = i * nt..(i + 1) * nt;
                displaced(
                    space,
                    &self.charts[at.clone()],
                    (eta, &self.chart),
                    &mut self.work,
                    &mut self.state,
                );
                self.rate_of(i, step.interval, column);
                let (xi, slope) = (&self.charts[at], &mut self.slope);
                chart_rate(space, xi, &self.rate, &mut self.work, slope);
                let change = (self.chart.as_slice(), self.stages.rates[i].as_slice());
                chart_rate_change(space, xi, change, &mut self.work, slope);
            }
            add_scaled(step.h * M::WEIGHTS[i], &self.slope, &mut self.sum);
        }
        displaced(
            space,
            &self.charts[M::LINKS.len() * nt..],
            (&self.by.as_slice()[own.clone()], &self.sum),
            &mut self.work,
            &mut self.state,
        );
        self.by.as_mut_slice()[own].copy_from_slice(&self.state);
    }
}

/// out = A x for a square A, its columns taken four at a time: systems are small, and this is most of the work beside their derivatives.
fn times(a: &DMatrix<f64>, x: &[f64], out: &mut [f64]) {
    const FOUR: usize = 4;
    let nt = x.len();
    out.fill(0.0);
    let (four, rest) = x.as_chunks::<FOUR>();
    let (by_four, by_rest) = a.as_slice().split_at(four.len() * FOUR * nt);
    for (columns, x) in by_four.chunks_exact((FOUR * nt).max(1)).zip(four) {
        let (first, last) = columns.split_at(2 * nt);
        let ((c0, c1), (c2, c3)) = (first.split_at(nt), last.split_at(nt));
        for ((((out, c0), c1), c2), c3) in out.iter_mut().zip(c0).zip(c1).zip(c2).zip(c3) {
            *out = *out + c0 * x[0] + c1 * x[1] + c2 * x[2] + c3 * x[3];
        }
    }
    for (column, &x) in by_rest.chunks_exact(nt.max(1)).zip(rest) {
        add_scaled(x, column, out);
    }
}

/// to += A e_k.
fn add_column(a: &DMatrix<f64>, k: usize, to: &mut [f64]) {
    add_scaled(1.0, a.column(k).as_slice(), to);
}

/// to += factor · from.
fn add_scaled(factor: f64, from: &[f64], to: &mut [f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}

fn check_columns<S: Differentiable>(
    system: &S,
    intervals: usize,
    columns: &[Column],
) -> Result<(), GradientError<S::Error>> {
    let check = |column, what, found, count| {
        if found < count {
            Ok(())
        } else {
            Err(GradientError::Column {
                column,
                what,
                found,
                count,
            })
        }
    };
    for (c, column) in columns.iter().enumerate() {
        match *column {
            Column::Initial(direction) => {
                check(c, "direction", direction, system.space().tangent_dim())?;
            }
            Column::Parameter(p) => check(c, "constant", p, system.parameter_count())?,
            Column::Input { interval, entry } => {
                check(c, "interval", interval, intervals)?;
                check(c, "entry of an input", entry, system.input_count())?;
            }
        }
    }
    Ok(())
}

fn check_derivatives<E>(by: &DMatrix<f64>) -> Result<(), GradientError<E>> {
    match by.iter().enumerate().find(|(_, x)| !x.is_finite()) {
        Some((entry, &value)) => Err(GradientError::NotFinite {
            part: "the columns, one after the other",
            entry,
            value,
        }),
        None => Ok(()),
    }
}
