//! The hand at the paper's rig: it moves the cart to and fro at random and swings the pole meanwhile.
//!
//! The moves are those of [`crate::rig::operator`]. Table 1 of Roehrl et al. 2020 says that there was more: the pole's speed has a
//! standard deviation of 6.7 rad/s and its angle is all around the circle, while the cart's speed has 0.43 m/s. Friction takes
//! μ_p ⟨φ̇²⟩ = 0.09 W out of such a pole; a cart that moves at random with that speed does not bring in half of it, one that is moved in
//! time with the pole does. So the hand adds an acceleration to that of its move,
//!
//! a = −a_max sat[κ (e* − e)] sat[φ̇ cos φ/ω_s], e = φ̇²/(2 ω₀²) + cos φ, sat x = min(max(x, −1), 1),
//!
//! which brings the energy e of the pole to e* (the power that a cart with the acceleration a brings into it is −B a φ̇ cos φ, B its
//! first moment), and about upright, where |φ + φ̇/ω₀| is below the catching angle, a = k φ + d φ̇ up to a largest one,
//! which holds the pole up for a while. With each move the hand changes its mind about e*, or lets the pole alone.
//! It makes up for a share of the friction that it feels.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::config::Swing;
use crate::rig::operator::Operator;
use crate::rig::truth::State;

/// The hand.
#[derive(Debug, Clone)]
pub struct Hand {
    operator: Operator,
    swing: Swing,
    /// kg, what it expects to accelerate.
    mass: f64,
    moods: ChaCha8Rng,
    /// e*; none while the pole is let alone.
    energy: Option<f64>,
}

impl Hand {
    /// A hand that moves the cart as `operator` does, expects to accelerate `mass`, kg, and draws from `moods` what it does with the
    /// pole.
    pub fn new(operator: Operator, swing: Swing, mass: f64, moods: ChaCha8Rng) -> Self {
        Hand {
            operator,
            swing,
            mass,
            moods,
            energy: None,
        }
    }

    /// The force for the next interval, N, at the true state, where the cart's friction is the force `friction` of the speed, N,
    /// negative forwards; time moves on.
    pub fn command(&mut self, state: State, friction: f64) -> f64 {
        let moves = self.operator.moves();
        let wish = self.operator.wish(state);
        if self.operator.moves() != moves {
            self.energy = self.mood();
        }
        let swing = self.energy.map_or(0.0, |e| self.acceleration(e, state));
        let force = wish + self.mass * swing - self.swing.feel * friction;
        self.operator.in_steps(force)
    }

    /// How many moves have begun.
    pub fn moves(&self) -> usize {
        self.operator.moves()
    }

    /// e* of a new move.
    fn mood(&mut self) -> Option<f64> {
        let s = &self.swing;
        let kind: f64 = self.moods.random();
        let place: f64 = self.moods.random();
        let [from, to] = s.energy;
        if kind < s.calm_share {
            None
        } else if kind < s.calm_share + s.wild_share {
            Some(to + (s.wild_energy - to) * place)
        } else {
            Some(from + (to - from) * place)
        }
    }

    /// Of the cart for the sake of the pole, m/s², which is to have the energy e*.
    fn acceleration(&self, wanted: f64, state: State) -> f64 {
        let s = &self.swing;
        let ([_, phi], [_, rate]) = (state.q, state.v);
        let turns = (phi / std::f64::consts::TAU).round();
        let from_upright = phi - turns * std::f64::consts::TAU;
        let ahead = from_upright + rate / s.frequency;
        if ahead.abs() < s.catch_angle && from_upright.abs() < 2.0 * s.catch_angle {
            let [by_angle, by_rate] = s.catch;
            let most = s.catch_acceleration;
            return (by_angle * from_upright + by_rate * rate).clamp(-most, most);
        }
        let energy = 0.5 * (rate / s.frequency).powi(2) + phi.cos();
        let wanted = if rate < 0.0 {
            wanted + s.backwards
        } else {
            wanted
        };
        let share = (s.gain * (wanted - energy)).clamp(-1.0, 1.0);
        -s.acceleration * share * (phi.cos() * rate / s.speed).clamp(-1.0, 1.0)
    }
}
