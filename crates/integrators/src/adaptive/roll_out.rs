//! A whole trajectory by steps that adapt.

use diffsol::error::OdeSolverError;
use diffsol::{DiffsolError, NalgebraContext, OdeBuilder, OdeSolverProblem, Vector};

use super::engine::{Point, Solver};
use super::equations::{Equations, FARTHEST, Matrix64, Vector64};
use super::start::{after_explicit, first_step};
use super::stiffness::{TIGHTER, Taken, Watch};
use super::{AdaptiveError, ArgumentError, Method, Settings, Statistics, Switch};
use crate::{Differentiable, Space};

/// How far the chart reaches before it is centred anew, as ‖ad_ξ‖, for methods that need no past.
const NEAR: f64 = 0.5;
/// The same for backward differences, which lose their past by it.
const FAR: f64 = 2.0;

/// Inputs of a roll-out.
#[derive(Debug, Clone, Copy)]
pub enum Inputs<'a, U> {
    /// `inputs[k]` is held from sample k to sample k + 1; one for the last sample may be there and is not used.
    Held(&'a [U]),
    /// One input all the time.
    Constant(&'a U),
}

/// States, and what they took.
#[derive(Debug, Clone, PartialEq)]
pub struct RollOut {
    /// Row k is the state at `times[k]`.
    pub states: Vec<Vec<f64>>,
    /// Counts.
    pub statistics: Statistics,
}

/// States of a system at `times` from `initial` at `times[0]`, by steps that adapt to [`Settings`].
///
/// No step straddles a sample at which the input changes; where it does not change, steps are as long as the motion lets them be, and
/// the states at samples within them come from the interpolant of the method. Row 0 is `initial`. Without inputs, `Inputs::Constant`.
///
/// ```
/// use std::convert::Infallible;
/// use integrators::adaptive::{Inputs, Method, Settings, roll_out};
/// use integrators::{Differentiable, Flat, Gradient, Jacobian, System};
///
/// /// ẋ = −1000 (x − u).
/// struct Lag(Flat);
/// # impl System for Lag {
/// #     type Space = Flat;
/// #     type Input = f64;
/// #     type Memory = ();
/// #     type Error = Infallible;
/// #     fn space(&self) -> &Flat { &self.0 }
/// #     fn memory(&self) {}
/// #     fn rate(&self, _t: f64, x: &[f64], u: &f64, _: &mut (), dx: &mut [f64]) -> Result<(), Infallible> {
/// #         dx[0] = -1000.0 * (x[0] - u);
/// #         Ok(())
/// #     }
/// # }
/// # impl Differentiable for Lag {
/// #     fn input_count(&self) -> usize { 1 }
/// #     fn parameter_count(&self) -> usize { 0 }
/// #     fn linearize(&self, (t, x, u): (f64, &[f64], &f64), m: &mut (), dx: &mut [f64], by: &mut Jacobian) -> Result<(), Infallible> {
/// #         by.state[(0, 0)] = -1000.0;
/// #         by.input[(0, 0)] = 1000.0;
/// #         self.rate(t, x, u, m, dx)
/// #     }
/// #     fn pull_back(&self, (t, x, u): (f64, &[f64], &f64), m: &mut (), w: &[f64], dx: &mut [f64], by: &mut Gradient) -> Result<(), Infallible> {
/// #         by.state[0] += -1000.0 * w[0];
/// #         by.input[0] += 1000.0 * w[0];
/// #         self.rate(t, x, u, m, dx)
/// #     }
/// # }
/// let settings = Settings::new(Method::Automatic, 1e-6, 1e-9);
/// let rolled = roll_out(&Lag(Flat::new(1)), &settings, &[0.0, 1.0, 2.0], Inputs::Held(&[1.0, 3.0]), &[0.0])?;
/// assert!((rolled.states[1][0] - 1.0).abs() < 1e-5);
/// assert!((rolled.states[2][0] - 3.0).abs() < 1e-5);
/// # Ok::<(), integrators::adaptive::AdaptiveError<Infallible>>(())
/// ```
///
/// # Errors
/// See [`AdaptiveError`]; the arguments are checked before the first step, and all that is wrong with them is reported.
pub fn roll_out<S>(
    system: &S,
    settings: &Settings,
    times: &[f64],
    inputs: Inputs<'_, S::Input>,
    initial: &[f64],
) -> Result<RollOut, AdaptiveError<S::Error>>
where
    S: Differentiable,
    S::Input: Sized + PartialEq,
{
    check(system, settings, times, &inputs, initial)?;
    let mut states = Vec::with_capacity(times.len());
    let (Some(&begin), Some(&end)) = (times.first(), times.last()) else {
        return Ok(RollOut {
            states,
            statistics: Statistics::default(),
        });
    };
    states.push(initial.to_vec());
    let pieces = pieces(times.len(), &inputs);
    let Some(&(_, _, first_input)) = pieces.first() else {
        return Ok(RollOut {
            states,
            statistics: Statistics::default(),
        });
    };
    let directions = system.space().tangent_dim();
    let absolute = match settings.absolute.as_slice() {
        [one] => vec![*one; directions],
        all => all.to_vec(),
    };
    let equations = Equations::new(system, first_input, initial, &absolute, settings.relative);
    let failed = |time: f64, error: DiffsolError| AdaptiveError::Solver {
        time,
        message: error.to_string(),
    };
    // The same equations at a part of the tolerance.
    let shortest = (1e-40 * (end - begin)).max(1e-300);
    let problem_at = |part: f64| {
        let mut problem = OdeBuilder::<Matrix64>::new()
            .t0(begin)
            .rtol(part * settings.relative)
            .atol(absolute.iter().map(|a| part * a).collect::<Vec<_>>())
            .build_from_eqn(equations.clone())
            .map_err(|error| failed(begin, error))?;
        let options = &mut problem.ode_options;
        options.min_timestep = shortest;
        options.max_nonlinear_solver_failures = usize::MAX;
        // As SciPy has them; diffsol's own 2 and 1/2 take many steps from the first one, or to a place where forces change suddenly.
        options.max_timestep_growth = Some(10.0);
        options.min_timestep_shrink = Some(0.2);
        Ok(problem)
    };
    let problem = problem_at(1.0)?;
    let tight = match settings.method {
        Method::Automatic => Some(problem_at(TIGHTER)?),
        _ => None,
    };
    let stiff = if pieces.len() > 1 {
        Method::Esdirk34
    } else {
        Method::Bdf
    };
    let mut run = Run {
        problem: &problem,
        tight: tight.as_ref().unwrap_or(&problem),
        settings,
        stiff,
        end,
        statistics: Statistics::default(),
        watch: Watch::new(directions),
        time: begin,
        made: f64::INFINITY,
        y: problem.eqn.inner.borrow().start.clone(),
        rate: vec![0.0; directions],
        rate_before: vec![0.0; directions],
        free: None,
        first: None,
        starting: false,
        method: match settings.method {
            Method::Automatic => Method::Tsit5,
            method => method,
        },
        solver: None,
        counts: (0, 0),
        sample: Vector64::zeros(directions, NalgebraContext::default()),
        next: None,
    };
    for (from, to, input) in pieces {
        let samples = times.get(from + 1..=to).unwrap_or_default();
        run.piece(samples, input, system.space().dim(), &mut states)?;
    }
    let mut statistics = run.statistics;
    let inner = problem.eqn.inner.borrow();
    statistics.evaluations = inner.evaluations;
    statistics.jacobians = inner.jacobians;
    Ok(RollOut { states, statistics })
}

/// Runs of intervals with one input: first and last sample, and the input.
fn pieces<'a, U: PartialEq>(samples: usize, inputs: &Inputs<'a, U>) -> Vec<(usize, usize, &'a U)> {
    let intervals = samples.saturating_sub(1);
    match *inputs {
        Inputs::Constant(input) if intervals > 0 => vec![(0, intervals, input)],
        Inputs::Constant(_) => Vec::new(),
        Inputs::Held(inputs) => {
            let mut pieces: Vec<(usize, usize, &U)> = Vec::new();
            for (k, input) in inputs.iter().take(intervals).enumerate() {
                match pieces.last_mut() {
                    Some((_, to, held)) if *held == input => *to = k + 1,
                    _ => pieces.push((k, k + 1, input)),
                }
            }
            pieces
        }
    }
}

