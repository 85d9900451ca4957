//! What the sensors of the model read: y(t) = offset + factor q(t − delay); of a sensor on the [motor](Motor) of a drive, q + e in place of q.

use super::{Hybrid, Placed};
use crate::effect::{Action, Distortion, Motor};

/// The reading of one coordinate's sensor, with its derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Added to positions, m or rad.
    pub offset: f64,
    /// Multiplies positions and velocities.
    pub factor: f64,
    /// Age of what is read, s.
    pub delay: f64,
    /// Where e and the motor's velocity are in a state (q, v, h), of a sensor that is on a motor.
    on_motor: Option<(usize, usize)>,
    /// Column of θ_free, what it changes, and by how much: ∂offset, ∂factor or ∂delay.
    columns: Vec<(usize, Distortion, f64)>,
}

/// Products of weights and states: (sample, index in the state, weight). Two of positions, two of velocities, and two of the ways from there to motors.
pub type Terms = [(usize, usize, f64); 6];
/// The first four.
type OfJoint = [(usize, usize, f64); 4];

/// A measurement that the model predicts, linear in the states at one or two samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predicted {
    /// The reading.
    pub value: f64,
    /// (sample, index in the state, weight): ∂reading/∂state.
    pub terms: Terms,
    /// q(t − delay), or v.
    pub undistorted: f64,
    /// Its rate.
    pub slope: f64,
}

impl Hybrid {
    /// The reading of coordinate `c` at θ.
    pub fn reading(&self, c: usize, theta: &[f64], free: &[usize]) -> Reading {
        let column = |index: usize| free.binary_search(&index).ok();
        let zero = self.zero_index(c);
        let mut reading = Reading {
            offset: theta[zero],
            factor: 1.0,
            delay: 0.0,
            on_motor: None,
            columns: Vec::new(),
        };
        let zero = column(zero).map(|k| (k, Distortion::Offset, 1.0));
        reading.columns.extend(zero);
        for (index, (effect, range)) in self.effects.iter().zip(&self.ranges).enumerate() {
            let Action::Sensor(distortion) = effect.kind.action else {
                if self.reads_motor(index, theta) == Some(c) {
                    let h = self.nq() + self.nv() + self.state_ranges[index].start;
                    reading.on_motor = Some((h, h + 1));
                }
                continue;
            };
            if effect.target != c {
                continue;
            }
            let value = theta[range.start];
            match distortion {
                Distortion::Offset => reading.offset += value,
                Distortion::Delay => reading.delay += value,
                Distortion::Scale => {
                    for (_, other, by) in &mut reading.columns {
                        if *other == Distortion::Scale {
                            *by *= 1.0 + value;
                        }
                    }
                    reading.factor *= 1.0 + value;
                }
            }
            let by = match distortion {
                Distortion::Scale => reading.factor / (1.0 + value),
                _ => 1.0,
            };
            let own = column(range.start).map(|k| (k, distortion, by));
            reading.columns.extend(own);
        }
        reading
    }

    /// The motor of effect `index`, if its joint's sensor is on it.
    pub(super) fn motor_read(&self, index: usize, theta: &[f64]) -> Option<Motor> {
        let motor = self.effects[index].kind.motor()?;
        let p = &theta[self.ranges[index].clone()];
        motor.is_read(p).then_some(motor)
    }

    /// The coordinate whose sensor is on the motor of effect `index`, if one is.
    fn reads_motor(&self, index: usize, theta: &[f64]) -> Option<usize> {
        self.motor_read(index, theta)?;
        let Placed { kind, target, .. } = self.effects[index];
        Some(self.coordinate_of(kind, target))
    }

    /// Takes the stretch of drives off the positions of a state (q, v, h) whose joints are read on the motor, where q is still what was read.
    pub(crate) fn put_behind_motors(&self, theta: &[f64], state: &mut [f64]) {
        let first = self.nq() + self.nv();
        for index in 0..self.effects.len() {
            if let Some(c) = self.reads_motor(index, theta) {
                let stretch = state[first + self.state_ranges[index].start];
                state[self.starts[c].q] -= stretch;
            }
        }
    }

    /// Whether the sensor of coordinate `c` is on a motor.
    pub(crate) fn is_read_on_motor(&self, c: usize, theta: &[f64]) -> bool {
        (0..self.effects.len()).any(|index| self.reads_motor(index, theta) == Some(c))
    }

    /// The readings of all coordinates.
    pub fn readings(&self, theta: &[f64], free: &[usize]) -> Vec<Reading> {
        (0..self.starts.len())
            .map(|c| self.reading(c, theta, free))
            .collect()
    }
}

/// The state (q, v) behind what its sensors read, where nothing later is known: what is late goes on at its rate.
pub(crate) fn behind(readings: &[Reading], mut state: Vec<f64>) -> Vec<f64> {
    let n = readings.len();
    for (c, reading) in readings.iter().enumerate() {
        state[c] = reading.position_of(state[c], state[n + c]);
        state[n + c] /= reading.factor;
    }
    state
}

impl Reading {
    /// What is read at sample `k` of a roll-out: `q` and `v` are the places of position and velocity in its states of `nx` numbers
    /// each, `t` its times. Between samples a cubic through positions and velocities; before the first sample, the acceleration of
    /// the first interval.
    pub fn position(
        &self,
        (q, v): (usize, usize),
        nx: usize,
        states: &[f64],
        t: &[f64],
        k: usize,
    ) -> Predicted {
        let terms = self.terms((q, v), t, k, false);
        let rate = self.terms((q, v), t, k, true);
        self.predict(terms, rate, v, nx, states, self.offset)
    }

