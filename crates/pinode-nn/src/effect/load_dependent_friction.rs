//! Friction that grows with the load of the drive: Q = −μ |f| sgn(v), the sign spread over the smoothing velocity; f is the force of the
//! inputs on the joint.
//!
//! μ is a ratio: the part of the drive's force that its gears lose. Only on joints with an input. Against an input gain error: this one
//! takes away when the drive pushes and adds to it when the drive brakes.

use lagrange::Scalar;

use super::{
    Action, Family, Kind, MemoryLaw, ParameterSpec, Quantity, Seen, WithMemory, kind::from_zero,
    smooth_sign,
};

struct LoadDependent;

impl MemoryLaw for LoadDependent {
    fn states(&self) -> usize {
        0
    }
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], smoothing: D) -> D {
        -p[0] * seen.f.abs() * smooth_sign(seen.v, smoothing)
    }
    fn rate<D: Scalar>(&self, _: &Seen<'_, D>, _: &[D], _: D, _: &mut [D]) {}
    fn start(&self, _: f64, _: f64, _: &[f64], _: &mut [f64]) {}
    fn spread(&self, _: f64, _: f64, _: &[f64], _: &mut [f64]) {}
    fn fastest(&self, _: f64, _: f64, _: &[f64]) -> f64 {
        0.0
    }
}

/// The kind `load_dependent_friction`.
pub static KIND: Kind = Kind {
    name: "load_dependent_friction",
    family: Family::Friction,
    summary: "force against the velocity, proportional to the force of the drive",
    parameters: &[ParameterSpec::new(
        "coefficient",
        Quantity::Ratio,
        (0.0, 1.0),
        0.0,
    )],
    action: Action::Memory(&WithMemory(LoadDependent)),
    contains: &[],
    probes: |scales, _| match scales.input > 0.0 {
        true => from_zero(0.05),
        false => Vec::new(),
    },
};
