//! Forces that are at work and not in the log: hands.
//!
//! They show in one stretch of time, or two, while the same positions, velocities and inputs at other times do without them.

use super::super::curves::ResidualForce;
use super::super::study::{Fitted, Start, Study};
use super::super::verdict::DataFault;
use super::Masked;
use super::second_look::{Look, Residual, Residuals, quantile, robust};
use crate::shooting::Window;

/// Windows whose residuals are so many times the noise, and so many times those of three windows in four, are disturbed …
const DISTURBED: (f64, f64) = (5.0, 4.0);
/// … in at most so many stretches of time, which hold at most this share of all windows.
const MOST_STRETCHES: usize = 2;
const MOST_WINDOWS: f64 = 0.15;
/// A fifth of the residual force in a stretch exceeds so many times what 97 % of it elsewhere does not.
const BURST: f64 = 1.5;
/// This share of the states in a stretch occurs at other times as well.
const KNOWN: f64 = 0.6;

/// The kind of this fault.
pub const UNLOGGED_FORCE: &str = "unlogged_force";
/// Iterations of the initial states of windows that another model is asked for.
const STATES_ALONE: usize = 8;

/// Whether another model explains all that is masked in the windows of `study`: then nobody pushed there.
pub fn is_explained(study: &Study, model: &Fitted, masked: &Masked) -> bool {
    let all = study.windows.fit.iter().chain(&study.windows.held_out);
    let kept = masked.leave(all.clone().copied().collect(), &study.observations);
    let pushed: Vec<Window> = all.filter(|w| !kept.contains(w)).copied().collect();
    let theta = &model.inside.theta;
    let states = study.starts(&model.hybrid, theta, &pushed, None);
    let (study, there) = study.over(model, pushed, states);
    let start = Start {
        hidden: Vec::new(),
        ..there.start(theta.clone())
    };
    let there = study.fit(model.hybrid.clone(), start, STATES_ALONE, 0);
    let sizes = Residuals::of(&study, &there).sizes;
    !sizes.is_empty() && sizes.iter().all(|lists| size(lists) < DISTURBED.0)
}

/// The size of the residuals of a window, robustly; infinite where the model diverges.
fn size(lists: &Option<Vec<Vec<Residual>>>) -> f64 {
    match lists {
        Some(lists) => lists
            .iter()
            .map(|list| robust(list.iter().map(|x| x.size)))
            .fold(0.0, f64::max),
        None => f64::INFINITY,
    }
}

/// Adds the stretches in which something pushed that is not logged to `look`.
pub fn unlogged_forces(
    study: &Study,
    residuals: &Residuals,
    force: &[ResidualForce],
    look: &mut Look,
) {
    let sizes: Vec<f64> = residuals.sizes.iter().map(size).collect();
    let limit = DISTURBED.0.max(DISTURBED.1 * quantile(sizes.clone(), 0.75));
    let observations = &study.observations;
    let mut disturbed: Vec<(usize, [f64; 2])> = residuals
        .windows
        .iter()
        .zip(&sizes)
        .filter(|(_, size)| **size > limit)
        .map(|(w, _)| {
            let t = &observations.runs[w.run].t;
            (w.run, [t[w.first], t[w.first + w.count - 1]])
        })
        .collect();
    if disturbed.is_empty() || disturbed.len() as f64 > MOST_WINDOWS * sizes.len() as f64 {
        return;
    }
    disturbed.sort_by(|a, b| a.0.cmp(&b.0).then(a.1[0].total_cmp(&b.1[0])));
    let mut stretches: Vec<(usize, [f64; 2])> = Vec::new();
    for (run, [a, b]) in disturbed {
        match stretches.last_mut() {
            Some((r, stretch)) if *r == run && a - stretch[1] < b - a => stretch[1] = b,
            _ => stretches.push((run, [a, b])),
        }
    }
    if stretches.len() > MOST_STRETCHES {
        return;
    }
    let bursts: Option<Vec<Burst>> = stretches
        .iter()
        .map(|stretch| Burst::of(stretch, &stretches, force))
        .collect();
    // What is not understood everywhere is not called a fault anywhere.
    let Some(bursts) = bursts else {
        return;
    };
    if !bursts.iter().all(|burst| burst.is_known(study, &stretches)) {
        return;
    }
    for burst in bursts {
        let force = &force[burst.place];
        look.masked.add(burst.run, burst.when);
        look.faults.push(DataFault {
            kind: UNLOGGED_FORCE.into(),
            column: format!("q.{}", force.coordinate),
            when: vec![burst.when],
            detail: format!(
                "from t = {:.2} to {:.2} s alone a force of up to {:.2} {unit} on `{}` is missing ({:.1} times what is usual), in states that at \
                 other times do without it: something pushed that is not in the log; the stretch is left out of all fits",
                burst.when[0],
                burst.when[1],
                burst.peak,
                force.coordinate,
                burst.peak / burst.usual,
                unit = force.unit
            ),
        });
    }
}

