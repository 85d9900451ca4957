//! v̇ and ḣ of eight states at once, with their derivatives.

use lagrange::mechanism::LinkForceMemory;
use lagrange::{Error, ForwardDynamicsDerivatives, LANES, Workspace};
use pulp::NullaryFnOnce;

use super::extra::ExtraMemory;
use super::forces::{By, Of};
use super::networks::NetworkMemory;
use super::{DrivenInputs, Hybrid, Placed};
use crate::effect::{At, Column, Room, Seen};
use crate::entries::Start;
use crate::processor::Processor;

/// One number of each of eight states.
pub(crate) type Lane = [f64; LANES];

/// Where eight states stand: the inputs of the recording of each, and its integration step.
#[derive(Clone, Copy)]
pub(crate) struct Eight<'a> {
    /// One a state.
    pub inputs: [&'a DrivenInputs; LANES],
    /// One a state.
    pub steps: [usize; LANES],
}

impl Eight<'_> {
    /// The force of an input.
    pub(super) fn signal(&self, input: usize) -> Lane {
        std::array::from_fn(|lane| self.inputs[lane].forces[input].value[self.steps[lane]])
    }

    /// Its derivative in the `k`th constant that it depends on.
    pub(super) fn derivative(&self, input: usize, k: usize) -> Lane {
        std::array::from_fn(|lane| {
            let of_lane = &self.inputs[lane].forces[input].by_parameter;
            of_lane.get(k).map_or(0.0, |(_, d)| d[self.steps[lane]])
        })
    }
}

/// Memory of one thread for one set of free constants.
pub(crate) struct EightMemory {
    work: Workspace,
    /// The free constants of the mechanics.
    selected: Vec<usize>,
    /// Forces of the inputs that act on the coordinates themselves.
    driven: Vec<Lane>,
    /// A force that the caller adds to Q, nv entries; its own derivatives are the caller's.
    pub added: Vec<Lane>,
    networks: NetworkMemory,
    links: LinkForceMemory,
    laws: Room,
    /// For every entry of θ its column among (q, v, h, θ_free).
    columns: Vec<Option<usize>>,
    /// Q.
    force: Vec<Lane>,
    /// ∂Q/∂(q, v, h, θ_free) of inputs and effects, column after column.
    forces: Vec<Lane>,
    by: ForwardDynamicsDerivatives<Lane>,
    /// What the effects that change the mechanics need.
    extra: Option<ExtraMemory<Lane>>,
    processor: Processor,
    /// (v̇, ḣ) of the last call.
    pub rates: Vec<Lane>,
    /// ∂Q_j/∂v_j of the forces on the joints without a memory, of the last call, if that linearised or was asked for them.
    pub slopes: Vec<Lane>,
    /// ∂(v̇, ḣ)/∂(q, v, h, θ_free) of the last call, column after column.
    pub linear: Vec<Lane>,
}

impl EightMemory {
    /// ∂v̇/∂Q of the last call that linearised, column after column.
    pub fn response(&self) -> &[Lane] {
        self.by.by_force.as_slice()
    }
}

impl Hybrid {
    /// Memory for [`linearize_eight`](Self::linearize_eight) for one thread.
    pub(crate) fn memory_of_eight(&self, free: &[usize]) -> EightMemory {
        let (n, nh) = (self.nv(), self.nh());
        let selected = self.free_of_mechanics(free);
        let count = 2 * n + nh + free.len();
        let place = |index| free.binary_search(&index).ok().map(|k| 2 * n + nh + k);
        let zeros = |n: usize| vec![[0.0; LANES]; n];
        EightMemory {
            work: self.mechanics.workspace(),
            driven: zeros(n),
            added: zeros(n),
            networks: self.network_memory(),
            links: LinkForceMemory::default(),
            laws: Room::default(),
            columns: (0..self.constants.len()).map(place).collect(),
            force: zeros(n),
            forces: zeros(n * count),
            by: ForwardDynamicsDerivatives::lanes(n, selected.len()),
            extra: self.extra.as_ref().map(|e| e.memory(n, selected.len())),
            processor: Processor::here(),
            rates: zeros(n + nh),
            slopes: zeros(n),
            linear: zeros((n + nh) * count),
            selected,
        }
    }

