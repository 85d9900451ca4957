//! How the generalized force depends on the inertia of each link.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector3};

use super::common::{ACCELERATION, Moved, motion};
use super::dispatch::{Kernel, Memory, TreeMemory, Width};
use super::engine::{Algorithms, Engine};
use super::kernels::{At, load};
use super::plan::Plan;
use super::vector::{
    Matrix, Spatial, Vector, constant, constant_columns, cross, cross_add, dot, product, scale,
    scale_add, times_add,
};
use crate::mechanism::{Inertia, Tree};
use crate::{Dynamics, Error, Mechanics, Scalar, Workspace};

/// Inertial parameters of one link.
pub const INERTIAL_PARAMETERS: usize = 10;

/// Entries of a symmetric matrix in the order xx, yy, zz, xy, xz, yz.
const ENTRIES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// Inertial parameters of links. The dynamics is linear in π = (m, m c_x, m c_y, m c_z, I_xx, I_yy, I_zz, I_xy, I_xz, I_yz) of every link,
/// with m in kg, the centre of mass c in m and the inertia I in kg·m² *about the origin* and in the axes of the link's frame.
///
/// ```
/// use lagrange::{Dynamics, Mechanics, urdf};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let text = r#"<robot name="pendulum">
///   <link name="base"/>
///   <link name="bob"><inertial><origin xyz="0 0 -2"/><mass value="3"/>
///     <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
///   <joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/></joint>
/// </robot>"#;
/// let pendulum = Dynamics::of(urdf::read(text, &urdf::Options::default())?.tree);
/// let (q, v, a) = ([0.3], [2.0], [1.0]);
/// let y = pendulum.regressor(&q, &v, &a)?;
/// assert_eq!(y.shape(), (1, 10)); // the base does not move
/// let force = pendulum.inverse_dynamics(&q, &v, &a)?;
/// assert!((y * pendulum.inertial_parameters() - &force).amax() < 1e-12);
/// // A heavier bob, its centre where it is: Q grows in proportion, a point mass has no inertia of its own.
/// let by = pendulum.inverse_dynamics_by_inertia(1, &q, &v, &a)?;
/// assert!((by[(0, 0)] - force[0] / 3.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
impl Dynamics<Tree> {
    /// Indices, among [`links`](Tree::links), of the links that move: ten columns of the regressor each.
    pub fn moving_links(&self) -> Vec<usize> {
        self.lagrangian().moving().map(|(link, _)| link).collect()
    }

    /// π of all moving links, one after the other; zeros for links without inertia.
    pub fn inertial_parameters(&self) -> DVector<f64> {
        let moving = self.moving_links();
        let mut out = DVector::zeros(INERTIAL_PARAMETERS * moving.len());
        for (k, &link) in moving.iter().enumerate() {
            let Inertia {
                mass,
                moment,
                rotational,
            } = self.link_inertia(link);
            let first = INERTIAL_PARAMETERS * k;
            out[first] = mass;
            out.rows_mut(first + 1, 3).copy_from(&moment);
            for (e, &entry) in ENTRIES.iter().enumerate() {
                out[first + 4 + e] = rotational[entry];
            }
        }
        out
    }

    /// Y(q, v, v̇ = a), nv × 10 a moving link, for which M v̇ + C v + G = Y π.
    ///
    /// # Errors
    /// When a vector has the wrong length or an entry that is not finite.
    pub fn regressor(&self, q: &[f64], v: &[f64], a: &[f64]) -> Result<DMatrix<f64>, Error> {
        self.check(&[("q", q), ("v", v), ("a", a)])?;
        let columns = INERTIAL_PARAMETERS * self.moving_links().len();
        let mut out = DMatrix::zeros(self.nv(), columns);
        self.regressor_into(q, v, a, &mut self.workspace(), &mut out);
        Ok(out)
    }

