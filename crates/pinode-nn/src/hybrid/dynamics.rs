//! v̇ of the hybrid model, and its derivatives.

use std::ops::Range;

use lagrange::{ForwardDynamicsDerivatives, ForwardDynamicsGradient, Workspace};
use nalgebra::{DMatrix, DVector};

use super::{DrivenInputs, Hybrid, Placed};
use crate::effect::{Action, JointForce};
use crate::entries::Start;
use crate::motion::Momenta;

impl Hybrid {
    /// Memory for [`acceleration`](Self::acceleration) and [`linearize`](Self::linearize) for one thread.
    pub fn memory(&self, free: &[usize]) -> Memory {
        let n = self.nv();
        let mechanics: Vec<usize> = free
            .iter()
            .copied()
            .filter(|i| self.mechanics_range().contains(i))
            .collect();
        Memory {
            work: self.mechanics.workspace(),
            acceleration: DVector::zeros(n),
            bias: DVector::zeros(n),
            by: ForwardDynamicsDerivatives::zeros(n, mechanics.len()),
            mechanics,
            forces: DMatrix::zeros(n, 2 * n + free.len()),
            linear: DMatrix::zeros(n, 2 * n + free.len()),
            by_parameter: vec![0.0; 8],
            gradient: ForwardDynamicsGradient::zeros(n, self.mechanics_range().len()),
            momenta: Momenta::new(n),
        }
    }

    /// v̇ at (q, v) under the input forces of integration step `step`; left in `memory.acceleration`.
    pub fn acceleration(
        &self,
        (q, v): (&[f64], &[f64]),
        theta: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut Memory,
    ) -> Result<(), lagrange::Error> {
        self.load((q, v), theta, inputs, step, memory);
        let p = &theta[self.mechanics_range()];
        self.mechanics
            .forward_dynamics_into(q, v, p, &mut memory.work, &mut memory.acceleration)
    }

    /// Q of inputs and effects, into `memory.acceleration`.
    pub(super) fn load(
        &self,
        (q, v): (&[f64], &[f64]),
        theta: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut Memory,
    ) {
        self.load_where(|_| true, (q, v), theta, inputs, step, memory);
    }

    /// Q of inputs and of those effects that `counts` keeps, into `memory.acceleration`.
    pub(super) fn load_where(
        &self,
        counts: impl Fn(&dyn JointForce) -> bool,
        (q, v): (&[f64], &[f64]),
        theta: &[f64],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut Memory,
    ) {
        memory.acceleration.fill(0.0);
        for (signal, &coordinate) in inputs.forces.iter().zip(&self.input_coordinates) {
            memory.acceleration[self.starts[coordinate].v] += signal.value[step];
        }
        for (law, effect, range) in self.forces().filter(|(law, ..)| counts(*law)) {
            let at = self.starts[effect.target];
            memory.acceleration[at.v] += law.force(
                q[at.q],
                v[at.v],
                &theta[range.clone()],
                effect.smoothing * self.smoothing_scale,
            );
        }
    }

    /// v̇ as [`acceleration`](Self::acceleration), and in `memory.linear` its derivatives [∂v̇/∂q, ∂v̇/∂v, ∂v̇/∂θ_free]:
    ///
    /// ∂v̇/∂x = ∂v̇/∂Q ∂Q/∂x + ∂v̇/∂x at fixed Q.
    pub fn linearize(
        &self,
        (q, v): (&[f64], &[f64]),
        theta: &[f64],
        free: &[usize],
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut Memory,
    ) -> Result<(), lagrange::Error> {
        self.load((q, v), theta, inputs, step, memory);
        let n = self.nv();
        let p = &theta[self.mechanics_range()];
        let by = &mut memory.by;
        self.mechanics.forward_dynamics_derivatives_into(
            q,
            v,
            memory.acceleration.as_slice(),
            p,
            &memory.mechanics,
            &mut memory.work,
            by,
        )?;
        memory.acceleration.copy_from(&by.acceleration);
        // First ∂Q/∂x of what makes Q.
        let rhs = &mut memory.forces;
        rhs.fill(0.0);
        let column = |index: usize| free.binary_search(&index).ok().map(|k| 2 * n + k);
        for (signal, &coordinate) in inputs.forces.iter().zip(&self.input_coordinates) {
            for (index, derivative) in &signal.by_parameter {
                if let Some(column) = column(*index) {
                    rhs[(self.starts[coordinate].v, column)] += derivative[step];
                }
            }
        }
        for (law, effect, range) in self.forces() {
            let by_parameter = &mut memory.by_parameter[..range.len()];
            let Start { q: iq, v: iv } = self.starts[effect.target];
            let at = law.derivatives(
                q[iq],
                v[iv],
                &theta[range.clone()],
                effect.smoothing * self.smoothing_scale,
                by_parameter,
            );
            rhs[(iv, iv)] += at.by_q;
            rhs[(iv, n + iv)] += at.by_v;
            for (index, derivative) in range.clone().zip(by_parameter) {
                if let Some(column) = column(index) {
                    rhs[(iv, column)] += *derivative;
                }
            }
        }
        // ∂v̇/∂x = ∂v̇/∂Q ∂Q/∂x, and what the mechanics adds.
        let linear = &mut memory.linear;
        by.by_force.mul_to(rhs, linear);
        for (first, block) in [(0, &by.by_q), (n, &by.by_v)] {
            let mut columns = linear.columns_mut(first, n);
            columns += block;
        }
        for (k, &index) in memory.mechanics.iter().enumerate() {
            if let Some(column) = column(index) {
                let mut to = linear.column_mut(column);
                to += by.by_p.column(k);
            }
        }
        Ok(())
    }

