//! Methods whose steps are derived here.

use crate::{Heun, Method, Rk4, StepError, System};

/// An explicit method of Runge and Kutta whose stages are a chain: kᵢ = f(t + aᵢ h, x + aᵢ h kᵢ₋₁) with a₁ = 0, and
/// x_{k+1} = x + h Σ bᵢ kᵢ.
///
/// [`Rk4`] and [`Heun`] are; nothing else can be.
pub trait Explicit: Clone + Send + Sync + private::Sealed {
    /// aᵢ.
    const LINKS: &'static [f64];
    /// bᵢ.
    const WEIGHTS: &'static [f64];

    /// [`Method::step`].
    ///
    /// # Errors
    /// As that.
    fn step<S: System>(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>>;
}

mod private {
    pub trait Sealed {}
    impl Sealed for crate::Rk4<f64> {}
    impl Sealed for crate::Heun {}
}

impl Explicit for Rk4<f64> {
    const LINKS: &'static [f64] = &[0.0, 0.5, 0.5, 1.0];
    const WEIGHTS: &'static [f64] = &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0];

    fn step<S: System>(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>> {
        Method::step(self, system, t, h, u, memory, x)
    }
}

impl Explicit for Heun {
    const LINKS: &'static [f64] = &[0.0, 1.0];
    const WEIGHTS: &'static [f64] = &[0.5, 0.5];

    fn step<S: System>(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>> {
        Method::step(self, system, t, h, u, memory, x)
    }
}
