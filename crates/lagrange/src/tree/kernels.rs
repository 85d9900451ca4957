//! The algorithms with their arguments, for one state (`f64`) or eight (`[f64; 8]`).
//!
//! Matrices are stored column after column.

use super::common::{
    ACCELERATION, Axis, Moved, POSITION, Sums, VELOCITY, composite, gravity, motion, sweep_rates,
};
use super::dispatch::{FEW, Kernel, Memory, TreeMemory, Width};
use super::gradient::Weighed;
use super::inverse_dynamics::Link;
use super::plan::Plan;
use super::sink::{self, Columns, Sides, Wide};
use super::state::State;
use super::{articulated, derivatives, factor, gradient, inverse_dynamics, matrices, momentum};
use crate::Scalar;
use crate::lanes::LANES;

/// A state and the constants.
#[derive(Debug, Clone, Copy)]
pub struct At<'a, T> {
    pub q: &'a [T],
    pub v: &'a [T],
    pub p: &'a [f64],
}

#[inline(always)]
pub(super) fn load<T: Width, const F: bool>(to: &mut [T::Number<F>], from: &[T]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = from.lift();
    }
}

impl<T: Width> At<'_, T> {
    /// The state into the memory of its width.
    #[inline(always)]
    pub(super) fn load<'m, const F: bool>(
        &self,
        plan: &Plan,
        memory: &'m mut Memory<F>,
    ) -> &'m mut TreeMemory<T::Number<F>> {
        let memory = T::memory(memory);
        let state = &mut memory.state;
        load::<T, F>(&mut state.q, self.q);
        load::<T, F>(&mut state.v, self.v);
        for (to, from) in state.p.iter_mut().zip(self.p) {
            *to = Scalar::constant(*from);
        }
        state.turn(plan);
        memory
    }
}

impl<D: Scalar> TreeMemory<D> {
    /// Motions and sums at the loaded state.
    #[inline(always)]
    fn compose<const LEVEL: u8>(&mut self, plan: &Plan) -> (&[Axis<D>], &[Sums<D>]) {
        let TreeMemory {
            state,
            moved,
            axes,
            sums,
            ..
        } = self;
        motion::<_, LEVEL>(plan, state, moved, axes);
        composite::<_, LEVEL>(plan, state, moved, sums);
        (axes, sums)
    }

    /// Q at the loaded state.
    #[inline(always)]
    fn inverse(&mut self, plan: &Plan) -> &[D] {
        let TreeMemory {
            state,
            links,
            force,
            ..
        } = self;
        inverse_dynamics::inverse_dynamics(plan, state, links, force);
        force
    }
}

#[inline(always)]
fn store<'a, T: Width, const F: bool>(
    to: impl IntoIterator<Item = &'a mut T>,
    from: &[T::Number<F>],
) {
    for (to, from) in to.into_iter().zip(from) {
        *to = T::drop(*from);
    }
}

/// Q = M v̇ + C v + G; C v + G without v̇.
pub struct InverseDynamics<'a, T> {
    pub at: At<'a, T>,
    pub a: Option<&'a [T]>,
    pub out: &'a mut [T],
}

impl<T: Width> Kernel for InverseDynamics<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        match self.a {
            Some(a) => load::<T, F>(&mut memory.state.a, a),
            None => memory.state.a.fill(Scalar::zero()),
        }
        store::<T, F>(self.out, memory.inverse(plan));
    }
}

/// M.
pub struct MassMatrix<'a, T> {
    pub at: At<'a, T>,
    pub mass: &'a mut [T],
}

impl<T: Width> Kernel for MassMatrix<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        let (axes, sums) = memory.compose::<POSITION>(plan);
        let mut out = sink::Mass::<T, F>(Columns::square(plan, self.mass));
        matrices::mass_matrix(plan, axes, sums, &mut out);
    }
}

/// G.
pub struct GravityForce<'a, T> {
    pub at: At<'a, T>,
    pub out: &'a mut [T],
}

