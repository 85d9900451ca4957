//! Mechanisms as systems that `integrators` rolls out.
//!
//! A state is x = (q, v), its rate ẋ = (v, v̇) with v̇ from M v̇ + C v + G = Q; the directions of motion are (δq, δv), 2 nv of them.
//! Poses of floating bodies turn in their own space ([`Positions`]): no method leaves the unit quaternions. Both systems below have
//! exact derivatives, so that [`integrators::gradient`] derives their roll-outs and the implicit methods of `integrators::adaptive` step
//! them, and rates of eight states at once for [`integrators::ensemble`].
//!
//! | system | input | what for |
//! |---|---|---|
//! | [`Motion`] | Q, held over a step | any mechanism, under constraints too |
//! | [`FreeMotion`] | Q | mechanisms that have momenta: symplectic and variational methods |
//!
//! ```
//! use integrators::{Order, Rk4, Variational, roll_out};
//! use lagrange::{Dynamics, Lagrangian, Mechanics, Scalar};
//! use pinode_nn::motion::Motion;
//!
//! /// 1 kg on a rod of 1 m.
//! struct Pendulum;
//! impl Lagrangian for Pendulum {
//!     fn dof(&self) -> usize { 1 }
//!     fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D { v[0] * v[0] * 0.5 }
//!     fn potential<D: Scalar>(&self, q: &[D]) -> D { q[0].cos() * -9.81 }
//! }
//! let pendulum = Dynamics::of(Pendulum);
//! let motion = Motion::new(&pendulum);
//! let times: Vec<f64> = (0..=10).map(|k| 0.1 * f64::from(k)).collect();
//! let no_force = vec![vec![0.0]; 10];
//! let by_rk4 = roll_out(&motion, Rk4::default(), &times, &no_force, 100, &[0.5, 0.0])?;
//!
//! let free = motion.free()?;
//! let method = Variational::new(&free, Order::Four);
//! let variational = roll_out(&free, method, &times, &no_force, 100, &[0.5, 0.0])?;
//! assert!((by_rk4[10][0] - variational[10][0]).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
mod free;
mod lanes;
mod momenta;
mod positions;

use std::fmt;
use std::ops::Deref;

use integrators::{Differentiable, Gradient, Jacobian, PhaseSpace, Space, System};
use lagrange::{Error, ForwardDynamicsDerivatives, ForwardDynamicsGradient, Mechanics, Workspace};
use nalgebra::DVector;

pub use free::{FreeMotion, NotFree};
pub(crate) use free::{check_free, not_separable};
pub(crate) use momenta::Momenta;
pub use positions::Positions;

/// The motion of a mechanism under a generalized force Q that is held over each step: the input, nv entries in N or N·m.
///
/// `M` points to the mechanism: `&Dynamics<L>`, `Arc<dyn Mechanics>`, …. Under constraints v̇ is the stabilised acceleration of
/// [`lagrange::constraint`]. Derivatives are in the state, in Q, and in those constants of the mechanism that
/// [`with_parameters`](Self::with_parameters) names. Those in the state are of the entries of (v, v̇), as [`Differentiable`] has it: that
/// a displacement δq of a floating body is seen in axes that turn, δq̇ = δv − ad_v δq, is a matter of the space, and in
/// [`Mechanics::linearize`] but not here.
#[derive(Clone)]
pub struct Motion<M> {
    mechanics: M,
    space: PhaseSpace<Positions>,
    constants: Vec<f64>,
    parameters: Vec<usize>,
}

impl<M> fmt::Debug for Motion<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Motion")
            .field("space", &self.space)
            .field("constants", &self.constants)
            .field("parameters", &self.parameters)
            .finish_non_exhaustive()
    }
}

/// A constant was asked for by an index that there is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "there is no constant {index}: the mechanism has {count}, counted from 0 as in `Mechanics::parameters`"
)]
pub struct NoSuchConstant {
    /// The index.
    pub index: usize,
    /// How many there are.
    pub count: usize,
}

impl<M: Deref<Target: Mechanics> + Send + Sync> Motion<M> {
    /// With the nominal constants, and derivatives in none of them.
    pub fn new(mechanics: M) -> Self {
        Motion {
            space: PhaseSpace {
                positions: Positions::new(mechanics.coordinates()),
            },
            constants: mechanics.nominal(),
            parameters: Vec::new(),
            mechanics,
        }
    }

    /// With other values of the constants ([`Mechanics::parameters`]).
    ///
    /// # Errors
    /// [`Error::Dimension`] or [`Error::NotFinite`].
    pub fn with_constants(mut self, constants: Vec<f64>) -> Result<Self, Error> {
        let (found, expected) = (constants.len(), self.constants.len());
        if found != expected {
            return Err(Error::Dimension {
                what: "constants",
                found,
                expected,
            });
        }
        if let Some(index) = constants.iter().position(|x| !x.is_finite()) {
            return Err(Error::NotFinite {
                what: "constants",
                index,
                value: constants[index],
            });
        }
        self.constants = constants;
        Ok(self)
    }

    /// With derivatives in the constants of these indices, in this order.
    ///
    /// # Errors
    /// [`NoSuchConstant`].
    pub fn with_parameters(mut self, parameters: Vec<usize>) -> Result<Self, NoSuchConstant> {
        let count = self.constants.len();
        if let Some(&index) = parameters.iter().find(|&&index| index >= count) {
            return Err(NoSuchConstant { index, count });
        }
        self.parameters = parameters;
        Ok(self)
    }

