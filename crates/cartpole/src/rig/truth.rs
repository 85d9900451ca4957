//! The true motion: M v̇ + C v + G = Q_smooth + Q_dry, with dry friction that is set-valued and really sticks.
//!
//! Each joint with dry friction either **slides** one way (its friction is then a smooth function of v) or **sticks** (v = 0 and v̇ = 0
//! exactly; the friction is whatever holds it). The ends of the rail are stops. With backlash the motor is a third body, between two
//! stops on the cart; with an elastic string it is one that pulls at the cart. A lagging force and bent bristles are one number more
//! each, which the same steps follow. The steps, of the classical Runge–Kutta method, end at the instants where one contact turns into another
//! ([`integrators::event`]).

use std::convert::Infallible;
use std::fmt;

use integrators::Flat;
use integrators::event::{
    At, ContactSystem, Direction, EventKind, EventStepper, Friction, Law, Limits,
};
use nalgebra::DMatrix;

use super::Error;
use super::effects::{DryFriction, Effects, Mechanics};
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

/// The coordinates after x and φ: the motor's place, and numbers with a rate of their own. Such a number stands where velocities do,
/// as that of a body of mass 1 that nothing else feels, so that the force on this body is its rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Layout {
    motor: Option<usize>,
    /// The motor's force, N, where it lags or where friction depends on it.
    force: Option<usize>,
    /// The force between two lags, N.
    between_lags: Option<usize>,
    /// The deflection of the bristles, m.
    bristles: Option<usize>,
    coordinates: usize,
}

impl Layout {
    fn of(effects: &Effects) -> Self {
        let mut coordinates = 2;
        let mut more = |wanted: bool| {
            wanted.then(|| {
                coordinates += 1;
                coordinates - 1
            })
        };
        let loaded = effects.joints.iter().any(|forces| forces.dry.load != 0.0);
        Layout {
            motor: more(effects.backlash.is_some() || effects.string.is_some()),
            force: more(effects.drive.lag.is_some() || loaded),
            between_lags: more(effects.drive.lag.is_some() && effects.drive.second_lag.is_some()),
            bristles: more(effects.bristles.is_some()),
            coordinates,
        }
    }
}

/// The dry friction of one joint, whose size may depend on its place and the motor's force.
struct OfJoint {
    joint: usize,
    dry: DryFriction,
    force: Option<usize>,
}

impl Friction for OfJoint {
    fn sliding(&self, direction: Direction, speed: f64, at: At<'_>) -> f64 {
        let force = self.force.map_or(0.0, |i| at.v[i]);
        self.dry.size_at(direction, speed, at.q[self.joint], force)
    }
}

