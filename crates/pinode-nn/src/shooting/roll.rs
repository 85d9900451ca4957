//! Roll-outs of the hybrid model over a window of a recording, with exact sensitivities.

use integrators::{Flat, Method, Rk4, StepError, System};

use super::eight::{EightRoller, Member};
use crate::hybrid::{DrivenInputs, Hybrid, HybridMotion, Memory};

/// Why a roll-out ended before its last sample.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Diverged {
    /// The state left the range of any mechanism, or the finite numbers.
    #[error("the state leaves the range of any mechanism")]
    OutOfRange,
    /// What the dynamics refused.
    #[error("{0}")]
    Dynamics(lagrange::Error),
    /// The equations of an implicit step were not solved.
    #[error(
        "the equations of a step were not solved in {iterations} iterations (last change of the velocity: {change:e} of its size)"
    )]
    NoConvergence {
        /// Iterations made.
        iterations: usize,
        /// The last change, relative to the velocity.
        change: f64,
    },
}

impl Diverged {
    /// A state beyond any mechanism's, or not a number, ends the roll-out.
    pub(crate) fn check(state: &[f64]) -> Result<(), Diverged> {
        if state.iter().all(|x| x.abs() < 1e12) {
            Ok(())
        } else {
            Err(Diverged::OutOfRange)
        }
    }
}

impl From<StepError<Diverged>> for Diverged {
    fn from(error: StepError<Diverged>) -> Self {
        match error {
            StepError::RightHandSide(cause) => cause,
            StepError::NoConvergence { iterations, change } => {
                Diverged::NoConvergence { iterations, change }
            }
            _ => Diverged::OutOfRange,
        }
    }
}

/// States at the samples of a window, and their sensitivities when asked for.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// State (q, v, h) after state: sample k at `k * nx ..`, nx = nq + nv + nh.
    pub states: Vec<f64>,
    /// ∂(q, v, h)_k/∂(initial state, θ_free): sample k at `k * nx * columns ..`, column after column.
    pub sensitivities: Vec<f64>,
}

/// Rolls out windows on one thread.
///
/// With sensitivities the state x = (q, v, h) is integrated together with S = ∂x/∂(x₀, θ_free), Ṡ = (∂f/∂x) S + ∂f/∂θ. The same
/// Runge-Kutta steps on both make S the exact derivative of the discrete roll-out.
pub struct Roller<'a> {
    pub(super) hybrid: &'a Hybrid,
    pub(super) free: &'a [usize],
    pub(super) memory: Memory,
    pub(super) rk4: Rk4<f64>,
    pub(super) state: Vec<f64>,
    /// What rolls out a stiff model.
    pub(super) eight: Option<Box<EightRoller<'a>>>,
}

/// Steps `state` by `method` from sample `first` on over `count` samples, the one it is at included; after each of the others `keep`
/// sees it.
pub(crate) fn over_samples<S: System<Input = usize, Error = Diverged>>(
    system: &S,
    method: &mut impl Method<S>,
    memory: &mut S::Memory,
    inputs: &DrivenInputs,
    (first, count): (usize, usize),
    state: &mut [f64],
    mut keep: impl FnMut(&[f64]),
) -> Result<(), Diverged> {
    debug_assert!(
        first + count <= inputs.grid.samples(),
        "beyond the last sample"
    );
    for sample in first..first + count - 1 {
        for step in inputs.grid.steps_from(sample) {
            let (a, b) = (inputs.grid.bounds[step], inputs.grid.bounds[step + 1]);
            method.step(system, a, b - a, &step, memory, state)?;
        }
        Diverged::check(state)?;
        keep(state);
    }
    Ok(())
}

impl<'a> Roller<'a> {
    /// For the model with these free entries of θ.
    pub fn new(hybrid: &'a Hybrid, free: &'a [usize]) -> Self {
        Roller {
            hybrid,
            free,
            memory: hybrid.memory(free),
            rk4: Rk4::new(0),
            state: Vec::new(),
            eight: hybrid
                .is_stiff()
                .then(|| Box::new(EightRoller::new(hybrid, free))),
        }
    }

    /// Columns of the sensitivities: the initial state, then θ_free.
    pub fn columns(&self) -> usize {
        self.hybrid.directions() + self.free.len()
    }