    /// The same for a velocity that is measured.
    pub fn velocity(
        &self,
        (q, v): (usize, usize),
        nx: usize,
        states: &[f64],
        t: &[f64],
        k: usize,
    ) -> Predicted {
        let terms = match self.delay {
            0.0 => [(k, v, 1.0), (k, v, 0.0), (k, v, 0.0), (k, v, 0.0)],
            _ => self.terms((q, v), t, k, true),
        };
        let rate = self.acceleration((q, v), t, k);
        self.predict(terms, rate, v, nx, states, 0.0)
    }

    /// The position behind a reading `y` that changes with the rate `rate`.
    pub fn position_of(&self, y: f64, rate: f64) -> f64 {
        (y - self.offset + rate * self.delay) / self.factor
    }

    fn predict(
        &self,
        terms: OfJoint,
        rate: OfJoint,
        v: usize,
        nx: usize,
        states: &[f64],
        offset: f64,
    ) -> Predicted {
        let [terms, rate] = [terms, rate].map(|terms| self.of_motor(terms, v));
        let sum = |terms: &Terms| -> f64 {
            let used = terms.iter().filter(|(.., weight)| *weight != 0.0);
            used.map(|(k, i, weight)| weight * states[k * nx + i]).sum()
        };
        let undistorted = sum(&terms);
        Predicted {
            value: offset + self.factor * undistorted,
            terms: terms.map(|(k, i, weight)| (k, i, self.factor * weight)),
            undistorted,
            slope: sum(&rate),
        }
    }

    /// What is said of a joint whose velocity is at `v`, of its motor where the sensor is on that: q + e in place of q, v_m in place of v.
    fn of_motor(&self, terms: OfJoint, v: usize) -> Terms {
        let [a, b, c, d] = terms;
        let none = (a.0, a.1, 0.0);
        let mut all = [a, b, c, d, none, none];
        let Some((stretch, velocity)) = self.on_motor else {
            return all;
        };
        let mut free = 4;
        for (i, term) in terms.into_iter().enumerate().filter(|(_, t)| t.2 != 0.0) {
            match term.1 == v {
                true => all[i].1 = velocity,
                false => {
                    all[free] = (term.0, stretch, term.2);
                    free += 1;
                }
            }
        }
        all
    }

    /// q(t_k − delay), or its rate, in terms of the states at samples.
    fn terms(&self, (q, v): (usize, usize), t: &[f64], k: usize, rate: bool) -> OfJoint {
        let now = if rate { v } else { q };
        let there = [(k, now, 1.0), (k, now, 0.0), (k, now, 0.0), (k, now, 0.0)];
        if self.delay == 0.0 || t.len() < 2 {
            return there;
        }
        let time = t[k] - self.delay;
        let last = t.len() - 2;
        let a = (0..=last.min(k)).rev().find(|&a| t[a] <= time).unwrap_or(0);
        let h = t[a + 1] - t[a];
        let x = time - t[a];
        if x < 0.0 {
            // q₀ + v₀ x + ½ x² (v₁ − v₀)/h
            return match rate {
                false => [
                    (0, q, 1.0),
                    (0, v, x - 0.5 * x * x / h),
                    (1, v, 0.5 * x * x / h),
                    (0, q, 0.0),
                ],
                true => [(0, v, 1.0 - x / h), (1, v, x / h), (0, q, 0.0), (0, q, 0.0)],
            };
        }
        let s = x / h;
        let weights = match rate {
            false => [
                (1.0 + 2.0 * s) * (1.0 - s).powi(2),
                h * s * (1.0 - s).powi(2),
                s * s * (3.0 - 2.0 * s),
                h * s * s * (s - 1.0),
            ],
            true => [
                6.0 * s * (s - 1.0) / h,
                (1.0 - s) * (1.0 - 3.0 * s),
                6.0 * s * (1.0 - s) / h,
                s * (3.0 * s - 2.0),
            ],
        };
        [
            (a, q, weights[0]),
            (a, v, weights[1]),
            (a + 1, q, weights[2]),
            (a + 1, v, weights[3]),
        ]
    }

    /// The rate of the velocity at t_k − delay, by the same cubic.
    fn acceleration(&self, (q, v): (usize, usize), t: &[f64], k: usize) -> OfJoint {
        let time = t[k] - self.delay;
        let a = (0..k.min(t.len().saturating_sub(1)))
            .rev()
            .find(|&a| t[a] <= time)
            .unwrap_or(0);
        let b = (a + 1).min(t.len() - 1);
        let h = match b > a {
            true => t[b] - t[a],
            false => f64::INFINITY,
        };
        let s = (time - t[a]) / h;
        if s < 0.0 {
            return [(a, v, -1.0 / h), (b, v, 1.0 / h), (a, q, 0.0), (b, q, 0.0)];
        }
        [
            (a, q, (12.0 * s - 6.0) / (h * h)),
            (a, v, (6.0 * s - 4.0) / h),
            (b, q, (6.0 - 12.0 * s) / (h * h)),
            (b, v, (6.0 * s - 2.0) / h),
        ]
    }

    /// Adds `scale` ∂reading/∂θ_free to `row`, θ_free's part of it; `position`: of a position, that has an offset.
    pub fn add_by_theta(&self, predicted: &Predicted, scale: f64, position: bool, row: &mut [f64]) {
        for &(column, distortion, by) in &self.columns {
            row[column] += scale
                * by
                * match distortion {
                    Distortion::Offset if position => 1.0,
                    Distortion::Offset => 0.0,
                    Distortion::Scale => predicted.undistorted,
                    Distortion::Delay => -self.factor * predicted.slope,
                };
        }
    }
}
