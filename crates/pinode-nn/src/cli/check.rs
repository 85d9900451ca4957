//! `pinode check`: validates a model and prints it.

use std::fmt::Write;
use std::path::PathBuf;

use lagrange::Role;
use lagrange::mechanism::PoseForm;
use serde_json::{Value, json};

use super::output::Output;
use crate::Error;
use crate::effect::ParameterSpec;
use crate::limits::{Unstopped, unstopped};
use crate::model::{EffectEntry, Model, NetworkEntry, OnLink, Pushes};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// Refuse inertias that no real body can have instead of warning of them
    #[arg(long)]
    strict: bool,
}

pub(super) fn run(arguments: &Arguments, output: &Output) -> Result<(), Error> {
    let model = if arguments.strict {
        Model::load_strict(&arguments.model)?
    } else {
        Model::load(&arguments.model)?
    };
    output.result(&document(&model), &text(&model))
}

/// Bodies as (name, mass with its scale applied).
fn bodies(model: &Model) -> Vec<(&str, f64)> {
    let Some(tree) = &model.tree else {
        return Vec::new();
    };
    let scale = |name: &str| {
        let scales = model
            .mechanics
            .parameters()
            .iter()
            .zip(&model.parameter_values);
        scales
            .filter(|(p, _)| p.role == Role::MassScale && p.name == name)
            .map(|(_, &value)| value)
            .next()
            .unwrap_or(1.0)
    };
    tree.bodies()
        .iter()
        .map(|body| (body.name.as_str(), body.mass * scale(&body.name)))
        .collect()
}

/// How the poses of what floats are written, and by angles about which axis of the body roll is; neither where nothing floats.
fn pose(model: &Model) -> (Option<&'static str>, Option<&'static str>) {
    match model.pose {
        PoseForm::Angles(angles) => (Some("angles"), Some(angles.roll_axis.name())),
        PoseForm::Quaternion => (model.has_poses().then_some("quaternion"), None),
    }
}

/// Constants named in the energies.
fn constants(model: &Model) -> Vec<(&str, f64)> {
    let parameters = model.mechanics.parameters().iter();
    parameters
        .zip(&model.parameter_values)
        .filter(|(p, _)| p.role == Role::Constant)
        .map(|(p, &value)| (p.name.as_str(), value))
        .collect()
}

/// (parameter, value, unit) of an effect's parameters.
fn parameters<'a>(
    model: &'a Model,
    effect: &'a EffectEntry,
) -> impl Iterator<Item = (&'static ParameterSpec, f64, &'static str)> + 'a {
    let angular = model.target_is_angular(effect.target);
    effect
        .kind
        .parameters
        .iter()
        .zip(&effect.values)
        .filter(|(spec, value)| spec.is_told(**value))
        .map(move |(spec, &value)| (spec, value, spec.quantity.unit(angular)))
}

/// The networks of a model, one an `[[effect]]` table: the members of an ensemble are together.
fn networks(model: &Model) -> impl Iterator<Item = Network<'_>> {
    let tables = model.networks.chunk_by(|a, b| a.table == b.table);
    tables.filter_map(|members| {
        let first = members.first()?;
        Some(Network {
            members,
            joints: first.gives(model).into_iter().map(|d| d.name).collect(),
            sees: first.sees(model).into_iter().map(|d| d.name).collect(),
            parameters: first.force.network().parameters().len(),
            precision: match first.single {
                true => "f32",
                false => "f64",
            },
            alone: first.force.is_alone(),
        })
    })
}

struct Network<'a> {
    members: &'a [NetworkEntry],
    joints: Vec<String>,
    sees: Vec<String>,
    /// Of each member.
    parameters: usize,
    precision: &'static str,
    alone: bool,
}

impl Network<'_> {
    fn weights(&self) -> Vec<&str> {
        self.members.iter().map(|m| m.weights.as_str()).collect()
    }

    fn document(&self) -> Value {
        json!({
            "weights": self.weights(),
            "joints": self.joints,
            "sees": self.sees,
            "parameters": self.parameters,
            "precision": self.precision,
            "alone": self.alone,
        })
    }

    fn words(&self) -> String {
        let of = match self.members.len() {
            1 => String::new(),
            n => format!("the mean of {n}, each of "),
        };
        let alone = match self.alone {
            true => ", for all of Q there",
            false => "",
        };
        format!(
            "on {}{alone}: {of}{} parameters ({}), sees {}, from {}",
            self.joints.join(", "),
            self.parameters,
            self.precision,
            self.sees.join(", "),
            self.weights().join(", ")
        )
    }
}

