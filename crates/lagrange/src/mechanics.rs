//! What a mechanism gives, whatever its energies were written in.

use nalgebra::{DMatrix, DVector};

use crate::constraint::Holonomic;
use crate::equations::{Linear, PowerBalance, Workspace, gradient, linear, one_by_one, power};
use crate::{Coordinate, Error, LANES, Parameter, state};
use crate::{Formulas, FormulasError};
use crate::{ForwardDynamicsDerivatives, ForwardDynamicsGradient};
use crate::{InverseDynamicsDerivatives, InverseDynamicsGradient};

/// The equations of motion of one mechanism: M(q) v̇ + C(q, v) v + G(q) = Q.
///
/// Immutable and shared; what changes is in the [`Workspace`] of each thread. Allocating calls take the nominal constants
/// and check their arguments; an `_into` twin takes the constants `p` (as many as [`parameters`](Self::parameters)), checks
/// nothing, allocates nothing, and panics when a slice has the wrong length.
///
/// q in m or rad, v in m/s or rad/s, forces in N or N·m, energies in J.
pub trait Mechanics: Send + Sync {
    /// The coordinates, in the order of q and v.
    fn coordinates(&self) -> &[Coordinate];

    /// The constants that a fit may move.
    fn parameters(&self) -> &[Parameter];

    /// Scratch memory for the `_into` calls.
    fn workspace(&self) -> Workspace;

    /// T(q, v), J.
    fn kinetic_energy_with(&self, q: &[f64], v: &[f64], p: &[f64]) -> f64;

    /// V(q), J.
    fn potential_energy_with(&self, q: &[f64], p: &[f64]) -> f64;

    /// M(q), symmetric, all of it filled. For T not quadratic in v it is M(q, 0).
    fn mass_matrix_into(&self, q: &[f64], p: &[f64], work: &mut Workspace, out: &mut DMatrix<f64>);