    /// The twin of [`regressor`](Self::regressor) that checks and allocates nothing; panics when a length is wrong. Y depends on no
    /// constants: factors on masses are factors on π.
    pub fn regressor_into(
        &self,
        q: &[f64],
        v: &[f64],
        a: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) {
        let columns = INERTIAL_PARAMETERS * self.lagrangian().moving().count();
        assert_eq!(out.shape(), (self.nv(), columns), "the shape of Y");
        self.unit_forces((q, v, a), None, work, out);
    }

    /// ∂Q/∂(m, c, I_c) of one link (its index among [`links`](Tree::links)) at (q, v, v̇ = a), nv × 10: mass, centre of mass (x, y, z) and
    /// inertia about the centre of mass (xx, yy, zz, xy, xz, yz), in the link's axes, each with the others held. Zeros for a link that
    /// does not move.
    ///
    /// # Errors
    /// When there is no such link, or a vector has the wrong length or an entry that is not finite.
    pub fn inverse_dynamics_by_inertia(
        &self,
        link: usize,
        q: &[f64],
        v: &[f64],
        a: &[f64],
    ) -> Result<DMatrix<f64>, Error> {
        self.check(&[("q", q), ("v", v), ("a", a)])?;
        self.check_link(link)?;
        let mut out = DMatrix::zeros(self.nv(), INERTIAL_PARAMETERS);
        let (p, work) = (self.nominal(), &mut self.workspace());
        self.inverse_dynamics_by_inertia_into(link, q, v, a, &p, work, &mut out);
        Ok(out)
    }

    /// The twin of [`inverse_dynamics_by_inertia`](Self::inverse_dynamics_by_inertia) that checks and allocates nothing; panics when
    /// there is no such link or a length is wrong. The factor on the body's mass in `p` is a factor on the whole.
    #[allow(clippy::too_many_arguments)]
    pub fn inverse_dynamics_by_inertia_into(
        &self,
        link: usize,
        q: &[f64],
        v: &[f64],
        a: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) {
        assert_eq!(out.shape(), (self.nv(), INERTIAL_PARAMETERS), "the shape");
        let Some(factor) = self.factor(link, p) else {
            return out.fill(0.0);
        };
        self.unit_forces((q, v, a), Some(link), work, out);
        let by = by_mass_centre_inertia(&self.link_inertia(link)) * factor;
        for mut row in out.row_iter_mut() {
            let of_pi = row.fixed_columns::<INERTIAL_PARAMETERS>(0).into_owned();
            row.copy_from(&(of_pi * by));
        }
    }

    /// ∂v̇/∂(m, c, I_c) of one link at (q, v) under Q = `force`, nv × 10, columns as in
    /// [`inverse_dynamics_by_inertia`](Self::inverse_dynamics_by_inertia): −M⁻¹ of them.
    ///
    /// # Errors
    /// As there, and when M has no inverse.
    pub fn forward_dynamics_by_inertia(
        &self,
        link: usize,
        q: &[f64],
        v: &[f64],
        force: &[f64],
    ) -> Result<DMatrix<f64>, Error> {
        self.check(&[("q", q), ("v", v), ("force", force)])?;
        self.check_link(link)?;
        let mut out = DMatrix::zeros(self.nv(), INERTIAL_PARAMETERS);
        let (p, work) = (self.nominal(), &mut self.workspace());
        self.forward_dynamics_by_inertia_into(link, q, v, force, &p, work, &mut out)?;
        Ok(out)
    }

    /// The twin of [`forward_dynamics_by_inertia`](Self::forward_dynamics_by_inertia) that checks and allocates nothing; panics when
    /// there is no such link or a length is wrong.
    ///
    /// # Errors
    /// When M has no inverse; `out` is then of no use.
    #[allow(clippy::too_many_arguments)]
    pub fn forward_dynamics_by_inertia_into(
        &self,
        link: usize,
        q: &[f64],
        v: &[f64],
        force: &[f64],
        p: &[f64],
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) -> Result<(), Error> {
        let mut one = std::mem::take(&mut work.lane);
        one.out.copy_from_slice(force);
        let a = &mut one.out;
        let by_joints = match self.joint_by_joint(work) {
            Some((engine, machine)) => {
                engine.forward_dynamics_by_mass(At { q, v, p }, machine, a.as_mut_slice());
                true
            }
            None => {
                let solved = self.forward_dynamics_by_factor(q, v, p, work, a);
                if !solved {
                    a.fill(f64::NAN);
                }
                false
            }
        };
        let result = if a.iter().all(|a| a.is_finite()) {
            // The factor of M is left in the memory of either route, and stays while the columns are found.
            self.inverse_dynamics_by_inertia_into(link, q, v, a.as_slice(), p, work, out);
            out.neg_mut();
            match self.joint_by_joint(work).filter(|_| by_joints) {
                Some((engine, machine)) => engine.solve(machine, out.as_mut_slice()),
                None => work.solve_mass(out),
            }
            Ok(())
        } else {
            Err(self.no_acceleration(q, v, p, work))
        };
        work.lane = one;
        result
    }

