//! The algorithms of one tree, called with plain numbers.

use super::dispatch::{FEW, Machine, Width};
use super::kernels::{
    At, ByMassScale, CoriolisMatrix, Equations, ForwardDerivatives, ForwardDerivativesOfEight,
    ForwardDynamics, ForwardDynamicsByMass, ForwardGradient, GravityForce, InverseDerivatives,
    InverseDynamics, InverseGradient, MassMatrix, Momentum, Solve,
};
use super::plan::Plan;
use super::regressor::{Place, UnitForces};
use crate::mechanism::Tree;
use crate::{
    ForwardDynamicsDerivatives, ForwardDynamicsGradient, InverseDynamicsDerivatives,
    InverseDynamicsGradient, LANES,
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

    /// The same through the factor of M, which is left in the memory for [`solve`](Algorithms::solve).
    pub fn forward_dynamics_by_mass(&self, at: At<f64>, machine: &mut Machine, force: &mut [f64]) {
        machine.run(&self.plan, ForwardDynamicsByMass { at, force });
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
        self.forward_by_mass_scale(at, constants, machine, out);
    }

    /// The same of eight states.
    pub fn forward_derivatives_lanes(
        &self,
        at: At<[f64; LANES]>,
        constants: &[usize],
        machine: &mut Machine,
        out: &mut ForwardDynamicsDerivatives<[f64; LANES]>,
    ) {
        machine.grow(&self.plan);
        let kernel = ForwardDerivativesOfEight {
            at,
            force: out.acceleration.as_mut_slice(),
            by_q: out.by_q.as_mut_slice(),
            by_v: out.by_v.as_mut_slice(),
            by_force: out.by_force.as_mut_slice(),
        };
        machine.run(&self.plan, kernel);
        self.forward_by_mass_scale(at, constants, machine, out);
    }
}

/// The algorithms for one state or eight.
///
/// Written out for both below, so that they are compiled once, in this crate, and not again for every mechanism that calls them.
pub trait Algorithms<T> {
    fn mass_matrix(&self, at: At<T>, machine: &mut Machine, mass: &mut [T]);

    fn coriolis_matrix(&self, at: At<T>, machine: &mut Machine, coriolis: &mut [T]);

    fn gravity_force(&self, at: At<T>, machine: &mut Machine, out: &mut [T]);

    fn equations(
        &self,
        at: At<T>,
        machine: &mut Machine,
        mass: &mut [T],
        coriolis: &mut [T],
        gravity: &mut [T],
    );

    /// M v.
    fn momentum(&self, at: At<T>, machine: &mut Machine, out: &mut [T]);

    /// Q, or the bias force without an acceleration.
    fn inverse_dynamics(&self, at: At<T>, a: Option<&[T]>, machine: &mut Machine, out: &mut [T]);

    /// v̇ in place of Q; not finite where there is none.
    fn forward_dynamics(&self, at: At<T>, machine: &mut Machine, force: &mut [T]);

    /// M⁻¹ times each of some columns, with the factor that is left in the memory.
    fn solve(&self, machine: &mut Machine, columns: &mut [T]);

    fn inverse_derivatives(
        &self,
        at: At<T>,
        a: &[T],
        constants: &[usize],
        machine: &mut Machine,
        out: &mut InverseDynamicsDerivatives<T>,
    );

    fn by_mass_scale(
        &self,
        at: At<T>,
        a: &[T],
        constants: &[usize],
        machine: &mut Machine,
        out: &mut [T],
    );

    /// ∂v̇/∂p = −M⁻¹ ∂Q/∂p at the v̇ that is there, with the factor that is left in the memory.
    fn forward_by_mass_scale(
        &self,
        at: At<T>,
        constants: &[usize],
        machine: &mut Machine,
        out: &mut ForwardDynamicsDerivatives<T>,
    );

