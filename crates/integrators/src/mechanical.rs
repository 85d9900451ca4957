//! Systems of second order.

use crate::{Space, System};

/// A mechanical [`System`] with the Lagrangian L = T − V: states x = (q, v) in a [`PhaseSpace`](crate::PhaseSpace), ẋ = (v, v̇).
///
/// With the momenta p = ∂L/∂v = M v it is d/dt p = ad_vᵀ p + ∂L/∂q + Q. The derivative in q is along the directions of motion; the
/// first term, of Euler and Poincaré, is there only where positions turn.
pub trait Mechanical: System {
    /// Where the positions live.
    type Positions: Space;

    /// Where q lives.
    fn positions(&self) -> &Self::Positions;

    /// Writes v̇ to `out`.
    ///
    /// # Errors
    /// Where there is no acceleration.
    fn acceleration(
        &self,
        t: f64,
        state: (&[f64], &[f64]),
        u: &Self::Input,
        memory: &mut Self::Memory,
        out: &mut [f64],
    ) -> Result<(), Self::Error>;

    /// Writes p = ∂L/∂v to `out`.
    ///
    /// # Errors
    /// Where it has no value.
    fn momentum(
        &self,
        state: (&[f64], &[f64]),
        memory: &mut Self::Memory,
        out: &mut [f64],
    ) -> Result<(), Self::Error>;

    /// Replaces p in `out` by the velocity M(q)⁻¹ p.
    ///
    /// # Errors
    /// Where M has no inverse.
    fn velocity(
        &self,
        q: &[f64],
        memory: &mut Self::Memory,
        out: &mut [f64],
    ) -> Result<(), Self::Error>;

    /// Writes ∂L/∂q + Q to `out`.
    ///
    /// # Errors
    /// Where it has no value.
    fn position_force(
        &self,
        t: f64,
        state: (&[f64], &[f64]),
        u: &Self::Input,
        memory: &mut Self::Memory,
        out: &mut [f64],
    ) -> Result<(), Self::Error>;

    /// Why L is not T(v) − V(q) with forces that do not depend on v, as explicit symplectic methods need it; `None` where it is.
    fn not_separable(&self) -> Option<String>;
}
