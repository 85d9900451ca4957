//! Force that repeats along the way: Q = A sin(2π q/λ + φ).
//!
//! A in N or N·m, of either sign, period λ in m or rad, phase φ in rad: the cogging of a motor, the teeth of a belt, an eccentric pulley. Periodic in the
//! position, not in time.

use std::f64::consts::TAU;

use lagrange::Scalar;

use super::{Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity, Scales};

struct Periodic;

impl ForceLaw for Periodic {
    fn force<D: Scalar>(&self, q: D, _v: D, p: &[D], _smoothing: f64) -> D {
        p[0] * (q / p[1] * TAU + p[2]).sin()
    }

    /// It repeats within the range of the motion.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        p[1] < 2.0 * scales.reach / FEWEST_PERIODS
    }
}

/// A screen tries so many numbers of periods in the range of the motion, from one and a half on, three quarters apart: over the whole
/// range a force falls out of step with the nearest one by less than half a turn, from where a fit finds to it.
const PERIODS: usize = 42;
/// What repeats more seldom in the range of the motion is a bent spring.
const FEWEST_PERIODS: f64 = 1.4;

/// The kind `periodic_force`.
pub static KIND: Kind = Kind {
    name: "periodic_force",
    family: Family::Conservative,
    summary: "force that repeats along the way",
    parameters: &[
        ParameterSpec::new(
            "amplitude",
            Quantity::Force,
            (f64::NEG_INFINITY, f64::INFINITY),
            0.0,
        ),
        ParameterSpec::new("period", Quantity::Displacement, (1e-6, f64::INFINITY), 0.1),
        ParameterSpec::new("phase", Quantity::Angle, (-1e3, 1e3), 0.0),
    ],
    action: Action::Joint(&OnCoordinate(Periodic)),
    contains: &[],
    probes: |scales, _| {
        let d = scales.small_force();
        let periods = (0..PERIODS).map(|k| 2.0 * scales.reach / (1.5 + 0.75 * k as f64));
        periods
            .flat_map(|period| {
                [0.0, 0.25].map(|turn| {
                    // The phase is that in the middle of the motion.
                    let phase = (turn - scales.centre / period).rem_euclid(1.0) * TAU;
                    Probe {
                        neutral: vec![0.0, period, phase],
                        perturbed: vec![d, period, phase],
                    }
                })
            })
            .collect()
    },
};
