//! How far a roll-out is from what was measured.

use lagrange::Coordinate;

use crate::entries::Start;
use crate::shooting::wrap_angle;

/// What was measured in one recording, behind the zeros of the sensors.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Target {
    /// Positions, one column a coordinate, m or rad.
    pub q: Vec<Vec<f64>>,
    /// Velocities, one column a coordinate, m/s or rad/s; empty where there is none.
    pub v: Vec<Vec<f64>>,
    /// Which positions and which velocities count: the others are no readings of what they stand for.
    pub valid: [Vec<Vec<bool>>; 2],
}

/// Σ_c λ_c (q_c − q′_c)² + μ_c (v_c − v′_c)² over the samples of a window; of an angle that wraps, (cos q − cos q′)² + (sin q − sin q′)² takes the
/// place of the first square (Roehrl et al. 2020, eq. 11).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Loss {
    channels: Vec<Channel>,
    /// The first sample that counts: 1 where windows start from what was measured, 0 where their start is free.
    pub first: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Channel {
    /// Where it is in a state.
    q: usize,
    v: usize,
    wraps: bool,
    /// λ and μ.
    position: f64,
    velocity: f64,
}

impl Loss {
    /// `weights` has λ and μ of every coordinate; `starts` their places, q before v.
    pub fn new(
        coordinates: &[Coordinate],
        starts: &[Start],
        nq: usize,
        weights: &[[f64; 2]],
        first: usize,
    ) -> Self {
        let channel = |((coordinate, start), weight): ((&Coordinate, &Start), &[f64; 2])| Channel {
            q: start.q,
            v: nq + start.v,
            wraps: coordinate.wraps,
            position: weight[0],
            velocity: weight[1],
        };
        let channels = coordinates.iter().zip(starts).zip(weights);
        Loss {
            channels: channels.map(channel).collect(),
            first,
        }
    }

    /// Every part of the loss at one sample of a recording, of the state with these entries: to `each` the entry, the weight and the measured number
    /// less that of the state, on the circle for an angle that wraps.
    pub fn residuals(
        &self,
        target: &Target,
        sample: usize,
        state: impl Fn(usize) -> f64,
        mut each: impl FnMut(usize, f64, f64),
    ) {
        for (c, channel) in self.channels.iter().enumerate() {
            if channel.position > 0.0 && target.valid[0][c][sample] {
                let d = target.q[c][sample] - state(channel.q);
                let d = if channel.wraps { wrap_angle(d) } else { d };
                each(channel.q, channel.position, d);
            }
            if channel.velocity > 0.0 && target.valid[1][c][sample] {
                let d = target.v[c][sample] - state(channel.v);
                each(channel.v, channel.velocity, d);
            }
        }
    }

    /// The loss at one sample of a recording, of the state with these entries.
    pub fn at(&self, target: &Target, sample: usize, state: impl Fn(usize) -> f64) -> f64 {
        let mut sum = 0.0;
        self.residuals(target, sample, state, |i, weight, d| {
            sum += weight
                * match self.wraps(i) {
                    // (cos a − cos b)² + (sin a − sin b)² = 2 − 2 cos(a − b) = 4 sin²((a − b)/2).
                    true => 4.0 * (0.5 * d).sin().powi(2),
                    false => d * d,
                };
        });
        sum
    }

    /// Its derivatives, each to `add` with the entry of the state.
    pub fn gradient(
        &self,
        target: &Target,
        sample: usize,
        state: impl Fn(usize) -> f64,
        mut add: impl FnMut(usize, f64),
    ) {
        self.residuals(target, sample, state, |i, weight, d| {
            let slope = if self.wraps(i) { d.sin() } else { d };
            add(i, -2.0 * weight * slope);
        });
    }

    /// Whether this entry of a state is an angle that wraps.
    fn wraps(&self, i: usize) -> bool {
        self.channels.iter().any(|c| c.wraps && c.q == i)
    }
}
