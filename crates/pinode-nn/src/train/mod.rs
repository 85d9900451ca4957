//! Networks that stand for the unknown part of Q, trained through the integrator (PINODE, Roehrl et al. 2020).
//!
//! M(q) v̇ + C(q, v) v + G(q) = Q + Q_NN(q, v, u; W) is rolled out over windows of recordings by classical Runge-Kutta, and the loss of the roll-outs
//! goes down along its exact gradient in W, by Adam, and on all windows at once by L-BFGS in the end, where that is asked for ([`Options::polish`]). The paper's windows are one sample long and start from the measured state, whose velocities are
//! differences of two readings; its loss is then biased by their noise ([`Start::Measured`]). The better ones ([`Start::Fitted`], the default) are
//! longer, start from states that are fitted to them, compare positions in units of their noise and leave out what the audit of the log calls
//! faulty; what effects and constants of the model can explain is fitted first, and what effects could explain of the network is handed over to them
//! as it learns, so that it is orthogonal to all that they can do on its joints.
//!
//! ```no_run
//! use pinode_nn::{log::Log, model::Model, train::{Options, Training, train}};
//!
//! let model = Model::load("cart.toml".as_ref())?;
//! let log = Log::read("log.csv".as_ref(), &model)?;
//! let options = Options::new(vec![0]);
//! let trained = train(&Training { model: &model, logs: &[log], held_out: &[] }, &options, None, &mut |epoch| {
//!     eprintln!("{}: {}", epoch.epoch, epoch.held_out);
//!     Ok(())
//! })?;
//! trained.write(&model, "out".as_ref())?;
//! # Ok::<(), pinode_nn::Error>(())
//! ```

mod adam;
mod adjoint;
mod baseline;
mod checkpoint;
mod data;
mod ensemble;
mod loss;
mod options;
mod overlap;
mod physics;
mod polish;
mod session;
#[cfg(test)]
mod session_tests;
mod starts;
mod states;
mod tangents;
#[cfg(test)]
mod tests;
mod windows;

use std::path::{Path, PathBuf};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use adjoint::Learner;
use data::Recordings;
use options::{check, check_size};

pub use baseline::{Fitted, fit_physics};
pub use ensemble::{band_of, weights_name, write_ensemble};
pub use options::{Options, Start};
pub use physics::Known;
pub use session::{Epoch, Session};

use crate::Error;
use crate::hybrid::{ConstantId, Hybrid};
use crate::learnt::law::Law;
use crate::learnt::{Card, LearntForce, Names, Quantity, usual_quantities};
use crate::log::{Log, refuse_twice};
use crate::model::{Model, Revision};
use crate::network::{Activation, Mlp, Real, Shape};

/// The name of the weights beside the model that uses them.
pub const WEIGHTS: &str = "network.safetensors";
/// The name of the model itself.
pub const MODEL: &str = "model.toml";
/// A network that corrects a model begins with this part of the usual weights in its last layer: near no force at all.
const FIRST_OUTPUT: f64 = 0.1;

/// What a network is trained on.
#[derive(Clone, Copy)]
pub struct Training<'a> {
    /// The model that it becomes a part of.
    pub model: &'a Model,
    /// What it learns from.
    pub logs: &'a [Log],
    /// What tells when to stop; the last eighth of each recording where there is none.
    pub held_out: &'a [Log],
}

/// A checkpoint that is written after every epoch.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    /// The file.
    pub path: PathBuf,
    /// Whether to go on from it where it is there.
    pub resume: bool,
}

/// A trained network.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The force.
    pub force: LearntForce,
    /// What its file will say of it.
    pub card: Card,
    /// What the force is like, one an output; none where it was trained on too few states.
    pub laws: Vec<Law>,
    /// How the epochs went.
    pub history: Vec<Epoch>,
    /// The epoch whose weights these are.
    pub best_epoch: usize,
    /// The constants of the model, as they were fitted beside it.
    pub revision: Revision,
    /// Those of them that have a tolerance and were free.
    pub constants: Vec<Known>,
    /// The typical loss of the windows held out when the network gives no force; none where it is alone on its joints.
    pub without_network: Option<f64>,
    /// The share of its force, Σ f² over what it was trained on, that free parameters of effects on its joints could still explain, where they were let
    /// take over what they can. None where there are no such parameters, or constants are kept.
    pub overlap: Option<f64>,
    /// Whether it was computed in 32 bits.
    pub single: bool,
    /// What should be known of it: recordings that were not used, and whether the model is better without it.
    pub warnings: Vec<String>,
}

