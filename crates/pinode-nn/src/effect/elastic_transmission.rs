//! Elastic transmission: a motor of its own inertia that pulls the joint by a spring and a damper,
//!
//! J v̇_m = f − T − c v_m,  ė = v_m − v,  T = k e + d (v_m − v),  Q = T,
//!
//! e the stretch, v_m the motor's velocity, seen at the joint; f the force of the input, which acts on the motor. k in N/m or N·m/rad, d in
//! N·s/m or N·m·s/rad, J in kg or kg·m². c, in N·s/m or N·m·s/rad, is the viscous friction of the motor itself, none where a file leaves it out:
//! friction of the joint is the load's. Two things a log does not say by itself, and that are no or yes:
//!
//! - `motor_in_mass`: whether the mechanism has J in its masses, as whoever identified the machine as a rigid one has it. Then Q = T + J v̇, as of a
//!   [backlash](super::backlash), so that a stiff spring changes nothing. Else the motor's inertia comes on top.
//! - `sensor_on_motor`: whether the joint's sensor is on the motor, as of most robots, and reads q + e. Else it reads q.
//!
//! Below a few milliseconds a stiff string, a lag and a delay look alike.

use lagrange::Scalar;

use super::{
    Action, Family, Kind, LeftOut, MemoryLaw, Motor, ParameterSpec, Probe, Quantity, Scales, Seen,
    WithMemory,
};

struct Elastic;

const ITS_MOTOR: Motor = Motor {
    inertia: 2,
    within: Some(4),
    read: 5,
};
/// Index of c.
const FRICTION: usize = 3;

/// T.
fn pull<D: Scalar>(seen: &Seen<'_, D>, p: &[D]) -> D {
    p[0] * seen.h[0] + p[1] * (seen.h[1] - seen.v)
}

impl MemoryLaw for Elastic {
    fn states(&self) -> usize {
        2
    }
    fn motor(&self) -> Option<Motor> {
        Some(ITS_MOTOR)
    }
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D) -> D {
        pull(seen, p)
    }
    fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _smoothing: D, rate: &mut [D]) {
        rate[0] = seen.h[1] - seen.v;
        rate[1] = (seen.f - pull(seen, p) - p[FRICTION] * seen.h[1]) / p[2];
    }
    fn start(&self, v: f64, f: f64, p: &[f64], h: &mut [f64]) {
        h[0] = f / p[0];
        h[1] = v;
    }
    fn spread(&self, force: f64, speed: f64, p: &[f64], spread: &mut [f64]) {
        spread[0] = force / p[0];
        spread[1] = (force / (p[0] * p[2]).sqrt()).min(speed);
    }
    /// The motor swings: d is below the critical damping 2 √(k μ), 1/μ = 1/J + 1/m.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        let inverse = ITS_MOTOR.inverse(scales.free_mass, p);
        p[1] < 2.0 * (p[0] / inverse).sqrt()
    }
    fn fastest(&self, _speed: f64, mass: f64, p: &[f64]) -> f64 {
        let inverse = ITS_MOTOR.inverse(mass, p);
        (p[0] * inverse).sqrt().max(p[1] * inverse)
    }
}

/// The kind `elastic_transmission`.
pub static KIND: Kind = Kind {
    name: "elastic_transmission",
    family: Family::Drive,
    summary: "the input moves a motor that pulls the joint by a spring",
    parameters: &[
        ParameterSpec::new("stiffness", Quantity::Stiffness, (1e-9, 1e12), 1e5),
        ParameterSpec::new("damping", Quantity::Damping, (0.0, 1e12), 0.0),
        ParameterSpec::new(
            "motor_inertia",
            Quantity::Inertia,
            (1e-18, f64::INFINITY),
            1e-6,
        ),
        ParameterSpec::new("motor_friction", Quantity::Damping, (0.0, 1e12), 0.0)
            .left_out_as(LeftOut::Value(0.0))
            .held(),
        ParameterSpec::flag("motor_in_mass"),
        ParameterSpec::flag("sensor_on_motor"),
    ],
    action: Action::Transmission(&WithMemory(Elastic)),
    contains: &[],
    probes: |scales, _| {
        let inertia = 0.1 * scales.mass;
        [40.0, 120.0]
            .map(|usual: f64| {
                let frequency = usual / scales.pace;
                let stiffness = frequency * frequency * inertia;
                let damping = 0.4 * frequency * inertia;
                Probe {
                    neutral: vec![100.0 * stiffness, damping, 1e-3 * inertia, 0.0, 0.0, 0.0],
                    perturbed: vec![stiffness, damping, inertia, 0.0, 0.0, 0.0],
                }
            })
            .to_vec()
    },
};
