//! What is learnt, and how.

use crate::learnt::Quantity;
use crate::network::Activation;

/// How a network is trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The coordinates that it acts on.
    pub joints: Vec<usize>,
    /// What it sees; empty: cosine and sine of every angle that wraps, every other angle, all velocities and all inputs.
    pub quantities: Vec<Quantity>,
    /// Units of the hidden layers.
    pub units: Vec<usize>,
    /// Their activation.
    pub hidden: Activation,
    /// Whether it stands for all of Q on its joints, the inputs' forces included, as in the paper.
    pub alone: bool,
    /// Length of a window, s; at least one sample interval.
    pub horizon: f64,
    /// Where windows start from, and what their errors are measured by.
    pub start: Start,
    /// Whether constants with a tolerance and the parameters of effects are fitted first.
    pub physics: bool,
    /// Longest integration step, s.
    pub longest_step: f64,
    /// At most so often all windows are seen.
    pub epochs: usize,
    /// Windows a step.
    pub batch: usize,
    /// Adam's step at the beginning.
    pub rate: f64,
    /// Whether it falls along a cosine to a hundredth of that; else it stays.
    pub decays: bool,
    /// Training ends when so many epochs have brought nothing on the windows held out.
    pub patience: usize,
    /// Whether the network is computed in 32 bits.
    pub single: bool,
    /// Of the first weights and of the order of the windows.
    pub seed: u64,
}

/// Where windows start from, and what their errors are measured by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// From the measured state; errors λ₁ (q − q′)² + λ₂ (q̇ − q̇′)² at the samples after it, SI units: the paper's loss.
    Measured {
        /// λ₁ and λ₂.
        weights: [f64; 2],
    },
    /// From states that are fitted to each window; errors in units of each sensor's noise, of positions, and of those velocities that are measured and
    /// no differences of positions.
    Fitted,
}

impl Options {
    /// Windows of 0.4 s from fitted states, 50-50-50 units.
    pub fn new(joints: Vec<usize>) -> Self {
        Options {
            joints,
            quantities: Vec::new(),
            units: vec![50; 3],
            hidden: Activation::Relu,
            alone: false,
            horizon: 0.4,
            start: Start::Fitted,
            physics: true,
            longest_step: 0.02,
            epochs: 300,
            batch: 32,
            rate: 2e-3,
            decays: true,
            patience: 60,
            single: true,
            seed: 0,
        }
    }

    /// The paper's: one step from the measured state, λ₁ = λ₂ = 1, the network alone on its joints, Adam with 10⁻³ (Roehrl et al. 2020).
    pub fn paper(joints: Vec<usize>) -> Self {
        Options {
            alone: true,
            horizon: 0.0,
            start: Start::Measured {
                weights: [1.0, 1.0],
            },
            physics: false,
            epochs: 100,
            batch: 128,
            patience: 20,
            rate: 1e-3,
            decays: false,
            ..Options::new(joints)
        }
    }
}
