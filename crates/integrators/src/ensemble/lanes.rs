//! Eight roll-outs in the lanes of the processor's vectors.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::RolledOut;
use crate::fixed::{check_arguments, check_finite, check_initial};
use crate::gradient::Explicit;
use crate::{RollOutError, Space, StepError, System};

/// States side by side.
pub const LANES: usize = 8;

/// A [`System`] that has a rate of eight states at once.
///
/// Entry i of eight states is an array of eight numbers: lane k of it is entry i of state k.
pub trait LaneSystem: System {
    /// Writes ẋ = f(t, x, u) of all lanes to `dx`, every entry of it; lane k is held at `u[k]`. A lane is computed from its own lane alone.
    ///
    /// # Errors
    /// Where f has no value in some lane. The step is then made again one state at a time by [`rate`](System::rate), so that only the
    /// states without a value fail. A lane may also be NaN instead, to the same end.
    fn rate_lanes(
        &self,
        t: f64,
        x: &[[f64; LANES]],
        u: [&Self::Input; LANES],
        memory: &mut Self::Memory,
        dx: &mut [[f64; LANES]],
    ) -> Result<(), Self::Error>;
}

/// Where one of the roll-outs in lanes starts, and what acts on it.
#[derive(Debug)]
pub struct LaneMember<'a, U> {
    /// `inputs[k]` is held from sample k to sample k + 1.
    pub inputs: &'a [U],
    /// The state at the first sample.
    pub initial: &'a [f64],
}

impl<U> Clone for LaneMember<'_, U> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<U> Copy for LaneMember<'_, U> {}

/// Roll-outs of one system from many states and with inputs of their own, in groups of eight in threads; result k belongs to member k,
/// and is what [`roll_out`](crate::roll_out) gives, to the bit where [`rate_lanes`](LaneSystem::rate_lanes) and
/// [`rate`](System::rate) round alike.
///
/// ```
/// use std::convert::Infallible;
/// use integrators::ensemble::{LANES, LaneMember, LaneSystem, roll_outs_in_lanes};
/// use integrators::{Flat, Rk4, System};
///
/// /// ẋ = −u x
/// struct Decay(Flat);
/// impl System for Decay {
///     type Space = Flat;
///     type Input = f64;
///     type Memory = ();
///     type Error = Infallible;
///     fn space(&self) -> &Flat {
///         &self.0
///     }
///     fn memory(&self) {}
///     fn rate(&self, _t: f64, x: &[f64], u: &f64, (): &mut (), dx: &mut [f64]) -> Result<(), Infallible> {
///         dx[0] = -u * x[0];
///         Ok(())
///     }
/// }
/// impl LaneSystem for Decay {
///     fn rate_lanes(
///         &self, _t: f64, x: &[[f64; LANES]], u: [&f64; LANES], (): &mut (), dx: &mut [[f64; LANES]],
///     ) -> Result<(), Infallible> {
///         dx[0] = std::array::from_fn(|k| -u[k] * x[0][k]);
///         Ok(())
///     }
/// }
///
/// let inputs: Vec<[f64; 1]> = (0..20).map(|k| [0.1 * f64::from(k)]).collect();
/// let members: Vec<_> = inputs.iter().map(|inputs| LaneMember { inputs, initial: &[1.0] }).collect();
/// let rolled = roll_outs_in_lanes(&Decay(Flat::new(1)), &Rk4::default(), &[0.0, 1.0], 50, &members);
/// for (k, states) in rolled.into_iter().enumerate() {
///     assert!((states?[1][0] - (-0.1 * k as f64).exp()).abs() < 1e-8);
/// }
/// # Ok::<(), integrators::RollOutError<Infallible>>(())
/// ```
pub fn roll_outs_in_lanes<S, M>(
    system: &S,
    method: &M,
    times: &[f64],
    substeps: usize,
    members: &[LaneMember<'_, S::Input>],
) -> Vec<RolledOut<S::Error>>
where
    S: LaneSystem,
    S::Input: Sized,
    M: Explicit,
{
    members
        .par_chunks(LANES)
        .flat_map_iter(|members| Group::roll_out(system, method, times, substeps, members))
        .collect()
}

/// The states of up to eight members on their way.
struct Group<'a, S: LaneSystem, M>
where
    S::Input: Sized,
{
    system: &'a S,
    members: &'a [LaneMember<'a, S::Input>],
    /// One step of one state.
    alone: M,
    memory: S::Memory,
    /// Rows of every member, or its error.
    results: Vec<RolledOut<S::Error>>,
    /// Whose input acts on a lane: a member's own, or that of a neighbour whose state fills the lane of a member that has failed or is
    /// not there.
    of_lane: [usize; LANES],
    /// The states, lane k of every entry in a row.
    x: Vec<f64>,
    before: Vec<f64>,
    one: Vec<f64>,
}

