//! The true motion: M v̇ + C v + G = Q_smooth + Q_dry, with dry friction that is set-valued and really sticks.
//!
//! Each joint with dry friction either **slides** one way (its friction is then a smooth function of v) or **sticks** (v = 0 and v̇ = 0
//! exactly; the friction is whatever holds it). The steps, of the classical Runge–Kutta method, end at the instants where one
//! turns into the other ([`integrators::event`]).

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

/// The rig without its dry friction; the input is the force on the cart, N.
struct Smooth<P> {
    positions: Flat,
    plant: P,
    effects: Effects,
}

impl<P: Plant> ContactSystem for Smooth<P> {
    type Positions = Flat;
    type Input = f64;
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
        force: &f64,
        plant: &mut P,
        mass: &mut DMatrix<f64>,
        total: &mut [f64],
    ) -> Result<(), Infallible> {
        let (m, bias) = plant.mass_and_bias([q[0], q[1]], [v[0], v[1]]);
        let inputs = [*force, 0.0];
        for i in 0..2 {
            for j in 0..2 {
                mass[(i, j)] = m[i][j];
            }
            total[i] = inputs[i] - bias[i] + self.effects.joints[i].smooth(q[i], v[i]);
        }
        Ok(())
    }
}

/// The dry friction of each joint that has some.
fn laws(effects: &Effects) -> Vec<Law> {
    [[1.0, 0.0], [0.0, 1.0]]
        .iter()
        .zip(&effects.joints)
        .filter(|(_, forces)| !forces.dry.is_none())
        .map(|(joint, forces)| {
            let dry = forces.dry;
            Law::friction(joint, move |direction, speed| dry.size(direction, speed))
        })
        .collect()
}

/// The simulated rig.
pub struct Truth<P: Plant> {
    smooth: Smooth<P>,
    /// Made by the first call that moves.
    stepper: Option<EventStepper<Smooth<P>>>,
    step: f64,
    time: f64,
    state: State,
}

impl<P: Plant> fmt::Debug for Truth<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Truth")
            .field("effects", &self.smooth.effects)
            .field("time", &self.time)
            .field("state", &self.state)
            .finish_non_exhaustive()
    }
}

impl<P: Plant> Truth<P> {
    /// A rig at time 0 in the given state; `step`, s, is the longest step of the integrator.
    pub fn new(plant: P, effects: Effects, step: f64, state: State) -> Self {
        let smooth = Smooth {
            positions: Flat::new(2),
            plant,
            effects,
        };
        Truth {
            smooth,
            stepper: None,
            step,
            time: 0.0,
            state,
        }
    }

    /// Where it is.
    pub fn state(&self) -> State {
        self.state
    }

    /// Lets `duration` seconds pass, with `force`, N, held on the cart.
    pub fn advance(&mut self, force: f64, duration: f64) -> Result<(), Error> {
        if duration <= 0.0 {
            return Ok(());
        }
        let stepper = match &mut self.stepper {
            Some(stepper) => stepper,
            none => {
                let laws = laws(&self.smooth.effects);
                none.insert(EventStepper::new(&self.smooth, laws).map_err(Error::Motion)?)
            }
        };
        // The small excess keeps 20 ms / 0.5 ms from becoming 41 steps.
        let steps = (duration / self.step * (1.0 - 1e-9)).ceil().max(1.0);
        let State { q, v } = self.state;
        let mut x = [q[0], q[1], v[0], v[1]];
        stepper.clear_events();
        stepper
            .advance(
                &self.smooth,
                (self.time, duration, steps as usize),
                &force,
                &mut x,
            )
            .map_err(Error::Motion)?;
        if let Some(held) = stepper.events().iter().find(|e| e.kind == EventKind::Held) {
            return Err(Error::Chatter { time: held.time });
        }
        self.time += duration;
        self.state = State {
            q: [x[0], x[1]],
            v: [x[2], x[3]],
        };
        Ok(())
    }
}