/// Trains a network; `each` hears of every epoch and ends the training by an error.
///
/// # Errors
/// [`Error::Training`] when the options fit no model, [`Error::SameLog`] when a log is given twice, [`Error::Floating`], [`Error::NoWindow`] and [`Error::NoWindowHeldOut`] when the
/// recordings are too short, [`Error::Unfittable`] when most roll-outs diverge, [`Error::Checkpoint`], and those of `each`.
pub fn train(
    training: &Training<'_>,
    options: &Options,
    checkpoint: Option<&Checkpoint>,
    each: &mut dyn FnMut(&Epoch) -> Result<(), Error>,
) -> Result<Trained, Error> {
    match options.single {
        true => train_in::<f32>(training, options, checkpoint, each),
        false => train_in::<f64>(training, options, checkpoint, each),
    }
}

fn train_in<T: Real>(
    training: &Training<'_>,
    options: &Options,
    checkpoint: Option<&Checkpoint>,
    each: &mut dyn FnMut(&Epoch) -> Result<(), Error>,
) -> Result<Trained, Error> {
    refuse_twice(training.logs, training.held_out)?;
    let mut session = Session::<T>::new(training, options)?;
    let without_network = match options.alone {
        true => None,
        false => Some(session.held_out_without_network()?),
    };
    let fingerprint = fingerprint(training, options);
    if let Some(checkpoint) = checkpoint
        && checkpoint.resume
        && checkpoint.path.exists()
    {
        session.restore(&checkpoint.path, &fingerprint)?;
        for epoch in &session.history.clone() {
            each(epoch)?;
        }
    }
    while let Some(epoch) = session.advance()? {
        if let Some(checkpoint) = checkpoint {
            session.save(&checkpoint.path, &fingerprint)?;
        }
        each(&epoch)?;
    }
    let overlap = session.settle()?;
    trained(training, options, &session, (without_network, overlap))
}

impl<'a, T: Real> Session<'a, T> {
    /// The network before its first step, and its recordings; constants and starts are fitted where the options say so.
    ///
    /// # Errors
    /// As [`train`].
    pub fn new(training: &Training<'_>, options: &'a Options) -> Result<Self, Error> {
        check(training.model, options)?;
        let model = training.model;
        let quantities = match options.quantities.is_empty() {
            true => usual_quantities(model, options.is_black_box(model)),
            false => options.quantities.clone(),
        };
        let mut sizes = vec![quantities.len()];
        sizes.extend(&options.units);
        sizes.push(options.joints.len());
        check_size(&sizes)?;
        let logs = [training.logs, training.held_out];
        let recordings = Recordings::new(model, logs, options, true)?;
        let features = recordings.features(&quantities);
        let outputs = recordings.outputs(&options.joints);
        let shape = Shape::new(&sizes, options.hidden, Activation::Tanh)
            .map_err(|e| Error::Training(e.to_string()))?;
        let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
        let mut network = Mlp::<T>::xavier(shape, &mut rng);
        if !options.alone {
            let last = network.shape().layers().last();
            let of_last = last.map_or(0..0, |layer| layer.weights..layer.biases);
            for weight in &mut network.parameters_mut()[of_last] {
                *weight = T::from_f64(FIRST_OUTPUT * weight.to_f64());
            }
        }
        let learner = Learner {
            network,
            features,
            outputs,
        };
        Ok(Session::of(recordings, options, learner))
    }
}

