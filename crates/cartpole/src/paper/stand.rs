//! What the models are compared on: the paper's cart-pole with either friction.

use std::path::{Path, PathBuf};

use super::experiment::{Errors, Lesson};
use super::{Error, Friction, PaperRig, StartsAt, true_errors};

/// A rig of the experiment. Its first coordinate is driven by its only input, its second one is free.
pub(super) trait Stand {
    /// Part of the names of its files.
    fn name(&self) -> &'static str;

    /// What it is, for people.
    fn title(&self) -> &'static str;

    /// Names and units of the errors: of the coordinates, then of their rates.
    fn signals(&self) -> [&'static str; 4];

    /// Of its samples, s.
    fn interval(&self) -> f64;

    /// What is known of it.
    ///
    /// # Errors
    /// Where its file cannot be read.
    fn known(&self) -> Result<Known, Error>;

    /// Writes a recording of so many samples to learn from.
    ///
    /// # Errors
    /// Those of the rig and of files.
    fn learn(&self, lesson: Lesson, samples: usize, seed: u64, path: &Path) -> Result<(), Error>;

    /// Writes a recording to run over; the errors of the true model over so many windows of so many steps, from the measured and from the true state.
    ///
    /// # Errors
    /// As [`learn`](Self::learn); [`Error::Short`].
    fn test(
        &self,
        samples: usize,
        seed: u64,
        windows: (usize, usize),
        path: &Path,
    ) -> Result<[Errors; 2], Error>;
}

/// What is known of a rig before anything is learnt, as text of model files.
pub struct Known {
    /// Files that the text names lie beside it.
    pub(super) path: PathBuf,
    pub(super) text: String,
    /// Eq. 13: values of frictions to start from, which are fitted.
    pub(super) frictions: &'static str,
    /// What stays as it is beside the published network.
    pub(super) held: &'static str,
    /// What is suspected before anything is learnt; fitted.
    pub(super) suspects: &'static str,
}

impl Known {
    /// Of the cart-pole, by its model file.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn of_the_cart_pole(path: &Path) -> Result<Self, Error> {
        Ok(Known {
            path: path.to_owned(),
            text: read(path)?,
            frictions: COULOMB_AND_VISCOUS,
            held: FIXED_VISCOUS,
            suspects: SUSPECTS,
        })
    }
}

/// The cart-pole.
pub(super) struct CartPole<'a> {
    pub rig: &'a PaperRig,
    /// The model file of what is known.
    pub known: &'a Path,
}

impl Stand for CartPole<'_> {
    fn name(&self) -> &'static str {
        match self.rig.friction {
            Friction::Mild => "mild",
            Friction::Strong => "strong",
        }
    }

    fn title(&self) -> &'static str {
        match self.rig.friction {
            Friction::Mild => "mild friction",
            Friction::Strong => "strong friction",
        }
    }

    fn signals(&self) -> [&'static str; 4] {
        ["x, m", "phi, rad", "x_dot, m/s", "phi_dot, rad/s"]
    }

    fn interval(&self) -> f64 {
        self.rig.interval()
    }

    fn known(&self) -> Result<Known, Error> {
        Known::of_the_cart_pole(self.known)
    }

    fn learn(&self, lesson: Lesson, samples: usize, seed: u64, path: &Path) -> Result<(), Error> {
        let recording = match lesson {
            Lesson::Calm => with_the_pole_let_alone(self.rig).record(samples, seed)?,
            _ => self.rig.record(samples, seed)?,
        };
        Ok(recording.log.write_csv(path)?)
    }

    fn test(
        &self,
        samples: usize,
        seed: u64,
        windows: (usize, usize),
        path: &Path,
    ) -> Result<[Errors; 2], Error> {
        let recording = self.rig.record(samples, seed)?;
        recording.log.write_csv(path)?;
        let errors = |from| true_errors(self.rig, &recording, windows, from);
        Ok([errors(StartsAt::Measured)?, errors(StartsAt::True)?])
    }
}

/// The rig with a hand that does not swing the pole.
fn with_the_pole_let_alone(rig: &PaperRig) -> PaperRig {
    let mut rig = rig.clone();
    rig.settings.swing.calm_share = 1.0;
    rig.settings.swing.wild_share = 0.0;
    rig
}

pub(super) fn read(path: &Path) -> Result<String, Error> {
    std::fs::read_to_string(path).map_err(|e| pinode_nn::Error::io(path, e).into())
}

/// With Table 2's factors to start from: μ_c (m_c + m_p + m_s) g, and μ_p.
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

/// The string's motor is among it as far as a stiff one carries it along.
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
