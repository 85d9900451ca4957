//! Free runs: the model rolled out from an initial state under recorded inputs, without being corrected by measurements.
//!
//! Classical Runge-Kutta unless another method is asked for, the input held over each sample interval, or smooth where
//! the model says so, the effects of the drive applied to it.

use integrators::event::ContactError;
use integrators::{Heun, Method, Order, Rk4, System, Variational};

use crate::Error;
use crate::contact_run::{ContactRunError, roll_contacts};
use crate::diagnose::pace::Pace;
use crate::diagnose::smooth::smooth;
use crate::hybrid::{DrivenInputs, Hybrid, HybridMotion, behind};
use crate::log::Run;
use crate::model::Model;
use crate::motion::check_free;
use crate::shooting::{
    Channel, Diverged, Finer, Observations, ObservedRun, Roller, Trajectory, over_samples,
    wrap_angle,
};

/// Integration steps are not longer than this unless asked for, s.
pub const LONGEST_STEP: f64 = 1e-3;
/// Between two samples there are at most so many.
const MOST_SUBSTEPS: usize = 1000;
/// Half the stretch that an estimated state is fitted to, 0.03 s at the usual [`Pace`], in parts of what a diagnosis smooths over; at least three samples on
/// either side are used.
const SMOOTHING: f64 = 0.5;

/// Where the initial state of a free run comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Initial {
    /// The measured positions and velocities; a velocity that is not measured is the difference of the neighbouring positions.
    Measured,
    /// Cubics fitted to the positions around the sample, those after it among them.
    Estimated,
    /// Where the model gets from the state 0.3 s before that fits the positions from there to the sample best: nothing after it is seen. Of a
    /// single state, that of [`initial_states`], the positions around it are not there: it is as [`Initial::Measured`].
    Past,
}

impl Initial {
    /// As users call it.
    pub fn name(self) -> &'static str {
        match self {
            Initial::Measured => "measured",
            Initial::Estimated => "estimated",
            Initial::Past => "past",
        }
    }
}

/// The states (q, v) of a run from which free runs can start, behind what its sensors read: one row a sample.
pub fn initial_states(model: &Model, run: &Run, kind: Initial) -> Vec<Vec<f64>> {
    let coordinates = model.mechanics.coordinates();
    let wraps: Vec<bool> = coordinates.iter().map(|c| c.wraps).collect();
    let hybrid = Hybrid::of(model);
    let readings = hybrid.readings(&hybrid.theta(), &[]);
    let q = &run.q;
    match kind {
        Initial::Estimated => {
            let observed = ObservedRun {
                finer: Finer::default(),
                t: run.t.clone(),
                u: Vec::new(),
                valid: vec![vec![true; run.len()]; q.len()],
                y: q.clone(),
            };
            let channel = |(coordinate, &wraps)| Channel {
                coordinate,
                velocity: false,
                wraps,
                noise: 0.0,
            };
            let observations = Observations {
                channels: wraps.iter().enumerate().map(channel).collect(),
                runs: vec![observed],
            };
            let half_width = SMOOTHING * Pace::of(&observations).half_width();
            let smoothed = smooth(&observations.runs[0], &wraps, half_width);
            (0..run.len())
                .map(|k| smoothed.behind(&readings, &run.t, k))
                .collect()
        }
        Initial::Measured | Initial::Past => {
            let v: Vec<Vec<f64>> = q
                .iter()
                .zip(&run.v)
                .zip(&wraps)
                .map(|((q, v), &wraps)| match v {
                    Some(v) => v.clone(),
                    None => differences(&run.t, q, wraps),
                })
                .collect();
            (0..run.len())
                .map(|k| {
                    behind(
                        &readings,
                        q.iter().chain(&v).map(|column| column[k]).collect(),
                    )
                })
                .collect()
        }
    }
}

