//! The logs of the bench.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{Error, Truth};
use crate::config::{Config, NoiseLevel};
use crate::joints::{Bench, KINDS};
use crate::rig::{
    self, Base, CASES, CHOICES, Dirt, FORM_CASES, Forms, Hidden, Sampling, Scene, UNSEEN, draw_of,
    draw_several, draw_suspects,
};

/// The three noise levels.
pub const NOISES: [NoiseLevel; 3] = [NoiseLevel::Low, NoiseLevel::Realistic, NoiseLevel::High];

/// A mechanism to hide effects in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rig {
    /// The cart-pole of the paper
    Cartpole,
    /// Furuta's pendulum: a driven arm, a pendulum that swings
    Furuta,
    /// An arm with seven driven joints
    Arm,
}

impl Rig {
    /// Its name in lines.
    pub fn name(self) -> &'static str {
        match self {
            Rig::Cartpole => "cartpole",
            Rig::Furuta => "furuta",
            Rig::Arm => "arm",
        }
    }
}

/// What is hidden, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Set {
    /// One effect
    One,
    /// One effect, a tenth of its size
    Small,
    /// One effect of a hundredth to a tenth of its size
    Limit,
    /// Nothing
    Nothing,
    /// Two effects
    Pairs,
    /// Three effects
    Triples,
    /// One effect that has been taken out of the library, with the kinds that contain it
    Removed,
    /// One effect beside eleven small disturbances
    Dirty,
    /// One effect; rows come early, late or never, and with few decimals
    Uneven,
    /// One effect of another form than the library's
    Forms,
    /// One effect; masses and known frictions of the model are 5 % off, which it takes for possible
    WrongBase,
    /// What the paper suspects on its rig, all at once
    Suspects,
}

impl Set {
    /// Its name in lines and in commands.
    pub fn name(self) -> &'static str {
        match self {
            Set::One => "one",
            Set::Small => "small",
            Set::Limit => "limit",
            Set::Nothing => "nothing",
            Set::Pairs => "pairs",
            Set::Triples => "triples",
            Set::Removed => "removed",
            Set::Dirty => "dirty",
            Set::Uneven => "uneven",
            Set::Forms => "forms",
            Set::WrongBase => "wrong-base",
            Set::Suspects => "suspects",
        }
    }
}

/// Which kinds are taken in turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Kinds {
    /// Friction, drag, springs, a constant force, gain and delay of the input
    Basic,
    /// Everything that a log can show
    All,
}

/// A log of the bench. The same case is the same log, bit for bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Case {
    /// The mechanism.
    pub rig: Rig,
    /// What is hidden, and how.
    pub set: Set,
    /// The kinds that the seed takes its turn of.
    pub kinds: Kinds,
    /// The noise level.
    pub noise: NoiseLevel,
    /// Seed of everything random on the rig.
    pub seed: u64,
    /// Length of the log, s; none for the usual one.
    pub duration: Option<u32>,
    /// Rows a second, Hz; none for the usual number.
    pub rate: Option<u32>,
}

/// What the bench has of a case before the diagnosis.
#[derive(Debug, Clone)]
pub(super) struct Prepared {
    pub hidden: Vec<Truth>,
    /// The hidden effects are of the library's forms.
    pub in_library: bool,
    pub size: f64,
    pub duration: f64,
    /// Factors on the model's constants that make them the rig's.
    pub masses: Option<Vec<f64>>,
    /// Factors on the values of the model's effects: kind, target, factor.
    pub known: Vec<(&'static str, &'static str, f64)>,
    pub model: PathBuf,
    pub log: PathBuf,
    /// Another recording of the same rig.
    pub fresh: PathBuf,
}

/// How far masses and known frictions are off in [`Set::WrongBase`].
const WRONG_SHARE: f64 = 0.05;
/// The seed of the recording that the diagnosis does not have, over that of its log.
const FRESH: u64 = 1 << 40;
/// Length of that recording, s.
const FRESH_DURATION: f64 = 20.0;
/// Length of the logs of the rigs of joints, s.
const JOINTS_DURATION: f64 = 60.0;

