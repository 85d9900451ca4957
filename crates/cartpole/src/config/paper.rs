//! The settings of the paper's rig: one TOML file, units in its comments, unknown keys refused.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Check, ConfigError, Noise, Operator, parse, read_text};

/// Everything that makes the rig of Roehrl et al. 2020, section 4.
///
/// ```
/// use cartpole::config::PaperConfig;
///
/// let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/cartpole/paper.toml");
/// let config = PaperConfig::read(path.as_ref())?;
/// assert_eq!(config.delay, 0.030);
/// # Ok::<(), cartpole::config::ConfigError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperConfig {
    /// The mechanism: joints `slider` (m, along x) and `pole` (rad, 0 = upright). Relative to the settings file until read.
    pub urdf: PathBuf,
    /// Rows a second, Hz; the input is held in between.
    pub rate: f64,
    /// Longest step of the integrator, s.
    pub truth_step: f64,
    /// From the logged input to the motor, s.
    pub delay: f64,
    /// What the motor drives the cart through; none where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub string: Option<StringDrive>,
    /// Friction of the two rigs.
    pub friction: Frictions,
    /// The ends of the rail; none where they are left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rail: Option<Ends>,
    /// Sensors and disturbances.
    pub sensors: Noise,
    /// How the hand moves the cart.
    pub operator: Operator,
    /// How it swings the pole meanwhile.
    pub swing: Swing,
}

/// An elastic string between the motor and the cart: J z̈ = f − T with T = k (z − x) + c (ż − ẋ), which pulls at the cart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StringDrive {
    /// k, N/m.
    pub stiffness: f64,
    /// c, N·s/m.
    pub damping: f64,
    /// J, kg, beside the mass that slides.
    pub motor_inertia: f64,
}

/// Friction of the two rigs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frictions {
    /// That of Table 2, a little larger one way than the other.
    pub mild: RigFriction,
    /// Drag with the square of the speed, and Coulomb friction that is much larger one way than the other.
    pub strong: RigFriction,
}

/// Friction of one rig: Q = −F± sgn ẋ − d |ẋ| ẋ on the cart, Q = −c φ̇ on the pole. A cart at rest is held by up to F±.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFriction {
    /// F₊ against ẋ > 0 and F₋ against ẋ < 0, N.
    pub coulomb: [f64; 2],
    /// d, N·s²/m².
    pub quadratic: f64,
    /// c, N·m·s/rad.
    pub pole_viscous: f64,
}

/// The ends of the rail, at which the cart bounces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ends {
    /// m.
    pub left: f64,
    /// m.
    pub right: f64,
    /// Speed after a blow on an end over the speed before.
    pub restitution: f64,
}

/// How the hand swings the pole while it moves the cart: see [`crate::paper::operator`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Swing {
    /// Share of the moves in which the pole is let alone.
    pub calm_share: f64,
    /// Share of the moves in which it is swung wildly.
    pub wild_share: f64,
    /// Energy that the hand swings it to, in units of its weight times the height of its centre: −1 hanging, 1 upright, both at rest.
    pub energy: [f64; 2],
    /// The same of a wild move: from that of the others to this.
    pub wild_energy: f64,
    /// More of it where the pole turns backwards, φ̇ < 0.
    pub backwards: f64,
    /// ω₀, rad/s, by which the hand knows the energy φ̇²/(2 ω₀²) + cos φ.
    pub frequency: f64,
    /// Largest acceleration of the cart for the sake of the pole, m/s².
    pub acceleration: f64,
    /// Share of it per missing energy.
    pub gain: f64,
    /// |φ̇ cos φ| from which on it is the whole of it, rad/s.
    pub speed: f64,
    /// The hand tries to catch the pole where it is about to be this close to upright, rad.
    pub catch_angle: f64,
    /// Acceleration of the cart by the angle, m/s² per rad, and its rate, m/s² per rad/s, then.
    pub catch: [f64; 2],
    /// Largest acceleration then, m/s².
    pub catch_acceleration: f64,
    /// Share of the cart's friction that the hand makes up for.
    pub feel: f64,
    /// The hand feels the direction of that friction as tanh(ẋ/v), v, m/s.
    pub feel_speed: f64,
}