    /// As [`linearize`](Self::linearize), of eight states; left in `memory.rates` and `memory.linear`. An error is that of any of the
    /// eight.
    pub(crate) fn linearize_eight(
        &self,
        x: &[Lane],
        theta: &[f64],
        at: &Eight<'_>,
        memory: &mut EightMemory,
    ) -> Result<(), Error> {
        let (n, nq) = (self.nv(), self.nq());
        let below = n + self.nh();
        let EightMemory {
            work,
            selected,
            driven,
            added,
            networks,
            links,
            laws,
            columns,
            force,
            forces,
            by,
            extra,
            processor,
            rates,
            slopes,
            linear,
        } = memory;
        for lanes in [&mut *forces, &mut *rates, &mut *slopes, &mut *linear] {
            lanes.fill([0.0; LANES]);
        }
        self.drive_eight(at, driven, |index, v, lane, derivative| {
            if let Some(column) = columns[index] {
                forces[column * n + v][lane] += derivative;
            }
        });
        sums(force, driven, added);
        let mut enter = |v: usize, by, part: &Lane| {
            let column = match by {
                By::Value => return add(&mut force[v], part),
                By::Position(i) => Some(i),
                By::Velocity(i) => Some(n + i),
                By::State(k) => Some(2 * n + k),
                By::Constant(index) => columns[index],
            };
            if let Some(column) = column {
                add(&mut forces[column * n + v], part);
            }
        };
        self.network_parts_of_eight(x, theta, at, networks, &mut enter);
        self.link_parts_of_eight(&x[..nq], at, links, enter);
        for (index, effect) in self.effects.iter().enumerate() {
            let Some(law) = &self.laws[index] else {
                continue;
            };
            let (start, seen) = self.seen_by_eight(index, x, at, driven);
            let (p, smoothing) = (&theta[self.ranges[index].clone()], effect.smoothing);
            let forgets = effect.kind.memory().is_none();
            law.parts_of_eight(&At { seen, p, smoothing }, laws, |row, column, part| {
                let of = self.row(index, start, row);
                if forgets && column == Some(Column::Velocity) {
                    add(&mut slopes[start.v], part);
                }
                let mut enter = |column: usize, part: &Lane| match of {
                    Of::Force(i) => add(&mut forces[column * n + i], part),
                    Of::Rate(k) => add(&mut linear[column * below + n + k], part),
                };
                match self.by(index, start, column) {
                    Some(By::Value) => match of {
                        Of::Force(i) => add(&mut force[i], part),
                        Of::Rate(k) => add(&mut rates[n + k], part),
                    },
                    Some(By::Position(i)) => enter(i, part),
                    Some(By::Velocity(i)) => enter(n + i, part),
                    Some(By::State(k)) => enter(2 * n + k, part),
                    Some(By::Constant(index)) => {
                        if let Some(column) = columns[index] {
                            enter(column, part);
                        }
                    }
                    None => {
                        for (lane, (inputs, step)) in at.inputs.iter().zip(at.steps).enumerate() {
                            self.input_parts(index, inputs, step, |entry, derivative| {
                                let Some(column) = columns[entry] else {
                                    return;
                                };
                                let part = part[lane] * derivative;
                                match of {
                                    Of::Force(i) => forces[column * n + i][lane] += part,
                                    Of::Rate(k) => linear[column * below + n + k][lane] += part,
                                }
                            });
                        }
                    }
                }
            });
        }
        let (q, v) = (&x[..nq], &x[nq..nq + n]);
        let p = &theta[self.mechanics_range()];
        match (&self.extra, extra) {
            (Some(changes), Some(room)) => {
                let whole = (&*self.mechanics, p);
                changes.derivatives(whole, (q, v), theta, force, selected, work, room, by)?;
                // ∂v̇/∂p = −M⁻¹ ∂ID/∂p.
                let slots = room.by_slot.as_slice().chunks_exact(n);
                for (&index, by_slot) in changes.parameters.iter().zip(slots) {
                    if let Some(column) = columns[index] {
                        for (to, from) in forces[column * n..].iter_mut().zip(by_slot) {
                            to.iter_mut().zip(from).for_each(|(to, from)| *to -= from);
                        }
                    }
                }
            }
            _ => self
                .mechanics
                .forward_dynamics_derivatives_lanes_into(q, v, force, p, selected, work, by)?,
        }
        rates[..n].copy_from_slice(by.acceleration.as_slice());
        let by_force = by.by_force.as_slice();
        processor.run(Chained {
            sizes: (n, below),
            by_force,
            forces,
            linear,
        });
        // What the mechanics adds.
        let in_state = by.by_q.as_slice().chunks_exact(n);
        let in_state = in_state.chain(by.by_v.as_slice().chunks_exact(n));
        let in_constants = by.by_p.as_slice().chunks_exact(n);
        let places = selected.iter().filter_map(|&index| columns[index]);
        for (column, from) in in_state.enumerate().chain(places.zip(in_constants)) {
            for (to, from) in linear[column * below..].iter_mut().zip(from) {
                add(to, from);
            }
        }
        Ok(())
    }

