//! M(q) and C v + G of the cart-pole, all that the rig takes from the crate `lagrange`.

use std::path::Path;
use std::sync::Arc;

use lagrange::{Dynamics, Mechanics, Workspace, urdf};
use nalgebra::{DMatrix, DVector};

use super::Error;

/// A mechanism with the two coordinates `slider` (m) and `pole` (rad): M v̇ + b(q, v) = Q. A clone has its own memory.
pub trait Plant: Clone + Send + Sync {
    /// M(q), kg, kg·m, kg·m², and b = C v + G on the left-hand side, N and N·m.
    fn mass_and_bias(&mut self, q: [f64; 2], v: [f64; 2]) -> ([[f64; 2]; 2], [f64; 2]);
}

/// A [`Plant`] from the mechanics of a model with two coordinates.
#[derive(Clone)]
pub struct Mechanism {
    mechanics: Arc<dyn Mechanics>,
    constants: Vec<f64>,
    work: Workspace,
    mass: DMatrix<f64>,
    bias: DVector<f64>,
}

impl Mechanism {
    /// Takes the nominal constants of a mechanism; anything but two coordinates is an error.
    pub fn new(mechanics: Box<dyn Mechanics>) -> Result<Self, lagrange::Error> {
        if mechanics.nv() != 2 {
            return Err(lagrange::Error::Dimension {
                what: "coordinates",
                found: mechanics.nv(),
                expected: 2,
            });
        }
        Ok(Mechanism {
            constants: mechanics.nominal(),
            work: mechanics.workspace(),
            mass: DMatrix::zeros(2, 2),
            bias: DVector::zeros(2),
            mechanics: mechanics.into(),
        })
    }

    /// With other factors on the masses and inertias of its bodies, in the order of the mechanics' constants.
    pub fn with_masses(mut self, scales: &[f64]) -> Result<Self, Error> {
        let expected = self.constants.len();
        if scales.len() != expected || !scales.iter().all(|s| *s > 0.0 && s.is_finite()) {
            return Err(Error::Masses {
                scales: scales.to_vec(),
                expected,
            });
        }
        self.constants.copy_from_slice(scales);
        Ok(self)
    }
}

/// The cart-pole of a URDF: joints `slider` and `pole`, in this order. Friction in the URDF is left out: the rig has its own.
pub fn read(path: &Path) -> Result<Mechanism, Error> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let options = urdf::Options {
        source: path.display().to_string(),
        ..Default::default()
    };
    let tree = urdf::read(&text, &options).map_err(Error::Urdf)?.tree;
    let coordinates = tree.coordinates().to_vec();
    let found: Vec<String> = coordinates.iter().map(|c| c.name.clone()).collect();
    if found != ["slider", "pole"] {
        return Err(Error::NotACartPole {
            path: path.to_owned(),
            found,
        });
    }
    let at_rest = |source| Error::Mechanics { time: 0.0, source };
    let dynamics = Dynamics::new(tree, coordinates).map_err(at_rest)?;
    Mechanism::new(Box::new(dynamics)).map_err(at_rest)
}

impl Plant for Mechanism {
    fn mass_and_bias(&mut self, q: [f64; 2], v: [f64; 2]) -> ([[f64; 2]; 2], [f64; 2]) {
        let (p, work) = (&self.constants, &mut self.work);
        self.mechanics.mass_matrix_into(&q, p, work, &mut self.mass);
        self.mechanics
            .bias_force_into(&q, &v, p, work, &mut self.bias);
        let m = &self.mass;
        (
            [[m[(0, 0)], m[(0, 1)]], [m[(1, 0)], m[(1, 1)]]],
            [self.bias[0], self.bias[1]],
        )
    }
}
