//! What a network is compared with: the model without one.

use super::adjoint::Learner;
use super::data::Recordings;
use super::options::check_numbers;
use super::{Options, Session, Training, revision};
use crate::Error;
use crate::learnt::Quantity;
use crate::log::refuse_twice;
use crate::model::Revision;
use crate::network::{Activation, Mlp, Shape};

/// A model without a network, fitted.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// Its constants.
    pub revision: Revision,
    /// Typical loss a sample of the windows that were learnt from, those that diverge left out, and of those held out, as of an [`Epoch`](super::Epoch).
    pub loss: f64,
    /// The same of the windows held out, where those that diverge are far away.
    pub held_out: f64,
    /// How many windows were learnt from, and how many of them diverge.
    pub windows: [usize; 2],
    /// The same of the windows held out.
    pub windows_held_out: [usize; 2],
    /// What should be known of it: recordings that were not used.
    pub warnings: Vec<String>,
}

/// The model without a network, its constants fitted as they are before one is trained: the pure ODE (Roehrl et al. 2020, eq. 13). What the options say
/// of the network does not count.
///
/// # Errors
/// As [`train`](super::train).
pub fn fit_physics(training: &Training<'_>, options: &Options) -> Result<Fitted, Error> {
    check_numbers(options)?;
    refuse_twice(training.logs, training.held_out)?;
    let model = training.model;
    // A network that gives no force.
    let options = Options {
        joints: vec![0],
        units: vec![1],
        alone: false,
        ..options.clone()
    };
    let logs = [training.logs, training.held_out];
    let recordings = Recordings::new(model, logs, &options, false)?;
    let shape = Shape::new(&[1, 1, 1], options.hidden, Activation::Tanh)
        .map_err(|e| Error::Training(e.to_string()))?;
    let silent = vec![0.0; shape.parameters()];
    let learner = Learner {
        network: Mlp::from_parameters(shape, silent).map_err(|e| Error::Training(e.to_string()))?,
        features: recordings.features(&[Quantity::Velocity(0)]),
        outputs: recordings.outputs(&options.joints),
    };
    let mut session = Session::<f64>::of(recordings, &options, learner);
    let (loss, diverged) = session.seen()?;
    let (held_out, held_out_diverged) = session.held_out()?;
    Ok(Fitted {
        revision: revision(model, &session.recordings.hybrid, &session.recordings.theta),
        loss,
        held_out,
        windows: [session.windows(), diverged],
        windows_held_out: [session.windows_held_out(), held_out_diverged],
        warnings: session.recordings.left_out.clone(),
    })
}
