//! All bodies in one frame: poses, motions, and the inertia and momentum of everything beyond each joint.
//!
//! The frame is the world's; where the only body on the base floats, it is that body's, as it stands at this instant. Expressed in
//! one frame, inertias and momenta of bodies add, and no vector is ever transformed on its way along the tree.

use super::plan::{Body, Freedom, Plan};
use super::state::State;
use super::vector::{
    Matrix, Spatial, Vector, add, constant, constant_columns, cross, cross_add, dot, negate,
    product, scale, scale_add, times, times_add, transposed_times, zero,
};
use crate::Scalar;

/// How much is computed.
pub const POSITION: u8 = 0;
pub const VELOCITY: u8 = 1;
pub const ACCELERATION: u8 = 2;

/// The motion of one body.
#[derive(Debug, Clone, Copy)]
pub struct Moved<D> {
    /// Its axes, as columns.
    pub rotation: Matrix<D>,
    pub origin: Vector<D>,
    /// V = (ω, velocity of the body-fixed point at the common origin).
    pub velocity: Spatial<D>,
    /// V̇, less gravity: the base accelerates with −g.
    pub acceleration: Spatial<D>,
}

/// Sums over bodies: ∫ dm over the body, then over all that it carries; r is a point's position, ṙ and r̈ its motion (r̈ less g).
#[derive(Debug, Clone, Copy)]
pub struct Sums<D> {
    /// ∫ dm
    pub mass: D,
    /// h = ∫ r dm
    pub moment: Vector<D>,
    /// J = ∫ r rᵀ dm: xx, yy, zz, xy, xz, yz
    pub spread: [D; 6],
    /// p = ∫ ṙ dm
    pub momentum: Vector<D>,
    /// E = ∫ r ṙᵀ dm, row after row
    pub flow: Matrix<D>,
    /// (∫ r × r̈ dm, ∫ r̈ dm)
    pub wrench: Spatial<D>,
}

/// A degree of freedom: the motion that it makes, S, and its rates.
#[derive(Debug, Clone, Copy)]
pub struct Axis<D> {
    /// S: ∂r/∂q_j = S_ω × r + S_v for all points beyond the joint.
    pub s: Spatial<D>,
    /// Ṡ = V × S
    pub rate: Spatial<D>,
    /// Ψ̇ = V_parent × S: the change of velocity with q_j. Equal to Ṡ where the joint has one degree of freedom.
    pub swept: Spatial<D>,
    /// Ψ̈ = V̇_parent × S + V_parent × Ψ̇: the change of acceleration with q_j.
    pub swept_rate: Spatial<D>,
}

impl<D: Scalar> Moved<D> {
    pub fn memory(plan: &Plan) -> Vec<Self> {
        let moved = Moved {
            rotation: [zero(); 3],
            origin: zero(),
            velocity: Spatial::zero(),
            acceleration: Spatial::zero(),
        };
        vec![moved; plan.bodies.len()]
    }
}

impl<D: Scalar> Axis<D> {
    pub fn memory(plan: &Plan) -> Vec<Self> {
        let zero = Spatial::zero();
        let axis = Axis {
            s: zero,
            rate: zero,
            swept: zero,
            swept_rate: zero,
        };
        vec![axis; plan.dofs.len()]
    }
}

/// Gravity in the common frame.
#[inline(always)]
pub fn gravity<D: Scalar>(plan: &Plan, state: &State<D>) -> Vector<D> {
    let gravity = constant(&plan.gravity);
    match plan.bodies.first() {
        Some(body) if plan.floating => {
            let fixed = constant_columns::<D>(&body.rotation);
            let (_, turn) = state.free(body);
            transposed_times(&turn, &transposed_times(&fixed, &gravity))
        }
        _ => gravity,
    }
}

