//! A learnt force: what a network sees of a state, and what it adds to Q.
//!
//! Q_j = s_j y_j(z), z_k = (x_k − o_k)/w_k, on the right-hand side of M v̇ + C v + G = Q. x_k are positions, their cosines and sines, velocities and
//! the generalized forces of the inputs, also those of some samples ago. In the paper (Roehrl et al. 2020) the cart-pole's network sees
//! cos φ, sin φ, ẋ, φ̇ and u and gives the force on the cart.

use std::fmt;

use lagrange::LANES;

use super::feature::{chain, see};
use super::{Feature, Region, Seen, Sight};
use crate::hybrid::Lane;
use crate::network::{Mlp, Single, Tape};

/// One output of a network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// The coordinate that it acts on, a single number and no pose.
    pub coordinate: usize,
    /// s in Q = s y, N or N·m.
    pub scale: f64,
}

/// A network as a force.
#[derive(Clone, PartialEq)]
pub struct LearntForce {
    network: Mlp<f64>,
    pub(super) features: Vec<Feature>,
    outputs: Vec<Output>,
    /// Whether the inputs act on the network's joints through the network alone.
    alone: bool,
    /// What it was trained on.
    pub(super) region: Option<Region>,
}

/// A network does not fit what it sees or acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a network with {inputs} inputs and {outputs} outputs is given {features} features and {joints} joints"
)]
pub struct Misfit {
    inputs: usize,
    outputs: usize,
    features: usize,
    joints: usize,
}

impl fmt::Debug for LearntForce {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LearntForce")
            .field("shape", self.network.shape())
            .field("features", &self.features)
            .field("outputs", &self.outputs)
            .field("alone", &self.alone)
            .finish_non_exhaustive()
    }
}

impl LearntForce {
    /// A network with one input a feature and one output a joint. With `alone`, inputs of these joints do not act themselves: the network stands for
    /// all of Q, as in the paper.
    ///
    /// # Errors
    /// [`Misfit`] when the numbers of inputs and outputs are others.
    pub fn new(
        network: Mlp<f64>,
        features: Vec<Feature>,
        outputs: Vec<Output>,
        alone: bool,
    ) -> Result<Self, Misfit> {
        let shape = network.shape();
        if (shape.inputs(), shape.outputs()) != (features.len(), outputs.len()) {
            return Err(Misfit {
                inputs: shape.inputs(),
                outputs: shape.outputs(),
                features: features.len(),
                joints: outputs.len(),
            });
        }
        Ok(LearntForce {
            network,
            features,
            outputs,
            alone,
            region: None,
        })
    }

    /// The network.
    pub fn network(&self) -> &Mlp<f64> {
        &self.network
    }

    /// What it sees, one an input.
    pub fn features(&self) -> &[Feature] {
        &self.features
    }

    /// What it acts on, one an output.
    pub fn outputs(&self) -> &[Output] {
        &self.outputs
    }

    /// Whether the inputs act on its joints through it alone; effects of the model come beside it.
    pub fn is_alone(&self) -> bool {
        self.alone
    }

    /// The forces where the quantities of [`features`](Self::features) have these values, by plain loops: for tests and single questions. A missing
    /// value counts as the feature's offset.
    pub fn at(&self, x: &[f64]) -> Vec<f64> {
        let features = self.features.iter().enumerate();
        let z: Vec<f64> = features
            .map(|(k, f)| x.get(k).map_or(0.0, |x| (x - f.offset) / f.width))
            .collect();
        let y = self.network.evaluate(&z);
        let outputs = self.outputs.iter().zip(y);
        outputs.map(|(output, y)| output.scale * y).collect()
    }

