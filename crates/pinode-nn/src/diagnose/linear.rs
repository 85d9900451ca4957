//! A fitted model's windows, linearised: normal equations in its free constants and in further columns, the initial states eliminated.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use super::study::{Fitted, Study};
use crate::hybrid::{DrivenInputs, Hybrid, Reading};
use crate::shooting::problem::{Problem, late};
use crate::shooting::{
    Accumulator, HiddenPrior, Member, Residual, Trajectory, Variation, Window, roll_steps,
};

/// So many windows have their normal equations in memory at once.
const AT_ONCE: usize = 16;

/// The surroundings of the linearisation of a fitted model.
pub struct Linearisation<'a> {
    study: &'a Study,
    fitted: &'a Fitted,
    hidden: HiddenPrior,
    /// How late each coordinate is read, s.
    late: Vec<f64>,
    inputs: Vec<DrivenInputs>,
    readings: Vec<Reading>,
}

/// The roll-out of a window.
pub struct AtWindow<'a> {
    /// Its place among the windows.
    pub index: usize,
    /// The window.
    pub window: &'a Window,
    /// The times of its samples, s.
    pub t: &'a [f64],
    /// The inputs of its recording.
    pub inputs: &'a DrivenInputs,
    /// What is measured less what is predicted.
    pub residuals: &'a [Residual],
    /// The states at its samples.
    pub states: &'a [f64],
    /// The steps between them.
    pub steps: &'a Variation,
}

impl<'a> Linearisation<'a> {
    /// About the fit of `fitted` to the seen windows.
    pub fn new(study: &'a Study, fitted: &'a Fitted) -> Self {
        let (hybrid, fit) = (&fitted.hybrid, &fitted.inside);
        let paths = study.hidden_paths(hybrid, &fit.theta, fitted.substeps);
        let hidden = study.hidden_prior(hybrid, (&fit.theta, true), &study.windows.fit, &paths);
        let mut linear = Linearisation {
            study,
            fitted,
            hidden,
            late: late(hybrid, &fit.theta),
            inputs: Vec::new(),
            readings: Vec::new(),
        };
        let problem = linear.problem();
        let (inputs, readings) = (problem.drive(&fit.theta), problem.readings(&fit.theta));
        (linear.inputs, linear.readings) = (inputs, readings);
        linear
    }

