//! One step of an explicit method in any space.

use crate::space::series::{Work, chart_rate};
use crate::{Space, System};

/// The chart x₀ ∘ exp ξ around the state where a step begins, where the system reads ξ̇ = φ(ad_ξ)⁻¹ f(t, x₀ ∘ exp ξ).
#[derive(Debug, Clone, Default)]
pub(crate) struct Chart {
    xi: Vec<f64>,
    point: Vec<f64>,
    velocity: Vec<f64>,
    work: Work,
}

impl Chart {
    /// Steps x by `flat`, a step of a method in a vector space: `flat(state, right-hand side)`.
    pub fn step<S: System>(
        &mut self,
        system: &S,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
        flat: impl FnOnce(
            &mut [f64],
            &mut dyn FnMut(f64, &[f64], &mut [f64]) -> Result<(), S::Error>,
        ) -> Result<(), S::Error>,
    ) -> Result<(), S::Error> {
        let space = system.space();
        let Chart {
            xi,
            point,
            velocity,
            work,
        } = self;
        xi.clear();
        xi.resize(space.tangent_dim(), 0.0);
        point.resize(space.dim(), 0.0);
        velocity.resize(space.tangent_dim(), 0.0);
        flat(xi, &mut |t, xi, rate| {
            space.move_into(x, xi, point);
            system.rate(t, point, u, memory, velocity)?;
            chart_rate(space, xi, velocity, work, rate);
            Ok(())
        })?;
        space.move_into(x, xi, point);
        x.copy_from_slice(point);
        Ok(())
    }
}