impl<'a, S, M> Group<'a, S, M>
where
    S: LaneSystem,
    S::Input: Sized,
    M: Explicit,
{
    fn roll_out(
        system: &'a S,
        method: &M,
        times: &[f64],
        substeps: usize,
        members: &'a [LaneMember<'a, S::Input>],
    ) -> Vec<RolledOut<S::Error>> {
        let dim = system.space().dim();
        let start = |member: &LaneMember<'_, S::Input>| {
            check_arguments(times, member.inputs.len(), substeps)?;
            check_initial(system.space(), member.initial)?;
            let Some(&start) = times.first() else {
                return Ok(Vec::new());
            };
            check_finite(start, member.initial)?;
            let mut rows = Vec::with_capacity(times.len());
            rows.push(member.initial.to_vec());
            Ok(rows)
        };
        let mut group = Group {
            system,
            members,
            alone: method.clone(),
            memory: system.memory(),
            results: members.iter().map(start).collect(),
            of_lane: [0; LANES],
            x: vec![0.0; dim * LANES],
            before: vec![0.0; dim * LANES],
            one: vec![0.0; dim],
        };
        for (lane, member) in members.iter().enumerate() {
            if group.results[lane].is_ok() {
                group.one.copy_from_slice(member.initial);
                group.write(lane);
            }
        }
        group.fill();
        let lanes = Lanes::new(system);
        let mut method = method.clone();
        for (interval, pair) in times.windows(2).enumerate() {
            let h = (pair[1] - pair[0]) / substeps as f64;
            for i in 0..substeps {
                if group.results.iter().all(Result::is_err) {
                    return group.results;
                }
                let t = pair[0] + i as f64 * h;
                group.step(&lanes, &mut method, interval, (t, h));
            }
            group.sample();
        }
        group.results
    }

    /// One step of all lanes.
    fn step(&mut self, lanes: &Lanes<'a, S>, method: &mut M, interval: usize, (t, h): (f64, f64)) {
        self.before.copy_from_slice(&self.x);
        let members = self.members;
        let u = self.of_lane.map(|member| &members[member].inputs[interval]);
        let done = method.step(lanes, t, h, &u, &mut self.memory, &mut self.x);
        if done.is_ok() && self.x.iter().all(|x| x.is_finite()) {
            return;
        }
        for (lane, member) in members.iter().enumerate() {
            self.read(lane, done.is_err());
            if self.results[lane].is_err()
                || (done.is_ok() && check_finite::<()>(t, &self.one).is_ok())
            {
                continue;
            }
            self.read(lane, true);
            let u = &member.inputs[interval];
            let alone = self
                .alone
                .step(self.system, t, h, u, &mut self.memory, &mut self.one)
                .map_err(|source: StepError<S::Error>| RollOutError::Step { time: t, source })
                .and_then(|()| check_finite(t + h, &self.one));
            match alone {
                Ok(()) => self.write(lane),
                Err(error) => self.results[lane] = Err(error),
            }
        }
        self.fill();
    }

    /// The state in a lane, before the step or after it, to `one`.
    fn read(&mut self, lane: usize, before: bool) {
        let from = if before { &self.before } else { &self.x };
        let lanes = from.as_chunks::<LANES>().0;
        for (x, lanes) in self.one.iter_mut().zip(lanes) {
            *x = lanes[lane];
        }
    }

    /// `one` to a lane.
    fn write(&mut self, lane: usize) {
        let lanes = self.x.as_chunks_mut::<LANES>().0;
        for (x, lanes) in self.one.iter().zip(lanes) {
            lanes[lane] = *x;
        }
    }

    /// Lanes without a member that lives follow the first one that does.
    fn fill(&mut self) {
        let lives = |lane: usize| matches!(self.results.get(lane), Some(Ok(_)));
        let Some(first) = (0..LANES).find(|&lane| lives(lane)) else {
            return;
        };
        self.of_lane = std::array::from_fn(|lane| if lives(lane) { lane } else { first });
        for lanes in self.x.as_chunks_mut::<LANES>().0 {
            *lanes = self.of_lane.map(|lane| lanes[lane]);
        }
    }

    /// Adds the states to the rows of the members.
    fn sample(&mut self) {
        let lanes = self.x.as_chunks::<LANES>().0;
        for (lane, rows) in self.results.iter_mut().enumerate() {
            if let Ok(rows) = rows {
                rows.push(lanes.iter().map(|lanes| lanes[lane]).collect());
            }
        }
    }
}

