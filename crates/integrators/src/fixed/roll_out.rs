//! A whole trajectory over sample times.

use super::{Method, StepError};
use crate::{Space, System};

/// Why a roll-out stopped. `E` is the error of the right-hand side.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RollOutError<E> {
    /// The state left the numbers.
    #[error(
        "x[{component}] is {value} at t = {time} s: the roll-out diverged; take more substeps, or look for a force that grows without bound"
    )]
    NotFinite {
        /// End of the substep, s.
        time: f64,
        /// The first entry of the state that is not finite.
        component: usize,
        /// NaN or an infinity.
        value: f64,
    },
    /// A sample time is not finite, or not later than the one before it.
    #[error(
        "times[{index}] is {time} s after {previous} s: sample times must be finite and increase"
    )]
    Times {
        /// Which sample.
        index: usize,
        /// Its time, s.
        time: f64,
        /// The time of the sample before it, s.
        previous: f64,
    },
    /// There are more intervals than inputs.
    #[error(
        "{found} inputs for {needed} intervals between samples: give one input for every sample but the last"
    )]
    Inputs {
        /// Number of inputs given.
        found: usize,
        /// Number of intervals.
        needed: usize,
    },
    /// `substeps` is 0.
    #[error("substeps is 0: at least 1 step is needed between two samples")]
    Substeps,
    /// The initial state has the wrong length.
    #[error("the initial state has {found} entries where the system has {expected}")]
    Initial {
        /// Its length.
        found: usize,
        /// The entries of a state.
        expected: usize,
    },
    /// The initial state is no point of the system's space.
    #[error(
        "the initial state is {distance:e} away from the space of the states: give quaternions of length 1"
    )]
    OffSpace {
        /// See [`Space::distance`].
        distance: f64,
    },
    /// A step failed.
    #[error("the step that begins at t = {time} s failed")]
    Step {
        /// Start of the substep, s.
        time: f64,
        /// What the method or the right-hand side said.
        source: StepError<E>,
    },
}

/// States of a system at `times` from `initial` at `times[0]`, by a [`Method`] of fixed step.
///
/// `inputs[k]` is held over [`times[k]`, `times[k + 1]`); an input for the last sample may be there and is not used. Every interval
/// is divided into `substeps` equal steps. Row k of the result is the state at `times[k]`; row 0 is `initial`.
///
/// ```
/// use std::convert::Infallible;
/// use integrators::{Ode, Rk4, roll_out};
///
/// // ẋ = −x + u
/// let lag = Ode::new(1, |_t, x: &[f64], u: &f64, dx: &mut [f64]| {
///     dx[0] = -x[0] + u;
///     Ok::<(), Infallible>(())
/// });
/// let states = roll_out(&lag, Rk4::default(), &[0.0, 1.0, 2.0], &[1.0, 0.0], 100, &[0.0])?;
/// let peak = 1.0 - (-1.0_f64).exp();
/// assert!((states[1][0] - peak).abs() < 1e-9);
/// assert!((states[2][0] - peak * (-1.0_f64).exp()).abs() < 1e-9);
/// # Ok::<(), integrators::RollOutError<Infallible>>(())
/// ```
///
/// # Errors
/// See [`RollOutError`]; the arguments are checked before the first step.
pub fn roll_out<S>(
    system: &S,
    mut method: impl Method<S>,
    times: &[f64],
    inputs: &[S::Input],
    substeps: usize,
    initial: &[f64],
) -> Result<Vec<Vec<f64>>, RollOutError<S::Error>>
where
    S: System,
    S::Input: Sized,
{
    check_arguments(times, inputs.len(), substeps)?;
    check_initial(system.space(), initial)?;
    let Some(&start) = times.first() else {
        return Ok(Vec::new());
    };
    check_finite(start, initial)?;
    let mut memory = system.memory();
    let mut x = initial.to_vec();
    let mut states = Vec::with_capacity(times.len());
    states.push(x.clone());
    for ((&from, &to), u) in times.iter().zip(times.iter().skip(1)).zip(inputs) {
        let h = (to - from) / substeps as f64;
        for i in 0..substeps {
            let time = from + i as f64 * h;
            method
                .step(system, time, h, u, &mut memory, &mut x)
                .map_err(|source| RollOutError::Step { time, source })?;
            check_finite(time + h, &x)?;
        }
        states.push(x.clone());
    }
    Ok(states)
}

