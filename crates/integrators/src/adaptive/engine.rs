//! The solvers behind one face.

use diffsol::error::OdeSolverError;
use diffsol::{
    Bdf, BdfState, DiffsolError, ExplicitRk, NalgebraLU, OdeSolverMethod, OdeSolverProblem,
    OdeSolverState, RkState, Sdirk, StateRefMut, Tableau,
};

use super::Method;
use super::equations::{Equations, Vector64};
use crate::Differentiable;

type Problem<'s, S> = OdeSolverProblem<Equations<'s, S>>;
type Lu = NalgebraLU<f64>;

/// A point of a trajectory: time, state, rate.
pub(super) struct Point<'a> {
    pub time: f64,
    pub y: &'a [f64],
    pub rate: &'a [f64],
}

pub(super) enum Solver<'p, 's, S: Differentiable> {
    Explicit(Box<ExplicitRk<'p, Equations<'s, S>>>),
    Diagonal(Box<Sdirk<'p, Equations<'s, S>, Lu>>),
    Backward(Box<Bdf<'p, Equations<'s, S>, Lu>>),
}

/// The same for each solver.
macro_rules! each {
    ($solver:expr, $name:ident => $call:expr) => {
        match $solver {
            Solver::Explicit($name) => $call,
            Solver::Diagonal($name) => $call,
            Solver::Backward($name) => $call,
        }
    };
}

/// Writes a point and a step to the state of a solver.
fn fill(state: StateRefMut<'_, Vector64>, at: &Point<'_>, h: f64) {
    state.y.batch_as_mut_slice(0).copy_from_slice(at.y);
    state.dy.batch_as_mut_slice(0).copy_from_slice(at.rate);
    *state.t = at.time;
    *state.h = h;
}

impl<'p, 's, S: Differentiable> Solver<'p, 's, S> {
    /// A solver that starts at a point with steps of h; [`Method::Automatic`] starts as Tsit5.
    pub fn new(
        problem: &'p Problem<'s, S>,
        method: Method,
        at: &Point<'_>,
        h: f64,
    ) -> Result<Self, DiffsolError> {
        // The state asks for a rate, which `fill` then replaces.
        problem.eqn.inner.borrow_mut().asleep = true;
        let solver = Self::start(problem, method, at, h);
        problem.eqn.inner.borrow_mut().asleep = false;
        solver
    }

    fn start(
        problem: &'p Problem<'s, S>,
        method: Method,
        at: &Point<'_>,
        h: f64,
    ) -> Result<Self, DiffsolError> {
        if method == Method::Bdf {
            let mut state = BdfState::new_without_initialise(problem)?;
            fill(state.as_mut(), at, h);
            return Ok(Solver::Backward(Box::new(problem.bdf_solver::<Lu>(state)?)));
        }
        let mut state = RkState::new_without_initialise(problem)?;
        fill(state.as_mut(), at, h);
        Ok(match method {
            Method::TrBdf2 => Solver::Diagonal(Box::new(
                problem.sdirk_solver::<Lu, _>(state, Tableau::tr_bdf2())?,
            )),
            Method::Esdirk34 => Solver::Diagonal(Box::new(
                problem.sdirk_solver::<Lu, _>(state, Tableau::esdirk34())?,
            )),
            _ => Solver::Explicit(Box::new(
                problem.explicit_rk_solver(state, Tableau::tsit45())?,
            )),
        })
    }

    /// Goes on from a point without a past, with steps of h.
    pub fn restart(&mut self, at: &Point<'_>, h: f64) {
        each!(self, solver => fill(solver.state_mut(), at, h));
    }

    pub fn step(&mut self) -> Result<(), DiffsolError> {
        each!(self, solver => solver.step()).map(|_| ())
    }

    /// Where the solver is.
    pub fn point(&self) -> Point<'_> {
        let state = each!(self, solver => solver.state());
        Point {
            time: state.t,
            y: state.y.batch_as_slice(0),
            rate: state.dy.batch_as_slice(0),
        }
    }

    /// The next step.
    pub fn h(&self) -> f64 {
        each!(self, solver => solver.state().h)
    }

    /// No step goes beyond `time`; forgotten when it is reached. False where it is reached already, but for rounding.
    pub fn stop_at(&mut self, time: f64) -> Result<bool, DiffsolError> {
        match each!(self, solver => solver.set_stop_time(time)) {
            Ok(()) => Ok(true),
            Err(DiffsolError::OdeSolverError(OdeSolverError::StopTimeAtCurrentTime)) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// The state at a time in the last step.
    pub fn interpolate(&self, time: f64, out: &mut Vector64) -> Result<(), DiffsolError> {
        each!(self, solver => solver.interpolate_inplace(time, out))
    }

    /// Steps tried again, and factorisations.
    pub fn counts(&self) -> (usize, usize) {
        let counts = each!(self, solver => solver.get_statistics());
        (
            counts.number_of_error_test_failures + counts.number_of_nonlinear_solver_fails,
            counts.number_of_linear_solver_setups,
        )
    }
}
