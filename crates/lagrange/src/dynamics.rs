//! The equations of motion of a [`Lagrangian`], by the fastest route there is for it.

mod lanes;

use nalgebra::{DMatrix, DVector};

use crate::equations::derivatives::inverse_dynamics_derivatives;
use crate::equations::{Workspace, cholesky, coriolis, fast, gradient, one_by_one, reference};
use crate::trace::{Arguments, Compiled, Quantity, Registers, mass_depends_on_velocity};
use crate::tree::{Algorithms, At, Engine, LEAST_PIVOT, Machine};
use crate::{Coordinate, Error, LANES, Lagrangian, Mechanics, Parameter};
use crate::{Formulas, FormulasError};
use crate::{ForwardDynamicsDerivatives, ForwardDynamicsGradient};
use crate::{InverseDynamicsDerivatives, InverseDynamicsGradient};

/// Only trees of so few degrees of freedom are tried as programs.
const FEW: usize = 2;

/// [`Mechanics`] of a [`Lagrangian`].
///
/// By one of three routes: joint by joint for a tree of rigid bodies, by programs from a trace of T and V where these are short
/// enough and do not branch, by dual numbers else. Calls for eight states (`_lanes_into`) go side by side in the processor's vectors on
/// the first two; the functions of a text other than sines, cosines, roots and integer powers are then still called state after state.
/// By dual numbers, and so for T not quadratic in v, the states go one after the other.
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
    /// Whether T = ½ vᵀ M(q) v, so that the fast routes hold.
    quadratic: bool,
    /// Programs from a trace of T and V, for a small mechanism whose energies do not branch.
    programs: Option<Box<Compiled>>,
    /// Joint by joint, for a tree of rigid bodies.
    joints: Option<Box<Engine>>,
    /// Whether that is the route to the equations. Where there are programs too, the shortest of them come first; where there is
    /// neither, dual numbers go through T and V.
    by_joints: bool,
}

impl<L: Lagrangian> Dynamics<L> {
    /// The equations of a mechanism whose coordinates have names and units; as many as its degrees of freedom, else an error.
    ///
    /// # Panics
    /// Where T or V panics, as on an index into q or v of [`dof`](Lagrangian::dof) or more: both are evaluated here, so that such a slip
    /// ends the program where the mechanism is made and not in a hot loop.
    pub fn new(lagrangian: L, coordinates: Vec<Coordinate>) -> Result<Self, Error> {
        let found = coordinates.iter().map(Coordinate::nv).sum();
        if found != lagrangian.dof() {
            return Err(Error::Dimension {
                what: "coordinates",
                found,
                expected: lagrangian.dof(),
            });
        }
        Ok(Self::build(lagrangian, coordinates))
    }

    /// The equations of a mechanism whose coordinates are called q0, q1, … and are displacements in m. (A tree of rigid bodies
    /// has [`coordinates`](crate::mechanism::Tree::coordinates) of its own: use [`new`](Self::new).)
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn of(lagrangian: L) -> Self {
        let coordinates = match lagrangian.rigid_bodies() {
            Some(tree) => tree.coordinates().to_vec(),
            None => (0..lagrangian.dof())
                .map(|i| Coordinate {
                    name: format!("q{i}"),
                    joint: format!("q{i}"),
                    angular: false,
                    wraps: false,
                    floating: false,
                })
                .collect(),
        };
        Self::build(lagrangian, coordinates)
    }

    fn build(lagrangian: L, coordinates: Vec<Coordinate>) -> Self {
        let tree = lagrangian.rigid_bodies();
        let quadratic = tree.is_some() || is_quadratic(&lagrangian);
        let joints = tree.map(|tree| Box::new(Engine::of(tree)));
        let few = tree.is_none_or(|tree| tree.nv() <= FEW && !tree.is_floating());
        let programs = if few {
            Self::programs(&lagrangian, quadratic)
        } else {
            None
        };
        Dynamics {
            lagrangian,
            coordinates,
            quadratic,
            programs,
            by_joints: joints.is_some(),
            joints,
        }
    }