impl PaperConfig {
    /// Reads and checks a settings file; `urdf` is taken relative to its folder.
    ///
    /// # Errors
    /// [`ConfigError`] for a file that cannot be read, and for text that is not the settings of the rig, with every fault.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let mut config = Self::parse(&read_text(path)?, &path.display().to_string())?;
        if let Some(folder) = path.parent() {
            config.urdf = folder.join(&config.urdf);
        }
        Ok(config)
    }

    /// Reads and checks settings; `source` is what errors call the text.
    ///
    /// # Errors
    /// [`ConfigError::Problems`] with every fault.
    pub fn parse(text: &str, source: &str) -> Result<Self, ConfigError> {
        parse(text, source, Self::faults)
    }

    /// Every number outside of its domain: its dotted key, and what is wrong with it.
    pub(crate) fn faults(&self) -> Vec<(String, String)> {
        let mut check = Check(Vec::new());
        check.number("rate", self.rate, 1.0, 1e4);
        check.number("truth_step", self.truth_step, 1e-6, 5e-3);
        check.number("delay", self.delay, 0.0, 1.0);
        if let Some(string) = &self.string {
            check.number("string.stiffness", string.stiffness, 0.0, 1e6);
            check.number("string.damping", string.damping, 0.0, 1e4);
            check.number("string.motor_inertia", string.motor_inertia, 1e-6, 1e3);
        }
        for (name, friction) in [
            ("mild", &self.friction.mild),
            ("strong", &self.friction.strong),
        ] {
            let key = |field: &str| format!("friction.{name}.{field}");
            for force in friction.coulomb {
                check.number(&key("coulomb"), force, 0.0, 1e3);
            }
            check.number(&key("quadratic"), friction.quadratic, 0.0, 1e3);
            check.number(&key("pole_viscous"), friction.pole_viscous, 0.0, 1e3);
        }
        let mut reach = 1e3;
        if let Some(rail) = &self.rail {
            check.number("rail.left", rail.left, -1e3, 0.0);
            check.number("rail.right", rail.right, 0.0, 1e3);
            check.number("rail.right", rail.right, rail.left + 1e-3, 1e3);
            check.number("rail.restitution", rail.restitution, 0.0, 1.0);
            reach = rail.right - rail.left;
        }
        self.sensors.check("sensors", &mut check);
        self.operator.check(reach, &mut check);
        self.swing.check(&mut check);
        check.0
    }
}

impl Swing {
    fn check(&self, check: &mut Check) {
        let s = self;
        check.number("swing.calm_share", s.calm_share, 0.0, 1.0);
        check.number("swing.wild_share", s.wild_share, 0.0, 1.0 - s.calm_share);
        check.range("swing.energy", s.energy, -1.0, 100.0);
        check.number("swing.wild_energy", s.wild_energy, s.energy[1], 100.0);
        check.number("swing.backwards", s.backwards, -10.0, 10.0);
        check.number("swing.frequency", s.frequency, 1e-3, 1e3);
        check.number("swing.acceleration", s.acceleration, 0.0, 1e3);
        check.number("swing.gain", s.gain, 0.0, 1e3);
        check.number("swing.speed", s.speed, 1e-6, 1e3);
        check.number("swing.catch_angle", s.catch_angle, 0.0, 3.2);
        for gain in s.catch {
            check.number("swing.catch", gain, 0.0, 1e4);
        }
        check.number("swing.catch_acceleration", s.catch_acceleration, 0.0, 1e3);
        check.number("swing.feel", s.feel, 0.0, 1.0);
        check.number("swing.feel_speed", s.feel_speed, 1e-6, 1e3);
    }
}
