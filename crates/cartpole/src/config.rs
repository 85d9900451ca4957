//! The rig's settings: one TOML file, units in its comments, unknown keys refused.

use std::path::{Path, PathBuf};

use lagrange::{Position, Problem, Problems};
use serde::{Deserialize, Serialize};

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
    /// Moves end within ± this, m.
    pub reach: f64,
    /// Force per displacement from the intended place, N/m.
    pub stiffness: f64,
    /// Force per velocity beside the intended one, N·s/m.
    pub damping: f64,
    /// Mass that the hand expects to accelerate, kg.
    pub mass: f64,
    /// Force per displacement beyond the reach, N/m.
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

/// Ranges of the sizes of hidden effects, as `[smallest, largest]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HiddenRanges {
    /// Coefficients, N·s/m and N·m·s/rad.
    pub viscous_friction: BothJoints,
    /// Forces, N and N·m.
    pub coulomb_friction: BothJoints,
    /// Force added one way and taken the other, N; either sign.
    pub asymmetric_coulomb_friction: Slider,
    /// Static force above the sliding one, N, and the Stribeck velocity, m/s.
    pub stribeck_friction: Stribeck,
    /// Coefficients, N·s²/m² and N·m·s²/rad².
    pub quadratic_drag: BothJoints,
    /// Stiffness, N/m, and rest position, m.
    pub linear_spring: Spring,
    /// Stiffness, N/m³.
    pub cubic_spring: Slider,
    /// Force, N; either sign.
    pub constant_force: Slider,
    /// Share of the input; either sign.
    pub input_gain_error: Motor,
    /// Delay, s.
    pub input_delay: Motor,
    /// Between motor and cart.
    pub backlash: Backlash,
    /// Mean coefficients, N·s/m and N·m·s/rad, and how far the two directions are from it.
    pub asymmetric_viscous_friction: AsymmetricViscous,
    /// Slope along the rail, N/m; either sign.
    pub position_dependent_friction: Slider,
    /// Ratio of friction to the motor's force.
    pub load_dependent_friction: Slider,
    /// Amplitude, N, and period, m.
    pub periodic_force: Periodic,
    /// N of the input; either sign.
    pub input_offset: Motor,
    /// Time constant, s.
    pub actuator_lag: Motor,
    /// Half width, N of the input.
    pub input_dead_zone: Motor,
    /// Largest force, N of the input.
    pub input_saturation: Motor,
    /// The string between motor and cart.
    pub elastic_transmission: ElasticTransmission,
    /// Zeros of the sensors, m and rad; either sign.
    pub sensor_offset: BothJoints,
    /// Share of the reading; either sign.
    pub sensor_scale: Slider,
    /// Delay, s.
    pub sensor_delay: BothJoints,
    /// Coulomb force, N, in place of the known one, and stiffness.
    pub dahl_friction: Dahl,
    /// Static force above the known sliding one, N, and what the bristles are like.
    pub lugre_friction: LuGre,
    /// Stiffness, N/m, of a spring that slips, and the half width of its loop.
    pub hysteresis: Hysteresis,
}

/// A range for each joint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BothJoints {
    /// On the cart.
    pub slider: Range,
    /// On the pole.
    pub pole: Range,
}

/// A range on the cart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slider {
    /// On the cart.
    pub slider: Range,
}

/// A range on the input.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// On the motor.
    pub motor: Range,
}

/// Ranges of Stribeck friction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stribeck {
    /// Static force above the sliding one, N.
    pub slider: Range,
    /// Stribeck velocity, m/s.
    pub velocity: Range,
}

/// Ranges of backlash.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backlash {
    /// Way of the motor from one flank to the other with the cart at rest, m.
    pub motor: Range,
    /// Relative speed after a blow over that before.
    pub restitution: Range,
    /// The part of the mass that slides that is the motor's, kg.
    pub motor_inertia: Range,
}

/// Ranges of a linear spring.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spring {
    /// Stiffness, N/m.
    pub slider: Range,
    /// Where it pulls to, m.
    pub rest: Range,
}

/// Ranges of viscous friction that depends on the direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AsymmetricViscous {
    /// Mean of the two coefficients on the cart, N·s/m.
    pub slider: Range,
    /// Mean of the two coefficients on the pole, N·m·s/rad.
    pub pole: Range,
    /// Share of the mean that one direction has more and the other less; either sign.
    pub difference: Range,
}

