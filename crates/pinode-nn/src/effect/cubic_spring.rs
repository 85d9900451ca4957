//! Cubic spring: Q = −k₃ q³.
//!
//! k₃ in N/m³ or N·m/rad³, of either sign (hardening or softening). Odd in q and growing; seen only at large amplitude.

use lagrange::Scalar;

use super::{
    Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Quantity, kind::from_zero,
};

struct CubicSpring;

impl ForceLaw for CubicSpring {
    fn force<D: Scalar>(&self, q: D, _v: D, p: &[D], _smoothing: D) -> D {
        -p[0] * q * q * q
    }
}

/// The kind `cubic_spring`.
pub static KIND: Kind = Kind {
    name: "cubic_spring",
    family: Family::Conservative,
    summary: "force that grows with the cube of the displacement",
    parameters: &[ParameterSpec::new(
        "stiffness",
        Quantity::CubicStiffness,
        (f64::NEG_INFINITY, f64::INFINITY),
        0.0,
    )],
    action: Action::Joint(&OnCoordinate(CubicSpring)),
    contains: &[],
    probes: |scales, _| {
        from_zero(scales.small_force() / (scales.centre.abs() + scales.reach).powi(3))
    },
};