fn document(model: &Model) -> Value {
    let coordinates = model.mechanics.coordinates();
    let named = |list: Vec<(&str, f64)>, key: &str| -> Vec<Value> {
        list.iter()
            .map(|(name, value)| json!({ "name": name, key: value }))
            .collect()
    };
    let inputs: Vec<Value> = model
        .inputs
        .iter()
        .map(|input| {
            let (name, gain) = (&input.name, input.gain);
            let target = model.target_name(input.target());
            match input.pushes {
                Pushes::Coordinate(_) => json!({ "name": name, "coordinate": target, "gain": gain }),
                Pushes::Link(OnLink { point, force, torque, .. }) => json!({
                    "name": name, "link": target, "point": point, "force": force, "torque": torque, "gain": gain,
                }),
            }
        })
        .collect();
    let effects: Vec<Value> = model
        .effects
        .iter()
        .map(|effect| {
            let parameters: serde_json::Map<String, Value> = parameters(model, effect)
                .map(|(spec, value, unit)| {
                    (spec.name.into(), json!({ "value": value, "unit": unit }))
                })
                .collect();
            json!({
                "kind": effect.kind.name,
                "target": model.target_name(effect.target),
                "parameters": parameters,
                "fixed": effect.fixed,
            })
        })
        .collect();
    let sensors: Vec<Value> = model
        .sensors
        .iter()
        .zip(coordinates)
        .map(|(sensor, coordinate)| {
            json!({
                "coordinate": coordinate.name,
                "position_noise": sensor.position_noise,
                "resolution": sensor.resolution,
                "velocity": sensor.velocity.name(),
                "zero": sensor.zero,
            })
        })
        .collect();
    let warnings: Vec<Value> = model
        .warnings
        .iter()
        .flat_map(|w| w.list.iter().map(|problem| (&w.source, problem)))
        .map(|(source, problem)| {
            json!({
                "file": source,
                "line": problem.position.map(|p| p.line),
                "column": problem.position.map(|p| p.column),
                "message": problem.message,
            })
        })
        .collect();
    let joints: Vec<Value> = model
        .tree
        .iter()
        .flat_map(|tree| tree.joints())
        .map(|joint| {
            let limits = joint.limits.filter(|_| joint.kind.is_single());
            json!({
                "name": joint.name,
                "limits": limits.map(|l| json!({
                    "lower": l.lower, "upper": l.upper, "effort": l.effort, "velocity": l.velocity,
                })),
                "type": joint.kind.name(),
                "parent": joint.parent,
                "child": joint.child,
                "follows": joint.mimic.as_ref().filter(|_| joint.follows).map(|m| json!({
                    "joint": m.leader, "multiplier": m.multiplier, "offset": m.offset,
                })),
            })
        })
        .collect();
    let constraints: Vec<Value> = model
        .constraints
        .iter()
        .map(|c| json!({ "name": c.name, "equation": c.description, "in_force": c.in_force }))
        .collect();
    let (pose, roll_axis) = pose(model);
    json!({
        "name": model.name,
        "pose": pose,
        "roll_axis": roll_axis,
        "coordinates": coordinates.iter().map(|c| json!({
            "name": c.name, "joint": c.joint, "nq": c.nq(), "nv": c.nv(), "unit": c.unit(), "wraps": c.wraps,
        })).collect::<Vec<_>>(),
        "joints": joints,
        "constraints": constraints,
        "masses": named(bodies(model), "mass"),
        "parameters": named(constants(model), "value"),
        "inputs": inputs,
        "effects": effects,
        "networks": networks(model).map(|network| network.document()).collect::<Vec<_>>(),
        "sensors": sensors,
        "warnings": warnings,
    })
}

