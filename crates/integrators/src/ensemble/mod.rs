//! Many roll-outs at once: in threads, and in lanes of eight.
//!
//! [`roll_outs`] and [`gradients`] take members that differ in everything, one at a time in the threads of rayon's pool.
//! [`roll_outs_in_lanes`] takes members of one system and one table of times, eight at a time in every thread, for systems that have a
//! rate of eight states ([`LaneSystem`]).
//!
//! Results are the same to the bit for any number of threads: a member's numbers depend on itself (in lanes: on its group of eight, and
//! groups are made in the order of the members), and sums over members are taken in their order. The error of one member is its own
//! result; the others are not touched by it.
mod lanes;

use nalgebra::DMatrix;
use rayon::prelude::*;

pub use lanes::{LANES, LaneMember, LaneSystem, roll_outs_in_lanes};

use crate::gradient::{Adjoint, Explicit, GradientError, RollOutGradient, Schedule};
use crate::{Differentiable, Method, RollOutError, System, roll_out};

/// States at the samples, row k at sample k, or why there are none.
pub type RolledOut<E> = Result<Vec<Vec<f64>>, RollOutError<E>>;

/// One roll-out of many.
#[derive(Debug)]
pub struct Member<'a, S: System>
where
    S::Input: Sized,
{
    /// What is rolled out; members may share it, or have constants of their own.
    pub system: &'a S,
    /// When it is sampled, and what acts on it.
    pub schedule: Schedule<'a, S::Input>,
    /// Where it starts.
    pub initial: &'a [f64],
}

impl<S: System> Clone for Member<'_, S>
where
    S::Input: Sized,
{
    fn clone(&self) -> Self {
        *self
    }
}

impl<S: System> Copy for Member<'_, S> where S::Input: Sized {}

/// [`roll_out`] of every member, in threads; result k belongs to member k.
///
/// ```
/// use std::convert::Infallible;
/// use integrators::ensemble::{Member, roll_outs};
/// use integrators::gradient::Schedule;
/// use integrators::{Ode, Rk4};
///
/// let decay = Ode::new(1, |_t, x: &[f64], rate: &f64, dx: &mut [f64]| {
///     dx[0] = -rate * x[0];
///     Ok::<(), Infallible>(())
/// });
/// let starts = [[1.0], [2.0], [f64::NAN]];
/// let schedule = Schedule { times: &[0.0, 1.0], inputs: &[0.5], substeps: 20 };
/// let members: Vec<_> =
///     starts.iter().map(|start| Member { system: &decay, schedule, initial: start }).collect();
/// let rolled = roll_outs(&members, &Rk4::default());
/// assert!(matches!(&rolled[1], Ok(states) if (states[1][0] - 2.0 * (-0.5_f64).exp()).abs() < 1e-8));
/// assert!(rolled[2].is_err());
/// ```
pub fn roll_outs<S, M>(members: &[Member<'_, S>], method: &M) -> Vec<RolledOut<S::Error>>
where
    S: System,
    S::Input: Sized,
    M: Method<S> + Clone + Sync,
{
    members
        .par_iter()
        .map(|member| {
            let Schedule {
                times,
                inputs,
                substeps,
            } = member.schedule;
            roll_out(
                member.system,
                method.clone(),
                times,
                inputs,
                substeps,
                member.initial,
            )
        })
        .collect()
}

/// The loss of one member and its derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct MemberGradient {
    /// Σ ℓ_k over its samples.
    pub loss: f64,
    /// In its initial state, its constants and its inputs.
    pub by: RollOutGradient,
}

/// Losses of the members of an ensemble and their derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct EnsembleGradient<E> {
    /// Result k belongs to member k.
    pub members: Vec<Result<MemberGradient, GradientError<E>>>,
}

/// The sum over an ensemble has no value, for one of its members has none.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("member {member} of the ensemble has no gradient: leave it out or mend it")]
pub struct MemberError<E> {
    /// The first of them.
    pub member: usize,
    /// Why.
    pub source: GradientError<E>,
}