impl<T: Width> Kernel for GravityForce<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        memory.state.v.fill(Scalar::zero());
        memory.state.a.fill(Scalar::zero());
        store::<T, F>(self.out, memory.inverse(plan));
    }
}

/// M v.
pub struct Momentum<'a, T> {
    pub at: At<'a, T>,
    pub out: &'a mut [T],
}

impl<T: Width> Kernel for Momentum<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        let TreeMemory {
            state,
            moved,
            axes,
            momenta,
            force,
            ..
        } = memory;
        motion::<_, VELOCITY>(plan, state, moved, axes);
        momentum::momentum(plan, state, (moved, axes), momenta, force);
        store::<T, F>(self.out, force);
    }
}

/// M, C and G together.
pub struct Equations<'a, T> {
    pub at: At<'a, T>,
    pub mass: &'a mut [T],
    pub coriolis: &'a mut [T],
    pub gravity: &'a mut [T],
}

impl<T: Width> Kernel for Equations<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        let gravity = gravity(plan, &memory.state);
        let (axes, sums) = memory.compose::<VELOCITY>(plan);
        let mut out = sink::Terms::<T, F> {
            mass: Columns::square(plan, self.mass),
            coriolis: Columns::square(plan, self.coriolis),
            gravity: Columns::new(plan, self.gravity),
        };
        matrices::mass_and_coriolis(plan, axes, sums, &mut out);
        matrices::gravity_force(plan, &gravity, axes, sums, &mut out);
    }
}

/// C.
pub struct CoriolisMatrix<'a, T> {
    pub at: At<'a, T>,
    pub coriolis: &'a mut [T],
}

impl<T: Width> Kernel for CoriolisMatrix<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        let (axes, sums) = memory.compose::<VELOCITY>(plan);
        let mut out = sink::Coriolis::<T, F>(Columns::square(plan, self.coriolis));
        matrices::mass_and_coriolis(plan, axes, sums, &mut out);
    }
}

/// v̇ by articulated bodies; for joints of which none follows another.
pub struct ForwardDynamics<'a, T> {
    pub at: At<'a, T>,
    /// Q, and afterwards v̇.
    pub force: &'a mut [T],
}

impl<T: Width> Kernel for ForwardDynamics<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        load::<T, F>(&mut memory.force, self.force);
        let TreeMemory {
            state,
            moved,
            axes,
            articulated,
            force,
            ..
        } = memory;
        articulated::forward_dynamics(plan, state, moved, axes, articulated, force);
        store::<T, F>(self.force, force);
    }
}

/// v̇ through the factor of M; for joints of which none follows another.
pub struct ForwardDynamicsByMass<'a, T> {
    pub at: At<'a, T>,
    /// Q, and afterwards v̇.
    pub force: &'a mut [T],
}

impl<T: Width> Kernel for ForwardDynamicsByMass<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        load::<T, F>(&mut memory.force, self.force);
        let TreeMemory {
            state,
            links,
            force,
            moved,
            axes,
            sums,
            mass,
            rows,
            ..
        } = memory;
        accelerate(plan, state, (links, moved, axes, sums), (mass, rows), force);
        store::<T, F>(self.force, &state.a);
    }
}

/// v̇ under `force` through the factor of M, into `state.a`; the factor is left in `mass`.
#[inline(always)]
#[allow(clippy::type_complexity)]
fn accelerate<D: Scalar>(
    plan: &Plan,
    state: &mut State<D>,
    (links, moved, axes, sums): (
        &mut [Link<D>],
        &mut [Moved<D>],
        &mut [Axis<D>],
        &mut [Sums<D>],
    ),
    (mass, rows): (&mut [D], &mut [D]),
    force: &[D],
) {
    let n = plan.dofs.len();
    state.a.fill(D::zero());
    let (bias, rows) = rows.split_at_mut(n);
    let (whole, rows) = rows.split_at_mut(n);
    inverse_dynamics::inverse_dynamics(plan, state, links, bias);
    motion::<_, POSITION>(plan, state, moved, axes);
    composite::<_, POSITION>(plan, state, moved, sums);
    mass_by_dofs(plan, axes, sums, mass);
    factor::factor(plan, mass, whole);
    for (row, dof) in rows.iter_mut().zip(&plan.dofs) {
        *row = force[dof.v] - bias[dof.v];
    }
    factor::solve(plan, mass, &mut rows[..n], 1);
    for (row, dof) in rows.iter().zip(&plan.dofs) {
        state.a[dof.v] = *row;
    }
}

