//! Dahl's friction: Q = −σ z, ż = v − σ z |v| / F_c.
//!
//! σ stiffness at rest in N/m or N·m/rad, F_c Coulomb force in N or N·m; z is the deflection of the contact, at most F_c/σ (Dahl 1968).
//! Coulomb friction that builds up over a way F_c/σ instead of at once; where that way is below the sensor's resolution the two are the
//! same. Confused with backlash and an elastic drive.

use lagrange::Scalar;

use super::memory::STRAY;
use super::{
    Action, Family, Kind, MemoryLaw, ParameterSpec, Probe, Quantity, Scales, Seen, WithMemory,
};

struct Dahl;

impl MemoryLaw for Dahl {
    fn states(&self) -> usize {
        1
    }
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D) -> D {
        -p[0] * seen.h[0]
    }
    fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D, rate: &mut [D]) {
        rate[0] = seen.v - p[0] * seen.h[0] * seen.v.abs() / p[1];
    }
    fn start(&self, _v: f64, _f: f64, _p: &[f64], h: &mut [f64]) {
        h[0] = 0.0;
    }
    fn spread(&self, _force: f64, _speed: f64, p: &[f64], spread: &mut [f64]) {
        spread[0] = p[1] / p[0];
    }
    fn stray(&self, noise: f64, _p: &[f64], spread: &mut [f64]) {
        spread[0] = spread[0].min(STRAY * noise);
    }
    /// It slips within the range of the motion.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        p[1] / p[0] < scales.reach
    }
    fn fastest(&self, speed: f64, mass: f64, p: &[f64]) -> f64 {
        (p[0] * speed / p[1]).max((p[0] / mass).sqrt())
    }
}

/// The kind `dahl_friction`.
pub static KIND: Kind = Kind {
    name: "dahl_friction",
    family: Family::Memory,
    summary: "Coulomb friction that builds up over a small way",
    parameters: &[
        ParameterSpec::new("stiffness", Quantity::Stiffness, (1e-9, 1e12), 1e3),
        ParameterSpec::new(
            "coulomb_force",
            Quantity::Force,
            (1e-9, f64::INFINITY),
            1e-9,
        ),
    ],
    action: Action::Memory(&WithMemory(Dahl)),
    contains: &["coulomb_friction"],
    probes: |scales, contained| {
        let force = contained
            .first()
            .copied()
            .filter(|force| *force > 0.0)
            .unwrap_or(scales.small_force());
        [0.01, 0.05, 0.2]
            .map(|way| {
                let stiffness = force / (way * scales.reach);
                Probe {
                    neutral: vec![stiffness, 1e-9],
                    perturbed: vec![stiffness, force],
                }
            })
            .to_vec()
    },
};