/// Poses of all bodies, S of all degrees of freedom, and from `LEVEL` = VELOCITY on V, Ṡ and Ψ̇, with ACCELERATION V̇ and Ψ̈.
///
/// V = V_parent + Σ S v, V̇ = V̇_parent + Σ (S v̇ + Ṡ v).
#[inline(always)]
pub fn motion<D: Scalar, const LEVEL: u8>(
    plan: &Plan,
    state: &State<D>,
    moved: &mut [Moved<D>],
    axes: &mut [Axis<D>],
) {
    let base = Spatial {
        angular: zero(),
        linear: negate(&gravity(plan, state)),
    };
    for (i, body) in plan.bodies.iter().enumerate() {
        let (rotation, origin) = match body.parent {
            None if plan.floating => {
                let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
                (constant_columns(&unit), zero())
            }
            None => state.pose(i, body),
            Some(parent) => {
                let parent = &moved[parent];
                let (rotation, origin) = state.pose(i, body);
                (
                    product(&parent.rotation, &rotation),
                    times_add(&parent.rotation, &origin, &parent.origin),
                )
            }
        };
        let above = body
            .parent
            .map(|p| (moved[p].velocity, moved[p].acceleration));
        let (below, below_rate) = above.unwrap_or((Spatial::zero(), base));
        let dofs = body.freedom.dof();
        let axes = &mut axes[body.first..body.first + dofs];
        directions(body, &rotation, &origin, axes);
        let mut here = Moved {
            rotation,
            origin,
            velocity: below,
            acceleration: below_rate,
        };
        if LEVEL >= VELOCITY {
            for (k, axis) in axes.iter().enumerate() {
                let rate = state.v[body.v + k] * body.ratio;
                here.velocity = axis.s.scaled_plus(rate, &here.velocity);
            }
            for (k, axis) in axes.iter_mut().enumerate() {
                axis.swept = match body.parent {
                    None => Spatial::zero(),
                    Some(_) => below.cross(&axis.s),
                };
                axis.rate = match body.freedom {
                    Freedom::Free => here.velocity.cross(&axis.s),
                    Freedom::Turn | Freedom::Slide => axis.swept,
                };
                if LEVEL >= ACCELERATION {
                    let v = state.v[body.v + k] * body.ratio;
                    let a = state.a[body.v + k] * body.ratio;
                    let so_far = axis.s.scaled_plus(a, &here.acceleration);
                    here.acceleration = axis.rate.scaled_plus(v, &so_far);
                    let swept = below_rate.cross(&axis.s);
                    axis.swept_rate = match body.parent {
                        None => swept,
                        Some(_) => below.cross(&axis.swept).plus(&swept),
                    };
                }
            }
        }
        let to = &mut moved[i];
        (to.rotation, to.origin) = (here.rotation, here.origin);
        if LEVEL >= VELOCITY {
            to.velocity = here.velocity;
        }
        if LEVEL >= ACCELERATION {
            to.acceleration = here.acceleration;
        }
    }
}

/// Ψ̈ of all degrees of freedom from motions at VELOCITY and V̇.
#[inline(always)]
pub fn sweep_rates<D: Scalar>(
    plan: &Plan,
    state: &State<D>,
    moved: &[Moved<D>],
    axes: &mut [Axis<D>],
) {
    let base = Spatial {
        angular: zero(),
        linear: negate(&gravity(plan, state)),
    };
    for body in &plan.bodies {
        let axes = &mut axes[body.first..body.first + body.freedom.dof()];
        for axis in axes {
            axis.swept_rate = match body.parent {
                None => base.cross(&axis.s),
                Some(parent) => {
                    let parent = &moved[parent];
                    let swept = parent.acceleration.cross(&axis.s);
                    parent.velocity.cross(&axis.swept).plus(&swept)
                }
            };
        }
    }
}

/// S of a joint: a turn about z through the origin, a translation along z, or both along and about all three axes.
#[inline(always)]
fn directions<D: Scalar>(
    body: &Body,
    rotation: &Matrix<D>,
    origin: &Vector<D>,
    axes: &mut [Axis<D>],
) {
    let along = |x: &Vector<D>| Spatial {
        angular: zero(),
        linear: *x,
    };
    let about = |x: &Vector<D>| Spatial {
        angular: *x,
        linear: cross(origin, x),
    };
    match body.freedom {
        Freedom::Turn => axes[0].s = about(&rotation[2]),
        Freedom::Slide => axes[0].s = along(&rotation[2]),
        Freedom::Free => {
            for (k, x) in rotation.iter().enumerate() {
                axes[k].s = along(x);
                axes[k + 3].s = about(x);
            }
        }
    }
}

