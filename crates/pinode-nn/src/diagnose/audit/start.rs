//! Recordings that start before the input acts.

use super::super::verdict::DataFault;
use crate::hybrid::{DrivenInputs, Hybrid, State};
use crate::log::Run;
use crate::model::Model;
use crate::shooting::Channel;

/// In a rest the model moves by so many times what is still, and by so many in one after another that is dead: where a joint turns round under a constant force it is
/// six times, (√2 + 2)²/2.
const WOULD_MOVE: f64 = 30.0;
const STILL_DEAD: f64 = 10.0;
/// … and by this part of how it would move without its inputs: one that holds a weight up is at work and moves nothing.
const OF_A_FALL: f64 = 0.5;

/// The first sample of each recording that counts: behind a dead start, in which an input as large as those that move the mechanism
/// later does not move it, as it would the model. Every recording must have one: a joint that sticks rests now and then.
pub fn dead_starts(
    model: &Model,
    runs: &[&Run],
    channels: &[Channel],
    faults: &mut Vec<DataFault>,
) -> Vec<usize> {
    if runs.len() < 2 {
        return vec![0; runs.len()];
    }
    let hybrid = Hybrid::of(model);
    let theta = hybrid.theta();
    for (i, input) in model.inputs.iter().enumerate() {
        // What pushes a link may balance others, or push another coordinate.
        let Some(c) = input.coordinate() else {
            continue;
        };
        let noise = channels[c].noise;
        let ends: Vec<usize> = runs
            .iter()
            .filter_map(|run| {
                let rests = rests(&run.q[c], &run.u[i], noise);
                if rests.is_empty() {
                    return None;
                }
                let fall = Fall::of(&hybrid, &theta, run, c);
                // What creeps while it is dead rests again and again.
                rests.iter().fold(None, |end, rest| {
                    let least = if end.is_some() {
                        STILL_DEAD
                    } else {
                        WOULD_MOVE
                    };
                    let is_dead = fall.as_ref().is_none_or(|fall| fall.leaves(rest, least));
                    if is_dead { Some(rest.end) } else { end }
                })
            })
            .collect();
        if ends.len() == runs.len() {
            let coordinate = &model.mechanics.coordinates()[c].name;
            faults.push(DataFault {
                kind: "dead_start".into(),
                column: format!("u.{}", input.name),
                when: runs
                    .iter()
                    .zip(&ends)
                    .map(|(run, &k)| [run.t[0], run.t[k]])
                    .collect(),
                detail: format!(
                    "every recording starts with the input at work and `{coordinate}` at rest; these stretches are left out of \
                     all fits"
                ),
            });
            return ends;
        }
    }
    vec![0; runs.len()]
}

/// A rest under full input.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Rest {
    from: usize,
    end: usize,
    /// What moves less than this rests.
    still: f64,
}

/// A recording from whose readings the model falls, with its inputs and without them.
struct Fall<'a> {
    hybrid: &'a Hybrid,
    theta: &'a [f64],
    run: &'a Run,
    coordinate: usize,
    driven: DrivenInputs,
    silent: DrivenInputs,
}

impl<'a> Fall<'a> {
    /// `None` where the model cannot say: of poses, and where an input acts through something that remembers.
    fn of(hybrid: &'a Hybrid, theta: &'a [f64], run: &'a Run, coordinate: usize) -> Option<Self> {
        let n = hybrid.nv();
        if hybrid.nq() != n || run.q.len() != n || hybrid.nh() > 0 {
            return None;
        }
        let silent: Vec<Vec<f64>> = run.u.iter().map(|u| vec![0.0; u.len()]).collect();
        let drive = |u: &[Vec<f64>]| hybrid.drive(&run.t, u, 1, theta, &[]);
        Some(Fall {
            driven: drive(&run.u),
            silent: drive(&silent),
            hybrid,
            theta,
            run,
            coordinate,
        })
    }

    /// How far it goes from rest, by the acceleration at each reading.
    fn goes(&self, inputs: &DrivenInputs, rest: &Rest) -> Option<f64> {
        let (t, still) = (&self.run.t, vec![0.0; self.hybrid.nv()]);
        let mut memory = self.hybrid.memory(&[]);
        let (mut x, mut v, mut farthest) = (0.0_f64, 0.0, 0.0_f64);
        for k in rest.from..rest.end.min(t.len() - 1) {
            let q: Vec<f64> = self.run.q.iter().map(|q| q[k]).collect();
            let state = State {
                q: &q,
                v: &still,
                h: &[],
            };
            let rolled = self
                .hybrid
                .acceleration(state, self.theta, inputs, k, &mut memory);
            rolled.ok()?;
            let interval = t[k + 1] - t[k];
            v += interval * memory.acceleration[self.coordinate];
            x += interval * v;
            if !x.is_finite() {
                return None;
            }
            farthest = farthest.max(x.abs());
        }
        Some(farthest)
    }

