//! Input dead zone: nothing arrives while |u| ≤ δ, u − δ sgn(u) beyond.
//!
//! δ, the half width of the zone, in units of the input. As Coulomb friction with the sign of the input in place of that of the
//! velocity: the two are told apart where u and v are out of phase.

use super::pointwise::{Pointwise, PointwiseLaw};
use super::{Action, Family, Kind, ParameterSpec, Quantity, kind::from_zero};

struct DeadZone;

impl PointwiseLaw for DeadZone {
    fn at(&self, u: f64, p: f64) -> (f64, f64, f64) {
        match u.abs() > p {
            true => (u - p.copysign(u), 1.0, -1_f64.copysign(u)),
            false => (0.0, 0.0, 0.0),
        }
    }
}

/// The kind `input_dead_zone`.
pub static KIND: Kind = Kind {
    name: "input_dead_zone",
    family: Family::Drive,
    summary: "small inputs do not act",
    parameters: &[ParameterSpec::new(
        "width",
        Quantity::Input,
        (0.0, f64::INFINITY),
        0.0,
    )],
    action: Action::Drive(&Pointwise(DeadZone)),
    contains: &[],
    probes: |scales, _| from_zero(0.05 * scales.input.max(f64::MIN_POSITIVE)),
};
