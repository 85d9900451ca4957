//! Free runs in which friction sticks and end stops are hard: the set-valued laws behind the smooth ones that fits differentiate.
//!
//! The grid, the inputs and the drives are those of [`free_run`](crate::free_run). Where a joint comes to rest under a force that its
//! friction holds, it stays there to the last digit, and the instants at which it sticks, breaks away and strikes a stop are found to
//! rounding ([`integrators::event`]).

use integrators::event::{ContactError, EventKind, EventRollOut, EventStepper};

use crate::free_run::NoSuchSpan;
use crate::hybrid::{DrivenInputs, Hybrid, HybridContacts};
use crate::motion::NotFree;
use crate::shooting::Diverged;

/// Why a run with contacts does not get to its end.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ContactRunError {
    /// The mechanism is not one that these laws are for.
    #[error("{0}")]
    NotFree(#[from] NotFree),
    /// The recording does not have these samples.
    #[error("{0}")]
    Span(#[from] NoSuchSpan),
    /// Between this sample and the next.
    #[error(
        "the motion with contacts stops after t = {time} s: {cause} (the laws, from 0 on: {})",
        laws.join(", ")
    )]
    Stopped {
        /// The last sample that was reached, s.
        time: f64,
        /// What the mechanism or the contacts refuse; it names laws by their place in `laws`.
        #[source]
        cause: ContactError<Diverged>,
        /// What the laws stand for.
        laws: Vec<String>,
    },
    /// A joint sticks and slides by turns so often within one step that its motion is not that of the laws any more.
    #[error(
        "the dry friction of `{coordinate}` changes between rest and sliding again and again within the step at t = {time} s: a force beside it is too stiff for the step; take shorter steps"
    )]
    Chatter {
        /// The coordinate with the friction.
        coordinate: String,
        /// s.
        time: f64,
    },
}

/// The model from `initial` (q, v) over `count` samples from sample `first` on: one state a sample, and the events between them, which
/// name laws by their place among [`HybridContacts::touches`].
///
/// A block of 1 kg on a table with 2 N of Coulomb friction, pushed with 1.8 N: smoothed, it creeps.
///
/// ```
/// use pinode_nn::contact_run::roll_contacts;
/// use pinode_nn::free_run::FreeRun;
/// use pinode_nn::hybrid::Hybrid;
/// use pinode_nn::model::Model;
/// use pinode_nn::shooting::Trajectory;
///
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("block.toml");
/// # std::fs::write(&path, r#"
/// # name = "block"
/// # lagrangian = { coordinates = ["x"], kinetic = "0.5*x_dot^2", potential = "0" }
/// # [[input]]
/// # name = "push"
/// # joint = "x"
/// # [[effect]]
/// # kind = "coulomb_friction"
/// # joint = "x"
/// # force = 2.0
/// # "#)?;
/// let model = Model::load(&path)?;
/// let hybrid = Hybrid::of(&model);
/// let t: Vec<f64> = (0..=100).map(|k| 0.01 * f64::from(k)).collect();
/// let theta = hybrid.theta();
/// let inputs = hybrid.drive(&t, &[vec![1.8; 101]], 10, &theta, &[]);
/// let held = roll_contacts(&hybrid, &theta, &inputs, (0, 101), &[0.0, 0.0])?;
/// assert_eq!(held.states[100], [0.0, 0.0]);
///
/// // v = ε artanh(1.8/2), ε = 3 mm/s
/// let run = FreeRun::new(&hybrid, &t, &[vec![1.8; 101]], 1e-3);
/// let mut smoothed = Trajectory::default();
/// run.roll(&mut run.roller(), (0, 101), &[0.0, 0.0], &mut smoothed)?;
/// assert!((smoothed.states[201] - 3e-3 * 0.9_f64.atanh()).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`ContactRunError`].
pub fn roll_contacts(
    hybrid: &Hybrid,
    theta: &[f64],
    inputs: &DrivenInputs,
    (first, count): (usize, usize),
    initial: &[f64],
) -> Result<EventRollOut, ContactRunError> {
    roll_system(
        &HybridContacts::new(hybrid, theta, inputs)?,
        inputs,
        (first, count),
        initial,
    )
}

/// [`roll_contacts`] of one with stops of either sort; `inputs` are its own.
pub(crate) fn roll_system(
    system: &HybridContacts<'_>,
    inputs: &DrivenInputs,
    (first, count): (usize, usize),
    initial: &[f64],
) -> Result<EventRollOut, ContactRunError> {
    NoSuchSpan::check(inputs, (first, count))?;
    let bounds = &inputs.grid.bounds;
    let stopped = |sample: usize| {
        move |cause| ContactRunError::Stopped {
            time: bounds
                .get(inputs.grid.steps_from(sample).start)
                .copied()
                .unwrap_or_default(),
            cause,
            laws: system.touches().iter().map(ToString::to_string).collect(),
        }
    };
    let mut stepper = EventStepper::new(system, system.laws()).map_err(stopped(first))?;
    let mut state = initial.to_vec();
    let mut states = Vec::with_capacity(count);
    states.push(state.clone());
    let mut seen = 0;
    for sample in first..(first + count).saturating_sub(1) {
        let steps = inputs.grid.steps_from(sample);
        let intervals = bounds.windows(2).enumerate().skip(steps.start);
        for (step, interval) in intervals.take(steps.len()) {
            let &[from, to] = interval else { continue };
            stepper
                .advance(system, (from, to - from, 1), &step, &mut state)
                .map_err(stopped(sample))?;
            let events = stepper.events().get(seen..).unwrap_or_default();
            if let Some(held) = events.iter().find(|e| e.kind == EventKind::Held) {
                let rubbing = system.rubbing();
                let coordinate = rubbing.get(held.law).map(|c| c.name.clone());
                return Err(ContactRunError::Chatter {
                    coordinate: coordinate.unwrap_or_default(),
                    time: held.time,
                });
            }
            seen += events.len();
        }
        if let Err(source) = Diverged::check(&state) {
            let time = bounds.get(steps.end).copied().unwrap_or_default();
            return Err(stopped(sample)(ContactError::System { time, source }));
        }
        states.push(state.clone());
    }
    Ok(EventRollOut {
        states,
        events: stepper.events().to_vec(),
    })
}