/// Eight states of a system as one: a method steps it as any other.
struct Lanes<'a, S: System> {
    system: &'a S,
    space: LaneSpace<'a, S::Space>,
}

impl<'a, S: LaneSystem> Lanes<'a, S> {
    fn new(system: &'a S) -> Self {
        Lanes {
            system,
            space: LaneSpace {
                space: system.space(),
                scratch: Mutex::new(Vec::new()),
            },
        }
    }
}

impl<'a, S: LaneSystem> System for Lanes<'a, S>
where
    S::Input: Sized,
{
    type Space = LaneSpace<'a, S::Space>;
    type Input = [&'a S::Input; LANES];
    type Memory = S::Memory;
    type Error = S::Error;

    fn space(&self) -> &Self::Space {
        &self.space
    }

    fn memory(&self) -> S::Memory {
        self.system.memory()
    }

    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &[&'a S::Input; LANES],
        memory: &mut S::Memory,
        dx: &mut [f64],
    ) -> Result<(), S::Error> {
        let (x, dx) = (x.as_chunks::<LANES>().0, dx.as_chunks_mut::<LANES>().0);
        self.system.rate_lanes(t, x, *u, memory, dx)
    }
}

/// The product of eight spaces, lane by lane. Where space is flat no state is taken apart.
struct LaneSpace<'a, P> {
    space: &'a P,
    /// Two arguments and a result of one lane. A group has its own, so that nothing waits.
    scratch: Mutex<Vec<f64>>,
}

impl<P: Space> LaneSpace<'_, P> {
    fn lane_by_lane(
        &self,
        (a, b): (&[f64], &[f64]),
        out: &mut [f64],
        call: impl Fn(&P, &[f64], &[f64], &mut [f64]),
    ) {
        let (na, nb, n) = (a.len() / LANES, b.len() / LANES, out.len() / LANES);
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        scratch.resize(na + nb + n, 0.0);
        let (one_a, rest) = scratch.split_at_mut(na);
        let (one_b, one_out) = rest.split_at_mut(nb);
        let (a, b) = (a.as_chunks::<LANES>().0, b.as_chunks::<LANES>().0);
        let out = out.as_chunks_mut::<LANES>().0;
        for lane in 0..LANES {
            for (one, lanes) in one_a.iter_mut().zip(a).chain(one_b.iter_mut().zip(b)) {
                *one = lanes[lane];
            }
            call(self.space, one_a, one_b, one_out);
            for (one, lanes) in one_out.iter().zip(out.iter_mut()) {
                lanes[lane] = *one;
            }
        }
    }
}

impl<P: Space> Space for LaneSpace<'_, P> {
    fn dim(&self) -> usize {
        self.space.dim() * LANES
    }
    fn tangent_dim(&self) -> usize {
        self.space.tangent_dim() * LANES
    }
    fn is_flat(&self) -> bool {
        self.space.is_flat()
    }
    fn curved(&self) -> Range<usize> {
        let of_one = self.space.curved();
        of_one.start * LANES..of_one.end * LANES
    }
    fn move_into(&self, point: &[f64], motion: &[f64], out: &mut [f64]) {
        self.lane_by_lane((point, motion), out, P::move_into);
    }
    fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]) {
        self.lane_by_lane((from, to), out, P::difference_into);
    }
    fn bracket_into(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        self.lane_by_lane((a, b), out, P::bracket_into);
    }
    fn cobracket_into(&self, a: &[f64], m: &[f64], out: &mut [f64]) {
        self.lane_by_lane((a, m), out, P::cobracket_into);
    }
}