/// Where the six numbers of a symmetric matrix stand in it.
const SIX: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

#[inline(always)]
fn scaled<D: Scalar>(x: &[f64; 6], factor: D) -> [D; 6] {
    let mut scaled = [D::zero(); 6];
    for (to, x) in scaled.iter_mut().zip(x) {
        *to = factor * *x;
    }
    scaled
}

impl<D: Scalar> Sums<D> {
    #[inline(always)]
    pub fn zero() -> Self {
        Sums {
            mass: D::zero(),
            moment: zero(),
            spread: [D::zero(); 6],
            momentum: zero(),
            flow: [zero(); 3],
            wrench: Spatial::zero(),
        }
    }

    pub fn memory(plan: &Plan) -> Vec<Self> {
        vec![Self::zero(); plan.bodies.len()]
    }

    /// Of one body alone, with its inertia taken `factor` times.
    ///
    /// h = R h_b + m p, J = R J_b Rᵀ + (R h_b) pᵀ + p hᵀ; with ṙ = u + ω × r and r̈ = a + ω̇ × r + ω × (ω × r):
    /// p = m u + ω × h, E = h uᵀ + J [ω]ᵀ, ∫ r̈ = m a + ω̇ × h + ω × (ω × h), ∫ r × r̈ = I ω̇ + ω × I ω + h × a.
    #[inline(always)]
    pub fn of<const LEVEL: u8>(body: &Body, moved: &Moved<D>, factor: D) -> Self {
        let Moved {
            rotation, origin, ..
        } = moved;
        let mut sums = Self::zero();
        let mass = factor * body.mass;
        let turned = times(rotation, &scale(&constant(&body.moment), factor));
        let h = scale_add(origin, mass, &turned);
        let j = {
            let [xx, yy, zz, xy, xz, yz] = scaled(&body.spread, factor);
            // Rows of J_b Rᵀ are what J_b makes of the rows of R.
            let columns = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
            let half = [
                times(rotation, &columns[0]),
                times(rotation, &columns[1]),
                times(rotation, &columns[2]),
            ];
            let mut j = [D::zero(); 6];
            for (entry, (a, b)) in j.iter_mut().zip(SIX) {
                let mut sum = turned[a].times_plus(origin[b], origin[a] * h[b]);
                for k in 0..3 {
                    sum = rotation[k][a].times_plus(half[k][b], sum);
                }
                *entry = sum;
            }
            j
        };
        (sums.mass, sums.moment, sums.spread) = (mass, h, j);
        if LEVEL >= VELOCITY {
            let Spatial {
                angular: w,
                linear: u,
            } = &moved.velocity;
            sums.momentum = cross_add(w, &h, &scale(u, mass));
            let [xx, yy, zz, xy, xz, yz] = j;
            let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
            for (a, row) in rows.iter().enumerate() {
                sums.flow[a] = cross_add(w, row, &scale(u, h[a]));
            }
            if LEVEL >= ACCELERATION {
                let Spatial {
                    angular: w_rate,
                    linear: u_rate,
                } = &moved.acceleration;
                let a = cross_add(w, u, u_rate);
                let turning = cross_add(w_rate, &h, &cross(w, &cross(w, &h)));
                sums.wrench.linear = scale_add(&a, mass, &turning);
                let (spin, spin_rate) = (sums.inertia(w), sums.inertia(w_rate));
                let moment = cross_add(w, &spin, &spin_rate);
                sums.wrench.angular = cross_add(&h, &a, &moment);
            }
        }
        sums
    }

