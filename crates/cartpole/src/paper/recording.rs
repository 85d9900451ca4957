//! What the paper's rig leaves: the log, and the truth behind it.

use crate::rig;
use crate::rig::truth::State;

/// A recording with its truth. Row k is the instant t_k.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// What is measured and commanded: t, q.slider, q.pole, v.slider, v.pole, u.motor.
    pub log: rig::Recording,
    /// What was.
    pub truth: Truth,
    /// How many moves the hand has made.
    pub moves: usize,
}

/// The truth behind a log. Nobody at the rig knows it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Truth {
    /// The true states at t_k; the angle is not wrapped.
    pub states: Vec<State>,
    /// Where the motor is, m, and its speed, m/s, at t_k: the cart's without a string.
    pub motor: Vec<(f64, f64)>,
    /// The effective force on the cart at t_k, N, with the input that arrives just after t_k: Q₁ in M v̇ + C v + G = Q, the pull of the
    /// string (or the input itself) and all friction. It is what the paper's network is to learn.
    pub force: Vec<f64>,
    /// The mean of Q₁ over [t_k, t_{k+1}], N, blows on the ends of the rail included. Neither T nor V depends on x, so
    /// Q₁ = dp/dt with the momentum p = ∂T/∂ẋ = (M v)₁, and the mean is [p(t_{k+1}) − p(t_k)]/h exactly.
    pub mean_force: Vec<f64>,
}
