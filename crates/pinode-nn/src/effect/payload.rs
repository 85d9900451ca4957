//! Payload: the equations of motion of a point mass m on the line from the joint of the body that the link belongs to, through its centre of mass.
//!
//! ID(q, v, v̇) + m ID₁(q, v, v̇; s) = Q, with ID₁ = M v̇ + C v + G of the same joints with nothing but 1 kg, s times as far from the joint as the
//! centre of mass.
//!
//! m in kg, s as a number: 1 is the centre of mass, 2 the end of a slender rod that hangs on its own. What an arm holds, a tool, a cable's end; negative masses are
//! [`added_mass`](super::added_mass)'s. Confused with that where the place does not show, and with `reflected_inertia` where neither weight does.

use super::inertial::{FARTHEST, PROBE};
use super::{Action, Family, Inertial, Kind, ParameterSpec, Probe, Quantity};

/// The kind `payload`.
pub static KIND: Kind = Kind {
    name: "payload",
    family: Family::Inertia,
    summary: "a point mass that is held away from the centre of mass of a body",
    parameters: &[
        ParameterSpec::new("mass", Quantity::Inertia, (0.0, f64::INFINITY), 0.0),
        ParameterSpec::new("place", Quantity::Ratio, (0.0, FARTHEST), 1.0),
    ],
    action: Action::Inertial(Inertial::Payload),
    contains: &["added_mass"],
    probes: |scales, contained| {
        let step = PROBE * scales.mass;
        let probe = |neutral: [f64; 2], perturbed: [f64; 2]| Probe {
            neutral: neutral.to_vec(),
            perturbed: perturbed.to_vec(),
        };
        match contained.first() {
            // Beside a mass that is there its place alone is new.
            Some(&mass) if mass > 0.0 => vec![probe([mass, 1.0], [mass, 1.0 + PROBE])],
            // What takes mass away is held by nobody.
            Some(_) => Vec::new(),
            None => [0.5, 2.0, 4.0]
                .map(|place| probe([0.0, place], [step, place]))
                .to_vec(),
        }
    },
};
