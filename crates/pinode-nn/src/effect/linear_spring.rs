//! Linear spring: Q = −k (q − q₀).
//!
//! k in N/m or N·m/rad, rest position q₀ in m or rad. A line over q whatever v is; with a small k and a far rest position it
//! is a constant force.

use lagrange::Scalar;

use super::{Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity, Scales};

struct LinearSpring;

/// A spring that pulls from farther away, in units of the reach of the motion, is a constant force.
const FARTHEST: f64 = 10.0;

impl ForceLaw for LinearSpring {
    fn force<D: Scalar>(&self, q: D, _v: D, p: &[D], _smoothing: D) -> D {
        -p[0] * (q - p[1])
    }

    /// Its rest position is not out of all reach.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        (p[1] - scales.centre).abs() < FARTHEST * scales.reach
    }
}

/// The kind `linear_spring`.
pub static KIND: Kind = Kind {
    name: "linear_spring",
    family: Family::Conservative,
    summary: "force towards a rest position, proportional to the distance",
    parameters: &[
        ParameterSpec::new("stiffness", Quantity::Stiffness, (0.0, f64::INFINITY), 0.0),
        ParameterSpec::new(
            "rest",
            Quantity::Displacement,
            (f64::NEG_INFINITY, f64::INFINITY),
            0.0,
        ),
    ],
    action: Action::Joint(&OnCoordinate(LinearSpring)),
    contains: &[],
    probes: |scales, _| {
        let stiffness = scales.small_force() / scales.reach;
        [-1.0, 0.0, 1.0]
            .map(|side| {
                let rest = scales.centre + side * scales.reach;
                Probe {
                    neutral: vec![0.0, rest],
                    perturbed: vec![stiffness, rest],
                }
            })
            .to_vec()
    },
};
