use super::{Direction, LawFault};

/// Why there is no motion under contacts. `E` is the error of the [`ContactSystem`](super::ContactSystem).
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ContactError<E> {
    /// A law does not fit the mechanism, or is none.
    #[error("law {law}: {fault}")]
    Law {
        /// Its number in the list.
        law: usize,
        /// What is wrong.
        fault: LawFault,
    },
    /// A state of the wrong length.
    #[error("the state has {found} entries where the mechanism has {expected}")]
    State {
        /// Its length.
        found: usize,
        /// nq + nv.
        expected: usize,
    },
    /// A start that is no point of the mechanism's space.
    #[error(
        "the positions at t = {time} s are {distance:e} away from the space of positions: give quaternions of length 1"
    )]
    OffSpace {
        /// s.
        time: f64,
        /// See [`Space::distance`](crate::Space::distance).
        distance: f64,
    },
    /// A length of time or a number of steps that cannot be stepped.
    #[error(
        "{duration} s in {steps} steps: give a finite time of at least 0 s and at least 1 step"
    )]
    Duration {
        /// s.
        duration: f64,
        /// Its steps.
        steps: usize,
    },
    /// M or f has no value.
    #[error("the equations of motion failed at t = {time} s")]
    System {
        /// s.
        time: f64,
        /// Why.
        #[source]
        source: E,
    },
    /// M is not positive definite.
    #[error(
        "the mass matrix is not positive definite at t = {time} s: pivot {coordinate} is {value}; give each coordinate inertia"
    )]
    Mass {
        /// s.
        time: f64,
        /// The first coordinate without inertia of its own.
        coordinate: usize,
        /// Its pivot in Cholesky's factorisation.
        value: f64,
    },
    /// A friction is NaN, infinite or below 0.
    #[error(
        "law {law} has the friction force {value} against {direction:?} slides at t = {time} s: it must be finite and at least 0"
    )]
    Friction {
        /// Its number in the list.
        law: usize,
        /// Of the slide.
        direction: Direction,
        /// s.
        time: f64,
        /// The force.
        value: f64,
    },
    /// A friction that holds less than it brakes: at rest it could neither stick nor slide.
    #[error(
        "law {law} holds {breakaway} at rest and {sliding} at the start of a slide, at t = {time} s: raise the breakaway force or lower the sliding one"
    )]
    Breakaway {
        /// Its number in the list.
        law: usize,
        /// s.
        time: f64,
        /// The breakaway force.
        breakaway: f64,
        /// The sliding force at speed 0.
        sliding: f64,
    },
    /// A stop whose restitution is none.
    #[error(
        "law {law} has the restitution {value} at t = {time} s: it must be at least 0 and at most 1"
    )]
    Restitution {
        /// Its number in the list.
        law: usize,
        /// s.
        time: f64,
        /// e.
        value: f64,
    },
    /// What holds a contact at rest is no number.
    #[error(
        "the force of law {law} at rest is {value} at t = {time} s: look for a force of the mechanism that is not finite"
    )]
    Reaction {
        /// Its number in the list.
        law: usize,
        /// s.
        time: f64,
        /// NaN or an infinity.
        value: f64,
    },
    /// A motion that starts behind a stop.
    #[error(
        "the gap of law {law} is {gap} at t = {time} s: start in front of the stop, or move it"
    )]
    Penetration {
        /// Its number in the list.
        law: usize,
        /// s.
        time: f64,
        /// g < 0.
        gap: f64,
    },
    /// The state left the numbers.
    #[error(
        "x[{component}] is {value} at t = {time} s: the motion diverged; take more steps, or look for a force that grows without bound"
    )]
    NotFinite {
        /// End of the step, s.
        time: f64,
        /// The first entry that is not finite.
        component: usize,
        /// NaN or an infinity.
        value: f64,
    },
    /// Contacts that change without end.
    #[error(
        "{events} events in the step that reaches t = {time} s, the last of law {law}: take smaller steps, or look for laws that contradict each other"
    )]
    TooManyEvents {
        /// Where it gave up, s.
        time: f64,
        /// Their number.
        events: usize,
        /// Whose event was the last.
        law: usize,
    },
    /// The forces or impulses of the contacts have no solution.
    #[error(
        "the contacts have no {what} at t = {time} s: look for laws that contradict each other, or a mass matrix near to singular"
    )]
    Complementarity {
        /// "forces" or "impulses".
        what: &'static str,
        /// s.
        time: f64,
    },
}
