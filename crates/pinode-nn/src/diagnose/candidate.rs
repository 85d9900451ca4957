//! What could be missing: every kind of effect on every target where it makes sense.

use std::f64::consts::PI;

use super::scales::MotionScales;
use crate::effect::{ActsOn, Kind, Scales, registry};
use crate::hybrid::{Hybrid, Placed};
use crate::poses::is_of_pose;

/// Whether both kinds contain the same simpler one and neither contains the other: side by side they would count it twice.
fn are_rivals(placed: &Kind, kind: &Kind) -> bool {
    let common = placed
        .contains
        .iter()
        .any(|name| kind.contains.contains(name));
    common && !kind.contains.contains(&placed.name)
}

/// Whether what is in place, and is not known exactly, is a special case of `kind` on `target`, which takes its place.
pub fn gives_way(placed: &Placed, kind: &Kind, target: usize) -> bool {
    !placed.fixed && placed.target == target && kind.contains.contains(&placed.kind.name)
}

/// Whether a coordinate is where it was after a turn.
fn goes_round(hybrid: &Hybrid, coordinate: usize) -> bool {
    let coordinates = hybrid.mechanics().coordinates();
    coordinates.get(coordinate).is_some_and(|c| c.wraps)
}

/// What acts on a body that no joint holds: drag, a steady push, a tether. Each along or about one axis of the world or of its angles.
const IN_THE_OPEN: [&str; 4] = [
    "viscous_friction",
    "quadratic_drag",
    "constant_force",
    "linear_spring",
];

/// Whether a kind makes sense on this coordinate or on its sensor.
fn has_a_place(kind: &Kind, hybrid: &Hybrid, target: usize) -> bool {
    let coordinates = hybrid.mechanics().coordinates();
    match kind.acts_on() {
        ActsOn::Joint if is_of_pose(coordinates, target) => IN_THE_OPEN.contains(&kind.name),
        // A way that goes round has no ends.
        ActsOn::Joint => kind.stop().is_none() || !goes_round(hybrid, target),
        // What pushes a link has no joint that a transmission could drive.
        ActsOn::Input => !kind.is_transmission() || !hybrid.is_on_link(target),
        _ => true,
    }
}

/// A kind of effect on a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The kind.
    pub kind: &'static Kind,
    /// The coordinate, the input or the link: see [`Kind::acts_on`].
    pub target: usize,
}

impl Candidate {
    /// That of a kind with this name on a target, for tests.
    #[cfg(test)]
    #[allow(clippy::unwrap_used)]
    pub fn named(name: &str, target: usize) -> Self {
        let kind = crate::effect::registry::find(name).unwrap();
        Candidate { kind, target }
    }

    /// All that `hybrid` could be missing: kinds not yet on a target, nor contained in one that is, unless that is known exactly: then there may be more
    /// of it.
    pub fn all(hybrid: &Hybrid) -> Vec<Candidate> {
        let mut all = Vec::new();
        for kind in registry::all() {
            let targets = match kind.acts_on() {
                ActsOn::Joint | ActsOn::Sensor => hybrid.nv(),
                ActsOn::Input => hybrid.inputs(),
                ActsOn::Link => hybrid.links().len(),
            };
            for target in 0..targets {
                let candidate = Candidate { kind, target };
                if !has_a_place(kind, hybrid, target) {
                    continue;
                }
                let place = match kind.acts_on() {
                    ActsOn::Input => hybrid.coordinate_of(kind, target),
                    _ => target,
                };
                if kind
                    .inertial()
                    .is_some_and(|change| !hybrid.may_change(change, place))
                {
                    continue;
                }
                let covered = hybrid.effects().iter().any(|placed| {
                    let same = placed.kind == kind
                        || placed.kind.contains.contains(&kind.name)
                        || are_rivals(placed.kind, kind);
                    placed.target == target
                        && match placed.fixed {
                            true => placed.kind.excludes(kind),
                            false => same || placed.kind.excludes(kind),
                        }
                });
                if !covered {
                    all.push(candidate);
                }
            }
        }
        all
    }

    /// Whether it is a friction that changes along a way that went round and round: there it would follow the time and not the place, which is the same
    /// after a turn.
    pub fn winds_up(&self, hybrid: &Hybrid, scales: &[Scales]) -> bool {
        let along_the_way = self.kind.name == "position_dependent_friction";
        along_the_way && goes_round(hybrid, self.target) && scales[self.target].reach > PI
    }

    /// Whether another is a special case of it.
    pub fn contains(&self, other: &Candidate) -> bool {
        other.target == self.target && self.kind.contains.contains(&other.kind.name)
    }

    /// Whether it is what a fit has in place. What is known exactly is no candidate, whatever it is called.
    pub fn is(&self, placed: &Placed) -> bool {
        self.kind == placed.kind && self.target == placed.target && !placed.fixed
    }

    /// The effect of `hybrid` that this candidate would take the place of.
    pub fn replaces(&self, hybrid: &Hybrid) -> Option<usize> {
        let mut effects = hybrid.effects().iter();
        effects.position(|placed| gives_way(placed, self.kind, self.target))
    }

