//! The mechanisms whose equations of motion effects add to those of the model: made when they are first asked for, then shared.

use std::sync::{Arc, OnceLock};

use lagrange::mechanism::Tree;
use lagrange::{Dynamics, Mechanics};

use crate::effect::tilt_direction;

/// One that is made when it is needed.
type Lazy = OnceLock<Option<Arc<dyn Mechanics>>>;

/// The tree of a model with other masses and under other gravities.
pub struct Variants {
    tree: Tree,
    points: Lazy,
    /// By coordinate: the bodies themselves, then point masses.
    tilted: Vec<[Lazy; 2]>,
}

impl Variants {
    pub fn new(tree: Tree) -> Self {
        let coordinates = tree.coordinates().iter();
        Variants {
            tilted: coordinates.map(|_| Default::default()).collect(),
            points: Lazy::new(),
            tree,
        }
    }

    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// A point mass in every body, by which it is parametrised.
    pub fn points(&self) -> Option<Arc<dyn Mechanics>> {
        let make = || Some(Arc::new(Dynamics::of(self.tree.with_point_masses())) as _);
        self.points.get_or_init(make).clone()
    }

    /// Under the gravity |g| d of coordinate `c`: the bodies themselves, or a point mass in each.
    pub fn tilted(&self, c: usize, points: bool) -> Option<Arc<dyn Mechanics>> {
        let make = || {
            let g = self.tree.gravity();
            let size = g.iter().map(|g| g * g).sum::<f64>().sqrt();
            let gravity = tilt_direction(&self.tree, c)?.map(|d| size * d);
            let tilted = self.tree.with_gravity(gravity);
            let tilted = match points {
                true => tilted.with_point_masses(),
                false => tilted,
            };
            Some(Arc::new(Dynamics::of(tilted)) as _)
        };
        self.tilted
            .get(c)?
            .get(usize::from(points))?
            .get_or_init(make)
            .clone()
    }
}