fn check<S>(
    system: &S,
    settings: &Settings,
    times: &[f64],
    inputs: &Inputs<'_, S::Input>,
    initial: &[f64],
) -> Result<(), AdaptiveError<S::Error>>
where
    S: Differentiable,
    S::Input: Sized,
{
    let space = system.space();
    let mut problems = settings.problems(space.tangent_dim());
    let mut previous = f64::NEG_INFINITY;
    for (index, &time) in times.iter().enumerate() {
        // The solvers tell times apart by some hundred roundings.
        let apart = previous + 1e3 * f64::EPSILON * previous.abs();
        if !time.is_finite() || (index > 0 && time <= apart) {
            problems.push(ArgumentError::Times {
                index,
                time,
                previous,
            });
            break;
        }
        previous = time;
    }
    if let Inputs::Held(inputs) = inputs {
        let needed = times.len().saturating_sub(1);
        if inputs.len() < needed {
            problems.push(ArgumentError::Inputs {
                found: inputs.len(),
                needed,
            });
        }
    }
    let (found, expected) = (initial.len(), space.dim());
    if found != expected {
        problems.push(ArgumentError::InitialLength { found, expected });
    }
    for (component, &value) in initial.iter().enumerate() {
        if !value.is_finite() {
            problems.push(ArgumentError::Initial { component, value });
        }
    }
    if problems.is_empty() {
        Ok(())
    } else {
        Err(AdaptiveError::Arguments(problems))
    }
}