/// M in the order of the degrees of freedom, row after row: the diagonal and what is below it.
#[inline(always)]
fn mass_by_dofs<D: Scalar>(plan: &Plan, axes: &[Axis<D>], sums: &[Sums<D>], mass: &mut [D]) {
    let n = plan.dofs.len();
    for (k, dof) in plan.dofs.iter().enumerate() {
        let momentum = sums[dof.body].of_motion(&axes[k].s);
        let mut at = Some(k);
        while let Some(j) = at {
            mass[k * n + j] = axes[j].s.dot(&momentum);
            at = plan.dofs[j].above;
        }
    }
}

/// ∂Q/∂q and ∂Q/∂v of the inverse dynamics.
pub struct InverseDerivatives<'a, T> {
    pub at: At<'a, T>,
    pub a: &'a [T],
    pub by_q: &'a mut [T],
    pub by_v: &'a mut [T],
}

impl<T: Width> Kernel for InverseDerivatives<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        load::<T, F>(&mut memory.state.a, self.a);
        let (axes, sums) = memory.compose::<ACCELERATION>(plan);
        let mut out = sink::Derivatives::<T, F> {
            plan,
            by_q: Columns::square(plan, self.by_q),
            by_v: Columns::square(plan, self.by_v),
        };
        derivatives::inverse_dynamics(plan, axes, sums, &mut out);
    }
}

/// v̇ and its derivatives; for joints of which none follows another.
pub struct ForwardDerivatives<'a> {
    pub at: At<'a, f64>,
    /// Q, and afterwards v̇.
    pub force: &'a mut [f64],
    pub by_q: &'a mut [f64],
    pub by_v: &'a mut [f64],
    pub by_force: &'a mut [f64],
}

impl Kernel for ForwardDerivatives<'_> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let n = plan.dofs.len();
        self.at.load::<F>(plan, memory);
        let Memory { one, sides, .. } = memory;
        let TreeMemory {
            state,
            links,
            moved,
            axes,
            sums,
            force,
            mass,
            rows,
            ..
        } = one;
        load::<f64, F>(force, self.force);
        accelerate(plan, state, (links, moved, axes, sums), (mass, rows), force);
        for (to, from) in self.force.iter_mut().zip(&state.a) {
            *to = from.0;
        }
        // −∂Q/∂q, −∂Q/∂v and 1, row after row, under M⁻¹.
        motion::<_, ACCELERATION>(plan, state, moved, axes);
        composite::<_, ACCELERATION>(plan, state, moved, sums);
        let mut out = Sides::<F>::new(plan, sides);
        derivatives::inverse_dynamics(plan, axes, sums, &mut out);
        let width = Sides::<F>::width(plan);
        factor::solve(plan, mass, sides, width);
        for (i, row) in plan.dofs.iter().zip(sides.chunks_exact(width)) {
            for (k, j) in plan.dofs.iter().enumerate() {
                let to = j.v * n + i.v;
                self.by_q[to] = row[k / LANES].0[k % LANES];
                self.by_v[to] = row[(n + k) / LANES].0[(n + k) % LANES];
                self.by_force[to] = row[(2 * n + k) / LANES].0[(2 * n + k) % LANES];
            }
        }
    }
}

