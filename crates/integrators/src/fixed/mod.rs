//! Methods of fixed step.
//!
//! | method | order | what for |
//! |---|---|---|
//! | [`Rk4`] | 4 | the default |
//! | [`Heun`] | 2 | cheap steps, rough forces |
//! | [`SymplecticEuler`] | 1 | separable systems: energy stays near its value for ever |
//! | [`StormerVerlet`] | 2 | separable systems, the same with order 2, and the same backwards in time |
//! | [`Variational`] | 2, 4 | any M(q), any space: symplectic, energy stays near its value for ever |
//!
//! All step in any [`Space`](crate::Space): explicit methods of Runge and Kutta in the chart exp of the place where a step begins
//! (Munthe-Kaas, "High order Runge-Kutta methods on manifolds", 1999), the others as their formulas say.

mod broyden;
mod chart;
mod heun;
mod method;
mod rk4;
mod roll_out;
mod separable;
mod variational;

pub use heun::Heun;
pub use method::{Method, StepError};
pub use rk4::Rk4;
pub use roll_out::{RollOutError, roll_out};
pub use separable::{NotSeparable, StormerVerlet, SymplecticEuler};
pub use variational::{Order, Variational};
