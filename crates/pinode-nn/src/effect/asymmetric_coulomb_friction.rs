//! Coulomb friction that depends on the direction: Q = −F₊ s for v > 0, −F₋ s for v < 0, s = sgn(v) spread over the smoothing
//! velocity; written −½(F₊ + F₋) s − ½(F₊ − F₋) s².
//!
//! F₊, F₋ in N or N·m. It is the same as Coulomb friction of their mean and a constant force of half their difference, at rest
//! too, where both hold the same range of forces: only what turns the constant force, as turning the base does, tells the two apart.

use integrators::event::Direction;
use lagrange::Scalar;

use super::{
    Action, DryFriction, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity,
    smooth_sign,
};

struct AsymmetricCoulomb;

impl ForceLaw for AsymmetricCoulomb {
    fn force<D: Scalar>(&self, _q: D, v: D, p: &[D], smoothing: D) -> D {
        let s = smooth_sign(v, smoothing);
        -(p[0] + p[1]) * s * 0.5 - (p[0] - p[1]) * s * s * 0.5
    }

    fn dry(&self) -> Option<&dyn DryFriction> {
        Some(self)
    }
}

impl DryFriction for AsymmetricCoulomb {
    fn size(&self, direction: Direction, _: f64, _: f64, p: &[f64]) -> f64 {
        match direction {
            Direction::Positive => p[0],
            Direction::Negative => p[1],
        }
    }
}

/// The kind `asymmetric_coulomb_friction`.
pub static KIND: Kind = Kind {
    name: "asymmetric_coulomb_friction",
    family: Family::Friction,
    summary: "constant force against the velocity, of different size each way",
    parameters: &[
        ParameterSpec::new("force_positive", Quantity::Force, (0.0, f64::INFINITY), 0.0),
        ParameterSpec::new("force_negative", Quantity::Force, (0.0, f64::INFINITY), 0.0),
    ],
    action: Action::Joint(&OnCoordinate(AsymmetricCoulomb)),
    contains: &["coulomb_friction"],
    probes: |scales, contained| {
        let force = contained.first().copied().unwrap_or(0.0);
        let d = scales.small_force();
        [(d, -d), (d, 0.0), (0.0, d)]
            .map(|(positive, negative)| Probe {
                neutral: vec![force, force],
                perturbed: vec![force + positive, force + negative],
            })
            .to_vec()
    },
};
