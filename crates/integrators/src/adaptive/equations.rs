//! A system as the solvers see it: ẏ = F(t, y) in a vector space, whatever the space of the states.

use std::cell::RefCell;
use std::rc::Rc;

use diffsol::{
    ConstantOp, NalgebraContext, NalgebraMat, NalgebraVec, NonLinearOp, NonLinearOpJacobian,
    OdeEquations, OdeEquationsRef, Op, ParameterisedOp, UnitCallable,
};
use diffsol::{DenseMatrix as _, MatrixCommon as _};
use nalgebra::DMatrix;

use super::Refusal;
use super::chart::Chart;
use crate::{Differentiable, Jacobian, Space};

pub(super) type Vector64 = NalgebraVec<f64>;
pub(super) type Matrix64 = NalgebraMat<f64>;

/// A rate beyond this counts as none: squares of it, divided by any tolerance, stay in the numbers.
const BOUND: f64 = 1e80;

/// The same for states. Beyond it are also those that a stage makes of a rate that was [`REFUSED`].
pub(super) const FARTHEST: f64 = 1e50;

/// What the solvers are given where there is no rate: so large that every error test and every Newton iteration fails, and a shorter
/// step is tried.
const REFUSED: f64 = 1e90;

/// Whether a rate or a derivative of one is NaN, infinite or too large.
fn beyond(value: f64) -> bool {
    value.is_nan() || value.abs() >= BOUND
}

/// ẏ = F(t, y).
///
/// In a flat space y = x. Else y = c + ξ with the chart x = x₀ ∘ exp ξ around the last state where it was centred, and
/// F = φ(ad_ξ)⁻¹ f(t, x). The constants c are [`Space::scale_into`] at x₀, so that a tolerance relative to y is what it says.
pub(super) struct Equations<'s, S: Differentiable> {
    pub inner: Rc<RefCell<Inner<'s, S>>>,
    context: NalgebraContext,
    directions: usize,
}

/// The right-hand side at a point.
#[derive(Debug, Clone, Default)]
struct Evaluation {
    time: f64,
    y: Vec<f64>,
    rate: Vec<f64>,
    valid: bool,
}

/// What changes while the equations are evaluated.
pub(super) struct Inner<'s, S: Differentiable> {
    system: &'s S,
    input: &'s S::Input,
    memory: S::Memory,
    absolute: Vec<f64>,
    relative: f64,
    flat: bool,
    chart: Chart,
    anchor: Vec<f64>,
    offset: Vec<f64>,
    xi: Vec<f64>,
    point: Vec<f64>,
    velocity: Vec<f64>,
    derivative: Jacobian,
    in_chart: DMatrix<f64>,
    recent: [Evaluation; 2],
    newest: usize,
    /// Where the solvers ask for a rate that is overwritten.
    pub asleep: bool,
    pub start: Vec<f64>,
    pub evaluations: usize,
    pub jacobians: usize,
    /// Since it was last taken.
    pub refusal: Option<(f64, Refusal<S::Error>)>,
    /// Of a Jacobian, since it was last taken.
    pub no_jacobian: Option<(f64, Refusal<S::Error>)>,
}

