//! A mechanism that obeys constraints.

use nalgebra::{DMatrix, DVector};

use super::kinematics::{Kinematics, Room, Sizes};
use super::{Constraint, Dropped, Holonomic, independent, project};
use crate::equations::{cholesky, gradient};
use crate::{Coordinate, Error, ForwardDynamicsDerivatives, InverseDynamicsDerivatives};
use crate::{Formulas, FormulasError, ForwardDynamicsGradient, InverseDynamicsGradient};
use crate::{LANES, Mechanics, Parameter, Workspace};

/// ω of the stabilisation φ̈ + 2 ω φ̇ + ω² φ = 0 unless another is asked for, 1/s: a deviation decays in some 20 ms, and the
/// classical Runge-Kutta method is stable with steps up to 50 ms.
pub const DEFAULT_RATE: f64 = 50.0;

/// A mechanism `M` whose coordinates obey the constraints `C`: M v̇ + C v + G = Q + Jᵀ λ, φ(q) = 0. See the
/// [module](crate::constraint) for the equations, and for what becomes of redundant and singular constraints.
///
/// It is [`Mechanics`] of the same coordinates, with the mass matrix, Coriolis matrix, gravity, energies and inverse dynamics of the
/// free mechanism, and constrained forward dynamics: [`by_force`](ForwardDynamicsDerivatives::by_force) is
/// M⁻¹ − M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ J M⁻¹, of the rank of the degrees of freedom that are left. Of eight states (`_lanes_into`) the forward dynamics
/// with its derivatives and gradients goes one after the other, all else as in the free mechanism.
///
/// The force Jᵀ λ, stabilisation included, does the work λᵀ J v = λᵀ φ̇, W, which is 0 where φ̇ = 0 alone: at velocities that violate the
/// constraints, the terms of [`power_balance`](Mechanics::power_balance), which hold no such work, do not add up by this much.
#[derive(Debug, Clone)]
pub struct Constrained<M, C> {
    free: M,
    constraint: C,
    /// The equations in force.
    kept: Vec<usize>,
    names: Vec<String>,
    dropped: Vec<Dropped>,
    /// ω of the stabilisation, 1/s.
    rate: f64,
    /// Whether M depends on v, as for a T that is not quadratic in v.
    mass_by_velocity: bool,
}

impl<M: Mechanics, C: Constraint> Constrained<M, C> {
    /// The mechanism `free` under `constraint`. Which equations are independent is found on φ = 0, at configurations near 0 and near
    /// some others.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] when no configuration with φ = 0 is found, [`Error::ConstraintScale`] when ∂φ/∂q is all but 0 or huge,
    /// [`Error::ConstrainedTwice`] when `free` has constraints already.
    pub fn new(free: M, constraint: C) -> Result<Self, Error> {
        let neutral = crate::state::neutral(free.coordinates());
        Self::near(free, constraint, &neutral)
    }

    /// As [`new`](Self::new), with the search for φ = 0 starting at `q`.
    ///
    /// # Errors
    /// As [`new`](Self::new), and when `q` has the wrong length or is not finite.
    pub fn near(free: M, constraint: C, q: &[f64]) -> Result<Self, Error> {
        free.check(&[("q", q)])?;
        if free.constraints().is_some() {
            return Err(Error::ConstrainedTwice);
        }
        let independent = independent::find(&free, &constraint, q)?;
        let names = independent.kept.iter().map(|&e| constraint.name(e));
        Ok(Constrained {
            names: names.collect(),
            kept: independent.kept,
            dropped: independent.dropped,
            mass_by_velocity: mass_depends_on_velocity(&free),
            free,
            constraint,
            rate: DEFAULT_RATE,
        })
    }

