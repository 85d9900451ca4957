//! Input saturation: u → −L for u < −L, L for u > L, else u.
//!
//! L in units of the input. Without effect where the log never exceeds it.

use super::pointwise::{Pointwise, PointwiseLaw};
use super::{Action, Family, Kind, ParameterSpec, Probe, Quantity};

struct Saturation;

impl PointwiseLaw for Saturation {
    fn at(&self, u: f64, p: f64) -> (f64, f64, f64) {
        match u.abs() > p {
            true => (p.copysign(u), 0.0, 1_f64.copysign(u)),
            false => (u, 1.0, 0.0),
        }
    }
}

/// The kind `input_saturation`.
pub static KIND: Kind = Kind {
    name: "input_saturation",
    family: Family::Drive,
    summary: "large inputs are cut off",
    parameters: &[ParameterSpec::new(
        "limit",
        Quantity::Input,
        (0.0, f64::INFINITY),
        f64::INFINITY,
    )],
    action: Action::Drive(&Pointwise(Saturation)),
    contains: &[],
    probes: |scales, _| {
        // The motion of a model that misses much of it is far from linear in the limit.
        [0.9, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08, 0.05]
            .map(|fraction| Probe {
                neutral: vec![scales.largest_input],
                perturbed: vec![fraction * scales.largest_input],
            })
            .to_vec()
    },
};
