//! A row times the derivatives of the constrained forward dynamics, by the transposed equations.
//!
//! With ID(q, v, v̇) = M v̇ + C v + G of the free mechanism and r = φ̈ + 2 ω φ̇ + ω² φ, the acceleration obeys
//!
//! ID(q, v, v̇) − Jᵀ λ − Q = 0,  r(q, v, v̇) = 0 with ∂r/∂v̇ = J.
//!
//! For the row w, μ and ν solve the transposed equations
//!
//! M μ + Jᵀ ν = w,  J μ = 0,  that is (J M⁻¹ Jᵀ) ν = J M⁻¹ w,  μ = M⁻¹ w − M⁻¹ Jᵀ ν.
//!
//! The derivatives of the two equations in any variable x, multiplied by μᵀ and νᵀ and added, hold ∂v̇/∂x with the factor
//! μᵀ M + νᵀ J = wᵀ, and ∂λ/∂x with −μᵀ Jᵀ = 0. What is left is
//!
//! wᵀ ∂v̇/∂x = −μᵀ ∂ID/∂x + μᵀ ∂Q/∂x + ∂s/∂x,  s = λᵀ J μ − νᵀ r,
//!
//! at fixed v̇, λ, μ, ν: the gradient of the free inverse dynamics along μ, wᵀ ∂v̇/∂Q = μᵀ, and the gradient of one number s.
//!
//! That gradient takes two forces Jᵀ λ on dual numbers where the constraint has a formula for them, as closed loops have; else two
//! residuals on dual numbers for every coordinate.

use num_dual::{Dual2, Dual64};

use super::kinematics::{Kinematics, Room, position_rate};
use super::{Constrained, Constraint};
use crate::equations::cholesky;
use crate::{Error, ForwardDynamicsGradient, InverseDynamicsGradient, Mechanics, Workspace};

impl<M: Mechanics, C: Constraint> Constrained<M, C> {
    /// v̇ and wᵀ ∂v̇/∂x for the row w = `weight`; for M that does not depend on v.
    pub(super) fn gradient(
        &self,
        (q, v, force): (&[f64], &[f64], &[f64]),
        p: &[f64],
        weight: &[f64],
        work: &mut Workspace,
        room: &mut Room,
        out: &mut ForwardDynamicsGradient,
    ) -> Result<(), Error> {
        out.acceleration.copy_from_slice(force);
        self.solve((q, v), p, self.rate(), work, room, &mut out.acceleration)?;
        let mu = &mut out.by_force;
        mu.copy_from_slice(weight);
        room.rhs.gemv_tr(1.0, &room.response, mu, 0.0);
        cholesky::solve(&room.coupling, &mut room.rhs);
        cholesky::solve(&room.mass, mu);
        mu.gemv(-1.0, &room.response, &room.rhs, 1.0);

        // The same vectors take the gradient of the free mechanism, and then that of the constrained one.
        let mut free = InverseDynamicsGradient {
            by_q: std::mem::take(&mut out.by_q),
            by_v: std::mem::take(&mut out.by_v),
            by_a: std::mem::take(&mut room.force),
            by_p: std::mem::take(&mut out.by_p),
        };
        let (a, mu) = (out.acceleration.as_slice(), out.by_force.as_slice());
        (self.free()).inverse_dynamics_gradient_into(q, v, a, p, mu, work, &mut free);
        (out.by_q, out.by_v, out.by_p) = (free.by_q, free.by_v, free.by_p);
        room.force = free.by_a;
        for by in [&mut out.by_q, &mut out.by_v, &mut out.by_p] {
            by.neg_mut();
        }

        let kinematics = self.kinematics();
        let at = Motion {
            q,
            v,
            a,
            mu,
            rate: self.rate(),
        };
        let (by_q, by_v) = (out.by_q.as_mut_slice(), out.by_v.as_mut_slice());
        if !kinematics.by_force(&at, p, room, by_q, by_v) {
            for j in 0..v.len() {
                let (of_q, of_v) = kinematics.by_position_and_velocity(&at, p, j, room);
                by_q[j] += of_q;
                by_v[j] += of_v;
            }
        }
        if self.coordinates().iter().any(|c| c.floating) {
            // ∂s/∂v has −νᵀ J [v, e_j] besides.
            room.force.gemv_tr(1.0, &room.jacobian, &room.rhs, 0.0);
            let mut iv = 0;
            for coordinate in self.coordinates() {
                if coordinate.floating {
                    let by = bracket(&v[iv..iv + 6], &room.force.as_slice()[iv..iv + 6]);
                    for (to, by) in out.by_v.as_mut_slice()[iv..].iter_mut().zip(by) {
                        *to -= by;
                    }
                }
                iv += coordinate.nv();
            }
        }
        for (k, by) in out.by_p.iter_mut().enumerate() {
            if kinematics.constraint.uses_constant(k) {
                *by += kinematics.by_constant(&at, p, k, room);
            }
        }
        Ok(())
    }
}

