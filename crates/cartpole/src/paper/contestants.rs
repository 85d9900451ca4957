//! The models that the experiment compares.

use std::path::{Path, PathBuf};

use pinode_nn::learnt::Quantity;
use pinode_nn::log::Log;
use pinode_nn::model::{Model, Revision};
use pinode_nn::train::{Options, Start, Training, fit_physics, train};

use super::Error;
use super::stand::Known;

/// A model that learns from a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Contestant {
    /// Eq. 13: Coulomb friction of what is driven and viscous friction of what is free, fitted by least squares to one step from the measured state.
    Ode,
    /// The same effects, fitted to windows of 0.4 s with free initial states.
    OdeOnWindows,
    /// PINODE as published: the network alone on what is driven, one step, λ₁ = λ₂ = 1.
    Pinode,
    /// This library's: delay, frictions and the motor's inertia fitted, a network for what they leave beside them, windows of 0.4 s with fitted
    /// initial states.
    Ours,
    /// No mechanics: q̈ = Q_NN(q, q̇, u), trained as PINODE as published.
    BlackBox,
    /// Nothing but the velocity at the start.
    ConstantVelocity,
}

impl Contestant {
    /// All of them.
    pub const ALL: [Contestant; 6] = [
        Contestant::ConstantVelocity,
        Contestant::BlackBox,
        Contestant::Ode,
        Contestant::OdeOnWindows,
        Contestant::Pinode,
        Contestant::Ours,
    ];

    /// What it is, for people.
    pub fn title(self) -> &'static str {
        match self {
            Contestant::Ode => "pure ODE (eq. 13), one step",
            Contestant::OdeOnWindows => "pure ODE, windows of 0.4 s",
            Contestant::Pinode => "PINODE as published",
            Contestant::Ours => "ours: effects, and a network for the rest",
            Contestant::BlackBox => "black box",
            Contestant::ConstantVelocity => "constant velocity",
        }
    }

    /// The name of its folder.
    pub fn folder(self) -> &'static str {
        match self {
            Contestant::Ode => "ode",
            Contestant::OdeOnWindows => "ode-on-windows",
            Contestant::Pinode => "pinode",
            Contestant::Ours => "ours",
            Contestant::BlackBox => "black-box",
            Contestant::ConstantVelocity => "constant-velocity",
        }
    }

    /// What it has beside the masses.
    fn effects(self, known: &Known) -> &'static str {
        match self {
            Contestant::Ode | Contestant::OdeOnWindows => known.frictions,
            Contestant::Pinode => known.held,
            Contestant::Ours => known.suspects,
            Contestant::BlackBox | Contestant::ConstantVelocity => "",
        }
    }

    fn options(self, seed: u64, epochs: Option<usize>) -> Options {
        let published = Options::paper(vec![DRIVEN]);
        let own = match self {
            Contestant::Ode => Options {
                physics: true,
                alone: false,
                ..published
            },
            Contestant::OdeOnWindows | Contestant::ConstantVelocity => Options::new(vec![DRIVEN]),
            Contestant::Ours => Options {
                epochs: 150,
                ..Options::new(vec![DRIVEN])
            },
            Contestant::BlackBox => Options {
                joints: vec![DRIVEN, FREE],
                ..published
            },
            Contestant::Pinode => Options {
                // cos φ, sin φ, ẋ, φ̇ and u: 5,451 parameters.
                quantities: vec![
                    Quantity::Cosine(FREE),
                    Quantity::Sine(FREE),
                    Quantity::Velocity(DRIVEN),
                    Quantity::Velocity(FREE),
                    Quantity::Input { input: 0, back: 0 },
                ],
                ..published
            },
        };
        Options {
            seed,
            epochs: epochs.unwrap_or(own.epochs),
            ..own
        }
    }

    /// Learns from `log`, and writes its model and what belongs to it to `folder`; returns the model's path.
    ///
    /// # Errors
    /// Those of [`train`], and of files.
    pub fn learn(
        self,
        known: &Known,
        log: &Log,
        folder: &Path,
        seed: u64,
        epochs: Option<usize>,
    ) -> Result<PathBuf, Error> {
        let model = Model::parse(&known.path, known.text.clone() + self.effects(known))?;
        let model = match self {
            Contestant::BlackBox => model.without_mechanics(true)?,
            Contestant::ConstantVelocity => model.without_mechanics(false)?,
            _ => model,
        };
        let options = self.options(seed, epochs);
        debug_assert!(options.start != Start::Fitted || options.horizon > 0.0);
        let training = Training {
            model: &model,
            logs: std::slice::from_ref(log),
            held_out: &[],
        };
        Ok(match self {
            Contestant::Ode | Contestant::OdeOnWindows => {
                let revision = fit_physics(&training, &options)?.revision;
                model.write_revision(folder, "model.toml", &revision)?
            }
            Contestant::ConstantVelocity => {
                model.write_revision(folder, "model.toml", &Revision::of(&model))?
            }
            Contestant::Pinode | Contestant::Ours | Contestant::BlackBox => {
                train(&training, &options, None, &mut |_| Ok(()))?.write(&model, folder)?
            }
        })
    }
}

/// The coordinates of a [`Stand`](super::stand::Stand).
const DRIVEN: usize = 0;
const FREE: usize = 1;
