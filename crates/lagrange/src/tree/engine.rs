//! The algorithms of one tree, called with plain numbers.

use super::dispatch::{FEW, Machine, Width};
use super::kernels::{
    At, ByMassScale, CoriolisMatrix, Equations, ForwardDerivatives, ForwardDynamics,
    ForwardDynamicsByMass, ForwardGradient, GravityForce, InverseDerivatives, InverseDynamics,
    InverseGradient, MassMatrix, Momentum, Solve,
};
use super::plan::Plan;
use super::regressor::{Place, UnitForces};
use crate::mechanism::Tree;
use crate::{
    ForwardDynamicsDerivatives, ForwardDynamicsGradient, InverseDynamicsDerivatives,
    InverseDynamicsGradient,
};

/// The equations of motion of one tree of rigid bodies.
#[derive(Debug, Clone)]
pub struct Engine {
    plan: Plan,
    /// The links that move.
    places: Vec<Place>,
}

impl Engine {
    pub fn of(tree: &Tree) -> Self {
        Engine {
            plan: Plan::of(tree),
            places: Place::of(tree),
        }
    }

    /// Memory for one thread.
    pub fn machine(&self) -> Machine {
        Machine::new(&self.plan)
    }

    /// Whether forward dynamics and its derivatives work joint by joint: no joint follows another.
    pub fn is_independent(&self) -> bool {
        self.plan.independent
    }

    pub fn mass_matrix<T: Width>(&self, at: At<T>, machine: &mut Machine, mass: &mut [T]) {
        machine.run(&self.plan, MassMatrix { at, mass });
    }

    pub fn coriolis_matrix<T: Width>(&self, at: At<T>, machine: &mut Machine, coriolis: &mut [T]) {
        machine.run(&self.plan, CoriolisMatrix { at, coriolis });
    }

    pub fn gravity_force<T: Width>(&self, at: At<T>, machine: &mut Machine, out: &mut [T]) {
        machine.run(&self.plan, GravityForce { at, out });
    }

    pub fn equations<T: Width>(
        &self,
        at: At<T>,
        machine: &mut Machine,
        mass: &mut [T],
        coriolis: &mut [T],
        gravity: &mut [T],
    ) {
        let kernel = Equations {
            at,
            mass,
            coriolis,
            gravity,
        };
        machine.run(&self.plan, kernel);
    }

    /// M v.
    pub fn momentum<T: Width>(&self, at: At<T>, machine: &mut Machine, out: &mut [T]) {
        machine.run(&self.plan, Momentum { at, out });
    }

    /// Q, or the bias force without an acceleration.
    pub fn inverse_dynamics<T: Width>(
        &self,
        at: At<T>,
        a: Option<&[T]>,
        machine: &mut Machine,
        out: &mut [T],
    ) {
        machine.run(&self.plan, InverseDynamics { at, a, out });
    }

    /// v̇ in place of Q; not finite where there is none.
    pub fn forward_dynamics<T: Width>(&self, at: At<T>, machine: &mut Machine, force: &mut [T]) {
        if self.plan.dofs.len() <= FEW {
            machine.run(&self.plan, ForwardDynamicsByMass { at, force });
        } else {
            machine.run(&self.plan, ForwardDynamics { at, force });
        }
    }

    /// The same through the factor of M, which is left in the memory for [`solve`](Self::solve).
    pub fn forward_dynamics_by_mass(&self, at: At<f64>, machine: &mut Machine, force: &mut [f64]) {
        machine.run(&self.plan, ForwardDynamicsByMass { at, force });
    }

    /// M⁻¹ times each of some columns, with the factor that is left in the memory.
    pub fn solve<T: Width>(&self, machine: &mut Machine, columns: &mut [T]) {
        for rhs in columns.chunks_exact_mut(self.plan.nv.max(1)) {
            machine.run(&self.plan, Solve { rhs });
        }
    }