    fn programs(lagrangian: &L, quadratic: bool) -> Option<Box<Compiled>> {
        let compiled = quadratic.then(|| Compiled::of(lagrangian)).flatten();
        compiled.map(Box::new)
    }

    /// The same equations by dual numbers through T and V alone: the other route to the same numbers. Not for trees with floating
    /// joints, whose velocities are no rates of coordinates; they are returned as they are.
    #[must_use]
    pub fn by_duals(self) -> Self {
        if self.coordinates.iter().any(|c| c.floating) {
            return self;
        }
        Dynamics {
            programs: None,
            by_joints: false,
            ..self
        }
    }

    /// The same equations by programs from a trace of T and V alone, where they can be had; else as they are.
    #[must_use]
    pub fn by_programs(self) -> Self {
        let floating = self.coordinates.iter().any(|c| c.floating);
        match Self::programs(&self.lagrangian, self.quadratic && !floating) {
            None => self,
            programs => Dynamics {
                programs,
                by_joints: false,
                ..self
            },
        }
    }

    /// Whether compiled programs serve, at least where they are shortest.
    pub fn is_compiled(&self) -> bool {
        self.programs.is_some()
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

/// Whether T(q, s v) = s² T(q, v) and the parallelogram law holds at a few generic states, and no graph of T says otherwise.
pub(crate) fn is_quadratic<L: Lagrangian>(lagrangian: &L) -> bool {
    let n = lagrangian.dof();
    let generic = |seed: f64| -> Vec<f64> {
        (0..n)
            .map(|i| (seed + 1.7 * i as f64).sin() + 0.1 * seed)
            .collect()
    };
    let sampled = [0.3, 1.1, 2.9].into_iter().all(|seed| {
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
    });
    sampled && !mass_depends_on_velocity(lagrangian)
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

    fn formulas(&self, bound: &[Option<f64>]) -> Result<Formulas, FormulasError> {
        Formulas::of(&self.lagrangian, &self.coordinates, bound)
    }

    fn kinetic_energy_with(&self, q: &[f64], v: &[f64], p: &[f64]) -> f64 {
        self.lagrangian.kinetic_with(q, v, p)
    }

    fn potential_energy_with(&self, q: &[f64], p: &[f64]) -> f64 {
        self.lagrangian.potential_with(q, p)
    }

    fn mass_matrix_into(&self, q: &[f64], p: &[f64], work: &mut Workspace, out: &mut DMatrix<f64>) {
        if let Some(programs) = self.program(Quantity::Mass) {
            let at = Arguments {
                q,
                p,
                ..Arguments::default()
            };
            programs.mass_matrix(at, &mut work.registers, out);
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.mass_matrix(At { q, v: &[], p }, machine, out.as_mut_slice());
        } else if self.quadratic {
            fast::mass_matrix(&self.lagrangian, q, p, work, out);
        } else {
            reference::mass_matrix(&self.lagrangian, (q, None), p, work, out);
        }
    }

    fn mass_matrix_at_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) {
        match self.quadratic {
            true => self.mass_matrix_into(q, p, work, out),
            false => reference::mass_matrix(&self.lagrangian, (q, Some(v)), p, work, out),
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
        if let Some(programs) = self.program(Quantity::Coriolis) {
            let at = Arguments { q, v, p, a: &[] };
            programs.coriolis_matrix(at, &mut work.registers, out);
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.coriolis_matrix(At { q, v, p }, machine, out.as_mut_slice());
        } else {
            coriolis::coriolis_matrix(&self.lagrangian, q, v, p, work, out);
        }
    }

    fn gravity_force_into(
        &self,
        q: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        if let Some(programs) = self.program(Quantity::Gravity) {
            let at = Arguments {
                q,
                p,
                ..Arguments::default()
            };
            programs.gravity_force(at, &mut work.registers, out);
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.gravity_force(At { q, v: &[], p }, machine, out.as_mut_slice());
        } else {
            fast::gravity_force(&self.lagrangian, q, p, work, out);
        }
    }

    fn bias_force_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        if let Some(programs) = self.program(Quantity::Bias) {
            let at = Arguments { q, v, p, a: &[] };
            programs.bias_force(at, &mut work.registers, out);
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.inverse_dynamics(At { q, v, p }, None, machine, out.as_mut_slice());
        } else {
            fast::bias_force(&self.lagrangian, q, v, p, work, out);
        }
    }

    fn momentum_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) {
        if let Some(programs) = self.program(Quantity::Momentum) {
            let at = Arguments { q, v, p, a: &[] };
            programs.momentum(at, &mut work.registers, out);
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.momentum(At { q, v, p }, machine, out.as_mut_slice());
        } else {
            fast::momentum(&self.lagrangian, q, v, p, work, out);
        }
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
        if let Some(programs) = self.program(Quantity::Terms) {
            let at = Arguments { q, v, p, a: &[] };
            programs.terms(at, &mut work.registers, mass, coriolis, gravity);
        } else if let Some((engine, machine)) = self.engine(work) {
            let (mass, coriolis) = (mass.as_mut_slice(), coriolis.as_mut_slice());
            let gravity = gravity.as_mut_slice();
            engine.equations(At { q, v, p }, machine, mass, coriolis, gravity);
        } else {
            self.mass_matrix_into(q, p, work, mass);
            self.coriolis_matrix_into(q, v, p, work, coriolis);
            self.gravity_force_into(q, p, work, gravity);
        }
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
        if let Some(programs) = self.program(Quantity::Force) {
            let at = Arguments { q, v, a, p };
            programs.inverse_dynamics(at, &mut work.registers, out);
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.inverse_dynamics(At { q, v, p }, Some(a), machine, out.as_mut_slice());
        } else {
            fast::inverse_dynamics(&self.lagrangian, (q, v, Some(a)), p, work, out);
        }
    }

