//! From the options to the settings of the rig and the effect it hides.

use std::path::{Path, PathBuf};

use super::{Choice, Error, Options};
use crate::config::Config;
use crate::rig::{CHOICES, Hidden, draw, draw_any, draw_of};

/// What a run of the program works with.
pub(super) struct Setting {
    pub config: Config,
    pub hidden: Hidden,
    pub seed: u64,
    /// Whether nobody knows what is hidden until the diagnosis is there.
    pub drawn: bool,
    /// Whether nobody is told afterwards either.
    pub secret: bool,
    /// The file that tells what is hidden.
    pub key: PathBuf,
    /// The folder of the models.
    pub models: PathBuf,
    /// The folder of everything that is written.
    pub out: PathBuf,
}

impl Setting {
    pub fn read(options: &Options, seed: u64) -> Result<Self, Error> {
        let models = options.models.clone().unwrap_or_else(models);
        let mut config = Config::read(&models.join("rig.toml"))?;
        if let Some(noise) = options.noise {
            config.noise = noise.into();
        }
        if let Some(duration) = options.duration {
            config.duration = duration;
        }
        let hidden = match (&options.effect, options.nothing) {
            (_, true) => Hidden::Nothing,
            (Some(name), false) => chosen(&config, name, seed)?,
            (None, false) => match options.from {
                Choice::Basic => draw(&config, seed),
                Choice::All => draw_any(&config, seed),
            },
        };
        Ok(Setting {
            config,
            hidden,
            seed,
            drawn: options.effect.is_none() && !options.nothing,
            secret: options.secret.is_some(),
            key: key(options),
            models,
            out: options.out.clone(),
        })
    }
}

/// Where the key goes.
fn key(options: &Options) -> PathBuf {
    match (&options.key, options.secret, options.out.file_name()) {
        (Some(key), _, _) => key.clone(),
        (None, Some(_), Some(name)) => {
            let mut name = name.to_owned();
            name.push(".key.json");
            options.out.with_file_name(name)
        }
        _ => options.out.join("key.json"),
    }
}

/// `models/cartpole` of the working folder, or else of the sources that this program was built from.
pub(super) fn models() -> PathBuf {
    let here = Path::new("models/cartpole");
    match here.join("rig.toml").exists() {
        true => here.to_owned(),
        false => Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole"),
    }
}

/// The effect called `KIND[@TARGET]`, with a drawn size.
fn chosen(config: &Config, name: &str, seed: u64) -> Result<Hidden, Error> {
    let (kind, target) = match name.split_once('@') {
        Some((kind, target)) => (kind, Some(target)),
        None => (name, None),
    };
    let all: Vec<Hidden> = (0..CHOICES)
        .map(|case| draw_of(config, case, seed))
        .collect();
    let matching: Vec<&Hidden> = all
        .iter()
        .filter(|h| h.kind() == kind)
        .filter(|h| target.is_none() || h.target().map(|t| t.name()) == target)
        .collect();
    // One of them for every seed, all of them over the seeds.
    let index = seed.checked_rem(matching.len() as u64).unwrap_or(0) as usize;
    match matching.get(index) {
        Some(&&hidden) => Ok(hidden),
        None => {
            let names: Vec<String> = all
                .iter()
                .map(|h| format!("{}@{}", h.kind(), h.target().map_or("", |t| t.name())))
                .collect();
            Err(Error::NoSuchEffect(format!(
                "the rig cannot hide `{name}`: give one of {}",
                names.join(", ")
            )))
        }
    }
}