/// Of all that the weights depend on.
fn fingerprint(training: &Training<'_>, options: &Options) -> String {
    let logs = training.logs.iter().chain(training.held_out);
    let logs: Vec<&str> = logs.map(|log| log.sha256.as_str()).collect();
    let text = format!(
        "{} {} {:?} {options:?}",
        env!("CARGO_PKG_VERSION"),
        training.model.sha256(),
        logs
    );
    crate::disk::sha256(text.as_bytes())
}

fn trained<T: Real>(
    training: &Training<'_>,
    options: &Options,
    session: &Session<'_, T>,
    (without_network, overlap): (Option<f64>, Option<f64>),
) -> Result<Trained, Error> {
    let model = training.model;
    let best_epoch = session.best_epoch();
    let best = session
        .history
        .iter()
        .find(|epoch| epoch.epoch == best_epoch);
    let diverged = best.map_or(0, |epoch| epoch.held_out_diverged);
    if 2 * diverged > session.windows_held_out() {
        return Err(Error::Unfittable {
            diverged,
            windows: session.windows_held_out(),
        });
    }
    let force = session.force(&session.best)?;
    let seen = session.recordings.seen_states(force.features());
    let force = force.trained_on(&seen);
    let names: Vec<String> = model.inputs.iter().map(|i| i.name.clone()).collect();
    let inputs: Vec<&str> = names.iter().map(String::as_str).collect();
    let constants = match options.physics {
        true => session.recordings.known(&session.best_theta, &names),
        false => Vec::new(),
    };
    let mut card = Card::of(
        &force,
        Names {
            coordinates: model.mechanics.coordinates(),
            inputs: &inputs,
        },
    );
    card.interval = Some(session.recordings.interval);
    let laws: Vec<Law> = (0..force.outputs().len())
        .filter_map(|output| Law::of(&force, output, &seen, model))
        .collect();
    let file = |log: &Log| serde_json::json!({ "file": log.path.display().to_string(), "sha256": log.sha256 });
    let words = serde_json::json!({
        "program": concat!("pinode ", env!("CARGO_PKG_VERSION")),
        "model_sha256": model.sha256(),
        "logs": training.logs.iter().map(file).collect::<Vec<_>>(),
        "held_out": training.held_out.iter().map(file).collect::<Vec<_>>(),
        "seed": options.seed,
        "windows": session.recordings.seen.windows.len(),
        "samples_per_window": session.recordings.horizon,
        "epochs": session.history.len(),
        "best_epoch": best_epoch,
        "loss": best.map(|epoch| epoch.loss),
        "loss_held_out": best.map(|epoch| epoch.held_out),
        "windows_held_out": session.windows_held_out(),
        "windows_held_out_diverged": best.map(|epoch| epoch.held_out_diverged),
        "loss_held_out_without_network": without_network,
        "explained_by_effects": overlap,
        "constants": constants,
        "loss_in": match options.start {
            Start::Measured { .. } => "squares of SI units, from measured states",
            Start::Fitted => "squares of the sensors' noise, from fitted states; windows beyond ten of it count little more",
        },
        "precision": if options.single { "f32" } else { "f64" },
        "laws": laws,
        "range": "the features' `range` and the tensor `region` are what the windows that were learnt from cover; outside of it the force was never seen",
    });
    if let serde_json::Value::Object(words) = words {
        card.training = words;
    }
    let mut warnings = session.recordings.left_out.clone();
    warnings.extend(worse_than_none(best, without_network));
    let recordings = &session.recordings;
    warnings.extend(recordings.in_words(&session.best_held_back, &names));
    warnings.extend(recordings.rests_in_the_end());
    warnings.extend(best.and_then(|best| unlearnt(best, options, &with_positions(&force, model))));
    warnings.extend(overlap.and_then(shared));
    Ok(Trained {
        revision: revision(model, &session.recordings.hybrid, &session.best_theta),
        constants,
        force,
        card,
        laws,
        history: session.history.clone(),
        best_epoch,
        without_network,
        overlap,
        single: options.single,
        warnings,
    })
}

/// Said of a network that makes the windows held out worse.
fn worse_than_none(best: Option<&Epoch>, without_network: Option<f64>) -> Option<String> {
    let (with, without) = (best?.held_out, without_network?);
    (with > without).then(|| {
        format!(
            "the model is better without this network: held out {with:.4} with it, {without:.4} without; leave it out, or train on more data \
             or with other options"
        )
    })
}

