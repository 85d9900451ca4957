//! Candidates a small step into the model, and what that changes of its roll-outs.

use crate::diagnose::candidate::Candidate;
use crate::diagnose::study::{Fitted, Study};
use crate::effect::Action;
use crate::hybrid::{DrivenInputs, HiddenPath, Hybrid, Reading};
use crate::shooting::{By, Member, ObservedRun, Trajectory, Window, roll_all};

/// A probe of a candidate: one column of the equations.
#[derive(Debug, Clone)]
pub struct Column {
    pub candidate: Candidate,
    pub(super) neutral: Vec<f64>,
    pub perturbed: Vec<f64>,
    /// What the same kind has on this target that is known exactly: the candidate may take so much from it.
    pub(super) known: f64,
    /// How many times as long as usual everything takes in the log.
    pub(super) pace: f64,
}

impl Column {
    /// The parameters a step of `factor` probes away, within their bounds; `None` when the bounds allow no step that way. Of what is far from
    /// linear in its parameters the probe itself is the start, unless the data ask for its opposite.
    pub(super) fn start(&self, factor: f64) -> Option<Vec<f64>> {
        match self.candidate.kind.starts_at_probes() {
            true => (factor > 0.0).then(|| self.perturbed.clone()),
            false => self.step(factor),
        }
    }

    /// The same, where no bound makes the step another one.
    pub fn unclamped(&self, factor: f64) -> Option<Vec<f64>> {
        let start = self.start(factor)?;
        let ends = self.neutral.iter().zip(&self.perturbed);
        let mut ends = ends.map(|(n, p)| if n == p { *n } else { n + factor * (p - n) });
        start
            .iter()
            .all(|x| ends.next() == Some(*x))
            .then_some(start)
    }

    fn step(&self, factor: f64) -> Option<Vec<f64>> {
        let specs = self.candidate.kind.parameters;
        let start: Vec<f64> = specs
            .iter()
            .zip(self.neutral.iter().zip(&self.perturbed))
            .enumerate()
            .map(|(k, (spec, (n, p)))| match n == p {
                true => *n,
                false => {
                    let lower = self.candidate.kind.lower_bound(k, self.known);
                    (n + factor * (p - n)).clamp(lower, spec.upper_at(self.pace))
                }
            })
            .collect();
        let moved = start.iter().zip(&self.neutral).any(|(a, b)| a != b);
        let mut entries = start.iter().zip(specs);
        let is_there = entries.all(|(x, spec)| x.is_finite() || *x == spec.neutral);
        (moved && is_there).then_some(start)
    }
}

/// What a probe changes.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Change {
    /// Only what is read of the fitted model's states.
    Reading,
    /// Forces along them: to first order about the fitted model's roll-out.
    Forces(By),
    /// The states themselves: it is rolled out.
    Motion,
}

/// A candidate a probe's step into the model.
pub(super) struct Probed {
    pub(super) hybrid: Hybrid,
    pub(super) theta: Vec<f64>,
    /// The inputs after its drives; none where they are those of the fitted model.
    pub(super) inputs: Option<Vec<DrivenInputs>>,
    pub(super) readings: Vec<Reading>,
    /// Where the recordings take its hidden states; empty where it starts from none of its own.
    paths: Vec<HiddenPath>,
    pub(super) change: Change,
    /// The states of the fitted model that it has too, by their place in h.
    kept: Vec<Option<usize>>,
}

impl Probed {
    /// `None` where the samples do not follow it.
    pub(super) fn new(study: &Study, fitted: &Fitted, column: &Column) -> Option<Self> {
        let (hybrid, theta) =
            column
                .candidate
                .place(&fitted.hybrid, &fitted.inside.theta, &column.perturbed);
        if !study.resolves(&hybrid, &theta) {
            return None;
        }
        // What asks for no more steps than the fitted model takes its steps, however fast that has become since it was fitted with them.
        let of_fitted = study.substeps_for(&fitted.hybrid, &fitted.inside.theta);
        let substeps = match study.substeps_for(&hybrid, &theta) {
            more if more > of_fitted => more.max(fitted.substeps),
            _ => fitted.substeps,
        };
        let kind = column.candidate.kind;
        let same_states =
            kind.states() == 0 && hybrid.nh() == fitted.hybrid.nh() && substeps == fitted.substeps;
        let beside = column.candidate.replaces(&fitted.hybrid).is_none();
        let change = match kind.action {
            Action::Sensor(_) if same_states && beside => Change::Reading,
            Action::Joint(_) if same_states && beside => {
                let own = hybrid.effects().len().checked_sub(1);
                Change::Forces(own.map_or(By::Forces, By::Law))
            }
            // A finite step into an inertia would change where friction sticks by as much as all else.
            _ if same_states && kind.inertial().is_some() => Change::Forces(By::Inertia),
            _ if same_states => Change::Forces(By::Forces),
            _ => Change::Motion,
        };
        let same_inputs = substeps == fitted.substeps && !matches!(kind.action, Action::Drive(_));
        let drive = |run: &ObservedRun| run.drive(&hybrid, substeps, &theta, &[]);
        let runs = &study.observations.runs;
        let kept = kept_states(&hybrid, &fitted.hybrid);
        let starts_anew = change == Change::Motion && kept.contains(&None);
        Some(Probed {
            inputs: (!same_inputs).then(|| runs.iter().map(drive).collect()),
            readings: hybrid.readings(&theta, &[]),
            paths: match starts_anew {
                true => study.hidden_paths(&hybrid, &theta, substeps),
                false => Vec::new(),
            },
            change,
            kept,
            hybrid,
            theta,
        })
    }

