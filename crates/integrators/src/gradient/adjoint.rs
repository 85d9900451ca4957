//! Derivatives of one number in everything, backwards through a roll-out.

use nalgebra::DMatrix;

use super::checkpoint::{Plan, split};
use super::record::{Recorded, Tape, numbers_per_step};
use super::reverse::Reverse;
use super::{Explicit, GradientError, Schedule};
use crate::fixed::{check_arguments, check_finite, check_initial};
use crate::{Differentiable, RollOutError, Space, StepError, System};

/// Derivatives of a loss in the initial state, the constants and every held input of a roll-out.
#[derive(Debug, Clone, PartialEq)]
pub struct RollOutGradient {
    /// Along the directions of motion of the initial state, nt.
    pub initial: Vec<f64>,
    /// np.
    pub parameters: Vec<f64>,
    /// nu × intervals: column k belongs to the input held from sample k to sample k + 1.
    pub inputs: DMatrix<f64>,
}

impl Default for RollOutGradient {
    fn default() -> Self {
        RollOutGradient {
            initial: Vec::new(),
            parameters: Vec::new(),
            inputs: DMatrix::zeros(0, 0),
        }
    }
}

/// The discrete adjoint of roll-outs: reverse mode through the very steps that [`roll_out`](crate::roll_out) takes.
///
/// Its equations are those of the [module](crate::gradient). Evaluations of the system, in a roll-out of N steps with s stages: s N of
/// the rate for the roll-out, s N of [`pull_back`](Differentiable::pull_back) for the way back, and at most s N of the rate to run
/// segments again whose stages did not fit in memory; none of these where all do.
///
/// # Memory
/// A fixed budget holds the states at the stages of a part of the steps, and states to run the other parts again from; it does not grow
/// with the number of steps. By default it is [`BUDGET`](Self::BUDGET) bytes; [`with_budget`](Self::with_budget) changes it. Where one
/// repetition of every step is not enough, states are kept by the binomial scheme of Griewank and Walther (2000), which repeats steps
/// a few times more. The result is the same, to the bit, with every budget. It holds at least the stages of one step and one state.
///
/// An adjoint that has gone through a roll-out takes no memory for another one that is not longer.
///
/// ```
/// use integrators::gradient::{Adjoint, DualOde, DualRate, RollOutGradient, Schedule};
/// use integrators::Rk4;
/// use num_dual::DualNum;
///
/// /// ẋ = −p x + u
/// struct Lag;
/// impl DualRate for Lag {
///     type Error = std::convert::Infallible;
///     fn rate<D: DualNum<Primitive = f64> + Copy>(
///         &self, _t: f64, x: &[D], u: &[D], p: &[D], dx: &mut [D],
///     ) -> Result<(), Self::Error> {
///         dx[0] = -p[0] * x[0] + u[0];
///         Ok(())
///     }
/// }
///
/// let lag = DualOde::new(1, Lag, vec![2.0]);
/// let schedule = Schedule { times: &[0.0, 0.5, 1.0], inputs: &[[1.0], [3.0]], substeps: 50 };
/// // The loss is the last state; its derivative in the initial one is e^{−2}.
/// let loss = |sample: usize, x: &[f64], by: &mut [f64]| {
///     if sample < 2 {
///         return 0.0;
///     }
///     by[0] = 1.0;
///     x[0]
/// };
/// let mut gradient = RollOutGradient::default();
/// let value = Adjoint::new(&lag, Rk4::default()).gradient(&lag, schedule, &[0.4], loss, &mut gradient)?;
/// let e = |t: f64| (-2.0 * t).exp();
/// assert!((value - (0.4 * e(1.0) + 0.5 * (e(0.5) - e(1.0)) + 1.5 * (1.0 - e(0.5)))).abs() < 1e-8);
/// assert!((gradient.initial[0] - e(1.0)).abs() < 1e-8);
/// assert!((gradient.inputs[0] - 0.5 * (e(0.5) - e(1.0))).abs() < 1e-8);
/// assert!((gradient.inputs[1] - 0.5 * (1.0 - e(0.5))).abs() < 1e-8);
/// # Ok::<(), integrators::gradient::GradientError<std::convert::Infallible>>(())
/// ```
pub struct Adjoint<S: Differentiable, M: Explicit> {
    method: M,
    tape: Tape<S::Memory>,
    reverse: Reverse,
    /// Kept states, one after the other, and before which segments they are.
    kept: Vec<f64>,
    segments: Vec<usize>,
    x: Vec<f64>,
    by_sample: Vec<f64>,
    /// Numbers.
    budget: usize,
}

impl<S: Differentiable, M: Explicit> std::fmt::Debug for Adjoint<S, M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Adjoint")
            .field("budget", &self.budget)
            .finish_non_exhaustive()
    }
}