    fn forward_dynamics_into(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) -> Result<(), Error> {
        let solved = match self.forward_by_joints(None, work) {
            Some((engine, machine)) => {
                engine.forward_dynamics(At { q, v, p }, machine, out.as_mut_slice());
                out.iter().all(|a| a.is_finite())
            }
            None => self.forward_dynamics_by_factor(q, v, p, work, out),
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
        if let Some(programs) = self.program(Quantity::Derivatives) {
            let at = Arguments { q, v, a, p };
            programs.derivatives(at, constants, &mut work.registers, out);
        } else if let Some((engine, machine)) = self.engine(work) {
            engine.inverse_derivatives(At { q, v, p }, a, constants, machine, out);
        } else {
            let at = (q, v, a);
            inverse_dynamics_derivatives(&self.lagrangian, at, p, constants, work, out);
        }
    }

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
        if let Some((engine, machine)) = self.forward_by_joints(Some(Quantity::Derivatives), work) {
            engine.forward_derivatives(At { q, v, p }, constants, machine, out);
            if out.acceleration.iter().all(|a| a.is_finite()) {
                return Ok(());
            }
            return Err(self.no_acceleration(q, v, p, work));
        }
        if !self.forward_dynamics_by_factor(q, v, p, work, &mut out.acceleration) {
            return Err(self.no_acceleration(q, v, p, work));
        }
        // The same matrices take the derivatives of the inverse dynamics, and then M⁻¹ of them.
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
        if self.program(Quantity::Derivatives).is_none()
            && let Some((engine, machine)) = self.engine(work)
        {
            return engine.inverse_gradient(At { q, v, p }, a, weight, machine, out);
        }
        gradient::of_inverse_dynamics(self, (q, v, a), p, weight, work, out);
    }

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
        let way = self.forward_by_joints(Some(Quantity::Derivatives), work);
        let Some((engine, machine)) = way else {
            return gradient::of_forward_dynamics(self, (q, v, force), p, weight, work, out);
        };
        out.acceleration.copy_from_slice(force);
        engine.forward_gradient(At { q, v, p }, weight, machine, out);
        if out.acceleration.iter().all(|a| a.is_finite()) {
            return Ok(());
        }
        Err(self.no_acceleration(q, v, p, work))
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
        let at = Arguments { q, v, a, p };
        if self.program_lanes(Quantity::Force, at, &mut work.eight, out.iter_mut()) {
            return;
        }
        if let Some((engine, machine)) = self.engine(work) {
            engine.inverse_dynamics(At { q, v, p }, Some(a), machine, out);
        } else {
            one_by_one::inverse_dynamics(self, (q, v, a), p, work, out);
        }
    }

    fn forward_dynamics_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) -> Result<(), Error> {
        self.forward_lanes((q, v), p, work, out)
    }

    fn mass_matrix_lanes_into(
        &self,
        q: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        let (v, a): (&[[f64; LANES]], &[[f64; LANES]]) = (&[], &[]);
        let at = Arguments { q, v, a, p };
        if self.program_lanes(Quantity::Mass, at, &mut work.eight, out.iter_mut()) {
            return;
        }
        if let Some((engine, machine)) = self.engine(work) {
            engine.mass_matrix(At { q, v, p }, machine, out);
        } else {
            one_by_one::mass_matrix(self, q, p, work, out);
        }
    }

    fn coriolis_matrix_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        let at = Arguments { q, v, p, a: &[] };
        if self.program_lanes(Quantity::Coriolis, at, &mut work.eight, out.iter_mut()) {
            return;
        }
        if let Some((engine, machine)) = self.engine(work) {
            engine.coriolis_matrix(At { q, v, p }, machine, out);
        } else {
            one_by_one::coriolis_matrix(self, (q, v), p, work, out);
        }
    }

    fn gravity_force_lanes_into(
        &self,
        q: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        let (v, a): (&[[f64; LANES]], &[[f64; LANES]]) = (&[], &[]);
        let at = Arguments { q, v, a, p };
        if self.program_lanes(Quantity::Gravity, at, &mut work.eight, out.iter_mut()) {
            return;
        }
        if let Some((engine, machine)) = self.engine(work) {
            engine.gravity_force(At { q, v, p }, machine, out);
        } else {
            one_by_one::gravity_force(self, q, p, work, out);
        }
    }

    fn bias_force_lanes_into(
        &self,
        q: &[[f64; LANES]],
        v: &[[f64; LANES]],
        p: &[f64],
        work: &mut Workspace,
        out: &mut [[f64; LANES]],
    ) {
        let at = Arguments { q, v, p, a: &[] };
        if self.program_lanes(Quantity::Bias, at, &mut work.eight, out.iter_mut()) {
            return;
        }
        if let Some((engine, machine)) = self.engine(work) {
            engine.inverse_dynamics(At { q, v, p }, None, machine, out);
        } else {
            one_by_one::bias_force(self, (q, v), p, work, out);
        }
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
        let at = Arguments { q, v, p, a: &[] };
        let slots = mass.iter_mut().chain(&mut *coriolis).chain(&mut *gravity);
        if self.program_lanes(Quantity::Terms, at, &mut work.eight, slots) {
            return;
        }
        if let Some((engine, machine)) = self.engine(work) {
            engine.equations(At { q, v, p }, machine, mass, coriolis, gravity);
        } else {
            self.mass_matrix_lanes_into(q, p, work, mass);
            self.coriolis_matrix_lanes_into(q, v, p, work, coriolis);
            self.gravity_force_lanes_into(q, p, work, gravity);
        }
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
        self.inverse_derivatives_lanes((q, v, a), p, constants, work, out);
    }

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
        self.forward_derivatives_lanes((q, v, force), p, constants, work, out)
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
        self.inverse_gradient_lanes((q, v, a), p, weight, work, out);
    }

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
        self.forward_gradient_lanes((q, v, force), p, weight, work, out)
    }
}