/// [`ForwardDerivatives`] of eight states, in memory that has [grown](super::Machine::grow).
pub struct ForwardDerivativesOfEight<'a> {
    pub at: At<'a, [f64; LANES]>,
    /// Q, and afterwards v̇.
    pub force: &'a mut [[f64; LANES]],
    pub by_q: &'a mut [[f64; LANES]],
    pub by_v: &'a mut [[f64; LANES]],
    pub by_force: &'a mut [[f64; LANES]],
}

impl Kernel for ForwardDerivativesOfEight<'_> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let n = plan.dofs.len();
        self.at.load::<F>(plan, memory);
        let Memory { eight, wide, .. } = memory;
        let TreeMemory {
            state,
            links,
            moved,
            axes,
            sums,
            force,
            mass,
            rows,
            ..
        } = eight;
        load::<[f64; LANES], F>(force, self.force);
        accelerate(plan, state, (links, moved, axes, sums), (mass, rows), force);
        store::<[f64; LANES], F>(self.force, &state.a);
        motion::<_, ACCELERATION>(plan, state, moved, axes);
        composite::<_, ACCELERATION>(plan, state, moved, sums);
        let mut out = Wide::<F>::new(plan, wide);
        derivatives::inverse_dynamics(plan, axes, sums, &mut out);
        factor::solve(plan, mass, wide, 3 * n);
        for (i, row) in plan.dofs.iter().zip(wide.chunks_exact(3 * n)) {
            for (k, j) in plan.dofs.iter().enumerate() {
                let to = j.v * n + i.v;
                self.by_q[to] = row[k].0;
                self.by_v[to] = row[n + k].0;
                self.by_force[to] = row[2 * n + k].0;
            }
        }
    }
}

/// ∂Q/∂p of the inverse dynamics in some factors on masses, one column each: what the body's own wrench does along the joints
/// that carry it.
pub struct ByMassScale<'a, T> {
    pub at: At<'a, T>,
    pub a: &'a [T],
    pub constants: &'a [usize],
    pub out: &'a mut [T],
}

impl<T: Width> Kernel for ByMassScale<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        load::<T, F>(&mut memory.state.a, self.a);
        let TreeMemory {
            state, moved, axes, ..
        } = memory;
        motion::<_, ACCELERATION>(plan, state, moved, axes);
        self.out.fill(T::default());
        for (i, body) in plan.bodies.iter().enumerate() {
            let wanted = |c: &usize| Some(*c) == body.parameter;
            let Some(column) = self.constants.iter().position(wanted) else {
                continue;
            };
            let alone = Sums::of::<ACCELERATION>(body, &moved[i], Scalar::constant(1.0));
            let mut at = Some(body.first + body.freedom.dof() - 1);
            while let Some(j) = at {
                let dof = &plan.dofs[j];
                let entry = axes[j].s.dot(&alone.wrench) * dof.ratio;
                let to = &mut self.out[column * plan.nv + dof.v];
                *to = T::drop(to.lift::<F>() + entry);
                at = dof.above;
            }
        }
    }
}

/// M⁻¹ times a vector, with the factor that [`ForwardDerivatives`] or [`ForwardDynamicsByMass`] has left.
pub struct Solve<'a, T> {
    pub rhs: &'a mut [T],
}

impl<T: Width> Kernel for Solve<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let TreeMemory { mass, rows, .. } = T::memory(memory);
        let rows = &mut rows[..plan.dofs.len()];
        for (row, dof) in rows.iter_mut().zip(&plan.dofs) {
            *row = self.rhs[dof.v].lift();
        }
        factor::solve(plan, mass, rows, 1);
        for (row, dof) in rows.iter().zip(&plan.dofs) {
            self.rhs[dof.v] = T::drop(*row);
        }
    }
}

/// λᵀ ∂Q/∂(q, v, v̇, p) of the inverse dynamics.
pub struct InverseGradient<'a, T> {
    pub at: At<'a, T>,
    pub a: &'a [T],
    pub weight: &'a [T],
    pub by_q: &'a mut [T],
    pub by_v: &'a mut [T],
    pub by_a: &'a mut [T],
    pub by_p: &'a mut [T],
}

