//! The models that the experiment compares.

use std::path::{Path, PathBuf};

use pinode_nn::learnt::Quantity;
use pinode_nn::log::Log;
use pinode_nn::model::{Model, Revision};
use pinode_nn::train::{Options, Start, Training, fit_physics, train};

use super::Error;

/// A model that learns from a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Contestant {
    /// Eq. 13: Coulomb friction of the cart and viscous friction of the pole, fitted by least squares to one step from the measured state.
    Ode,
    /// The same effects, fitted to windows of 0.4 s with free initial states.
    OdeOnWindows,
    /// PINODE as published: the network alone on the cart, one step, λ₁ = λ₂ = 1.
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

    /// What it has beside the masses: values to start from, which it fits; the pole's friction of Table 2 stays where the paper keeps it.
    fn effects(self) -> &'static str {
        match self {
            Contestant::Ode | Contestant::OdeOnWindows => COULOMB_AND_VISCOUS,
            Contestant::Pinode => FIXED_VISCOUS,
            Contestant::Ours => SUSPECTS,
            Contestant::BlackBox | Contestant::ConstantVelocity => "",
        }
    }

    fn options(self, seed: u64, epochs: Option<usize>) -> Options {
        let published = Options::paper(vec![SLIDER]);
        let own = match self {
            Contestant::Ode => Options {
                physics: true,
                alone: false,
                ..published
            },
            Contestant::OdeOnWindows | Contestant::ConstantVelocity => Options::new(vec![SLIDER]),
            Contestant::Ours => Options {
                epochs: 150,
                ..Options::new(vec![SLIDER])
            },
            Contestant::BlackBox => Options {
                joints: vec![SLIDER, POLE],
                ..published
            },
            Contestant::Pinode => Options {
                // cos φ, sin φ, ẋ, φ̇ and u: 5,451 parameters.
                quantities: vec![
                    Quantity::Cosine(POLE),
                    Quantity::Sine(POLE),
                    Quantity::Velocity(SLIDER),
                    Quantity::Velocity(POLE),
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
        known: &Path,
        log: &Log,
        folder: &Path,
        seed: u64,
        epochs: Option<usize>,
    ) -> Result<PathBuf, Error> {
        let text = std::fs::read_to_string(known).map_err(|e| pinode_nn::Error::io(known, e))?;
        let model = Model::parse(known, text + self.effects())?;
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

/// The coordinates of the cart-pole.
const SLIDER: usize = 0;
const POLE: usize = 1;

/// Eq. 13, with Table 2's factors to start from: μ_c (m_c + m_p + m_s) g, and μ_p.
const COULOMB_AND_VISCOUS: &str = r#"
[[effect]]
kind  = "coulomb_friction"
joint = "slider"
force = 0.215333424               # N

[[effect]]
kind  = "viscous_friction"
joint = "pole"
coefficient = 0.0020              # N·m·s/rad

[tolerance]
mass = 0.0                        # Table 2 is believed
gain = 0.0
zero = { slider = 0.0, pole = 0.0 }
"#;

/// "Viscous friction kept for the pole".
const FIXED_VISCOUS: &str = r#"
[[effect]]
kind  = "viscous_friction"
joint = "pole"
coefficient = 0.0020              # N·m·s/rad
fixed = true
"#;

/// What is suspected before anything is learnt, the string's motor among it as far as a stiff one carries it along.
const SUSPECTS: &str = r#"
[[effect]]
kind  = "input_delay"
input = "motor"
delay = 0.02                      # s

[[effect]]
kind  = "asymmetric_coulomb_friction"
joint = "slider"
force_positive = 0.2              # N
force_negative = 0.2

[[effect]]
kind  = "viscous_friction"
joint = "pole"
coefficient = 0.0020              # N·m·s/rad

[[effect]]
kind  = "reflected_inertia"
joint = "slider"
inertia = 0.0                     # kg

[tolerance]
mass = 0.0                        # Table 2 is believed
gain = 0.0
"#;
