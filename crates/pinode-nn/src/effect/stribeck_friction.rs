//! Stribeck friction: Q = −[F_c + (F_s − F_c) exp(−(v/v_s)²)] sgn(v), the sign spread over the smoothing velocity.
//!
//! F_c sliding and F_s static force in N or N·m, v_s Stribeck velocity in m/s or rad/s (Canudas de Wit et al. 1995, with
//! exponent 2). A hump at low speed on top of Coulomb friction; needs slow motion to be seen.

use integrators::event::Direction;
use lagrange::Scalar;

use super::{
    Action, DryFriction, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity,
    Scales, smooth_sign,
};

struct Stribeck;

/// F_c + (F_s − F_c) exp(−(v/v_s)²): the static force F_s at rest.
fn hump<D: Scalar>(v: D, p: &[D]) -> D {
    let r = v / p[2];
    p[0] + (p[1] - p[0]) * (-r * r).exp()
}

impl ForceLaw for Stribeck {
    fn force<D: Scalar>(&self, _q: D, v: D, p: &[D], smoothing: D) -> D {
        -hump(v, p) * smooth_sign(v, smoothing)
    }

    fn dry(&self) -> Option<&dyn DryFriction> {
        Some(self)
    }

    /// Its force at rest is the larger one: friction that comes with speed is another.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        p[1] > p[0] && is_stribeck([p[0], p[1], p[2]], scales)
    }
}

/// The Stribeck velocity is among the speeds of the motion, down to this share of the large ones: below it a hump is made of how the sign is spread.
const SLOWEST: f64 = 5e-3;
/// Friction that has less than this share of its sliding force at rest does not hold there. Bristles leave their static force uncertain.
const HOLDS: f64 = 0.5;

/// Whether sliding force, static force and Stribeck velocity are those of friction at rest and at speeds that the motion has.
pub(super) fn is_stribeck([sliding, at_rest, velocity]: [f64; 3], scales: &Scales) -> bool {
    velocity > SLOWEST * scales.speed && at_rest > HOLDS * sliding
}

impl DryFriction for Stribeck {
    fn size(&self, _: Direction, _: f64, speed: f64, p: &[f64]) -> f64 {
        hump(speed, p)
    }
}

/// The kind `stribeck_friction`.
pub static KIND: Kind = Kind {
    name: "stribeck_friction",
    family: Family::Friction,
    summary: "Coulomb friction that is larger at low speed",
    parameters: &[
        ParameterSpec::new("coulomb_force", Quantity::Force, (0.0, f64::INFINITY), 0.0),
        ParameterSpec::new("static_force", Quantity::Force, (0.0, f64::INFINITY), 0.0),
        ParameterSpec::new(
            "stribeck_velocity",
            Quantity::Velocity,
            (1e-4, f64::INFINITY),
            0.05,
        ),
    ],
    action: Action::Joint(&OnCoordinate(Stribeck)),
    contains: &["coulomb_friction"],
    probes: |scales, contained| {
        let force = contained.first().copied().unwrap_or(0.0);
        let d = scales.small_force();
        // Beside known Coulomb friction the hump alone is new.
        let step = if contained.is_empty() { d } else { 0.0 };
        [0.03, 0.08, 0.2, 0.6]
            .map(|fraction| {
                let velocity = fraction * scales.speed;
                Probe {
                    neutral: vec![force, force, velocity],
                    perturbed: vec![force + step, force + step + d, velocity],
                }
            })
            .to_vec()
    },
};
