//! Input offset: u → u + b.
//!
//! b in units of the input. On a joint the same as a constant force there, but for a delay or a saturation behind it.

use super::pointwise::{Pointwise, PointwiseLaw};
use super::{Action, Family, Kind, ParameterSpec, Quantity, kind::from_zero};

struct Offset;

impl PointwiseLaw for Offset {
    fn at(&self, u: f64, p: f64) -> (f64, f64, f64) {
        (u + p, 1.0, 1.0)
    }
}

/// The kind `input_offset`.
pub static KIND: Kind = Kind {
    name: "input_offset",
    family: Family::Drive,
    summary: "something is added to the input",
    parameters: &[ParameterSpec::new(
        "offset",
        Quantity::Input,
        (f64::NEG_INFINITY, f64::INFINITY),
        0.0,
    )],
    action: Action::Drive(&Pointwise(Offset)),
    contains: &[],
    probes: |scales, _| from_zero(0.05 * scales.input.max(f64::MIN_POSITIVE)),
};