    /// The inputs, where `fitted` are those of the fitted model.
    fn inputs<'a>(&'a self, fitted: &'a [DrivenInputs]) -> &'a [DrivenInputs] {
        self.inputs.as_deref().unwrap_or(fitted)
    }

    /// Where it is rolled out, its states at the samples of each window that starts at the fitted model's `states`.
    pub(super) fn moved(
        &self,
        windows: &[Window],
        states: &[Vec<f64>],
        fitted: &[DrivenInputs],
    ) -> Vec<Option<Trajectory>> {
        if self.change != Change::Motion {
            return Vec::new();
        }
        let inputs = self.inputs(fitted);
        let starts: Vec<Vec<f64>> = windows
            .iter()
            .zip(states)
            .map(|(window, state)| self.start(window, state))
            .collect();
        let members: Vec<Member> = windows
            .iter()
            .zip(&starts)
            .map(|(window, initial)| Member {
                inputs: &inputs[window.run],
                span: (window.first, window.count),
                initial,
            })
            .collect();
        roll_all((&self.hybrid, &self.theta, &[]), &members, false)
    }

    /// The initial state (q, v, h) of a window that starts at `state` in the fitted model.
    fn start(&self, window: &Window, state: &[f64]) -> Vec<f64> {
        let visible = self.hybrid.nx() - self.hybrid.nh();
        let mut start = state[..visible].to_vec();
        let found = self.kept.iter().enumerate();
        start.extend(found.map(|(k, kept)| match kept {
            Some(old) => state[visible + old],
            None => self.paths[window.run].at(window.first)[k],
        }));
        start
    }
}

/// For each of h of `new` its place in h of `old`.
fn kept_states(new: &Hybrid, old: &Hybrid) -> Vec<Option<usize>> {
    let mut kept = Vec::with_capacity(new.nh());
    for (index, effect) in new.effects().iter().enumerate() {
        let place = old.effects().iter().position(|e| e.is_same(effect));
        let first = place.map(|k| old.state_range(k).start);
        kept.extend((0..new.state_range(index).len()).map(|k| first.map(|first| first + k)));
    }
    kept
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::diagnose::pushes::tests::prepared;
    use crate::diagnose::setup::Prepared;

    /// A stop that a fit made harder than the steps it began with had every candidate rolled out in shorter ones, a hundred times as slowly.
    #[test]
    fn forces_beside_what_has_become_fast_are_still_taken_along_the_roll_out() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        let candidate = |name| Candidate::named(name, 0);
        let bristles = candidate("dahl_friction");
        let (hybrid, theta) = bristles.place(&null.hybrid, &null.inside.theta, &[20.0, 0.3]);
        let slow = study.fit(hybrid, null.start(theta), 1, 0);
        let steps = |fitted: &Fitted| study.substeps_for(&fitted.hybrid, &fitted.inside.theta);
        let mut fast = slow.clone();
        while steps(&fast) == fast.substeps {
            let stiffness = fast.hybrid.range(fast.hybrid.effects().len() - 1).start;
            fast.inside.theta[stiffness] *= 2.0;
        }
        let change = |fitted: &Fitted, name| {
            let candidate = candidate(name);
            let scales = candidate.scales(&fitted.hybrid, &study.scales);
            let contained = candidate.contained(&fitted.hybrid, &fitted.inside.theta);
            let probe = (candidate.kind.probes)(&scales, &contained).remove(0);
            let column = Column {
                candidate,
                neutral: probe.neutral,
                perturbed: probe.perturbed,
                known: 0.0,
                pace: study.pace.times(),
            };
            Probed::new(&study, fitted, &column).unwrap().change
        };
        for fitted in [&slow, &fast] {
            assert!(
                change(fitted, "linear_spring")
                    == Change::Forces(By::Law(fitted.hybrid.effects().len()))
            );
            assert!(change(fitted, "added_mass") == Change::Forces(By::Inertia));
        }
    }
}