    /// The mechanism.
    pub fn mechanics(&self) -> &M::Target {
        &self.mechanics
    }

    /// The values of its constants.
    pub fn constants(&self) -> &[f64] {
        &self.constants
    }

    /// The constants that derivatives are taken in.
    pub fn parameters(&self) -> &[usize] {
        &self.parameters
    }

    fn nv(&self) -> usize {
        self.space.positions.tangent_dim()
    }

    fn check_force(&self, force: &[f64]) -> Result<(), Error> {
        let (found, expected) = (force.len(), self.nv());
        if found == expected {
            return Ok(());
        }
        Err(Error::Dimension {
            what: "the generalized force Q",
            found,
            expected,
        })
    }

    /// v̇ into `out`.
    fn accelerate(
        &self,
        (q, v): (&[f64], &[f64]),
        force: &[f64],
        memory: &mut Memory,
        out: &mut [f64],
    ) -> Result<(), Error> {
        self.check_force(force)?;
        let Memory { work, vector, .. } = memory;
        vector.copy_from_slice(force);
        self.mechanics
            .forward_dynamics_into(q, v, &self.constants, work, vector)?;
        out.copy_from_slice(vector.as_slice());
        Ok(())
    }
}

/// Memory of one thread.
#[derive(Debug, Clone)]
pub struct Memory {
    work: Workspace,
    vector: DVector<f64>,
    derivatives: ForwardDynamicsDerivatives,
    gradient: ForwardDynamicsGradient,
    momenta: Momenta,
}

impl<M: Deref<Target: Mechanics> + Send + Sync> System for Motion<M> {
    type Space = PhaseSpace<Positions>;
    type Input = Vec<f64>;
    type Memory = Memory;
    type Error = Error;

    fn space(&self) -> &Self::Space {
        &self.space
    }

    fn memory(&self) -> Memory {
        let nv = self.nv();
        Memory {
            work: self.mechanics.workspace(),
            vector: DVector::zeros(nv),
            derivatives: ForwardDynamicsDerivatives::zeros(nv, self.parameters.len()),
            gradient: ForwardDynamicsGradient::zeros(nv, self.constants.len()),
            momenta: Momenta::new(nv),
        }
    }

    /// (v, v̇).
    fn rate(
        &self,
        _t: f64,
        x: &[f64],
        u: &Vec<f64>,
        memory: &mut Memory,
        dx: &mut [f64],
    ) -> Result<(), Error> {
        let (q, v) = x.split_at(self.space.positions.dim());
        let (dq, dv) = dx.split_at_mut(v.len());
        dq.copy_from_slice(v);
        self.accelerate((q, v), u, memory, dv)
    }
}

impl<M: Deref<Target: Mechanics> + Send + Sync> Differentiable for Motion<M> {
    /// The entries of Q.
    fn input_count(&self) -> usize {
        self.nv()
    }

    fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    fn linearize(
        &self,
        (_, x, u): (f64, &[f64], &Vec<f64>),
        memory: &mut Memory,
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Error> {
        self.check_force(u)?;
        let (q, v) = x.split_at(self.space.positions.dim());
        let n = v.len();
        let Memory {
            work, derivatives, ..
        } = memory;
        self.mechanics.forward_dynamics_derivatives_into(
            q,
            v,
            u,
            &self.constants,
            &self.parameters,
            work,
            derivatives,
        )?;
        dx[..n].copy_from_slice(v);
        dx[n..].copy_from_slice(derivatives.acceleration.as_slice());
        by.state.rows_mut(0, n).fill(0.0);
        by.state.view_mut((0, n), (n, n)).fill_with_identity();
        by.state
            .view_mut((n, 0), (n, n))
            .copy_from(&derivatives.by_q);
        by.state
            .view_mut((n, n), (n, n))
            .copy_from(&derivatives.by_v);
        by.input.rows_mut(0, n).fill(0.0);
        by.input.rows_mut(n, n).copy_from(&derivatives.by_force);
        by.parameters.rows_mut(0, n).fill(0.0);
        by.parameters.rows_mut(n, n).copy_from(&derivatives.by_p);
        Ok(())
    }

    fn pull_back(
        &self,
        (_, x, u): (f64, &[f64], &Vec<f64>),
        memory: &mut Memory,
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Error> {
        self.check_force(u)?;
        let (q, v) = x.split_at(self.space.positions.dim());
        let n = v.len();
        let (of_q, of_v) = weight.split_at(n);
        let Memory { work, gradient, .. } = memory;
        self.mechanics.forward_dynamics_gradient_into(
            q,
            v,
            u,
            &self.constants,
            of_v,
            work,
            gradient,
        )?;
        dx[..n].copy_from_slice(v);
        dx[n..].copy_from_slice(gradient.acceleration.as_slice());
        let (by_q, by_v) = by.state.split_at_mut(n);
        add(by_q, gradient.by_q.as_slice());
        add(by_v, of_q);
        add(by_v, gradient.by_v.as_slice());
        add(&mut by.input, gradient.by_force.as_slice());
        for (to, &constant) in by.parameters.iter_mut().zip(&self.parameters) {
            *to += gradient.by_p[constant];
        }
        Ok(())
    }
}

/// to += from.
fn add(to: &mut [f64], from: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from;
    }
}
