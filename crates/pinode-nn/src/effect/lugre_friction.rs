//! LuGre friction: Q = −(σ₀ z + σ₁ ż), ż = v − σ₀ |v| z / g(v), g(v) = F_c + (F_s − F_c) exp(−(v/v_s)²).
//!
//! σ₀ in N/m, σ₁ in N·s/m, F_c and F_s in N, v_s in m/s (N·m and rad on an angle); z is the deflection of the bristles (Canudas de Wit et
//! al. 1995, whose σ₂ is `viscous_friction` here). Stribeck friction with a spring at rest; seen only where the way F_s/σ₀ is not
//! below the sensor's resolution.

use lagrange::Scalar;

use super::memory::STRAY;
use super::stribeck_friction::is_stribeck;
use super::{
    Action, Family, Kind, MemoryLaw, ParameterSpec, Probe, Quantity, Scales, Seen, WithMemory,
};

struct LuGre;

/// ż.
fn bristles<D: Scalar>(seen: &Seen<'_, D>, p: &[D]) -> D {
    let r = seen.v / p[4];
    let g = p[2] + (p[3] - p[2]) * (-r * r).exp();
    seen.v - p[0] * seen.v.abs() * seen.h[0] / g
}

impl MemoryLaw for LuGre {
    fn states(&self) -> usize {
        1
    }
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D) -> D {
        -p[0] * seen.h[0] - p[1] * bristles(seen, p)
    }
    fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D, rate: &mut [D]) {
        rate[0] = bristles(seen, p);
    }
    fn start(&self, _v: f64, _f: f64, _p: &[f64], h: &mut [f64]) {
        h[0] = 0.0;
    }
    fn spread(&self, _force: f64, _speed: f64, p: &[f64], spread: &mut [f64]) {
        spread[0] = p[2].max(p[3]) / p[0];
    }
    fn stray(&self, noise: f64, _p: &[f64], spread: &mut [f64]) {
        spread[0] = spread[0].min(STRAY * noise);
    }
    /// It slips within the range of the motion, and with the forces of Stribeck friction.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        let slips = p[2].max(p[3]) / p[0] < scales.reach;
        slips && is_stribeck([p[2], p[3], p[4]], scales)
    }
    fn fastest(&self, speed: f64, mass: f64, p: &[f64]) -> f64 {
        let decay = p[0] * speed / p[2].min(p[3]);
        decay.max((p[0] / mass).sqrt()).max(p[1] / mass)
    }
}

/// The kind `lugre_friction`.
pub static KIND: Kind = Kind {
    name: "lugre_friction",
    family: Family::Memory,
    summary: "friction of bristles that bend before they slip",
    parameters: &[
        ParameterSpec::new("stiffness", Quantity::Stiffness, (1e-9, 1e12), 1e3),
        ParameterSpec::new("damping", Quantity::Damping, (0.0, 1e12), 0.0),
        ParameterSpec::new(
            "coulomb_force",
            Quantity::Force,
            (1e-9, f64::INFINITY),
            1e-9,
        ),
        ParameterSpec::new("static_force", Quantity::Force, (1e-9, f64::INFINITY), 1e-9),
        ParameterSpec::new(
            "stribeck_velocity",
            Quantity::Velocity,
            (1e-4, f64::INFINITY),
            0.05,
        ),
    ],
    action: Action::Memory(&WithMemory(LuGre)),
    contains: &["coulomb_friction", "stribeck_friction", "dahl_friction"],
    probes: |scales, contained| {
        let d = scales.small_force();
        let slow = 0.1 * scales.speed;
        let (coulomb, statics, velocity) = match *contained {
            [force] => (force.max(1e-9), force + d, slow),
            [_, force] => (force.max(1e-9), force + d, slow),
            [coulomb, statics, velocity] => (coulomb.max(1e-9), statics.max(1e-9), velocity),
            _ => (d, 2.0 * d, slow),
        };
        let stiffnesses = match *contained {
            // Dahl's.
            [stiffness, _] => vec![stiffness],
            _ => [0.01, 0.05]
                .map(|way| statics / (way * scales.reach))
                .to_vec(),
        };
        let probe = |stiffness: f64| Probe {
            neutral: vec![stiffness, 0.0, 1e-9, 1e-9, velocity],
            perturbed: vec![stiffness, 0.0, coulomb, statics, velocity],
        };
        stiffnesses.into_iter().map(probe).collect()
    },
};