impl<T: Width> Kernel for InverseGradient<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        load::<T, F>(&mut memory.state.a, self.a);
        load::<T, F>(&mut memory.force, self.weight);
        let TreeMemory {
            state,
            moved,
            axes,
            weighed,
            force,
            rows,
            ..
        } = memory;
        motion::<_, ACCELERATION>(plan, state, moved, axes);
        let products = weigh(plan, state, (moved, axes), force, weighed, rows);
        let outs = [self.by_q, self.by_v, self.by_a, self.by_p];
        store::<T, F>(outs.into_iter().flatten(), products);
    }
}

/// The products one after the other at the start of `rows`.
#[inline(always)]
fn weigh<'a, D: Scalar>(
    plan: &Plan,
    state: &State<D>,
    (moved, axes): (&[Moved<D>], &[Axis<D>]),
    weight: &[D],
    weighed: &mut [Weighed<D>],
    rows: &'a mut [D],
) -> &'a [D] {
    let n = plan.nv;
    let (by_q, rest) = rows.split_at_mut(n);
    let (by_v, rest) = rest.split_at_mut(n);
    let (by_a, rest) = rest.split_at_mut(n);
    let out = gradient::Products {
        by_q,
        by_v,
        by_a,
        by_p: &mut rest[..plan.np],
    };
    gradient::inverse_dynamics(plan, state, (moved, axes), weight, weighed, out);
    &rows[..3 * n + plan.np]
}

/// v̇ and wᵀ ∂v̇/∂(q, v, Q, p); for joints of which none follows another.
///
/// With λ = M⁻¹ w: wᵀ ∂v̇/∂x = −λᵀ ∂Q/∂x at fixed v̇, and wᵀ ∂v̇/∂Q = λᵀ. Both v̇ and λ are from the same articulated bodies, or with
/// [`FEW`] degrees of freedom from the same factor of M, as v̇ of the forward dynamics is.
pub struct ForwardGradient<'a, T> {
    pub at: At<'a, T>,
    /// Q, and afterwards v̇.
    pub force: &'a mut [T],
    pub weight: &'a [T],
    pub by_q: &'a mut [T],
    pub by_v: &'a mut [T],
    pub by_force: &'a mut [T],
    pub by_p: &'a mut [T],
}

impl<T: Width> Kernel for ForwardGradient<'_, T> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let n = plan.dofs.len();
        let memory = self.at.load::<F>(plan, memory);
        let TreeMemory {
            state,
            links,
            moved,
            axes,
            sums,
            articulated,
            weighed,
            momenta,
            force,
            mass,
            rows,
        } = memory;
        load::<T, F>(force, self.force);
        if n <= FEW {
            accelerate(plan, state, (links, moved, axes, sums), (mass, rows), force);
            store::<T, F>(self.force, &state.a);
            for (row, dof) in rows.iter_mut().zip(&plan.dofs) {
                *row = self.weight[dof.v].lift();
            }
            factor::solve(plan, mass, &mut rows[..n], 1);
            for (row, dof) in rows.iter().zip(&plan.dofs) {
                force[dof.v] = *row;
            }
            motion::<_, ACCELERATION>(plan, state, moved, axes);
        } else {
            articulated::forward_dynamics(plan, state, moved, axes, articulated, force);
            store::<T, F>(self.force, force);
            load::<T, F>(force, self.weight);
            articulated::solve(plan, moved, axes, articulated, momenta, force);
            sweep_rates(plan, state, moved, axes);
        }
        store::<T, F>(self.by_force, force);
        let products = weigh(plan, state, (moved, axes), force, weighed, rows);
        let (by_state, by_p) = (&products[..2 * n], &products[3 * n..]);
        for (to, from) in self.by_q.iter_mut().chain(self.by_v).zip(by_state) {
            *to = T::drop(-*from);
        }
        for (to, from) in self.by_p.iter_mut().zip(by_p) {
            *to = T::drop(-*from);
        }
    }
}