/// (q_{k+1} − q_{k−1}) / (t_{k+1} − t_{k−1}), one-sided at the ends.
fn differences(t: &[f64], q: &[f64], wraps: bool) -> Vec<f64> {
    let last = t.len().saturating_sub(1);
    (0..t.len())
        .map(|k| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
            let step = q[b] - q[a];
            let step = if wraps { wrap_angle(step) } else { step };
            if b > a { step / (t[b] - t[a]) } else { 0.0 }
        })
        .collect()
}

/// Steps per sample interval for steps of at most `longest` s over the sample times `t`.
pub fn substeps(t: &[f64], longest: f64) -> usize {
    // A gap in a log does not make the steps between all other samples minute: they stay bounded.
    ((longest_interval(t) / longest).ceil() as usize).clamp(1, MOST_SUBSTEPS)
}

/// The longest step within sample intervals of at most `spanned` s where `longest` is asked for over the times `t`, s: another one where
/// [`substeps`] are bounded.
pub(crate) fn longest_step(t: &[f64], spanned: f64, longest: f64) -> f64 {
    let intervals = t.windows(2).map(|p| p[1] - p[0]);
    let interval = intervals.filter(|x| *x <= spanned).fold(0.0, f64::max);
    let taken = interval / substeps(t, longest) as f64;
    // Rounding makes no other step.
    match taken > longest * (1.0 + 1e-9) {
        true => taken,
        false => longest,
    }
}

/// The longest time between samples, s.
fn longest_interval(t: &[f64]) -> f64 {
    t.windows(2).map(|p| p[1] - p[0]).fold(0.0, f64::max)
}

/// What should be known of the steps that are `taken` in a run, where they are longer than was asked for.
pub(crate) fn step_warning(run: &str, taken: f64, longest: f64) -> Option<String> {
    (taken > longest).then(|| {
        format!(
            "run `{run}`: steps of up to {taken:e} s are taken, not of {longest:e} s: there are at most {MOST_SUBSTEPS} between two samples"
        )
    })
}

/// A span of samples that a recording does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{count} samples from sample {first} on are asked for, of a recording with {samples}: ask for at least 1, and for none beyond the last"
)]
pub struct NoSuchSpan {
    /// Where it would begin.
    pub first: usize,
    /// Its samples.
    pub count: usize,
    /// The samples of the recording.
    pub samples: usize,
}

impl NoSuchSpan {
    /// Whether `inputs` have these samples.
    pub(crate) fn check(
        inputs: &DrivenInputs,
        (first, count): (usize, usize),
    ) -> Result<(), NoSuchSpan> {
        let samples = inputs.grid.samples().max(1);
        match first.checked_add(count) {
            Some(end) if count > 0 && end <= samples => Ok(()),
            _ => Err(NoSuchSpan {
                first,
                count,
                samples,
            }),
        }
    }
}

/// Why a free run does not get to its end.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FreeRunError {
    /// The recording does not have its samples.
    #[error(transparent)]
    Span(#[from] NoSuchSpan),
    /// The motion ends before.
    #[error(transparent)]
    Diverged(#[from] Diverged),
}

/// The model over one recording.
pub struct FreeRun<'a> {
    hybrid: &'a Hybrid,
    theta: Vec<f64>,
    inputs: DrivenInputs,
}

impl<'a> FreeRun<'a> {
    /// Under the inputs `u` (one column each) at times `t`, with integration steps of at most `longest_step` s.
    pub fn new(hybrid: &'a Hybrid, t: &[f64], u: &[Vec<f64>], longest_step: f64) -> Self {
        let theta = hybrid.theta();
        let inputs = hybrid.drive(t, u, substeps(t, longest_step), &theta, &[]);
        FreeRun {
            hybrid,
            theta,
            inputs,
        }
    }

    /// The inputs as they act.
    pub(crate) fn inputs(&self) -> &DrivenInputs {
        &self.inputs
    }

