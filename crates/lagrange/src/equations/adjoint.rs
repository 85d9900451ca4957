//! Euler–Lagrange for a tree in O(n): the adjoint of the recursion for T, on dual numbers.

use nalgebra::DVector;
use num_dual::{Dual64, HyperDual64};

use crate::mechanism::Tree;
use crate::tree::{Freedom, Plan, State, vector};
use crate::{Error, Scalar};
use vector::{Spatial, Vector};

/// Q = M v̇ + C v + G at (q, v, v̇ = a) with the nominal masses; allocates.
///
/// With time along ε, q + ε v and v + ε v̇, and a base that moves with 0 − ε g, one sweep outward gives every body's velocity, and
/// its adjoint, one sweep inward, the momentum ∂T/∂V of all that each joint carries: then
///
/// Q = ε(∂T/∂v) − re(∂T/∂q),
///
/// and as a joint's pose acts on T only through the velocity V that it hands on, −∂T/∂q is S · (V ×* ∂T/∂V). For a floating joint this
/// is Euler and Poincaré's equation in the body's velocities.
///
/// # Errors
/// When a vector has the wrong length or an entry that is not finite.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use lagrange::{Dynamics, Mechanics, equations::adjoint, urdf};
///
/// let text = r#"<robot name="pendulum">
///   <link name="base"/>
///   <link name="bob"><inertial><origin xyz="0 0 -2"/><mass value="3"/>
///     <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
///   <joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/></joint>
/// </robot>"#;
/// let tree = urdf::read(text, &urdf::Options::default())?.tree;
/// let torque = adjoint::inverse_dynamics(&tree, &[0.3], &[2.0], &[1.0])?;
/// assert!((torque[0] - 3.0 * 2.0 * (2.0 + 9.81 * 0.3_f64.sin())).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
pub fn inverse_dynamics(
    tree: &Tree,
    q: &[f64],
    v: &[f64],
    a: &[f64],
) -> Result<DVector<f64>, Error> {
    let plan = Plan::of(tree);
    check(&plan, &[("q", q), ("v", v), ("a", a)])?;
    let rates = position_rate(&plan, q, v);
    let mut state = State::<Dual64>::new(&plan);
    let lift = |x: f64, eps: f64| Dual64::new(x, eps);
    set(&mut state.q, q, &rates, lift);
    set(&mut state.v, v, a, lift);
    let base = plan.gravity.map(|g| Dual64::new(0.0, -g));
    let mut force = DVector::zeros(plan.nv);
    for (i, s, motion, momentum) in joints(&plan, &mut state, &base) {
        let turning = motion.cross_wrench(&momentum);
        force[i] += s.dot(&momentum).eps + s.dot(&turning).re;
    }
    Ok(force)
}

/// dQ along (dq, dv, da) at (q, v, v̇ = a): [`inverse_dynamics`] with a second dual part. Where a joint floats, `dq` is along its
/// velocities.
///
/// # Errors
/// As [`inverse_dynamics`].
pub fn inverse_dynamics_along(
    tree: &Tree,
    (q, v, a): (&[f64], &[f64], &[f64]),
    (dq, dv, da): (&[f64], &[f64], &[f64]),
) -> Result<DVector<f64>, Error> {
    let plan = Plan::of(tree);
    let tangents = [("v", v), ("a", a), ("dq", dq), ("dv", dv), ("da", da)];
    check(&plan, &[("q", q)])?;
    check(&plan, &tangents)?;
    let mut state = State::<HyperDual64>::new(&plan);
    // q is displaced first; the rates q̇ are those of the displaced q.
    let along = |x: f64, eps: f64| Dual64::new(x, eps);
    let mut displaced = vec![Dual64::from(0.0); plan.nq];
    set(&mut displaced, q, &position_rate(&plan, q, dq), along);
    let mut velocity = vec![Dual64::from(0.0); plan.nv];
    set(&mut velocity, v, dv, along);
    let rates = position_rate(&plan, &displaced, &velocity);
    for ((to, at), rate) in state.q.iter_mut().zip(&displaced).zip(&rates) {
        *to = HyperDual64::new(at.re, rate.re, at.eps, rate.eps);
    }
    for (k, to) in state.v.iter_mut().enumerate() {
        *to = HyperDual64::new(v[k], a[k], dv[k], da[k]);
    }
    let base = plan.gravity.map(|g| HyperDual64::new(0.0, -g, 0.0, 0.0));
    let mut force = DVector::zeros(plan.nv);
    for (i, s, motion, momentum) in joints(&plan, &mut state, &base) {
        let turning = motion.cross_wrench(&momentum);
        force[i] += s.dot(&momentum).eps1eps2 + s.dot(&turning).eps2;
    }
    Ok(force)
}

fn set<D: Scalar>(to: &mut [D], at: &[f64], rate: &[f64], lift: impl Fn(f64, f64) -> D) {
    for ((to, &at), &rate) in to.iter_mut().zip(at).zip(rate) {
        *to = lift(at, rate);
    }
}

