//! A state of a tree on any scalar, and the poses of the joints.

use super::plan::{Body, Freedom, Plan};
use super::vector::{
    Matrix, Vector, constant, constant_columns, product, scale, scale_add, times_add, zero,
};
use crate::Scalar;

/// q, v, v̇ and the factors on the masses, and what is computed from q alone.
#[derive(Debug, Clone)]
pub struct State<D> {
    pub q: Vec<D>,
    pub v: Vec<D>,
    pub a: Vec<D>,
    pub p: Vec<D>,
    angles: Vec<D>,
    sines: Vec<D>,
    cosines: Vec<D>,
}

impl<D: Scalar> State<D> {
    pub fn new(plan: &Plan) -> Self {
        let zeros = |n: usize| vec![D::zero(); n];
        State {
            q: zeros(plan.nq),
            v: zeros(plan.nv),
            a: zeros(plan.nv),
            p: zeros(plan.np),
            angles: zeros(plan.bodies.len()),
            sines: zeros(plan.bodies.len()),
            cosines: zeros(plan.bodies.len()),
        }
    }

    /// Sines and cosines of all joints that turn; to be called when q has changed.
    #[inline(always)]
    pub fn turn(&mut self, plan: &Plan) {
        for (angle, body) in self.angles.iter_mut().zip(&plan.bodies) {
            *angle = match body.freedom {
                Freedom::Turn => self.q[body.q] * body.ratio + body.offset,
                Freedom::Slide | Freedom::Free => D::zero(),
            };
        }
        D::sin_cos_of(&self.angles, &mut self.sines, &mut self.cosines);
    }

    /// Axes and origin of body `i` in its parent's frame.
    #[inline(always)]
    pub fn pose(&self, i: usize, body: &Body) -> (Matrix<D>, Vector<D>) {
        let [x, y, z] = constant_columns(&body.rotation);
        let origin = constant(&body.translation);
        match body.freedom {
            Freedom::Turn => {
                let (sin, cos) = (self.sines[i], self.cosines[i]);
                let turned = [
                    scale_add(&x, cos, &scale(&y, sin)),
                    scale_add(&y, cos, &scale(&x, -sin)),
                    z,
                ];
                (turned, origin)
            }
            Freedom::Slide => {
                let position = self.q[body.q] * body.ratio + body.offset;
                ([x, y, z], scale_add(&z, position, &origin))
            }
            Freedom::Free => {
                let (position, turn) = self.free(body);
                let rotation = [x, y, z];
                (
                    product(&rotation, &turn),
                    times_add(&rotation, &position, &origin),
                )
            }
        }
    }

    /// Position and rotation matrix of a joint of six degrees of freedom.
    #[inline(always)]
    pub fn free(&self, body: &Body) -> (Vector<D>, Matrix<D>) {
        let at = &self.q[body.q..body.q + 7];
        (
            [at[0], at[1], at[2]],
            quaternion([at[3], at[4], at[5], at[6]]),
        )
    }

    /// The joint's velocities: angular and linear, in the body's axes.
    #[inline(always)]
    pub fn joint(&self, body: &Body, rates: &[D]) -> (Vector<D>, Vector<D>) {
        let rate = || rates[body.v] * body.ratio;
        match body.freedom {
            Freedom::Turn => ([D::zero(), D::zero(), rate()], zero()),
            Freedom::Slide => (zero(), [D::zero(), D::zero(), rate()]),
            Freedom::Free => {
                let r = &rates[body.v..body.v + 6];
                ([r[3], r[4], r[5]], [r[0], r[1], r[2]])
            }
        }
    }

    /// The factor on the inertia of a body.
    #[inline(always)]
    pub fn factor(&self, body: &Body) -> Option<D> {
        body.parameter.map(|k| self.p[k])
    }
}

/// The rotation of a unit quaternion w x y z, as columns.
#[inline(always)]
pub fn quaternion<D: Scalar>([w, x, y, z]: [D; 4]) -> Matrix<D> {
    let one = D::constant(1.0);
    let (x2, y2, z2) = (x + x, y + y, z + z);
    [
        [one - y * y2 - z * z2, x * y2 + w * z2, x * z2 - w * y2],
        [x * y2 - w * z2, one - x * x2 - z * z2, y * z2 + w * x2],
        [x * z2 + w * y2, y * z2 - w * x2, one - x * x2 - y * y2],
    ]
}
