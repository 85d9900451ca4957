//! Holonomic constraints φ(q) = 0, and mechanisms that obey them:
//!
//! **M(q) v̇ + C(q, v) v + G(q) = Q + Jᵀ λ,  φ(q) = 0,  J = ∂φ/∂q**
//!
//! | symbol | what |
//! |---|---|
//! | φ | residuals, one an equation; m where a constraint is a distance, 1 or rad where it is an angle |
//! | J | ∂φ/∂q, so that φ̇ = J v; along the tangent of q where a joint floats |
//! | λ | multipliers, on the right-hand side: Jᵀ λ is the generalized force of the constraints; N where φ is in m |
//!
//! A [`Constraint`] gives φ over [`Scalar`]; J, J̇ v and everything that the derivatives of the dynamics need come from dual
//! numbers. [`Constrained`] joins a mechanism and its constraints and is a [`Mechanics`](crate::Mechanics) itself: mass matrix,
//! Coriolis matrix, gravity, energies and inverse dynamics are those of the free mechanism, the forward dynamics and its
//! derivatives are constrained.
//!
//! # How it is solved
//!
//! With a₀ = M⁻¹ (Q − C v − G), the acceleration without constraints, and φ̈ = J v̇ + J̇ v,
//!
//! (J M⁻¹ Jᵀ) λ = −(J a₀ + J̇ v + 2 ω φ̇ + ω² φ),  v̇ = a₀ + M⁻¹ Jᵀ λ.
//!
//! # What keeps φ at 0
//!
//! φ̈ = 0 alone lets errors of the integration grow with t². The forward dynamics therefore solves φ̈ + 2 ω φ̇ + ω² φ = 0
//! (Baumgarte's method, critically damped): a deviation decays like e^(−ωt), and what the integrator adds in each step stays bounded.
//! ω is a property of the mechanism and not of the step: [`DEFAULT_RATE`] unless
//! [`with_stabilisation`](Constrained::with_stabilisation) says otherwise. An explicit method is stable with it while ω h is well
//! below its limit (2.8 for the classical Runge-Kutta method). On φ = 0, φ̇ = 0 the added terms are zero, and the acceleration is the
//! exact one; ω = 0 switches them off.
//!
//! # Where to start
//!
//! [`Constrained::project`] moves a state onto φ = 0, J v = 0.
//!
//! # Redundant and singular
//!
//! [`Constrained::new`] looks at the rank of J at several configurations on φ = 0. Equations that follow from the others everywhere
//! (the one across the plane of a planar linkage) are dropped and named by [`Constrained::dropped`]; equations that no
//! configuration satisfies are an error. Where the rank falls at single configurations (a dead centre), λ is not determined: the
//! forward dynamics returns [`Error::SingularConstraint`] there, which names equation and q.

mod constrained;
mod derivatives;
mod gradient;
mod independent;
mod kinematics;
mod loops;
mod project;
mod text;

pub use constrained::{Constrained, DEFAULT_RATE};
pub use independent::Dropped;
pub(crate) use kinematics::Room;
pub use loops::{LinkPoint, Loop, LoopField, LoopProblem, Loops};
pub(crate) use text::Equation;
pub use text::TextConstraints;

use nalgebra::{DMatrix, DVector};

use crate::{Error, Scalar, Workspace};

/// Equations φ(q) = 0 that the coordinates of a mechanism obey.
///
/// ```
/// use lagrange::constraint::{Constrained, Constraint};
/// use lagrange::{Dynamics, Lagrangian, Scalar};
///
/// /// A free point mass of 2 kg in a vertical plane, q = (x, z).
/// struct Mass;
/// impl Lagrangian for Mass {
///     fn dof(&self) -> usize { 2 }
///     fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D { v[0] * v[0] + v[1] * v[1] }
///     fn potential<D: Scalar>(&self, q: &[D]) -> D { q[1] * (2.0 * 9.81) }
/// }
///
/// /// A rod of 0.5 m from the origin to the mass.
/// struct Rod;
/// impl Constraint for Rod {
///     fn len(&self) -> usize { 1 }
///     fn name(&self, _equation: usize) -> String { "rod".into() }
///     fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) {
///         out[0] = (q[0] * q[0] + q[1] * q[1]).sqrt() - 0.5;
///     }
/// }
///
/// let pendulum = Constrained::new(Dynamics::of(Mass), Rod)?;
/// // Hanging at rest: the rod pulls upward, towards shorter, with m g.
/// let (a, multipliers) = pendulum.forward_dynamics_with_multipliers(&[0.0, -0.5], &[0.0, 0.0], &[0.0, 0.0])?;
/// assert!(a.amax() < 1e-12);
/// assert!((multipliers[0] + 2.0 * 9.81).abs() < 1e-12);
/// # Ok::<(), lagrange::Error>(())
/// ```
pub trait Constraint: Send + Sync {
    /// Number of equations.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What equation `equation` (from 0) is called in errors, warnings and outputs.
    fn name(&self, equation: usize) -> String {
        format!("phi{equation}")
    }