impl<'s, S: Differentiable> Equations<'s, S> {
    pub fn new(
        system: &'s S,
        input: &'s S::Input,
        initial: &[f64],
        absolute: &[f64],
        relative: f64,
    ) -> Self {
        let space = system.space();
        let directions = space.tangent_dim();
        let context = NalgebraContext::default();
        let zeros = || vec![0.0; directions];
        let blank = || Evaluation {
            time: 0.0,
            y: zeros(),
            rate: zeros(),
            valid: false,
        };
        let mut inner = Inner {
            system,
            input,
            memory: system.memory(),
            absolute: absolute.to_vec(),
            relative,
            flat: space.is_flat(),
            chart: Chart::new(directions),
            anchor: initial.to_vec(),
            offset: zeros(),
            xi: zeros(),
            point: initial.to_vec(),
            velocity: zeros(),
            derivative: Jacobian::zeros(system),
            in_chart: DMatrix::zeros(directions, directions),
            recent: [blank(), blank()],
            newest: 0,
            asleep: false,
            start: zeros(),
            evaluations: 0,
            jacobians: 0,
            refusal: None,
            no_jacobian: None,
        };
        if inner.flat {
            inner.start.copy_from_slice(initial);
        } else {
            space.scale_into(initial, &mut inner.offset);
            inner.start.copy_from_slice(&inner.offset);
        }
        Equations {
            inner: Rc::new(RefCell::new(inner)),
            context,
            directions,
        }
    }
}

impl<S: Differentiable> Clone for Equations<'_, S> {
    /// The same equations, with the same counts.
    fn clone(&self) -> Self {
        Equations {
            inner: Rc::clone(&self.inner),
            context: self.context,
            directions: self.directions,
        }
    }
}

impl<'s, S: Differentiable> Inner<'s, S> {
    pub fn set_input(&mut self, input: &'s S::Input) {
        self.input = input;
        for evaluation in &mut self.recent {
            evaluation.valid = false;
        }
    }

    /// The state x that y stands for.
    pub fn state_into(&mut self, y: &[f64], out: &mut [f64]) {
        if self.flat {
            out.copy_from_slice(y);
        } else {
            for ((xi, y), c) in self.xi.iter_mut().zip(y).zip(&self.offset) {
                *xi = y - c;
            }
            self.system.space().move_into(&self.anchor, &self.xi, out);
        }
    }

    /// How far y is from the centre of the chart: ‖ad_ξ‖; 0 in a flat space.
    pub fn reach(&mut self, y: &[f64]) -> f64 {
        if self.flat {
            return 0.0;
        }
        for ((xi, y), c) in self.xi.iter_mut().zip(y).zip(&self.offset) {
            *xi = y - c;
        }
        self.chart.reach(self.system.space(), &self.xi)
    }

    /// Centres the chart at y, and writes what stands for the same state from then on to `out`.
    pub fn centre(&mut self, y: &[f64], out: &mut [f64]) {
        if self.flat {
            out.copy_from_slice(y);
            return;
        }
        let mut point = std::mem::take(&mut self.point);
        self.state_into(y, &mut point);
        self.anchor.copy_from_slice(&point);
        self.point = point;
        self.system
            .space()
            .scale_into(&self.anchor, &mut self.offset);
        out.copy_from_slice(&self.offset);
        for evaluation in &mut self.recent {
            evaluation.valid = false;
        }
    }

    /// Writes F(t, y), or [`REFUSED`] where there is none.
    pub fn rate(&mut self, t: f64, y: &[f64], out: &mut [f64]) {
        if self.asleep {
            out.fill(0.0);
            return;
        }
        for known in &self.recent {
            if known.valid && known.time == t && known.y == y {
                out.copy_from_slice(&known.rate);
                return;
            }
        }
        if !self.try_rate(t, y, out) {
            out.fill(REFUSED);
            return;
        }
        self.newest = 1 - self.newest;
        if let Some(newest) = self.recent.get_mut(self.newest) {
            newest.time = t;
            newest.y.copy_from_slice(y);
            newest.rate.copy_from_slice(out);
            newest.valid = true;
        }
    }