fn check(plan: &Plan, vectors: &[(&'static str, &[f64])]) -> Result<(), Error> {
    for &(what, vector) in vectors {
        let expected = if what == "q" { plan.nq } else { plan.nv };
        let found = vector.len();
        if found != expected {
            return Err(Error::Dimension {
                what,
                found,
                expected,
            });
        }
        if let Some(index) = vector.iter().position(|x| !x.is_finite()) {
            let value = vector[index];
            return Err(Error::NotFinite { what, index, value });
        }
    }
    Ok(())
}

/// q̇: v itself, and for a pose its linear velocity in the parent's axes and the quaternion's rate ½ q ∘ (0, ω).
fn position_rate<D: Scalar>(plan: &Plan, q: &[D], v: &[D]) -> Vec<D> {
    let mut rates = vec![D::zero(); plan.nq];
    for body in &plan.bodies {
        match body.freedom {
            Freedom::Turn | Freedom::Slide => rates[body.q] = v[body.v],
            Freedom::Free => {
                let [w, x, y, z] = [3, 4, 5, 6].map(|k| q[body.q + k]);
                let u = [0, 1, 2].map(|k| v[body.v + k]);
                let [a, b, c] = [3, 4, 5].map(|k| v[body.v + k] * 0.5);
                let turn = crate::tree::quaternion([w, x, y, z]);
                rates[body.q..body.q + 3].copy_from_slice(&vector::times(&turn, &u));
                rates[body.q + 3] = -(x * a + y * b + z * c);
                rates[body.q + 4] = w * a + y * c - z * b;
                rates[body.q + 5] = w * b + z * a - x * c;
                rates[body.q + 6] = w * c + x * b - y * a;
            }
        }
    }
    rates
}

/// One degree of freedom of one joint: its index in v, S (with the ratio of a joint that follows another), V and ∂T/∂V of all that it
/// carries, in the body's axes.
type JointMotion<D> = (usize, Spatial<D>, Spatial<D>, Spatial<D>);

fn joints<D: Scalar>(plan: &Plan, state: &mut State<D>, base: &Vector<D>) -> Vec<JointMotion<D>> {
    state.p.fill(D::constant(1.0));
    state.turn(plan);
    let count = plan.bodies.len();
    let mut motions = vec![Spatial::<D>::zero(); count];
    let mut momenta = vec![Spatial::<D>::zero(); count];
    // Outward: V = Rᵀ (ω_parent, u_parent + ω_parent × p) + S v, and ∂T/∂V = (I ω + h × u, m u + ω × h).
    for (i, body) in plan.bodies.iter().enumerate() {
        let (rotation, origin) = state.pose(i, body);
        let (w, u) = match body.parent {
            None => (vector::zero(), *base),
            Some(parent) => {
                let Spatial { angular, linear } = &motions[parent];
                (*angular, vector::cross_add(angular, &origin, linear))
            }
        };
        let (w_joint, u_joint) = state.joint(body, &state.v);
        let motion = Spatial {
            angular: vector::add(&vector::transposed_times(&rotation, &w), &w_joint),
            linear: vector::add(&vector::transposed_times(&rotation, &u), &u_joint),
        };
        motions[i] = motion;
        let h = vector::constant(&body.moment);
        let (w, u) = (&motion.angular, &motion.linear);
        let [xx, yy, zz, xy, xz, yz] = body.inertia.map(D::constant);
        let spin = vector::times(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], w);
        momenta[i] = Spatial {
            angular: vector::cross_add(&h, u, &spin),
            linear: vector::cross_add(w, &h, &vector::scale(u, D::constant(body.mass))),
        };
    }
    // Inward, its adjoint.
    for (i, body) in plan.bodies.iter().enumerate().rev() {
        let Some(parent) = body.parent else { continue };
        let (rotation, origin) = state.pose(i, body);
        let linear = vector::times(&rotation, &momenta[i].linear);
        let angular = vector::times(&rotation, &momenta[i].angular);
        let handed = Spatial {
            angular: vector::cross_add(&origin, &linear, &angular),
            linear,
        };
        momenta[parent] = momenta[parent].plus(&handed);
    }
    let mut joints = Vec::with_capacity(plan.dofs.len());
    for (i, body) in plan.bodies.iter().enumerate() {
        let one = D::constant(body.ratio);
        let mut put = |index: usize, k: usize| {
            let mut s = Spatial::zero();
            match k {
                0..3 => s.linear[k] = one,
                _ => s.angular[k - 3] = one,
            }
            joints.push((index, s, motions[i], momenta[i]));
        };
        match body.freedom {
            Freedom::Turn => put(body.v, 5),
            Freedom::Slide => put(body.v, 2),
            Freedom::Free => (0..6).for_each(|k| put(body.v + k, k)),
        }
    }
    joints
}