impl<S, M> Adjoint<S, M>
where
    S: Differentiable,
    S::Input: Sized,
    M: Explicit,
{
    /// Bytes for states, unless it is said otherwise: 16 MiB, of which no more is taken than a roll-out needs.
    pub const BUDGET: usize = 1 << 24;

    /// With memory for a system.
    pub fn new(system: &S, method: M) -> Self {
        Adjoint {
            method,
            tape: Recorded(system).memory(),
            reverse: Reverse::new::<S, M>(system),
            kept: Vec::new(),
            segments: Vec::new(),
            x: vec![0.0; system.space().dim()],
            by_sample: vec![0.0; system.space().tangent_dim()],
            budget: Self::BUDGET / size_of::<f64>(),
        }
    }

    /// The same with `bytes` for states.
    pub fn with_budget(mut self, bytes: usize) -> Self {
        self.budget = bytes / size_of::<f64>();
        self
    }

    /// The loss Σ ℓ_k(x_k) over the samples of a roll-out from `initial`, and its derivatives, into `out`.
    ///
    /// `loss(k, x_k, by)` returns ℓ_k and writes its derivative along the directions of motion, ∂ℓ_k(x_k ⊕ ξ)/∂ξ at ξ = 0, to `by`, which
    /// is zero before. It is called once for every sample, from the last one to the first; the sum is taken in this order.
    ///
    /// A system of other sizes than the one that this adjoint was made for is given new memory.
    ///
    /// # Errors
    /// Those of [`roll_out`](crate::roll_out), and [`GradientError::NotFinite`]; `out` is then of no use.
    pub fn gradient(
        &mut self,
        system: &S,
        schedule: Schedule<'_, S::Input>,
        initial: &[f64],
        mut loss: impl FnMut(usize, &[f64], &mut [f64]) -> f64,
        out: &mut RollOutGradient,
    ) -> Result<f64, GradientError<S::Error>> {
        check_arguments(schedule.times, schedule.inputs.len(), schedule.substeps)?;
        check_initial(system.space(), initial)?;
        if !self.fits(system) {
            *self = Self {
                budget: self.budget,
                ..Self::new(system, self.method.clone())
            };
        }
        let shape = (system.input_count(), schedule.intervals());
        if out.inputs.shape() != shape {
            out.inputs = DMatrix::zeros(shape.0, shape.1);
        }
        self.reverse.clear();
        let mut value = 0.0;
        if let Some(&start) = schedule.times.first() {
            check_finite(start, initial)?;
            value = self.through(system, schedule, initial, &mut loss, &mut out.inputs)?;
        }
        out.initial.clone_from(&self.reverse.lambda);
        out.parameters.clone_from(&self.reverse.by.parameters);
        check_gradient(value, out)?;
        Ok(value)
    }

    /// Whether the memory has the sizes of a system.
    fn fits(&self, system: &S) -> bool {
        let (space, by) = (system.space(), &self.reverse.by);
        self.x.len() == space.dim()
            && by.state.len() == space.tangent_dim()
            && by.input.len() == system.input_count()
            && by.parameters.len() == system.parameter_count()
    }

    /// Forwards in segments and back.
    fn through(
        &mut self,
        system: &S,
        schedule: Schedule<'_, S::Input>,
        initial: &[f64],
        loss: &mut impl FnMut(usize, &[f64], &mut [f64]) -> f64,
        by_inputs: &mut DMatrix<f64>,
    ) -> Result<f64, RollOutError<S::Error>> {
        let (dim, steps) = (system.space().dim(), schedule.steps());
        let per_step = numbers_per_step(system.space(), M::LINKS.len());
        // A kept state has its segment's number beside it.
        let plan = Plan::new(steps, per_step, dim + 1, self.budget);
        self.tape
            .record
            .resize(plan.segment.min(steps) * per_step, 0.0);
        self.kept.resize((plan.kept + 1) * dim, 0.0);
        self.kept[..dim].copy_from_slice(initial);
        self.segments.clear();
        self.segments.reserve(plan.kept + 1);
        self.segments.push(0);
        let from_segment = |segment: usize| (segment * plan.segment).min(steps);

        let mut value = 0.0;
        let mut end = steps.div_ceil(plan.segment);
        if end == 0 {
            self.at_sample(0, initial, loss, &mut value);
            return Ok(value);
        }
        let mut at_end = true;
        while let Some(&(mut from)) = self.segments.last() {
            let top = self.segments.len() - 1;
            self.x.copy_from_slice(&self.kept[top * dim..][..dim]);
            while end - from > 1 && self.segments.len() <= plan.kept {
                // The place of `from`, and the free ones.
                let states = plan.kept + 2 - self.segments.len();
                let next = from + split(end - from, states);
                self.run(system, schedule, from_segment(from)..from_segment(next))?;
                self.kept[self.segments.len() * dim..][..dim].copy_from_slice(&self.x);
                self.segments.push(next);
                from = next;
            }
            self.run(system, schedule, from_segment(from)..from_segment(end - 1))?;
            let steps = from_segment(end - 1)..from_segment(end);
            self.record(system, schedule, steps.clone())?;
            if std::mem::take(&mut at_end) {
                let x = std::mem::take(&mut self.x);
                self.at_sample(schedule.intervals(), &x, loss, &mut value);
                self.x = x;
            }
            self.back(system, schedule, steps, loss, (&mut value, by_inputs))?;
            end -= 1;
            if self.segments.last() == Some(&end) {
                self.segments.pop();
            }
        }
        Ok(value)
    }

    /// Adds ∂ℓ_k/∂x_k to λ and ℓ_k to `value`.
    fn at_sample(
        &mut self,
        sample: usize,
        x: &[f64],
        loss: &mut impl FnMut(usize, &[f64], &mut [f64]) -> f64,
        value: &mut f64,
    ) {
        self.by_sample.fill(0.0);
        *value += loss(sample, x, &mut self.by_sample);
        for (lambda, by) in self.reverse.lambda.iter_mut().zip(&self.by_sample) {
            *lambda += by;
        }
    }

    /// Moves x over steps that are not recorded.
    fn run(
        &mut self,
        system: &S,
        schedule: Schedule<'_, S::Input>,
        steps: std::ops::Range<usize>,
    ) -> Result<(), RollOutError<S::Error>> {
        for held in schedule.held(steps) {
            for step in held.steps.clone().map(|i| held.step(i)) {
                let (time, x) = (step.t, &mut self.x);
                self.method
                    .step(system, time, step.h, step.u, &mut self.tape.memory, x)
                    .map_err(|source| RollOutError::Step { time, source })?;
                check_finite(time + step.h, x)?;
            }
        }
        Ok(())
    }

    /// Moves x over the steps of a segment and records their stages.
    fn record(
        &mut self,
        system: &S,
        schedule: Schedule<'_, S::Input>,
        steps: std::ops::Range<usize>,
    ) -> Result<(), RollOutError<S::Error>> {
        self.tape.at = 0;
        let recorded = Recorded(system);
        let flat = system.space().is_flat();
        for held in schedule.held(steps) {
            for step in held.steps.clone().map(|i| held.step(i)) {
                let (time, x) = (step.t, &mut self.x);
                if !flat {
                    self.tape.push(x);
                }
                self.method
                    .step(&recorded, time, step.h, step.u, &mut self.tape, x)
                    .map_err(|source| RollOutError::Step { time, source })?;
                check_finite(time + step.h, x)?;
            }
        }
        Ok(())
    }

    /// Back through the recorded steps; adds the losses of the samples at which steps among them begin.
    fn back(
        &mut self,
        system: &S,
        schedule: Schedule<'_, S::Input>,
        steps: std::ops::Range<usize>,
        loss: &mut impl FnMut(usize, &[f64], &mut [f64]) -> f64,
        (value, by_inputs): (&mut f64, &mut DMatrix<f64>),
    ) -> Result<(), RollOutError<S::Error>> {
        let dim = system.space().dim();
        let per_step = numbers_per_step(system.space(), M::LINKS.len());
        let record = std::mem::take(&mut self.tape.record);
        let mut records = record[..steps.len() * per_step].rchunks_exact(per_step.max(1));
        for held in schedule.held(steps).rev() {
            for i in held.steps.clone().rev() {
                let (step, record) = (held.step(i), records.next().unwrap_or_default());
                self.reverse
                    .step::<S, M>(system, &step, record, &mut self.tape.memory)
                    .map_err(|source| RollOutError::Step {
                        time: step.t,
                        source: StepError::RightHandSide(source),
                    })?;
                if i == 0 {
                    let by_input = &mut self.reverse.by.input;
                    by_inputs
                        .column_mut(held.interval)
                        .copy_from_slice(by_input);
                    by_input.fill(0.0);
                    self.at_sample(held.interval, &record[..dim], loss, value);
                }
            }
        }
        self.tape.record = record;
        Ok(())
    }
}

/// NaN and infinities are named.
fn check_gradient<E>(value: f64, out: &RollOutGradient) -> Result<(), GradientError<E>> {
    let bad = |numbers: &[f64]| numbers.iter().position(|x| !x.is_finite());
    let parts: [(&'static str, &[f64]); 4] = [
        ("the loss", &[value]),
        ("the initial state", &out.initial),
        ("the constants", &out.parameters),
        ("the inputs, interval after interval", out.inputs.as_slice()),
    ];
    for (part, numbers) in parts {
        if let Some(entry) = bad(numbers) {
            return Err(GradientError::NotFinite {
                part,
                entry,
                value: numbers.get(entry).copied().unwrap_or(f64::NAN),
            });
        }
    }
    Ok(())
}