    /// Whether the model would leave where it rests by so many times what is still, if its friction let it. `true` where it cannot say.
    fn leaves(&self, rest: &Rest, least: f64) -> bool {
        let falls = |inputs| self.goes(inputs, rest);
        let (Some(by_all), Some(without)) = (falls(&self.driven), falls(&self.silent)) else {
            return true;
        };
        by_all > least * rest.still && by_all > OF_A_FALL * without
    }
}

/// The rests under full input that begin in the first quarter of a recording, of at least ten samples.
fn rests(q: &[f64], u: &[f64], noise: f64) -> Vec<Rest> {
    let low = q.iter().copied().fold(f64::INFINITY, f64::min);
    let high = q.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let still = (6.0 * noise).max(1e-3 * (high - low));
    let size = |u: &[f64]| u.iter().map(|u| u.abs()).sum::<f64>() / u.len().max(1) as f64;
    let usual = size(u);
    let mut from = 0;
    let mut rests = Vec::new();
    for k in 1..q.len() {
        if (q[k] - q[from]).abs() > still {
            if k - from >= 10 && usual > 0.0 && size(&u[from..k]) > 0.7 * usual {
                rests.push(Rest {
                    from,
                    end: k,
                    still,
                });
            }
            if from > q.len() / 4 {
                break;
            }
            from = k;
        }
    }
    rests
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_rest_under_full_input_at_the_start_is_dead_and_a_later_one_is_not() {
        let u: Vec<f64> = (0..1000).map(|k| 3.0 * (0.1 * k as f64).sin()).collect();
        let mut q: Vec<f64> = (0..1000).map(|k| 0.1 * (0.1 * k as f64).cos()).collect();
        assert!(rests(&q, &u, 1e-5).is_empty());
        let stuck = q[500];
        q[500..600].fill(stuck);
        assert!(rests(&q, &u, 1e-5).is_empty());
        q[20..120].fill(0.05);
        let ends: Vec<usize> = rests(&q, &u, 1e-5).iter().map(|rest| rest.end).collect();
        assert_eq!(ends, [120]);
    }

    /// I φ̈ = τ − m g l sin φ.
    const INERTIA: f64 = 0.05;
    const WEIGHT: f64 = 0.981;

    /// Whether three recordings of a pendulum on this way, at 500 Hz by a sensor of this noise, seem dead at their start, and whether they are said to be. The torque
    /// is what the way needs, or what `torque` says.
    fn seem_and_are(way: fn(f64) -> [f64; 2], torque: Option<f64>) -> (bool, bool) {
        let model = Model::parse(
            std::path::Path::new("pendulum.toml"),
            format!(
                "name = \"pendulum\"\n\
                 lagrangian = {{ coordinates = [\"phi\"], kinetic = \"0.5*{INERTIA}*phi_dot^2\", potential = \"-{WEIGHT}*cos(phi)\" }}\n\
                 [[input]]\nname = \"motor\"\njoint = \"phi\"\n"
            ),
        )
        .unwrap();
        let t: Vec<f64> = (0..5000).map(|k| 2e-3 * f64::from(k)).collect();
        let needed = |t: &f64| {
            let [q, acceleration] = way(*t);
            torque.unwrap_or(INERTIA * acceleration + WEIGHT * q.sin())
        };
        let runs: Vec<Run> = (0..3)
            .map(|id| Run {
                id: id.to_string(),
                q: vec![t.iter().map(|t| way(*t)[0]).collect()],
                v: vec![None],
                u: vec![t.iter().map(needed).collect()],
                t: t.clone(),
            })
            .collect();
        let noise = 1e-5;
        let channel = Channel {
            coordinate: 0,
            velocity: false,
            wraps: false,
            noise,
        };
        let seems = !rests(&runs[0].q[0], &runs[0].u[0], noise).is_empty();
        let all: Vec<&Run> = runs.iter().collect();
        let mut faults = Vec::new();
        let ends = dead_starts(&model, &all, &[channel], &mut faults);
        assert_eq!(ends.iter().any(|end| *end > 0), !faults.is_empty());
        (seems, !faults.is_empty())
    }

    #[test]
    fn a_joint_that_turns_round_is_not_dead() {
        let swing = |t: f64| {
            let q = (3.0 * t).sin();
            [q, -9.0 * q]
        };
        assert_eq!(seem_and_are(swing, None), (true, false));
    }

    #[test]
    fn a_joint_that_holds_a_weight_up_is_not_dead_and_one_that_does_not_feel_its_motor_is() {
        let rests_first = |t: f64| match t < 2.0 {
            true => [0.8, 0.0],
            false => [0.8 * (t - 2.0).cos(), -0.8 * (t - 2.0).cos()],
        };
        assert_eq!(seem_and_are(rests_first, None), (true, false));
        let hangs_first = |t: f64| match t < 2.0 {
            true => [0.0, 0.0],
            false => [0.4 * (1.0 - (t - 2.0).cos()), 0.4 * (t - 2.0).cos()],
        };
        assert_eq!(seem_and_are(hangs_first, Some(0.3)), (true, true));
    }
}
