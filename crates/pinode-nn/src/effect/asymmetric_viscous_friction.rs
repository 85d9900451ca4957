//! Viscous friction that depends on the direction: Q = −c₊ v for v > 0, −c₋ v for v < 0.
//!
//! c₊, c₋ in N·s/m or N·m·s/rad. Continuous at rest. Its even part, −½(c₊ − c₋)|v|, is what a constant force and quadratic drag
//! imitate over a narrow range of speeds.

use lagrange::Scalar;

use super::{Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity};

struct AsymmetricViscous;

impl ForceLaw for AsymmetricViscous {
    fn force<D: Scalar>(&self, _q: D, v: D, p: &[D], _smoothing: D) -> D {
        // Of the two brackets one is 0.
        -(p[0] * (v + v.abs()) + p[1] * (v - v.abs())) * 0.5
    }
}

/// The kind `asymmetric_viscous_friction`.
pub static KIND: Kind = Kind {
    name: "asymmetric_viscous_friction",
    family: Family::Friction,
    summary: "force against the velocity, proportional to it, of different size each way",
    parameters: &[
        ParameterSpec::new(
            "coefficient_positive",
            Quantity::Damping,
            (0.0, f64::INFINITY),
            0.0,
        ),
        ParameterSpec::new(
            "coefficient_negative",
            Quantity::Damping,
            (0.0, f64::INFINITY),
            0.0,
        ),
    ],
    action: Action::Joint(&OnCoordinate(AsymmetricViscous)),
    contains: &["viscous_friction"],
    probes: |scales, contained| {
        let known = contained.first().copied().unwrap_or(0.0);
        let d = scales.small_force() / scales.speed;
        [(d, -d), (d, 0.0), (0.0, d)]
            .map(|(positive, negative)| Probe {
                neutral: vec![known, known],
                perturbed: vec![known + positive, known + negative],
            })
            .to_vec()
    },
};
