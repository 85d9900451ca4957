//! The controller: swings the pole up by its energy, and hands it to the regulator when it can be caught.
//!
//! E is the pole's energy with the cart at rest over its potential energy upright: −1 hanging, 1 upright. A cart with the acceleration a brings the
//! power −B a φ̇ cos φ into the pole, so the force goes along −(E* − E) φ̇ cos φ, and back to the centre of the rail. The pole can be caught where the
//! regulator brings it upright on the learnt model, and the cart stays on its rail: that is tried before it is done.

use std::error::Error;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

use lagrange::Mechanics;
use pinode_nn::environment::Channel;
use pinode_nn::model::Model;

use super::plant::{Plant, State};
use super::regulator::Regulator;

/// Trials of a catch go on for so many samples, and end closer to upright than this, rad.
const TRIAL: usize = 45;
const END: f64 = 0.1;
/// They begin below these: rad, and energy away from 1.
const WITHIN: [f64; 2] = [1.1, 0.6];
/// A pole that leans further is lost, rad.
const LOST: f64 = 1.2;
/// The cart is held back where it is about to come closer to an end of its rail than this, m, seen so far ahead, s, by this force, N/m.
const GUARD: [f64; 3] = [0.08, 0.1, 120.0];
/// A trial of a catch leaves so much of the rail, m.
const LEFT: f64 = 0.04;

/// What is tuned.
#[derive(Debug, Clone, Copy)]
pub struct Gains {
    /// Largest force for the pole, N.
    pub force: f64,
    /// Share of it per missing energy.
    pub by_energy: f64,
    /// The energy E* that it is swung to.
    pub energy: f64,
    /// N/m back to the centre.
    pub centring: f64,
    /// N·s/m.
    pub damping: f64,
}

impl Gains {
    /// Names, first guesses and their spread.
    pub const GUESS: [(&'static str, f64, f64); 5] = [
        ("force, N", 5.0, 2.0),
        ("share per energy", 2.0, 0.7),
        ("energy", 1.2, 0.15),
        ("centring, N/m", 12.0, 5.0),
        ("damping, N s/m", 1.0, 0.7),
    ];

    /// From numbers in the order of [`Gains::GUESS`], none of them negative.
    pub fn of(numbers: &[f64; 5]) -> Self {
        let [force, by_energy, energy, centring, damping] = numbers.map(|x| x.max(0.0));
        Gains {
            force,
            by_energy,
            energy,
            centring,
            damping,
        }
    }
}

/// What the controller knows of the pole: from the learnt model's mechanics.
pub struct Pole {
    mechanics: Arc<dyn Mechanics>,
    constants: Vec<f64>,
    /// V level, and upright above that, J.
    level: f64,
    height: f64,
    /// How fast it falls from upright, 1/s.
    pub rate: f64,
}

impl Pole {
    pub fn new(model: &Model) -> Self {
        let (mechanics, constants) = (model.mechanics.clone(), model.parameter_values.clone());
        let potential = |phi: f64| mechanics.potential_energy_with(&[0.0, phi], &constants);
        let level = potential(FRAC_PI_2);
        let height = potential(0.0) - level;
        let inertia = 2.0 * mechanics.kinetic_energy_with(&[0.0; 2], &[0.0, 1.0], &constants);
        Pole {
            level,
            height,
            rate: (height / inertia).sqrt(),
            mechanics,
            constants,
        }
    }

    fn energy(&self, state: &State) -> f64 {
        let q = [0.0, state[1]];
        let kinetic = self
            .mechanics
            .kinetic_energy_with(&q, &[0.0, state[3]], &self.constants);
        let potential = self.mechanics.potential_energy_with(&q, &self.constants);
        (kinetic + potential - self.level) / self.height
    }
}

/// The controller with what it keeps from step to step.
pub struct Pilot<'a> {
    pub gains: Gains,
    pub pole: &'a Pole,
    pub regulator: &'a Regulator,
    pub action: &'a Channel,
    /// The ends of the rail, m.
    pub ends: [f64; 2],
    /// The learnt model without the delay of its input: catches are tried on it.
    pub prompt: Plant,
    /// The inputs that are still under way, the last one last, N.
    pub past: Vec<f64>,
    pub caught: bool,
}

impl Pilot<'_> {
    /// Before an episode.
    pub fn begin(&mut self) {
        self.past.clear();
        self.caught = false;
    }

    /// The middle of the rail, m.
    pub fn centre(&self) -> f64 {
        0.5 * (self.ends[0] + self.ends[1])
    }

    /// The force for the coming interval, N, at the `state` that the rig is in now.
    pub fn command(&mut self, plant: &mut Plant, state: &State) -> Result<f64, Box<dyn Error>> {
        let mut ahead = plant.arrived(state, &self.past)?;
        ahead[1] -= TAU * (ahead[1] / TAU).round();
        self.caught = match self.caught {
            true => ahead[1].abs() < LOST,
            false => self.can_catch(&ahead)?,
        };
        let force = match self.caught {
            true => self.regulator.force(&ahead),
            false => self.swing(&ahead),
        };
        let force = self.action.clip(force);
        self.past.push(force);
        let done = self.past.len().saturating_sub(plant.past());
        self.past.drain(..done);
        Ok(force)
    }

    /// Whether the regulator brings the pole upright from here.
    fn can_catch(&mut self, ahead: &State) -> Result<bool, Box<dyn Error>> {
        let [angle, energy] = WITHIN;
        if ahead[1].abs() > angle || (self.pole.energy(ahead) - 1.0).abs() > energy {
            return Ok(false);
        }
        let mut state = *ahead;
        for _ in 0..TRIAL {
            let force = self.action.clip(self.regulator.force(&state));
            state = self.prompt.after(&state, &[], &[force])?;
            let on_rail = self.ends[0] + LEFT < state[0] && state[0] < self.ends[1] - LEFT;
            if !on_rail || state[1].abs() > LOST {
                return Ok(false);
            }
        }
        Ok(state[1].abs() < END)
    }

    fn swing(&self, ahead: &State) -> f64 {
        let g = &self.gains;
        let missing = (g.by_energy * (g.energy - self.pole.energy(ahead))).clamp(-1.0, 1.0);
        let drive = ahead[3] * ahead[1].cos() / self.pole.rate;
        // A pole at rest feels nothing of the energy: any push will do.
        let along = match drive.abs() < 1e-2 {
            true => 1.0,
            false => (2.0 * drive).clamp(-1.0, 1.0),
        };
        let [close, foresight, stiffness] = GUARD;
        let soon = ahead[0] + foresight * ahead[2];
        let over = soon - soon.clamp(self.ends[0] + close, self.ends[1] - close);
        let back = g.centring * (ahead[0] - self.centre()) + g.damping * ahead[2];
        -g.force * missing * along - back - stiffness * over
    }
}