    fn problem(&self) -> Problem<'_> {
        Problem::new(
            &self.fitted.hybrid,
            &self.study.observations,
            &self.study.windows.fit,
            &self.fitted.inside.free,
            &self.hidden,
            self.fitted.substeps,
        )
        .read_late(&self.late)
    }

    /// The inputs of each recording.
    pub fn inputs(&self) -> &[DrivenInputs] {
        &self.inputs
    }

    /// The sensors.
    pub fn readings(&self) -> &[Reading] {
        &self.readings
    }

    /// What is predicted at the residuals of a window changes by this where the states at its samples are those of `hybrid`, `states`, read
    /// by `readings`.
    pub fn change(
        &self,
        at: &AtWindow,
        (hybrid, readings): (&Hybrid, &[Reading]),
        states: &[f64],
    ) -> Vec<f64> {
        let sizes = (hybrid.nv(), hybrid.nx());
        let change = at.residuals.iter().map(|r| {
            let channel = &self.study.observations.channels[r.channel];
            let reading = &readings[channel.coordinate];
            let there = channel.predict(reading, sizes, states, at.t, r.sample);
            there.value - r.predicted.value
        });
        change.collect()
    }

    /// Gives `keep` the information S and the score g of every window, in the windows' order, in the free constants and `columns` further
    /// ones, of which `changes` says by how much they change what is read at each residual. Windows that diverge have none.
    pub fn each_window(
        &self,
        columns: usize,
        changes: impl Fn(&AtWindow) -> Vec<Vec<f64>> + Sync,
        mut keep: impl FnMut(DMatrix<f64>, DVector<f64>),
    ) {
        let problem = self.problem();
        let (hybrid, fit) = (&self.fitted.hybrid, &self.fitted.inside);
        let windows = &self.study.windows.fit;
        let nx = hybrid.nx();
        let nuisances = fit.free.len();
        let total = nuisances + columns;
        type OneWindow = (usize, Option<(Trajectory, Variation)>);
        let of_window = |(index, rolled): OneWindow| -> Option<(DMatrix<f64>, DVector<f64>)> {
            let (null, steps) = rolled?;
            let (window, state) = (&windows[index], &fit.states[index]);
            let inputs = &self.inputs[window.run];
            let residuals = problem.residuals(window, &self.readings, &null.states);
            let residuals: Vec<Residual> = residuals.collect();
            let changes = changes(&AtWindow {
                index,
                window,
                t: &self.study.observations.runs[window.run].t[window.first..][..window.count],
                inputs,
                residuals: &residuals,
                states: &null.states,
                steps: &steps,
            });
            let mut normal = Accumulator::new(nx, total);
            let mut row = vec![0.0; nx + total];
            for (i, r) in residuals.iter().enumerate() {
                let scale = 1.0 / fit.sigma[r.channel];
                let own = &mut row[..nx + nuisances];
                problem.fill_row(own, r, &self.readings, scale, &null);
                for (entry, change) in row[nx + nuisances..].iter_mut().zip(&changes) {
                    *entry = change[i] * scale;
                }
                normal.add(&row, r.value * scale);
            }
            problem.add_prior(index, state, &mut normal);
            let reduced = normal.finish().reduce()?;
            Some((reduced.s, reduced.g))
        };
        // A few windows at once: the matrices of all would fill the memory.
        for first in (0..windows.len()).step_by(AT_ONCE) {
            let some = first..windows.len().min(first + AT_ONCE);
            let members: Vec<Member> = windows[some.clone()]
                .iter()
                .zip(&fit.states[some.clone()])
                .map(|(window, initial)| Member {
                    inputs: &self.inputs[window.run],
                    span: (window.first, window.count),
                    initial,
                })
                .collect();
            let rolled = roll_steps((hybrid, &fit.theta, &fit.free), &members);
            let each: Vec<OneWindow> = some.zip(rolled).collect();
            let reduced: Vec<_> = each.into_par_iter().map(of_window).collect();
            for (s, g) in reduced.into_iter().flatten() {
                keep(s, g);
            }
        }
    }

    /// P (θ − θ₀) of the free constants: how hard their tolerances pull them back.
    pub fn strain(&self) -> DVector<f64> {
        let (fit, constants) = (&self.fitted.inside, self.fitted.hybrid.constants());
        // Without a tolerance the weight is 0.
        let pulls = fit
            .free
            .iter()
            .map(|&i| (fit.theta[i] - constants[i].value) * constants[i].tolerance.powi(-2));
        DVector::from_iterator(fit.free.len(), pulls)
    }

    /// How the free constants follow a step of each further column, with the opposite sign: S_nn⁻¹ S_nc, the tolerances in S_nn, of the
    /// information S of all windows.
    pub fn by_nuisance(&self, s: &DMatrix<f64>) -> DMatrix<f64> {
        let fit = &self.fitted.inside;
        let n = fit.free.len();
        let mut s_nn = s.view((0, 0), (n, n)).into_owned();
        for (k, &i) in fit.free.iter().enumerate() {
            let tolerance = self.fitted.hybrid.constants()[i].tolerance;
            if tolerance.is_finite() {
                s_nn[(k, k)] += tolerance.powi(-2);
            }
            // A constant that moves nothing must not spoil the elimination.
            s_nn[(k, k)] += f64::MIN_POSITIVE.sqrt();
        }
        let s_nc = s.view((0, n), (n, s.ncols() - n));
        solve_scaled(&s_nn, &s_nc.into_owned())
    }
}

/// A⁻¹ B for a positive A whose rows differ widely in unit.
fn solve_scaled(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    let scale: Vec<f64> = (0..n).map(|i| a[(i, i)].sqrt()).collect();
    let unit = DMatrix::from_fn(n, n, |i, j| {
        a[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-10 } else { 0.0 }
    });
    let rhs = DMatrix::from_fn(n, b.ncols(), |i, j| b[(i, j)] / scale[i]);
    match Cholesky::new(unit) {
        Some(factor) => {
            let x = factor.solve(&rhs);
            DMatrix::from_fn(n, b.ncols(), |i, j| x[(i, j)] / scale[i])
        }
        None => DMatrix::zeros(n, b.ncols()),
    }
}
