//! Names that are one equation where one input moves one coordinate.
//!
//! M q̈ + F = (1 + g) u is M/(1 + g) q̈ + F/(1 + g) = u: a gain that is off is an inertia that is off, with all forces in proportion, and where nothing else knows the position
//! it is a sensor's scale, M ÿ + (1 + g) F = (1 + g) u with y = (1 + g) q. A zero of an angle is gravity from aside. Where what else is free may follow, or is stretched within its
//! tolerance, no screen sees that, for it steps along one of them alone: the other is fitted from where it does the same.

use super::candidate::Candidate;
use super::comparison::Comparison;
use super::found::{Found, position, stripped};
use super::refine::{ITERATIONS, is_sensible};
use super::study::{Fitted, Study};
use crate::effect::{ActsOn, Quantity, registry};
use crate::hybrid::{ConstantId, Hybrid};

/// Another name for what was found that explains no less than these nats less does as well: twenty to one.
const AS_WELL: f64 = 3.0;

/// Another name, its constant, and by how many times all other forces that are free are larger beside it.
#[derive(Debug, Clone, Copy)]
struct Dual {
    kind: &'static str,
    constant: f64,
    forces: f64,
}

/// What does the same as a law with this constant before a coordinate that moves `mass`.
fn duals(kind: &str, p: f64, mass: f64) -> Vec<Dual> {
    let dual = |kind, constant, forces| Dual {
        kind,
        constant,
        forces,
    };
    match kind {
        "input_gain_error" => vec![
            dual(
                "reflected_inertia",
                mass / (1.0 + p) - mass,
                1.0 / (1.0 + p),
            ),
            dual("sensor_scale", p, 1.0 / (1.0 + p)),
        ],
        "reflected_inertia" => {
            let gain = mass / (mass + p);
            vec![dual("input_gain_error", gain - 1.0, gain)]
        }
        "sensor_scale" => vec![dual("input_gain_error", p, 1.0 + p)],
        // Which way a joint turns is not asked.
        "sensor_offset" => [p, -p].map(|p| dual("gravity_tilt", p, 1.0)).to_vec(),
        "gravity_tilt" => [p, -p].map(|p| dual("sensor_offset", p, 1.0)).to_vec(),
        _ => Vec::new(),
    }
}

/// θ with all forces of effects on joints that are free so many times as large.
fn with_forces(hybrid: &Hybrid, mut theta: Vec<f64>, times: f64) -> Vec<f64> {
    let is_force = |quantity| {
        use Quantity::{CubicStiffness, Damping, Force, QuadraticDamping, Stiffness};
        matches!(
            quantity,
            Force | Damping | QuadraticDamping | Stiffness | CubicStiffness
        )
    };
    for &i in &hybrid.free() {
        let ConstantId::Effect(effect, k) = hybrid.constants()[i].id else {
            continue;
        };
        let kind = hybrid.effects()[effect].kind;
        if kind.acts_on() == ActsOn::Joint && is_force(kind.parameters[k].quantity) {
            theta[i] *= times;
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
    for dual in duals(kind.name, p, mass) {
        let other = registry::find(dual.kind).map(|kind| Candidate { kind, target });
        let is_asked = |other: &Candidate| {
            !study.without.contains(&other.kind) && !found.indistinguishable.contains(other)
        };
        let Some(other) = other.filter(is_asked) else {
            continue;
        };
        let theta = with_forces(&reduced, theta.clone(), dual.forces);
        let (with, theta) = other.place(&reduced, &theta, &[dual.constant]);
        let fitted = study.fit(with, current.start(theta), 1, ITERATIONS);
        let as_well = Comparison::of(&fitted, current).total() > -AS_WELL;
        if as_well && is_sensible(study, &other, &fitted) {
            found.is_also(other, fitted);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// M q̈ + b v = (1 + g) u, as an inertia before b/(1 + g), and back.
    #[test]
    fn a_gain_is_an_inertia_with_all_forces_in_proportion() {
        let [inertia, scale] = &duals("input_gain_error", -0.1, 2.0)[..] else {
            unreachable!("two")
        };
        assert!((inertia.constant - (2.0 / 0.9 - 2.0)).abs() < 1e-12);
        assert!((inertia.forces - 1.0 / 0.9).abs() < 1e-12);
        assert_eq!(scale.constant, -0.1);
        let [gain] = &duals(inertia.kind, inertia.constant, 2.0)[..] else {
            unreachable!("one")
        };
        assert!((gain.constant + 0.1).abs() < 1e-12);
        assert!((gain.forces * inertia.forces - 1.0).abs() < 1e-12);
        assert!(duals("coulomb_friction", 0.1, 2.0).is_empty());
    }
}
