//! Backlash: a motor with play before it moves the joint,
//!
//! J v̇_m = f − T,  ė = v_m − v,  T = k s(e) + d s′(e) (v_m − v),  Q = T,
//!
//! s(e) = 0 within the gap |e| ≤ g/2 and e ∓ g/2 beyond, its corners rounded over a fiftieth of the gap. g in m or rad; k and d are stiffness
//! and damping of the teeth that touch, J the inertia on the motor's side. A force is lost after each reversal of it until the play is
//! crossed, then there is an impact. Small backlash looks like an elastic drive.

use lagrange::Scalar;

use super::{Action, Family, Kind, MemoryLaw, ParameterSpec, Probe, Quantity, Seen, WithMemory};

struct Backlash;

/// ½ (x + √(x² + w²)): 0 below, x above, rounded over w.
fn beyond<D: Scalar>(x: D, w: D) -> D {
    (x + (x * x + w * w).sqrt()) * 0.5
}

/// Its derivative in x.
fn touching<D: Scalar>(x: D, w: D) -> D {
    (x / (x * x + w * w).sqrt() + 1.0) * 0.5
}

/// Over what way the corners at half the `gap` are rounded.
fn rounding<D: Scalar>(gap: D) -> D {
    gap * 0.04 + 1e-9
}

/// T.
fn pull<D: Scalar>(seen: &Seen<'_, D>, p: &[D]) -> D {
    let (gap, e) = (p[0] * 0.5, seen.h[0]);
    let w = rounding(gap);
    let stretch = beyond(e - gap, w) - beyond(-e - gap, w);
    let touches = touching(e - gap, w) + touching(-e - gap, w);
    p[1] * stretch + p[2] * touches * (seen.h[1] - seen.v)
}

impl MemoryLaw for Backlash {
    fn states(&self) -> usize {
        2
    }
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: f64) -> D {
        pull(seen, p)
    }
    fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: f64, rate: &mut [D]) {
        rate[0] = seen.h[1] - seen.v;
        rate[1] = (seen.f - pull(seen, p)) / p[3];
    }
    fn start(&self, v: f64, f: f64, p: &[f64], h: &mut [f64]) {
        // T = f: with x beyond the corner at g/2, ½ (x + √(x² + w²)) = |f|/k. In the middle where nothing pushes.
        let (gap, stretch) = (0.5 * p[0], f.abs() / p[1]);
        let w = rounding(gap);
        let beyond = stretch - w * w / (4.0 * stretch);
        h[0] = match f == 0.0 {
            true => 0.0,
            false => (gap + beyond).max(0.0).copysign(f),
        };
        h[1] = v;
    }
    fn spread(&self, force: f64, speed: f64, p: &[f64], spread: &mut [f64]) {
        spread[0] = 0.5 * p[0] + force / p[1];
        spread[1] = (force / (p[1] * p[3]).sqrt()).min(speed);
    }
    fn fastest(&self, _speed: f64, mass: f64, p: &[f64]) -> f64 {
        let inverse = 1.0 / p[3] + 1.0 / mass;
        (p[1] * inverse).sqrt().max(p[2] * inverse)
    }
}

/// The kind `backlash`.
pub static KIND: Kind = Kind {
    name: "backlash",
    family: Family::Drive,
    summary: "the input moves a motor that has play before it moves the joint",
    parameters: &[
        ParameterSpec::new("gap", Quantity::Displacement, (0.0, f64::INFINITY), 0.0),
        ParameterSpec::new("stiffness", Quantity::Stiffness, (1e-3, 1e7), 1e4).held_at(1e4),
        ParameterSpec::new("damping", Quantity::Damping, (0.0, 1e5), 10.0).held_at(10.0),
        ParameterSpec::new(
            "motor_inertia",
            Quantity::Inertia,
            (1e-9, f64::INFINITY),
            1e-6,
        )
        .held_at(0.05),
    ],
    action: Action::Transmission(&WithMemory(Backlash)),
    contains: &[],
    probes: |scales, _| {
        let inertia = 0.1 * scales.mass;
        let stiffness = 200.0_f64.powi(2) * inertia;
        let damping = 0.5 * 200.0 * inertia;
        [0.01, 0.04]
            .map(|part| Probe {
                neutral: vec![0.0, stiffness, damping, 1e-3 * inertia],
                perturbed: vec![part * scales.reach, stiffness, damping, inertia],
            })
            .to_vec()
    },
};