    /// As [`acceleration`](Self::acceleration), of eight states; left in `memory.rates`, and in `memory.slopes` with `slopes`.
    pub(crate) fn accelerate_eight(
        &self,
        x: &[Lane],
        theta: &[f64],
        at: &Eight<'_>,
        memory: &mut EightMemory,
        slopes: bool,
    ) -> Result<(), Error> {
        let (n, nq) = (self.nv(), self.nq());
        let EightMemory {
            work,
            driven,
            added,
            networks,
            laws,
            extra,
            rates,
            slopes: found,
            ..
        } = memory;
        found.fill([0.0; LANES]);
        self.drive_eight(at, driven, |_, _, _, _| {});
        let (force, hidden) = rates.split_at_mut(n);
        sums(force, driven, added);
        self.add_networks_of_eight(x, theta, at, networks, force);
        self.add_link_forces_of_eight(&x[..nq], at, force);
        hidden.fill([0.0; LANES]);
        for (index, effect) in self.effects.iter().enumerate() {
            let Some(law) = &self.laws[index] else {
                continue;
            };
            let (start, seen) = self.seen_by_eight(index, x, at, driven);
            let (p, smoothing) = (&theta[self.ranges[index].clone()], effect.smoothing);
            let here = At { seen, p, smoothing };
            if slopes && effect.kind.memory().is_none() {
                let [value, slope] = law.slopes_of_eight(&here, laws);
                add(&mut force[start.v], &value);
                add(&mut found[start.v], &slope);
                continue;
            }
            law.values_of_eight(&here, laws, |row, value| {
                match self.row(index, start, row) {
                    Of::Force(i) => add(&mut force[i], value),
                    Of::Rate(k) => add(&mut hidden[k], value),
                }
            });
        }
        let (q, v) = (&x[..nq], &x[nq..nq + n]);
        let (p, out) = (&theta[self.mechanics_range()], force);
        match (&self.extra, extra) {
            (Some(changes), Some(room)) => {
                changes.forward_dynamics((&*self.mechanics, p), (q, v), theta, work, room, out)
            }
            _ => self
                .mechanics
                .forward_dynamics_lanes_into(q, v, p, work, out),
        }
    }

    /// Where the law of effect `index`, a force on a joint without a memory, is evaluated at eight states.
    pub(super) fn at_joint<'a>(&self, index: usize, x: &[Lane], theta: &'a [f64]) -> At<'a, Lane> {
        let effect = &self.effects[index];
        let Start { q, v } = self.starts[effect.target];
        At {
            seen: Seen {
                q: x[q],
                v: x[self.nq() + v],
                f: [0.0; LANES],
                h: &[],
            },
            p: &theta[self.ranges[index].clone()],
            smoothing: effect.smoothing,
        }
    }

    /// The entries of v that dry friction acts on, and the velocity over which its change of sign is spread.
    pub(crate) fn dry_velocities(&self) -> impl Iterator<Item = (usize, f64)> {
        let dry = self.effects.iter().filter(|e| e.kind.dry().is_some());
        dry.map(|e| (self.starts[e.target].v, e.smoothing))
    }

    /// Forces of the inputs that act on the coordinates themselves, into `driven`; to `add`, for every entry of θ that one depends on, the
    /// entry, that of v, the lane and the derivative.
    fn drive_eight(
        &self,
        at: &Eight<'_>,
        driven: &mut [Lane],
        mut add: impl FnMut(usize, usize, usize, f64),
    ) {
        driven.fill([0.0; LANES]);
        for (lane, (inputs, step)) in at.inputs.iter().zip(at.steps).enumerate() {
            for (signal, v) in self.direct(inputs) {
                driven[v][lane] += signal.value[step];
                for (index, derivative) in &signal.by_parameter {
                    add(*index, v, lane, derivative[step]);
                }
            }
        }
    }

    /// Where the law of effect `index` acts, and what it sees there in eight states.
    fn seen_by_eight<'a>(
        &self,
        index: usize,
        x: &'a [Lane],
        at: &Eight<'_>,
        driven: &[Lane],
    ) -> (Start, Seen<'a, Lane>) {
        let Placed { kind, target, .. } = self.effects[index];
        let start = self.starts[self.coordinate_of(kind, target)];
        let seen = Seen {
            q: x[start.q],
            v: x[self.nq() + start.v],
            f: match kind.is_transmission() {
                true => at.signal(target),
                false => driven[start.v],
            },
            h: &x[self.nq() + self.nv()..][self.state_ranges[index].clone()],
        };
        (start, seen)
    }
}

/// to = a + b.
fn sums(to: &mut [Lane], a: &[Lane], b: &[Lane]) {
    to.copy_from_slice(a);
    for (to, b) in to.iter_mut().zip(b) {
        add(to, b);
    }
}

/// to += from.
fn add(to: &mut Lane, from: &Lane) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from;
    }
}

/// ∂v̇/∂Q times ∂Q/∂x, into the upper rows of `linear`.
struct Chained<'a> {
    /// n and the rows of `linear`.
    sizes: (usize, usize),
    by_force: &'a [Lane],
    forces: &'a [Lane],
    linear: &'a mut [Lane],
}

impl NullaryFnOnce for Chained<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        // Sizes that are known are unrolled.
        match self.sizes {
            (2, 2) => self.columns(2, 2),
            (n, below) => self.columns(n, below),
        }
    }
}

impl Chained<'_> {
    #[inline(always)]
    fn columns(self, n: usize, below: usize) {
        let columns = self.forces.chunks_exact(n);
        for (out, forces) in self.linear.chunks_exact_mut(below).zip(columns) {
            for (i, out) in out[..n].iter_mut().enumerate() {
                let mut sum = [0.0; LANES];
                for (j, force) in forces.iter().enumerate() {
                    let response = &self.by_force[j * n + i];
                    for ((sum, r), f) in sum.iter_mut().zip(response).zip(force) {
                        *sum += r * f;
                    }
                }
                *out = sum;
            }
        }
    }
}
