//! Whether the fixed steps of a simulation are fine enough for its motion.
//!
//! A step h that is too long for a stiff force does not fail: the force, sampled far inside a stop, throws the mechanism out with energy
//! that nothing has given it. So each step of the trajectory is taken again as two of h/2 from where it began, and the difference of the
//! velocities at its end, d = v_h − v_{h/2}, is compared in the metric of the mass matrix with the fastest motion of the run:
//!
//! √(dᵀ M d) > 5 % of max √(vᵀ M v).
//!
//! This is local: it does not grow with the length of a run, so that a chaotic motion, where two whole runs with h and h/2 part in
//! seconds, raises no alarm. The metric has no units to choose and does not mind a light joint that trembles under its dry friction while
//! heavy ones move; the fastest motion of the whole run does not mind starts from rest and reversals. A step that resolves a force, also
//! coarsely, errs by far less: classical Runge-Kutta by (ω h)⁵/120 of an oscillation of the frequency ω, 0.8 % at ω h = 1, and dry friction F
//! within its smoothing by a part of F h/m. An unstable step errs by more than the velocity that it began with. What errs in a motion of
//! less than 1/400 of the run's energy is overlooked.

use integrators::{Heun, Method, Order, Rk4, System, Variational};
use lagrange::Workspace;
use nalgebra::{DMatrix, DVector};

use crate::entries::v_names;
use crate::free_run::{Scheme, substeps};
use crate::hybrid::{DrivenInputs, Hybrid, HybridMotion};
use crate::model::Model;

/// Part of the fastest motion by which one step may err.
const LARGEST_ERROR: f64 = 0.05;
/// Slower motions count as this, m/s and rad/s, as for methods whose steps adapt.
const SLOWEST: f64 = 1e-3;

/// The first step that is too long for what happens in it.
#[derive(Debug, Clone, PartialEq)]
pub struct CoarseStep {
    /// When it begins, s.
    pub time: f64,
    /// Its length, s.
    pub step: f64,
    /// The velocity that most of the error is in, as the columns of a log name it.
    pub velocity: String,
    /// That velocity where the step begins, m/s or rad/s.
    pub before: f64,
    /// At its end.
    pub after: f64,
    /// At its end by two steps of half the length.
    pub halved: f64,
}

impl CoarseStep {
    /// Of the motion `states`, one state (q, v, h) a sample, which `scheme` has rolled out over the times `t` under the inputs `u` with steps
    /// of at most `longest` s. None where all steps are fine enough; the located events of [`Scheme::Contacts`] are not looked at.
    pub fn of(
        scheme: Scheme,
        model: &Model,
        (t, u): (&[f64], &[Vec<f64>]),
        states: &[Vec<f64>],
        longest: f64,
    ) -> Option<CoarseStep> {
        let hybrid = Hybrid::explicit(model);
        let theta = hybrid.theta();
        let steps = substeps(t, longest);
        let whole = hybrid.drive(t, u, steps, &theta, &[]);
        let half = hybrid.drive(t, u, 2 * steps, &theta, &[]);
        let over = [&whole, &half].map(|inputs| {
            let motion = HybridMotion::new(&hybrid, &theta, &[], inputs);
            (motion, inputs)
        });
        let pair = Pair {
            model,
            over: &over,
            states,
        };
        match scheme {
            Scheme::Rk4 => pair.first(Rk4::default(), Rk4::default()),
            Scheme::Heun => pair.first(Heun::default(), Heun::default()),
            Scheme::Variational => {
                let [whole, half] =
                    [&over[0].0, &over[1].0].map(|m| Variational::new(m, Order::Four));
                pair.first(whole, half)
            }
            Scheme::Contacts => None,
        }
    }

    /// What should be known of a simulation of `run` with such a step.
    pub fn warning(&self, run: &str) -> String {
        let CoarseStep {
            time,
            step,
            velocity,
            before,
            after,
            halved,
        } = self;
        format!(
            "run `{run}`: steps of {step:.1e} s are too long from t = {time:.6} s on: one of them takes `{velocity}` from {before:.4} to {after:.4}, \
             two of half the length take it to {halved:.4}. A force is too stiff or too steep for them, and energy comes or goes that nothing \
             accounts for: take --method adaptive, a shorter --step such as {:.0e} s, or, for end stops and dry friction, --method contacts",
            step / 10.0
        )
    }
}

/// A motion and the systems of its steps and of half of them.
struct Pair<'a> {
    model: &'a Model,
    over: &'a [(HybridMotion<'a>, &'a DrivenInputs); 2],
    states: &'a [Vec<f64>],
}

