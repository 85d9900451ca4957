//! The effects of a model: `[[effect]]` tables, and friction from the URDF's `<dynamics>`.

use lagrange::{Mechanics, Position, Problem};
use toml::de::DeValue;

use super::document::{Faults, Section};
use super::mechanism::{JointFriction, Mechanism, find_coordinate, find_link};
use super::networks;
use super::{EffectEntry, Input, Target};
use crate::effect::{Action, ActsOn, Kind, Misplaced, RigidStop, moved, registry};
use crate::entries::starts;
use crate::naming::{hint, nearest, quoted};
use crate::typical::typical;

/// The `[[effect]]` tables, each with its byte offset.
pub(super) fn read(
    root: &Section,
    mechanism: Option<&Mechanism>,
    inputs: &[Input],
    faults: &mut Faults,
) -> Vec<(usize, EffectEntry)> {
    let mut effects: Vec<(usize, EffectEntry)> = Vec::new();
    let body_of = |effect: &EffectEntry| match effect.target {
        Target::Link(link) => mechanism?.tree.as_ref()?.links().get(link)?.body,
        _ => None,
    };
    let tables = root.sections("effect", faults);
    let mut tables: Vec<Section> = (tables.into_iter())
        .filter(|t| !networks::is_network(t))
        .collect();
    // What is known exactly first: others may take from it.
    tables.sort_by_key(|table| !is_fixed(table));
    for table in tables {
        let Some(effect) = read_one(&table, mechanism, (inputs, &effects), faults) else {
            continue;
        };
        let body = body_of(&effect);
        let same = |other: &EffectEntry| {
            other.target == effect.target || (body.is_some() && body_of(other) == body)
        };
        // What is known exactly may have more of its kind beside it, which is not.
        let alike = |other: &EffectEntry| other.kind == effect.kind && other.fixed == effect.fixed;
        if effects.iter().any(|(_, other)| alike(other) && same(other)) {
            faults.at(
                table.offset,
                format!(
                    "{} acts on this target already: the two cannot be told apart, make them one{}",
                    effect.kind.name,
                    match effect.fixed {
                        true => "",
                        false => ", or `fixed = true` the one that is known exactly",
                    }
                ),
            );
        } else if let Some((_, other)) = effects
            .iter()
            .find(|(_, other)| other.target == effect.target && other.kind.excludes(effect.kind))
        {
            faults.at(
                table.offset,
                match effect.kind.is_transmission() {
                    true => format!(
                        "{} and {} are both transmissions: an input has one",
                        other.kind.name, effect.kind.name
                    ),
                    false => format!(
                        "{} acts on this target already: their angles do not add, make them one",
                        effect.kind.name
                    ),
                },
            );
        }
        effects.push((table.offset, effect));
    }
    effects.sort_by_key(|(offset, _)| *offset);
    effects
}

/// Whether a table says `fixed = true`.
fn is_fixed(table: &Section) -> bool {
    let fixed = table.get("fixed").map(|value| value.get_ref());
    matches!(fixed, Some(DeValue::Boolean(true)))
}

