//! The rig's settings: one TOML file, units in its comments, unknown keys refused.

mod hidden;
mod paper;

use std::path::{Path, PathBuf};

use lagrange::{Position, Problem, Problems};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

pub use hidden::*;
pub use paper::*;

/// A closed range `[smallest, largest]`.
pub type Range = [f64; 2];

/// What a settings file may not be.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not the settings of a rig; every fault with line and column.
    #[error("{0}")]
    Problems(Problems),
}

/// Everything that makes the virtual rig.
///
/// ```
/// use cartpole::config::Config;
///
/// let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/cartpole/rig.toml");
/// let config = Config::read(path.as_ref())?;
/// assert_eq!(config.rate, 50.0);
/// # Ok::<(), cartpole::config::ConfigError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The mechanism: joints `slider` (m, along x) and `pole` (rad, 0 = upright). Relative to the settings file until read.
    pub urdf: PathBuf,
    /// Length of a recording, s.
    pub duration: f64,
    /// Rows a second, Hz; the input is held in between.
    pub rate: f64,
    /// Longest step of the integrator, s.
    pub truth_step: f64,
    /// Which noise level is in use.
    pub noise: NoiseLevel,
    /// Friction that is always there and known to the user.
    pub known: Known,
    /// The rail.
    pub rail: Rail,
    /// Sensors and disturbances at each noise level.
    pub noise_levels: NoiseLevels,
    /// The hand at the input.
    pub operator: Operator,
    /// Ranges of the sizes of hidden effects.
    pub hidden: HiddenRanges,
}

/// A name of one of the three noise levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NoiseLevel {
    /// A good laboratory.
    Low,
    /// The paper's rig; `medium` says the same.
    #[serde(alias = "medium")]
    Realistic,
    /// A poor sensor and a coarse encoder.
    High,
}

/// Friction that is always there and known to the user.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Known {
    /// Coulomb friction of the cart, N.
    pub slider_coulomb_friction: f64,
    /// Viscous friction of the pole, N·m·s/rad.
    pub pole_viscous_friction: f64,
}

/// The rail.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rail {
    /// The cart's travel to each side of x = 0, m.
    pub limit: f64,
    /// Speed after a blow on an end of it over the speed before.
    pub restitution: f64,
}

/// The noise of each level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseLevels {
    /// A good laboratory.
    pub low: Noise,
    /// The paper's rig.
    pub realistic: Noise,
    /// A poor sensor and a coarse encoder.
    pub high: Noise,
}

/// Sensors and disturbances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Standard deviation of the cart's measured position, m.
    pub ultrasonic: f64,
    /// Share of the position samples that are glitches.
    pub outlier_share: f64,
    /// Glitches are uniform within ± this, m.
    pub outlier_size: f64,
    /// Counts a turn of the pole's encoder.
    pub encoder_counts: u32,
    /// Standard deviation of an unknown force on the cart, N.
    pub cart_force: f64,
    /// Correlation time of that force, s.
    pub cart_force_time: f64,
}

/// The hand at the input: see [`crate::rig::operator`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Operator {
    /// Duration of a move, s.
    pub move_time: Range,
    /// Length of a move, m.
    pub move_length: Range,
    /// Largest acceleration of a move, m/s²; longer moves take longer.
    pub acceleration: f64,
    /// Rest between two moves, s.
    pub dwell: Range,
    /// Moves end within ± this of the centre, m.
    pub reach: f64,
    /// The place about which the hand moves the cart, m.
    #[serde(default)]
    pub centre: f64,
    /// Where it holds the cart back, m from the centre; beyond ± the reach where nothing is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<Range>,
    /// Force per displacement from the intended place, N/m.
    pub stiffness: f64,
    /// Force per velocity beside the intended one, N·s/m.
    pub damping: f64,
    /// Mass that the hand expects to accelerate, kg.
    pub mass: f64,
    /// Force per displacement beyond the reach, or beyond `hold`, N/m.
    pub guard: f64,
    /// How far ahead the hand sees the cart leave its reach, s.
    pub foresight: f64,
    /// Standard deviation of the tremor, N.
    pub tremor: f64,
    /// Correlation time of the tremor, s.
    pub tremor_time: f64,
    /// Step of the commanded force, N.
    pub resolution: f64,
    /// Largest commanded force, N.
    pub limit: f64,
}

impl Config {
    /// Reads and checks a settings file; `urdf` is taken relative to its folder.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = read_text(path)?;
        let mut config = Self::parse(&text, &path.display().to_string())?;
        if let Some(folder) = path.parent() {
            config.urdf = folder.join(&config.urdf);
        }
        Ok(config)
    }

    /// Reads and checks settings; `source` is what errors call the text.
    pub fn parse(text: &str, source: &str) -> Result<Self, ConfigError> {
        parse(text, source, Self::faults)
    }

    /// The noise level in use.
    pub fn noise(&self) -> &Noise {
        match self.noise {
            NoiseLevel::Low => &self.noise_levels.low,
            NoiseLevel::Realistic => &self.noise_levels.realistic,
            NoiseLevel::High => &self.noise_levels.high,
        }
    }

    /// Every number outside of its domain: its dotted key, and what is wrong with it.
    fn faults(&self) -> Vec<(String, String)> {
        let mut check = Check(Vec::new());
        let Known {
            slider_coulomb_friction,
            pole_viscous_friction,
        } = self.known;
        check.number("duration", self.duration, 1e-3, 1e5);
        check.number("rate", self.rate, 1.0, 1e4);
        check.number("truth_step", self.truth_step, 1e-6, 5e-4);
        check.number(
            "known.slider_coulomb_friction",
            slider_coulomb_friction,
            0.0,
            1e3,
        );
        check.number(
            "known.pole_viscous_friction",
            pole_viscous_friction,
            0.0,
            1e3,
        );
        check.number("rail.limit", self.rail.limit, 1e-3, 1e3);
        check.number("rail.restitution", self.rail.restitution, 0.0, 1.0);
        let levels = [
            ("low", &self.noise_levels.low),
            ("realistic", &self.noise_levels.realistic),
            ("high", &self.noise_levels.high),
        ];
        for (name, level) in levels {
            level.check(&format!("noise_levels.{name}"), &mut check);
        }
        self.operator.check(self.rail.limit, &mut check);
        self.hidden.check(&self.known, &self.rail, &mut check);
        check.0
    }
}

