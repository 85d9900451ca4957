use std::fmt;
use std::sync::Arc;

use integrators::event::{At, ContactSystem, Direction, Friction, Law};
use lagrange::Coordinate;
use nalgebra::DMatrix;

use super::{DrivenInputs, Hybrid, Memory, State};
use crate::effect::{DryFriction, JointForce};
use crate::motion::{NotFree, Positions, check_free};
use crate::shooting::Diverged;

/// The hybrid model at one θ under the inputs of one recording with its dry friction as what it is, a set of forces at rest, and no
/// function of the velocity that `smoothing` makes of it, and with end stops that are hard:
///
/// M(q) v̇ = f + Σ_j w_j λ_j, f = Σ_i B_i g_i ū_i + Σ_e Q_e(q, v; p_e) − C(q, v) v − G(q)
///
/// The sum over e has the effects that are smooth by themselves; λ_j are the [`laws`](Self::laws). The input is the number of an
/// integration step in [`DrivenInputs::grid`], as in [`HybridMotion`](super::HybridMotion).
///
/// A hard stop is the limit of the compliant one for k → ∞: a blow takes no time, and turns the speed v of approach into e v with the e
/// of the compliant blow ([`RigidStop::restitution`](crate::effect::RigidStop::restitution) of the mass 1/(M⁻¹)_jj where it happens).
/// [`with_compliant_stops`](Self::with_compliant_stops) leaves them among the Q_e.
///
/// For free mechanisms, with bodies that float or without. Under constraints Jᵀλ and dry friction would depend on each other through
/// equations that these laws do not have.
#[derive(Clone, Copy)]
pub struct HybridContacts<'a> {
    hybrid: &'a Hybrid,
    theta: &'a [f64],
    inputs: &'a DrivenInputs,
    hard: bool,
}

/// What a law of contact stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Touch<'a> {
    /// Dry friction on this coordinate.
    Friction(&'a Coordinate),
    /// The stop at the lower end of its way.
    LowerStop(&'a Coordinate),
    /// The stop at the upper end of its way.
    UpperStop(&'a Coordinate),
}

impl fmt::Display for Touch<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, coordinate) = match self {
            Touch::Friction(c) => ("dry friction", c),
            Touch::LowerStop(c) => ("lower end stop", c),
            Touch::UpperStop(c) => ("upper end stop", c),
        };
        write!(f, "{what} of `{}`", coordinate.name)
    }
}

impl<'a> HybridContacts<'a> {
    /// At θ, under `inputs`.
    ///
    /// # Errors
    /// [`NotFree`] under constraints, and where T is not ½ vᵀ M(q) v.
    pub fn new(
        hybrid: &'a Hybrid,
        theta: &'a [f64],
        inputs: &'a DrivenInputs,
    ) -> Result<Self, NotFree> {
        check_free(hybrid.mechanics(), &theta[hybrid.mechanics_range()])?;
        hybrid.check_without_memory()?;
        Ok(HybridContacts {
            hybrid,
            theta,
            inputs,
            hard: true,
        })
    }

    /// With end stops that give as in fits: only friction is another one than theirs.
    #[must_use]
    pub fn with_compliant_stops(self) -> Self {
        HybridContacts {
            hard: false,
            ..self
        }
    }

    /// The laws: one for each coordinate with dry friction, in their order, on which the dry effects add; then the hard stops.
    /// [`touches`](Self::touches) says which is which.
    pub fn laws(&self) -> Vec<Law> {
        let stops = self.stops().into_iter().map(|(_, law)| law);
        self.frictions().into_iter().chain(stops).collect()
    }

    /// What each of the [`laws`](Self::laws) stands for.
    pub fn touches(&self) -> Vec<Touch<'a>> {
        let rubbing = self.rubbing().into_iter().map(Touch::Friction);
        let stops = self.stops().into_iter().map(|(touch, _)| touch);
        rubbing.chain(stops).collect()
    }

    /// The stops of each end stop, the lower before the upper.
    fn stops(&self) -> Vec<(Touch<'a>, Law)> {
        let hybrid = self.hybrid;
        let mut stops = Vec::new();
        if !self.hard {
            return stops;
        }
        for (index, effect) in hybrid.effects.iter().enumerate() {
            let Some(stop) = effect.kind.stop() else {
                continue;
            };
            let coordinate = &hybrid.mechanics().coordinates()[effect.target];
            let start = hybrid.starts[effect.target];
            let p: Arc<[f64]> = Arc::from(&self.theta[hybrid.range(index)]);
            // The gaps q − q₋ and q₊ − q.
            let [lower, upper] = stop.places(&p);
            for (touch, sign, place) in [
                (Touch::LowerStop(coordinate), 1.0, lower),
                (Touch::UpperStop(coordinate), -1.0, upper),
            ] {
                let Some(place) = place else { continue };
                let (mut row, mut direction) = (vec![0.0; hybrid.nq()], vec![0.0; hybrid.nv()]);
                row[start.q] = sign;
                direction[start.v] = sign;
                let p = Arc::clone(&p);
                let law = Law::stop_of_gap(&row, &direction, -sign * place, 0.0)
                    .with_restitution(move |strike| stop.restitution(strike.mass, &p));
                stops.push((touch, law));
            }
        }
        stops
    }

    fn frictions(&self) -> Vec<Law> {
        let hybrid = self.hybrid;
        let on = |c: usize| {
            let own = hybrid.dry().filter(move |(target, ..)| *target == c);
            let parts = own.map(|(_, law, index)| {
                let p = &self.theta[hybrid.range(index)];
                (law, Arc::from(p))
            });
            let mut direction = vec![0.0; hybrid.nv()];
            direction[hybrid.starts[c].v] = 1.0;
            let sum = Sum {
                at: hybrid.starts[c].q,
                parts: parts.collect(),
            };
            Law::friction(&direction, sum)
        };
        hybrid.rubbing().into_iter().map(on).collect()
    }

    /// The coordinates with dry friction.
    pub fn rubbing(&self) -> Vec<&'a Coordinate> {
        let coordinates = self.hybrid.mechanics().coordinates();
        let rubbing = self.hybrid.rubbing();
        rubbing.into_iter().map(|c| &coordinates[c]).collect()
    }
}