    /// Q for each unit inertial parameter of all moving links, or of one.
    fn unit_forces(
        &self,
        (q, v, a): (&[f64], &[f64], &[f64]),
        link: Option<usize>,
        work: &mut Workspace,
        out: &mut DMatrix<f64>,
    ) {
        let made;
        let engine = match self.joints() {
            Some(engine) => engine,
            None => {
                made = Engine::of(self.lagrangian());
                &made
            }
        };
        let machine = work.machine.get_or_insert_with(|| engine.machine());
        let at = At { q, v, p: &[] };
        engine.unit_forces(at, a, link, machine, out.as_mut_slice());
    }

    fn check_link(&self, link: usize) -> Result<(), Error> {
        let count = self.lagrangian().links().len();
        if link >= count {
            return Err(Error::NoSuchLink { link, count });
        }
        Ok(())
    }

    /// The factor on the inertia of a link's body; none for a link that does not move.
    fn factor(&self, link: usize, p: &[f64]) -> Option<f64> {
        let tree = self.lagrangian();
        let body = &tree.bodies()[tree.links()[link].body?];
        let parameter = tree.nodes[body.node].parameter;
        Some(parameter.map_or(1.0, |k| p[k]))
    }

    /// In and about the origin of the link's frame.
    fn link_inertia(&self, link: usize) -> Inertia {
        let inertial = self.lagrangian().links()[link].inertial;
        inertial.map_or_else(Inertia::zero, |inertial| inertial.in_link())
    }
}

impl Tree {
    /// The links that move, with the index of their body.
    fn moving(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let links = self.links().iter().enumerate();
        links.filter_map(|(k, link)| link.body.map(|body| (k, body)))
    }
}

/// ∂π/∂(m, c, I_c): h = m c, I = I_c + m (c·c 1 − c cᵀ).
fn by_mass_centre_inertia(
    inertia: &Inertia,
) -> SMatrix<f64, INERTIAL_PARAMETERS, INERTIAL_PARAMETERS> {
    let (m, c) = (inertia.mass, inertia.centre());
    let mut out = SMatrix::zeros();
    let parallel = Matrix3::identity() * c.dot(&c) - c * c.transpose();
    out[(0, 0)] = 1.0;
    for k in 0..3 {
        out[(1 + k, 0)] = c[k];
        out[(1 + k, 1 + k)] = m;
        let unit = Vector3::ith(k, 1.0);
        let shift =
            Matrix3::identity() * (2.0 * c[k]) - unit * c.transpose() - c * unit.transpose();
        for (e, &entry) in ENTRIES.iter().enumerate() {
            out[(4 + e, 1 + k)] = m * shift[entry];
        }
    }
    for (e, &entry) in ENTRIES.iter().enumerate() {
        out[(4 + e, 0)] = parallel[entry];
        out[(4 + e, 4 + e)] = 1.0;
    }
    out
}

/// A moving link in the frame of its body.
#[derive(Debug, Clone)]
pub struct Place {
    /// Its index among the links of the tree.
    pub link: usize,
    body: usize,
    /// Its axes, as columns.
    axes: [[f64; 3]; 3],
    origin: [f64; 3],
}

