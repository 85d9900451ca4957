//! Eight states at once.

use std::ops::Deref;

use integrators::System;
use integrators::ensemble::{LANES, LaneSystem};
use lagrange::{Error, Mechanics};

use super::{FreeMotion, Memory, Motion};

impl<M: Deref<Target: Mechanics> + Send + Sync> LaneSystem for Motion<M> {
    /// (v, v̇) of eight states by [`Mechanics::forward_dynamics_lanes_into`].
    fn rate_lanes(
        &self,
        _t: f64,
        x: &[[f64; LANES]],
        u: [&Vec<f64>; LANES],
        memory: &mut Memory,
        dx: &mut [[f64; LANES]],
    ) -> Result<(), Error> {
        let (q, v) = x.split_at(self.mechanics.nq());
        let (dq, dv) = dx.split_at_mut(v.len());
        dq.copy_from_slice(v);
        for (lane, u) in u.into_iter().enumerate() {
            self.check_force(u)?;
            for (to, force) in dv.iter_mut().zip(u) {
                to[lane] = *force;
            }
        }
        self.mechanics
            .forward_dynamics_lanes_into(q, v, &self.constants, &mut memory.work, dv)
    }
}

impl<M: Deref<Target: Mechanics> + Send + Sync> LaneSystem for FreeMotion<M> {
    fn rate_lanes(
        &self,
        t: f64,
        x: &[[f64; LANES]],
        u: [&<Self as System>::Input; LANES],
        memory: &mut Memory,
        dx: &mut [[f64; LANES]],
    ) -> Result<(), Error> {
        self.motion().rate_lanes(t, x, u, memory, dx)
    }
}