impl Case {
    /// `cartpole/one/realistic/1007`, with `/basic` where not all kinds are drawn from, `/20s` where the length is another and `/1000Hz`
    /// where the rate is.
    pub fn id(&self) -> String {
        let noise = match self.noise {
            NoiseLevel::Low => "low",
            NoiseLevel::Realistic => "realistic",
            NoiseLevel::High => "high",
        };
        let kinds = match self.kinds {
            Kinds::All => "",
            Kinds::Basic => "/basic",
        };
        let (rig, set) = (self.rig.name(), self.set.name());
        let length = self.duration.map_or(String::new(), |s| format!("/{s}s"));
        let rate = self.rate.map_or(String::new(), |hz| format!("/{hz}Hz"));
        format!("{rig}/{set}/{noise}/{}{kinds}{length}{rate}", self.seed)
    }

    /// What is hidden, and the factor on its size.
    fn scene(&self, config: &Config) -> (Scene, f64) {
        let seed = self.seed;
        let cases: Vec<usize> = match self.kinds {
            Kinds::Basic => (0..CASES).collect(),
            Kinds::All => (0..CHOICES).filter(|case| *case != UNSEEN).collect(),
        };
        let turn = |count: usize| (seed % count as u64) as usize;
        let case = |k: usize| cases.get(k % cases.len()).copied().unwrap_or_default();
        let one = || draw_of(config, case(turn(cases.len())), seed);
        let mut size = 1.0;
        // A kind whose size is no number gives its turn to the next one.
        let scaled = |factor: f64| {
            (0..cases.len())
                .map(|k| draw_of(config, case(turn(cases.len()) + k), seed))
                .find_map(|hidden| hidden.scaled(factor, &config.known))
                .unwrap_or(Hidden::Nothing)
        };
        let scene = match self.set {
            Set::Nothing => Scene::default(),
            Set::One | Set::Removed => Scene::of(&one()),
            Set::Small => {
                size = 0.1;
                Scene::of(&scaled(size))
            }
            Set::Limit => {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                size = 10f64.powf(rng.random_range(-2.0..-1.0));
                Scene::of(&scaled(size))
            }
            Set::Pairs => Scene {
                hidden: draw_several(config, 2, seed),
                ..Scene::default()
            },
            Set::Triples => Scene {
                hidden: draw_several(config, 3, seed),
                ..Scene::default()
            },
            Set::Dirty => Scene {
                dirt: Some(Dirt::draw(seed)),
                ..Scene::of(&one())
            },
            Set::Uneven => Scene {
                sampling: Some(Sampling::draw(seed)),
                ..Scene::of(&one())
            },
            Set::Forms => {
                let index = turn(FORM_CASES.len());
                let case = FORM_CASES.get(index).copied().unwrap_or_default();
                Scene {
                    forms: Some(Forms::draw(seed)),
                    ..Scene::of(&draw_of(config, case, seed))
                }
            }
            Set::WrongBase => Scene {
                base: Some(Base::draw(WRONG_SHARE, seed)),
                ..Scene::of(&one())
            },
            Set::Suspects => Scene {
                hidden: draw_suspects(config, seed),
                ..Scene::default()
            },
        };
        (scene, size)
    }

    /// Writes log, model and another recording to `dir`.
    pub(super) fn prepare(&self, models: &Path, dir: &Path) -> Result<Prepared, Error> {
        match self.rig {
            Rig::Cartpole => self.prepare_cartpole(&models.join("cartpole"), dir),
            _ if self.rate.is_some() => Err(Error::OneRate {
                rig: self.rig.name(),
            }),
            Rig::Furuta => self.prepare_joints(&Bench::furuta(models)?, dir),
            Rig::Arm => self.prepare_joints(&Bench::arm(models)?, dir),
        }
    }