    /// As `other`, as far as `LEVEL` has it: what nobody reads is not written.
    #[inline(always)]
    fn set<const LEVEL: u8>(&mut self, other: &Self) {
        (self.mass, self.moment, self.spread) = (other.mass, other.moment, other.spread);
        if LEVEL >= VELOCITY {
            (self.momentum, self.flow) = (other.momentum, other.flow);
        }
        if LEVEL >= ACCELERATION {
            self.wrench = other.wrench;
        }
    }

    #[inline(always)]
    pub fn add<const LEVEL: u8>(&mut self, other: &Self) {
        self.mass = self.mass + other.mass;
        self.moment = add(&self.moment, &other.moment);
        for (to, from) in self.spread.iter_mut().zip(&other.spread) {
            *to = *to + *from;
        }
        if LEVEL >= VELOCITY {
            self.momentum = add(&self.momentum, &other.momentum);
            for (to, from) in self.flow.iter_mut().zip(&other.flow) {
                *to = add(to, from);
            }
        }
        if LEVEL >= ACCELERATION {
            self.wrench = self.wrench.plus(&other.wrench);
        }
    }

    /// I x = tr(J) x − J x, with I = ∫ (r·r 1 − r rᵀ) dm.
    #[inline(always)]
    pub fn inertia(&self, x: &Vector<D>) -> Vector<D> {
        let [xx, yy, zz, xy, xz, yz] = self.spread;
        let trace = xx + yy + zz;
        let columns = [
            [trace - xx, -xy, -xz],
            [-xy, trace - yy, -yz],
            [-xz, -yz, trace - zz],
        ];
        times(&columns, x)
    }

    /// ∫ (r × ·, ·) (S_v + S_ω × r) dm: the momentum of the motion S, (I S_ω + h × S_v, m S_v + S_ω × h).
    #[inline(always)]
    pub fn of_motion(&self, s: &Spatial<D>) -> Spatial<D> {
        let spin = self.inertia(&s.angular);
        Spatial {
            angular: cross_add(&self.moment, &s.linear, &spin),
            linear: cross_add(&s.angular, &self.moment, &scale(&s.linear, self.mass)),
        }
    }

    /// ∫ (r × ·, ·) (x × ṙ) dm = (tr(E) x − Eᵀ x, x × p).
    #[inline(always)]
    pub fn of_turning(&self, x: &Vector<D>) -> Spatial<D> {
        // Eᵀ x, with E in rows.
        let across = times(&self.flow, x);
        let trace = self.trace();
        Spatial {
            angular: [
                trace.times_plus(x[0], -across[0]),
                trace.times_plus(x[1], -across[1]),
                trace.times_plus(x[2], -across[2]),
            ],
            linear: cross(x, &self.momentum),
        }
    }

    /// y for which S · [`of_turning`](Self::of_turning)(x) = y · x: p × S_v + tr(E) S_ω − E S_ω.
    #[inline(always)]
    pub fn turning_along(&self, s: &Spatial<D>) -> Vector<D> {
        let w = &s.angular;
        let sum = scale_add(w, self.trace(), &cross(&self.momentum, &s.linear));
        [
            sum[0] - dot(&self.flow[0], w),
            sum[1] - dot(&self.flow[1], w),
            sum[2] - dot(&self.flow[2], w),
        ]
    }

    #[inline(always)]
    fn trace(&self) -> D {
        self.flow[0][0] + self.flow[1][1] + self.flow[2][2]
    }
}

/// Fills `sums` with the sums over each body and all that it carries.
#[inline(always)]
pub fn composite<D: Scalar, const LEVEL: u8>(
    plan: &Plan,
    state: &State<D>,
    moved: &[Moved<D>],
    sums: &mut [Sums<D>],
) {
    for ((body, moved), sums) in plan.bodies.iter().zip(moved).zip(sums.iter_mut()) {
        sums.set::<LEVEL>(&match state.factor(body) {
            Some(factor) => Sums::of::<LEVEL>(body, moved, factor),
            None => Sums::zero(),
        });
    }
    for (i, body) in plan.bodies.iter().enumerate().rev() {
        if let Some(parent) = body.parent {
            let carried = sums[i];
            sums[parent].add::<LEVEL>(&carried);
        }
    }
}
