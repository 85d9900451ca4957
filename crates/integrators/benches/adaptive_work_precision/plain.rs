//! Problems written as two closures.

use std::convert::Infallible;

use integrators::{Differentiable, Flat, Gradient, Jacobian, System};

/// ẋ = f(x) with its Jacobian, as closures.
pub(crate) struct Plain<F, J> {
    space: Flat,
    rate: F,
    jacobian: J,
}

pub(crate) fn plain<F, J>(dim: usize, rate: F, jacobian: J) -> Plain<F, J>
where
    F: Fn(f64, &[f64], &mut [f64]) + Sync,
    J: Fn(f64, &[f64], &mut dyn FnMut(usize, usize, f64)) + Sync,
{
    Plain {
        space: Flat::new(dim),
        rate,
        jacobian,
    }
}

impl<F, J> System for Plain<F, J>
where
    F: Fn(f64, &[f64], &mut [f64]) + Sync,
    J: Fn(f64, &[f64], &mut dyn FnMut(usize, usize, f64)) + Sync,
{
    type Space = Flat;
    type Input = ();
    type Memory = ();
    type Error = Infallible;
    fn space(&self) -> &Flat {
        &self.space
    }
    fn memory(&self) {}
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        _u: &(),
        _m: &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        (self.rate)(t, x, dx);
        Ok(())
    }
}

impl<F, J> Differentiable for Plain<F, J>
where
    F: Fn(f64, &[f64], &mut [f64]) + Sync,
    J: Fn(f64, &[f64], &mut dyn FnMut(usize, usize, f64)) + Sync,
{
    fn input_count(&self) -> usize {
        0
    }
    fn parameter_count(&self) -> usize {
        0
    }
    fn linearize(
        &self,
        (t, x, _u): (f64, &[f64], &()),
        _m: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        (self.rate)(t, x, dx);
        by.state.fill(0.0);
        (self.jacobian)(t, x, &mut |i, j, value| by.state[(i, j)] = value);
        Ok(())
    }
    fn pull_back(
        &self,
        (t, x, _u): (f64, &[f64], &()),
        _m: &mut (),
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Infallible> {
        (self.rate)(t, x, dx);
        (self.jacobian)(t, x, &mut |i, j, value| by.state[j] += weight[i] * value);
        Ok(())
    }
}