/// A burst of residual force.
struct Burst {
    run: usize,
    /// Index of the residual force.
    place: usize,
    /// Its coordinate's stretch of time, s.
    when: [f64; 2],
    /// The largest force in it, and what 97 % of the force elsewhere does not exceed.
    peak: f64,
    usual: f64,
}

impl Burst {
    fn of(
        &(run, [from, to]): &(usize, [f64; 2]),
        all: &[(usize, [f64; 2])],
        force: &[ResidualForce],
    ) -> Option<Self> {
        let place = |r: &ResidualForce, k: usize| (r.run[k], r.t[k]);
        let within = |at: (usize, f64)| at.0 == run && (from..=to).contains(&at.1);
        let elsewhere = |at: (usize, f64)| {
            let inside = |&(run, [a, b]): &(usize, [f64; 2])| at.0 == run && a <= at.1 && at.1 <= b;
            !all.iter().any(inside)
        };
        let sizes = |r: &ResidualForce, chosen: &dyn Fn((usize, f64)) -> bool| -> Vec<f64> {
            (0..r.t.len())
                .filter(|&k| chosen(place(r, k)))
                .map(|k| r.force[k].abs())
                .collect()
        };
        let (usual, index) = force
            .iter()
            .enumerate()
            .map(|(index, r)| {
                let usual = quantile(sizes(r, &elsewhere), 0.97).max(f64::MIN_POSITIVE);
                (quantile(sizes(r, &within), 0.8) / usual, usual, index)
            })
            .filter(|(ratio, ..)| *ratio > BURST)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, usual, index)| (usual, index))?;
        let r = &force[index];
        let mut strong =
            (0..r.t.len()).filter(|&k| within(place(r, k)) && r.force[k].abs() > usual);
        let first = strong.next()?;
        let last = strong.next_back().unwrap_or(first);
        let spacing =
            r.t.windows(2)
                .map(|t| t[1] - t[0])
                .fold(f64::INFINITY, |m, d| if d > 0.0 { m.min(d) } else { m });
        // The local fit behind the force reaches a few samples to either side.
        let reach = 4.0 * spacing;
        Some(Burst {
            run,
            place: index,
            when: [(r.t[first] - reach).max(from), (r.t[last] + reach).min(to)],
            peak: sizes(r, &within).into_iter().fold(0.0, f64::max),
            usual,
        })
    }

    /// Whether most of the states in it occur at other times too, near in position, velocity and input.
    fn is_known(&self, study: &Study, stretches: &[(usize, [f64; 2])]) -> bool {
        // Every coordinate's position and velocity, and every input, in units of what counts as near.
        let near = |run: usize, k: usize| -> Vec<f64> {
            let smooth = &study.smoothed[run];
            let scales = study.scales.iter().enumerate();
            let mut at: Vec<f64> = scales
                .flat_map(|(c, s)| {
                    let q = smooth.q[c][k] / (0.3 * s.reach);
                    [q, smooth.v[c][k] / (0.4 * s.speed)]
                })
                .collect();
            let inputs = study.observations.runs[run].u.iter().enumerate();
            at.extend(inputs.map(|(i, u)| {
                let usual = study.scales.usual_input(i);
                u[k] / usual.max(f64::MIN_POSITIVE)
            }));
            at
        };
        let (mut inside, mut outside) = (Vec::new(), Vec::new());
        for (run, recording) in study.observations.runs.iter().enumerate() {
            for (k, &t) in recording.t.iter().enumerate() {
                if run == self.run && self.when[0] <= t && t <= self.when[1] {
                    inside.push(near(run, k));
                } else if !stretches
                    .iter()
                    .any(|&(r, [a, b])| r == run && a <= t && t <= b)
                {
                    outside.push(near(run, k));
                }
            }
        }
        let is_near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1.0);
        let known = inside
            .iter()
            .filter(|a| outside.iter().any(|b| is_near(a, b)))
            .count();
        known as f64 >= KNOWN * inside.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::pushes::tests::prepared_with;
    use crate::diagnose::setup::Prepared;

    #[test]
    fn what_is_masked_is_explained_by_the_right_model_and_by_no_other() {
        for (damping, right) in [(0.0, true), (1.0, false)] {
            let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, damping);
            let mut masked = Masked::none(1);
            assert!(!is_explained(&study, &null, &masked), "nothing is masked");
            masked.add(0, [20.0, 21.0]);
            masked.add(0, [55.0, 55.5]);
            assert_eq!(is_explained(&study, &null, &masked), right, "{damping}");
        }
    }
}