/// So many squares of the noise are left by what has not learnt all; 1 is what the noise makes.
const LEFT: f64 = 2.0;
/// The best epoch was among the last where it is in this part of them.
const AMONG_THE_LAST: f64 = 0.95;

/// Said of a network that leaves far more than noise on what is held out; `more` is what it sees and the positions that it does not, nothing where it sees all.
fn unlearnt(best: &Epoch, options: &Options, more: &[String]) -> Option<String> {
    if options.start != Start::Fitted || best.held_out < LEFT {
        return None;
    }
    let mut cures = Vec::new();
    if !more.is_empty() {
        cures.push(format!(
            "let it see all positions: --sees {}",
            more.join(" ")
        ));
    }
    cures.push(
        match best.epoch as f64 > AMONG_THE_LAST * options.epochs as f64 {
            true if !best.polish => "give it more --epochs: it was still getting better",
            _ if options.hidden == Activation::Tanh => "give it more data or --units",
            _ => "give it more data, --units or smooth ones (--activation tanh)",
        }
        .to_owned(),
    );
    Some(format!(
        "what is held out is left with {:.1} squares of the noise a sample, where 1 is what noise makes: the network has not learnt all; {}",
        best.held_out,
        cures.join(", or ")
    ))
}

/// What a network sees and the positions that it does not, as `--sees` takes them; nothing where it sees them all.
fn with_positions(force: &LearntForce, model: &Model) -> Vec<String> {
    let coordinates = model.mechanics.coordinates();
    let inputs: Vec<&str> = model.inputs.iter().map(|i| i.name.as_str()).collect();
    let seen: Vec<Quantity> = force.features().iter().map(|f| f.quantity).collect();
    let positions = coordinates.iter().enumerate();
    let positions = positions.flat_map(|(c, coordinate)| match coordinate.wraps {
        true => vec![Quantity::Cosine(c), Quantity::Sine(c)],
        false => vec![Quantity::Position(c)],
    });
    let unseen: Vec<Quantity> = positions.filter(|q| !seen.contains(q)).collect();
    if unseen.is_empty() {
        return Vec::new();
    }
    let name = |quantity: &Quantity| match quantity {
        Quantity::Cosine(_) | Quantity::Sine(_) => {
            format!("'{}'", quantity.name(coordinates, &inputs))
        }
        _ => quantity.name(coordinates, &inputs),
    };
    seen.iter().chain(&unseen).map(name).collect()
}

/// A larger share of a network's force that effects could explain is warned of.
const SHARED: f64 = 0.05;

/// Said of a network that does what effects beside it could do.
fn shared(overlap: f64) -> Option<String> {
    (overlap > SHARED).then(|| {
        format!(
            "effects of the model could explain {:.0} % of this network's force, and did not come to take it over: their free parameters say little \
             beside it; give what is known of them with `fixed = true`, or train longer",
            100.0 * overlap
        )
    })
}

/// The model with the constants as fitted.
fn revision(model: &Model, hybrid: &Hybrid, theta: &[f64]) -> Revision {
    let mut revision = Revision::of(model);
    for (constant, &value) in hybrid.constants().iter().zip(theta) {
        match constant.id {
            ConstantId::Mechanics(k) => revision.parameter_values[k] = value,
            ConstantId::Gain(i) => revision.gains[i] = value,
            ConstantId::Zero(c) => revision.zeros[c] = value,
            ConstantId::Effect(e, k) => revision.effects[e].0.values[k] = value,
            ConstantId::Network(..) => {} // its weights are not in the model
        }
    }
    revision
}

impl Trained {
    /// Writes [`WEIGHTS`] and `model.toml`, the model with this network in it, to `dir`; returns the path of the model.
    ///
    /// # Errors
    /// As [`Model::write_revision`].
    pub fn write(&self, model: &Model, dir: &Path) -> Result<PathBuf, Error> {
        write_ensemble(std::slice::from_ref(self), model, None, dir)
    }
}