    fn try_rate(&mut self, t: f64, y: &[f64], out: &mut [f64]) -> bool {
        // NaN is not below the bound either.
        if !y.iter().all(|y| y.abs() < FARTHEST) {
            return false;
        }
        self.evaluations += 1;
        let done = if self.flat {
            self.system.rate(t, y, self.input, &mut self.memory, out)
        } else {
            let mut point = std::mem::take(&mut self.point);
            self.state_into(y, &mut point);
            let done =
                self.system
                    .rate(t, &point, self.input, &mut self.memory, &mut self.velocity);
            self.point = point;
            done.map(|()| {
                let (space, xi, velocity) = (self.system.space(), &self.xi, &self.velocity);
                if velocity.iter().any(|v| !v.is_finite()) {
                    out.copy_from_slice(velocity);
                } else if !self.chart.rate_into(space, xi, velocity, out) {
                    // Beyond the chart: a shorter step stays in it.
                    out.fill(REFUSED);
                }
            })
        };
        if let Err(error) = done {
            self.refusal = Some((t, Refusal::System(error)));
            return false;
        }
        for (component, &value) in out.iter().enumerate() {
            if beyond(value) && value != REFUSED {
                self.refusal = Some((t, Refusal::Rate { component, value }));
                return false;
            }
        }
        out.iter().all(|&value| value != REFUSED)
    }

    fn jacobian(&mut self, t: f64, y: &[f64]) {
        self.jacobians += 1;
        self.in_chart.fill(0.0);
        if !y.iter().all(|y| y.abs() < FARTHEST) {
            return;
        }
        let mut point = std::mem::take(&mut self.point);
        self.state_into(y, &mut point);
        let done = self.system.linearize(
            (t, &point, self.input),
            &mut self.memory,
            &mut self.velocity,
            &mut self.derivative,
        );
        self.point = point;
        if let Err(error) = done {
            self.no_jacobian = Some((t, Refusal::System(error)));
            return;
        }
        let found = &self.derivative.state;
        for row in 0..found.nrows() {
            for column in 0..found.ncols() {
                let value = found[(row, column)];
                if beyond(value) {
                    self.no_jacobian = Some((t, Refusal::Jacobian { row, column, value }));
                    return;
                }
            }
        }
        if self.flat {
            self.in_chart.copy_from(found);
        } else {
            let space = self.system.space();
            self.chart
                .jacobian_into(space, &self.xi, &self.velocity, found, &mut self.in_chart);
        }
    }

    /// The Jacobian of the last call, ∂F/∂y.
    pub fn last_jacobian(&self) -> &DMatrix<f64> {
        &self.in_chart
    }

    /// ‖F(t, y₁) − F(t, y₂)‖/‖y₁ − y₂‖ of the last two evaluations where they are at one time, each entry relative to its tolerance.
    pub fn slope(&self) -> Option<f64> {
        let [a, b] = &self.recent;
        if !(a.valid && b.valid && a.time == b.time) {
            return None;
        }
        let (mut rates, mut states) = (0.0, 0.0);
        for i in 0..a.y.len() {
            let scale = self.absolute[i] + self.relative * a.y[i].abs();
            rates += ((a.rate[i] - b.rate[i]) / scale).powi(2);
            states += ((a.y[i] - b.y[i]) / scale).powi(2);
        }
        (states > 0.0).then(|| (rates / states).sqrt())
    }

    /// √(mean of (vᵢ/(atolᵢ + rtol |yᵢ|))²), the norm of the error test.
    pub fn norm(&self, v: &[f64], y: &[f64]) -> f64 {
        let sum: f64 = v
            .iter()
            .zip(y)
            .zip(&self.absolute)
            .map(|((v, y), a)| (v / (a + self.relative * y.abs())).powi(2))
            .sum();
        (sum / v.len().max(1) as f64).sqrt()
    }

    /// The same norm of a − b.
    pub fn norm_of_change(&self, a: &[f64], b: &[f64], y: &[f64]) -> f64 {
        let sum: f64 = a
            .iter()
            .zip(b)
            .zip(y)
            .zip(&self.absolute)
            .map(|(((a, b), y), s)| ((a - b) / (s + self.relative * y.abs())).powi(2))
            .sum();
        (sum / a.len().max(1) as f64).sqrt()
    }
}

/// F.
pub(super) struct Rate<'a, 's, S: Differentiable>(&'a Equations<'s, S>);