    /// v̇ as [`acceleration`](Self::acceleration), and *adds* w · ∂v̇/∂q, w · ∂v̇/∂v and w · ∂v̇/∂θ_free for the row w = `weight` to
    /// `by`: ∂v̇/∂x = ∂v̇/∂Q ∂Q/∂x + ∂v̇/∂x at fixed Q.
    #[allow(clippy::too_many_arguments)]
    pub fn pull_back(
        &self,
        (q, v): (&[f64], &[f64]),
        theta: &[f64],
        free: &[usize],
        inputs: &DrivenInputs,
        step: usize,
        weight: &[f64],
        memory: &mut Memory,
        (by_q, by_v, by_theta): (&mut [f64], &mut [f64], &mut [f64]),
    ) -> Result<(), lagrange::Error> {
        self.load((q, v), theta, inputs, step, memory);
        let p = &theta[self.mechanics_range()];
        let by = &mut memory.gradient;
        self.mechanics.forward_dynamics_gradient_into(
            q,
            v,
            memory.acceleration.as_slice(),
            p,
            weight,
            &mut memory.work,
            by,
        )?;
        memory.acceleration.copy_from(&by.acceleration);
        let mut add_to_theta = |index: usize, part: f64| {
            if let Ok(k) = free.binary_search(&index) {
                by_theta[k] += part;
            }
        };
        for &index in &memory.mechanics {
            add_to_theta(index, by.by_p[index]);
        }
        for (signal, &coordinate) in inputs.forces.iter().zip(&self.input_coordinates) {
            let of_force = by.by_force[self.starts[coordinate].v];
            for (index, derivative) in &signal.by_parameter {
                add_to_theta(*index, of_force * derivative[step]);
            }
        }
        for (law, effect, range) in self.forces() {
            let by_parameter = &mut memory.by_parameter[..range.len()];
            let Start { q: iq, v: iv } = self.starts[effect.target];
            let at = law.derivatives(
                q[iq],
                v[iv],
                &theta[range.clone()],
                effect.smoothing * self.smoothing_scale,
                by_parameter,
            );
            let of_force = by.by_force[iv];
            // A coordinate with an effect is one number in q and in v.
            by_q[iv] += of_force * at.by_q;
            by_v[iv] += of_force * at.by_v;
            for (index, derivative) in range.clone().zip(by_parameter) {
                add_to_theta(index, of_force * *derivative);
            }
        }
        for (to, by) in [(by_q, &by.by_q), (by_v, &by.by_v)] {
            for (to, by) in to.iter_mut().zip(by.iter()) {
                *to += by;
            }
        }
        Ok(())
    }

    /// The effects that are forces.
    fn forces(&self) -> impl Iterator<Item = (&'static dyn JointForce, &Placed, &Range<usize>)> {
        self.effects
            .iter()
            .zip(&self.ranges)
            .filter_map(|(effect, range)| match effect.kind.action {
                Action::Joint(law) => Some((law, effect, range)),
                Action::Drive(_) => None,
            })
    }
}

/// Memory of one thread for one set of free constants.
pub struct Memory {
    pub(super) work: Workspace,
    /// v̇ of the last call.
    pub acceleration: DVector<f64>,
    /// C v + G.
    pub(super) bias: DVector<f64>,
    by: ForwardDynamicsDerivatives,
    /// ∂Q/∂(q, v, θ_free) of inputs and effects.
    forces: DMatrix<f64>,
    /// The free constants of the mechanics.
    mechanics: Vec<usize>,
    /// [∂v̇/∂q, ∂v̇/∂v, ∂v̇/∂θ_free] of the last [`Hybrid::linearize`].
    pub linear: DMatrix<f64>,
    by_parameter: Vec<f64>,
    gradient: ForwardDynamicsGradient,
    pub(super) momenta: Momenta,
}
