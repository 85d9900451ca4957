//! An eddy-current brake: Q = −c v / (1 + (v/v₀)²), on the right-hand side of M v̇ + C v + G = Q.
//!
//! c in N·s/m, v₀ in m/s. Viscous friction at low speed; beyond v₀, where the force is the largest, c v₀/2, the field of the currents
//! pushes the magnet's out of the conductor and the force falls (Smythe, Trans. AIEE 61, 1942). Odd in v, and in no library.

use lagrange::Scalar;
use pinode_nn::effect::{
    Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity,
};

struct EddyBrake;

impl ForceLaw for EddyBrake {
    fn force<D: Scalar>(&self, _q: D, v: D, p: &[D], _smoothing: D) -> D {
        let ratio = v / p[1];
        -p[0] * v / (ratio * ratio + 1.0)
    }
}

/// The kind `eddy_brake`.
pub static KIND: Kind = Kind {
    name: "eddy_brake",
    family: Family::Friction,
    summary: "force of the currents that a magnet induces: it falls again beyond a critical speed",
    parameters: &[
        ParameterSpec::new("coefficient", Quantity::Damping, (0.0, f64::INFINITY), 0.0),
        ParameterSpec::new(
            "critical_velocity",
            Quantity::Velocity,
            (1e-3, f64::INFINITY),
            1.0,
        ),
    ],
    action: Action::Joint(&OnCoordinate(EddyBrake)),
    contains: &["viscous_friction"],
    // A small brake with its critical speed low, in the middle and high among the speeds of the log.
    probes: |scales, _| {
        [0.1, 0.3, 0.8]
            .map(|share| {
                let critical = share * scales.speed;
                Probe {
                    neutral: vec![0.0, critical],
                    perturbed: vec![2.0 * scales.small_force() / critical, critical],
                }
            })
            .to_vec()
    },
};
