//! Quadratic drag: Q = −d |v| v.
//!
//! d in N·s²/m² or N·m·s²/rad². Odd in v and curved upwards; air resistance.

use lagrange::Scalar;

use super::{
    Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Quantity, kind::from_zero,
};

struct QuadraticDrag;

impl ForceLaw for QuadraticDrag {
    fn force<D: Scalar>(&self, _q: D, v: D, p: &[D], _smoothing: D) -> D {
        -p[0] * v.abs() * v
    }
}

/// The kind `quadratic_drag`.
pub static KIND: Kind = Kind {
    name: "quadratic_drag",
    family: Family::Friction,
    summary: "force against the velocity, proportional to its square",
    parameters: &[ParameterSpec::new(
        "coefficient",
        Quantity::QuadraticDamping,
        (0.0, f64::INFINITY),
        0.0,
    )],
    action: Action::Joint(&OnCoordinate(QuadraticDrag)),
    contains: &[],
    probes: |scales, _| from_zero(scales.small_force() / scales.speed.powi(2)),
};
