//! How large dry friction is.

/// The sense of a slide.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Direction {
    /// w·v > 0.
    Positive,
    /// w·v < 0.
    Negative,
}

impl Direction {
    /// +1 or −1.
    pub fn sign(self) -> f64 {
        match self {
            Direction::Positive => 1.0,
            Direction::Negative => -1.0,
        }
    }
}

/// When and where a friction is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct At<'a> {
    /// s.
    pub time: f64,
    /// Positions.
    pub q: &'a [f64],
    /// Velocities.
    pub v: &'a [f64],
}

/// The size of a dry friction, at least 0, in the unit of λ: N along a unit vector of a length, N·m along one of an angle.
///
/// A closure `|direction, speed|` is one whose breakaway force is that of the slide at speed 0:
///
/// ```
/// use integrators::event::{At, Direction, Friction};
///
/// // Stribeck: 0.2 N at high speed, 0.3 N from rest.
/// let stribeck = |_: Direction, speed: f64| 0.2 + 0.1 * (-(speed / 0.05).powi(2)).exp();
/// let at = At { time: 0.0, q: &[0.0], v: &[0.0] };
/// assert_eq!(stribeck.breakaway(Direction::Positive, at), 0.1 + 0.2);
/// ```
pub trait Friction: Send + Sync {
    /// Against a slide in `direction` with `speed` = |w·v|: the force is −sign(direction) times it.
    ///
    /// Smooth in the speed and the state for each direction. At least 0 for speeds of at least 0. A trial step past the point of
    /// rest asks with a speed a little below 0: the formula goes on smoothly, there also to forces below 0.
    fn sliding(&self, direction: Direction, speed: f64, at: At<'_>) -> f64;

    /// What friction at rest holds against a motion in `direction`, not less than [`sliding`](Self::sliding) at speed 0, which is
    /// the default.
    fn breakaway(&self, direction: Direction, at: At<'_>) -> f64 {
        self.sliding(direction, 0.0, at)
    }
}

impl<F: Fn(Direction, f64) -> f64 + Send + Sync> Friction for F {
    fn sliding(&self, direction: Direction, speed: f64, _: At<'_>) -> f64 {
        self(direction, speed)
    }
}

/// Coulomb's law: the same force at every speed and in both directions, and one not smaller from rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coulomb {
    /// While it slides.
    pub sliding: f64,
    /// From rest.
    pub breakaway: f64,
}

impl Coulomb {
    /// `force`, also from rest.
    pub fn new(force: f64) -> Self {
        Coulomb {
            sliding: force,
            breakaway: force,
        }
    }
}

impl Friction for Coulomb {
    fn sliding(&self, _: Direction, _: f64, _: At<'_>) -> f64 {
        self.sliding
    }
    fn breakaway(&self, _: Direction, _: At<'_>) -> f64 {
        self.breakaway
    }
}