    /// The same force times a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        for output in &mut scaled.outputs {
            output.scale *= factor;
        }
        scaled
    }

    /// The same force with other parameters of the network, as many as it has.
    #[must_use]
    pub(crate) fn with_parameters(&self, parameters: &[f64]) -> Self {
        let mut other = self.clone();
        other.network.parameters_mut().copy_from_slice(parameters);
        other
    }

    /// Memory for one thread.
    pub(crate) fn room(&self) -> Room {
        let zeros = |n: usize| vec![[0.0; LANES]; n];
        Room {
            own: None,
            single: Single::default(),
            tape: Tape::new(self.network.shape(), LANES, 1),
            point: Vec::new(),
            z: zeros(self.features.len()),
            by_z: zeros(self.features.len()),
        }
    }

    /// From here on these are the parameters of the network in `room`, and derivatives are taken in them, too.
    pub(crate) fn load(&self, parameters: &[f64], room: &mut Room) {
        let own = room.own.get_or_insert_with(|| self.network.clone());
        own.parameters_mut().copy_from_slice(parameters);
    }

    /// Q of the network in one state, entry after entry to `add` with its place in v.
    pub(crate) fn force(
        &self,
        x: &[Lane],
        at: &Seen<'_>,
        room: &mut Room,
        mut add: impl FnMut(usize, f64),
    ) {
        see(&self.features, x, at, &mut room.z);
        room.point.clear();
        room.point.extend(room.z.iter().map(|z| z[0]));
        let network = room.own.as_ref().unwrap_or(&self.network);
        let y = room.single.evaluate(network, &room.point);
        for (output, y) in self.outputs.iter().zip(y) {
            add(at.starts[output.coordinate].v, output.scale * y);
        }
    }

    /// The derivatives of [`force`](Self::force), which has to have been called at the same state.
    pub(crate) fn derivatives(
        &self,
        x: &[Lane],
        at: &Seen<'_>,
        room: &mut Room,
        mut add: impl FnMut(usize, In, f64),
    ) {
        for (o, output) in self.outputs.iter().enumerate() {
            let v = at.starts[output.coordinate].v;
            let gradient = match &room.own {
                Some(own) => room.single.gradients(own, o, |k, gradient| {
                    add(v, In::Parameter(k), output.scale * gradient);
                }),
                None => room.single.gradient(&self.network, o),
            };
            for (by_z, gradient) in room.by_z.iter_mut().zip(gradient) {
                *by_z = [0.0; LANES];
                by_z[0] = output.scale * gradient;
            }
            chain(&self.features, x, at, &room.by_z, |by, part| {
                add(v, In::Sight(by), part[0])
            });
        }
    }

    /// Q of the network in eight states.
    pub(crate) fn force_of_eight(
        &self,
        x: &[Lane],
        at: &Seen<'_>,
        room: &mut Room,
        mut add: impl FnMut(usize, &Lane),
    ) {
        see(&self.features, x, at, &mut room.z);
        for (k, z) in room.z.iter().enumerate() {
            *room.tape.input_mut(0, k, 0) = *z;
        }
        let network = room.own.as_ref().unwrap_or(&self.network);
        network.forward(&mut room.tape, 0);
        for (o, output) in self.outputs.iter().enumerate() {
            let force = room.tape.output(0, o, 0).map(|y| output.scale * y);
            add(at.starts[output.coordinate].v, &force);
        }
    }

    /// The derivatives of [`force_of_eight`](Self::force_of_eight), which has to have been called at the same states.
    pub(crate) fn derivatives_of_eight(
        &self,
        x: &[Lane],
        at: &Seen<'_>,
        room: &mut Room,
        mut add: impl FnMut(usize, In, &Lane),
    ) {
        let network = room.own.as_ref().unwrap_or(&self.network);
        for (o, output) in self.outputs.iter().enumerate() {
            for other in 0..self.outputs.len() {
                let seed = if other == o { output.scale } else { 0.0 };
                *room.tape.seed_mut(0, other, 0) = [seed; LANES];
            }
            network.backward(&mut room.tape, 0);
            for (k, by_z) in room.by_z.iter_mut().enumerate() {
                *by_z = *room.tape.input_gradient(0, k, 0);
            }
            let v = at.starts[output.coordinate].v;
            chain(&self.features, x, at, &room.by_z, |by, part| {
                add(v, In::Sight(by), &part)
            });
            if room.own.is_some() {
                network.each_gradient(&room.tape, 0, 0, |k, part| add(v, In::Parameter(k), part));
            }
        }
    }
}

/// What a learnt force is derived in.
#[derive(Debug, Clone, Copy)]
pub(crate) enum In {
    /// What it sees.
    Sight(Sight),
    /// A parameter of the network.
    Parameter(usize),
}

/// Memory of one thread for a learnt force.
pub(crate) struct Room {
    /// The network with parameters that are not its own.
    own: Option<Mlp<f64>>,
    single: Single,
    tape: Tape<f64>,
    point: Vec<f64>,
    z: Vec<Lane>,
    by_z: Vec<Lane>,
}
