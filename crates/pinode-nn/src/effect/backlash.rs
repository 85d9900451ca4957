//! Backlash: a motor with play before it moves the joint,
//!
//! J v̇_m = f − T,  ė = v_m − v,  T = k s(e) + d s′(e) (v_m − v),  Q = T + J v̇,
//!
//! s(e) = 0 within the gap |e| ≤ g/2 and e ∓ g/2 beyond, its corners rounded by parabolas over a fiftieth of the gap to each side, between
//! which nothing acts. g in m or rad; k and d are stiffness and damping of the teeth that touch. J is the inertia on the motor's side, seen
//! at the joint. The mechanism has it in its masses, as whoever weighed or identified a drive without knowing of its play: J v̇ takes it out
//! of the joint again, so that hard teeth without play change nothing. Within the play the motor moves by itself, and the rest of the joint
//! without it; then there is an impact. Small backlash looks like an elastic drive. Where the joint's sensor is on the motor (`sensor_on_motor`), it
//! reads q + e.

use lagrange::Scalar;

use super::{
    Action, Family, Kind, LeftOut, MemoryLaw, Motor, ParameterSpec, Probe, Quantity, Scales, Seen,
    WithMemory,
};

/// What is taken for the motor and its teeth beside the joint's own entry of M: a tenth of the inertia, teeth on which it swings with
/// 400 rad/s and 0.6 of the critical damping: a blow of some 8 ms that gives a tenth of the speed back.
const MOTOR: f64 = 0.1;
const STIFFNESS: f64 = 400.0 * 400.0 * MOTOR;
const DAMPING: f64 = 1.2 * 400.0 * MOTOR;

struct Backlash;

/// x kept within ±w, without asking for a number.
fn within<D: Scalar>(x: D, w: D) -> D {
    ((x + w).abs() - (x - w).abs()) * 0.5
}

/// 0 below −w, (x + w)²/(4 w), x above w. A rounding that goes on for ever, as ½ (x + √(x² + w²)), would drive the motor to the middle of
/// its play with k w²/(4 x), as strongly as friction where the teeth are hard.
fn beyond<D: Scalar>(x: D, w: D) -> D {
    let corner = within(x, w) + w;
    let above = ((x - w).abs() + x - w) * 0.5;
    corner * corner / (w * 4.0) + above
}

/// Its derivative in x.
fn touching<D: Scalar>(x: D, w: D) -> D {
    (within(x, w) / w + 1.0) * 0.5
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

/// Index of J.
const INERTIA: usize = 3;
const ITS_MOTOR: Motor = Motor {
    inertia: INERTIA,
    within: None,
    read: 4,
};

/// A gap of less than this part of the noise shows in no log, however long.
const LEAST_GAP: f64 = 0.01;

impl MemoryLaw for Backlash {
    fn states(&self) -> usize {
        2
    }
    fn motor(&self) -> Option<Motor> {
        Some(ITS_MOTOR)
    }
    /// Without a gap it is an elastic transmission.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        p[0] > LEAST_GAP * scales.noise
    }
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D) -> D {
        pull(seen, p)
    }
    fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D, rate: &mut [D]) {
        rate[0] = seen.h[1] - seen.v;
        rate[1] = (seen.f - pull(seen, p)) / p[INERTIA];
    }
    fn start(&self, v: f64, f: f64, p: &[f64], h: &mut [f64]) {
        // T = f: beyond the corner at g/2 by the x that stretches by |f|/k. In the middle where nothing pushes.
        let (gap, stretch) = (0.5 * p[0], f.abs() / p[1]);
        let w = rounding(gap);
        let beyond = match stretch < w {
            true => 2.0 * (w * stretch).sqrt() - w,
            false => stretch,
        };
        h[0] = match f == 0.0 {
            true => 0.0,
            false => (gap + beyond).max(0.0).copysign(f),
        };
        h[1] = v;
    }
    fn spread(&self, force: f64, speed: f64, p: &[f64], spread: &mut [f64]) {
        spread[0] = 0.5 * p[0] + force / p[1];
        spread[1] = (force / (p[1] * p[INERTIA]).sqrt()).min(speed);
    }
    fn fastest(&self, _speed: f64, mass: f64, p: &[f64]) -> f64 {
        let inverse = ITS_MOTOR.inverse(mass, p);
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
        ParameterSpec::new("stiffness", Quantity::Stiffness, (1e-9, 1e12), 1e4)
            .left_out_as(LeftOut::OfInertia(STIFFNESS))
            .held(),
        ParameterSpec::new("damping", Quantity::Damping, (0.0, 1e12), 10.0)
            .left_out_as(LeftOut::OfInertia(DAMPING))
            .held(),
        ParameterSpec::new(
            "motor_inertia",
            Quantity::Inertia,
            (1e-18, f64::INFINITY),
            1e-6,
        )
        .left_out_as(LeftOut::OfInertia(MOTOR)),
        ParameterSpec::flag("sensor_on_motor"),
    ],
    action: Action::Transmission(&WithMemory(Backlash)),
    contains: &[],
    probes: |scales, _| {
        let [inertia, damping] = [MOTOR, DAMPING / scales.pace].map(|x| x * scales.mass);
        let stiffness = STIFFNESS / scales.pace.powi(2) * scales.mass;
        // What shows is the time without force, which grows with the play and with the inertia: one may stand for the other.
        let sizes = [
            (0.005, 1.0),
            (0.005, 3.0),
            (0.015, 1.0),
            (0.015, 3.0),
            (0.04, 1.0),
            (0.04, 3.0),
        ];
        sizes
            .map(|(part, motor)| Probe {
                neutral: vec![0.0, stiffness, damping, 1e-3 * inertia, 0.0],
                perturbed: vec![
                    part * scales.reach,
                    stiffness,
                    damping,
                    motor * inertia,
                    0.0,
                ],
            })
            .to_vec()
    },
};
