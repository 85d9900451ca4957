//! What such a rig hides: one effect of a kind of the library on one of its joints or inputs.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Bench;
use crate::config::Range;
use crate::rig::Error;
use crate::rig::effects::{Drive, DryFriction, ElasticString, JointForces};

/// The kinds that are hidden in turn.
pub const KINDS: [&str; 14] = [
    "viscous_friction",
    "coulomb_friction",
    "asymmetric_coulomb_friction",
    "stribeck_friction",
    "quadratic_drag",
    "linear_spring",
    "constant_force",
    "input_gain_error",
    "input_offset",
    "input_delay",
    "actuator_lag",
    "input_dead_zone",
    "input_saturation",
    "elastic_transmission",
];

/// A hidden effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// One of [`KINDS`].
    pub kind: &'static str,
    /// The joint, or for a kind of the drive the input, by index.
    pub target: usize,
    /// Its parameters by name, SI units, as in a model file.
    pub parameters: Vec<(&'static str, f64)>,
}

impl Fault {
    /// Whether it sits on an input.
    pub fn is_of_the_drive(&self) -> bool {
        self.kind.starts_with("input_")
            || ["actuator_lag", "elastic_transmission"].contains(&self.kind)
    }

    /// A parameter; 0 for one that it has not.
    fn get(&self, name: &str) -> f64 {
        let found = self.parameters.iter().find(|(n, _)| *n == name);
        found.map_or(0.0, |(_, x)| *x)
    }

    /// Puts it on its joint. Friction of the kind or the joint's own law takes the place of the known one.
    pub(super) fn on_joint(&self, joint: &mut JointForces) {
        let dry = |positive, negative| DryFriction {
            against_positive: positive,
            against_negative: negative,
            ..DryFriction::default()
        };
        let p = |name| self.get(name);
        match self.kind {
            "viscous_friction" => joint.viscous = [p("coefficient"); 2],
            "coulomb_friction" => joint.dry = dry(p("force"), p("force")),
            "asymmetric_coulomb_friction" => {
                joint.dry = dry(p("force_positive"), p("force_negative"));
            }
            "stribeck_friction" => {
                joint.dry = DryFriction {
                    stribeck: p("static_force") - p("coulomb_force"),
                    stribeck_velocity: p("stribeck_velocity"),
                    ..dry(p("coulomb_force"), p("coulomb_force"))
                };
            }
            "quadratic_drag" => joint.quadratic = p("coefficient"),
            "linear_spring" => (joint.spring, joint.rest) = (p("stiffness"), p("rest")),
            "constant_force" => joint.constant = p("force"),
            _ => {}
        }
    }

    /// The string between its motor and the joint, if that is what it is.
    pub(super) fn string(&self) -> Option<ElasticString> {
        (self.kind == "elastic_transmission").then(|| ElasticString {
            stiffness: self.get("stiffness"),
            damping: self.get("damping"),
            motor_inertia: self.get("motor_inertia"),
            hardening: 0.0,
            free_play: 0.0,
        })
    }

    /// Puts it on its input.
    pub(super) fn on_drive(&self, drive: &mut Drive) {
        match self.kind {
            "input_gain_error" => drive.gain = self.get("gain"),
            "input_offset" => drive.offset = self.get("offset"),
            "input_delay" => drive.delay = self.get("delay"),
            "actuator_lag" => drive.lag = Some(self.get("time_constant")),
            "input_dead_zone" => drive.dead_zone = self.get("width"),
            "input_saturation" => drive.limit = Some(self.get("limit")),
            _ => {}
        }
    }

    /// An effect of the kind with this index in [`KINDS`] (taken modulo) on a drawn target, with drawn sizes, in shares of what the
    /// joint's friction, speed and range are.
    pub(super) fn draw(bench: &Bench, kind: usize, seed: u64) -> Result<Fault, Error> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let kind = KINDS.get(kind % KINDS.len()).copied().unwrap_or_default();
        let mut fault = Fault {
            kind,
            target: 0,
            parameters: Vec::new(),
        };
        let drive = fault.is_of_the_drive();
        let targets = if drive {
            bench.inputs.len()
        } else {
            bench.joints.len()
        };
        fault.target = rng.random_range(0..targets.max(1));
        let joint_index = match drive {
            true => bench.inputs.get(fault.target).map_or(0, |i| i.joint),
            false => fault.target,
        };
        let Some(joint) = bench.joints.get(joint_index) else {
            return Ok(fault);
        };
        let mut size = |[from, to]: Range| rng.random_range(from..=to);
        let (force, speed, known) = (joint.force, joint.speed, joint.coulomb);
        fault.parameters = match kind {
            "viscous_friction" => vec![("coefficient", size([0.6, 1.4]) * joint.viscous_size())],
            "coulomb_friction" => vec![("force", size([0.6, 1.4]) * force)],
            "asymmetric_coulomb_friction" => {
                let (mean, apart) = (if known > 0.0 { known } else { force }, size([0.25, 0.6]));
                vec![
                    ("force_positive", mean * (1.0 + apart)),
                    ("force_negative", mean * (1.0 - apart)),
                ]
            }
            "stribeck_friction" => vec![
                ("coulomb_force", if known > 0.0 { known } else { force }),
                ("static_force", force * (1.0 + size([0.4, 1.0]))),
                ("stribeck_velocity", size([0.05, 0.15]) * speed),
            ],
            "quadratic_drag" => vec![("coefficient", size([0.6, 1.5]) * force / (speed * speed))],
            "linear_spring" => vec![
                ("stiffness", size([1.0, 3.0]) * force / joint.range),
                ("rest", joint.centre + size([-0.2, 0.2]) * joint.range),
            ],
            "constant_force" => vec![("force", size([0.4, 1.0]) * force)],
            "input_gain_error" => vec![("gain", size([0.05, 0.15]))],
            "input_offset" => vec![("offset", size([0.4, 1.0]) * force)],
            "input_delay" => vec![("delay", size([0.01, 0.04]))],
            "actuator_lag" => vec![("time_constant", size([0.01, 0.04]))],
            "input_dead_zone" => vec![("width", size([0.5, 1.2]) * force)],
            "elastic_transmission" => {
                let mass = bench.inertia(joint_index)?;
                let (rate, ratio) = (TAU * size([8.0, 14.0]), size([0.1, 0.25]));
                let inertia = size([0.1, 0.3]) * mass;
                vec![
                    ("stiffness", inertia * rate * rate),
                    ("damping", 2.0 * ratio * inertia * rate),
                    ("motor_inertia", inertia),
                ]
            }
            _ => vec![(
                "limit",
                size([0.6, 0.9]) * bench.large_input(fault.target, seed)?,
            )],
        };
        if rng.random_bool(0.5) {
            match (kind, fault.parameters.as_mut_slice()) {
                ("asymmetric_coulomb_friction", [(_, a), (_, b)]) => std::mem::swap(a, b),
                ("constant_force" | "input_gain_error" | "input_offset", [(_, x)]) => *x = -*x,
                _ => {}
            }
        }
        Ok(fault)
    }
}
