//! A mechanism's equations of motion, whatever its energies were written in.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::constraint::Holonomic;
use crate::equations::derivatives::inverse_dynamics_derivatives;
use crate::equations::{Workspace, coriolis, fast, reference};
use crate::trace::{Compiled, Registers};
use crate::{Coordinate, Error, Lagrangian, Parameter};
use crate::{ForwardDynamicsDerivatives, InverseDynamicsDerivatives};

/// The equations of motion of one mechanism: M(q) v̇ + C(q, v) v + G(q) = Q.
///
/// Immutable and shared; what changes is in the [`Workspace`] of each thread. Every allocating call takes the nominal constants
/// and checks its arguments; its `_into` twin takes the constants `p` (as many as [`parameters`](Self::parameters)), checks
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

    /// v̇ from M v̇ = Q − C v − G by Cholesky: `out` holds Q and becomes v̇. Afterwards
    /// [`Workspace::solve_mass`] can use the factor.
    fn forward_dynamics_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) -> Result<(), Error>;

    /// Derivatives of the inverse dynamics at (q, v, v̇ = a) in q, v and the constants with the given indices. For T quadratic
    /// in v or not.
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
    /// ∂v̇/∂x = −M⁻¹ ∂(M v̇ + C v + G)/∂x at fixed v̇, and ∂v̇/∂Q = M⁻¹.
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
    ) -> Result<(), Error> {
        out.acceleration.copy_from_slice(force);
        self.forward_dynamics_into(q, v, p, work, &mut out.acceleration)?;
        let mut inverse = InverseDynamicsDerivatives {
            by_q: std::mem::take(&mut out.by_q),
            by_v: std::mem::take(&mut out.by_v),
            by_p: std::mem::take(&mut out.by_p),
        };
        let a = out.acceleration.as_slice();
        self.inverse_dynamics_derivatives_into(q, v, a, p, constants, work, &mut inverse);
        let InverseDynamicsDerivatives { by_q, by_v, by_p } = inverse;
        (out.by_q, out.by_v, out.by_p) = (by_q, by_v, by_p);
        for by in [&mut out.by_q, &mut out.by_v, &mut out.by_p] {
            by.neg_mut();
            work.solve_mass(by);
        }
        out.by_force.fill_with_identity();
        work.solve_mass(&mut out.by_force);
        Ok(())
    }

    /// The constraints that the forward dynamics obeys, where there are some; see [`Constrained`](crate::constraint::Constrained).
    fn constraints(&self) -> Option<&dyn Holonomic> {
        None
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

    /// T + V, J: constant along a motion with Q = 0.
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

    /// Refuses vectors of the wrong length or with NaN or infinity in them.
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
        }
        Ok(())
    }
}

/// [`Mechanics`] of a [`Lagrangian`].
///
/// ```
/// use lagrange::{Dynamics, Lagrangian, Mechanics, Scalar};
///
/// struct Pendulum;
/// impl Lagrangian for Pendulum {
///     fn dof(&self) -> usize { 1 }
///     fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D { v[0] * v[0] * 0.5 }
///     fn potential<D: Scalar>(&self, q: &[D]) -> D { q[0].cos() * -9.81 }
/// }
/// let pendulum = Dynamics::of(Pendulum);
/// let falling = pendulum.forward_dynamics(&[0.5], &[0.0], &[0.0])?;
/// assert!((falling[0] + 9.81 * 0.5_f64.sin()).abs() < 1e-15);
/// # Ok::<(), lagrange::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Dynamics<L> {
    lagrangian: L,
    coordinates: Vec<Coordinate>,
    /// Whether T = ½ vᵀ M(q) v, so that the fast route holds.
    quadratic: bool,
    /// The equations as programs, for a small mechanism whose energies do not branch.
    compiled: Option<Compiled>,
}

impl<L: Lagrangian> Dynamics<L> {
    /// The equations of a mechanism whose coordinates have names and units; as many as its degrees of freedom, else an error.
    pub fn new(lagrangian: L, coordinates: Vec<Coordinate>) -> Result<Self, Error> {
        if coordinates.len() != lagrangian.dof() {
            return Err(Error::Dimension {
                what: "coordinates",
                found: coordinates.len(),
                expected: lagrangian.dof(),
            });
        }
        Ok(Self::build(lagrangian, coordinates))
    }

    /// The equations of a mechanism whose coordinates are called q0, q1, … and are displacements in m.
    pub fn of(lagrangian: L) -> Self {
        let coordinates = (0..lagrangian.dof())
            .map(|i| Coordinate {
                name: format!("q{i}"),
                joint: format!("q{i}"),
                angular: false,
                wraps: false,
                floating: false,
            })
            .collect();
        Self::build(lagrangian, coordinates)
    }

    fn build(lagrangian: L, coordinates: Vec<Coordinate>) -> Self {
        let quadratic = is_quadratic(&lagrangian);
        let compiled = quadratic.then(|| Compiled::of(&lagrangian)).flatten();
        Dynamics {
            lagrangian,
            coordinates,
            quadratic,
            compiled,
        }
    }

    /// The same equations by dual numbers alone, without the compiled programs that small mechanisms have: the other route to the
    /// same numbers.
    pub fn by_duals(self) -> Self {
        Dynamics {
            compiled: None,
            ..self
        }
    }

    /// Whether forward dynamics and the derivatives run as compiled programs.
    pub fn is_compiled(&self) -> bool {
        self.compiled.is_some()
    }

    /// The mechanism.
    pub fn lagrangian(&self) -> &L {
        &self.lagrangian
    }

    /// Whether T is quadratic in v; if not, the reference route is taken for all.
    pub fn kinetic_is_quadratic(&self) -> bool {
        self.quadratic
    }
}

