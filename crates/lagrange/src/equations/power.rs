//! Where the work of a generalized force goes.

use super::Workspace;
use crate::{Error, Mechanics};

/// Where the work of a generalized force goes; input = kinetic + potential.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PowerBalance {
    /// Q · v, W.
    pub input: f64,
    /// dT/dt, W; for T not quadratic in v the rate of v · ∂T/∂v − T.
    pub kinetic: f64,
    /// dV/dt, W.
    pub potential: f64,
}

/// The balance at (q, v) under Q = `force`, from both dynamics: v · (Q(q, v, v̇) − G) and v · G with the v̇ of the forward dynamics.
pub(crate) fn balance<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, force): (&[f64], &[f64], &[f64]),
    p: &[f64],
    work: &mut Workspace,
) -> Result<PowerBalance, Error> {
    let mut one = std::mem::take(&mut work.lane);
    one.out.copy_from_slice(force);
    let solved = mechanics.forward_dynamics_into(q, v, p, work, &mut one.out);
    one.a.copy_from_slice(one.out.as_slice());
    mechanics.inverse_dynamics_into(q, v, &one.a, p, work, &mut one.out);
    let both = dot(v, one.out.as_slice());
    mechanics.gravity_force_into(q, p, work, &mut one.out);
    let potential = dot(v, one.out.as_slice());
    work.lane = one;
    solved.map(|()| PowerBalance {
        input: dot(v, force),
        kinetic: both - potential,
        potential,
    })
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
