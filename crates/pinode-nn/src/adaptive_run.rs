//! Free runs whose steps adapt to the motion, also where it is stiff: [`integrators::adaptive`] on the hybrid model.
//!
//! Jacobians are exact, those of the fits. Inputs are held between samples, no step straddles a jump of one, and an input that comes late
//! jumps when it comes ([`Hybrid::hold`]); where nothing jumps, steps are as long as the motion lets them be and the states at samples
//! come from the interpolant of the method. Bodies that float turn on their manifold. Under constraints v̇ is the stabilised
//! acceleration of [`lagrange::constraint`], which holds the mechanism together within the tolerance.
//!
//! A step is accepted where the root of the mean square of eᵢ/(atolᵢ + rtol |xᵢ|) is below 1, over the entries of q and v, with the error
//! e of this step. For a pose |xᵢ| counts as 1 m and 1 rad wherever it is.

use integrators::adaptive::{AdaptiveError, Inputs, Method, Refusal, RollOut, Settings, roll_out};

use crate::Error;
use crate::free_run::stopped;
use crate::hybrid::{HeldInputs, Hybrid, HybridMotion};
use crate::model::Model;
use crate::shooting::Diverged;

/// A coordinate or velocity below this, m, rad, m/s or rad/s, need not be known relative to itself.
const SMALL: f64 = 1e-3;
/// Accepted steps at most.
const MOST_STEPS: usize = 10_000_000;

/// The absolute tolerances that belong to rtol = `relative`, one for each entry of v for the positions and one for each for the
/// velocities, then one for each state of the effects with a memory: stretches and velocities, rtol · 10 µm or 10 µm/s.
///
/// atol = rtol · 1 mm or 1 mrad for positions, rtol · 1 mm/s or 1 mrad/s for velocities; for the velocity of a coordinate with dry
/// friction rtol times the velocity over which its sign change is spread, where that is less.
pub fn absolute_tolerances(hybrid: &Hybrid, relative: f64) -> Vec<f64> {
    let coordinates = hybrid.mechanics().coordinates();
    let mut absolute = vec![relative * SMALL; hybrid.nv()];
    for (c, coordinate) in coordinates.iter().enumerate() {
        let small = hybrid.smoothing(c).map_or(SMALL, |s| s.min(SMALL));
        absolute.extend(std::iter::repeat_n(relative * small, coordinate.nv()));
    }
    absolute.extend(std::iter::repeat_n(relative * 0.01 * SMALL, hybrid.nh()));
    absolute
}

/// The model over one recording.
///
/// A block of 1 kg behind a damper of 10⁵ N·s/m: its velocity decays within 10 µs, and is pushed.
///
/// ```
/// use integrators::adaptive::Method;
/// use pinode_nn::adaptive_run::AdaptiveRun;
/// use pinode_nn::hybrid::Hybrid;
/// use pinode_nn::model::Model;
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
/// # kind = "viscous_friction"
/// # joint = "x"
/// # coefficient = 1e5
/// # "#)?;
/// let hybrid = Hybrid::of(&Model::load(&path)?);
/// let t: Vec<f64> = (0..=100).map(|k| 0.1 * f64::from(k)).collect();
/// let run = AdaptiveRun::new(&hybrid, &t, &[vec![1e5; 101]]); // N
/// let rolled = run.roll(&run.settings(Method::Automatic, 1e-6), &[0.0, 0.0])?;
/// assert!((rolled.states[100][0] - 10.0).abs() < 1e-4); // 1 m/s for 10 s
/// assert!(rolled.statistics.steps < 1000); // an explicit method needs 3·10⁵
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct AdaptiveRun<'a> {
    hybrid: &'a Hybrid,
    theta: Vec<f64>,
    held: HeldInputs,
}

impl<'a> AdaptiveRun<'a> {
    /// Under the inputs `u` (one column each, one value a sample) at times `t`.
    pub fn new(hybrid: &'a Hybrid, t: &[f64], u: &[Vec<f64>]) -> Self {
        let theta = hybrid.theta();
        AdaptiveRun {
            held: hybrid.hold(t, u, &theta),
            hybrid,
            theta,
        }
    }

    /// rtol = `relative`, and the [`absolute_tolerances`] that belong to it.
    pub fn settings(&self, method: Method, relative: f64) -> Settings {
        Settings::new(method, relative, relative)
            .with_absolute(&absolute_tolerances(self.hybrid, relative))
            .with_max_steps(MOST_STEPS)
    }