/// A roll-out under way.
struct Run<'p, 's, S: Differentiable> {
    problem: &'p OdeSolverProblem<Equations<'s, S>>,
    /// The same with the tolerances of the implicit method.
    tight: &'p OdeSolverProblem<Equations<'s, S>>,
    settings: &'p Settings,
    /// The implicit one of [`Method::Automatic`].
    stiff: Method,
    end: f64,
    statistics: Statistics,
    watch: Watch,
    time: f64,
    /// The last step; infinite after one that the end of a piece shortened.
    made: f64,
    y: Vec<f64>,
    rate: Vec<f64>,
    /// The rate one step before.
    rate_before: Vec<f64>,
    /// The step that was proposed before the end of a piece shortened it.
    free: Option<f64>,
    /// The first step after the last start of backward differences.
    first: Option<f64>,
    /// Whether no step was made since the last start.
    starting: bool,
    method: Method,
    solver: Option<Solver<'p, 's, S>>,
    /// Of the solver, at the last step.
    counts: (usize, usize),
    sample: Vector64,
    /// What the last step says to go on with: a method and its first step.
    next: Option<(Method, f64)>,
}

impl<'p, 's, S: Differentiable> Run<'p, 's, S> {
    /// Rolls on over the samples of one input.
    fn piece(
        &mut self,
        samples: &[f64],
        input: &'s S::Input,
        dim: usize,
        states: &mut Vec<Vec<f64>>,
    ) -> Result<(), AdaptiveError<S::Error>> {
        let Some(&stop) = samples.last() else {
            return Ok(());
        };
        self.problem.eqn.inner.borrow_mut().set_input(input);
        self.restart()?;
        let mut due = samples.iter().copied().peekable();
        let mut stopping = false;
        while self.time < stop {
            let Some(solver) = self.solver.as_mut() else {
                return Ok(());
            };
            if !stopping && self.time + solver.h() * (1.0 + 1e-9) >= stop {
                self.free = Some(solver.h());
                stopping = true;
                let ahead = solver
                    .stop_at(stop)
                    .map_err(|error| self.solver_error(error))?;
                if !ahead {
                    self.time = stop;
                }
            }
            if self.time < stop {
                self.step(stop)?;
            }
            while let Some(time) = due.next_if(|&time| time <= self.time) {
                let mut state = vec![0.0; dim];
                let mut inner = self.problem.eqn.inner.borrow_mut();
                match &self.solver {
                    Some(solver) if time < self.time => {
                        solver
                            .interpolate(time, &mut self.sample)
                            .map_err(|error| AdaptiveError::Solver {
                                time,
                                message: error.to_string(),
                            })?;
                        inner.state_into(self.sample.batch_as_slice(0), &mut state);
                    }
                    _ => inner.state_into(&self.y, &mut state),
                }
                states.push(state);
            }
            if self.time < stop && self.keep_chart_and_method()? {
                stopping = false;
            }
        }
        Ok(())
    }