/// Where the number s is differentiated; λ and ν are the room's `multipliers` and `rhs`.
struct Motion<'a> {
    q: &'a [f64],
    v: &'a [f64],
    a: &'a [f64],
    mu: &'a [f64],
    /// ω of the stabilisation.
    rate: f64,
}

impl<C: Constraint> Kinematics<'_, C> {
    /// Adds ∂s/∂q and ∂s/∂v, if the constraint knows its force Jᵀ λ and no joint floats, q̇ = v.
    ///
    /// As ∂²φ/∂q² is symmetric, ∂(λᵀ J μ)/∂q is the rate of Jᵀ λ along μ; and the derivatives of νᵀ φ, νᵀ φ̇, νᵀ φ̈ in q at fixed v, v̇ are
    /// Jᵀ ν and its two rates along the motion: one force on dual numbers each, whatever the number of coordinates.
    fn by_force(
        &self,
        at: &Motion,
        p: &[f64],
        room: &mut Room,
        by_q: &mut [f64],
        by_v: &mut [f64],
    ) -> bool {
        if self.coordinates.iter().any(|c| c.floating) {
            return false;
        }
        // Of all equations; 0 of those that are dropped.
        let of_all = &mut room.real.out;
        of_all.fill(0.0);
        for (multiplier, &equation) in room.rhs.iter().zip(self.kept) {
            of_all[equation] = *multiplier;
        }
        let lane = &mut room.second;
        lane.set(&[], &[], p);
        for (i, d) in lane.q.iter_mut().enumerate() {
            *d = Dual2::new(at.q[i], at.v[i], at.a[i]);
        }
        lane.rate.fill(0.0.into());
        let known = (self.constraint).add_force_with(&lane.q, &lane.p, of_all, &mut lane.rate);
        if !known {
            return false;
        }
        let omega = at.rate;
        for ((by_q, by_v), force) in by_q.iter_mut().zip(by_v).zip(&lane.rate) {
            *by_q -= force.v2 + 2.0 * omega * force.v1 + omega * omega * force.re;
            *by_v -= 2.0 * (force.v1 + omega * force.re);
        }
        for (multiplier, &equation) in room.multipliers.iter().zip(self.kept) {
            of_all[equation] = *multiplier;
        }
        let lane = &mut room.dual;
        lane.set(&[], &[], p);
        for (i, d) in lane.q.iter_mut().enumerate() {
            *d = Dual64::new(at.q[i], at.mu[i]);
        }
        lane.rate.fill(0.0.into());
        (self.constraint).add_force_with(&lane.q, &lane.p, of_all, &mut lane.rate);
        for (by_q, force) in by_q.iter_mut().zip(&lane.rate) {
            *by_q += force.eps;
        }
        true
    }

    /// ∂s/∂q along the velocity e_j; and ∂s/∂v_j, but for −νᵀ J [v, e_j] where a joint floats.
    ///
    /// As q̇ is linear in v, ∂φ̇/∂v = J and ∂φ̈/∂v_j = 2 ∂φ̇/∂q_j, where the order of two velocities does not matter. Where it does,
    /// J [v, e_j] is added, [·, ·] being the bracket of velocities of a body.
    fn by_position_and_velocity(
        &self,
        at: &Motion,
        p: &[f64],
        j: usize,
        room: &mut Room,
    ) -> (f64, f64) {
        let lane = &mut room.hyper;
        lane.set(at.q, &[], p);
        lane.unit_velocity(j);
        position_rate(self.coordinates, &lane.q, &lane.v, &mut lane.rate);
        for (d, rate) in lane.q.iter_mut().zip(&lane.rate) {
            d.eps2 = rate.re;
        }
        let of_force = self.of_force(at.mu, room);
        room.taylor.set(&[], &[], p);
        let [position, velocity, acceleration] = self.of_motion(at, room);
        let omega = at.rate;
        (
            of_force - acceleration - 2.0 * omega * velocity - omega * omega * position,
            -2.0 * (velocity + omega * position),
        )
    }

    /// ∂s/∂p_k.
    fn by_constant(&self, at: &Motion, p: &[f64], k: usize, room: &mut Room) -> f64 {
        room.hyper.set(at.q, &[], p);
        room.hyper.p[k].eps2 = 1.0;
        let of_force = self.of_force(at.mu, room);
        room.taylor.set(&[], &[], p);
        room.taylor.p[k].re.eps = 1.0;
        let [position, velocity, acceleration] = self.of_motion(at, room);
        let omega = at.rate;
        of_force - acceleration - 2.0 * omega * velocity - omega * omega * position
    }

    /// λᵀ ∂(J μ)/∂x, x along ε₂ of the hyper-dual lane; ε₁ is along the velocity μ, and is taken away again.
    fn of_force(&self, mu: &[f64], room: &mut Room) -> f64 {
        let lane = &mut room.hyper;
        lane.set(&[], mu, &[]);
        position_rate(self.coordinates, &lane.q, &lane.v, &mut lane.rate);
        for (d, rate) in lane.q.iter_mut().zip(&lane.rate) {
            d.eps1 = rate.re;
            d.eps1eps2 = rate.eps2;
        }
        self.constraint
            .residual_with(&lane.q, &lane.p, &mut lane.out);
        for d in &mut lane.q {
            d.eps1 = 0.0;
            d.eps1eps2 = 0.0;
        }
        (room.multipliers.iter().zip(self.kept))
            .map(|(multiplier, &equation)| multiplier * lane.out[equation].eps1eps2)
            .sum()
    }

    /// νᵀ ∂(φ, φ̇, φ̈)/∂x at fixed v̇, x along ε₂ of q in the hyper-dual lane and along ε of the constants in the Taylor lane.
    fn of_motion(&self, at: &Motion, room: &mut Room) -> [f64; 3] {
        let (lane, taylor) = (&mut room.hyper, &mut room.taylor);
        for ((d, &v), &a) in lane.v.iter_mut().zip(at.v).zip(at.a) {
            *d = v.into();
            d.eps1 = a;
        }
        // q̇, then q̈, and their changes with x.
        position_rate(self.coordinates, &lane.q, &lane.v, &mut lane.rate);
        for (d, rate) in lane.q.iter_mut().zip(&lane.rate) {
            d.eps1 = rate.re;
            d.eps1eps2 = rate.eps2;
        }
        position_rate(self.coordinates, &lane.q, &lane.v, &mut lane.rate);
        for ((to, q), rate) in taylor.q.iter_mut().zip(&lane.q).zip(&lane.rate) {
            *to = Dual2::new(
                Dual64::new(q.re, q.eps2),
                Dual64::new(q.eps1, q.eps1eps2),
                Dual64::new(rate.eps1, rate.eps1eps2),
            );
        }
        self.constraint
            .residual_with(&taylor.q, &taylor.p, &mut taylor.out);
        let mut sum = [0.0; 3];
        for (nu, &equation) in room.rhs.iter().zip(self.kept) {
            let phi = &taylor.out[equation];
            for (sum, part) in sum.iter_mut().zip([phi.re, phi.v1, phi.v2]) {
                *sum += nu * part.eps;
            }
        }
        sum
    }
}

/// gᵀ [v, e_j] for the six velocities e_j of a body, with v = (u, ω) and [v, (x, y)] = (ω × x + u × y, ω × y): (g_u × ω, g_u × u + g_ω × ω).
fn bracket(v: &[f64], g: &[f64]) -> [f64; 6] {
    let cross = |a: &[f64], b: &[f64]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let (u, omega) = v.split_at(3);
    let (linear, angular) = g.split_at(3);
    let [a, b, c] = cross(linear, omega);
    let (d, e) = (cross(linear, u), cross(angular, omega));
    [a, b, c, d[0] + e[0], d[1] + e[1], d[2] + e[2]]
}
