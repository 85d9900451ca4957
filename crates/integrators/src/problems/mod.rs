//! Initial-value problems with known solutions, for the tests of every integrator.

mod harmonic_oscillator;
mod kepler;
mod linear_decay;
mod pendulum;

pub use harmonic_oscillator::HarmonicOscillator;
pub use kepler::Kepler;
pub use linear_decay::LinearDecay;
pub use pendulum::Pendulum;

/// An initial-value problem ẋ = f(t, x), x(0) given, with its solution.
///
/// ```
/// use integrators::problems::{Problem, LinearDecay};
///
/// let problem = LinearDecay { rate: 2.0, start: 3.0 };
/// assert_eq!(problem.solution(0.0), problem.initial());
/// ```
pub trait Problem {
    /// What it is called in the output of a test.
    fn name(&self) -> &'static str;
    /// x(0).
    fn initial(&self) -> Vec<f64>;
    /// Writes f(t, x) to `dx`.
    fn rate(&self, t: f64, x: &[f64], dx: &mut [f64]);
    /// Writes ∂f/∂x at (t, x) to `jacobian`, row by row: entry (i, j) stands at i · dim + j.
    fn jacobian(&self, t: f64, x: &[f64], jacobian: &mut [f64]);
    /// x(t), exact but for rounding.
    fn solution(&self, t: f64) -> Vec<f64>;
    /// A time span on which the solution does something, s.
    fn span(&self) -> f64;
}