    /// Q for each unit inertial parameter of each moving link, or of one of them, column after column. With the index of a moving link.
    pub fn unit_forces(
        &self,
        at: At<f64>,
        a: &[f64],
        link: Option<usize>,
        machine: &mut Machine,
        out: &mut [f64],
    ) {
        let one = link.map(|link| self.places.partition_point(|place| place.link < link));
        let places = match one {
            Some(k) => &self.places[k..=k],
            None => &self.places,
        };
        let kernel = UnitForces { at, a, places, out };
        machine.run(&self.plan, kernel);
    }

    pub fn inverse_derivatives(
        &self,
        at: At<f64>,
        a: &[f64],
        constants: &[usize],
        machine: &mut Machine,
        out: &mut InverseDynamicsDerivatives,
    ) {
        let kernel = InverseDerivatives {
            at,
            a,
            by_q: out.by_q.as_mut_slice(),
            by_v: out.by_v.as_mut_slice(),
        };
        machine.run(&self.plan, kernel);
        self.by_mass_scale(at, a, constants, machine, out.by_p.as_mut_slice());
    }

    fn by_mass_scale(
        &self,
        at: At<f64>,
        a: &[f64],
        constants: &[usize],
        machine: &mut Machine,
        out: &mut [f64],
    ) {
        if !constants.is_empty() {
            let kernel = ByMassScale {
                at,
                a,
                constants,
                out,
            };
            machine.run(&self.plan, kernel);
        }
    }

    /// v̇ in place of Q, which `out.acceleration` holds, and its derivatives; not finite where there is none.
    pub fn forward_derivatives(
        &self,
        at: At<f64>,
        constants: &[usize],
        machine: &mut Machine,
        out: &mut ForwardDynamicsDerivatives,
    ) {
        let kernel = ForwardDerivatives {
            at,
            force: out.acceleration.as_mut_slice(),
            by_q: out.by_q.as_mut_slice(),
            by_v: out.by_v.as_mut_slice(),
            by_force: out.by_force.as_mut_slice(),
        };
        machine.run(&self.plan, kernel);
        let a = out.acceleration.as_slice();
        self.by_mass_scale(at, a, constants, machine, out.by_p.as_mut_slice());
        // ∂v̇/∂p = −M⁻¹ ∂Q/∂p, a column at a time.
        let n = self.plan.nv;
        for k in 0..constants.len() {
            let column = &mut out.by_p.as_mut_slice()[k * n..(k + 1) * n];
            column.iter_mut().for_each(|x| *x = -*x);
            machine.run(&self.plan, Solve { rhs: column });
        }
    }

    /// λᵀ ∂Q/∂(q, v, v̇, p).
    pub fn inverse_gradient(
        &self,
        at: At<f64>,
        a: &[f64],
        weight: &[f64],
        machine: &mut Machine,
        out: &mut InverseDynamicsGradient,
    ) {
        let kernel = InverseGradient {
            at,
            a,
            weight,
            by_q: out.by_q.as_mut_slice(),
            by_v: out.by_v.as_mut_slice(),
            by_a: out.by_a.as_mut_slice(),
            by_p: out.by_p.as_mut_slice(),
        };
        machine.run(&self.plan, kernel);
    }

    /// v̇ in place of Q, which `out.acceleration` holds, and wᵀ ∂v̇/∂(q, v, Q, p); not finite where there is none.
    pub fn forward_gradient(
        &self,
        at: At<f64>,
        weight: &[f64],
        machine: &mut Machine,
        out: &mut ForwardDynamicsGradient,
    ) {
        let kernel = ForwardGradient {
            at,
            force: out.acceleration.as_mut_slice(),
            weight,
            by_q: out.by_q.as_mut_slice(),
            by_v: out.by_v.as_mut_slice(),
            by_force: out.by_force.as_mut_slice(),
            by_p: out.by_p.as_mut_slice(),
        };
        machine.run(&self.plan, kernel);
    }
}
