//! The hand at the input: random moves left and right, as on the paper's rig.
//!
//! A move goes from one place to another by the minimum-jerk law x(s) = x₀ + L (10 s³ − 15 s⁴ + 6 s⁵), s = t/T; its time, length and
//! side and the rest after it are random. The hand sees the true cart, drags it along with a spring and a damper,
//! F = k (x_ref − x) + d (ẋ_ref − ẋ) + m ẍ_ref, and trembles. Where
//! the cart is about to leave the hand's reach, x + ẋ t_f beyond ± the reach (or beyond other bounds, where the settings give some), it is
//! held back by k_g times the excess. The force is commanded once a sample, in steps.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::noise::Coloured;
use super::truth::State;
use crate::config::Operator as Settings;

/// The hand.
#[derive(Debug, Clone)]
pub struct Operator {
    settings: Settings,
    interval: f64,
    moves: ChaCha8Rng,
    tremor: Coloured,
    time: f64,
    current: Move,
    made: usize,
}

/// One move: from `start` s on, from `from` m by `length` m in `duration` s, then rest until `end` s.
#[derive(Debug, Clone, Copy)]
struct Move {
    start: f64,
    from: f64,
    length: f64,
    duration: f64,
    end: f64,
}

impl Move {
    /// x_ref, ẋ_ref, ẍ_ref at time t.
    fn at(&self, t: f64) -> [f64; 3] {
        let s = ((t - self.start) / self.duration).clamp(0.0, 1.0);
        let (l, d) = (self.length, self.duration);
        [
            self.from + l * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s),
            l / d * 30.0 * (s * (1.0 - s)).powi(2),
            l / (d * d) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
        ]
    }
}

impl Operator {
    /// A hand that commands a force every `interval` seconds, beginning with a rest in the middle of the rail.
    pub fn new(
        settings: Settings,
        interval: f64,
        mut moves: ChaCha8Rng,
        tremor: ChaCha8Rng,
    ) -> Self {
        let [from, to] = settings.dwell;
        Operator {
            tremor: Coloured::new(tremor, settings.tremor, settings.tremor_time, interval),
            settings,
            interval,
            time: 0.0,
            current: Move {
                start: 0.0,
                from: 0.0,
                length: 0.0,
                duration: 1.0,
                end: moves.random_range(from..=to),
            },
            moves,
            made: 0,
        }
    }

    /// The force for the next interval, N, at the true state; time moves on.
    pub fn command(&mut self, state: State) -> f64 {
        let force = self.wish(state);
        self.in_steps(force)
    }

    /// How many moves have begun.
    pub fn moves(&self) -> usize {
        self.made
    }

    /// The force for the next interval before it is limited and comes in steps, N; time moves on.
    pub(crate) fn wish(&mut self, state: State) -> f64 {
        while self.time >= self.current.end {
            self.current = self.next_move();
            self.made += 1;
        }
        let s = &self.settings;
        let [x, x_dot, x_ddot] = self.current.at(self.time);
        let at = state.q[0] - s.centre;
        // Where the cart is about to be, beyond the reach: there the hand holds against it.
        let [left, right] = s.hold.unwrap_or([-s.reach, s.reach]);
        let ahead = at + s.foresight * state.v[0];
        let excess = ahead - ahead.clamp(left, right);
        let force = s.stiffness * (x - at) + s.damping * (x_dot - state.v[0]) + s.mass * x_ddot
            - s.guard * excess
            + self.tremor.next();
        self.time += self.interval;
        force
    }

    /// What is commanded where this force is wished for, N.
    pub(crate) fn in_steps(&self, force: f64) -> f64 {
        let s = &self.settings;
        let force = force.clamp(-s.limit, s.limit);
        (force / s.resolution).round() * s.resolution
    }

    fn next_move(&mut self) -> Move {
        let s = &self.settings;
        let mut draw = |[from, to]: [f64; 2]| self.moves.random_range(from..=to);
        let from = self.current.from + self.current.length;
        let (length, duration, dwell) = (draw(s.move_length), draw(s.move_time), draw(s.dwell));
        let right = from + length <= s.reach;
        let left = from - length >= -s.reach;
        let to = match (right, left) {
            (true, true) if self.moves.random_bool(0.5) => from + length,
            (true, false) => from + length,
            (_, true) => from - length,
            // Too long for either side: to the far end of the reach.
            (false, false) => -s.reach.copysign(from),
        };
        let start = self.current.end;
        // The largest acceleration of a move is 10/√3 L/T²: a long way takes its time.
        let quickest = (10.0 / 3.0_f64.sqrt() * (to - from).abs() / s.acceleration).sqrt();
        let duration = duration.max(quickest);
        Move {
            start,
            from,
            length: to - from,
            duration,
            end: start + duration + dwell,
        }
    }
}
