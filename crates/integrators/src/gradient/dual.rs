//! Derivatives without writing any.

use nalgebra::SVector;
use num_dual::{Derivative, DualNum, DualSVec64};

use crate::{Differentiable, Flat, Gradient, Jacobian, System};

/// A right-hand side ẋ = f(t, x, u; p) that is written once for plain and for dual numbers.
pub trait DualRate: Sync {
    /// What f refuses.
    type Error: Send;

    /// Writes f(t, x, u; p), as long as x, to `dx`, every entry of it.
    ///
    /// # Errors
    /// Where f has no value.
    fn rate<D: DualNum<Primitive = f64> + Copy>(
        &self,
        t: f64,
        x: &[D],
        u: &[D],
        p: &[D],
        dx: &mut [D],
    ) -> Result<(), Self::Error>;
}

/// A [`Differentiable`] system in a flat space of a [`DualRate`], with inputs of NU numbers and constants p: derivatives by dual numbers.
///
/// They are exact. f is evaluated on duals ⌈(nx + nu + np)/4⌉ times for all of its derivatives, also by
/// [`pull_back`](Differentiable::pull_back): with many states or constants a derivative backwards by hand costs less.
///
/// Comparisons in f look at values alone, so that a branch is derived as it is taken.
///
/// ```
/// use integrators::gradient::{DualOde, DualRate};
/// use integrators::{Differentiable, Jacobian, System};
/// use num_dual::DualNum;
///
/// /// A pendulum with p = (g/l, damping) and a torque, x = (θ, θ̇).
/// struct Pendulum;
/// impl DualRate for Pendulum {
///     type Error = std::convert::Infallible;
///     fn rate<D: DualNum<Primitive = f64> + Copy>(
///         &self, _t: f64, x: &[D], u: &[D], p: &[D], dx: &mut [D],
///     ) -> Result<(), Self::Error> {
///         dx[0] = x[1];
///         dx[1] = -p[0] * x[0].sin() - p[1] * x[1] + u[0];
///         Ok(())
///     }
/// }
///
/// let pendulum = DualOde::<_, 1>::new(2, Pendulum, vec![9.81, 0.1]);
/// let (mut dx, mut by) = ([0.0; 2], Jacobian::zeros(&pendulum));
/// let Ok(()) = pendulum.linearize((0.0, &[0.0, 0.0], &[0.5]), &mut pendulum.memory(), &mut dx, &mut by);
/// assert_eq!(dx, [0.0, 0.5]);
/// assert_eq!(by.state.as_slice(), [0.0, -9.81, 1.0, -0.1]);
/// assert_eq!(by.input.as_slice(), [0.0, 1.0]);
/// ```
#[derive(Debug, Clone)]
pub struct DualOde<R, const NU: usize> {
    space: Flat,
    rate: R,
    parameters: Vec<f64>,
}

/// Directions of one evaluation.
const WIDTH: usize = 4;

type Number = DualSVec64<WIDTH>;

/// Numbers of one thread: x, u and p one after the other, and ẋ.
#[derive(Debug, Clone)]
pub struct DualMemory {
    arguments: Vec<Number>,
    rate: Vec<Number>,
}

impl<R: DualRate, const NU: usize> DualOde<R, NU> {
    /// For states of `dim` entries, at the constants `parameters`.
    pub fn new(dim: usize, rate: R, parameters: Vec<f64>) -> Self {
        DualOde {
            space: Flat::new(dim),
            rate,
            parameters,
        }
    }

    /// p.
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// p, to be changed.
    pub fn parameters_mut(&mut self) -> &mut [f64] {
        &mut self.parameters
    }

    fn dim(&self) -> usize {
        crate::Space::dim(&self.space)
    }

    /// f in blocks of directions: `use_block(number of the first direction, ẋ)`.
    fn in_blocks(
        &self,
        (t, x, u): (f64, &[f64], &[f64; NU]),
        memory: &mut DualMemory,
        mut use_block: impl FnMut(usize, &[Number]),
    ) -> Result<(), R::Error> {
        let DualMemory { arguments, rate } = memory;
        let values = x.iter().chain(u).chain(&self.parameters);
        for (argument, value) in arguments.iter_mut().zip(values) {
            *argument = Number::from_re(*value);
        }
        let count = arguments.len();
        // Once at least, for f itself.
        for first in (0..count.max(1)).step_by(WIDTH) {
            let block = first..(first + WIDTH).min(count);
            for (i, argument) in arguments[block.clone()].iter_mut().enumerate() {
                argument.eps = Derivative::some(SVector::ith(i, 1.0));
            }
            let (x, rest) = arguments.split_at(self.dim());
            let (u, p) = rest.split_at(NU);
            self.rate.rate(t, x, u, p, rate)?;
            use_block(first, rate);
            for argument in &mut arguments[block] {
                argument.eps = Derivative::none();
            }
        }
        Ok(())
    }
}

impl<R: DualRate, const NU: usize> System for DualOde<R, NU> {
    type Space = Flat;
    type Input = [f64; NU];
    type Memory = DualMemory;
    type Error = R::Error;

    fn space(&self) -> &Flat {
        &self.space
    }

    fn memory(&self) -> DualMemory {
        let zero = Number::from_re(0.0);
        DualMemory {
            arguments: vec![zero; self.dim() + NU + self.parameters.len()],
            rate: vec![zero; self.dim()],
        }
    }

    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &[f64; NU],
        _memory: &mut DualMemory,
        dx: &mut [f64],
    ) -> Result<(), R::Error> {
        self.rate.rate(t, x, u, &self.parameters, dx)
    }
}

impl<R: DualRate, const NU: usize> Differentiable for DualOde<R, NU> {
    fn input_count(&self) -> usize {
        NU
    }

    fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    fn linearize(
        &self,
        at: (f64, &[f64], &[f64; NU]),
        memory: &mut DualMemory,
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), R::Error> {
        let dim = self.dim();
        self.in_blocks(at, memory, |first, rate| {
            for (row, (dx, rate)) in dx.iter_mut().zip(rate).enumerate() {
                *dx = rate.re;
                for i in 0..WIDTH {
                    let slope = slope(rate, i);
                    match first + i {
                        j if j < dim => by.state[(row, j)] = slope,
                        j if j < dim + NU => by.input[(row, j - dim)] = slope,
                        j if j < dim + NU + by.parameters.ncols() => {
                            by.parameters[(row, j - dim - NU)] = slope;
                        }
                        _ => {}
                    }
                }
            }
        })
    }

    fn pull_back(
        &self,
        at: (f64, &[f64], &[f64; NU]),
        memory: &mut DualMemory,
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), R::Error> {
        let Gradient {
            state,
            input,
            parameters,
        } = by;
        self.in_blocks(at, memory, |first, rate| {
            for (dx, rate) in dx.iter_mut().zip(rate) {
                *dx = rate.re;
            }
            let sums = state.iter_mut().chain(&mut *input).chain(&mut *parameters);
            for (i, sum) in sums.skip(first).take(WIDTH).enumerate() {
                for (weight, rate) in weight.iter().zip(rate) {
                    *sum += weight * slope(rate, i);
                }
            }
        })
    }
}

/// The derivative along direction i of the block.
fn slope(number: &Number, i: usize) -> f64 {
    number.eps.0.as_ref().map_or(0.0, |eps| eps[i])
}