    /// What rolls out on one thread.
    pub fn roller(&self) -> Roller<'a> {
        Roller::new(self.hybrid, &[])
    }

    /// The states (q, v) of the whole recording, behind what its sensors read, with the states h of effects with a memory that this motion takes them to. Where a sensor is on a
    /// motor, the joint is by the drive's stretch behind that.
    pub fn with_hidden(&self, states: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if self.hybrid.nh() == 0 || states.len() != self.inputs.grid.samples() {
            return states;
        }
        let motion = |k: usize| states.get(k).cloned().unwrap_or_default();
        let path = self.hybrid.hidden_path(&self.theta, &self.inputs, &motion);
        let states = states.iter().enumerate();
        states
            .map(|(k, state)| {
                let mut whole = [state, path.at(k)].concat();
                self.hybrid.put_behind_motors(&self.theta, &mut whole);
                whole
            })
            .collect()
    }

    /// States (q, v, h), one after the other, at `count` samples from `first` on; as many as stayed finite.
    ///
    /// # Errors
    /// [`FreeRunError`].
    pub fn roll(
        &self,
        roller: &mut Roller,
        (first, count): (usize, usize),
        initial: &[f64],
        out: &mut Trajectory,
    ) -> Result<(), FreeRunError> {
        NoSuchSpan::check(&self.inputs, (first, count))?;
        roller.roll(&self.theta, &self.inputs, (first, count), initial, out)?;
        Ok(())
    }
}

/// By which method a model is simulated, with fixed steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Scheme {
    /// Classical Runge-Kutta, of order 4
    #[default]
    Rk4,
    /// Heun's method, of order 2: for rough forces
    Heun,
    /// Variational, of order 4: the energy of long runs does not drift; not under constraints
    Variational,
    /// Dry friction that sticks instead of creeping, end stops that are hard: classical Runge-Kutta from one located event to the next;
    /// not under constraints
    Contacts,
}

/// The model from `initial` (q, v) over the times `t` under the inputs `u`, by classical Runge-Kutta: one state a sample.
///
/// # Errors
/// [`Error::Diverged`], or [`Error::Stopped`] with what the dynamics refuse, and the last time that was reached; `run` is what the recording is called there.
pub fn simulate(
    model: &Model,
    run: &str,
    t: &[f64],
    u: &[Vec<f64>],
    initial: &[f64],
    longest_step: f64,
) -> Result<Vec<Vec<f64>>, Error> {
    simulate_by(Scheme::Rk4, model, run, t, u, initial, longest_step)
}

/// [`simulate`] by another method.
///
/// # Errors
/// Those of [`simulate`]; [`Error::NoStep`] where an implicit step is not solved; [`Error::Contacts`]; [`Error::NotFree`] where the method is not for the
/// mechanism.
pub fn simulate_by(
    scheme: Scheme,
    model: &Model,
    run: &str,
    t: &[f64],
    u: &[Vec<f64>],
    initial: &[f64],
    longest_step: f64,
) -> Result<Vec<Vec<f64>>, Error> {
    let mut states = simulate_whole(scheme, model, (run, t, u), initial, longest_step)?;
    let visible = model.mechanics.nq() + model.mechanics.nv();
    states.iter_mut().for_each(|state| state.truncate(visible));
    Ok(states)
}

/// The same with the states h of effects with a memory behind q and v, from `initial` (q, v) or (q, v, h).
///
/// # Errors
/// Those of [`simulate_by`].
pub(crate) fn simulate_whole(
    scheme: Scheme,
    model: &Model,
    (run, t, u): (&str, &[f64], &[Vec<f64>]),
    initial: &[f64],
    longest_step: f64,
) -> Result<Vec<Vec<f64>>, Error> {
    if t.is_empty() {
        return Ok(Vec::new());
    }
    let hybrid = Hybrid::explicit(model);
    let FreeRun { theta, inputs, .. } = FreeRun::new(&hybrid, t, u, longest_step);
    let motion = HybridMotion::new(&hybrid, &theta, &[], &inputs);
    let mut states = vec![hybrid.whole_start(initial, &theta, &inputs)];
    let rolled = match scheme {
        Scheme::Contacts => {
            return roll_contacts(&hybrid, &theta, &inputs, (0, t.len()), initial)
                .map(|motion| motion.states)
                .map_err(|error| stopped_with_contacts(run, error));
        }
        Scheme::Rk4 => roll(&motion, Rk4::default(), &inputs, t.len(), &mut states),
        Scheme::Heun => roll(&motion, Heun::default(), &inputs, t.len(), &mut states),
        Scheme::Variational => {
            check_free(&*model.mechanics, &model.parameter_values)?;
            hybrid.check_without_memory()?;
            let method = Variational::new(&motion, Order::Four);
            roll(&motion, method, &inputs, t.len(), &mut states)
        }
    };
    let Err(diverged) = rolled else {
        return Ok(states);
    };
    let last = t.get(states.len().saturating_sub(1));
    Err(stopped(run, last.copied().unwrap_or_default(), diverged))
}

