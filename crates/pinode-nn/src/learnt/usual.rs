//! What a network sees unless it is told otherwise.

use nalgebra::DMatrix;

use super::Quantity;
use crate::effect::{Family, Kind};
use crate::model::{Model, Target};

/// Slopes of energies are taken at so many places, by differences over twice this, and are none below this part of the energy a metre.
const PLACES: usize = 4;
const ASIDE: f64 = 1e-4;
const LEVEL: f64 = 1e-5;

/// Cosine and sine of every angle that wraps, other angles, the [places](places), or all displacements where the network `is_all` there is, all velocities and all inputs.
pub fn usual_quantities(model: &Model, is_all: bool) -> Vec<Quantity> {
    let coordinates = model.mechanics.coordinates();
    let places = places(model);
    let mut quantities = Vec::new();
    for (c, coordinate) in coordinates.iter().enumerate() {
        if coordinate.wraps {
            quantities.extend([Quantity::Cosine(c), Quantity::Sine(c)]);
        } else if coordinate.angular || is_all || places.contains(&c) {
            quantities.push(Quantity::Position(c));
        }
    }
    quantities.extend((0..coordinates.len()).map(Quantity::Velocity));
    quantities.extend((0..model.inputs.len()).map(|input| Quantity::Input { input, back: 0 }));
    quantities
}

/// The displacements that say where the mechanism is: those that do not change in any direction d of displacements along which the motion is the same wherever it begins,
/// d·∂T/∂q = 0 and d·∂V/∂q = 0, V with the known springs, stops and periodic forces. A cart's position is none, nor are those of two masses with a spring between them.
fn places(model: &Model) -> Vec<usize> {
    let coordinates = model.mechanics.coordinates();
    let is_displacement = |c: &usize| !coordinates[*c].angular;
    let displacements: Vec<usize> = (0..coordinates.len()).filter(is_displacement).collect();
    let rows = slopes(model, &displacements);
    let matrix = DMatrix::from_fn(rows.len(), displacements.len(), |i, k| rows[i][k]);
    // What cannot be told is seen.
    if displacements.is_empty() || matrix.iter().any(|x| !x.is_finite()) {
        return displacements;
    }
    let found = matrix.tr_mul(&matrix).symmetric_eigen();
    let directions = found
        .eigenvalues
        .iter()
        .zip(found.eigenvectors.column_iter());
    let level: Vec<_> = directions
        .filter(|(square, _)| **square < LEVEL * LEVEL)
        .collect();
    let stays = |k: &usize| level.iter().all(|(_, d)| d[*k].abs() < LEVEL);
    let stay = (0..displacements.len()).filter(stays);
    stay.map(|k| displacements[k]).collect()
}

/// The slopes of T and V along some displacements, a row each at some places, in parts of the energy and all its slopes; and a row for each known spring.
fn slopes(model: &Model, displacements: &[usize]) -> Vec<Vec<f64>> {
    let mechanics = &model.mechanics;
    let n = mechanics.coordinates().len();
    let scattered = |seed: usize| -> Vec<f64> {
        let value = |i: usize| 0.3 + ((5 * i + 3 * seed) % 7) as f64 / 7.0;
        (0..n).map(value).collect()
    };
    let at = |seed: usize, kinetic: bool| -> Vec<f64> {
        let (q, v) = (scattered(seed), scattered(seed + 1));
        let energy = |q: &[f64]| {
            let found = match kinetic {
                true => mechanics.kinetic_energy(q, &v),
                false => mechanics.potential_energy(q),
            };
            found.unwrap_or(f64::NAN)
        };
        let beside = |c: usize, aside: f64| {
            let mut q = q.clone();
            q[c] += aside;
            energy(&q)
        };
        let slope = |&c: &usize| (beside(c, ASIDE) - beside(c, -ASIDE)) / (2.0 * ASIDE);
        let own: Vec<f64> = displacements.iter().map(slope).collect();
        let size = own.iter().fold(energy(&q).abs(), |sum, x| sum + x.abs());
        own.iter()
            .map(|x| x / size.max(f64::MIN_POSITIVE))
            .collect()
    };
    let of_energies = (0..PLACES).flat_map(|seed| [at(seed, true), at(seed, false)]);
    // Of the position alone; the same everywhere is one.
    let depends =
        |kind: &Kind| kind.family == Family::Conservative && kind.name != "constant_force";
    let springs = model.effects.iter().filter_map(|entry| match entry.target {
        Target::Coordinate(c) if depends(entry.kind) => Some(c),
        _ => None,
    });
    let of_spring = |spring: usize| {
        let row = displacements.iter();
        row.map(|&c| f64::from(u8::from(c == spring))).collect()
    };
    of_energies.chain(springs.map(of_spring)).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// What a network on the first joint of a mechanism without inputs sees.
    fn seen(coordinates: &str, kinetic: &str, potential: &str, more: &str) -> Vec<String> {
        let text = format!(
            "name = \"seen\"\n[lagrangian]\ncoordinates = {coordinates}\nkinetic = \"{kinetic}\"\npotential = \"{potential}\"\nparameters = {{ m = 1.5, k = 4.0 }}\n{more}"
        );
        let model = Model::parse("seen.toml".as_ref(), text).unwrap();
        let coordinates = model.mechanics.coordinates();
        // Alone on all joints it is a black box, which knows no energies.
        let all = usual_quantities(&model, true);
        assert_eq!(all.len(), 2 * coordinates.len());
        let names = usual_quantities(&model, false);
        names.iter().map(|q| q.name(coordinates, &[])).collect()
    }

    #[test]
    fn a_displacement_is_seen_where_the_motion_depends_on_it() {
        let two = "0.5*m*(x_dot^2 + y_dot^2)";
        let both = "[\"x\", \"y\"]";
        let velocities = ["v.x", "v.y"].map(str::to_owned);
        let all = ["q.x", "q.y", "v.x", "v.y"].map(str::to_owned);
        // A cart, and two masses with a spring between them.
        assert_eq!(seen("[\"x\"]", "0.5*m*x_dot^2", "0", ""), ["v.x"]);
        assert_eq!(seen(both, two, "0.5*k*(x - y)^2", ""), velocities);
        // On a spring to the world, by its own or as a known effect.
        assert_eq!(
            seen("[\"x\"]", "0.5*m*x_dot^2", "0.5*k*x^2", ""),
            ["q.x", "v.x"]
        );
        assert_eq!(seen(both, two, "0.5*k*(x - y)^2 + 0.01*k*x^2", ""), all);
        let spring =
            "[[effect]]\nkind = \"linear_spring\"\njoint = \"y\"\nstiffness = 2.0\nrest = 0.0\n";
        assert_eq!(seen(both, two, "0.5*k*(x - y)^2", spring), all);
        // A bead on a wire whose inertia changes along it; the other slides anywhere.
        let bead = "0.5*m*((1 + x^2)*x_dot^2 + y_dot^2)";
        assert_eq!(seen(both, bead, "0", ""), ["q.x", "v.x", "v.y"]);
    }
}