/// Whether T(q, s v) = s² T(q, v) and the parallelogram law holds at a few generic states.
fn is_quadratic<L: Lagrangian>(lagrangian: &L) -> bool {
    let n = lagrangian.dof();
    let generic = |seed: f64| -> Vec<f64> {
        (0..n)
            .map(|i| (seed + 1.7 * i as f64).sin() + 0.1 * seed)
            .collect()
    };
    [0.3, 1.1, 2.9].into_iter().all(|seed| {
        let (q, v, w) = (generic(seed), generic(seed + 0.5), generic(seed + 4.0));
        let kinetic = |a: f64, b: f64| {
            let u: Vec<f64> = v.iter().zip(&w).map(|(v, w)| a * v + b * w).collect();
            lagrangian.kinetic(&q, &u)
        };
        let scale = kinetic(1.0, 0.0).abs() + kinetic(0.0, 1.0).abs();
        let close = |x: f64| x.abs() <= 1e-10 * scale;
        close(kinetic(0.0, 0.0))
            && close(kinetic(2.0, 0.0) - 4.0 * kinetic(1.0, 0.0))
            && close(kinetic(-1.0, 0.0) - kinetic(1.0, 0.0))
            && close(
                kinetic(1.0, 1.0) + kinetic(1.0, -1.0)
                    - 2.0 * kinetic(1.0, 0.0)
                    - 2.0 * kinetic(0.0, 1.0),
            )
    })
}

impl<L: Lagrangian> Mechanics for Dynamics<L> {
    fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }

    fn parameters(&self) -> &[Parameter] {
        self.lagrangian.parameters()
    }

    fn workspace(&self) -> Workspace {
        self.fresh_workspace()
    }

    fn kinetic_energy_with(&self, q: &[f64], v: &[f64], p: &[f64]) -> f64 {
        self.lagrangian.kinetic_with(q, v, p)
    }

    fn potential_energy_with(&self, q: &[f64], p: &[f64]) -> f64 {
        self.lagrangian.potential_with(q, p)
    }

    fn mass_matrix_into(&self, q: &[f64], p: &[f64], work: &mut Workspace, out: &mut DMatrix<f64>) {
        if self.quadratic {
            fast::mass_matrix(&self.lagrangian, q, p, work, out);
        } else {
            let rest = vec![0.0; q.len()];
            let at = reference::equations_with(&self.lagrangian, q, &rest, p);
            out.copy_from(&at.mass_matrix);
        }
    }

    fn coriolis_matrix_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) {
        coriolis::coriolis_matrix(&self.lagrangian, q, v, p, work, out);
    }

    fn gravity_force_into(
        &self,
        q: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        fast::gravity_force(&self.lagrangian, q, p, work, out);
    }

    fn bias_force_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        fast::bias_force(&self.lagrangian, q, v, p, work, out);
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
        fast::inverse_dynamics(&self.lagrangian, (q, v, Some(a)), p, work, out);
    }

    fn forward_dynamics_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) -> Result<(), Error> {
        let mut mass = std::mem::take(&mut work.mass);
        let mut bias = std::mem::take(&mut work.force);
        if let Some(compiled) = &self.compiled {
            compiled.equations(q, v, p, &mut work.registers, &mut mass, &mut bias);
        } else {
            if self.quadratic {
                fast::mass_matrix(&self.lagrangian, q, p, work, &mut mass);
            } else {
                let at = reference::equations_with(&self.lagrangian, q, v, p);
                mass.copy_from(&at.mass_matrix);
            }
            fast::bias_force(&self.lagrangian, q, v, p, work, &mut bias);
        }
        *out -= &bias;
        work.force = bias;
        let solved = match Cholesky::new(mass) {
            Some(factor) => {
                factor.solve_mut(out);
                work.mass = factor.unpack_dirty();
                out.iter().all(|a| a.is_finite())
            }
            None => false,
        };
        if solved {
            return Ok(());
        }
        Err(self.no_acceleration(q, v, p, work))
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
        match &self.compiled {
            Some(compiled) => {
                compiled.derivatives((q, v, a), p, constants, &mut work.registers, out);
            }
            None => {
                inverse_dynamics_derivatives(&self.lagrangian, (q, v, a), p, constants, work, out);
            }
        }
    }
}

impl<L: Lagrangian> Dynamics<L> {
    fn fresh_workspace(&self) -> Workspace {
        let registers = match &self.compiled {
            Some(compiled) => compiled.registers(),
            None => Registers::default(),
        };
        Workspace::new(
            self.lagrangian.dof(),
            self.lagrangian.parameters().len(),
            registers,
        )
    }

    /// Why the forward dynamics has no solution: the cold path behind a failed factorisation. Restores the workspace.
    fn no_acceleration(&self, q: &[f64], v: &[f64], p: &[f64], work: &mut Workspace) -> Error {
        let n = q.len();
        *work = self.fresh_workspace();
        for (what, vector) in [("q", q), ("v", v), ("p", p)] {
            if let Some(index) = vector.iter().position(|x| !x.is_finite()) {
                return Error::NotFinite {
                    what,
                    index,
                    value: vector[index],
                };
            }
        }
        let mass = reference::equations_with(&self.lagrangian, q, v, p).mass_matrix;
        // The smallest leading block without a Cholesky factor names the coordinate.
        let pivot = (0..n)
            .find(|&k| Cholesky::new(mass.view((0, 0), (k + 1, k + 1)).into_owned()).is_none())
            .unwrap_or(n.saturating_sub(1));
        Error::SingularMassMatrix {
            q: q.to_vec(),
            pivot,
            value: mass.get((pivot, pivot)).copied().unwrap_or(f64::NAN),
        }
    }
}
