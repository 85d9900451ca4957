//! What can be rolled out.

use std::fmt;
use std::marker::PhantomData;

use crate::{Flat, Space};

/// ẋ = f(t, x, u) with the states x in a [`Space`] and an input u that is held over each step.
///
/// Immutable and shared between threads; what changes while f is evaluated is in the [`Memory`](Self::Memory) of each thread. In
/// a space that is not flat, ẋ has one entry a direction of motion, for example the velocity of a turning body in its own axes.
///
/// [`Ode`] makes one of a closure.
pub trait System: Sync {
    /// Where the states live.
    type Space: Space;
    /// What is held over a step: forces, or the number of a step in a table of them.
    type Input: ?Sized + Sync;
    /// Scratch memory of one thread.
    type Memory: Send;
    /// What f refuses.
    type Error: Send;

    /// Where the states live.
    fn space(&self) -> &Self::Space;

    /// Scratch memory for one thread.
    fn memory(&self) -> Self::Memory;

    /// Writes ẋ = f(t, x, u), as long as a tangent of the space, to `dx`, every entry of it.
    ///
    /// # Errors
    /// Where f has no value. Methods pass them on and leave the state as it was.
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &Self::Input,
        memory: &mut Self::Memory,
        dx: &mut [f64],
    ) -> Result<(), Self::Error>;
}

/// A [`System`] in a flat space from a closure `f(t, x, u, memory, dx)`.
///
/// ```
/// use std::convert::Infallible;
/// use integrators::{Ode, System};
///
/// // ẋ = −x + u
/// let lag = Ode::new(1, |_t, x: &[f64], u: &f64, dx: &mut [f64]| {
///     dx[0] = -x[0] + u;
///     Ok::<(), Infallible>(())
/// });
/// let mut dx = [0.0];
/// let Ok(()) = lag.rate(0.0, &[1.0], &3.0, &mut lag.memory(), &mut dx);
/// assert_eq!(dx, [2.0]);
/// ```
pub struct Ode<F, U, M, E> {
    space: Flat,
    rate: F,
    memory: Box<dyn Fn() -> M + Send + Sync>,
    signature: PhantomData<fn(&U) -> E>,
}

impl<F, U, E> Ode<F, U, (), E> {
    /// ẋ = f for states of `dim` entries: `rate(t, x, u, dx)` writes every entry of `dx`.
    #[allow(
        clippy::type_complexity,
        reason = "the closure's signature is the documentation"
    )]
    pub fn new(
        dim: usize,
        rate: F,
    ) -> Ode<impl Fn(f64, &[f64], &U, &mut (), &mut [f64]) -> Result<(), E> + Sync, U, (), E>
    where
        F: Fn(f64, &[f64], &U, &mut [f64]) -> Result<(), E> + Sync,
    {
        Ode::with_memory(
            dim,
            || (),
            move |t, x: &[f64], u: &U, (): &mut (), dx: &mut [f64]| rate(t, x, u, dx),
        )
    }
}

impl<F, U, M, E> Ode<F, U, M, E>
where
    F: Fn(f64, &[f64], &U, &mut M, &mut [f64]) -> Result<(), E> + Sync,
{
    /// As [`new`](Self::new), for a right-hand side that needs memory: `memory()` makes one for a thread.
    pub fn with_memory(
        dim: usize,
        memory: impl Fn() -> M + Send + Sync + 'static,
        rate: F,
    ) -> Self {
        Ode {
            space: Flat::new(dim),
            rate,
            memory: Box::new(memory),
            signature: PhantomData,
        }
    }
}

impl<F, U, M, E> fmt::Debug for Ode<F, U, M, E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Ode").field("space", &self.space).finish()
    }
}

impl<F, U, M, E> System for Ode<F, U, M, E>
where
    F: Fn(f64, &[f64], &U, &mut M, &mut [f64]) -> Result<(), E> + Sync,
    U: Sync,
    M: Send,
    E: Send,
{
    type Space = Flat;
    type Input = U;
    type Memory = M;
    type Error = E;

    fn space(&self) -> &Flat {
        &self.space
    }

    fn memory(&self) -> M {
        (self.memory)()
    }

    fn rate(&self, t: f64, x: &[f64], u: &U, memory: &mut M, dx: &mut [f64]) -> Result<(), E> {
        (self.rate)(t, x, u, memory, dx)
    }
}
