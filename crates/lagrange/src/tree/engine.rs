//! The algorithms of one tree, called with plain numbers.

use nalgebra::{DMatrix, DVector};

use super::dispatch::{FEW, Machine};
use super::kernels::{
    At, ByMassScale, CoriolisMatrix, Equations, ForwardDerivatives, ForwardDynamics,
    ForwardDynamicsByMass, ForwardGradient, GravityForce, InverseDerivatives, InverseDynamics,
    InverseGradient, MassMatrix,
};
use super::plan::Plan;
use crate::mechanism::Tree;
use crate::{
    ForwardDynamicsDerivatives, ForwardDynamicsGradient, InverseDynamicsDerivatives,
    InverseDynamicsGradient, LANES,
};

/// The equations of motion of one tree of rigid bodies.
#[derive(Debug, Clone)]
pub struct Engine {
    plan: Plan,
}

impl Engine {
    pub fn of(tree: &Tree) -> Self {
        Engine {
            plan: Plan::of(tree),
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

    pub fn mass_matrix(&self, at: At<f64>, machine: &mut Machine, out: &mut DMatrix<f64>) {
        let mass = out.as_mut_slice();
        machine.run(&self.plan, MassMatrix { at, mass });
    }

    pub fn mass_matrix_lanes(
        &self,
        at: At<[f64; LANES]>,
        machine: &mut Machine,
        mass: &mut [[f64; LANES]],
    ) {
        machine.run(&self.plan, MassMatrix { at, mass });
    }

    pub fn coriolis_matrix(&self, at: At<f64>, machine: &mut Machine, out: &mut DMatrix<f64>) {
        let coriolis = out.as_mut_slice();
        machine.run(&self.plan, CoriolisMatrix { at, coriolis });
    }

    pub fn gravity_force(&self, at: At<f64>, machine: &mut Machine, out: &mut DVector<f64>) {
        let out = out.as_mut_slice();
        machine.run(&self.plan, GravityForce { at, out });
    }

    pub fn equations(
        &self,
        at: At<f64>,
        machine: &mut Machine,
        mass: &mut DMatrix<f64>,
        coriolis: &mut DMatrix<f64>,
        gravity: &mut DVector<f64>,
    ) {
        let kernel = Equations {
            at,
            mass: mass.as_mut_slice(),
            coriolis: coriolis.as_mut_slice(),
            gravity: gravity.as_mut_slice(),
        };
        machine.run(&self.plan, kernel);
    }

    /// Q, or the bias force without an acceleration.
    pub fn inverse_dynamics(
        &self,
        at: At<f64>,
        a: Option<&[f64]>,
        machine: &mut Machine,
        out: &mut [f64],
    ) {
        machine.run(&self.plan, InverseDynamics { at, a, out });
    }

    pub fn inverse_dynamics_lanes(
        &self,
        at: At<[f64; LANES]>,
        a: &[[f64; LANES]],
        machine: &mut Machine,
        out: &mut [[f64; LANES]],
    ) {
        let a = Some(a);
        machine.run(&self.plan, InverseDynamics { at, a, out });
    }

    /// v̇ in place of Q; not finite where there is none.
    pub fn forward_dynamics(&self, at: At<f64>, machine: &mut Machine, force: &mut [f64]) {
        if self.plan.dofs.len() <= FEW {
            machine.run(&self.plan, ForwardDynamicsByMass { at, force });
        } else {
            machine.run(&self.plan, ForwardDynamics { at, force });
        }
    }

    pub fn forward_dynamics_lanes(
        &self,
        at: At<[f64; LANES]>,
        machine: &mut Machine,
        force: &mut [[f64; LANES]],
    ) {
        if self.plan.dofs.len() <= FEW {
            machine.run(&self.plan, ForwardDynamicsByMass { at, force });
        } else {
            machine.run(&self.plan, ForwardDynamics { at, force });
        }
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
            machine.run(&self.plan, super::kernels::Solve { rhs: column });
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
