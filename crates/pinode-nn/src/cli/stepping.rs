//! By what a model is stepped: a scheme of fixed steps, or a method whose steps adapt.

use clap::ValueEnum;
use clap::builder::PossibleValue;
use lagrange::mechanism::PoseForm;
use serde_json::{Value, json};

use super::simulate::shorten;
use crate::Error;
use crate::contact_run::ContactRunError;
use crate::free_run::{Scheme, simulate_whole};
use crate::log::Run;
use crate::model::Model;
use crate::poses::Upright;

/// What `--method` takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stepping {
    Fixed(Scheme),
    Adapting(Adapting),
}

/// Methods whose steps adapt to the motion; `--tolerance` says how closely.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Adapting {
    /// Steps that adapt to --tolerance: explicit where they are bounded by accuracy, implicit where the motion is stiff
    Adaptive,
    /// Steps that adapt, explicit, of order 5
    Tsit5,
    /// Steps that adapt, implicit, of order 2: stiff, coarse tolerances
    TrBdf2,
    /// Steps that adapt, implicit, of order 3: stiff, inputs that jump often
    Esdirk34,
    /// Steps that adapt, implicit, of orders 1 to 5: stiff and smooth for long, fine tolerances
    Bdf,
}

impl Default for Stepping {
    fn default() -> Self {
        Stepping::Fixed(Scheme::default())
    }
}

impl ValueEnum for Stepping {
    fn value_variants<'a>() -> &'a [Self] {
        &[
            Stepping::Fixed(Scheme::Rk4),
            Stepping::Fixed(Scheme::Heun),
            Stepping::Fixed(Scheme::Variational),
            Stepping::Fixed(Scheme::Contacts),
            Stepping::Adapting(Adapting::Adaptive),
            Stepping::Adapting(Adapting::Tsit5),
            Stepping::Adapting(Adapting::TrBdf2),
            Stepping::Adapting(Adapting::Esdirk34),
            Stepping::Adapting(Adapting::Bdf),
        ]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        match self {
            Stepping::Fixed(scheme) => scheme.to_possible_value(),
            Stepping::Adapting(adapting) => adapting.to_possible_value(),
        }
    }
}

/// What the steps of several runs took.
#[derive(Debug, Default)]
pub(super) struct Effort {
    /// Accepted steps of methods that adapt.
    steps: usize,
    /// Those of them by the explicit method.
    explicit: usize,
    /// Steps tried again.
    rejected: usize,
    /// Evaluations of v̇.
    evaluations: usize,
    /// Linearisations.
    jacobians: usize,
}

impl Effort {
    /// For programs.
    pub fn document(&self) -> Value {
        json!({
            "steps": self.steps, "explicit_steps": self.explicit, "rejected": self.rejected,
            "evaluations": self.evaluations, "jacobians": self.jacobians
        })
    }

    /// For people.
    pub fn words(&self) -> String {
        let Effort {
            steps, explicit, ..
        } = self;
        format!(
            "{steps} steps, {explicit} of them explicit; {} evaluations and {} Jacobians\n",
            self.evaluations, self.jacobians
        )
    }
}

impl Stepping {
    /// The trajectory over `run` from `initial`, (q, v) or (q, v, h): one state (q, v, h) a sample. Where the angles of a pose stop it, the error says so.
    pub fn simulate(
        self,
        model: &Model,
        run: &Run,
        initial: &[f64],
        fineness: (f64, f64),
        effort: &mut Effort,
    ) -> Result<Vec<Vec<f64>>, Error> {
        let rolled = self.roll(model, run, initial, fineness, effort);
        rolled.map_err(|error| {
            // What stops it does not bring along where it had come to.
            let before = || {
                let mut run = run.clone();
                let reached = stopped_at(&error)? - run.t.first()?;
                shorten(&mut run, reached);
                let states = match run.len() {
                    0 | 1 => vec![initial.to_vec()],
                    _ => {
                        let effort = &mut Effort::default();
                        let rolled = self.roll(model, &run, initial, fineness, effort);
                        rolled.ok()?
                    }
                };
                Upright::of(model, &run.t, &states)
            };
            match model.pose {
                PoseForm::Quaternion => error,
                PoseForm::Angles(_) => match before() {
                    Some(upright) => upright.stops(&run.id, error),
                    None => error,
                },
            }
        })
    }

    fn roll(
        self,
        model: &Model,
        run: &Run,
        initial: &[f64],
        (longest, tolerance): (f64, f64),
        effort: &mut Effort,
    ) -> Result<Vec<Vec<f64>>, Error> {
        match self {
            Stepping::Fixed(scheme) => {
                simulate_whole(scheme, model, (&run.id, &run.t, &run.u), initial, longest)
            }
            Stepping::Adapting(method) => method.simulate(model, run, initial, tolerance, effort),
        }
    }
}

/// When a simulation stopped, s; none where it did not begin.
fn stopped_at(error: &Error) -> Option<f64> {
    match error {
        Error::Diverged { time, .. } | Error::Stopped { time, .. } | Error::NoStep { time, .. } => {
            Some(*time)
        }
        #[cfg(feature = "adaptive")]
        Error::Adaptive { cause, .. } => cause.time(),
        Error::Contacts { cause, .. } => match **cause {
            ContactRunError::Stopped { time, .. } | ContactRunError::Chatter { time, .. } => {
                Some(time)
            }
            _ => None,
        },
        _ => None,
    }
}

#[cfg(feature = "adaptive")]
impl Adapting {
    fn simulate(
        self,
        model: &Model,
        run: &Run,
        initial: &[f64],
        tolerance: f64,
        effort: &mut Effort,
    ) -> Result<Vec<Vec<f64>>, Error> {
        use integrators::adaptive::Method;

        let method = match self {
            Adapting::Adaptive => Method::Automatic,
            Adapting::Tsit5 => Method::Tsit5,
            Adapting::TrBdf2 => Method::TrBdf2,
            Adapting::Esdirk34 => Method::Esdirk34,
            Adapting::Bdf => Method::Bdf,
        };
        let by = (method, tolerance);
        let over = (run.id.as_str(), run.t.as_slice(), run.u.as_slice());
        let rolled = crate::adaptive_run::simulate_whole_adaptively(by, model, over, initial)?;
        let took = &rolled.statistics;
        effort.steps += took.steps;
        effort.explicit += took.explicit_steps;
        effort.rejected += took.rejected;
        effort.evaluations += took.evaluations;
        effort.jacobians += took.jacobians;
        Ok(rolled.states)
    }
}

#[cfg(not(feature = "adaptive"))]
impl Adapting {
    fn simulate(
        self,
        _: &Model,
        _: &Run,
        _: &[f64],
        _: f64,
        _: &mut Effort,
    ) -> Result<Vec<Vec<f64>>, Error> {
        let name = self.to_possible_value();
        let name = name
            .as_ref()
            .map_or("adaptive", |value| value.get_name())
            .to_owned();
        Err(Error::NotBuilt {
            what: format!("--method {name}"),
            feature: "adaptive",
            instead: "take --method rk4",
        })
    }
}
