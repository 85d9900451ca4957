//! What contacts act on.

use std::fmt;
use std::marker::PhantomData;

use nalgebra::DMatrix;

use crate::{Flat, Space};

/// A mechanism M(q) v̇ = f(t, q, v, u) + Σ wᵢ λᵢ without its contacts: the inertia M and the force f = Q − C v − G of all that is smooth.
///
/// States are x = (q, v) as in a [`PhaseSpace`](crate::PhaseSpace). f is smooth while the contacts stay as they are, also a little
/// beyond the place where they change: a trial step sees penetrated stops. Immutable and shared between threads; what changes is
/// in the [`Memory`](Self::Memory) of each thread. [`Masses`] makes one of a closure.
pub trait ContactSystem: Sync {
    /// Where q lives.
    type Positions: Space;
    /// What is held over a step: forces, or the number of a step in a table of them.
    type Input: ?Sized + Sync;
    /// Scratch memory of one thread.
    type Memory: Send;
    /// What M and f refuse.
    type Error: Send;

    /// Where q lives.
    fn positions(&self) -> &Self::Positions;

    /// Scratch memory for one thread.
    fn memory(&self) -> Self::Memory;

    /// Writes M(q), nv × nv, all of it, to `mass`, and f, nv entries, to `force`, at the `state` (q, v).
    ///
    /// # Errors
    /// Where they have no value.
    fn mass_and_force(
        &self,
        t: f64,
        state: (&[f64], &[f64]),
        u: &Self::Input,
        memory: &mut Self::Memory,
        mass: &mut DMatrix<f64>,
        force: &mut [f64],
    ) -> Result<(), Self::Error>;
}

/// A [`ContactSystem`] whose coordinates add, from a closure `f(t, (q, v), u, mass, force)`.
///
/// ```
/// use std::convert::Infallible;
/// use integrators::event::Masses;
///
/// // A body of 2 kg that falls.
/// let body = Masses::new(1, |_t, (_q, _v), _u: &(), mass, force| {
///     mass[(0, 0)] = 2.0;
///     force[0] = -2.0 * 9.81;
///     Ok::<(), Infallible>(())
/// });
/// # let _ = body;
/// ```
pub struct Masses<F, U, E> {
    positions: Flat,
    mass_and_force: F,
    signature: PhantomData<fn(&U) -> E>,
}

impl<F, U, E> Masses<F, U, E>
where
    F: Fn(f64, (&[f64], &[f64]), &U, &mut DMatrix<f64>, &mut [f64]) -> Result<(), E> + Sync,
{
    /// Of `coordinates` coordinates. The closure writes every entry of M that is not 0, and every entry of f.
    pub fn new(coordinates: usize, mass_and_force: F) -> Self {
        Masses {
            positions: Flat::new(coordinates),
            mass_and_force,
            signature: PhantomData,
        }
    }
}

impl<F, U, E> fmt::Debug for Masses<F, U, E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Masses")
            .field("positions", &self.positions)
            .finish()
    }
}

impl<F, U, E> ContactSystem for Masses<F, U, E>
where
    F: Fn(f64, (&[f64], &[f64]), &U, &mut DMatrix<f64>, &mut [f64]) -> Result<(), E> + Sync,
    U: Sync,
    E: Send,
{
    type Positions = Flat;
    type Input = U;
    type Memory = ();
    type Error = E;

    fn positions(&self) -> &Flat {
        &self.positions
    }

    fn memory(&self) {}

    fn mass_and_force(
        &self,
        t: f64,
        state: (&[f64], &[f64]),
        u: &U,
        (): &mut (),
        mass: &mut DMatrix<f64>,
        force: &mut [f64],
    ) -> Result<(), E> {
        mass.fill(0.0);
        (self.mass_and_force)(t, state, u, mass, force)
    }
}
