//! Derivatives of a roll-out for fits: one linearisation a step.
//!
//! Over an integration step of length h with A = ∂f/∂x and B = ∂f/∂θ in its middle, S = ∂x/∂(x₀, θ) goes on by
//!
//! S ← e^{hA} S + h φ₁(hA) B,  φ₁(z) = (e^z − 1)/z,
//!
//! to the fourth power of hA. Its error is of second order in h. The fits look for the zero of Σ Sᵀ W r: where the model is right, r is
//! noise, and no small error of S moves that zero on average. [`Roller::roll_with_sensitivities`] has the derivatives of the Runge-Kutta
//! steps themselves, at twice the price.

use integrators::Method;

use super::{Diverged, Roller, Trajectory};
use crate::hybrid::{DrivenInputs, HybridMotion, Memory};

/// Room for one step.
#[derive(Debug, Clone, Default)]
struct Room {
    middle: Vec<f64>,
    rate: Vec<f64>,
    next: Vec<f64>,
}

impl Roller<'_> {
    /// States at `count` samples from sample `first` on, and their derivatives in the initial state and θ_free to second order in the
    /// step. `kept` sees every step in its middle: its number, the state there, what [`Hybrid::linearize`](crate::hybrid::Hybrid::linearize)
    /// left, and its length.
    pub(super) fn roll_with_tangents(
        &mut self,
        theta: &[f64],
        inputs: &DrivenInputs,
        (first, count): (usize, usize),
        initial: &[f64],
        out: &mut Trajectory,
        mut kept: impl FnMut(usize, &[f64], &mut Memory, f64),
    ) -> Result<(), Diverged> {
        let nx = initial.len();
        let motion = HybridMotion::new(self.hybrid, theta, self.free, inputs);
        let mut total = vec![0.0; nx * self.columns()];
        (0..nx).for_each(|i| total[i * nx + i] = 1.0);
        let mut room = Room {
            middle: vec![0.0; nx],
            rate: vec![0.0; nx],
            next: vec![0.0; nx],
        };
        self.state.clear();
        self.state.extend_from_slice(initial);
        out.states.clear();
        out.sensitivities.clear();
        out.states.extend_from_slice(initial);
        out.sensitivities.extend_from_slice(&total);
        let substeps = inputs.grid.substeps;
        for sample in first..first + count - 1 {
            for step in sample * substeps..(sample + 1) * substeps {
                let (a, b) = (inputs.grid.bounds[step], inputs.grid.bounds[step + 1]);
                let (state, memory) = (&mut self.state, &mut self.memory);
                room.middle.copy_from_slice(state);
                Method::step(&mut self.rk4, &motion, a, b - a, &step, memory, state)?;
                for (m, x) in room.middle.iter_mut().zip(state.iter()) {
                    *m = 0.5 * (*m + x);
                }
                let middle = self.hybrid.parts(&room.middle);
                self.hybrid
                    .linearize(middle, theta, self.free, inputs, step, memory)
                    .map_err(Diverged::Dynamics)?;
                go_on(self.hybrid.nv(), memory, b - a, &mut total, &mut room);
                kept(step, &room.middle, memory, b - a);
            }
            Diverged::check(&self.state)?;
            out.states.extend_from_slice(&self.state);
            out.sensitivities.extend_from_slice(&total);
        }
        Ok(())
    }
}

/// One step of S, column after column in `total`, by the linearisation in `memory`.
fn go_on(n: usize, memory: &Memory, h: f64, total: &mut [f64], room: &mut Room) {
    let nx = room.middle.len();
    let step = Step::of(n, nx, memory, h);
    for (column, s) in total.chunks_exact_mut(nx).enumerate() {
        step.apply(s, (column >= nx).then_some(column), room);
    }
}

/// e^{hA}, nx × nx, column after column, by the linearisation in `memory`.
pub(super) fn transition(n: usize, nx: usize, memory: &Memory, h: f64, out: &mut Vec<f64>) {
    let mut room = Room {
        middle: Vec::new(),
        rate: vec![0.0; nx],
        next: vec![0.0; nx],
    };
    let step = Step::of(n, nx, memory, h);
    let first = out.len();
    out.resize(first + nx * nx, 0.0);
    for (i, column) in out[first..].chunks_exact_mut(nx).enumerate() {
        column[i] = 1.0;
        step.apply(column, None, &mut room);
    }
}

/// A step of length h by a linearisation.
struct Step<'a> {
    n: usize,
    nx: usize,
    h: f64,
    /// The rows of A and B below the positions, column after column.
    linear: &'a [f64],
}

impl<'a> Step<'a> {
    fn of(n: usize, nx: usize, memory: &'a Memory, h: f64) -> Self {
        let linear = memory.linear.as_slice();
        Step { n, nx, h, linear }
    }

    /// s ← e^{hA} s + h φ₁(hA) b, b the `constant`th column of the linearisation, or 0. Written out for the usual numbers of states.
    fn apply(&self, s: &mut [f64], constant: Option<usize>, room: &mut Room) {
        let Room { rate, next, .. } = room;
        match (self.n, self.nx) {
            (1, 2) => self.apply_sized::<1, 2>(s, constant, rate, next),
            (1, 3) => self.apply_sized::<1, 3>(s, constant, rate, next),
            (2, 4) => self.apply_sized::<2, 4>(s, constant, rate, next),
            (2, 5) => self.apply_sized::<2, 5>(s, constant, rate, next),
            (2, 6) => self.apply_sized::<2, 6>(s, constant, rate, next),
            (3, 6) => self.apply_sized::<3, 6>(s, constant, rate, next),
            _ => self.apply_sized::<0, 0>(s, constant, rate, next),
        }
    }

    /// For N coordinates and NX states; 0 stands for any number.
    #[inline(always)]
    fn apply_sized<const N: usize, const NX: usize>(
        &self,
        s: &mut [f64],
        constant: Option<usize>,
        rate: &mut [f64],
        next: &mut [f64],
    ) {
        let (n, nx) = match NX {
            0 => (self.n, self.nx),
            _ => (N, NX),
        };
        let (s, rate, next) = (&mut s[..nx], &mut rate[..nx], &mut next[..nx]);
        let below = nx - n;
        // The rates of positions are the velocities, the rest is in A.
        let times = |s: &[f64], out: &mut [f64]| {
            out[..n].copy_from_slice(&s[n..2 * n]);
            out[n..].fill(0.0);
            for (column, s) in self.linear.chunks_exact(below).zip(s) {
                for i in 0..below {
                    out[n + i] += column[i] * s;
                }
            }
        };
        times(s, rate);
        if let Some(column) = constant {
            let b = &self.linear[column * below..(column + 1) * below];
            for i in 0..below {
                rate[n + i] += b[i];
            }
        }
        // Each term of the series from the one before.
        let mut factor = self.h;
        for power in 2..=5 {
            for i in 0..nx {
                s[i] += factor * rate[i];
            }
            if power < 5 {
                times(rate, next);
                rate.copy_from_slice(next);
                factor *= self.h / power as f64;
            }
        }
    }
}
