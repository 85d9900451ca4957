//! What could be missing: every kind of effect on every target where it makes sense.

use crate::effect::{Action, Kind, Scales, default_smoothing, registry};
use crate::hybrid::{Hybrid, Placed};

/// A kind of effect on a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The kind.
    pub kind: &'static Kind,
    /// The coordinate, or the input for an effect of the drive.
    pub target: usize,
}

impl Candidate {
    /// All that `hybrid` could be missing: kinds not yet on a target, nor contained in one that is.
    pub fn all(hybrid: &Hybrid) -> Vec<Candidate> {
        let mut all = Vec::new();
        for kind in registry::ALL.iter().copied() {
            let targets = match kind.action {
                Action::Joint(_) => hybrid.nv(),
                Action::Drive(_) => hybrid.inputs(),
            };
            for target in 0..targets {
                let candidate = Candidate { kind, target };
                // A way that goes round has no ends.
                let coordinates = hybrid.mechanics().coordinates();
                if kind.stop().is_some() && coordinates.get(target).is_some_and(|c| c.wraps) {
                    continue;
                }
                let covered = hybrid.effects().iter().any(|placed| {
                    placed.target == target
                        && (placed.kind == kind || placed.kind.contains.contains(&kind.name))
                });
                if !covered {
                    all.push(candidate);
                }
            }
        }
        all
    }

    /// The effect of `hybrid` that this candidate would take the place of.
    pub fn replaces(&self, hybrid: &Hybrid) -> Option<usize> {
        hybrid.effects().iter().position(|placed| {
            placed.target == self.target && self.kind.contains.contains(&placed.kind.name)
        })
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
        let angular = match self.kind.action {
            Action::Joint(_) => hybrid.mechanics().coordinates()[self.target].angular,
            Action::Drive(_) => false,
        };
        with.add(
            Placed {
                kind: self.kind,
                target: self.target,
                smoothing: default_smoothing(angular),
            },
            values,
            false,
        );
        theta.extend_from_slice(values);
        (with, theta)
    }

    /// The scales on its target.
    pub fn scales(&self, hybrid: &Hybrid, scales: &[Scales]) -> Scales {
        match self.kind.action {
            Action::Joint(_) => scales[self.target],
            Action::Drive(_) => scales[hybrid.input_coordinates()[self.target]],
        }
    }

    /// Name of its target.
    pub fn target_name<'a>(&self, hybrid: &'a Hybrid, inputs: &'a [String]) -> &'a str {
        match self.kind.action {
            Action::Joint(_) => &hybrid.mechanics().coordinates()[self.target].name,
            Action::Drive(_) => &inputs[self.target],
        }
    }
}