impl<L: Lagrangian> Dynamics<L> {
    /// The programs, where one of them is the route to a quantity.
    #[inline]
    fn program(&self, quantity: Quantity) -> Option<&Compiled> {
        let programs = self.programs.as_deref()?;
        (!self.by_joints || programs.is_short(quantity)).then_some(programs)
    }

    /// The algorithms for trees and their memory, where there are some.
    #[inline]
    fn engine<'a>(&'a self, work: &'a mut Workspace) -> Option<(&'a Engine, &'a mut Machine)> {
        let joints = self.joints.as_deref().filter(|_| self.by_joints);
        joints.zip(work.machine.as_mut())
    }

    /// The same, where no joint follows another.
    #[inline]
    pub(crate) fn joint_by_joint<'a>(
        &'a self,
        work: &'a mut Workspace,
    ) -> Option<(&'a Engine, &'a mut Machine)> {
        self.engine(work)
            .filter(|(engine, _)| engine.is_independent())
    }

    /// The same for the forward dynamics and its derivatives, unless programs of M, the bias force and `more` are shorter.
    #[inline]
    fn forward_by_joints<'a>(
        &'a self,
        more: Option<Quantity>,
        work: &'a mut Workspace,
    ) -> Option<(&'a Engine, &'a mut Machine)> {
        let mut needed = [Some(Quantity::Equations), more].into_iter().flatten();
        let short = needed.all(|quantity| self.program(quantity).is_some());
        self.joint_by_joint(work).filter(|_| !short)
    }

    /// The algorithms for trees, whether or not they are the route to the equations.
    pub(crate) fn joints(&self) -> Option<&Engine> {
        self.joints.as_deref()
    }

    /// v̇ in place of Q by Cholesky's factor of M, which is left in `work`; whether there is one.
    pub(crate) fn forward_dynamics_by_factor(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DVector<f64>,
    ) -> bool {
        let mut mass = std::mem::take(&mut work.mass);
        let mut bias = std::mem::take(&mut work.force);
        match self.program(Quantity::Equations) {
            Some(programs) => {
                let at = Arguments { q, v, p, a: &[] };
                programs.equations(at, &mut work.registers, &mut mass, &mut bias);
            }
            None => {
                self.mass_matrix_at_into(q, v, p, work, &mut mass);
                self.bias_force_into(q, v, p, work, &mut bias);
            }
        }
        *out -= &bias;
        work.force = bias;
        let solved = cholesky::factorise(&mut mass, LEAST_PIVOT).is_ok();
        if solved {
            cholesky::solve(&mass, out);
        }
        work.mass = mass;
        solved && out.iter().all(|a| a.is_finite())
    }

    fn fresh_workspace(&self) -> Workspace {
        let registers = match &self.programs {
            Some(programs) => programs.registers(),
            None => Registers::default(),
        };
        let machine = self.joints.as_ref().map(|engine| engine.machine());
        let np = self.lagrangian.parameters().len();
        Workspace::new((self.nq(), self.nv(), np), registers, machine)
    }

    /// Why the forward dynamics has no solution: the cold path behind a failed factorisation. Restores the workspace.
    pub(crate) fn no_acceleration(
        &self,
        q: &[f64],
        v: &[f64],
        p: &[f64],
        work: &mut Workspace,
    ) -> Error {
        let n = self.nv();
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
        let mut mass = DMatrix::zeros(n, n);
        self.mass_matrix_at_into(q, v, p, work, &mut mass);
        let whole = mass.diagonal();
        if let Err((pivot, part)) = cholesky::factorise(&mut mass, LEAST_PIVOT) {
            let value = part * whole[pivot];
            return Error::singular_mass_matrix(&self.coordinates, q, pivot, value);
        }
        let mut force = DVector::zeros(n);
        let rest = vec![0.0; n];
        for (energy, v) in [("V", &rest[..]), ("T", v)] {
            self.bias_force_into(q, v, p, work, &mut force);
            if force.iter().any(|x| !x.is_finite()) {
                let q = q.to_vec();
                return Error::EnergyNotFinite { energy, q };
            }
        }
        Error::AccelerationNotFinite { q: q.to_vec() }
    }
}