    /// M(q, v) = ∂²T/∂v∂v at the state, for T quadratic in v or not: what v̇ is multiplied by in M v̇ + C v + G = Q. Column k is what a
    /// unit of v̇_k adds to Q.
    fn mass_matrix_at_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) {
        let n = self.nv();
        let (mut a, mut bias, mut force) = (vec![0.0; n], DVector::zeros(n), DVector::zeros(n));
        self.bias_force_into(q, v, p, work, &mut bias);
        for (k, mut column) in out.column_iter_mut().enumerate() {
            a.fill(0.0);
            a.iter_mut().skip(k).take(1).for_each(|a| *a = 1.0);
            self.inverse_dynamics_into(q, v, &a, p, work, &mut force);
            column.copy_from(&force);
            column -= &bias;
        }
    }

    /// The Christoffel matrix C(q, v), for which Ṁ − 2C is skew. Defined for T quadratic in v.
    fn coriolis_matrix_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    );

    /// G(q) = +∂V/∂q, on the left-hand side.
    fn gravity_force_into(
        &self,
        q: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    );

    /// C v + G, on the left-hand side.
    fn bias_force_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    );

    /// Q = M v̇ + C v + G for v̇ = `a`.
    fn inverse_dynamics_into(
        &self,
        q: &[f64],
        v: &[f64],
        a: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    );

    /// The generalized momenta ∂T/∂v, for T quadratic in v or not: M v where it is.
    fn momentum_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    );

    /// M, C and G at once.
    #[allow(clippy::too_many_arguments)]
    fn equations_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        mass: &mut DMatrix<f64>,
        coriolis: &mut DMatrix<f64>,
        gravity: &mut DVector<f64>,
    ) {
        self.mass_matrix_into(q, p, work, mass);
        self.coriolis_matrix_into(q, v, p, work, coriolis);
        self.gravity_force_into(q, p, work, gravity);
    }

    /// v̇ from M v̇ = Q − C v − G: `out` holds Q and becomes v̇.
    fn forward_dynamics_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) -> Result<(), Error>;

    /// Derivatives of the inverse dynamics at (q, v, v̇ = a) in q, v and the constants with the given indices. For T quadratic
    /// in v or not; where a joint floats, those in q are along its velocities.
    #[allow(clippy::too_many_arguments)]
    fn inverse_dynamics_derivatives_into(
        &self,
        q: &[f64],
        v: &[f64],
        a: &[f64],
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        out: &mut InverseDynamicsDerivatives,
    );

    /// v̇ and its derivatives in q, v, the generalized force Q = `force` and the constants with the given indices:
    ///
    /// ∂v̇/∂x = −M⁻¹ ∂(M v̇ + C v + G)/∂x at fixed v̇, and ∂v̇/∂Q = M⁻¹. The v̇ is that of
    /// [`forward_dynamics_into`](Self::forward_dynamics_into), on large trees to rounding.
    #[allow(clippy::too_many_arguments)]
    fn forward_dynamics_derivatives_into(
        &self,
        q: &[f64],
        v: &[f64],
        force: &[f64],
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        out: &mut ForwardDynamicsDerivatives,
    ) -> Result<(), Error>;

    /// How the work of the generalized force Q = `force` goes into the two energies at this state, W.
    ///
    /// With the v̇ of the forward dynamics: dV/dt = v · G, dT/dt = v · (M v̇ + C v), and their sum is Q · v. For T not quadratic in v,
    /// the second is the rate of v · ∂T/∂v − T, which then takes T's place in the energy that stays.
    ///
    /// # Errors
    /// Those of the forward dynamics.
    fn power_balance_with(
        &self,
        q: &[f64],
        v: &[f64],
        force: &[f64],
        p: &[f64],
        work: &mut Workspace,
    ) -> Result<PowerBalance, Error> {
        power::balance(self, (q, v, force), p, work)
    }

    /// The linear system ẋ = A x + B Q around the state (q, v) under Q = `force`, for x = (δq, δv): A = [0, 1; ∂v̇/∂q, ∂v̇/∂v],
    /// B = [0; ∂v̇/∂Q], 2 nv × 2 nv and 2 nv × nv.
    ///
    /// Where a joint floats, δq is a displacement along its velocities, in axes that turn with the body: the block of A that is 0 is
    /// there −ad(v), with −ω× for both halves and −v× from the angular half to the linear one.
    ///
    /// # Errors
    /// Those of the forward dynamics; `out` is then of no use.
    fn linearize_into(
        &self,
        q: &[f64],
        v: &[f64],
        force: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut Linear,
    ) -> Result<(), Error> {
        linear::linearize(self, (q, v, force), p, work, out)
    }

    /// λᵀ ∂Q/∂(q, v, v̇, p) of the inverse dynamics at (q, v, v̇ = a), for the row λ = `weight`: for a tree at the cost of a few
    /// inverse dynamics, else from [`inverse_dynamics_derivatives_into`](Self::inverse_dynamics_derivatives_into).
    #[allow(clippy::too_many_arguments)]
    fn inverse_dynamics_gradient_into(
        &self,
        q: &[f64],
        v: &[f64],
        a: &[f64],
        p: &[f64],
        weight: &[f64],
        work: &mut Workspace,
        out: &mut InverseDynamicsGradient,
    ) {
        gradient::of_inverse_dynamics(self, (q, v, a), p, weight, work, out);
    }

    /// v̇ and wᵀ ∂v̇/∂(q, v, Q, p) under Q = `force`, for the row w = `weight`; as
    /// [`inverse_dynamics_gradient_into`](Self::inverse_dynamics_gradient_into).
    #[allow(clippy::too_many_arguments)]
    fn forward_dynamics_gradient_into(
        &self,
        q: &[f64],
        v: &[f64],
        force: &[f64],
        p: &[f64],
        weight: &[f64],
        work: &mut Workspace,
        out: &mut ForwardDynamicsGradient,
    ) -> Result<(), Error> {
        gradient::of_forward_dynamics(self, (q, v, force), p, weight, work, out)
    }

    /// [`inverse_dynamics_into`](Self::inverse_dynamics_into) of eight states: lane k of every entry is state k.
    ///
    /// As all calls for eight states: side by side in the processor's vectors for a tree and for energies that are traced to programs
    /// (see [`Dynamics`](crate::Dynamics)), one state after the other else.
    fn inverse_dynamics_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        a: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        one_by_one::inverse_dynamics(self, (q, v, a), p, work, out);
    }

    /// [`forward_dynamics_into`](Self::forward_dynamics_into) of eight states: `out` holds Q and becomes v̇, lane k of every entry for
    /// state k.
    ///
    /// # Errors
    /// Of the first state that has no acceleration; `out` is then of no use.
    fn forward_dynamics_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) -> Result<(), Error> {
        one_by_one::forward_dynamics(self, (q, v), p, work, out)
    }

    /// [`mass_matrix_into`](Self::mass_matrix_into) of eight positions, column after column: lane k of every entry is state k.
    fn mass_matrix_lanes_into(
        &self,
        q: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        one_by_one::mass_matrix(self, q, p, work, out);
    }

    /// [`coriolis_matrix_into`](Self::coriolis_matrix_into) of eight states, column after column: lane k of every entry is state k.
    fn coriolis_matrix_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        one_by_one::coriolis_matrix(self, (q, v), p, work, out);
    }

    /// [`gravity_force_into`](Self::gravity_force_into) of eight positions: lane k of every entry is state k.
    fn gravity_force_lanes_into(
        &self,
        q: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        one_by_one::gravity_force(self, q, p, work, out);
    }

    /// [`bias_force_into`](Self::bias_force_into) of eight states: lane k of every entry is state k.
    fn bias_force_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        one_by_one::bias_force(self, (q, v), p, work, out);
    }

    /// [`equations_into`](Self::equations_into) of eight states, matrices column after column: lane k of every entry is state k.
    #[allow(clippy::too_many_arguments)]
    fn equations_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        mass: &mut [[f64; LANES]],
        coriolis: &mut [[f64; LANES]],
        gravity: &mut [[f64; LANES]],
    ) {
        self.mass_matrix_lanes_into(q, p, work, mass);
        self.coriolis_matrix_lanes_into(q, v, p, work, coriolis);
        self.gravity_force_lanes_into(q, p, work, gravity);
    }

    /// [`inverse_dynamics_derivatives_into`](Self::inverse_dynamics_derivatives_into) of eight states; `out` is made by
    /// [`InverseDynamicsDerivatives::lanes`].
    #[allow(clippy::too_many_arguments)]
    fn inverse_dynamics_derivatives_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        a: &[[f64; LANES]],
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        out: &mut InverseDynamicsDerivatives<[f64; LANES]>,
    ) {
        one_by_one::inverse_derivatives(self, (q, v, a), p, constants, work, out);
    }

    /// [`forward_dynamics_derivatives_into`](Self::forward_dynamics_derivatives_into) of eight states; `out` is made by
    /// [`ForwardDynamicsDerivatives::lanes`].
    ///
    /// # Errors
    /// Of the first state that has no acceleration; `out` is then of no use.
    #[allow(clippy::too_many_arguments)]
    fn forward_dynamics_derivatives_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        force: &[[f64; LANES]],
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        out: &mut ForwardDynamicsDerivatives<[f64; LANES]>,
    ) -> Result<(), Error> {
        one_by_one::forward_derivatives(self, (q, v, force), p, constants, work, out)
    }

    /// [`inverse_dynamics_gradient_into`](Self::inverse_dynamics_gradient_into) of eight states with a row each; `out` is made by
    /// [`InverseDynamicsGradient::lanes`].
    #[allow(clippy::too_many_arguments)]
    fn inverse_dynamics_gradient_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        a: &[[f64; LANES]],
        p: &[f64],
        weight: &[[f64; LANES]],
        work: &mut Workspace,
        out: &mut InverseDynamicsGradient<[f64; LANES]>,
    ) {
        one_by_one::inverse_gradient(self, (q, v, a), p, weight, work, out);
    }

    /// [`forward_dynamics_gradient_into`](Self::forward_dynamics_gradient_into) of eight states with a row each; `out` is made by
    /// [`ForwardDynamicsGradient::lanes`].
    ///
    /// # Errors
    /// Of the first state that has no acceleration; `out` is then of no use.
    #[allow(clippy::too_many_arguments)]
    fn forward_dynamics_gradient_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        force: &[[f64; LANES]],
        p: &[f64],
        weight: &[[f64; LANES]],
        work: &mut Workspace,
        out: &mut ForwardDynamicsGradient<[f64; LANES]>,
    ) -> Result<(), Error> {
        one_by_one::forward_gradient(self, (q, v, force), p, weight, work, out)
    }

    /// The constraints that the forward dynamics obeys, where there are some; see [`Constrained`](crate::constraint::Constrained).
    fn constraints(&self) -> Option<&dyn Holonomic> {
        None
    }

    /// M, C and G as formulas; constants for which `bound` has a number are that number, the others keep their names.
    ///
    /// # Errors
    /// Those of [`Formulas::of`]; [`FormulasError::NoEnergies`] where there is nothing to write down.
    fn formulas(&self, _bound: &[Option<f64>]) -> Result<Formulas, FormulasError> {
        Err(FormulasError::NoEnergies)
    }

    /// Length of q; more than [`nv`](Self::nv) where a joint floats.
    fn nq(&self) -> usize {
        self.coordinates().iter().map(Coordinate::nq).sum()
    }

    /// Length of v, of accelerations and of generalized forces: the degrees of freedom.
    fn nv(&self) -> usize {
        self.coordinates().iter().map(Coordinate::nv).sum()
    }

    /// The nominal constants.
    fn nominal(&self) -> Vec<f64> {
        self.parameters().iter().map(|p| p.nominal).collect()
    }

    /// T(q, v), J.
    fn kinetic_energy(&self, q: &[f64], v: &[f64]) -> Result<f64, Error> {
        self.check(&[("q", q), ("v", v)])?;
        Ok(self.kinetic_energy_with(q, v, &self.nominal()))
    }

    /// V(q), J; zero at the world's origin for a URDF.
    fn potential_energy(&self, q: &[f64]) -> Result<f64, Error> {
        self.check(&[("q", q)])?;
        Ok(self.potential_energy_with(q, &self.nominal()))
    }

    /// T + V, J: constant along a motion with Q = 0, for T quadratic in v. (Else it is v · ∂T/∂v − T + V that stays.)
    fn total_energy(&self, q: &[f64], v: &[f64]) -> Result<f64, Error> {
        Ok(self.kinetic_energy(q, v)? + self.potential_energy(q)?)
    }

    /// M(q).
    fn mass_matrix(&self, q: &[f64]) -> Result<DMatrix<f64>, Error> {
        self.check(&[("q", q)])?;
        let mut out = DMatrix::zeros(self.nv(), self.nv());
        self.mass_matrix_into(q, &self.nominal(), &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// The Christoffel matrix C(q, v).
    fn coriolis_matrix(&self, q: &[f64], v: &[f64]) -> Result<DMatrix<f64>, Error> {
        self.check(&[("q", q), ("v", v)])?;
        let mut out = DMatrix::zeros(self.nv(), self.nv());
        self.coriolis_matrix_into(q, v, &self.nominal(), &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// G(q) = +∂V/∂q, on the left-hand side.
    fn gravity_force(&self, q: &[f64]) -> Result<DVector<f64>, Error> {
        self.check(&[("q", q)])?;
        let mut out = DVector::zeros(self.nv());
        self.gravity_force_into(q, &self.nominal(), &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// C v + G, on the left-hand side.
    fn bias_force(&self, q: &[f64], v: &[f64]) -> Result<DVector<f64>, Error> {
        self.check(&[("q", q), ("v", v)])?;
        let mut out = DVector::zeros(self.nv());
        self.bias_force_into(q, v, &self.nominal(), &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// The generalized force Q = M a + C v + G that makes the mechanism accelerate with `a`.
    fn inverse_dynamics(&self, q: &[f64], v: &[f64], a: &[f64]) -> Result<DVector<f64>, Error> {
        self.check(&[("q", q), ("v", v), ("a", a)])?;
        let mut out = DVector::zeros(self.nv());
        self.inverse_dynamics_into(q, v, a, &self.nominal(), &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// The acceleration v̇ = M⁻¹ (Q − C v − G) under the generalized force Q = `force`.
    fn forward_dynamics(&self, q: &[f64], v: &[f64], force: &[f64]) -> Result<DVector<f64>, Error> {
        self.check(&[("q", q), ("v", v), ("force", force)])?;
        let mut out = DVector::from_column_slice(force);
        self.forward_dynamics_into(q, v, &self.nominal(), &mut self.workspace(), &mut out)?;
        Ok(out)
    }

    /// The generalized momenta ∂T/∂v, kg·m/s or kg·m²/s: M v for T quadratic in v.
    fn momentum(&self, q: &[f64], v: &[f64]) -> Result<DVector<f64>, Error> {
        self.check(&[("q", q), ("v", v)])?;
        let mut out = DVector::zeros(self.nv());
        self.momentum_into(q, v, &self.nominal(), &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// How the work of the generalized force Q = `force` goes into the two energies at this state: see
    /// [`power_balance_with`](Self::power_balance_with).
    fn power_balance(&self, q: &[f64], v: &[f64], force: &[f64]) -> Result<PowerBalance, Error> {
        self.check(&[("q", q), ("v", v), ("force", force)])?;
        self.power_balance_with(q, v, force, &self.nominal(), &mut self.workspace())
    }

    /// The acceleration under Q = `force` and its derivatives in q, v, Q and all constants.
    fn forward_dynamics_derivatives(
        &self,
        q: &[f64],
        v: &[f64],
        force: &[f64],
    ) -> Result<ForwardDynamicsDerivatives, Error> {
        self.check(&[("q", q), ("v", v), ("force", force)])?;
        let p = self.nominal();
        let all: Vec<usize> = (0..p.len()).collect();
        let mut out = ForwardDynamicsDerivatives::zeros(self.nv(), p.len());
        let mut work = self.workspace();
        self.forward_dynamics_derivatives_into(q, v, force, &p, &all, &mut work, &mut out)?;
        Ok(out)
    }

    /// The inverse dynamics' derivatives in q, v and all constants, at the acceleration `a`.
    fn inverse_dynamics_derivatives(
        &self,
        q: &[f64],
        v: &[f64],
        a: &[f64],
    ) -> Result<InverseDynamicsDerivatives, Error> {
        self.check(&[("q", q), ("v", v), ("a", a)])?;
        let p = self.nominal();
        let all: Vec<usize> = (0..p.len()).collect();
        let mut out = InverseDynamicsDerivatives::zeros(self.nv(), p.len());
        let mut work = self.workspace();
        self.inverse_dynamics_derivatives_into(q, v, a, &p, &all, &mut work, &mut out);
        Ok(out)
    }

    /// The linear system around the state (q, v) under Q = `force`: see [`linearize_into`](Self::linearize_into).
    fn linearize(&self, q: &[f64], v: &[f64], force: &[f64]) -> Result<Linear, Error> {
        self.check(&[("q", q), ("v", v), ("force", force)])?;
        let mut out = Linear::zeros(self.nv());
        let mut work = self.workspace();
        self.linearize_into(q, v, force, &self.nominal(), &mut work, &mut out)?;
        Ok(out)
    }

    /// The configuration of all zeros, with quaternions 1 0 0 0.
    fn neutral(&self) -> Vec<f64> {
        state::neutral(self.coordinates())
    }

    /// q ⊕ Δ for a motion Δ = v·dt: see [`state::integrate`].
    fn integrate(&self, q: &[f64], motion: &[f64]) -> Result<Vec<f64>, Error> {
        state::integrate(self.coordinates(), q, motion)
    }

    /// The motion Δ with from ⊕ Δ = to, by the short way round: see [`state::difference`].
    fn difference(&self, from: &[f64], to: &[f64]) -> Result<Vec<f64>, Error> {
        state::difference(self.coordinates(), from, to)
    }

    /// Refuses vectors of the wrong length or with NaN or infinity in them, and in `q` quaternions that are not of length 1 to 1e-6.
    fn check(&self, vectors: &[(&'static str, &[f64])]) -> Result<(), Error> {
        for &(what, vector) in vectors {
            let expected = if what == "q" { self.nq() } else { self.nv() };
            if vector.len() != expected {
                return Err(Error::Dimension {
                    what,
                    found: vector.len(),
                    expected,
                });
            }
            if let Some(index) = vector.iter().position(|x| !x.is_finite()) {
                return Err(Error::NotFinite {
                    what,
                    index,
                    value: vector[index],
                });
            }
            if what == "q" {
                state::check_unit(self.coordinates(), vector)?;
            }
        }
        Ok(())
    }
}
