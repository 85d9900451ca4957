//! Names that are one equation where one input moves one coordinate.
//!
//! M q̈ + F = (1 + g) u is M/(1 + g) q̈ + F/(1 + g) = u: a gain that is off is an inertia that is off, with all forces in proportion. Where nothing of the mechanism itself knows the
//! position it is a sensor's scale as well, y = (1 + g) q: M ÿ + (1 + g) F(q) = (1 + g) u. A zero of an angle is gravity from aside. Where what else is free may follow, or is stretched within its
//! tolerance, no screen sees that, for it steps along one of them alone: the other is fitted from where it does the same.

use super::candidate::Candidate;
use super::comparison::Comparison;
use super::found::{Found, position, stripped};
use super::refine::{ITERATIONS, is_sensible};
use super::study::{Fitted, Study};
use crate::effect::{ActsOn, Quantity, registry};
use crate::hybrid::{ConstantId, Hybrid, Placed};

/// Another name for what was found that explains no less than these nats less does as well: twenty to one.
const AS_WELL: f64 = 3.0;

/// What scales all forces of one coordinate.
const SCALES: [&str; 2] = ["input_gain_error", "sensor_scale"];
/// What changes by less than this part along a coordinate does not.
const LEVEL: f64 = 1e-9;

/// Another name, its constant, and by how many times all free forces are larger beside it that are of some degree in the motion, a^n b of degree n.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Dual {
    kind: &'static str,
    constant: f64,
    forces: f64,
    readings: f64,
}

/// What does the same as a law with this constant before a coordinate that moves `mass`.
fn duals(kind: &str, p: f64, mass: f64) -> Vec<Dual> {
    let dual = |kind, constant, forces, readings| Dual {
        kind,
        constant,
        forces,
        readings,
    };
    let ratio = 1.0 + p;
    let inertia = mass / ratio - mass;
    match kind {
        "input_gain_error" => vec![
            dual("reflected_inertia", inertia, 1.0 / ratio, 1.0),
            dual("sensor_scale", p, 1.0 / ratio, ratio),
        ],
        "sensor_scale" => vec![
            dual("input_gain_error", p, ratio, 1.0 / ratio),
            dual("reflected_inertia", inertia, 1.0, 1.0 / ratio),
        ],
        "reflected_inertia" => {
            let ratio = mass / (mass + p);
            vec![
                dual("input_gain_error", ratio - 1.0, ratio, 1.0),
                dual("sensor_scale", ratio - 1.0, 1.0, ratio),
            ]
        }
        // Which way a joint turns is not asked.
        "sensor_offset" => [p, -p].map(|p| dual("gravity_tilt", p, 1.0, 1.0)).to_vec(),
        "gravity_tilt" => [p, -p].map(|p| dual("sensor_offset", p, 1.0, 1.0)).to_vec(),
        _ => Vec::new(),
    }
}

/// Whether a candidate is a sensor's scale that is told as a gain, one of `all`: where they are one equation, what tells the two apart is over which speeds friction changes its sign.
pub fn is_told_as_gain(candidate: &Candidate, all: &[Candidate], hybrid: &Hybrid) -> bool {
    let [gain, scale] = SCALES;
    let is_asked = || all.iter().any(|other| other.kind.name == gain);
    candidate.kind.name == scale && is_asked() && is_one_equation(hybrid)
}

/// Whether one input moves one coordinate of a constant inertia without weight, and no force on it is known but of dampers, which are of the first degree in the motion, as an inertia is.
fn is_one_equation(hybrid: &Hybrid) -> bool {
    let is_damper = |e: &Placed| e.kind.name == "viscous_friction";
    let is_known = |e: &Placed| e.fixed && e.kind.acts_on() == ActsOn::Joint && !is_damper(e);
    let has_one = hybrid.nv() == 1 && hybrid.inputs() == 1 && !hybrid.is_on_link(0);
    has_one && !hybrid.effects().iter().any(is_known) && is_free(hybrid)
}

/// Whether the inertia of the one coordinate is the same everywhere, and nothing of the mechanics pulls at it.
fn is_free(hybrid: &Hybrid) -> bool {
    let mechanics = hybrid.mechanics();
    let at = |x: f64| {
        let (mass, weight) = (mechanics.mass_matrix(&[x]), mechanics.gravity_force(&[x]));
        Some((mass.ok()?, weight.ok()?))
    };
    let (Some((mass, weight)), Some((mass_there, weight_there))) = (at(0.3), at(-0.8)) else {
        return false;
    };
    let off = (&mass - mass_there).norm() + weight.norm() + weight_there.norm();
    off <= LEVEL * mass.norm()
}

/// The degree of a force in the motion.
fn degree(quantity: Quantity) -> Option<i32> {
    match quantity {
        Quantity::Force => Some(0),
        Quantity::Damping | Quantity::Stiffness => Some(1),
        Quantity::QuadraticDamping => Some(2),
        Quantity::CubicStiffness => Some(3),
        _ => None,
    }
}