    /// The same with another ω of the stabilisation φ̈ + 2 ω φ̇ + ω² φ = 0, 1/s; 0 for none.
    ///
    /// # Errors
    /// [`Error::NotFinite`] or [`Error::Negative`] for a rate that is not a number ≥ 0.
    pub fn with_stabilisation(mut self, rate: f64) -> Result<Self, Error> {
        let what = "stabilisation rate";
        if !rate.is_finite() {
            return Err(Error::NotFinite {
                what,
                index: 0,
                value: rate,
            });
        }
        if rate < 0.0 {
            return Err(Error::Negative { what, value: rate });
        }
        self.rate = rate;
        Ok(self)
    }

    /// ω of the stabilisation, 1/s.
    pub fn stabilisation(&self) -> f64 {
        self.rate
    }

    /// The mechanism without its constraints.
    pub fn free(&self) -> &M {
        &self.free
    }

    /// The constraints, the dropped ones too.
    pub fn constraint(&self) -> &C {
        &self.constraint
    }

    /// The names of the equations in force, in the order of φ and λ.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The equations that follow from those in force, and are left out.
    pub fn dropped(&self) -> &[Dropped] {
        &self.dropped
    }

    /// φ(q) of the equations in force.
    ///
    /// # Errors
    /// When `q` has the wrong length or an entry that is not finite.
    pub fn residual(&self, q: &[f64]) -> Result<DVector<f64>, Error> {
        self.check(&[("q", q)])?;
        let mut out = DVector::zeros(self.kept.len());
        self.residual_into(q, &self.nominal(), &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// J = ∂φ/∂q of the equations in force, one row an equation, one column a velocity.
    ///
    /// # Errors
    /// When `q` has the wrong length or an entry that is not finite.
    pub fn jacobian(&self, q: &[f64]) -> Result<DMatrix<f64>, Error> {
        self.check(&[("q", q)])?;
        let mut out = DMatrix::zeros(self.kept.len(), self.nv());
        self.jacobian_into(q, &self.nominal(), &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// v̇ under the generalized force Q = `force`, and λ: M v̇ + C v + G = Q + Jᵀ λ with φ̈ = J v̇ + J̇ v = 0, without stabilisation.
    ///
    /// # Errors
    /// [`Error::SingularConstraint`] where the rank of J falls, and what the free mechanism refuses.
    pub fn forward_dynamics_with_multipliers(
        &self,
        q: &[f64],
        v: &[f64],
        force: &[f64],
    ) -> Result<(DVector<f64>, DVector<f64>), Error> {
        self.check(&[("q", q), ("v", v), ("force", force)])?;
        let mut acceleration = DVector::from_column_slice(force);
        let mut multipliers = DVector::zeros(self.kept.len());
        let mut work = self.workspace();
        let p = self.nominal();
        self.multipliers_into(q, v, &p, &mut work, &mut acceleration, &mut multipliers)?;
        Ok((acceleration, multipliers))
    }

    /// The consistent state that belongs to (q, v): φ = 0 by Gauss-Newton steps, each the least in the metric of M, then J v = 0 by
    /// the least change of v in that metric (what an impact of the constraints would do).
    ///
    /// ```
    /// # use lagrange::constraint::{Constrained, Constraint};
    /// # use lagrange::{Dynamics, Lagrangian, Scalar};
    /// # struct Mass;
    /// # impl Lagrangian for Mass {
    /// #     fn dof(&self) -> usize { 2 }
    /// #     fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D { (v[0] * v[0] + v[1] * v[1]) * 0.5 }
    /// #     fn potential<D: Scalar>(&self, q: &[D]) -> D { q[1] * 9.81 }
    /// # }
    /// # struct Circle;
    /// # impl Constraint for Circle {
    /// #     fn len(&self) -> usize { 1 }
    /// #     fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) { out[0] = q[0] * q[0] + q[1] * q[1] - 1.0; }
    /// # }
    /// // A point mass on the circle of radius 1.
    /// let pendulum = Constrained::new(Dynamics::of(Mass), Circle)?;
    /// let (q, v) = pendulum.project(&[0.9, -0.9], &[1.0, 0.0])?;
    /// assert!((q[0] - 0.5_f64.sqrt()).abs() < 1e-12 && (q[1] + 0.5_f64.sqrt()).abs() < 1e-12);
    /// assert!((v[0] - 0.5).abs() < 1e-12 && (v[1] - 0.5).abs() < 1e-12);
    /// # Ok::<(), lagrange::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Inconsistent`] when it does not converge, with the equation of the largest residual.
    pub fn project(&self, q: &[f64], v: &[f64]) -> Result<(Vec<f64>, Vec<f64>), Error> {
        self.project_holding(q, v, &[])
    }

    /// As [`project`](Self::project), with the velocities of the given indices and what they move held fixed: a driven crank.
    ///
    /// # Errors
    /// As [`project`](Self::project).
    pub fn project_holding(
        &self,
        q: &[f64],
        v: &[f64],
        held: &[usize],
    ) -> Result<(Vec<f64>, Vec<f64>), Error> {
        self.check(&[("q", q), ("v", v)])?;
        self.project_with(q, v, held, &self.nominal())
    }

    pub(super) fn kinematics(&self) -> Kinematics<'_, C> {
        Kinematics {
            constraint: &self.constraint,
            coordinates: self.free.coordinates(),
            kept: &self.kept,
        }
    }

    pub(super) fn rate(&self) -> f64 {
        self.rate
    }

    /// v̇ and, in `room`, λ, J, M⁻¹ Jᵀ and the factor of J M⁻¹ Jᵀ; `out` holds Q and becomes v̇.
    pub(super) fn solve(
        &self,
        (q, v): (&[f64], &[f64]),
        p: &[f64],
        rate: f64,
        work: &mut Workspace,
        room: &mut Room,
        out: &mut DVector<f64>,
    ) -> Result<(), Error> {
        let kinematics = self.kinematics();
        kinematics.jacobian(q, p, room);
        kinematics.along(q, v, p, room);
        if let Some(free) = &mut room.free {
            let force = out.as_slice();
            self.free
                .forward_dynamics_derivatives_into(q, v, force, p, &[], work, free)?;
            out.copy_from(&free.acceleration);
            // M⁻¹ is symmetric.
            room.jacobian.transpose_to(&mut room.response);
            room.product.copy_from(&free.by_force);
            for mut column in room.response.column_iter_mut() {
                room.force.copy_from(&column);
                column.gemv(1.0, &room.product, &room.force, 0.0);
            }
        } else {
            self.free.forward_dynamics_into(q, v, p, work, out)?;
            self.free.mass_matrix_into(q, p, work, &mut room.mass);
            if let Err((pivot, value)) = cholesky::factorise(&mut room.mass, 0.0) {
                let coordinates = self.free.coordinates();
                return Err(Error::singular_mass_matrix(coordinates, q, pivot, value));
            }
            room.jacobian.transpose_to(&mut room.response);
            room.mass.solve_lower_triangular_mut(&mut room.response);
            room.mass.tr_solve_lower_triangular_mut(&mut room.response);
        }
        room.coupling.gemm(1.0, &room.jacobian, &room.response, 0.0);
        if let Err((row, part)) = cholesky::factorise(&mut room.coupling, cholesky::DEPENDENT) {
            return Err(self.no_multipliers(row, part, q, room));
        }
        // −(J a₀ + J̇ v + 2 ω φ̇ + ω² φ)
        room.multipliers.gemv(-1.0, &room.jacobian, out, 0.0);
        room.multipliers -= &room.bias;
        room.multipliers.axpy(-2.0 * rate, &room.velocity, 1.0);
        room.multipliers.axpy(-rate * rate, &room.position, 1.0);
        cholesky::solve(&room.coupling, &mut room.multipliers);
        out.gemv(1.0, &room.response, &room.multipliers, 1.0);
        Ok(())
    }

    /// Why there are no multipliers.
    #[cold]
    fn no_multipliers(&self, row: usize, part: f64, q: &[f64], room: &Room) -> Error {
        let name = self.names.get(row).cloned().unwrap_or_default();
        if room.jacobian.iter().any(|x| !x.is_finite()) {
            return Error::ConstraintNotFinite {
                name,
                q: q.to_vec(),
            };
        }
        Error::SingularConstraint {
            name,
            q: q.to_vec(),
            angle: part.sqrt(),
        }
    }
}

/// Whether the mass matrix at rest is not the inverse of ∂v̇/∂Q at some moving states.
fn mass_depends_on_velocity<M: Mechanics>(free: &M) -> bool {
    let neutral = crate::state::neutral(free.coordinates());
    let still = vec![0.0; free.nv()];
    (1..=3).any(|seed| {
        let q = project::moved(
            free.coordinates(),
            &neutral,
            &project::spread(seed, free.nv()),
        );
        let v = project::spread(seed + 7, free.nv());
        let mass = free.mass_matrix(&q);
        let by = free.forward_dynamics_derivatives(&q, &v, &still);
        let (Ok(mass), Ok(by)) = (mass, by) else {
            return false;
        };
        let size = mass.norm() * by.by_force.norm();
        let identity = DMatrix::identity(free.nv(), free.nv());
        (mass * by.by_force - identity).amax() > 1e-9 * (1.0 + size)
    })
}

impl<M: Mechanics, C: Constraint> Holonomic for Constrained<M, C> {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn dropped(&self) -> &[Dropped] {
        &self.dropped
    }

    fn residual_into(&self, q: &[f64], p: &[f64], work: &mut Workspace, out: &mut DVector<f64>) {
        self.kinematics().residual(q, p, &mut work.constraint, out);
    }

    fn jacobian_into(&self, q: &[f64], p: &[f64], work: &mut Workspace, out: &mut DMatrix<f64>) {
        self.kinematics().jacobian(q, p, &mut work.constraint);
        out.copy_from(&work.constraint.jacobian);
    }

    fn multipliers_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        acceleration: &mut DVector<f64>,
        multipliers: &mut DVector<f64>,
    ) -> Result<(), Error> {
        let mut room = std::mem::take(&mut work.constraint);
        let solved = self.solve((q, v), p, 0.0, work, &mut room, acceleration);
        multipliers.copy_from(&room.multipliers);
        work.constraint = room;
        solved
    }

    fn project_with(
        &self,
        q: &[f64],
        v: &[f64],
        held: &[usize],
        p: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), Error> {
        project::state(&self.free, &self.kinematics(), (q, v), held, p)
    }
}

impl<M: Mechanics, C: Constraint> Mechanics for Constrained<M, C> {
    fn coordinates(&self) -> &[Coordinate] {
        self.free.coordinates()
    }

    fn parameters(&self) -> &[Parameter] {
        self.free.parameters()
    }

    fn workspace(&self) -> Workspace {
        let mut work = self.free.workspace();
        let size = Sizes {
            nq: self.nq(),
            nv: self.nv(),
            np: self.parameters().len(),
        };
        let mut room = Room::new(size, self.constraint.len(), self.kept.len());
        if self.mass_by_velocity {
            room.free = Some(ForwardDynamicsDerivatives::zeros(size.nv, 0));
        }
        work.constraint = room;
        work
    }

    fn constraints(&self) -> Option<&dyn Holonomic> {
        Some(self)
    }

    /// M, C and G of the mechanism without its constraints, as they stand in M v̇ + C v + G = Q + Jᵀλ; the pages and the code made of
    /// them name the constraints.
    fn formulas(&self, bound: &[Option<f64>]) -> Result<Formulas, FormulasError> {
        Ok(self.free.formulas(bound)?.under(&self.names))
    }

    fn kinetic_energy_with(&self, q: &[f64], v: &[f64], p: &[f64]) -> f64 {
        self.free.kinetic_energy_with(q, v, p)
    }

    fn potential_energy_with(&self, q: &[f64], p: &[f64]) -> f64 {
        self.free.potential_energy_with(q, p)
    }

    fn mass_matrix_into(&self, q: &[f64], p: &[f64], work: &mut Workspace, out: &mut DMatrix<f64>) {
        self.free.mass_matrix_into(q, p, work, out);
    }

    fn mass_matrix_at_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) {
        self.free.mass_matrix_at_into(q, v, p, work, out);
    }

    fn coriolis_matrix_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) {
        self.free.coriolis_matrix_into(q, v, p, work, out);
    }

