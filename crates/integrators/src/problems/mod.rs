//! Initial-value problems with known solutions, for the tests of every integrator.
//!
//! | problem | kind | solution |
//! |---|---|---|
//! | [`LinearDecay`] | one number | exponential |
//! | [`HarmonicOscillator`] | mechanical, separable | circular functions |
//! | [`DrivenOscillator`] | mechanical, with loss and a force that depends on time | circular functions |
//! | [`Pendulum`] | mechanical, separable | Jacobi's elliptic functions, period by the elliptic integral |
//! | [`Kepler`] | mechanical, separable | Kepler's equation |
//! | [`DoublePendulum`] | mechanical, M(q) | at one time, to 16 digits |
//! | [`RigidBody`] | mechanical, on quaternions, free | Jacobi's functions and one quadrature |
//! | [`HeavyTop`] | mechanical, on quaternions, with weight | at one time, to 16 digits |
//! | [`Robertson`] | stiff | at several times, to 11 digits or more |
//! | [`VanDerPol`] | stiff | at one time for ε = 10⁻⁶, to 15 digits |
//! | [`StickSlip`] | dry friction, for [`event`](crate::event) | arcs of circles and straight lines |
//!
//! All but the last have their derivatives ([`Differentiable`]); those that are [`Mechanical`] also have an energy to be
//! kept ([`Conservative`]).

mod double_pendulum;
mod driven_oscillator;
mod elliptic;
mod formula;
mod harmonic_oscillator;
mod heavy_top;
mod kepler;
mod linear_decay;
mod pendulum;
mod rigid_body;
mod robertson;
mod stick_slip;
mod van_der_pol;

use std::convert::Infallible;

pub use double_pendulum::DoublePendulum;
pub use driven_oscillator::DrivenOscillator;
pub use harmonic_oscillator::HarmonicOscillator;
pub use heavy_top::HeavyTop;
pub use kepler::Kepler;
pub use linear_decay::LinearDecay;
pub use pendulum::Pendulum;
pub use rigid_body::RigidBody;
pub use robertson::Robertson;
pub use stick_slip::StickSlip;
pub use van_der_pol::VanDerPol;

use crate::{Differentiable, Mechanical, System};

/// An initial-value problem ẋ = f(t, x), x(0) given, with its solution.
///
/// ```
/// use integrators::problems::{LinearDecay, Problem};
/// use integrators::{Rk4, roll_out};
///
/// fn error_at_the_end<P: Problem>(problem: &P) -> f64 {
///     let times = [0.0, problem.span()];
///     let rolled = roll_out(problem, Rk4::default(), &times, &[()], 100, &problem.initial()).unwrap();
///     let exact = problem.solution(times[1]).unwrap();
///     rolled[1].iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
/// }
///
/// assert!(error_at_the_end(&LinearDecay { rate: 2.0, start: 3.0 }) < 1e-8);
/// ```
pub trait Problem: System<Input = (), Memory = (), Error = Infallible> + Differentiable {
    /// What it is called in the output of a test.
    fn name(&self) -> &'static str;

    /// x(0).
    fn initial(&self) -> Vec<f64>;

    /// A time, s, at which the solution is known and nothing is special, so that errors do not cancel as they may after a whole period.
    fn span(&self) -> f64;

    /// x(t), exact but for rounding; `None` where it is not known. Problems with a formula know it at every t, the others at the times
    /// in their documentation, among them 0 and [`span`](Self::span).
    fn solution(&self, t: f64) -> Option<Vec<f64>>;
}

/// A mechanical [`Problem`] without loss.
pub trait Conservative: Problem + Mechanical {
    /// T + V at x = (q, v), J or in the units of the problem.
    fn energy(&self, x: &[f64]) -> f64;
}