/// What ended a simulation of `run` behind the sample at `time`.
pub(crate) fn stopped(run: &str, time: f64, cause: Diverged) -> Error {
    let run = run.to_owned();
    match cause {
        Diverged::OutOfRange
        | Diverged::Dynamics(lagrange::Error::AccelerationNotFinite { .. }) => {
            Error::Diverged { run, time }
        }
        Diverged::Dynamics(cause) => Error::Stopped { run, time, cause },
        Diverged::NoConvergence { iterations, change } => Error::NoStep {
            run,
            time,
            iterations,
            change,
        },
    }
}

/// The same error for the same cause as without contacts.
fn stopped_with_contacts(run: &str, error: ContactRunError) -> Error {
    match error {
        ContactRunError::NotFree(cause) => Error::NotFree(cause),
        ContactRunError::Stopped {
            time,
            cause: ContactError::NotFinite { .. },
            ..
        } => stopped(run, time, Diverged::OutOfRange),
        ContactRunError::Stopped {
            time,
            cause: ContactError::System { source, .. },
            ..
        } => stopped(run, time, source),
        cause => Error::Contacts {
            run: run.to_owned(),
            cause: Box::new(cause),
        },
    }
}

/// Appends the states at the samples behind the one that `states` holds.
fn roll<'a>(
    motion: &HybridMotion<'a>,
    mut method: impl Method<HybridMotion<'a>>,
    inputs: &DrivenInputs,
    samples: usize,
    states: &mut Vec<Vec<f64>>,
) -> Result<(), Diverged> {
    let mut state = states.last().cloned().unwrap_or_default();
    over_samples(
        motion,
        &mut method,
        &mut motion.memory(),
        inputs,
        (0, samples),
        &mut state,
        |state| states.push(state.to_vec()),
    )
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    const LATE: &str = "
        name = 'late'
        [lagrangian]
        coordinates = ['q']
        kinetic = '0.5*q_dot^2'
        potential = '8*q^2'
        [[effect]]
        kind = 'sensor_delay'
        joint = 'q'
        delay = 0.047
    ";

    /// q = sin 4t, of which the sensor reads what was 47 ms before.
    #[test]
    fn free_runs_start_from_what_a_late_sensor_reads_later() {
        let model = Model::parse("late.toml".as_ref(), LATE.to_owned()).unwrap();
        let t: Vec<f64> = (0..200).map(|k| 0.01 * f64::from(k)).collect();
        let run = Run {
            id: "0".into(),
            q: vec![t.iter().map(|t| (4.0 * (t - 0.047)).sin()).collect()],
            v: vec![None],
            u: Vec::new(),
            t,
        };
        let states = initial_states(&model, &run, Initial::Estimated);
        for (k, (state, t)) in states.iter().zip(&run.t).enumerate() {
            // The last 47 ms nobody reads: there the motion goes on as it was.
            let allowed = match k {
                0..192 => [2e-5, 2e-3],
                _ => [2e-3, 0.2],
            };
            let errors = [state[0] - (4.0 * t).sin(), state[1] - 4.0 * (4.0 * t).cos()];
            let fits = errors.iter().zip(&allowed).all(|(e, a)| e.abs() < *a);
            assert!(fits, "{k}: {errors:?}");
        }
    }
}