pub(crate) fn check_arguments<E>(
    times: &[f64],
    inputs: usize,
    substeps: usize,
) -> Result<(), RollOutError<E>> {
    if substeps == 0 {
        return Err(RollOutError::Substeps);
    }
    let needed = times.len().saturating_sub(1);
    if inputs < needed {
        return Err(RollOutError::Inputs {
            found: inputs,
            needed,
        });
    }
    let mut previous = f64::NEG_INFINITY;
    for (index, &time) in times.iter().enumerate() {
        if !time.is_finite() || time <= previous {
            return Err(RollOutError::Times {
                index,
                time,
                previous,
            });
        }
        previous = time;
    }
    Ok(())
}

/// A quaternion written with six digits is one.
pub(crate) const OFF_SPACE: f64 = 1e-6;

/// Refuses an initial state of the wrong length, and one that is not in the space. What is no number is for [`check_finite`].
pub(crate) fn check_initial<E>(space: &impl Space, initial: &[f64]) -> Result<(), RollOutError<E>> {
    let (found, expected) = (initial.len(), space.dim());
    if found != expected {
        return Err(RollOutError::Initial { found, expected });
    }
    let distance = space.distance(initial);
    if distance > OFF_SPACE {
        return Err(RollOutError::OffSpace { distance });
    }
    Ok(())
}

pub(crate) fn check_finite<E>(time: f64, x: &[f64]) -> Result<(), RollOutError<E>> {
    match x.iter().position(|x| !x.is_finite()) {
        Some(component) => Err(RollOutError::NotFinite {
            time,
            component,
            value: x.get(component).copied().unwrap_or(f64::NAN),
        }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Ode, Rk4};
    use std::convert::Infallible;

    #[test]
    fn a_finite_escape_is_reported_with_time_and_component() {
        // ẏ = y² from 1 escapes at t = 1.
        let escape = Ode::new(2, |_t, x: &[f64], _u: &(), dx: &mut [f64]| {
            dx[0] = 1.0;
            dx[1] = x[1] * x[1];
            Ok::<(), Infallible>(())
        });
        let times: Vec<f64> = (0..=20).map(|k| 0.1 * k as f64).collect();
        let rolled = roll_out(&escape, Rk4::default(), &times, &[(); 20], 4, &[0.0, 1.0]);
        match rolled.unwrap_err() {
            RollOutError::NotFinite {
                time, component, ..
            } => {
                assert_eq!(component, 1);
                assert!((1.0..1.5).contains(&time), "{time}");
            }
            other => panic!("{other}"),
        }
    }

    #[test]
    fn bad_arguments_are_refused_before_the_first_step() {
        let still = Ode::new(1, |_t, _x: &[f64], _u: &(), dx: &mut [f64]| {
            dx.fill(0.0);
            Ok::<(), Infallible>(())
        });
        let roll = |times: &[f64], inputs: usize, substeps: usize, initial: &[f64]| {
            let inputs = vec![(); inputs];
            roll_out(&still, Rk4::default(), times, &inputs, substeps, initial)
        };
        let refuse =
            |times: &[f64], inputs, substeps| roll(times, inputs, substeps, &[0.0]).unwrap_err();
        assert_eq!(refuse(&[0.0, 1.0], 1, 0), RollOutError::Substeps);
        assert_eq!(
            refuse(&[0.0, 1.0, 2.0], 1, 1),
            RollOutError::Inputs {
                found: 1,
                needed: 2
            }
        );
        assert!(matches!(
            refuse(&[0.0, 1.0, 1.0], 2, 1),
            RollOutError::Times { index: 2, .. }
        ));
        assert!(matches!(
            refuse(&[f64::NAN], 0, 1),
            RollOutError::Times { index: 0, .. }
        ));
        assert!(matches!(
            roll(&[0.0], 0, 1, &[f64::NAN]).unwrap_err(),
            RollOutError::NotFinite { component: 0, .. }
        ));
        assert_eq!(
            roll(&[0.0], 0, 1, &[0.0, 1.0]).unwrap_err(),
            RollOutError::Initial {
                found: 2,
                expected: 1
            }
        );
        assert_eq!(roll(&[], 0, 1, &[0.0]), Ok(Vec::<Vec<f64>>::new()));
    }

    #[test]
    fn an_error_of_the_right_hand_side_comes_back_with_its_time() {
        let stops = Ode::new(1, |t, _x: &[f64], _u: &(), dx: &mut [f64]| {
            dx[0] = 1.0;
            if t > 0.6 { Err("stop") } else { Ok(()) }
        });
        let error = roll_out(&stops, Rk4::default(), &[0.0, 1.0], &[()], 2, &[0.0]).unwrap_err();
        assert_eq!(
            error,
            RollOutError::Step {
                time: 0.5,
                source: StepError::RightHandSide("stop")
            }
        );
    }
}