/// Ranges of a force that repeats along the rail.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Periodic {
    /// Amplitude, N.
    pub slider: Range,
    /// Period, m.
    pub period: Range,
}

/// Ranges of an elastic string between motor and cart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElasticTransmission {
    /// √(k/J)/2π, the motor's frequency on its string with the cart held, Hz.
    pub frequency: Range,
    /// c/(2 √(k J)), its damping ratio with the cart held.
    pub damping_ratio: Range,
    /// J, beside the mass that slides, kg.
    pub motor_inertia: Range,
}

/// Ranges of Dahl's friction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dahl {
    /// Coulomb force, N.
    pub slider: Range,
    /// Stiffness at rest, N/m.
    pub stiffness: Range,
}

/// Ranges of LuGre friction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LuGre {
    /// Static force above the sliding one, N.
    pub slider: Range,
    /// Stribeck velocity, m/s.
    pub velocity: Range,
    /// Stiffness of the bristles, N/m.
    pub stiffness: Range,
    /// Damping of the bristles, N·s/m.
    pub damping: Range,
}

/// Ranges of a spring that slips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hysteresis {
    /// Stiffness, N/m.
    pub slider: Range,
    /// Half width of its loop, m: it slips where it is stretched by this.
    pub width: Range,
}

impl Config {
    /// Reads and checks a settings file; `urdf` is taken relative to its folder.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Io {
            path: path.to_owned(),
            source,
        })?;
        let mut config = Self::parse(&text, &path.display().to_string())?;
        if let Some(folder) = path.parent() {
            config.urdf = folder.join(&config.urdf);
        }
        Ok(config)
    }

    /// Reads and checks settings; `source` is what errors call the text.
    pub fn parse(text: &str, source: &str) -> Result<Self, ConfigError> {
        let problems = |list| {
            ConfigError::Problems(Problems {
                source: source.to_owned(),
                list,
            })
        };
        let config: Config = toml::from_str(text).map_err(|error| {
            let message = error.message().to_owned();
            problems(vec![match error.span() {
                Some(span) => Problem::at(Position::of(text, span.start), message),
                None => Problem::general(message),
            }])
        })?;
        let mut list: Vec<Problem> = config
            .faults()
            .into_iter()
            .map(|(key, message)| Problem {
                position: position_of(text, &key),
                message: format!("{key} {message}"),
            })
            .collect();
        if list.is_empty() {
            return Ok(config);
        }
        list.sort_by_key(|p| p.position);
        Err(problems(list))
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
            let key = |field: &str| format!("noise_levels.{name}.{field}");
            check.number(&key("ultrasonic"), level.ultrasonic, 0.0, 1.0);
            check.number(&key("outlier_share"), level.outlier_share, 0.0, 1.0);
            check.number(&key("outlier_size"), level.outlier_size, 0.0, 10.0);
            let counts = f64::from(level.encoder_counts);
            check.number(&key("encoder_counts"), counts, 2.0, 1e9);
            check.number(&key("cart_force"), level.cart_force, 0.0, 1e3);
            check.number(&key("cart_force_time"), level.cart_force_time, 1e-3, 1e3);
        }
        let o = &self.operator;
        check.range("operator.move_time", o.move_time, 0.02, 1e3);
        check.range("operator.move_length", o.move_length, 1e-6, 1e3);
        check.range("operator.dwell", o.dwell, 0.0, 1e3);
        check.number("operator.reach", o.reach, 1e-3, self.rail.limit);
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
        let h = &self.hidden;
        let sizes = [
            ("viscous_friction.slider", h.viscous_friction.slider),
            ("viscous_friction.pole", h.viscous_friction.pole),
            ("coulomb_friction.slider", h.coulomb_friction.slider),
            ("coulomb_friction.pole", h.coulomb_friction.pole),
            ("stribeck_friction.slider", h.stribeck_friction.slider),
            ("quadratic_drag.slider", h.quadratic_drag.slider),
            ("quadratic_drag.pole", h.quadratic_drag.pole),
            ("linear_spring.slider", h.linear_spring.slider),
            ("cubic_spring.slider", h.cubic_spring.slider),
            ("constant_force.slider", h.constant_force.slider),
        ];
        for (key, range) in sizes {
            check.range(&format!("hidden.{key}"), range, 0.0, 1e6);
        }
        check.range(
            "hidden.asymmetric_coulomb_friction.slider",
            h.asymmetric_coulomb_friction.slider,
            0.0,
            slider_coulomb_friction, // neither side may push
        );
        check.range(
            "hidden.stribeck_friction.velocity",
            h.stribeck_friction.velocity,
            1e-4,
            1e3,
        );
        let rest = h.linear_spring.rest;
        check.range("hidden.linear_spring.rest", rest, -1e3, 1e3);
        let gain = h.input_gain_error.motor;
        check.range("hidden.input_gain_error.motor", gain, 0.0, 0.99);
        let delay = h.input_delay.motor;
        check.range("hidden.input_delay.motor", delay, 0.0, 10.0);
        let b = h.backlash;
        check.range("hidden.backlash.motor", b.motor, 1e-6, 1.0);
        check.range("hidden.backlash.restitution", b.restitution, 0.0, 1.0);
        check.range("hidden.backlash.motor_inertia", b.motor_inertia, 1e-6, 1e6);
        let (a, e, g) = (
            h.asymmetric_viscous_friction,
            h.elastic_transmission,
            h.lugre_friction,
        );
        let (delay, lag) = (h.sensor_delay, h.actuator_lag.motor);
        let steepest = slider_coulomb_friction / self.rail.limit; // friction may not push at the end of the rail
        let bounded = [
            ("asymmetric_viscous_friction.slider", a.slider, 0.0, 1e6),
            ("asymmetric_viscous_friction.pole", a.pole, 0.0, 1e6),
            (
                "asymmetric_viscous_friction.difference",
                a.difference,
                0.0,
                1.0,
            ),
            (
                "position_dependent_friction.slider",
                h.position_dependent_friction.slider,
                0.0,
                steepest,
            ),
            (
                "load_dependent_friction.slider",
                h.load_dependent_friction.slider,
                0.0,
                0.99,
            ),
            ("periodic_force.slider", h.periodic_force.slider, 0.0, 1e6),
            ("periodic_force.period", h.periodic_force.period, 1e-3, 1e3),
            ("input_offset.motor", h.input_offset.motor, 0.0, 1e6),
            ("actuator_lag.motor", lag, 1e-3, 10.0),
            ("input_dead_zone.motor", h.input_dead_zone.motor, 0.0, 1e6),
            (
                "input_saturation.motor",
                h.input_saturation.motor,
                1e-3,
                1e6,
            ),
            ("elastic_transmission.frequency", e.frequency, 1e-2, 100.0),
            (
                "elastic_transmission.damping_ratio",
                e.damping_ratio,
                0.0,
                1.0,
            ),
            (
                "elastic_transmission.motor_inertia",
                e.motor_inertia,
                1e-4,
                1e6,
            ),
            ("sensor_offset.slider", h.sensor_offset.slider, 0.0, 1e3),
            ("sensor_offset.pole", h.sensor_offset.pole, 0.0, 1e3),
            ("sensor_scale.slider", h.sensor_scale.slider, 0.0, 0.99),
            ("sensor_delay.slider", delay.slider, 0.0, 10.0),
            ("sensor_delay.pole", delay.pole, 0.0, 10.0),
            ("dahl_friction.slider", h.dahl_friction.slider, 1e-6, 1e6),
            (
                "dahl_friction.stiffness",
                h.dahl_friction.stiffness,
                1e-6,
                1e6,
            ),
            ("lugre_friction.slider", g.slider, 0.0, 1e6),
            ("lugre_friction.velocity", g.velocity, 1e-4, 1e3),
            ("lugre_friction.stiffness", g.stiffness, 1e-6, 1e6),
            ("lugre_friction.damping", g.damping, 0.0, 1e6),
            ("hysteresis.slider", h.hysteresis.slider, 1e-6, 1e6),
            ("hysteresis.width", h.hysteresis.width, 1e-6, 1e3),
        ];
        for (key, range, least, most) in bounded {
            check.range(&format!("hidden.{key}"), range, least, most);
        }
        check.0
    }
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