/// y at the start.
pub(super) struct Start<'a, 's, S: Differentiable>(&'a Equations<'s, S>);

impl<S: Differentiable> Op for Equations<'_, S> {
    type T = f64;
    type V = Vector64;
    type M = Matrix64;
    type C = NalgebraContext;
    fn context(&self) -> &Self::C {
        &self.context
    }
    fn nstates(&self) -> usize {
        self.directions
    }
    fn nout(&self) -> usize {
        self.directions
    }
    fn nparams(&self) -> usize {
        0
    }
}

macro_rules! same_sizes {
    ($name:ident) => {
        impl<S: Differentiable> Op for $name<'_, '_, S> {
            type T = f64;
            type V = Vector64;
            type M = Matrix64;
            type C = NalgebraContext;
            fn context(&self) -> &Self::C {
                &self.0.context
            }
            fn nstates(&self) -> usize {
                self.0.directions
            }
            fn nout(&self) -> usize {
                self.0.directions
            }
            fn nparams(&self) -> usize {
                0
            }
        }
    };
}
same_sizes!(Rate);
same_sizes!(Start);

impl<S: Differentiable> NonLinearOp for Rate<'_, '_, S> {
    fn call_inplace(&self, y: &Vector64, t: f64, out: &mut Vector64) {
        self.0
            .inner
            .borrow_mut()
            .rate(t, y.batch_as_slice(0), out.batch_as_mut_slice(0));
    }
}

impl<S: Differentiable> NonLinearOpJacobian for Rate<'_, '_, S> {
    fn jac_mul_inplace(&self, y: &Vector64, t: f64, v: &Vector64, out: &mut Vector64) {
        let mut inner = self.0.inner.borrow_mut();
        inner.jacobian(t, y.batch_as_slice(0));
        for (out, row) in out
            .batch_as_mut_slice(0)
            .iter_mut()
            .zip(inner.in_chart.row_iter())
        {
            *out = row
                .iter()
                .zip(v.batch_as_slice(0))
                .map(|(a, b)| a * b)
                .sum();
        }
    }

    fn jacobian_inplace(&self, y: &Vector64, t: f64, out: &mut Matrix64) {
        let mut inner = self.0.inner.borrow_mut();
        inner.jacobian(t, y.batch_as_slice(0));
        let found = &inner.in_chart;
        for i in 0..out.nrows() {
            for j in 0..out.ncols() {
                out.set_index(i, j, found[(i, j)]);
            }
        }
    }
}

impl<S: Differentiable> ConstantOp for Start<'_, '_, S> {
    fn call_inplace(&self, _t: f64, y: &mut Vector64) {
        y.batch_as_mut_slice(0)
            .copy_from_slice(&self.0.inner.borrow().start);
    }
}

impl<'a, 's, S: Differentiable> OdeEquationsRef<'a> for Equations<'s, S> {
    type Mass = ParameterisedOp<'a, UnitCallable<Matrix64>>;
    type Rhs = Rate<'a, 's, S>;
    type Root = ParameterisedOp<'a, UnitCallable<Matrix64>>;
    type Init = Start<'a, 's, S>;
    type Out = ParameterisedOp<'a, UnitCallable<Matrix64>>;
    type Reset = ParameterisedOp<'a, UnitCallable<Matrix64>>;
}

impl<'s, S: Differentiable> OdeEquations for Equations<'s, S> {
    fn rhs(&self) -> Rate<'_, 's, S> {
        Rate(self)
    }
    fn mass(&self) -> Option<ParameterisedOp<'_, UnitCallable<Matrix64>>> {
        // M = 1.
        None
    }
    fn init(&self) -> Start<'_, 's, S> {
        Start(self)
    }
    fn set_params(&mut self, _p: &Vector64) {}
    fn get_params(&self, _p: &mut Vector64) {}
}
