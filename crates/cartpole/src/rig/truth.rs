//! The true motion: M v̇ + C v + G = Q_smooth + Q_dry, with dry friction that is set-valued and really sticks.
//!
//! Each joint with dry friction either **slides** one way (its friction is then a smooth function of v) or **sticks** (v = 0 and v̇ = 0
//! exactly; the friction is whatever holds it). In a fixed set of these contacts the equations are smooth and integrated by the
//! classical Runge–Kutta method. A sliding joint that comes to rest inside a step ends it there, at the root of v(t), found by
//! bisection; the contacts at rest are then those that are consistent: a joint sticks if the force that holds it lies between the two
//! breakaway forces, and else starts to slide the way that it accelerates. M is positive definite, so one answer exists; with two
//! joints it is found by trying all. A sticking joint lets go at the first step whose beginning asks more than it holds.
//! (Karnopp, 1985, with the velocity band replaced by the exact event.)

use super::Error;
use super::effects::{Direction, Effects};
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

/// What dry friction does on a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Contact {
    /// No dry friction.
    Free,
    Slides(Direction),
    Sticks,
}

type Contacts = [Contact; 2];

/// After this many comings to rest in one step, a joint stays at rest until the end of the step.
const MOST_EVENTS: usize = 16;
/// Halvings of a step in the search for the instant of rest: to 1e-12 of the step.
const BISECTIONS: usize = 40;

/// The simulated rig.
#[derive(Debug, Clone)]
pub struct Truth<P> {
    plant: P,
    effects: Effects,
    step: f64,
    time: f64,
    state: State,
}

impl<P: Plant> Truth<P> {
    /// A rig at time 0 in the given state; `step`, s, is the longest step of the integrator.
    pub fn new(plant: P, effects: Effects, step: f64, state: State) -> Self {
        Truth {
            plant,
            effects,
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
        // The small excess keeps 20 ms / 0.5 ms from becoming 41 steps.
        let steps = (duration / self.step * (1.0 - 1e-9)).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(force, duration / steps)?;
        }
        Ok(())
    }

