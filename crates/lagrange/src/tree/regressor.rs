//! How the generalized force depends on the inertia of each link.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::common::{ACCELERATION, Axis, Moved, motion};
use super::plan::Plan;
use super::state::State;
use super::vector::Spatial;
use crate::mechanism::{Inertia, Tree};
use crate::{Dynamics, Error, Mechanics};

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
        let links = self.lagrangian().links().iter().enumerate();
        links.filter_map(|(k, link)| link.body.map(|_| k)).collect()
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
        let at = At::new(self.lagrangian(), q, v, a);
        let moving = self.moving_links();
        let mut out = DMatrix::zeros(self.nv(), INERTIAL_PARAMETERS * moving.len());
        for (k, &link) in moving.iter().enumerate() {
            at.columns(self.lagrangian(), link, |row, column, x| {
                out[(row, INERTIAL_PARAMETERS * k + column)] += x;
            });
        }
        Ok(out)
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
        let count = self.lagrangian().links().len();
        if link >= count {
            return Err(Error::NoSuchLink { link, count });
        }
        let mut by_pi = DMatrix::<f64>::zeros(self.nv(), INERTIAL_PARAMETERS);
        let at = At::new(self.lagrangian(), q, v, a);
        at.columns(self.lagrangian(), link, |row, column, x| {
            by_pi[(row, column)] += x;
        });
        Ok(by_pi * by_mass_centre_inertia(&self.link_inertia(link)))
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
        let by = self.forward_dynamics_derivatives(q, v, force)?;
        let a = by.acceleration.as_slice();
        Ok(-by.by_force * self.inverse_dynamics_by_inertia(link, q, v, a)?)
    }

    /// In and about the origin of the link's frame.
    fn link_inertia(&self, link: usize) -> Inertia {
        let inertial = self.lagrangian().links()[link].inertial;
        inertial.map_or_else(Inertia::zero, |inertial| inertial.in_link())
    }
}

/// ∂π/∂(m, c, I_c): h = m c, I = I_c + m (c·c 1 − c cᵀ).
fn by_mass_centre_inertia(inertia: &Inertia) -> DMatrix<f64> {
    let (m, c) = (inertia.mass, inertia.centre());
    let mut out = DMatrix::zeros(INERTIAL_PARAMETERS, INERTIAL_PARAMETERS);
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

/// All motions at one state.
struct At {
    plan: Plan,
    moved: Vec<Moved<f64>>,
    axes: Vec<Axis<f64>>,
}

impl At {
    fn new(tree: &Tree, q: &[f64], v: &[f64], a: &[f64]) -> Self {
        let plan = Plan::of(tree);
        let mut state = State::new(&plan);
        state.q.copy_from_slice(q);
        state.v.copy_from_slice(v);
        state.a.copy_from_slice(a);
        state.turn(&plan);
        let (mut moved, mut axes) = (Moved::memory(&plan), Axis::memory(&plan));
        motion::<f64, ACCELERATION>(&plan, &state, &mut moved, &mut axes);
        At { plan, moved, axes }
    }

    /// Q for each unit inertial parameter of one link: `put(row, column, entry)`, to be added up.
    ///
    /// With the acceleration a of the link's origin (less gravity), its axes e_k, ω and ω̇:
    ///
    /// - of m: F = a
    /// - of m c_k: F = ω̇ × e_k + ω × (ω × e_k), N = e_k × a
    /// - of I_kl: N = J ω̇ + ω × J ω with J = e_k e_lᵀ + e_l e_kᵀ (e_k e_kᵀ for k = l)
    fn columns(&self, tree: &Tree, link: usize, mut put: impl FnMut(usize, usize, f64)) {
        let link = &tree.links()[link];
        let Some(node) = link.body.map(|b| tree.bodies()[b].node) else {
            return;
        };
        let moved = &self.moved[node];
        let to_common = Matrix3::from_columns(&moved.rotation.map(Vector3::from));
        let axes = to_common * link.pose.rotation.to_rotation_matrix().matrix();
        let origin = to_common * link.pose.translation.vector + Vector3::from(moved.origin);
        let pair = |s: &Spatial<f64>| (Vector3::from(s.angular), Vector3::from(s.linear));
        let (w, u) = pair(&moved.velocity);
        let (w_rate, u_rate) = pair(&moved.acceleration);
        let velocity = u + w.cross(&origin);
        let a = u_rate + w_rate.cross(&origin) + w.cross(&velocity);
        let e = |k: usize| -> Vector3<f64> { axes.column(k).into() };

        let mut column = |index: usize, force: Vector3<f64>, moment: Vector3<f64>| {
            let wrench = Spatial {
                angular: (moment + origin.cross(&force)).into(),
                linear: force.into(),
            };
            let body = &self.plan.bodies[node];
            let mut at = Some(body.first + body.freedom.dof() - 1);
            while let Some(j) = at {
                let dof = &self.plan.dofs[j];
                put(dof.v, index, self.axes[j].s.dot(&wrench) * dof.ratio);
                at = dof.above;
            }
        };
        column(0, a, Vector3::zeros());
        for k in 0..3 {
            let turning = w_rate.cross(&e(k)) + w.cross(&w.cross(&e(k)));
            column(1 + k, turning, e(k).cross(&a));
        }
        for (index, &(k, l)) in ENTRIES.iter().enumerate() {
            let spin = |x: &Vector3<f64>| match k == l {
                true => e(k) * e(k).dot(x),
                false => e(k) * e(l).dot(x) + e(l) * e(k).dot(x),
            };
            let moment = spin(&w_rate) + w.cross(&spin(&w));
            column(4 + index, Vector3::zeros(), moment);
        }
    }
}