fn read_one(
    table: &Section,
    mechanism: Option<&Mechanism>,
    (inputs, before): (&[Input], &[(usize, EffectEntry)]),
    faults: &mut Faults,
) -> Option<EffectEntry> {
    let kind = read_kind(table, faults)?;
    let (target_key, sits_on) = match kind.acts_on() {
        ActsOn::Joint | ActsOn::Sensor => ("joint", "a joint"),
        ActsOn::Input => ("input", "an input"),
        ActsOn::Link => ("link", "a link"),
    };

    let mut known = vec!["kind", target_key, "fixed"];
    let smoothed = kind.is_smoothed();
    if smoothed {
        known.push("smoothing");
    }
    known.extend(kind.parameters.iter().map(|p| p.name));
    let others = ["joint", "input", "link"];
    let mut others = others.into_iter().filter(|key| *key != target_key);
    if let Some(value) = others.find_map(|key| table.get(key)) {
        faults.at(
            value.span().start,
            format!(
                "{} acts on {sits_on}: write `{target_key} = \"…\"`",
                kind.name
            ),
        );
        known.extend(["joint", "input", "link"]);
    }
    let titled = Section {
        title: kind.name.to_owned(),
        ..table.clone()
    };
    titled.check_keys(&known, faults);

    let named = titled.needed_string(target_key, faults);
    let place = named.as_ref().map(|name| name.offset());
    let target = named.and_then(|name| match kind.acts_on() {
        ActsOn::Joint | ActsOn::Sensor => {
            find_coordinate(mechanism?, name.value, name.offset(), faults).map(Target::Coordinate)
        }
        ActsOn::Link => match &mechanism?.tree {
            Some(tree) => find_link(tree, &name, faults).map(Target::Link),
            None => {
                let change = kind.inertial()?;
                let fault = Misplaced::NoBodies { change };
                faults.at(name.offset(), fault.to_string());
                None
            }
        },
        ActsOn::Input => {
            let index = inputs.iter().position(|input| input.name == name.value);
            if index.is_none() {
                let names: Vec<&str> = inputs.iter().map(|i| i.name.as_str()).collect();
                faults.at(
                    name.offset(),
                    format!(
                        "unknown input {}{}",
                        quoted(name.value),
                        hint(name.value, "inputs", &names)
                    ),
                );
            }
            let on_link = |i: &usize| inputs.get(*i).is_some_and(|i| i.coordinate().is_none());
            if kind.is_transmission() && index.as_ref().is_some_and(on_link) {
                faults.at(
                    name.offset(),
                    format!(
                        "{} stands between a motor and a joint, and the input {} pushes a link",
                        kind.name,
                        quoted(name.value)
                    ),
                );
            }
            index.map(Target::Input)
        }
    });
    if kind.name == "load_dependent_friction"
        && let (Some(Target::Coordinate(c)), Some(place)) = (target, place)
        && inputs.iter().any(|input| input.coordinate().is_none())
        && !inputs.iter().any(|input| input.coordinate() == Some(c))
    {
        faults.at(
            place,
            "load_dependent_friction follows the forces of the inputs on its joint: there is none, and those on links do not count",
        );
    }
    let coordinate = match target {
        Some(Target::Coordinate(i)) => Some(i),
        Some(Target::Input(i)) if kind.memory().is_some() => {
            inputs.get(i).and_then(Input::coordinate)
        }
        _ => None,
    };
    let angular = coordinate
        .and_then(|i| mechanism?.mechanics.coordinates().get(i))
        .is_some_and(|c| c.angular);

    let takes = || -> String {
        let list: Vec<String> = kind
            .parameters
            .iter()
            .map(|p| {
                let optional = if p.default.is_some() {
                    ", optional"
                } else {
                    ""
                };
                format!("{} ({}{optional})", p.name, p.quantity.unit(angular))
            })
            .collect();
        list.join(", ")
    };
    let inertia = || {
        coordinate
            .and_then(|c| inertia_of(mechanism?, c))
            .unwrap_or(1.0)
    };
    let known = |other: &&EffectEntry| {
        let same = other.kind == kind && Some(other.target) == target;
        same && other.fixed && !is_fixed(table)
    };
    let known = before.iter().map(|(_, other)| other).filter(known);
    let known: f64 = known.filter_map(|other| other.values.first()).sum();
    let taken = match (kind.action, target, mechanism) {
        (Action::Inertial(change), Some(Target::Coordinate(at) | Target::Link(at)), Some(m))
            if kind.adds_up() =>
        {
            change.may_take(at, &*m.mechanics, m.tree.as_ref())
        }
        _ => 0.0,
    };
    let known = known + taken;
    let mut values = Vec::with_capacity(kind.parameters.len());
    for (k, spec) in kind.parameters.iter().enumerate() {
        let unit = spec.quantity.unit(angular);
        let lower = kind.lower_bound(k, known);
        let bounds = match (lower.is_finite(), spec.largest().is_finite()) {
            (true, true) => format!("from {lower} to {} {unit}", spec.largest()),
            (true, false) => format!("at least {lower} {unit}"),
            (false, true) => format!("at most {} {unit}", spec.largest()),
            (false, false) => "finite".to_owned(),
        };
        if table.get(spec.name).is_none() {
            if let Some(default) = spec.default {
                values.push(spec.within(default.value(inertia())));
                continue;
            }
            faults.at(
                table.offset,
                format!(
                    "{} takes {}: {} is missing",
                    kind.name,
                    takes(),
                    quoted(spec.name)
                ),
            );
        }
        let within = |x: f64| (lower..=spec.largest()).contains(&x);
        values.extend(match spec.is_flag {
            true => table.boolean(spec.name, faults).map(f64::from),
            false => table.number_that(spec.name, &bounds, within, faults),
        });
    }
    let smoothing = if !smoothed {
        None
    } else {
        let positive = |x: f64| x > 0.0;
        table.number_that("smoothing", "a positive velocity", positive, faults)
    };
    let fixed = table.boolean("fixed", faults).unwrap_or(false);
    if values.len() != kind.parameters.len() {
        return None;
    }
    if let (Some(stop), Some(Target::Coordinate(c))) = (kind.stop(), target) {
        let wraps =
            mechanism.is_some_and(|m| m.mechanics.coordinates().get(c).is_some_and(|c| c.wraps));
        if let Some(fault) = stop_fault(stop, &values, wraps) {
            faults.at(table.offset, format!("{} {fault}", kind.name));
        }
    }
    let target = target?;
    let on = match target {
        Target::Input(_) => coordinate,
        Target::Coordinate(at) | Target::Link(at) => Some(at),
    };
    if let (Some(change), Some(mechanism), Some(at)) = (kind.changes(&values), mechanism, on)
        && let Err(misplaced) = change.check(
            at,
            &*mechanism.mechanics,
            &mechanism.mechanics.nominal(),
            mechanism.tree.as_ref(),
        )
    {
        let offset = place.unwrap_or(table.offset);
        faults.at(offset, misplaced.to_string());
    } else if let Some(taken) = taken_fault(kind, &values, coordinate, mechanism) {
        faults.at(table.offset, taken);
    }
    let reads = |kind: &Kind, values: &[f64]| kind.motor().is_some_and(|m| m.is_read(values));
    let is_read = before.iter().any(|(_, other)| match other.target {
        Target::Input(i) => {
            reads(other.kind, &other.values)
                && inputs.get(i).and_then(Input::coordinate) == coordinate
        }
        _ => false,
    });
    if reads(kind, &values) && is_read {
        faults.at(
            table.offset,
            format!(
                "the sensor of its joint is on another motor already: say `sensor_on_motor` of one {} alone",
                kind.name
            ),
        );
    }
    Some(EffectEntry {
        kind,
        target,
        values,
        smoothing,
        fixed,
    })
}