impl Place {
    /// Of all links that move, in their order.
    pub fn of(tree: &Tree) -> Vec<Self> {
        let moving = tree.moving().map(|(k, body)| {
            let pose = &tree.links()[k].pose;
            let axes = pose.rotation.to_rotation_matrix().into_inner();
            Place {
                link: k,
                body: tree.bodies()[body].node,
                axes: axes.into(),
                origin: pose.translation.vector.into(),
            }
        });
        moving.collect()
    }
}

/// Q for each unit inertial parameter of some links, one column each.
pub struct UnitForces<'a> {
    pub at: At<'a, f64>,
    pub a: &'a [f64],
    pub places: &'a [Place],
    /// nv × 10 a link, column after column.
    pub out: &'a mut [f64],
}

impl Kernel for UnitForces<'_> {
    #[inline(always)]
    fn run<const F: bool>(self, plan: &Plan, memory: &mut Memory<F>) {
        let memory = self.at.load::<F>(plan, memory);
        load::<f64, F>(&mut memory.state.a, self.a);
        let TreeMemory {
            state, moved, axes, ..
        } = memory;
        motion::<_, ACCELERATION>(plan, state, moved, axes);
        self.out.fill(0.0);
        let columns = self.out.chunks_exact_mut(INERTIAL_PARAMETERS * plan.nv);
        for (place, columns) in self.places.iter().zip(columns) {
            let wrenches = unit_wrenches(place, &moved[place.body]);
            let body = &plan.bodies[place.body];
            let mut at = Some(body.first + body.freedom.dof() - 1);
            while let Some(j) = at {
                let dof = &plan.dofs[j];
                for (k, wrench) in wrenches.iter().enumerate() {
                    let entry = axes[j].s.dot(wrench) * dof.ratio;
                    columns[k * plan.nv + dof.v] += f64::drop(entry);
                }
                at = dof.above;
            }
        }
    }
}

/// The wrench of each unit inertial parameter of a link, about the common origin.
///
/// With the acceleration a of the link's origin (less gravity), its axes e_k, ω and ω̇:
///
/// - of m: F = a
/// - of m c_k: F = ω̇ × e_k + ω × (ω × e_k), N = e_k × a
/// - of I_kl: N = J ω̇ + ω × J ω with J = e_k e_lᵀ + e_l e_kᵀ (e_k e_kᵀ for k = l)
#[inline(always)]
fn unit_wrenches<D: Scalar>(place: &Place, moved: &Moved<D>) -> [Spatial<D>; INERTIAL_PARAMETERS] {
    let e = product(&moved.rotation, &constant_columns(&place.axes));
    let origin = times_add(&moved.rotation, &constant(&place.origin), &moved.origin);
    let (w, u) = (&moved.velocity.angular, &moved.velocity.linear);
    let (w_rate, u_rate) = (&moved.acceleration.angular, &moved.acceleration.linear);
    let velocity = cross_add(w, &origin, u);
    let a = cross_add(w, &velocity, &cross_add(w_rate, &origin, u_rate));

    let mut out = [Spatial::zero(); INERTIAL_PARAMETERS];
    out[0] = Spatial {
        angular: cross(&origin, &a),
        linear: a,
    };
    for k in 0..3 {
        let turning = cross_add(w_rate, &e[k], &cross(w, &cross(w, &e[k])));
        out[1 + k] = Spatial {
            angular: cross_add(&origin, &turning, &cross(&e[k], &a)),
            linear: turning,
        };
    }
    for (index, (k, l)) in ENTRIES.into_iter().enumerate() {
        let (spin, spin_rate) = (spin(&e, (k, l), w), spin(&e, (k, l), w_rate));
        out[4 + index].angular = cross_add(w, &spin, &spin_rate);
    }
    out
}

/// J x for the unit entry (k, l) of the inertia.
#[inline(always)]
fn spin<D: Scalar>(e: &Matrix<D>, (k, l): (usize, usize), x: &Vector<D>) -> Vector<D> {
    let half = scale(&e[k], dot(&e[l], x));
    if k == l {
        half
    } else {
        scale_add(&e[l], dot(&e[k], x), &half)
    }
}