    fn prepare_joints(&self, bench: &Bench, dir: &Path) -> Result<Prepared, Error> {
        let fault = match self.set {
            Set::Nothing => None,
            Set::One | Set::Removed => {
                Some(bench.draw((self.seed % KINDS.len() as u64) as usize, self.seed)?)
            }
            _ => {
                return Err(Error::NoSuchSet {
                    set: self.set.name(),
                    rig: self.rig.name(),
                });
            }
        };
        let (log, fresh) = (dir.join("log.csv"), dir.join("fresh.csv"));
        let duration = self.duration.map_or(JOINTS_DURATION, f64::from);
        bench
            .run(fault.as_slice(), self.noise, duration, self.seed)?
            .write_csv(&log)?;
        let other = self.seed.wrapping_add(FRESH);
        bench
            .run(fault.as_slice(), self.noise, FRESH_DURATION, other)?
            .write_csv(&fresh)?;
        let model = bench.known_model(fault.as_slice(), &dir.join("user"))?;
        let hidden = fault.iter().map(|fault| Truth {
            kind: fault.kind.to_owned(),
            target: bench.target_name(fault).to_owned(),
            parameters: fault
                .parameters
                .iter()
                .map(|(name, value)| ((*name).to_owned(), *value))
                .collect(),
        });
        Ok(Prepared {
            hidden: hidden.collect(),
            in_library: true,
            size: 1.0,
            duration,
            masses: None,
            known: Vec::new(),
            model,
            log,
            fresh,
        })
    }

    fn prepare_cartpole(&self, models: &Path, dir: &Path) -> Result<Prepared, Error> {
        let mut config = Config::read(&models.join("rig.toml"))?;
        config.noise = self.noise;
        if let Some(duration) = self.duration {
            config.duration = f64::from(duration);
        }
        if let Some(rate) = self.rate {
            config.rate = f64::from(rate);
        }
        let (scene, size) = self.scene(&config);
        let (log, fresh) = (dir.join("log.csv"), dir.join("fresh.csv"));
        rig::run_scene(&config, &scene, self.seed)?.write_csv(&log)?;
        let again = Config {
            duration: FRESH_DURATION.min(config.duration),
            ..config.clone()
        };
        rig::run_scene(&again, &scene, self.seed.wrapping_add(FRESH))?.write_csv(&fresh)?;
        let model = rig::known_model_without(&scene.hidden, models, &dir.join("user"))?;
        if self.set == Set::WrongBase {
            loosen(&model)?;
        }
        let hidden = scene.hidden.iter().map(truth).collect();
        Ok(Prepared {
            hidden,
            in_library: scene.forms.is_none() && scene.dirt.is_none(),
            size,
            duration: config.duration,
            masses: scene.masses(),
            known: scene.base.map_or_else(Vec::new, |base| {
                let [slider, pole] = base.friction;
                vec![
                    ("coulomb_friction", "slider", slider),
                    ("viscous_friction", "pole", pole),
                ]
            }),
            model,
            log,
            fresh,
        })
    }
}

fn truth(hidden: &Hidden) -> Truth {
    Truth {
        kind: hidden.kind().to_owned(),
        target: hidden.target().map_or("", |t| t.name()).to_owned(),
        parameters: hidden
            .parameters()
            .into_iter()
            .map(|(name, value)| (name.to_owned(), value))
            .collect(),
    }
}

/// The model knows its masses to 5 % only.
fn loosen(model: &Path) -> Result<(), Error> {
    let text = std::fs::read_to_string(model).map_err(Error::io(model))?;
    let mut document: toml_edit::DocumentMut =
        text.parse().map_err(|e: toml_edit::TomlError| {
            Error::io(model)(std::io::Error::other(e.to_string()))
        })?;
    document["tolerance"]["mass"] = toml_edit::value(WRONG_SHARE);
    std::fs::write(model, document.to_string()).map_err(Error::io(model))
}