/// The entry of M of coordinate `c` at the [typical] configuration, kg or kg·m².
fn inertia_of(mechanism: &Mechanism, c: usize) -> Option<f64> {
    let at = starts(mechanism.mechanics.coordinates()).get(c)?.v;
    typical(&*mechanism.mechanics).1?.get((at, at)).copied()
}

/// What no motor can be that a joint has in its inertia: as much as the joint moves, or more. What it moves when all else is free to give
/// way is 1/(M⁻¹)_cc.
fn taken_fault(
    kind: &Kind,
    values: &[f64],
    coordinate: Option<usize>,
    mechanism: Option<&Mechanism>,
) -> Option<String> {
    let motor = kind.motor()?;
    let taken = motor.inertia_within(values)?;
    let spec = kind.parameters.get(motor.inertia)?;
    let (mechanism, c) = (mechanism?, coordinate?);
    let moved = moved(c, &*mechanism.mechanics)?;
    let coordinate = mechanism.mechanics.coordinates().get(c)?;
    let unit = spec.quantity.unit(coordinate.angular);
    (taken >= moved).then(|| {
        format!(
            "{} takes {} = {taken} {unit} out of what {} moves, and that is {moved} {unit}, all else free to give way: give less, or give the mechanism the motor's mass",
            kind.name,
            spec.name,
            quoted(&coordinate.name),
        )
    })
}

/// What no stops can be.
fn stop_fault(stop: &dyn RigidStop, values: &[f64], wraps: bool) -> Option<String> {
    if wraps {
        return Some(
            "sits on an angle that goes round and has no ends: make the joint `revolute`, or leave it out of `angles`".to_owned(),
        );
    }
    match stop.places(values) {
        [Some(lower), Some(upper)] if lower >= upper => Some(format!(
            "has its lower end at {lower} and its upper at {upper}: give lower < upper"
        )),
        _ if !values.iter().take(2).any(|place| place.is_finite()) => {
            Some("has no place: give `lower`, `upper` or both".to_owned())
        }
        _ => None,
    }
}

fn read_kind(table: &Section, faults: &mut Faults) -> Option<&'static Kind> {
    let name = table.needed_string("kind", faults)?;
    let found = registry::find(name.value);
    if found.is_none() {
        let kinds = registry::all();
        let names = || kinds.iter().map(|kind| kind.name);
        let names = names().chain([networks::KIND]);
        let message = format!(
            "unknown kind of effect {}; nearest: {}",
            quoted(name.value),
            quoted(nearest(name.value, names).unwrap_or(""))
        );
        faults.at(name.offset(), message);
    }
    found
}

/// Adds the URDF's friction where the model does not give its own; says so where it does.
pub(super) fn add_joint_friction(
    friction: &[JointFriction],
    mechanics: &dyn Mechanics,
    text: &str,
    effects: &mut Vec<(usize, EffectEntry)>,
    warnings: &mut Vec<Problem>,
) {
    let mut from_urdf = Vec::new();
    for joint in friction {
        for (name, value) in [
            ("viscous_friction", joint.damping),
            ("coulomb_friction", joint.friction),
        ] {
            let Some(kind) = registry::find(name).filter(|_| value > 0.0) else {
                continue;
            };
            let entry = EffectEntry {
                kind,
                target: Target::Coordinate(joint.coordinate),
                values: vec![value],
                smoothing: None,
                fixed: false,
            };
            match effects
                .iter()
                .find(|(_, own)| own.kind == entry.kind && own.target == entry.target)
            {
                None => from_urdf.push((0, entry)),
                Some((offset, _)) => {
                    let joint = mechanics
                        .coordinates()
                        .get(joint.coordinate)
                        .map_or("", |c| c.name.as_str());
                    warnings.push(Problem::at(
                        Position::of(text, *offset),
                        format!(
                            "{name} of {} takes the place of the URDF's, which is {value}",
                            quoted(joint)
                        ),
                    ));
                }
            }
        }
    }
    from_urdf.append(effects);
    *effects = from_urdf;
}
