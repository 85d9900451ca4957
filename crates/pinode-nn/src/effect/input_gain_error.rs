//! Input gain error: u → (1 + g) u.
//!
//! g is a ratio, 0 where the gain in the model is right, −2 where its sign is wrong. The same as an error of all masses that the input moves, unless gravity
//! or another known force sets the scale.

use super::{
    Action, DriveLaw, Family, Grid, Kind, ParameterSpec, Quantity, Signal, kind::from_zero,
};

struct GainError;

impl DriveLaw for GainError {
    fn pass(&self, _grid: &Grid, p: &[f64], first: Option<usize>, signal: &mut Signal) {
        if let Some(index) = first {
            signal.by_parameter.push((index, signal.value.clone()));
        }
        let own = signal.by_parameter.len() - usize::from(first.is_some());
        for value in &mut signal.value {
            *value *= 1.0 + p[0];
        }
        for (_, derivative) in &mut signal.by_parameter[..own] {
            for value in derivative {
                *value *= 1.0 + p[0];
            }
        }
    }
}

/// The kind `input_gain_error`.
pub static KIND: Kind = Kind {
    name: "input_gain_error",
    family: Family::Drive,
    summary: "the input acts with another gain than the model's",
    parameters: &[ParameterSpec::new(
        "gain",
        Quantity::Ratio,
        (-3.0, 10.0),
        0.0,
    )],
    action: Action::Drive(&GainError),
    contains: &[],
    probes: |_, _| from_zero(0.05),
};