    /// F at the current point, afresh.
    fn evaluate(&mut self) -> Result<(), AdaptiveError<S::Error>> {
        let mut inner = self.problem.eqn.inner.borrow_mut();
        let before = inner.refusal.take();
        inner.rate(self.time, &self.y, &mut self.rate);
        if let Some((time, source)) = inner.refusal.take() {
            return Err(AdaptiveError::RightHandSide { time, source });
        }
        inner.refusal = before;
        Ok(())
    }

    /// Centres the chart at the current point, and evaluates F there.
    fn centre(&mut self) -> Result<(), AdaptiveError<S::Error>> {
        let from = self.y.clone();
        self.problem
            .eqn
            .inner
            .borrow_mut()
            .centre(&from, &mut self.y);
        self.evaluate()
    }

    /// Changes the method or centres the chart, where it is time; whether one of them was done.
    fn keep_chart_and_method(&mut self) -> Result<bool, AdaptiveError<S::Error>> {
        if let Some((method, h)) = self.next.take() {
            self.method = method;
            self.solver = None;
            self.centre()?;
            self.start(h)?;
            return Ok(true);
        }
        let limit = if self.method == Method::Bdf {
            FAR
        } else {
            NEAR
        };
        if self.problem.eqn.inner.borrow_mut().reach(&self.y) <= limit {
            return Ok(false);
        }
        self.centre()?;
        let h = self.solver.as_ref().map_or(0.0, Solver::h);
        self.start(h)?;
        Ok(true)
    }

    /// Starts without a past, for a new input.
    fn restart(&mut self) -> Result<(), AdaptiveError<S::Error>> {
        self.centre()?;
        let h = match (self.method, self.free, self.first) {
            (Method::Bdf, _, Some(first)) => first,
            (Method::Bdf, _, None) | (_, None, _) => self.first_step(),
            (_, Some(free), _) => free.max(self.solver.as_ref().map_or(0.0, Solver::h)),
        };
        self.start(h)
    }

    /// Goes on from the current point without a past.
    fn start(&mut self, h: f64) -> Result<(), AdaptiveError<S::Error>> {
        self.statistics.starts += 1;
        self.starting = self.method == Method::Bdf;
        let at = Point {
            time: self.time,
            y: &self.y,
            rate: &self.rate,
        };
        if let Some(solver) = self.solver.as_mut() {
            solver.restart(&at, h);
            return Ok(());
        }
        let problem = if self.method == Method::Tsit5 {
            self.problem
        } else {
            self.tight
        };
        let solver =
            Solver::new(problem, self.method, &at, h).map_err(|error| self.solver_error(error))?;
        self.counts = (0, 0);
        self.solver = Some(solver);
        self.statistics.switches.push(Switch {
            time: self.time,
            to: self.method,
        });
        self.jacobian_refusal()
    }

    /// A first step; and the implicit method where the motion is stiff from the beginning.
    fn first_step(&mut self) -> f64 {
        let order = match self.method {
            Method::Bdf => 1.0,
            Method::TrBdf2 => 2.0,
            Method::Esdirk34 => 3.0,
            Method::Tsit5 | Method::Automatic => 5.0,
        };
        let explicit = self.method == Method::Tsit5;
        let at = Point {
            time: self.time,
            y: &self.y,
            rate: &self.rate,
        };
        let span = self.end - self.time;
        let mut inner = self.problem.eqn.inner.borrow_mut();
        let first = first_step(&mut inner, &at, order, span, explicit);
        if !explicit {
            return first.accurate;
        }
        let automatic = self.settings.method == Method::Automatic && self.solver.is_none();
        if automatic && self.watch.begins_stiff(first.accurate, first.radius) {
            self.method = self.stiff;
            return first.first_order;
        }
        first.explicit()
    }

    fn solver_error(&self, error: DiffsolError) -> AdaptiveError<S::Error> {
        AdaptiveError::Solver {
            time: self.time,
            message: error.to_string(),
        }
    }

    fn jacobian_refusal(&self) -> Result<(), AdaptiveError<S::Error>> {
        match self.problem.eqn.inner.borrow_mut().no_jacobian.take() {
            Some((time, source)) => Err(AdaptiveError::RightHandSide { time, source }),
            None => Ok(()),
        }
    }

