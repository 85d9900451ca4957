//! One step backwards.

use super::Explicit;
use super::record::{before_calls, numbers_per_call};
use super::schedule::Step;
use crate::space::series::{Work, chart_rate, chart_rate_back, displaced_back};
use crate::{Differentiable, Gradient, Space};

/// λ and what it takes to carry it over one step.
#[derive(Debug, Clone)]
pub(crate) struct Reverse {
    /// ∂loss/∂x along the directions of motion.
    pub lambda: Vec<f64>,
    /// Sums of the derivatives in the constants and in the input; `state` is ∂/∂Xᵢ of the last stage.
    pub by: Gradient,
    sum: Vec<f64>,
    weight: Vec<f64>,
    rate: Vec<f64>,
    /// fᵢ of all stages, in the curved directions.
    rates: Vec<f64>,
    /// ξᵢ of all stages, then of the end.
    charts: Vec<f64>,
    slope: Vec<f64>,
    of_end: Vec<f64>,
    of_chart: Vec<f64>,
    of_series: Vec<f64>,
    kappa: Vec<f64>,
    part: Vec<f64>,
    work: Work,
}

impl Reverse {
    pub fn new<S: Differentiable, M: Explicit>(system: &S) -> Self {
        let nt = system.space().tangent_dim();
        let curved = if system.space().is_flat() { 0 } else { nt };
        Reverse {
            lambda: vec![0.0; nt],
            by: Gradient::zeros(system),
            sum: vec![0.0; nt],
            weight: vec![0.0; nt],
            rate: vec![0.0; nt],
            rates: vec![0.0; curved * M::LINKS.len()],
            charts: vec![0.0; curved * (M::LINKS.len() + 1)],
            slope: vec![0.0; curved],
            of_end: vec![0.0; curved],
            of_chart: vec![0.0; curved],
            of_series: vec![0.0; curved],
            kappa: vec![0.0; curved],
            part: vec![0.0; curved],
            work: Work::new(curved),
        }
    }

    /// Zeros for another roll-out.
    pub fn clear(&mut self) {
        let Gradient {
            state,
            input,
            parameters,
        } = &mut self.by;
        for numbers in [state, input, parameters, &mut self.lambda] {
            numbers.fill(0.0);
        }
    }

    /// λ from the end of a step to its beginning, by what its stages left in `record`.
    pub fn step<S: Differentiable, M: Explicit>(
        &mut self,
        system: &S,
        step: &Step<'_, S::Input>,
        record: &[f64],
        memory: &mut S::Memory,
    ) -> Result<(), S::Error> {
        if system.space().is_flat() {
            self.flat::<S, M>(system, step, record, memory)
        } else {
            self.curved::<S, M>(system, step, record, memory)
        }
    }

    fn flat<S: Differentiable, M: Explicit>(
        &mut self,
        system: &S,
        step: &Step<'_, S::Input>,
        record: &[f64],
        memory: &mut S::Memory,
    ) -> Result<(), S::Error> {
        let dim = system.space().dim();
        self.sum.copy_from_slice(&self.lambda);
        let mut next = 0.0; // aᵢ₊₁ h, with the derivative at the stage after this one
        self.by.state.fill(0.0);
        for i in (0..M::LINKS.len()).rev() {
            let own = step.h * M::WEIGHTS[i];
            for ((weight, lambda), g) in
                self.weight.iter_mut().zip(&self.lambda).zip(&self.by.state)
            {
                *weight = own * lambda + next * g;
            }
            self.pull_back(system, step, M::LINKS[i], &record[i * dim..][..dim], memory)?;
            for (sum, g) in self.sum.iter_mut().zip(&self.by.state) {
                *sum += g;
            }
            next = step.h * M::LINKS[i];
        }
        std::mem::swap(&mut self.lambda, &mut self.sum);
        Ok(())
    }

    fn pull_back<S: Differentiable>(
        &mut self,
        system: &S,
        step: &Step<'_, S::Input>,
        link: f64,
        point: &[f64],
        memory: &mut S::Memory,
    ) -> Result<(), S::Error> {
        self.by.state.fill(0.0);
        system.pull_back(
            (step.t + link * step.h, point, step.u),
            memory,
            &self.weight,
            &mut self.rate,
            &mut self.by,
        )
    }