fn text(model: &Model) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(out, "{}", model.name);
    let coordinates = model.mechanics.coordinates();
    let _ = writeln!(out, "\ncoordinates (in this order):");
    for c in coordinates {
        let wraps = if c.wraps { ", wraps" } else { "" };
        let more = match (c.floating, c.name == c.joint) {
            (true, _) => {
                " pose: in q position x y z and unit quaternion w x y z, in v linear and angular velocity in the body's axes"
                    .to_owned()
            }
            (false, false) => format!(" of joint {}", c.joint),
            (false, true) => String::new(),
        };
        let _ = writeln!(out, "  {} [{}{wraps}]{more}", c.name, c.unit());
    }
    if let (_, Some(axis)) = pose(model) {
        let _ = writeln!(
            out,
            "  the pose of what floats is by angles: yaw about z, then pitch, then roll about the {axis} axis of the body (`roll_axis`), which must stay \
             away from the vertical"
        );
    }
    if let Some(tree) = &model.tree {
        let _ = writeln!(out, "\njoints:");
        for joint in tree.joints() {
            let follows = match joint.mimic.as_ref().filter(|_| joint.follows) {
                Some(mimic) => format!(
                    ", follows {}: {} times its position + {}",
                    mimic.leader, mimic.multiplier, mimic.offset
                ),
                None => String::new(),
            };
            let _ = writeln!(
                out,
                "  {}: {}, {} -> {}{follows}",
                joint.name,
                joint.kind.name(),
                joint.parent,
                joint.child
            );
        }
        let unstopped = unstopped(model);
        for Unstopped { joint, limits, .. } in &unstopped {
            let unit = if joint.kind.is_angular() { "rad" } else { "m" };
            let _ = writeln!(
                out,
                "  {} has the limits {} … {} {unit}",
                joint.name, limits.lower, limits.upper
            );
        }
        if !unstopped.is_empty() {
            let _ = writeln!(
                out,
                "  these limits do not stop a motion: where one should, add an [[effect]] with kind = \"end_stop\", the joint, lower, upper, stiffness \
                 and damping"
            );
        }
        let _ = writeln!(out, "\nmoving masses:");
        for (name, mass) in bodies(model) {
            let _ = writeln!(out, "  {name}: {mass} kg");
        }
    }
    if !model.constraints.is_empty() {
        let _ = writeln!(out, "\nconstraints:");
    }
    for constraint in &model.constraints {
        let redundant = if constraint.in_force {
            ""
        } else {
            " (redundant, left out)"
        };
        let _ = writeln!(
            out,
            "  {}: {}{redundant}",
            constraint.name, constraint.description
        );
    }
    let constants = constants(model);
    if !constants.is_empty() {
        let _ = writeln!(out, "\nconstants:");
        for (name, value) in constants {
            let _ = writeln!(out, "  {name} = {value}");
        }
    }
    if !model.inputs.is_empty() {
        let _ = writeln!(out, "\ninputs:");
    }
    for input in &model.inputs {
        let target = model.target_name(input.target());
        let what = match input.pushes {
            Pushes::Coordinate(c) => coordinates.get(c).map_or("", |c| c.force_unit()).to_owned(),
            Pushes::Link(on) => format!("× ({on})"),
        };
        let _ = writeln!(
            out,
            "  {} on {target}, {} {what} per unit",
            input.name, input.gain
        );
    }
    if !model.effects.is_empty() {
        let _ = writeln!(out, "\neffects:");
    }
    for effect in &model.effects {
        let numbers: Vec<String> = parameters(model, effect)
            .map(|(spec, value, unit)| match spec.is_flag {
                true => format!("{} = true", spec.name),
                false => format!("{} = {value} {unit}", spec.name),
            })
            .collect();
        let _ = writeln!(
            out,
            "  {} on {}: {}{}",
            effect.kind.name,
            model.target_name(effect.target),
            numbers.join(", "),
            if effect.fixed { " (fixed)" } else { "" }
        );
    }
    if !model.networks.is_empty() {
        let _ = writeln!(out, "\nnetworks:");
    }
    for network in networks(model) {
        let _ = writeln!(out, "  {}", network.words());
    }
    let count: usize = model.warnings.iter().map(|w| w.list.len()).sum();
    if count > 0 {
        let plural = if count == 1 { "" } else { "s" };
        let _ = writeln!(out, "\n{count} warning{plural}:");
        for warnings in &model.warnings {
            let _ = writeln!(out, "{warnings}");
        }
    } else {
        let _ = writeln!(out, "\nno warnings");
    }
    out
}
