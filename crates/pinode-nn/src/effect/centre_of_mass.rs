//! Centre of mass: a body whose centre of mass is closer to its joint, or farther from it, than the model says.
//!
//! ID(q, v, v̇) + m (ID₁(q, v, v̇; s) − ID₁(q, v, v̇; 1)) = Q, with ID₁ = M v̇ + C v + G of the same joints with nothing but 1 kg, s times as far from the joint as
//! the centre of mass of the model, and m the mass that the model's source gives the body.
//!
//! s as a number: below 1 it is closer; negative on the other side of the joint. The mass stays, and so does the inertia about the centre of mass. On the line
//! through the joint and the centre of mass alone: what is beside it has no kind. Confused with `added_mass` and `payload` where the mass does not show, as of an
//! arm's first link, with `link_inertia` where the weight does not, and with the mass scale of the body.

use super::inertial::{FARTHEST, PROBE};
use super::{Action, Family, Inertial, Kind, ParameterSpec, Probe, Quantity};

/// The kind `centre_of_mass`.
pub static KIND: Kind = Kind {
    name: "centre_of_mass",
    family: Family::Inertia,
    summary: "a centre of mass that is closer to the joint or farther from it",
    parameters: &[ParameterSpec::new(
        "place",
        Quantity::Ratio,
        (-FARTHEST, FARTHEST),
        1.0,
    )],
    action: Action::Inertial(Inertial::Centre),
    contains: &[],
    probes: |_, _| {
        vec![Probe {
            neutral: vec![1.0],
            perturbed: vec![1.0 + PROBE],
        }]
    },
};