/// The rig without its contacts, in the coordinates of its [`Layout`]. The inputs are the force that arrives at the motor and that on
/// the cart itself, N.
struct Smooth<P> {
    positions: Flat,
    layout: Layout,
    plant: P,
    effects: Effects,
    /// First moment of the pole about its pivot, kg·m, where the mechanics are other than the plant's.
    moment: Option<f64>,
    /// Where the block of the slipping spring is, m.
    block: f64,
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
        &[arriving, on_cart]: &[f64; 2],
        plant: &mut P,
        mass: &mut DMatrix<f64>,
        total: &mut [f64],
    ) -> Result<(), Infallible> {
        let Layout {
            motor,
            force,
            between_lags,
            bristles,
            ..
        } = self.layout;
        let (mut m, mut bias) = plant.mass_and_bias([q[0], q[1]], [v[0], v[1]]);
        if let Some(moment) = self.moment {
            let mechanics = self.effects.mechanics;
            mechanics.change((q[1], v[1]), moment, &mut m, &mut bias);
        }
        let drive = force.map_or(arriving, |i| v[i]);
        let inputs = match motor {
            None => [drive + on_cart, 0.0],
            Some(_) => [on_cart, 0.0],
        };
        mass.fill(0.0);
        for i in 0..2 {
            for j in 0..2 {
                mass[(i, j)] = m[i][j];
            }
            total[i] = inputs[i] - bias[i] + self.effects.joints[i].smooth(q[i], v[i]);
        }
        if let Some(spring) = self.effects.slipping_spring {
            total[0] += spring.force(q[0], self.block);
        }
        if let Some(i) = motor {
            total[i] = drive;
            if let Some(backlash) = self.effects.backlash {
                mass[(0, 0)] -= backlash.motor_inertia;
                mass[(i, i)] += backlash.motor_inertia;
            }
            if let Some(string) = self.effects.string {
                let pull = string.pull(q[i] - q[0], v[i] - v[0]);
                mass[(i, i)] += string.motor_inertia;
                total[i] -= pull;
                total[0] += pull;
            }
        }
        if let Some(i) = force {
            mass[(i, i)] = 1.0;
            let lags = self.effects.drive;
            total[i] = match (lags.lag, between_lags.zip(lags.second_lag)) {
                (None, _) => 0.0,
                (Some(t), None) => (arriving - v[i]) / t,
                (Some(_), Some((between, t))) => (v[between] - v[i]) / t,
            };
            if let (Some(between), Some(t)) = (between_lags, lags.lag) {
                mass[(between, between)] = 1.0;
                total[between] = (arriving - v[between]) / t;
            }
        }
        if let (Some(i), Some(law)) = (bristles, self.effects.bristles) {
            let (rate, friction) = law.bend(v[i], v[0]);
            mass[(i, i)] = 1.0;
            total[i] = rate;
            total[0] += friction;
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
fn laws(effects: &Effects, layout: Layout) -> Vec<(Contact, Law)> {
    let along = |entries: &[(usize, f64)]| {
        let mut w = vec![0.0; layout.coordinates];
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
            let size = OfJoint {
                joint,
                dry: forces.dry,
                force: layout.force,
            };
            (
                Contact::Friction,
                Law::friction(&along(&[(joint, 1.0)]), size),
            )
        })
        .collect();
    for side in [1.0, -1.0] {
        if let (Some(backlash), Some(motor)) = (effects.backlash, layout.motor) {
            // g = b/2 ± (z − x)
            let w = along(&[(motor, side), (0, -side)]);
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

/// Dry friction may change so often within a step: a motor that comes to rest on a flank bounces e^k v with e up to 0.5 down to rounding,
/// some forty times, and each blow may set a cart going that friction stops again.
const MOST_CHANGES: usize = 128;

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
    /// A rig at time 0 in the given state, with the motor at the middle of its gap or its string at rest and as fast as the cart,
    /// without a force of the motor, its bristles straight and its springs relaxed; `step`, s, is the longest step of the integrator.
    pub fn new(mut plant: P, effects: Effects, step: f64, State { q, v }: State) -> Self {
        let layout = Layout::of(&effects);
        // At the upright the coupling of cart and pole is the moment itself.
        let changed = effects.mechanics != Mechanics::default();
        let moment = changed.then(|| plant.mass_and_bias([0.0; 2], [0.0; 2]).0[0][1]);
        let smooth = Smooth {
            positions: Flat::new(layout.coordinates),
            layout,
            plant,
            effects,
            moment,
            block: q[0],
        };
        let mut x = vec![0.0; 2 * layout.coordinates];
        let (positions, velocities) = x.split_at_mut(layout.coordinates);
        for (all, [cart, pole]) in [(positions, q), (velocities, v)] {
            (all[0], all[1]) = (cart, pole);
            if let Some(motor) = layout.motor {
                all[motor] = cart;
            }
        }
        Truth {
            smooth,
            stepper: None,
            contacts: Vec::new(),
            step,
            time: 0.0,
            x,
            blows: Vec::new(),
        }
    }

    /// With the motor at another place, m, and speed, m/s; nothing where nothing is between it and the cart.
    pub fn with_motor(mut self, place: f64, speed: f64) -> Self {
        let Layout {
            motor, coordinates, ..
        } = self.smooth.layout;
        if let Some(motor) = motor {
            self.x[motor] = place;
            self.x[coordinates + motor] = speed;
        }
        self
    }

    /// Where cart and pole are.
    pub fn state(&self) -> State {
        let (q, v) = self.x.split_at(self.x.len() / 2);
        State {
            q: [q[0], q[1]],
            v: [v[0], v[1]],
        }
    }

    /// Where the motor is, m, and its speed, m/s: the cart's where nothing is between them.
    pub fn motor(&self) -> (f64, f64) {
        let (q, v) = self.x.split_at(self.x.len() / 2);
        let motor = self.smooth.layout.motor.unwrap_or(0);
        (q[motor], v[motor])
    }

    /// When the cart struck an end of its rail, s.
    pub fn blows(&self) -> &[f64] {
        &self.blows
    }

    /// Lets `duration` seconds pass, with `force`, N, of the drive held.
    pub fn advance(&mut self, force: f64, duration: f64) -> Result<(), Error> {
        self.advance_under([force, 0.0], duration)
    }

    /// Lets `duration` seconds pass, with two forces held, N: that which arrives at the motor, and one on the cart itself.
    pub fn advance_under(&mut self, forces: [f64; 2], duration: f64) -> Result<(), Error> {
        if duration <= 0.0 {
            return Ok(());
        }
        let stepper = match &mut self.stepper {
            Some(stepper) => stepper,
            none => {
                let laws = laws(&self.smooth.effects, self.smooth.layout);
                self.contacts = laws.iter().map(|(contact, _)| *contact).collect();
                let laws = laws.into_iter().map(|(_, law)| law).collect();
                let limits = Limits {
                    most_changes: MOST_CHANGES,
                    ..Limits::default()
                };
                let stepper = EventStepper::new(&self.smooth, laws).map_err(Error::Motion)?;
                none.insert(stepper.with_limits(limits))
            }
        };
        // The small excess keeps 20 ms / 0.5 ms from becoming 41 steps.
        let steps = (duration / self.step * (1.0 - 1e-9)).ceil().max(1.0);
        stepper.clear_events();
        if let (Some(force), None) = (self.smooth.layout.force, self.smooth.effects.drive.lag) {
            self.x[self.smooth.layout.coordinates + force] = forces[0];
        }
        match self.smooth.effects.slipping_spring {
            None => stepper
                .advance(
                    &self.smooth,
                    (self.time, duration, steps as usize),
                    &forces,
                    &mut self.x,
                )
                .map_err(Error::Motion)?,
            // The block follows from step to step.
            Some(spring) => {
                let h = duration / steps;
                for i in 0..steps as usize {
                    let start = self.time + i as f64 * h;
                    let (x, v) = (self.x[0], self.x[self.smooth.layout.coordinates]);
                    stepper
                        .advance(&self.smooth, (start, h, 1), &forces, &mut self.x)
                        .map_err(Error::Motion)?;
                    let (x_end, v_end) = (self.x[0], self.x[self.smooth.layout.coordinates]);
                    if v * v_end < 0.0 {
                        // It turned around within the step, at x + ½ v² h/(v − v_end) but for the change of its acceleration.
                        let furthest = x + 0.5 * v * v * h / (v - v_end);
                        self.smooth.block = spring.drag(furthest, self.smooth.block);
                    }
                    self.smooth.block = spring.drag(x_end, self.smooth.block);
                }
            }
        }
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