impl Noise {
    /// Numbers outside of their domain, in the table `table`.
    fn check(&self, table: &str, check: &mut Check) {
        let key = |field: &str| format!("{table}.{field}");
        check.number(&key("ultrasonic"), self.ultrasonic, 0.0, 1.0);
        check.number(&key("outlier_share"), self.outlier_share, 0.0, 1.0);
        check.number(&key("outlier_size"), self.outlier_size, 0.0, 10.0);
        let counts = f64::from(self.encoder_counts);
        check.number(&key("encoder_counts"), counts, 2.0, 1e9);
        check.number(&key("cart_force"), self.cart_force, 0.0, 1e3);
        check.number(&key("cart_force_time"), self.cart_force_time, 1e-3, 1e3);
    }
}

impl Operator {
    /// Numbers outside of their domain, where the cart's travel ends at ± `limit`, m.
    fn check(&self, limit: f64, check: &mut Check) {
        let o = self;
        check.range("operator.move_time", o.move_time, 0.02, 1e3);
        check.range("operator.move_length", o.move_length, 1e-6, 1e3);
        check.range("operator.dwell", o.dwell, 0.0, 1e3);
        check.number("operator.reach", o.reach, 1e-3, limit);
        check.number("operator.centre", o.centre, -limit, limit);
        if let Some(hold) = o.hold {
            check.range("operator.hold", hold, -2.0 * limit, 2.0 * limit);
        }
        check.number("operator.stiffness", o.stiffness, 0.0, 1e6);
        check.number("operator.damping", o.damping, 0.0, 1e6);
        check.number("operator.mass", o.mass, 0.0, 1e6);
        check.number("operator.acceleration", o.acceleration, 1e-3, 1e4);
        check.number("operator.guard", o.guard, 0.0, 1e6);
        check.number("operator.foresight", o.foresight, 0.0, 10.0);
        check.number("operator.tremor", o.tremor, 0.0, 1e3);
        check.number("operator.tremor_time", o.tremor_time, 1e-3, 1e3);
        check.number("operator.resolution", o.resolution, 1e-9, 1e3);
        check.number("operator.limit", o.limit, 1e-3, 1e6);
        // A move that is longer than the way from one end of the reach to the other could not be made.
        if o.move_length[1] > 2.0 * o.reach {
            check.0.push((
                "operator.move_length".into(),
                format!(
                    "goes up to {} m: moves end within ± reach = {} m, so give at most {} m",
                    o.move_length[1],
                    o.reach,
                    2.0 * o.reach
                ),
            ));
        }
    }
}

/// Reads settings from TOML and refuses numbers outside of their domain; `faults` gives each one's dotted key, and what is wrong.
fn parse<T: DeserializeOwned>(
    text: &str,
    source: &str,
    faults: impl Fn(&T) -> Vec<(String, String)>,
) -> Result<T, ConfigError> {
    let problems = |list| {
        ConfigError::Problems(Problems {
            source: source.to_owned(),
            list,
        })
    };
    let settings: T = toml::from_str(text).map_err(|error| {
        let message = error.message().to_owned();
        problems(vec![match error.span() {
            Some(span) => Problem::at(Position::of(text, span.start), message),
            None => Problem::general(message),
        }])
    })?;
    let mut list: Vec<Problem> = faults(&settings)
        .into_iter()
        .map(|(key, message)| Problem {
            position: position_of(text, &key),
            message: format!("{key} {message}"),
        })
        .collect();
    if list.is_empty() {
        return Ok(settings);
    }
    list.sort_by_key(|p| p.position);
    Err(problems(list))
}

/// The text of a settings file.
fn read_text(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|source| ConfigError::Io {
        path: path.to_owned(),
        source,
    })
}

/// Collects faults.
struct Check(Vec<(String, String)>);

impl Check {
    fn number(&mut self, key: &str, value: f64, least: f64, most: f64) {
        if !(least..=most).contains(&value) {
            let message = format!("is {value}: give a number from {least} to {most}");
            self.0.push((key.to_owned(), message));
        }
    }

    fn range(&mut self, key: &str, [from, to]: Range, least: f64, most: f64) {
        if !(least <= from && from <= to && to <= most) {
            let message =
                format!("is [{from}, {to}]: give [smallest, largest], both from {least} to {most}");
            self.0.push((key.to_owned(), message));
        }
    }
}

/// Where the value of a dotted key stands in the text.
fn position_of(text: &str, key: &str) -> Option<Position> {
    let document = toml_edit::Document::parse(text).ok()?;
    let mut item = document.as_item();
    for part in key.split('.') {
        item = item.get(part)?;
    }
    Some(Position::of(text, item.span()?.start))
}