/// A step and how far it errs.
struct Error {
    time: f64,
    step: f64,
    /// dᵀ M d.
    size: f64,
    entry: usize,
    velocities: [f64; 3],
}

impl<'a> Pair<'a> {
    /// The first step that errs by too much.
    fn first(
        &self,
        mut by_whole: impl Method<HybridMotion<'a>>,
        mut by_half: impl Method<HybridMotion<'a>>,
    ) -> Option<CoarseStep> {
        let [(whole, inputs), (half, halved)] = self.over;
        let (mut memory, mut finer) = (whole.memory(), half.memory());
        let mut metric = Metric::of(self.model);
        // The errors that are larger than all before: the first above a bound is among them.
        let mut records: Vec<Error> = Vec::new();
        let mut fastest = 0.0_f64;
        for (sample, start) in self.states.iter().enumerate() {
            if sample + 1 == self.states.len() {
                break;
            }
            let mut state = start.clone();
            for step in inputs.grid.steps_from(sample) {
                let [a, b] = bounds(inputs, step)?;
                let (before, mut other) = (state.clone(), state.clone());
                // The motion went on from here, so that this fails by rounding alone; where half a step fails, nothing is to be said.
                by_whole
                    .step(whole, a, b - a, &step, &mut memory, &mut state)
                    .ok()?;
                for part in [2 * step, 2 * step + 1] {
                    let [a, b] = bounds(halved, part)?;
                    if by_half
                        .step(half, a, b - a, &part, &mut finer, &mut other)
                        .is_err()
                    {
                        other.clone_from(&state);
                    }
                }
                let (size, entry) = metric.error(&before, &state, &other);
                fastest = fastest.max(metric.motion(&before));
                if size > records.last().map_or(0.0, |last| last.size) {
                    let velocity =
                        |state: &[f64]| state.get(metric.nq + entry).copied().unwrap_or_default();
                    records.push(Error {
                        time: a,
                        step: b - a,
                        size,
                        entry,
                        velocities: [velocity(&before), velocity(&state), velocity(&other)],
                    });
                }
            }
        }
        let bound = LARGEST_ERROR.powi(2) * fastest;
        let found = records.into_iter().find(|error| error.size > bound)?;
        let [before, after, halved] = found.velocities;
        Some(CoarseStep {
            time: found.time,
            step: found.step,
            velocity: v_names(self.model.mechanics.coordinates())
                .into_iter()
                .nth(found.entry)?,
            before,
            after,
            halved,
        })
    }
}

/// When a step begins and ends, s.
fn bounds(inputs: &DrivenInputs, step: usize) -> Option<[f64; 2]> {
    let bounds = inputs.grid.bounds.get(step..step + 2)?;
    bounds.try_into().ok()
}

/// The metric of the mass matrix, without what effects add to it.
struct Metric<'a> {
    model: &'a Model,
    nq: usize,
    work: Workspace,
    mass: DMatrix<f64>,
}

impl<'a> Metric<'a> {
    fn of(model: &'a Model) -> Self {
        let nv = model.mechanics.nv();
        Metric {
            model,
            nq: model.mechanics.nq(),
            work: model.mechanics.workspace(),
            mass: DMatrix::zeros(nv, nv),
        }
    }

    /// M at the state, and the velocities of `of` there.
    fn at(&mut self, state: &[f64], of: impl Fn(usize) -> f64) -> DVector<f64> {
        let (q, v) = state.split_at(self.nq.min(state.len()));
        let v = v.get(..self.mass.nrows()).unwrap_or(v);
        let Model {
            mechanics,
            parameter_values: p,
            ..
        } = self.model;
        mechanics.mass_matrix_at_into(q, v, p, &mut self.work, &mut self.mass);
        DVector::from_fn(self.mass.nrows(), |i, _| of(self.nq + i))
    }

    /// vᵀ M v, slow motions counted as [`SLOWEST`].
    fn motion(&mut self, state: &[f64]) -> f64 {
        let v = self.at(state, |i| state.get(i).copied().unwrap_or_default());
        let slowest = SLOWEST.powi(2) * self.mass.trace();
        v.dot(&(&self.mass * &v)).max(slowest)
    }

    /// dᵀ M d of the difference d between `state` and `other`, M at `before`, and the entry of d that has most of it.
    fn error(&mut self, before: &[f64], state: &[f64], other: &[f64]) -> (f64, usize) {
        let entry = |of: &[f64], i: usize| of.get(i).copied().unwrap_or_default();
        let d = self.at(before, |i| entry(state, i) - entry(other, i));
        let parts = (&self.mass * &d).component_mul(&d);
        let most = match parts.is_empty() {
            true => 0,
            false => parts.imax(),
        };
        (parts.sum(), most)
    }
}
