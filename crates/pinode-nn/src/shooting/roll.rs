//! Roll-outs of the hybrid model over a window of a recording, with exact sensitivities.

use integrators::Rk4;

use crate::hybrid::{DrivenInputs, Hybrid, Memory};

/// A roll-out left the finite numbers, or the mass matrix lost its inverse on the way.
#[derive(Debug, Clone, PartialEq)]
pub struct Diverged {
    /// What the dynamics refused; none where the state left the finite numbers.
    pub cause: Option<lagrange::Error>,
}

impl From<lagrange::Error> for Diverged {
    fn from(cause: lagrange::Error) -> Self {
        Diverged { cause: Some(cause) }
    }
}

/// States at the samples of a window, and their sensitivities when asked for.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// State (q, v) after state: sample k at `k * nx ..`, nx = nq + nv.
    pub states: Vec<f64>,
    /// ∂(q, v)_k/∂(initial state, θ_free): sample k at `k * nx * columns ..`, column after column.
    pub sensitivities: Vec<f64>,
}

/// Rolls out windows on one thread.
///
/// With sensitivities the state x = (q, v) is integrated together with S = ∂x/∂(x₀, θ_free), Ṡ = (∂f/∂x) S + ∂f/∂θ. The same
/// Runge-Kutta steps on both make S the exact derivative of the discrete roll-out.
pub struct Roller<'a> {
    hybrid: &'a Hybrid,
    free: &'a [usize],
    memory: Memory,
    rk4: Rk4<f64>,
    state: Vec<f64>,
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
        }
    }

    /// Columns of the sensitivities: the initial state, then θ_free.
    pub fn columns(&self) -> usize {
        2 * self.hybrid.nv() + self.free.len()
    }

    /// States at `count` samples from sample `first` on, starting at `initial`.
    ///
    /// A pose moves with the rate of its quaternion, ½ (quaternion) ∘ (0, ω), which is divided by its length after every step. The
    /// steps leave the unit sphere by terms of the order of their own error, so that the global error stays of order h⁴.
    pub fn roll(
        &mut self,
        theta: &[f64],
        inputs: &DrivenInputs,
        (first, count): (usize, usize),
        initial: &[f64],
        out: &mut Trajectory,
    ) -> Result<(), Diverged> {
        let nq = self.hybrid.nq();
        let (hybrid, memory) = (self.hybrid, &mut self.memory);
        self.state.clear();
        self.state.extend_from_slice(initial);
        out.states.clear();
        out.sensitivities.clear();
        out.states.extend_from_slice(initial);
        let substeps = inputs.grid.substeps;
        for sample in first..first + count - 1 {
            for step in sample * substeps..(sample + 1) * substeps {
                let (a, b) = (inputs.grid.bounds[step], inputs.grid.bounds[step + 1]);
                self.rk4.step(
                    a,
                    b - a,
                    &mut self.state,
                    |_, x, dx| -> Result<(), Diverged> {
                        let (q, v) = x.split_at(nq);
                        // Beyond the range of any mechanism it is the state that is at fault.
                        let found = hybrid.acceleration((q, v), theta, inputs, step, memory);
                        found.or_else(|e| check(x).and(Err(e.into())))?;
                        hybrid.position_rate(q, v, &mut dx[..nq]);
                        dx[nq..].copy_from_slice(memory.acceleration.as_slice());
                        Ok(())
                    },
                )?;
                hybrid.normalize(&mut self.state[..nq]);
            }
            check(&self.state)?;
            out.states.extend_from_slice(&self.state);
        }
        Ok(())
    }

    /// As [`roll`](Self::roll), with the sensitivities in the initial state and θ_free. Not for poses, which diagnosis and evaluation
    /// refuse: their q and v differ in length.
    pub fn roll_with_sensitivities(
        &mut self,
        theta: &[f64],
        inputs: &DrivenInputs,
        (first, count): (usize, usize),
        initial: &[f64],
        out: &mut Trajectory,
    ) -> Result<(), Diverged> {
        let n = self.hybrid.nv();
        let nx = 2 * n;
        let columns = self.columns();
        let (hybrid, memory, free) = (self.hybrid, &mut self.memory, self.free);
        self.state.clear();
        self.state.extend_from_slice(initial);
        self.state.resize(nx + nx * columns, 0.0);
        for i in 0..nx {
            self.state[nx + i * nx + i] = 1.0;
        }
        out.states.clear();
        out.sensitivities.clear();
        out.states.extend_from_slice(initial);
        out.sensitivities.extend_from_slice(&self.state[nx..]);
        let substeps = inputs.grid.substeps;
        for sample in first..first + count - 1 {
            for step in sample * substeps..(sample + 1) * substeps {
                let (a, b) = (inputs.grid.bounds[step], inputs.grid.bounds[step + 1]);
                self.rk4.step(
                    a,
                    b - a,
                    &mut self.state,
                    |_, x, dx| -> Result<(), Diverged> {
                        let (q, v) = x[..nx].split_at(n);
                        hybrid.linearize((q, v), theta, free, inputs, step, memory)?;
                        dx[..n].copy_from_slice(v);
                        dx[n..nx].copy_from_slice(memory.acceleration.as_slice());
                        let pairs = x[nx..].chunks_exact(nx).zip(dx[nx..].chunks_exact_mut(nx));
                        for (column, (s, ds)) in pairs.enumerate() {
                            ds[..n].copy_from_slice(&s[n..]);
                            for i in 0..n {
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
                    },
                )?;
            }
            check(&self.state)?;
            out.states.extend_from_slice(&self.state[..nx]);
            out.sensitivities.extend_from_slice(&self.state[nx..]);
        }
        Ok(())
    }
}

/// A state beyond any mechanism's, or not a number, ends the roll-out.
fn check(state: &[f64]) -> Result<(), Diverged> {
    if state.iter().all(|x| x.abs() < 1e12) {
        Ok(())
    } else {
        Err(Diverged { cause: None })
    }
}
