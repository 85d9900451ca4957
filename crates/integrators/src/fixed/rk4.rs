//! The classical Runge-Kutta method.

use super::chart::Chart;
use super::{Method, StepError};
use crate::{Real, Space, System};

/// The classical Runge-Kutta method of order 4 for ẋ = f(t, x), with its working memory.
///
/// One step of length h from x_k at t:
///
/// - k₁ = f(t, x_k)
/// - k₂ = f(t + h/2, x_k + h/2 k₁)
/// - k₃ = f(t + h/2, x_k + h/2 k₂)
/// - k₄ = f(t + h, x_k + h k₃)
/// - x_{k+1} = x_k + h/6 (k₁ + 2 k₂ + 2 k₃ + k₄)
///
/// An input is held over the step when the closure holds it:
///
/// ```
/// use std::convert::Infallible;
/// use integrators::Rk4;
///
/// // A cart of 2 kg, x = [position (m), velocity (m/s)], pushed by 1 N in the first step and by −1 N in the second.
/// let mut rk4 = Rk4::new(2);
/// let mut x = [0.0, 0.0];
/// let h = 0.5;
/// for (k, force) in [1.0, -1.0].into_iter().enumerate() {
///     let Ok(()) = rk4.step(k as f64 * h, h, &mut x, |_t, x, dx| {
///         dx[0] = x[1];
///         dx[1] = force / 2.0;
///         Ok::<(), Infallible>(())
///     });
/// }
/// assert!((x[0] - 0.125).abs() < 1e-15);
/// assert!(x[1].abs() < 1e-15);
/// ```
///
/// On dual numbers the same step carries the exact derivative of the discrete map x_k ↦ x_{k+1}:
///
/// ```
/// use std::convert::Infallible;
/// use integrators::Rk4;
/// use num_dual::Dual64;
///
/// let mut x = [Dual64::new(1.0, 1.0)];
/// let Ok(()) = Rk4::new(1).step(0.0, 0.1, &mut x, |_t, x, dx| {
///     dx[0] = -x[0];
///     Ok::<(), Infallible>(())
/// });
/// // ẋ = −x: one step multiplies by 1 − h + h²/2 − h³/6 + h⁴/24.
/// assert!((x[0].eps - 0.9048375).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Rk4<S> {
    slope: Vec<S>,
    sum: Vec<S>,
    point: Vec<S>,
    chart: Chart,
}

impl<S: Real> Rk4<S> {
    /// Working memory for states of `dim` entries.
    pub fn new(dim: usize) -> Self {
        Rk4 {
            slope: vec![S::zero(); dim],
            sum: vec![S::zero(); dim],
            point: vec![S::zero(); dim],
            chart: Chart::default(),
        }
    }

    /// Replaces x(t) by x(t + h); `f(t, x, dx)` writes the derivative of x to `dx`.
    ///
    /// Allocates nothing as long as `x` has the length given to [`new`](Self::new). `dx` holds old numbers on entry: `f` writes
    /// every entry. No finiteness is checked here.
    ///
    /// # Errors
    /// The first error of `f`; `x` is then as it was. A closure that cannot fail returns `Ok::<(), Infallible>(())`, and the
    /// result is taken by `let Ok(()) = …;`.
    pub fn step<E>(
        &mut self,
        t: f64,
        h: f64,
        x: &mut [S],
        mut f: impl FnMut(f64, &[S], &mut [S]) -> Result<(), E>,
    ) -> Result<(), E> {
        for buffer in [&mut self.slope, &mut self.sum, &mut self.point] {
            buffer.resize(x.len(), S::zero());
        }
        let (k, sum, point) = (&mut self.slope, &mut self.sum, &mut self.point);
        f(t, x, sum)?; // k₁
        advance(point, x, h / 2.0, sum);
        f(t + h / 2.0, point, k)?; // k₂
        add(sum, 2.0, k);
        advance(point, x, h / 2.0, k);
        f(t + h / 2.0, point, k)?; // k₃
        add(sum, 2.0, k);
        advance(point, x, h, k);
        f(t + h, point, k)?; // k₄
        add(sum, 1.0, k);
        add(x, h / 6.0, sum);
        Ok(())
    }
}

/// point = x + h k.
fn advance<S: Real>(point: &mut [S], x: &[S], h: f64, k: &[S]) {
    for ((p, &x), &k) in point.iter_mut().zip(x).zip(k) {
        *p = x + k * h;
    }
}

/// y += factor k.
fn add<S: Real>(y: &mut [S], factor: f64, k: &[S]) {
    for (y, &k) in y.iter_mut().zip(k) {
        *y = *y + k * factor;
    }
}

impl Rk4<f64> {
    /// A step of a system in any space.
    pub(crate) fn step_in_space<S: System>(
        &mut self,
        system: &S,
        (t, h): (f64, f64),
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), S::Error> {
        if system.space().is_flat() {
            return self.step(t, h, x, |t, x, dx| system.rate(t, x, u, memory, dx));
        }
        let mut chart = std::mem::take(&mut self.chart);
        let done = chart.step(system, u, memory, x, |xi, f| self.step(t, h, xi, f));
        self.chart = chart;
        done
    }
}

impl<S: System> Method<S> for Rk4<f64> {
    fn step(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>> {
        self.step_in_space(system, (t, h), u, memory, x)
            .map_err(StepError::RightHandSide)
    }
}
