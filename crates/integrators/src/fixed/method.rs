use crate::System;

/// A method of fixed step for a kind of systems, with its working memory.
pub trait Method<S: System> {
    /// Replaces x(t) by x(t + h), with `u` held.
    ///
    /// Takes memory at the first step of a system at most. No finiteness is checked here: [`roll_out`](crate::roll_out) does it.
    ///
    /// # Errors
    /// The first error of the system; x is then as it was.
    fn step(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>>;
}

/// Why there is no step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError<E> {
    /// The right-hand side failed.
    #[error("the equations of motion failed")]
    RightHandSide(#[source] E),
    /// The equations of an implicit step were not solved.
    #[error(
        "the velocity of the step still changed by {change:e} of its size after {iterations} iterations: take smaller steps"
    )]
    NoConvergence {
        /// Iterations made.
        iterations: usize,
        /// The last change, relative to the velocity.
        change: f64,
    },
}