impl<E: Clone> EnsembleGradient<E> {
    /// The sum of the losses of all members, and of its derivatives in constants that they share, in the order of the members.
    ///
    /// # Errors
    /// [`MemberError`] if a member has no gradient: nothing is left out of a sum silently.
    pub fn total(&self) -> Result<(f64, Vec<f64>), MemberError<E>> {
        let (mut loss, mut parameters) = (0.0, Vec::new());
        for (member, result) in self.members.iter().enumerate() {
            let one = result.as_ref().map_err(|source| MemberError {
                member,
                source: source.clone(),
            })?;
            loss += one.loss;
            parameters.resize(parameters.len().max(one.by.parameters.len()), 0.0);
            for (sum, by) in parameters.iter_mut().zip(&one.by.parameters) {
                *sum += by;
            }
        }
        Ok((loss, parameters))
    }
}

/// The [`Adjoint`] of every member, in threads. `loss(member, k, x_k, by)` is its loss at sample k, as
/// [`Adjoint::gradient`] takes it; every thread has a budget of `budget` bytes for states.
///
/// ```
/// use integrators::ensemble::{Member, gradients};
/// use integrators::gradient::{DualOde, DualRate, Schedule};
/// use integrators::Rk4;
/// use num_dual::DualNum;
///
/// /// ẋ = −p x
/// struct Decay;
/// impl DualRate for Decay {
///     type Error = std::convert::Infallible;
///     fn rate<D: DualNum<Primitive = f64> + Copy>(
///         &self, _t: f64, x: &[D], _u: &[D], p: &[D], dx: &mut [D],
///     ) -> Result<(), Self::Error> {
///         dx[0] = -p[0] * x[0];
///         Ok(())
///     }
/// }
///
/// let decay = DualOde::new(1, Decay, vec![0.5]);
/// let schedule = Schedule { times: &[0.0, 1.0], inputs: &[[]], substeps: 200 };
/// let members = [[1.0], [2.0]].map(|start| (start, schedule));
/// let members: Vec<_> = members
///     .iter()
///     .map(|(start, schedule)| Member { system: &decay, schedule: *schedule, initial: start })
///     .collect();
/// let last = |_member: usize, k: usize, x: &[f64], by: &mut [f64]| {
///     by[0] = k as f64;
///     k as f64 * x[0]
/// };
/// let (loss, parameters) = gradients(&members, &Rk4::default(), 1 << 20, last).total()?;
/// let e = (-0.5_f64).exp();
/// assert!((loss - 3.0 * e).abs() < 1e-8 && (parameters[0] + 3.0 * e).abs() < 1e-8);
/// # Ok::<(), integrators::ensemble::MemberError<std::convert::Infallible>>(())
/// ```
pub fn gradients<S, M>(
    members: &[Member<'_, S>],
    method: &M,
    budget: usize,
    loss: impl Fn(usize, usize, &[f64], &mut [f64]) -> f64 + Sync,
) -> EnsembleGradient<S::Error>
where
    S: Differentiable,
    S::Input: Sized,
    M: Explicit,
{
    let one = |number: usize, member: &Member<'_, S>| {
        let mut by = RollOutGradient {
            inputs: DMatrix::zeros(member.system.input_count(), member.schedule.intervals()),
            ..RollOutGradient::default()
        };
        let mut adjoint = Adjoint::new(member.system, method.clone()).with_budget(budget);
        let loss = adjoint.gradient(
            member.system,
            member.schedule,
            member.initial,
            |k, x, by| loss(number, k, x, by),
            &mut by,
        )?;
        Ok(MemberGradient { loss, by })
    };
    EnsembleGradient {
        members: members
            .par_iter()
            .enumerate()
            .map(|(number, member)| one(number, member))
            .collect(),
    }
}
