//! The mechanisms whose equations of motion effects add to those of the model: made when they are first asked for, then shared.

use std::sync::{Arc, OnceLock};

use lagrange::mechanism::Tree;
use lagrange::{Dynamics, Mechanics};

use crate::effect::tilt_direction;

/// One that is made when it is needed.
type Lazy = OnceLock<Option<Arc<dyn Mechanics>>>;

/// Where the point masses of a family are: so many times as far from their joints as the centres of mass.
const PLACES: [f64; FAMILIES] = [1.0, 0.0, 2.0];
/// Of three such families any place on the line is made, for the equations of motion are quadratic in it.
pub(super) const FAMILIES: usize = 3;

/// The share of a family in a point mass that is `times` as far from its joint as the centre of mass, and the derivative of that: Lagrange's polynomials.
pub(super) fn share(family: usize, times: f64) -> (f64, f64) {
    let s = times;
    match family {
        0 => (s * (2.0 - s), 2.0 - 2.0 * s),
        1 => (0.5 * (s - 1.0) * (s - 2.0), s - 1.5),
        _ => (0.5 * s * (s - 1.0), s - 0.5),
    }
}

/// The share of a family in inertia that has no mass: half the second derivative of [`share`], at any place.
pub(super) fn spread(family: usize) -> f64 {
    if family == 0 { -1.0 } else { 0.5 }
}

/// The tree of a model with other masses and under other gravities.
pub struct Variants {
    tree: Tree,
    /// By family.
    points: [Lazy; FAMILIES],
    /// By coordinate: the bodies themselves, then the families of point masses.
    tilted: Vec<[Lazy; 1 + FAMILIES]>,
}

impl Variants {
    pub fn new(tree: Tree) -> Self {
        let coordinates = tree.coordinates().iter();
        Variants {
            tilted: coordinates.map(|_| Default::default()).collect(),
            points: Default::default(),
            tree,
        }
    }

    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// A point mass in every body, by which it is parametrised.
    pub fn points(&self, family: usize) -> Option<Arc<dyn Mechanics>> {
        let times = *PLACES.get(family)?;
        let make = || Some(Arc::new(Dynamics::of(self.tree.with_point_masses_at(times))) as _);
        self.points.get(family)?.get_or_init(make).clone()
    }

    /// Under the gravity |g| d of coordinate `c`: the bodies themselves, or a point mass of a family in each.
    pub fn tilted(&self, c: usize, family: Option<usize>) -> Option<Arc<dyn Mechanics>> {
        let make = || {
            let g = self.tree.gravity();
            let size = g.iter().map(|g| g * g).sum::<f64>().sqrt();
            let gravity = tilt_direction(&self.tree, c)?.map(|d| size * d);
            let tilted = self.tree.with_gravity(gravity);
            let tilted = match family {
                Some(family) => tilted.with_point_masses_at(*PLACES.get(family)?),
                None => tilted,
            };
            Some(Arc::new(Dynamics::of(tilted)) as _)
        };
        self.tilted
            .get(c)?
            .get(family.map_or(0, |family| 1 + family))?
            .get_or_init(make)
            .clone()
    }
}