/// θ with the forces of effects on joints that are free as they are beside a `dual`.
fn beside(hybrid: &Hybrid, mut theta: Vec<f64>, dual: &Dual) -> Vec<f64> {
    for &i in &hybrid.free() {
        let ConstantId::Effect(effect, k) = hybrid.constants()[i].id else {
            continue;
        };
        let kind = hybrid.effects()[effect].kind;
        let degree = degree(kind.parameters[k].quantity);
        if let Some(degree) = degree.filter(|_| kind.acts_on() == ActsOn::Joint) {
            theta[i] *= dual.forces * dual.readings.powi(degree);
        }
    }
    theta
}

/// Adds to what was found, and `current` has, the other names that do as well in its place; `null` is the model that the search began with.
pub fn with_duals(study: &Study, null: &Fitted, current: &Fitted, found: &mut Found) {
    let hybrid = &current.hybrid;
    let Candidate { kind, target } = found.candidate;
    if hybrid.nv() != 1 || hybrid.inputs() != 1 || hybrid.is_on_link(0) {
        return;
    }
    let Some(index) = position(current, &found.candidate) else {
        return;
    };
    let mass = found.candidate.scales(hybrid, &study.scales).mass;
    let p = current.inside.theta[hybrid.range(index).start];
    let (reduced, theta) = stripped(null, current, index);
    let asked = Candidate::all(&reduced);
    for dual in duals(kind.name, p, mass) {
        let other = registry::find(dual.kind).map(|kind| Candidate { kind, target });
        let is_asked = |other: &Candidate| {
            let is_new = !found.indistinguishable.contains(other);
            is_new && asked.contains(other) && !study.without.contains(&other.kind)
        };
        let Some(other) = other.filter(is_asked) else {
            continue;
        };
        let theta = beside(&reduced, theta.clone(), &dual);
        let (with, theta) = other.place(&reduced, &theta, &[dual.constant]);
        let mut bounded = with.constants().iter().zip(&theta);
        if !bounded.all(|(c, x)| (c.lower..=c.upper).contains(x)) {
            continue;
        }
        let fitted = study.fit(with, current.start(theta), 1, ITERATIONS);
        let as_well = Comparison::of(&fitted, current).total() > -AS_WELL;
        if as_well && is_sensible(study, &other, &fitted) {
            found.is_also(other, fitted);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::Model;

    #[test]
    fn a_sensors_scale_is_told_as_a_gain_where_nothing_else_is_known_of_the_forces() {
        let model = |potential: &str, fixed: &str| {
            let text = format!(
                "name = \"slide\"\n[lagrangian]\ncoordinates = [\"x\"]\nkinetic = \"x_dot^2\"\npotential = \"{potential}\"\n\
                 [[input]]\nname = \"push\"\njoint = \"x\"\n{fixed}"
            );
            Model::parse(Path::new("slide.toml"), text).map(|model| Hybrid::of(&model))
        };
        let named = |name| Candidate::named(name, 0);
        let [gain, scale] = SCALES.map(named);
        let fixed = |kind: &str, value: &str| {
            format!("[[effect]]\nkind = \"{kind}\"\njoint = \"x\"\n{value}\nfixed = true\n")
        };
        let damper = fixed("viscous_friction", "coefficient = 3.0");
        let spring = fixed("linear_spring", "stiffness = 3.0\nrest = 0.1");
        for (potential, more, as_gain) in [
            ("0", "", true),
            ("0", &*damper, true),
            ("0", &spring, false),
            ("2*x^2", "", false),
            ("9.81*x", "", false),
        ] {
            let hybrid = model(potential, more).ok();
            let told = |candidate: &Candidate, all: &[Candidate]| {
                hybrid.as_ref().map(|h| is_told_as_gain(candidate, all, h))
            };
            assert_eq!(
                told(&scale, &[gain, scale]),
                Some(as_gain),
                "{potential} {more}"
            );
            assert_eq!(told(&scale, &[scale]), Some(false), "nothing stands for it");
            assert_eq!(told(&gain, &[gain, scale]), Some(false));
        }
    }

    /// M q̈ + c + b v + d v² = (1 + g) u by each of the three names: forces of degree n, and back.
    #[test]
    fn a_gain_is_an_inertia_and_a_scale_with_all_forces_in_proportion() {
        let (g, mass) = (-0.1, 2.0);
        let [inertia, scale] = duals("input_gain_error", g, mass)[..] else {
            unreachable!("two")
        };
        let times = |dual: &Dual| [0, 1, 2].map(|n| dual.forces * dual.readings.powi(n));
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(inertia.constant, 2.0 / 0.9 - 2.0);
        near(scale.constant, g);
        // M q̈ = −c + u, y = 0.9 q: a friction c/0.9 before 2 kg; b v stays, for v = ẏ/0.9.
        for (dual, expected) in [
            (&inertia, [1.0 / 0.9, 1.0 / 0.9, 1.0 / 0.9]),
            (&scale, [1.0 / 0.9, 1.0, 0.9]),
        ] {
            let times = times(dual);
            times.iter().zip(expected).for_each(|(a, b)| near(*a, b));
        }
        for other in [inertia, scale] {
            for back in duals(other.kind, other.constant, mass) {
                let there = match back.kind {
                    "input_gain_error" => [1.0; 3],
                    "sensor_scale" => times(&scale),
                    _ => times(&inertia),
                };
                let forth = times(&other);
                let back = times(&back);
                (0..3).for_each(|n| near(forth[n] * back[n], there[n]));
            }
        }
        assert!(duals("coulomb_friction", 0.1, mass).is_empty());
    }
}