    /// λᵀ ∂Q/∂(q, v, v̇, p).
    fn inverse_gradient(
        &self,
        at: At<T>,
        a: &[T],
        weight: &[T],
        machine: &mut Machine,
        out: &mut InverseDynamicsGradient<T>,
    );

    /// v̇ in place of Q, which `out.acceleration` holds, and wᵀ ∂v̇/∂(q, v, Q, p); not finite where there is none.
    fn forward_gradient(
        &self,
        at: At<T>,
        weight: &[T],
        machine: &mut Machine,
        out: &mut ForwardDynamicsGradient<T>,
    );
}

macro_rules! algorithms {
    ($number:ty) => {
        impl Algorithms<$number> for Engine {
            fn mass_matrix(&self, at: At<$number>, machine: &mut Machine, mass: &mut [$number]) {
                machine.run(&self.plan, MassMatrix { at, mass });
            }

            fn coriolis_matrix(
                &self,
                at: At<$number>,
                machine: &mut Machine,
                coriolis: &mut [$number],
            ) {
                machine.run(&self.plan, CoriolisMatrix { at, coriolis });
            }

            fn gravity_force(&self, at: At<$number>, machine: &mut Machine, out: &mut [$number]) {
                machine.run(&self.plan, GravityForce { at, out });
            }

            fn equations(
                &self,
                at: At<$number>,
                machine: &mut Machine,
                mass: &mut [$number],
                coriolis: &mut [$number],
                gravity: &mut [$number],
            ) {
                let kernel = Equations {
                    at,
                    mass,
                    coriolis,
                    gravity,
                };
                machine.run(&self.plan, kernel);
            }

            fn momentum(&self, at: At<$number>, machine: &mut Machine, out: &mut [$number]) {
                machine.run(&self.plan, Momentum { at, out });
            }

            fn inverse_dynamics(
                &self,
                at: At<$number>,
                a: Option<&[$number]>,
                machine: &mut Machine,
                out: &mut [$number],
            ) {
                machine.run(&self.plan, InverseDynamics { at, a, out });
            }

            fn forward_dynamics(
                &self,
                at: At<$number>,
                machine: &mut Machine,
                force: &mut [$number],
            ) {
                if self.plan.dofs.len() <= FEW {
                    machine.run(&self.plan, ForwardDynamicsByMass { at, force });
                } else {
                    machine.run(&self.plan, ForwardDynamics { at, force });
                }
            }

            fn solve(&self, machine: &mut Machine, columns: &mut [$number]) {
                for rhs in columns.chunks_exact_mut(self.plan.nv.max(1)) {
                    machine.run(&self.plan, Solve { rhs });
                }
            }

            fn inverse_derivatives(
                &self,
                at: At<$number>,
                a: &[$number],
                constants: &[usize],
                machine: &mut Machine,
                out: &mut InverseDynamicsDerivatives<$number>,
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
                at: At<$number>,
                a: &[$number],
                constants: &[usize],
                machine: &mut Machine,
                out: &mut [$number],
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

            fn forward_by_mass_scale(
                &self,
                at: At<$number>,
                constants: &[usize],
                machine: &mut Machine,
                out: &mut ForwardDynamicsDerivatives<$number>,
            ) {
                let (a, by_p) = (out.acceleration.as_slice(), out.by_p.as_mut_slice());
                self.by_mass_scale(at, a, constants, machine, by_p);
                let columns = &mut by_p[..constants.len() * self.plan.nv];
                columns.iter_mut().for_each(|x| *x = x.negated());
                self.solve(machine, columns);
            }

            fn inverse_gradient(
                &self,
                at: At<$number>,
                a: &[$number],
                weight: &[$number],
                machine: &mut Machine,
                out: &mut InverseDynamicsGradient<$number>,
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

            fn forward_gradient(
                &self,
                at: At<$number>,
                weight: &[$number],
                machine: &mut Machine,
                out: &mut ForwardDynamicsGradient<$number>,
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
    };
}

algorithms!(f64);
algorithms!([f64; LANES]);
