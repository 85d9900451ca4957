//! Viscous friction: Q = −c v.
//!
//! c in N·s/m or N·m·s/rad. The straight line through the origin over v; confused with quadratic drag when the speed hardly
//! varies, and with back-EMF of a motor.

use lagrange::Scalar;

use super::{
    Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Quantity, kind::from_zero,
};

struct Viscous;

impl ForceLaw for Viscous {
    fn force<D: Scalar>(&self, _q: D, v: D, p: &[D], _smoothing: D) -> D {
        -p[0] * v
    }
}

/// The kind `viscous_friction`.
pub static KIND: Kind = Kind {
    name: "viscous_friction",
    family: Family::Friction,
    summary: "force against the velocity, proportional to it",
    parameters: &[ParameterSpec::new(
        "coefficient",
        Quantity::Damping,
        (0.0, f64::INFINITY),
        0.0,
    )],
    action: Action::Joint(&OnCoordinate(Viscous)),
    contains: &[],
    probes: |scales, _| from_zero(scales.small_force() / scales.speed),
};
