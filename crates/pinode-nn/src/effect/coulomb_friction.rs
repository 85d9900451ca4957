//! Coulomb friction: Q = −F_c sgn(v), the sign spread over the smoothing velocity.
//!
//! F_c in N or N·m. A step at v = 0, flat elsewhere; confused with an input dead zone when u and v are in phase.

use integrators::event::Direction;
use lagrange::Scalar;

use super::{
    Action, DryFriction, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Quantity, Scales,
    kind::from_zero, smooth_sign,
};

struct Coulomb;

impl ForceLaw for Coulomb {
    fn force<D: Scalar>(&self, _q: D, v: D, p: &[D], smoothing: D) -> D {
        -p[0] * smooth_sign(v, smoothing)
    }

    fn dry(&self) -> Option<&dyn DryFriction> {
        Some(self)
    }
}

impl DryFriction for Coulomb {
    fn size(&self, _: Direction, _: f64, _: f64, p: &[f64]) -> f64 {
        p[0]
    }

    fn holding(&self, scales: &Scales) -> Vec<Vec<f64>> {
        match scales.held > 0.0 {
            true => vec![vec![scales.held]],
            false => Vec::new(),
        }
    }
}

/// The kind `coulomb_friction`.
pub static KIND: Kind = Kind {
    name: "coulomb_friction",
    family: Family::Friction,
    summary: "constant force against the velocity",
    parameters: &[ParameterSpec::new(
        "force",
        Quantity::Force,
        (0.0, f64::INFINITY),
        0.0,
    )],
    action: Action::Joint(&OnCoordinate(Coulomb)),
    contains: &[],
    probes: |scales, _| from_zero(scales.small_force()),
};
