use super::chart::Chart;
use super::{Method, StepError};
use crate::{Space, System};

/// Heun's method of order 2, the explicit trapezoidal rule:
///
/// - k₁ = f(t, x_k)
/// - k₂ = f(t + h, x_k + h k₁)
/// - x_{k+1} = x_k + h/2 (k₁ + k₂)
///
/// ```
/// use std::convert::Infallible;
/// use integrators::{Heun, Method, Ode, System};
///
/// let decay = Ode::new(1, |_t, x: &[f64], _u: &(), dx: &mut [f64]| {
///     dx[0] = -x[0];
///     Ok::<(), Infallible>(())
/// });
/// let mut x = [1.0];
/// Heun::default().step(&decay, 0.0, 0.1, &(), &mut decay.memory(), &mut x)?;
/// // One step multiplies by 1 − h + h²/2.
/// assert!((x[0] - 0.905).abs() < 1e-15);
/// # Ok::<(), integrators::StepError<Infallible>>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Heun {
    first: Vec<f64>,
    second: Vec<f64>,
    point: Vec<f64>,
    chart: Chart,
}

impl Heun {
    fn flat<E>(
        (first, second, point): (&mut Vec<f64>, &mut Vec<f64>, &mut Vec<f64>),
        (t, h): (f64, f64),
        x: &mut [f64],
        mut f: impl FnMut(f64, &[f64], &mut [f64]) -> Result<(), E>,
    ) -> Result<(), E> {
        for buffer in [&mut *first, &mut *second, &mut *point] {
            buffer.resize(x.len(), 0.0);
        }
        f(t, x, first)?;
        for ((point, x), k) in point.iter_mut().zip(x.iter()).zip(first.iter()) {
            *point = x + h * k;
        }
        f(t + h, point, second)?;
        for ((x, a), b) in x.iter_mut().zip(first.iter()).zip(second.iter()) {
            *x += 0.5 * h * (a + b);
        }
        Ok(())
    }
}

impl<S: System> Method<S> for Heun {
    fn step(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>> {
        let slopes = (&mut self.first, &mut self.second, &mut self.point);
        let done = if system.space().is_flat() {
            Self::flat(slopes, (t, h), x, |t, x, dx| {
                system.rate(t, x, u, memory, dx)
            })
        } else {
            self.chart.step(system, u, memory, x, |xi, f| {
                Self::flat(slopes, (t, h), xi, f)
            })
        };
        done.map_err(StepError::RightHandSide)
    }
}
