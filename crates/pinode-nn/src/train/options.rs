//! What is learnt, and how.

use crate::Error;
use crate::learnt::Quantity;
use crate::model::Model;
use crate::network::Activation;

/// A larger layer is refused, and a larger network.
const MOST_UNITS: usize = 4096;
const MOST_PARAMETERS: usize = 10_000_000;

/// How a network is trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The coordinates that it acts on.
    pub joints: Vec<usize>,
    /// What it sees; empty: cosine and sine of every angle that wraps, every other angle, displacements that an energy, a known spring, stop or periodic force depends on (a black box all), all
    /// velocities and all inputs.
    pub quantities: Vec<Quantity>,
    /// Units of the hidden layers.
    pub units: Vec<usize>,
    /// Their activation.
    pub hidden: Activation,
    /// Whether the inputs act on its joints through it alone, as in the paper. Effects of the model stay beside it: where there are none, it is all of Q.
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
    /// Adam ends when so many epochs have brought nothing on the windows held out.
    pub patience: usize,
    /// At most so many rounds of twenty steps of L-BFGS on all windows follow Adam's epochs; they end when one brings nothing on the windows held out.
    pub polish: usize,
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
            polish: 0,
            single: true,
            seed: 0,
        }
    }

    /// Whether nothing but the network acts on any joint.
    pub(super) fn is_black_box(&self, model: &Model) -> bool {
        self.alone && self.joints.len() == model.mechanics.coordinates().len()
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

/// Whether a network with layers of these sizes can be trained.
pub(super) fn check_size(sizes: &[usize]) -> Result<(), Error> {
    let hidden = &sizes[1..sizes.len() - 1];
    if let Some(units) = hidden.iter().find(|units| **units > MOST_UNITS) {
        return Err(Error::Training(format!(
            "a hidden layer of {units} units is too large: {MOST_UNITS} at most, give fewer by --units"
        )));
    }
    // At most MOST_UNITS² a layer, and no list of layers is so long that this overflows.
    let parameters: usize = sizes.windows(2).map(|pair| (pair[0] + 1) * pair[1]).sum();
    if parameters > MOST_PARAMETERS {
        return Err(Error::Training(format!(
            "a network of {parameters} parameters is too large: {MOST_PARAMETERS} at most, give fewer or smaller layers by --units"
        )));
    }
    Ok(())
}

/// What is not all right with the options.
pub(super) fn check(model: &Model, options: &Options) -> Result<(), Error> {
    let coordinates = model.mechanics.coordinates();
    let fault = |what: String| Err(Error::Training(what));
    if options.joints.is_empty() {
        return fault(
            "no joint is given for the network to act on: name one by --joint".to_owned(),
        );
    }
    for (k, &joint) in options.joints.iter().enumerate() {
        let Some(coordinate) = coordinates.get(joint) else {
            return fault(format!(
                "there is no coordinate {joint}: the model has {}",
                coordinates.len()
            ));
        };
        let name = &coordinate.name;
        if options.joints[..k].contains(&joint) {
            return fault(format!("the joint `{name}` is given twice"));
        }
        let taken = model.networks.iter().flat_map(|n| n.force.outputs());
        if taken.clone().any(|output| output.coordinate == joint) {
            return fault(format!(
                "the model has a network on `{name}` already: take its [[effect]] out first"
            ));
        }
    }
    let known = |quantity: &Quantity| match *quantity {
        Quantity::Position(c) | Quantity::Cosine(c) | Quantity::Sine(c) | Quantity::Velocity(c) => {
            c < coordinates.len()
        }
        Quantity::Input { input, .. } => input < model.inputs.len(),
    };
    if !options.quantities.iter().all(known) {
        return fault(
            "the network is to see a coordinate or an input that the model does not have"
                .to_owned(),
        );
    }
    for (k, quantity) in options.quantities.iter().enumerate() {
        if options.quantities[..k].contains(quantity) {
            let inputs: Vec<&str> = model.inputs.iter().map(|i| i.name.as_str()).collect();
            let name = quantity.name(coordinates, &inputs);
            return fault(format!("the network is to see {name} twice"));
        }
        if let Quantity::Position(c) = *quantity
            && let Some(coordinate) = coordinates.get(c).filter(|c| c.wraps)
        {
            let name = &coordinate.name;
            return fault(format!(
                "the network is to see q.{name}, an angle that wraps: the same angle has many readings, and they jump; let it see \
                 cos(q.{name}) and sin(q.{name})"
            ));
        }
    }
    check_numbers(options)
}

/// What is not all right with the numbers among them.
pub(super) fn check_numbers(options: &Options) -> Result<(), Error> {
    let fault = |what: String| Err(Error::Training(what));
    for (name, value) in [("batch", options.batch), ("epochs", options.epochs)] {
        if value == 0 {
            return fault(format!("`{name}` is 0: it must be at least 1"));
        }
    }
    for (name, value) in [
        ("the learning rate", options.rate),
        ("the longest step", options.longest_step),
        (
            "the length of a window",
            match options.start {
                // One interval, however short.
                Start::Measured { .. } => options.horizon + f64::MIN_POSITIVE,
                Start::Fitted => options.horizon,
            },
        ),
    ] {
        if !(value > 0.0 && value.is_finite()) {
            return fault(format!("{name} is {value}: it must be positive"));
        }
    }
    Ok(())
}
