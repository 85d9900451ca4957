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
    let (past, rate) = (rig.past(), rig.settings.rate);
    let measured = Measured {
        q: log.q.each_ref().map(Vec::as_slice),
        v: log.v.each_ref().map(Vec::as_slice),
        wraps: [false, true],
        interval: 1.0 / rate,
    };
    mean_errors(&measured, past, (windows, steps), |k| {
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
        let run = rig.true_run(&start, &log.u[k - past..k], &log.u[k..k + steps])?;
        Ok(run.iter().map(|state| state.q).collect())
    })
}

/// What was measured of two coordinates, by row.
pub(super) struct Measured<'a> {
    pub q: [&'a [f64]; 2],
    /// Backward differences.
    pub v: [&'a [f64]; 2],
    /// Whether differences are taken on the circle.
    pub wraps: [bool; 2],
    /// s.
    pub interval: f64,
}

/// The mean absolute errors of q, then of backward differences of it, over roll-outs that begin at rows evenly spread, not before row `first`. `run` has the
/// positions at the row with its number and at the `steps` rows after it.
pub(super) fn mean_errors(
    measured: &Measured<'_>,
    first: usize,
    (windows, steps): (usize, usize),
    mut run: impl FnMut(usize) -> Result<Vec<[f64; 2]>, Error>,
) -> Result<[f64; 4], Error> {
    let rows = measured.q[0].len();
    if rows <= first + steps || windows == 0 || steps == 0 {
        return Err(Error::Short {
            rows,
            needed: first + steps + 1,
        });
    }
    let mut sums = [0.0; 4];
    for window in 0..windows {
        let k = first + window * (rows - steps - first) / windows;
        for (i, pair) in run(k)?.windows(2).enumerate() {
            let [before, q] = pair else {
                continue;
            };
            let row = k + i + 1;
            for c in 0..2 {
                let off = q[c] - measured.q[c][row];
                let turns = (off / std::f64::consts::TAU).round();
                let circle = f64::from(u8::from(measured.wraps[c])) * std::f64::consts::TAU;
                let rate = (q[c] - before[c]) / measured.interval;
                sums[c] += (off - circle * turns).abs();
                sums[2 + c] += (rate - measured.v[c][row]).abs();
            }
        }
    }
    Ok(sums.map(|sum| sum / (windows * steps) as f64))
}