    /// One accepted step.
    fn step(&mut self, stop: f64) -> Result<(), AdaptiveError<S::Error>> {
        let Some(solver) = self.solver.as_mut() else {
            return Ok(());
        };
        let h = solver.h();
        if self.statistics.steps >= self.settings.max_steps {
            return Err(AdaptiveError::Steps {
                steps: self.statistics.steps,
                time: self.time,
                step: h,
            });
        }
        let before = {
            let mut inner = self.problem.eqn.inner.borrow_mut();
            let rounding = f64::EPSILON * self.time.abs();
            if h.is_nan() || h <= rounding || self.made <= 4.0 * rounding {
                // Steps shrink before a place without a rate.
                return Err(match inner.refusal.take() {
                    Some((time, source)) => AdaptiveError::RightHandSide { time, source },
                    None => AdaptiveError::StepSize {
                        time: self.time,
                        step: h,
                    },
                });
            }
            if self.made > 1e4 * rounding {
                inner.refusal = None;
            }
            (inner.evaluations, inner.jacobians)
        };
        let outcome = solver.step();
        self.jacobian_refusal()?;
        let Some(solver) = self.solver.as_ref() else {
            return Ok(());
        };
        if let Err(error) = outcome {
            if let Some((time, source)) = self.problem.eqn.inner.borrow_mut().refusal.take() {
                return Err(AdaptiveError::RightHandSide { time, source });
            }
            return Err(match error {
                DiffsolError::OdeSolverError(
                    OdeSolverError::StepSizeTooSmall { .. }
                    | OdeSolverError::TooManyErrorTestFailures { .. },
                ) => AdaptiveError::StepSize {
                    time: self.time,
                    step: h,
                },
                error => self.solver_error(error),
            });
        }
        let at = solver.point();
        self.y.copy_from_slice(at.y);
        self.rate_before.copy_from_slice(&self.rate);
        self.rate.copy_from_slice(at.rate);
        let made = at.time - self.time;
        // The solvers count times that differ by rounding as one.
        let close = 200.0 * f64::EPSILON * (stop.abs() + made.abs());
        (self.time, self.made) = if (at.time - stop).abs() <= close {
            (stop, f64::INFINITY)
        } else {
            (at.time, made)
        };
        if let Some(component) = self
            .y
            .iter()
            .position(|y| y.is_nan() || y.abs() >= FARTHEST)
        {
            return Err(AdaptiveError::NotFinite {
                time: self.time,
                component,
                value: self.y.get(component).copied().unwrap_or(f64::NAN),
            });
        }
        let counts = solver.counts();

        let rejected = counts.0.saturating_sub(self.counts.0);
        let factorizations = counts.1.saturating_sub(self.counts.1);
        self.statistics.rejected += rejected;
        self.statistics.factorizations += factorizations;
        self.counts = counts;
        self.statistics.steps += 1;
        if self.starting {
            self.first = Some(made);
            self.starting = false;
        }
        if self.method == Method::Tsit5 {
            self.statistics.explicit_steps += 1;
        }
        if self.settings.method == Method::Automatic {
            let (evaluations, jacobians) = {
                let inner = self.problem.eqn.inner.borrow();
                (inner.evaluations - before.0, inner.jacobians - before.1)
            };
            self.judge(Taken {
                h: made,
                evaluations,
                jacobians,
                factorizations,
                rejected,
            });
        }
        Ok(())
    }

    /// Asks whether to go on with the other method.
    fn judge(&mut self, taken: Taken) {
        let inner = self.problem.eqn.inner.borrow();
        self.next = if self.method == Method::Tsit5 {
            let remaining = self.end - self.time;
            self.watch
                .explicit_step(taken, inner.slope(), remaining)
                .then(|| {
                    let first = if self.stiff == Method::Bdf {
                        let change = inner.norm_of_change(&self.rate, &self.rate_before, &self.y);
                        after_explicit(taken.h, change)
                    } else {
                        taken.h
                    };
                    (self.stiff, first)
                })
        } else {
            self.watch
                .implicit_step(taken, (inner.jacobians, inner.last_jacobian()))
                .map(|h| (Method::Tsit5, h))
        };
    }
}
