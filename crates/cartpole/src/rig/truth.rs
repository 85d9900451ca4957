//! The true motion: M v̇ + C v + G = Q_smooth + Q_dry, with dry friction that is set-valued and really sticks.
//!
//! Each joint with dry friction either **slides** one way (its friction is then a smooth function of v) or **sticks** (v = 0 and v̇ = 0
//! exactly; the friction is whatever holds it). The ends of the rail are stops, and with backlash the motor is a third body, between
//! two stops on the cart. The steps, of the classical Runge–Kutta method, end at the instants where one contact turns into another
//! ([`integrators::event`]).

use std::convert::Infallible;
use std::fmt;

use integrators::Flat;
use integrators::event::{ContactSystem, EventKind, EventStepper, Law};
use nalgebra::DMatrix;

use super::Error;
use super::effects::Effects;
use super::plant::Plant;

/// q and v of `slider` (m, m/s) and `pole` (rad, rad/s; 0 = upright).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Positions; the pole's angle is not wrapped.
    pub q: [f64; 2],
    /// Velocities.
    pub v: [f64; 2],
}

impl State {
    /// The cart in the middle of its rail, the pole hanging, at rest.
    pub const HANGING: State = State {
        q: [0.0, std::f64::consts::PI],
        v: [0.0, 0.0],
    };
}

/// The rig without its contacts, in (x, φ), and with backlash (x, φ, z), z the motor's place. The inputs are the force of the drive
/// and that on the cart itself, N.
struct Smooth<P> {
    positions: Flat,
    plant: P,
    effects: Effects,
}

impl<P: Plant> ContactSystem for Smooth<P> {
    type Positions = Flat;
    type Input = [f64; 2];
    type Memory = P;
    type Error = Infallible;

    fn positions(&self) -> &Flat {
        &self.positions
    }

    fn memory(&self) -> P {
        self.plant.clone()
    }

    fn mass_and_force(
        &self,
        _t: f64,
        (q, v): (&[f64], &[f64]),
        &[drive, on_cart]: &[f64; 2],
        plant: &mut P,
        mass: &mut DMatrix<f64>,
        total: &mut [f64],
    ) -> Result<(), Infallible> {
        let (m, bias) = plant.mass_and_bias([q[0], q[1]], [v[0], v[1]]);
        let inputs = match self.effects.backlash {
            None => [drive + on_cart, 0.0],
            Some(_) => [on_cart, 0.0],
        };
        for i in 0..2 {
            for j in 0..2 {
                mass[(i, j)] = m[i][j];
            }
            total[i] = inputs[i] - bias[i] + self.effects.joints[i].smooth(q[i], v[i]);
        }
        if let Some(backlash) = self.effects.backlash {
            for i in 0..2 {
                mass[(i, 2)] = 0.0;
                mass[(2, i)] = 0.0;
            }
            mass[(0, 0)] -= backlash.motor_inertia;
            mass[(2, 2)] = backlash.motor_inertia;
            total[2] = drive;
        }
        Ok(())
    }
}

/// What the laws of contact are, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Contact {
    Friction,
    Flank,
    EndOfRail,
}

/// The dry friction of each joint that has some, the flanks of the backlash, the ends of the rail.
fn laws(effects: &Effects) -> Vec<(Contact, Law)> {
    let n = coordinates(effects);
    let along = |entries: &[(usize, f64)]| {
        let mut w = vec![0.0; n];
        for &(i, x) in entries {
            w[i] = x;
        }
        w
    };
    let mut laws: Vec<(Contact, Law)> = effects
        .joints
        .iter()
        .enumerate()
        .filter(|(_, forces)| !forces.dry.is_none())
        .map(|(joint, forces)| {
            let dry = forces.dry;
            let size = move |direction, speed| dry.size(direction, speed);
            (
                Contact::Friction,
                Law::friction(&along(&[(joint, 1.0)]), size),
            )
        })
        .collect();
    for side in [1.0, -1.0] {
        if let Some(backlash) = effects.backlash {
            // g = b/2 ± (z − x)
            let w = along(&[(2, side), (0, -side)]);
            let flank = Law::stop(&w, 0.5 * backlash.gap, backlash.restitution);
            laws.push((Contact::Flank, flank));
        }
    }
    for side in [1.0, -1.0] {
        if let Some(rail) = effects.rail {
            let end = Law::stop(&along(&[(0, side)]), rail.limit, rail.restitution);
            laws.push((Contact::EndOfRail, end));
        }
    }
    laws
}

