//! Counting what a method asks of a system.

use std::convert::Infallible;
use std::sync::atomic::{AtomicUsize, Ordering};

use integrators::problems::Problem;
use integrators::{Mechanical, System};

/// A problem that counts its evaluations: of the rate, the acceleration or the force of a position.
pub struct Counted<P> {
    /// What is counted.
    pub problem: P,
    evaluations: AtomicUsize,
}

impl<P> Counted<P> {
    /// With a count of 0.
    pub fn new(problem: P) -> Self {
        Counted {
            problem,
            evaluations: AtomicUsize::new(0),
        }
    }

    /// So many since the beginning.
    pub fn evaluations(&self) -> usize {
        self.evaluations.load(Ordering::Relaxed)
    }

    fn count(&self) {
        self.evaluations.fetch_add(1, Ordering::Relaxed);
    }
}

impl<P: Problem> System for Counted<P> {
    type Space = P::Space;
    type Input = ();
    type Memory = ();
    type Error = Infallible;

    fn space(&self) -> &P::Space {
        self.problem.space()
    }
    fn memory(&self) {}
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &(),
        memory: &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        self.count();
        self.problem.rate(t, x, u, memory, dx)
    }
}

impl<P: Problem + Mechanical> Mechanical for Counted<P> {
    type Positions = P::Positions;

    fn positions(&self) -> &P::Positions {
        self.problem.positions()
    }
    fn acceleration(
        &self,
        t: f64,
        state: (&[f64], &[f64]),
        u: &(),
        memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        self.count();
        self.problem.acceleration(t, state, u, memory, out)
    }
    fn momentum(
        &self,
        state: (&[f64], &[f64]),
        memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        self.problem.momentum(state, memory, out)
    }
    fn velocity(&self, q: &[f64], memory: &mut (), out: &mut [f64]) -> Result<(), Infallible> {
        self.problem.velocity(q, memory, out)
    }
    fn position_force(
        &self,
        t: f64,
        state: (&[f64], &[f64]),
        u: &(),
        memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        self.count();
        self.problem.position_force(t, state, u, memory, out)
    }
    fn not_separable(&self) -> Option<String> {
        self.problem.not_separable()
    }
}