impl Hybrid {
    /// Refuses effects with states of their own.
    pub(crate) fn check_without_memory(&self) -> Result<(), NotFree> {
        let remembers = |effect: &&super::Placed| effect.kind.states() > 0;
        match self.effects.iter().find(remembers) {
            None => Ok(()),
            Some(effect) => Err(NotFree::Memory {
                kind: effect.kind.name,
            }),
        }
    }

    /// Where stops are at θ: below and above a coordinate.
    pub fn stops(&self, theta: &[f64]) -> impl Iterator<Item = (usize, [Option<f64>; 2])> {
        let effects = self.effects.iter().enumerate();
        effects.filter_map(move |(index, effect)| {
            let stop = effect.kind.stop()?;
            Some((effect.target, stop.places(&theta[self.range(index)])))
        })
    }

    /// Moves the coordinates of a state (q, v, …) that are in a stop to where it begins. A state that was measured is in it by no more than an error,
    /// but a hard spring would throw it out.
    pub fn keep_before_stops(&self, theta: &[f64], state: &mut [f64]) {
        for (c, [lower, upper]) in self.stops(theta) {
            let q = &mut state[c];
            *q = q.max(lower.unwrap_or(*q)).min(upper.unwrap_or(*q));
        }
    }

    /// The dry effects: the coordinate, the law, the index among all effects.
    fn dry(&self) -> impl Iterator<Item = (usize, &'static dyn DryFriction, usize)> {
        let laws = self.effects.iter().enumerate();
        laws.filter_map(|(index, effect)| Some((effect.target, effect.kind.dry()?, index)))
    }

    /// The coordinates with dry friction, in increasing order.
    pub fn rubbing(&self) -> Vec<usize> {
        let mut targets: Vec<usize> = self.dry().map(|(target, ..)| target).collect();
        targets.sort_unstable();
        targets.dedup();
        targets
    }

    /// The smallest velocity, m/s or rad/s, over which a sign change of the dry friction on coordinate `c` is spread; `None` without any.
    pub fn smoothing(&self, c: usize) -> Option<f64> {
        let own = self.dry().filter(|(target, ..)| *target == c);
        own.filter_map(|(.., index)| self.effects.get(index))
            .map(|effect| effect.smoothing)
            .min_by(f64::total_cmp)
    }
}

/// Dry frictions with their parameters that act together.
struct Sum {
    /// Where the coordinate stands in q.
    at: usize,
    parts: Vec<(&'static dyn DryFriction, Arc<[f64]>)>,
}

impl Friction for Sum {
    fn sliding(&self, direction: Direction, speed: f64, at: At<'_>) -> f64 {
        let q = at.q.get(self.at).copied().unwrap_or_default();
        let parts = self.parts.iter();
        parts.map(|(law, p)| law.size(direction, q, speed, p)).sum()
    }
}

impl ContactSystem for HybridContacts<'_> {
    type Positions = Positions;
    type Input = usize;
    type Memory = Memory;
    type Error = Diverged;

    fn positions(&self) -> &Positions {
        &self.hybrid.space.first.positions
    }

    fn memory(&self) -> Memory {
        self.hybrid.memory(&[])
    }

    fn mass_and_force(
        &self,
        _t: f64,
        state: (&[f64], &[f64]),
        step: &usize,
        memory: &mut Memory,
        mass: &mut DMatrix<f64>,
        force: &mut [f64],
    ) -> Result<(), Diverged> {
        let (hybrid, (q, v)) = (self.hybrid, state);
        let is_smooth =
            |law: &dyn JointForce| law.dry().is_none() && !(self.hard && law.stop().is_some());
        let parts = State { q, v, h: &[] };
        hybrid.load_where(is_smooth, parts, self.theta, self.inputs, *step, memory);
        hybrid.mass_matrix_into(q, self.theta, memory, mass);
        hybrid.bias((q, v), self.theta, memory);
        let Memory {
            acceleration: load,
            bias,
            ..
        } = memory;
        for ((f, load), bias) in force.iter_mut().zip(load.iter()).zip(bias.iter()) {
            *f = load - bias;
        }
        Ok(())
    }
}