fn coordinates(effects: &Effects) -> usize {
    if effects.backlash.is_some() { 3 } else { 2 }
}

/// The simulated rig.
pub struct Truth<P: Plant> {
    smooth: Smooth<P>,
    /// Made by the first call that moves.
    stepper: Option<EventStepper<Smooth<P>>>,
    contacts: Vec<Contact>,
    step: f64,
    time: f64,
    /// q, then v.
    x: Vec<f64>,
    blows: Vec<f64>,
}

impl<P: Plant> fmt::Debug for Truth<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Truth")
            .field("effects", &self.smooth.effects)
            .field("time", &self.time)
            .field("state", &self.state())
            .finish_non_exhaustive()
    }
}

impl<P: Plant> Truth<P> {
    /// A rig at time 0 in the given state, with the motor in the middle of its gap and as fast as the cart; `step`, s, is the longest
    /// step of the integrator.
    pub fn new(plant: P, effects: Effects, step: f64, State { q, v }: State) -> Self {
        let smooth = Smooth {
            positions: Flat::new(coordinates(&effects)),
            plant,
            effects,
        };
        let motor = |cart: f64| effects.backlash.map(|_| cart);
        let positions = q.into_iter().chain(motor(q[0]));
        Truth {
            smooth,
            stepper: None,
            contacts: Vec::new(),
            step,
            time: 0.0,
            x: positions.chain(v).chain(motor(v[0])).collect(),
            blows: Vec::new(),
        }
    }

    /// Where cart and pole are.
    pub fn state(&self) -> State {
        let (q, v) = self.x.split_at(self.x.len() / 2);
        State {
            q: [q[0], q[1]],
            v: [v[0], v[1]],
        }
    }

    /// Where the motor is, m, and its speed, m/s: the cart's without backlash.
    pub fn motor(&self) -> (f64, f64) {
        let (q, v) = self.x.split_at(self.x.len() / 2);
        let last = if self.smooth.effects.backlash.is_some() {
            2
        } else {
            0
        };
        (q[last], v[last])
    }

    /// When the cart struck an end of its rail, s.
    pub fn blows(&self) -> &[f64] {
        &self.blows
    }

    /// Lets `duration` seconds pass, with `force`, N, of the drive held.
    pub fn advance(&mut self, force: f64, duration: f64) -> Result<(), Error> {
        self.advance_under([force, 0.0], duration)
    }

    /// Lets `duration` seconds pass, with two forces held, N: that of the drive, and one on the cart itself.
    pub fn advance_under(&mut self, forces: [f64; 2], duration: f64) -> Result<(), Error> {
        if duration <= 0.0 {
            return Ok(());
        }
        let stepper = match &mut self.stepper {
            Some(stepper) => stepper,
            none => {
                let laws = laws(&self.smooth.effects);
                self.contacts = laws.iter().map(|(contact, _)| *contact).collect();
                let laws = laws.into_iter().map(|(_, law)| law).collect();
                none.insert(EventStepper::new(&self.smooth, laws).map_err(Error::Motion)?)
            }
        };
        // The small excess keeps 20 ms / 0.5 ms from becoming 41 steps.
        let steps = (duration / self.step * (1.0 - 1e-9)).ceil().max(1.0);
        stepper.clear_events();
        stepper
            .advance(
                &self.smooth,
                (self.time, duration, steps as usize),
                &forces,
                &mut self.x,
            )
            .map_err(Error::Motion)?;
        for event in stepper.events() {
            match event.kind {
                EventKind::Held => return Err(Error::Chatter { time: event.time }),
                EventKind::Impact { .. }
                    if self.contacts.get(event.law) == Some(&Contact::EndOfRail) =>
                {
                    self.blows.push(event.time);
                }
                _ => {}
            }
        }
        self.time += duration;
        Ok(())
    }
}
