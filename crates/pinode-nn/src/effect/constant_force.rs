//! Constant force: Q = F.
//!
//! F in N or N·m, of either sign: the pull of a cable, an offset of the input, a tilt. While sliding, the same as a difference
//! of Coulomb friction between the two directions.

use lagrange::Scalar;

use super::{
    Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Quantity, kind::from_zero,
};

struct ConstantForce;

impl ForceLaw for ConstantForce {
    fn force<D: Scalar>(&self, _q: D, _v: D, p: &[D], _smoothing: D) -> D {
        p[0]
    }
}

/// The kind `constant_force`.
pub static KIND: Kind = Kind {
    name: "constant_force",
    family: Family::Conservative,
    summary: "constant force",
    parameters: &[ParameterSpec::new(
        "force",
        Quantity::Force,
        (f64::NEG_INFINITY, f64::INFINITY),
        0.0,
    )],
    action: Action::Joint(&OnCoordinate(ConstantForce)),
    contains: &[],
    probes: |scales, _| from_zero(scales.small_force()),
};