    /// The parameters, at `theta`, of the effect whose place it would take; none when there is none.
    pub fn contained(&self, hybrid: &Hybrid, theta: &[f64]) -> Vec<f64> {
        self.replaces(hybrid)
            .map(|index| theta[hybrid.range(index)].to_vec())
            .unwrap_or_default()
    }

    /// The model with this effect, and θ, `theta` for all that was there before and `values` for the new effect.
    pub fn place(&self, hybrid: &Hybrid, theta: &[f64], values: &[f64]) -> (Hybrid, Vec<f64>) {
        let (mut with, mut theta) = match self.replaces(hybrid) {
            Some(index) => {
                let range = hybrid.range(index);
                let rest = [&theta[..range.start], &theta[range.end..]].concat();
                (hybrid.without(index), rest)
            }
            None => (hybrid.clone(), theta.to_vec()),
        };
        let coordinate = hybrid.coordinate_of(self.kind, self.target);
        with.add(
            Placed {
                kind: self.kind,
                target: self.target,
                smoothing: self
                    .replaces(hybrid)
                    .and_then(|index| hybrid.effects().get(index))
                    .map_or(hybrid.default_smoothing(coordinate), |known| {
                        known.smoothing
                    }),
                fixed: false,
            },
            values,
        );
        theta.extend_from_slice(values);
        (with, theta)
    }

    /// The scales on its target; for a link with the mass of its body or its inertia, for an input with its own size.
    pub fn scales(&self, hybrid: &Hybrid, scales: &MotionScales) -> Scales {
        let coordinate = hybrid.coordinate_of(self.kind, self.target);
        let own = scales[coordinate];
        match self.kind.acts_on() {
            ActsOn::Input => scales.of_input(self.target, coordinate),
            ActsOn::Link => Scales {
                mass: hybrid
                    .inertia_of_body(self.kind, self.target)
                    .unwrap_or(own.mass),
                ..own
            },
            _ => own,
        }
    }

    /// Name of its target.
    pub fn target_name<'a>(&self, hybrid: &'a Hybrid, inputs: &'a [String]) -> &'a str {
        hybrid.target_name(self.kind, self.target, inputs)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::model::Model;
    use std::path::Path;

    fn changes(path: &str) -> Vec<(&'static str, String)> {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let model = Model::load(&models.join(path)).unwrap();
        let hybrid = Hybrid::of(&model);
        let inputs: Vec<String> = model.inputs.iter().map(|i| i.name.clone()).collect();
        Candidate::all(&hybrid)
            .into_iter()
            .filter(|c| c.kind.inertial().is_some())
            .map(|c| (c.kind.name, c.target_name(&hybrid, &inputs).to_owned()))
            .collect()
    }

    #[test]
    fn mechanics_may_be_changed_where_there_is_a_body_a_joint_or_a_base() {
        let expected = [
            ("gravity_tilt", "slider"),
            ("backlash", "motor"),
            ("added_mass", "cart"),
            ("added_mass", "pole"),
            ("payload", "pole"),
            ("centre_of_mass", "pole"),
            ("link_inertia", "pole"),
            ("reflected_inertia", "slider"),
            ("reflected_inertia", "pole"),
        ];
        let found = changes("cartpole/cartpole.toml");
        assert_eq!(found, expected.map(|(kind, on)| (kind, on.to_owned())));
        assert!(changes("four_bar/four_bar.toml").is_empty(), "constraints");
    }

    #[test]
    fn a_body_that_floats_is_held_by_no_joint_and_has_no_friction_of_one() {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let model = Model::load(&models.join("quadruped/quadruped.toml")).unwrap();
        let model = model.by_angles(Default::default()).unwrap();
        let hybrid = Hybrid::of(&model);
        let all = Candidate::all(&hybrid);
        let on = |target: usize| -> Vec<&str> {
            let own = all
                .iter()
                .filter(|c| c.kind.acts_on() == ActsOn::Joint && c.target == target);
            own.map(|c| c.kind.name).collect()
        };
        for coordinate in 0..6 {
            let mut found = on(coordinate);
            found.sort_unstable();
            let mut expected = IN_THE_OPEN;
            expected.sort_unstable();
            assert_eq!(found, expected, "{coordinate}");
        }
        assert!(on(6).contains(&"coulomb_friction"));
    }

    #[test]
    fn friction_along_a_way_is_none_where_that_goes_round_and_round() {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let model = Model::load(&models.join("cartpole/cartpole.toml")).unwrap();
        let hybrid = Hybrid::of(&model);
        let scales = |reach: f64| Scales {
            reach,
            ..Scales::example()
        };
        let winds = |kind: &str, target: usize, reach: f64| {
            let kind = registry::find(kind).unwrap();
            Candidate { kind, target }.winds_up(&hybrid, &[scales(reach); 2])
        };
        let friction = "position_dependent_friction";
        assert!(winds(friction, 1, 20.0) && !winds(friction, 1, 2.0));
        assert!(!winds(friction, 0, 20.0), "a cart does not go round");
        assert!(!winds("coulomb_friction", 1, 20.0));
    }
}
