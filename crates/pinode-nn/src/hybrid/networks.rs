//! What the networks of a model add to Q, and their derivatives.

use std::sync::Arc;

use lagrange::LANES;

use super::forces::{By, Of};
use super::{Constant, ConstantId, DrivenInputs, Eight, Hybrid, Lane, State};
use crate::learnt::{In, LearntForce, Room, Seen, Sight};
use crate::processor::Processor;

/// Memory of one thread for all networks of a model.
pub(super) struct NetworkMemory {
    rooms: Vec<Room>,
    /// A single state as eight.
    x: Vec<Lane>,
}

impl Hybrid {
    /// Adds a learnt force.
    pub fn add_network(&mut self, force: Arc<LearntForce>) {
        if force.is_alone() {
            let joints: Vec<usize> = force.outputs().iter().map(|o| o.coordinate).collect();
            self.leave_to_network(&joints);
        }
        self.networks.push(force);
        self.open.push(None);
    }

    /// Adds a learnt force whose parameters are entries of θ, around what they are with this standard deviation.
    pub fn add_open_network(&mut self, force: Arc<LearntForce>, tolerance: f64) {
        let index = self.networks.len();
        let parameters = force.network().parameters().iter().enumerate();
        let first = self.constants.len();
        self.constants
            .extend(parameters.map(|(k, &value)| Constant {
                id: ConstantId::Network(index, k),
                value,
                lower: f64::NEG_INFINITY,
                upper: f64::INFINITY,
                tolerance,
                is_said: true,
            }));
        self.add_network(force);
        self.open[index] = Some(first..self.constants.len());
    }

    /// The learnt forces with the parameters that open ones have at θ.
    pub fn networks_at(&self, theta: &[f64]) -> Vec<Arc<LearntForce>> {
        let own = self.networks.iter().zip(&self.open);
        own.map(|(network, open)| match open {
            Some(range) => Arc::new(network.with_parameters(&theta[range.clone()])),
            None => network.clone(),
        })
        .collect()
    }

    /// Inputs do not act on these coordinates by themselves any more, but through a network alone; effects of the model do.
    pub(crate) fn leave_to_network(&mut self, coordinates: &[usize]) {
        for (carried, own) in self.carried.iter_mut().zip(&self.input_coordinates) {
            *carried |= coordinates.contains(own);
        }
        for start in coordinates.iter().filter_map(|&c| self.starts.get(c)) {
            self.left[start.v] = true;
        }
    }

    /// What was learnt of Q.
    pub fn networks(&self) -> &[Arc<LearntForce>] {
        &self.networks
    }

    /// The parameters of open networks, from θ.
    fn load_networks(&self, theta: &[f64], memory: &mut NetworkMemory) {
        for ((network, own), room) in self.networks.iter().zip(&self.open).zip(&mut memory.rooms) {
            if let Some(range) = own {
                network.load(&theta[range.clone()], room);
            }
        }
    }

    /// What a network is derived in, as an entry of what the model is.
    fn in_what(&self, network: usize, what: In) -> By {
        match what {
            In::Sight(sight) => sight.into(),
            In::Parameter(k) => {
                let first = self.open.get(network).and_then(Option::as_ref);
                By::Constant(first.map_or(usize::MAX, |range| range.start + k))
            }
        }
    }

    pub(super) fn network_memory(&self) -> NetworkMemory {
        let x = match self.networks.is_empty() {
            true => 0,
            false => self.nx(),
        };
        NetworkMemory {
            rooms: self.networks.iter().map(|network| network.room()).collect(),
            x: vec![[0.0; LANES]; x],
        }
    }

    /// Where eight states stand, for networks.
    pub(crate) fn seen_of_eight<'a>(&'a self, eight: &Eight<'a>) -> Seen<'a> {
        Seen {
            eight: *eight,
            starts: &self.starts,
            nq: self.nq(),
            processor: Processor::here(),
        }
    }

    /// `eight` is a single state, once in each lane.
    fn seen_of_one<'a>(&'a self, inputs: &'a DrivenInputs, step: usize) -> Seen<'a> {
        self.seen_of_eight(&Eight {
            inputs: [inputs; LANES],
            steps: [step; LANES],
        })
    }

    /// Adds the networks' forces to Q.
    pub(super) fn add_networks(
        &self,
        state: State<'_>,
        theta: &[f64],
        (inputs, step): (&DrivenInputs, usize),
        memory: &mut NetworkMemory,
        q: &mut [f64],
    ) {
        if self.networks.is_empty() {
            return;
        }
        self.load_networks(theta, memory);
        let numbers = state.q.iter().chain(state.v);
        for (to, &from) in memory.x.iter_mut().zip(numbers) {
            *to = [from; LANES];
        }
        let at = self.seen_of_one(inputs, step);
        for (network, room) in self.networks.iter().zip(&mut memory.rooms) {
            network.force(&memory.x, &at, room, |v, force| q[v] += force);
        }
    }

    /// Every derivative of the networks' forces to `add`, where [`add_networks`](Self::add_networks) was called last.
    pub(super) fn network_parts(
        &self,
        inputs: &DrivenInputs,
        step: usize,
        memory: &mut NetworkMemory,
        mut add: impl FnMut(Of, By, f64),
    ) {
        if self.networks.is_empty() {
            return;
        }
        let at = self.seen_of_one(inputs, step);
        for (index, (network, room)) in self.networks.iter().zip(&mut memory.rooms).enumerate() {
            network.derivatives(&memory.x, &at, room, |v, by, part| {
                add(Of::Force(v), self.in_what(index, by), part);
            });
        }
    }

    /// Adds the networks' forces in eight states to Q.
    pub(super) fn add_networks_of_eight(
        &self,
        x: &[Lane],
        theta: &[f64],
        at: &Eight<'_>,
        memory: &mut NetworkMemory,
        q: &mut [Lane],
    ) {
        self.load_networks(theta, memory);
        let at = self.seen_of_eight(at);
        for (network, room) in self.networks.iter().zip(&mut memory.rooms) {
            network.force_of_eight(x, &at, room, |v, force| {
                for (to, from) in q[v].iter_mut().zip(force) {
                    *to += from;
                }
            });
        }
    }

    /// The networks' forces in eight states and their derivatives, each to `add` with the entry of v that it acts on.
    pub(super) fn network_parts_of_eight(
        &self,
        x: &[Lane],
        theta: &[f64],
        at: &Eight<'_>,
        memory: &mut NetworkMemory,
        mut add: impl FnMut(usize, By, &Lane),
    ) {
        self.load_networks(theta, memory);
        let at = self.seen_of_eight(at);
        for (index, (network, room)) in self.networks.iter().zip(&mut memory.rooms).enumerate() {
            network.force_of_eight(x, &at, room, |v, force| add(v, By::Value, force));
            network.derivatives_of_eight(x, &at, room, |v, by, part| {
                add(v, self.in_what(index, by), part)
            });
        }
    }
}

impl From<Sight> for By {
    fn from(sight: Sight) -> By {
        match sight {
            Sight::Position(i) => By::Position(i),
            Sight::Velocity(i) => By::Velocity(i),
            Sight::Constant(k) => By::Constant(k),
        }
    }
}