    fn curved<S: Differentiable, M: Explicit>(
        &mut self,
        system: &S,
        step: &Step<'_, S::Input>,
        record: &[f64],
        memory: &mut S::Memory,
    ) -> Result<(), S::Error> {
        let space = system.space();
        let (dim, nt, stages) = (space.dim(), space.tangent_dim(), M::LINKS.len());
        let record = &record[before_calls(space)..];
        let call = |i: usize| record[i * numbers_per_call(space)..].split_at(dim);
        let turning = space.curved();
        for i in 0..stages {
            let rate = &mut self.rates[i * nt..][..nt];
            rate[turning.clone()].copy_from_slice(&call(i).1[..turning.len()]);
        }
        let rates = &self.rates;
        charts::<S::Space, M>(
            space,
            step.h,
            |i| &rates[i * nt..][..nt],
            &mut self.work,
            &mut self.slope,
            &mut self.charts,
        );
        let chart = |charts: &[f64], i: usize| i * nt..(i * nt + nt).min(charts.len());
        let end = chart(&self.charts, stages);
        displaced_back(
            space,
            &self.charts[end],
            &self.lambda,
            &mut self.work,
            (&mut self.sum, &mut self.of_end),
        );
        let mut next = 0.0;
        self.of_chart.fill(0.0);
        for i in (0..stages).rev() {
            let own = step.h * M::WEIGHTS[i];
            for ((kappa, of_end), of_next) in
                self.kappa.iter_mut().zip(&self.of_end).zip(&self.of_chart)
            {
                *kappa = own * of_end + next * of_next;
            }
            next = step.h * M::LINKS[i];
            let point = call(i).0;
            if i == 0 {
                // ξ₁ = 0: the chart's rate is f itself, and x₁ is where the step begins.
                self.weight.copy_from_slice(&self.kappa);
                self.pull_back(system, step, M::LINKS[i], point, memory)?;
                for (sum, g) in self.sum.iter_mut().zip(&self.by.state) {
                    *sum += g;
                }
                continue;
            }
            let at = chart(&self.charts, i);
            chart_rate_back(
                space,
                &self.charts[at.clone()],
                (&self.kappa, &self.rates[i * nt..][..nt]),
                &mut self.work,
                (&mut self.weight, &mut self.of_series),
            );
            self.pull_back(system, step, M::LINKS[i], point, memory)?;
            displaced_back(
                space,
                &self.charts[at],
                &self.by.state,
                &mut self.work,
                (&mut self.part, &mut self.of_chart),
            );
            for (sum, part) in self.sum.iter_mut().zip(&self.part) {
                *sum += part;
            }
            for (of_chart, of_series) in self.of_chart.iter_mut().zip(&self.of_series) {
                *of_chart += of_series;
            }
        }
        std::mem::swap(&mut self.lambda, &mut self.sum);
        Ok(())
    }
}

/// ξᵢ of the stages of a step, then of its end, in the curved directions, from the rates at the stages: ξᵢ = aᵢ h kᵢ₋₁ and ξ = h Σ bᵢ kᵢ
/// with the chart's rates kᵢ.
pub(crate) fn charts<'a, P: Space, M: Explicit>(
    space: &P,
    h: f64,
    rate: impl Fn(usize) -> &'a [f64],
    work: &mut Work,
    slope: &mut [f64],
    charts: &mut [f64],
) {
    let (nt, stages, curved) = (slope.len(), M::LINKS.len(), space.curved());
    charts.fill(0.0);
    let (charts, end) = charts.split_at_mut(stages * nt);
    for i in 0..stages {
        if i == 0 {
            slope.copy_from_slice(rate(i));
        } else {
            chart_rate(space, &charts[i * nt..][..nt], rate(i), work, slope);
        }
        for j in curved.clone() {
            end[j] += h * M::WEIGHTS[i] * slope[j];
        }
        if let Some(link) = M::LINKS.get(i + 1) {
            let next = &mut charts[(i + 1) * nt..];
            for j in curved.clone() {
                next[j] = link * h * slope[j];
            }
        }
    }
}
