//! Hysteresis: a spring that slips, Q = −k z, ż = v [1 − ½ (1 + sgn(v z)) |z/w|^4].
//!
//! k stiffness in N/m or N·m/rad, w half width of the loop in m or rad: |z| stays below w (Bouc 1967, Wen 1976, with exponent 4: close to the
//! play of a spring behind a block that slides). The loop has the width 2w over the position whatever the speed.

use lagrange::Scalar;

use super::memory::STRAY;
use super::{
    Action, Family, Kind, MemoryLaw, ParameterSpec, Probe, Quantity, Scales, Seen, WithMemory,
};

struct Hysteresis;

impl MemoryLaw for Hysteresis {
    fn states(&self) -> usize {
        1
    }
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D) -> D {
        -p[0] * seen.h[0]
    }
    fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D, rate: &mut [D]) {
        // ½ (1 + sgn(v z)): 1 where it slips, 0 else, also at v z = 0.
        let slips = (-(seen.v * seen.h[0])).sign() * -0.5 + 0.5;
        let r = seen.h[0] / p[1];
        let r2 = r * r;
        rate[0] = seen.v * (-slips * r2 * r2 + 1.0);
    }
    fn start(&self, _v: f64, _f: f64, _p: &[f64], h: &mut [f64]) {
        h[0] = 0.0;
    }
    fn spread(&self, _force: f64, _speed: f64, p: &[f64], spread: &mut [f64]) {
        spread[0] = p[1];
    }
    fn stray(&self, noise: f64, _p: &[f64], spread: &mut [f64]) {
        spread[0] = spread[0].min(STRAY * noise);
    }
    /// It slips within the range of the motion.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        p[1] < scales.reach
    }
    fn fastest(&self, speed: f64, mass: f64, p: &[f64]) -> f64 {
        (4.0 * speed / p[1]).max((p[0] / mass).sqrt())
    }
}

/// The kind `hysteresis`.
pub static KIND: Kind = Kind {
    name: "hysteresis",
    family: Family::Memory,
    summary: "a spring that slips",
    parameters: &[
        ParameterSpec::new("stiffness", Quantity::Stiffness, (0.0, 1e12), 0.0),
        ParameterSpec::new("width", Quantity::Displacement, (1e-6, f64::INFINITY), 0.01),
    ],
    action: Action::Memory(&WithMemory(Hysteresis)),
    contains: &[],
    probes: |scales, _| {
        [0.02, 0.06, 0.2]
            .map(|way| {
                let width = way * scales.reach;
                Probe {
                    neutral: vec![0.0, width],
                    perturbed: vec![scales.small_force() / width, width],
                }
            })
            .to_vec()
    },
};