    fn step(&mut self, force: f64, h: f64) -> Result<(), Error> {
        let mut rest_of_step = h;
        let mut held = [false; 2];
        for event in 0.. {
            let contacts = self.contacts(force, held)?;
            let after = self.runge_kutta(contacts, force, rest_of_step)?;
            let Some(_) = turned(contacts, after) else {
                self.state = after;
                break;
            };
            let (mut before_rest, mut past_rest) = (0.0, rest_of_step);
            let mut at_rest = after;
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (before_rest + past_rest);
                let there = self.runge_kutta(contacts, force, middle)?;
                if turned(contacts, there).is_some() {
                    past_rest = middle;
                    at_rest = there;
                } else {
                    before_rest = middle;
                }
            }
            // Past the root by 1e-12 of a step: the joint that has just turned is at rest.
            while let Some(joint) = turned(contacts, at_rest) {
                at_rest.v[joint] = 0.0;
                held[joint] = event >= MOST_EVENTS;
            }
            self.state = at_rest;
            rest_of_step -= past_rest;
            if rest_of_step <= 1e-12 * h {
                break;
            }
        }
        self.time += h;
        let State { q, v } = self.state;
        match q.iter().chain(&v).position(|x| !x.is_finite()) {
            None => Ok(()),
            Some(index) => Err(Error::Mechanics {
                time: self.time,
                source: lagrange::Error::NotFinite {
                    what: "the state (q, v)",
                    index,
                    value: [q[0], q[1], v[0], v[1]][index],
                },
            }),
        }
    }

    /// The contacts at the present state; a joint that is `held` and at rest sticks whatever it takes.
    fn contacts(&mut self, force: f64, held: [bool; 2]) -> Result<Contacts, Error> {
        let State { v, .. } = self.state;
        let options = |joint: usize| -> &'static [Contact] {
            const ANY: [Contact; 3] = [
                Contact::Sticks,
                Contact::Slides(Direction::Positive),
                Contact::Slides(Direction::Negative),
            ];
            if self.effects.joints[joint].dry.is_none() {
                &[Contact::Free]
            } else if v[joint] > 0.0 {
                &ANY[1..2]
            } else if v[joint] < 0.0 {
                &ANY[2..]
            } else if held[joint] {
                &ANY[..1]
            } else {
                &ANY
            }
        };
        let (first, second) = (options(0), options(1));
        let mut fallback = [first[0], second[0]];
        for &slider in first {
            for &pole in second {
                let contacts = [slider, pole];
                let (acceleration, reaction) = self.acceleration(self.state, contacts, force)?;
                let consistent = (0..2).all(|joint| match contacts[joint] {
                    Contact::Free => true,
                    Contact::Sticks => {
                        held[joint] || self.effects.joints[joint].dry.holds(reaction[joint])
                    }
                    Contact::Slides(direction) => {
                        v[joint] != 0.0 || direction.sign() * acceleration[joint] > 0.0
                    }
                });
                if consistent {
                    return Ok(contacts);
                }
                fallback = contacts;
            }
        }
        // Only rounding, at the very border of sticking, leaves none: staying at rest is then as right as sliding.
        for joint in 0..2 {
            if v[joint] == 0.0 && fallback[joint] != Contact::Free {
                fallback[joint] = Contact::Sticks;
            }
        }
        Ok(fallback)
    }

    /// v̇, and the generalized force that friction supplies on sticking joints.
    fn acceleration(
        &mut self,
        State { q, v }: State,
        contacts: Contacts,
        force: f64,
    ) -> Result<([f64; 2], [f64; 2]), Error> {
        let (m, bias) = self.plant.mass_and_bias(q, v);
        let mut rhs = [force - bias[0], -bias[1]];
        for joint in 0..2 {
            let forces = &self.effects.joints[joint];
            rhs[joint] += forces.smooth(q[joint], v[joint]);
            if let Contact::Slides(direction) = contacts[joint] {
                rhs[joint] += forces.dry.sliding(direction, v[joint]);
            }
        }
        let sticks = contacts.map(|c| c == Contact::Sticks);
        let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
        if !(m[0][0] > 0.0 && m[1][1] > 0.0 && determinant > 0.0) {
            let pivot = usize::from(m[0][0] > 0.0);
            return Err(Error::Mechanics {
                time: self.time,
                source: lagrange::Error::SingularMassMatrix {
                    q: q.to_vec(),
                    pivot,
                    value: m[pivot][pivot],
                },
            });
        }
        let a = match sticks {
            [false, false] => [
                (m[1][1] * rhs[0] - m[0][1] * rhs[1]) / determinant,
                (m[0][0] * rhs[1] - m[1][0] * rhs[0]) / determinant,
            ],
            [true, false] => [0.0, rhs[1] / m[1][1]],
            [false, true] => [rhs[0] / m[0][0], 0.0],
            [true, true] => [0.0, 0.0],
        };
        let reaction = [0, 1].map(|i| {
            if sticks[i] {
                m[i][0] * a[0] + m[i][1] * a[1] - rhs[i]
            } else {
                0.0
            }
        });
        Ok((a, reaction))
    }

    /// The state after h seconds in fixed contacts, by the classical Runge–Kutta method; of fourth order, as these are smooth.
    fn runge_kutta(&mut self, contacts: Contacts, force: f64, h: f64) -> Result<State, Error> {
        let start = self.state;
        let moved = |rate: State, h: f64| State {
            q: [start.q[0] + h * rate.q[0], start.q[1] + h * rate.q[1]],
            v: [start.v[0] + h * rate.v[0], start.v[1] + h * rate.v[1]],
        };
        let mut rate = |at: State| -> Result<State, Error> {
            let (v, _) = self.acceleration(at, contacts, force)?;
            Ok(State { q: at.v, v })
        };
        let k1 = rate(start)?;
        let k2 = rate(moved(k1, 0.5 * h))?;
        let k3 = rate(moved(k2, 0.5 * h))?;
        let k4 = rate(moved(k3, h))?;
        let mean = |a: [f64; 2], b: [f64; 2], c: [f64; 2], d: [f64; 2]| {
            [0, 1].map(|i| (a[i] + 2.0 * (b[i] + c[i]) + d[i]) / 6.0)
        };
        let mean = State {
            q: mean(k1.q, k2.q, k3.q, k4.q),
            v: mean(k1.v, k2.v, k3.v, k4.v),
        };
        Ok(moved(mean, h))
    }
}

/// A joint that slides the wrong way.
fn turned(contacts: Contacts, state: State) -> Option<usize> {
    (0..2).find(|&joint| match contacts[joint] {
        Contact::Slides(direction) => direction.sign() * state.v[joint] < 0.0,
        _ => false,
    })
}