    /// The residuals φ(q): `out` has [`len`](Self::len) entries.
    fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]);

    /// φ with the constants `p` of the mechanism ([`Mechanics::parameters`](crate::Mechanics::parameters)) in place of the nominal
    /// ones.
    fn residual_with<D: Scalar>(&self, q: &[D], _p: &[D], out: &mut [D]) {
        self.residual(q, out);
    }

    /// Whether [`residual_with`](Self::residual_with) depends on constant `index` of the mechanism. Where it does not, derivatives in
    /// this constant are not looked for; `true` is never wrong.
    fn uses_constant(&self, _index: usize) -> bool {
        true
    }

    /// Adds ∂(λᵀ φ)/∂q to `out`, one entry a number of q, for one number λ an equation: the generalized force Jᵀ λ. `false` where there
    /// is no formula for it, as is always right: dual numbers find it then, one entry at a time, and `out` is of no use.
    fn add_force_with<D: Scalar>(
        &self,
        _q: &[D],
        _p: &[D],
        _multipliers: &[f64],
        _out: &mut [D],
    ) -> bool {
        false
    }
}

/// The equations of both, the first's before the second's.
impl<A: Constraint, B: Constraint> Constraint for (A, B) {
    fn len(&self) -> usize {
        self.0.len() + self.1.len()
    }
    fn name(&self, equation: usize) -> String {
        match equation.checked_sub(self.0.len()) {
            None => self.0.name(equation),
            Some(rest) => self.1.name(rest),
        }
    }
    fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) {
        let (first, second) = out.split_at_mut(self.0.len());
        self.0.residual(q, first);
        self.1.residual(q, second);
    }
    fn residual_with<D: Scalar>(&self, q: &[D], p: &[D], out: &mut [D]) {
        let (first, second) = out.split_at_mut(self.0.len());
        self.0.residual_with(q, p, first);
        self.1.residual_with(q, p, second);
    }
    fn uses_constant(&self, index: usize) -> bool {
        self.0.uses_constant(index) || self.1.uses_constant(index)
    }
    fn add_force_with<D: Scalar>(
        &self,
        q: &[D],
        p: &[D],
        multipliers: &[f64],
        out: &mut [D],
    ) -> bool {
        let (first, second) = multipliers.split_at(self.0.len());
        self.0.add_force_with(q, p, first, out) && self.1.add_force_with(q, p, second, out)
    }
}

/// What a constrained mechanism has beside its [`Mechanics`](crate::Mechanics), whatever its constraints were written in; see
/// [`Mechanics::constraints`](crate::Mechanics::constraints).
///
/// q has `nq` entries, v and forces `nv`, φ and λ as many as [`names`](Self::names); `p` are the constants of the mechanism. The
/// calls with a [`Workspace`] check nothing and allocate nothing.
pub trait Holonomic: Send + Sync {
    /// The equations in force, in the order of φ and λ.
    fn names(&self) -> &[String];

    /// The equations that follow from those in force, and are left out.
    fn dropped(&self) -> &[Dropped];

    /// φ(q).
    fn residual_into(&self, q: &[f64], p: &[f64], work: &mut Workspace, out: &mut DVector<f64>);

    /// J = ∂φ/∂q, one row an equation.
    fn jacobian_into(&self, q: &[f64], p: &[f64], work: &mut Workspace, out: &mut DMatrix<f64>);

    /// v̇ and λ with φ̈ = J v̇ + J̇ v = 0 at the state as it is, without stabilisation: `acceleration` holds Q and becomes v̇.
    ///
    /// # Errors
    /// As the forward dynamics.
    fn multipliers_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        acceleration: &mut DVector<f64>,
        multipliers: &mut DVector<f64>,
    ) -> Result<(), Error>;

    /// The state on φ = 0, J v = 0 that belongs to (q, v), the velocities in `held` (and their coordinates) unchanged; see
    /// [`Constrained::project`].
    ///
    /// # Errors
    /// [`Error::Inconsistent`] when no such state is found.
    fn project_with(
        &self,
        q: &[f64],
        v: &[f64],
        held: &[usize],
        p: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), Error>;
}
