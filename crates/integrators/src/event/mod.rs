//! Contacts whose forces are sets: dry friction that sticks, stops, backlash, impacts.
//!
//! M(q) v̇ = f(t, q, v, u) + Σ wᵢ λᵢ with f = Q − C v − G of a [`ContactSystem`], and for each [`Law`] a relation between w·v (or the gap
//! g with ġ = w·v) and λ that is no function:
//!
//! | law | λ |
//! |---|---|
//! | [friction](Law::friction), w·v > 0 | −F₊(w·v) |
//! | friction, w·v < 0 | F₋(\|w·v\|) |
//! | friction, w·v = 0 | anything in [−F₊ₛ, F₋ₛ], the breakaway forces |
//! | [stop](Law::stop), g > 0 | 0 |
//! | stop, g = 0 | at least 0; an impact turns ġ⁻ < 0 into −e ġ⁻ |
//!
//! While no contact changes, the motion is smooth and [`EventStepper`] takes steps of the classical Runge-Kutta method. It ends a
//! step at the instant, found to rounding, where a slide comes to rest, a stop is struck, a friction is asked for more than its
//! breakaway force or a stop would have to pull. The contacts are then found anew from complementarity problems: of the impulses, if
//! something strikes, and of the accelerations. What sticks has w·v = 0 and does not creep. [`roll_out_events`] does it over a
//! table of samples.
//!
//! Friction levels may depend on time and state, not on the forces of other laws; that would lead to Painlevé's paradoxes, which
//! these laws do not have: M positive definite gives one v̇. Where laws depend on each other (two that say the same) v̇ is still one,
//! and of the forces one set is taken: laws earlier in the list carry what they can. Friction that depends on others at rest
//! (a friction and a stop along one direction, closed loops of frictions) can then change so often within a step that it is
//! [held](EventKind::Held) at rest until the step ends. **While it is held it may carry more than its breakaway force**: a motion whose
//! [`events`](EventRollOut) have `Held` in them is not to be trusted after the first of them. Laws on coordinates of their own, as joints
//! have them, do not depend on each other.
//!
//! Steps are not adapted. Where one is too long for a stiff spring or damper, friction can hide what would be seen without it: the roll-out
//! stays finite and is wrong. Half the step has to give the same motion.
//!
//! Fits differentiate a smoothed law such as F tanh(w·v/ε) in place of the set. It creeps where this one sticks, and its error goes
//! with ε to 0 (linearly in the places where slides end; tests/events.rs shows it); a roll-out here is what to check one against.

mod complementarity;
mod error;
mod factor;
mod friction;
mod impact;
mod law;
mod mode;
mod motion;
mod occurrence;
mod rest;
mod roll_out;
mod root;
mod stepper;
mod system;

pub use error::ContactError;
pub use friction::{At, Coulomb, Direction, Friction};
pub use law::{Law, LawFault, Strike};
pub use occurrence::{Event, EventKind};
pub use roll_out::{EventRollOut, EventRollOutError, roll_out_events};
pub use stepper::{EventStepper, Limits};
pub use system::{ContactSystem, Masses};

/// Gaps and velocities that are sums of several terms count as 0 below this part of the sizes of the terms.
const ROUNDING: f64 = 1e-13;

/// At the end of its box, a law whose acceleration is less than this part of the sizes of its terms stays at rest.
const BORDER: f64 = 1e-13;

/// A law at rest lets go where its force is past its box by this part of the sizes of its terms.
const RELEASE: f64 = 1e-12;