    fn gravity_force_into(
        &self,
        q: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        self.free.gravity_force_into(q, p, work, out);
    }

    fn bias_force_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        self.free.bias_force_into(q, v, p, work, out);
    }

    fn inverse_dynamics_into(
        &self,
        q: &[f64],
        v: &[f64],
        a: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        self.free.inverse_dynamics_into(q, v, a, p, work, out);
    }

    fn momentum_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        self.free.momentum_into(q, v, p, work, out);
    }

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
        self.free
            .equations_into(q, v, p, work, mass, coriolis, gravity);
    }

    fn inverse_dynamics_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        a: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        self.free.inverse_dynamics_lanes_into(q, v, a, p, work, out);
    }

    fn mass_matrix_lanes_into(
        &self,
        q: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        self.free.mass_matrix_lanes_into(q, p, work, out);
    }

    fn coriolis_matrix_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        self.free.coriolis_matrix_lanes_into(q, v, p, work, out);
    }

    fn gravity_force_lanes_into(
        &self,
        q: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        self.free.gravity_force_lanes_into(q, p, work, out);
    }

    fn bias_force_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        self.free.bias_force_lanes_into(q, v, p, work, out);
    }

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
        self.free
            .equations_lanes_into(q, v, p, work, mass, coriolis, gravity);
    }

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
        self.free
            .inverse_dynamics_derivatives_lanes_into(q, v, a, p, constants, work, out);
    }

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
        self.free
            .inverse_dynamics_gradient_into(q, v, a, p, weight, work, out);
    }

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
        self.free
            .inverse_dynamics_gradient_lanes_into(q, v, a, p, weight, work, out);
    }

    /// v̇ from M v̇ = Q + Jᵀ λ − C v − G with φ̈ + 2 ω φ̇ + ω² φ = 0.
    fn forward_dynamics_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) -> Result<(), Error> {
        let mut room = std::mem::take(&mut work.constraint);
        let solved = self.solve((q, v), p, self.rate, work, &mut room, out);
        work.constraint = room;
        solved
    }

    fn inverse_dynamics_derivatives_into(
        &self,
        q: &[f64],
        v: &[f64],
        a: &[f64],
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        out: &mut InverseDynamicsDerivatives,
    ) {
        self.free
            .inverse_dynamics_derivatives_into(q, v, a, p, constants, work, out);
    }

    /// The derivatives of the stabilised acceleration, from the derivatives of M v̇ − Jᵀ λ + C v + G = Q and of
    /// φ̈ + 2 ω φ̇ + ω² φ = 0.
    fn forward_dynamics_derivatives_into(
        &self,
        q: &[f64],
        v: &[f64],
        force: &[f64],
        p: &[f64],
        constants: &[usize],
        work: &mut Workspace,
        out: &mut ForwardDynamicsDerivatives,
    ) -> Result<(), Error> {
        let mut room = std::mem::take(&mut work.constraint);
        let solved = self.derivatives((q, v, force), p, constants, work, &mut room, out);
        work.constraint = room;
        solved
    }

    /// The stabilised acceleration and a row times its derivatives, by one solution with the transposed equations; where M depends on
    /// v, a product with the whole derivatives.
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
        if self.mass_by_velocity {
            return gradient::of_forward_dynamics(self, (q, v, force), p, weight, work, out);
        }
        let mut room = std::mem::take(&mut work.constraint);
        let solved = self.gradient((q, v, force), p, weight, work, &mut room, out);
        work.constraint = room;
        solved
    }
}
