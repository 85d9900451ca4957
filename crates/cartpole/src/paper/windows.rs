//! How far the true model is from the measurement: what no model of the rig can do better from the same start.

use super::{Error, PaperRig, Recording, Start};
use crate::rig::truth::State;

/// Where windows begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartsAt {
    /// The measured x, φ and their backward differences, as in the paper; the motor moves with the cart.
    Measured,
    /// The true state, the motor's included.
    True,
}

/// Mean absolute errors of the true model, of x, m, φ, rad, ẋ, m/s, and φ̇, rad/s, against the measured ones: velocities are backward differences of
/// positions here as there. Over all steps of `windows` roll-outs of `steps` steps that begin at rows evenly spread (Roehrl et al. 2020, section 5: 1000 of 0.6 s).
///
/// Angles are compared on the circle.
///
/// # Errors
/// [`Error::Short`] for a recording that has no such window, else as [`PaperRig::true_run`].
pub fn true_errors(
    rig: &PaperRig,
    recording: &Recording,
    (windows, steps): (usize, usize),
    from: StartsAt,
) -> Result<[f64; 4], Error> {
    let log = &recording.log;
    let (first, rows) = (rig.past(), log.len());
    if rows <= first + steps || windows == 0 || steps == 0 {
        return Err(Error::Short {
            rows,
            needed: first + steps + 1,
        });
    }
    let mut sums = [0.0; 4];
    for window in 0..windows {
        let k = first + window * (rows - steps - first) / windows;
        let start = match from {
            StartsAt::Measured => Start {
                state: State {
                    q: [log.q[0][k], log.q[1][k]],
                    v: [log.v[0][k], log.v[1][k]],
                },
                motor: None,
            },
            StartsAt::True => Start {
                state: recording.truth.states[k],
                motor: Some(recording.truth.motor[k]),
            },
        };
        let run = rig.true_run(&start, &log.u[k - first..k], &log.u[k..k + steps])?;
        let rate = rig.settings.rate;
        for (i, pair) in run.windows(2).enumerate() {
            let [State { q: before, .. }, State { q, .. }] = pair else {
                continue;
            };
            let row = k + i + 1;
            let turn = q[1] - log.q[1][row];
            let angle = turn - std::f64::consts::TAU * (turn / std::f64::consts::TAU).round();
            let errors = [
                q[0] - log.q[0][row],
                angle,
                (q[0] - before[0]) * rate - log.v[0][row],
                (q[1] - before[1]) * rate - log.v[1][row],
            ];
            for (sum, error) in sums.iter_mut().zip(errors) {
                *sum += error.abs();
            }
        }
    }
    Ok(sums.map(|sum| sum / (windows * steps) as f64))
}