    /// States at `count` samples from sample `first` on, starting at `initial`.
    pub fn roll(
        &mut self,
        theta: &[f64],
        inputs: &DrivenInputs,
        span: (usize, usize),
        initial: &[f64],
        out: &mut Trajectory,
    ) -> Result<(), Diverged> {
        if let Some(eight) = &mut self.eight {
            let member = Member {
                inputs,
                span,
                initial,
            };
            return eight.roll(theta, &[member], std::slice::from_mut(out));
        }
        let motion = HybridMotion::new(self.hybrid, theta, self.free, inputs);
        self.state.clear();
        self.state.extend_from_slice(initial);
        out.sensitivities.clear();
        out.states.clear();
        out.states.extend_from_slice(initial);
        over_samples(
            &motion,
            &mut self.rk4,
            &mut self.memory,
            inputs,
            span,
            &mut self.state,
            |state| out.states.extend_from_slice(state),
        )
    }

    /// As [`roll`](Self::roll), with the sensitivities in the initial state and θ_free. Not for poses, which diagnosis and evaluation
    /// refuse: their q and v differ in length.
    pub fn roll_with_sensitivities(
        &mut self,
        theta: &[f64],
        inputs: &DrivenInputs,
        span: (usize, usize),
        initial: &[f64],
        out: &mut Trajectory,
    ) -> Result<(), Diverged> {
        if let Some(eight) = &mut self.eight {
            let member = Member {
                inputs,
                span,
                initial,
            };
            return eight.roll_with_sensitivities(theta, &[member], std::slice::from_mut(out));
        }
        let nx = initial.len();
        let system = self.with_sensitivities(theta, inputs, initial);
        for i in 0..nx {
            self.state[nx + i * nx + i] = 1.0;
        }
        let Trajectory {
            states,
            sensitivities,
        } = out;
        states.clear();
        sensitivities.clear();
        let mut keep = |state: &[f64]| {
            states.extend_from_slice(&state[..nx]);
            sensitivities.extend_from_slice(&state[nx..]);
        };
        keep(&self.state);
        over_samples(
            &system,
            &mut self.rk4,
            &mut self.memory,
            inputs,
            span,
            &mut self.state,
            keep,
        )
    }
}

impl<'a> Roller<'a> {
    /// The system of (x, S); the state becomes (`initial`, 0).
    pub(super) fn with_sensitivities<'b>(
        &mut self,
        theta: &'b [f64],
        inputs: &'b DrivenInputs,
        initial: &[f64],
    ) -> WithSensitivities<'b>
    where
        'a: 'b,
    {
        let nx = initial.len();
        let size = nx + nx * self.columns();
        self.state.clear();
        self.state.extend_from_slice(initial);
        self.state.resize(size, 0.0);
        WithSensitivities {
            hybrid: self.hybrid,
            theta,
            free: self.free,
            inputs,
            space: Flat::new(size),
        }
    }
}

/// (x, S) with Ṡ = (∂f/∂x) S + ∂f/∂θ, for a flat space of x.
pub(super) struct WithSensitivities<'a> {
    hybrid: &'a Hybrid,
    theta: &'a [f64],
    free: &'a [usize],
    inputs: &'a DrivenInputs,
    space: Flat,
}

impl System for WithSensitivities<'_> {
    type Space = Flat;
    type Input = usize;
    type Memory = Memory;
    type Error = Diverged;

    fn space(&self) -> &Flat {
        &self.space
    }

    fn memory(&self) -> Memory {
        self.hybrid.memory(self.free)
    }

    fn rate(
        &self,
        _t: f64,
        x: &[f64],
        step: &usize,
        memory: &mut Memory,
        dx: &mut [f64],
    ) -> Result<(), Diverged> {
        let n = self.hybrid.nv();
        let nx = self.hybrid.nx();
        let state = self.hybrid.parts(&x[..nx]);
        self.hybrid
            .linearize(state, self.theta, self.free, self.inputs, *step, memory)
            .map_err(Diverged::Dynamics)?;
        dx[..n].copy_from_slice(state.v);
        dx[n..2 * n].copy_from_slice(memory.acceleration.as_slice());
        dx[2 * n..nx].copy_from_slice(memory.rates.as_slice());
        let below = nx - n;
        let pairs = x[nx..].chunks_exact(nx).zip(dx[nx..].chunks_exact_mut(nx));
        for (column, (s, ds)) in pairs.enumerate() {
            ds[..n].copy_from_slice(&s[n..2 * n]);
            for i in 0..below {
                let mut rate = if column < nx {
                    0.0
                } else {
                    memory.linear[(i, column)]
                };
                for (j, s) in s.iter().enumerate() {
                    rate += memory.linear[(i, j)] * s;
                }
                ds[n + i] = rate;
            }
        }
        Ok(())
    }
}