    /// From `initial` (q, v) or (q, v, h) at the first sample: one state (q, v) a sample, and what they took. Without h, the effects with a
    /// memory start as [`Hybrid::hidden_start`] has them.
    ///
    /// # Errors
    /// Those of [`integrators::adaptive::roll_out`].
    pub fn roll(
        &self,
        settings: &Settings,
        initial: &[f64],
    ) -> Result<RollOut, AdaptiveError<Diverged>> {
        let mut rolled = self.roll_whole(settings, initial)?;
        let visible = self.hybrid.nx() - self.hybrid.nh();
        for state in &mut rolled.states {
            state.truncate(visible);
        }
        Ok(rolled)
    }

    /// The same with h behind q and v.
    fn roll_whole(
        &self,
        settings: &Settings,
        initial: &[f64],
    ) -> Result<RollOut, AdaptiveError<Diverged>> {
        let HeldInputs {
            inputs,
            samples,
            held,
        } = &self.held;
        let motion = HybridMotion::new(self.hybrid, &self.theta, &[], inputs);
        let (bounds, held) = (&inputs.grid.bounds, Inputs::Held(held));
        let start = self.hybrid.whole_start(initial, &self.theta, inputs);
        let mut rolled = roll_out(&motion, settings, bounds, held, &start)?;
        if samples.len() < rolled.states.len() {
            let mut wanted = samples.iter().copied().peekable();
            let mut bound = 0_usize..;
            rolled.states.retain(|_| {
                bound
                    .next()
                    .is_some_and(|bound| wanted.next_if_eq(&bound).is_some())
            });
        }
        Ok(rolled)
    }
}

/// The model from `initial` (q, v) over the times `t` under the inputs `u`, by steps that adapt to rtol = `relative` and the
/// [`absolute_tolerances`] that belong to it.
///
/// # Errors
/// [`Error::Diverged`], [`Error::Stopped`] with what the dynamics refuse, [`Error::Adaptive`] for all else that stops the steps; `run` is what
/// the recording is called there.
pub fn simulate_adaptively(
    by: (Method, f64),
    model: &Model,
    run: &str,
    t: &[f64],
    u: &[Vec<f64>],
    initial: &[f64],
) -> Result<RollOut, Error> {
    let mut rolled = simulate_whole_adaptively(by, model, (run, t, u), initial)?;
    let visible = model.mechanics.nq() + model.mechanics.nv();
    let states = rolled.states.iter_mut();
    states.for_each(|state| state.truncate(visible));
    Ok(rolled)
}

/// The same with the states h of effects with a memory behind q and v.
///
/// # Errors
/// Those of [`simulate_adaptively`].
pub(crate) fn simulate_whole_adaptively(
    (method, relative): (Method, f64),
    model: &Model,
    (run, t, u): (&str, &[f64], &[Vec<f64>]),
    initial: &[f64],
) -> Result<RollOut, Error> {
    let hybrid = Hybrid::explicit(model);
    let by = AdaptiveRun::new(&hybrid, t, u);
    let rolled = by
        .roll_whole(&by.settings(method, relative), initial)
        .map_err(|cause| stopped_adaptively(run, cause))?;
    let out_of_range = |state: &Vec<f64>| Diverged::check(state).is_err();
    match rolled.states.iter().position(out_of_range) {
        None => Ok(rolled),
        Some(k) => {
            let last = t.get(k.saturating_sub(1)).copied().unwrap_or_default();
            Err(stopped(run, last, Diverged::OutOfRange))
        }
    }
}

/// The same error for the same cause as with fixed steps.
fn stopped_adaptively(run: &str, cause: AdaptiveError<Diverged>) -> Error {
    match cause {
        AdaptiveError::RightHandSide {
            time,
            source: Refusal::System(cause),
        } => stopped(run, time, cause),
        AdaptiveError::RightHandSide {
            time,
            source: Refusal::Rate { .. } | Refusal::Jacobian { .. },
        }
        | AdaptiveError::NotFinite { time, .. } => stopped(run, time, Diverged::OutOfRange),
        cause => Error::Adaptive {
            run: run.to_owned(),
            cause: Box::new(cause),
        },
    }
}
