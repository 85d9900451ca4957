//! Coulomb friction that changes along the way: Q = −(F₀ + s q) sgn(v), the sign spread over the smoothing velocity; no friction where
//! F₀ + s q would be negative.
//!
//! F₀ in N or N·m at q = 0 (where the motion may never be: it may be negative), s in N/m or N·m/rad. A step over v whose height depends on q; a spring has the same sign for both
//! directions of motion, this has not.

use integrators::event::Direction;
use lagrange::Scalar;

use super::{
    Action, DryFriction, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity,
    smooth_sign,
};

struct PositionDependent;

impl ForceLaw for PositionDependent {
    fn force<D: Scalar>(&self, q: D, v: D, p: &[D], smoothing: D) -> D {
        let size = p[0] + p[1] * q;
        // The larger one of this and 0.
        -(size + size.abs()) * 0.5 * smooth_sign(v, smoothing)
    }

    fn dry(&self) -> Option<&dyn DryFriction> {
        Some(self)
    }
}

impl DryFriction for PositionDependent {
    fn size(&self, _: Direction, q: f64, _: f64, p: &[f64]) -> f64 {
        (p[0] + p[1] * q).max(0.0)
    }
}

/// The kind `position_dependent_friction`.
pub static KIND: Kind = Kind {
    name: "position_dependent_friction",
    family: Family::Friction,
    summary: "constant force against the velocity, of a size that changes along the way",
    parameters: &[
        ParameterSpec::new(
            "force",
            Quantity::Force,
            (f64::NEG_INFINITY, f64::INFINITY),
            0.0,
        ),
        ParameterSpec::new(
            "slope",
            Quantity::Stiffness,
            (f64::NEG_INFINITY, f64::INFINITY),
            0.0,
        ),
    ],
    action: Action::Joint(&OnCoordinate(PositionDependent)),
    contains: &["coulomb_friction"],
    probes: |scales, contained| {
        let known = contained.first().copied().unwrap_or(0.0);
        // Beside known friction the slope alone is new.
        let d = if contained.is_empty() {
            scales.small_force()
        } else {
            0.0
        };
        let slope = 0.5 * scales.small_force() / scales.reach;
        [slope, -slope]
            .map(|slope| Probe {
                neutral: vec![known, 0.0],
                perturbed: vec![known + d - slope * scales.centre, slope],
            })
            .to_vec()
    },
};
