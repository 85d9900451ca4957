//! A whole motion with contacts over sample times.

use super::{ContactError, ContactSystem, Event, EventStepper, Law};
use crate::RollOutError;
use crate::fixed::check_arguments;

/// Why a roll-out with contacts stopped. `E` is the error of the [`ContactSystem`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EventRollOutError<E> {
    /// The times, inputs or substeps are none; found before the first step.
    #[error("{0}")]
    Arguments(RollOutError<E>),
    /// The laws, the start, or what happens between two samples.
    #[error("the motion with contacts stops after t = {time} s: {source}")]
    Contacts {
        /// The last sample that was reached, s.
        time: f64,
        /// Why.
        source: ContactError<E>,
    },
}

/// States at the sample times and what happened between them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EventRollOut {
    /// Row k is x = (q, v) at `times[k]`.
    pub states: Vec<Vec<f64>>,
    /// In the order of time.
    pub events: Vec<Event>,
}

/// States of a system with contacts at `times` from `initial` = (q, v) at `times[0]`, and its events.
///
/// `inputs[k]` is held over [`times[k]`, `times[k + 1]`); an input for the last sample may be there and is not used. Every interval is
/// divided into `substeps` equal steps, and these at events. No step reaches past a sample, so the rows have no error of
/// interpolation; for a state between samples, add its time and repeat the input.
///
/// A ball of 2 kg falls from 1 m on the floor, e = 1/2:
///
/// ```
/// use std::convert::Infallible;
/// use integrators::event::{EventKind, Law, Masses, roll_out_events};
///
/// let ball = Masses::new(1, |_t, (_q, _v), _u: &(), mass, force| {
///     mass[(0, 0)] = 2.0;
///     force[0] = -2.0 * 9.81;
///     Ok::<(), Infallible>(())
/// });
/// let floor = Law::stop(&[1.0], 0.0, 0.5);
/// let motion = roll_out_events(&ball, vec![floor], &[0.0, 0.5, 2.0], &[(); 2], 10, &[1.0, 0.0])?;
/// let first = motion.events[0];
/// assert!((first.time - (2.0 / 9.81_f64).sqrt()).abs() < 1e-12);
/// assert!(matches!(first.kind, EventKind::Impact { before, after } if after == -0.5 * before));
/// // At rest after infinitely many bounces, at t = 3 √(2 h / g).
/// assert_eq!(motion.events.last().map(|event| event.kind), Some(EventKind::Rests));
/// assert_eq!(motion.states[2], [0.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`EventRollOutError`]; the arguments are checked before the first step.
pub fn roll_out_events<S>(
    system: &S,
    laws: Vec<Law>,
    times: &[f64],
    inputs: &[S::Input],
    substeps: usize,
    initial: &[f64],
) -> Result<EventRollOut, EventRollOutError<S::Error>>
where
    S: ContactSystem,
    S::Input: Sized,
{
    check_arguments(times, inputs.len(), substeps).map_err(EventRollOutError::Arguments)?;
    let Some(&start) = times.first() else {
        return Ok(EventRollOut::default());
    };
    let fail = |time| move |source| EventRollOutError::Contacts { time, source };
    let mut stepper = EventStepper::new(system, laws).map_err(fail(start))?;
    let mut x = initial.to_vec();
    stepper.start(system, start, &mut x).map_err(fail(start))?;
    let mut states = Vec::with_capacity(times.len());
    states.push(x.clone());
    for ((&from, &to), u) in times.iter().zip(times.iter().skip(1)).zip(inputs) {
        stepper
            .advance(system, (from, to - from, substeps), u, &mut x)
            .map_err(fail(from))?;
        states.push(x.clone());
    }
    Ok(EventRollOut {
        states,
        events: stepper.events().to_vec(),
    })
}
