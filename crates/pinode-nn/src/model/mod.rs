//! Models: one TOML file with a mechanism, inputs, effects, sensors and how well all this is known.
//!
//! ```toml
//! name = "pendulum"
//!
//! [lagrangian]                         # or: urdf = "pendulum.urdf"
//! coordinates = ["phi"]
//! angles      = ["phi"]          # these wrap, but for those in `unwrapped = ["…"]`: joints with ends
//! kinetic     = "0.5*m*l^2*phi_dot^2"
//! potential   = "-m*g*l*cos(phi)"
//! # constraints = ["x^2 + z^2 = l^2"]  # holonomic, in coordinates and parameters: φ, meant as φ = 0, or an equation
//! [lagrangian.parameters]
//! m = 0.2
//! l = 0.5
//! g = 9.81
//!
//! [[input]]                            # column u.motor of a log
//! name  = "motor"
//! joint = "phi"
//! gain  = 0.1                          # N·m per unit of u
//! # between_samples = "held"           # until the next sample, as it was put out; or "smooth", as it was measured
//!
//! # [[input]]                          # with a URDF: a force and a torque that turn with a link, as those of a propeller
//! # name   = "rotor"
//! # link   = "hull"
//! # point  = [0.2, 0.0, 0.0]           # where the force acts, m in the link's frame; its origin unless given
//! # force  = [0.0, 0.0, 1.0]           # in the link's axes: N at gain · u = 1
//! # torque = [0.0, 0.0, 0.016]         # N·m at gain · u = 1
//! # gain   = 5.0
//!
//! [[effect]]
//! kind  = "viscous_friction"
//! joint = "phi"
//! coefficient = 0.01                   # N·m·s/rad
//! # smoothing = 0.01                   # of a sign change, rad/s or m/s
//! # fixed = true                       # a fit leaves it alone; one more of its kind may stand beside it that is not fixed
//!
//! [sensor.phi]
//! position_noise = 1e-3                # rad
//! zero = 0.0                           # the sensor reads q + zero
//!
//! # resolution = 1e-3                  # quantisation step, rad
//! # velocity = "measured"              # or "backward_difference" of the positions, or "none"
//!
//! [tolerance]                          # standard deviations of what a fit may move: priors
//! parameters = { l = 0.01 }            # relative, of constants of [lagrangian.parameters]; 0: exact. Others are, until an effect would be named for what one is off by
//! # mass = 0.02                        # relative, of masses and inertias of a URDF
//! # gain = 0.01                        # relative, of input gains
//! # zero = { phi = 0.002 }             # of sensor zeros, rad or m; two quanta unless given
//!
//! # [log.columns]                      # where a log has other names
//! # "q.phi" = { column = "angle_deg", scale = 0.0174533, offset = 0.0 }
//! # "u.motor" = "/motor/command.data"  # of an MCAP file: topic and field
//! # "u.other" = { column = "u", rows_late = 1 } # a row holds what was put out until its state was measured
//!
//! # At the top, with a URDF: gravity = [0.0, 0.0, -9.81], base = "fixed" (or "floating": the first coordinate is the pose `base`),
//! # pose = "quaternion" (or "angles": six coordinates `base.x`, … `base.roll` instead, with roll_axis = "x"),
//! # mimic = "follow" (or "ignore"), urdf_dynamics = true
//!
//! # [[loop]]                           # with a URDF: a point of one link is at a point of another
//! # name = "rocker"                    # the links' names unless given
//! # a = { link = "coupler", point = [0.3, 0.0, 0.0] }   # m, in the link's frame; its origin unless given
//! # b = { link = "rocker", point = [0.2, 0.0, 0.0] }
//! # components = ["x", "z"]            # of the world that coincide; all three unless given
//!
//! # [mass_scale]                       # with a URDF: factors on masses and inertias, by link
//! # pole = 1.02
//! ```
//!
//! With a URDF, its `<dynamics damping friction>` become `viscous_friction` and `coulomb_friction` unless `urdf_dynamics = false`
//! or an `[[effect]]` of the same kind sits on the same joint. Its `<limit>`s do not become stops: a rail that ends has an `[[effect]]`
//! of the kind `end_stop` with `stiffness` and `damping`, and `lower`, `upper` or both; a side that is left out is open.
//!
//! A learnt force is an `[[effect]]` of the kind `neural_network` with `weights`, a file that `pinode train` writes, and the `joints` that it
//! was trained for. A list of files is an ensemble: the force is the mean of its members. How far what is measured may be from its roll-outs is the
//! [`Band`], a table that `pinode train --members` writes:
//!
//! ```toml
//! [band]                               # 95 % within √((spread · s)² + floor² + (growth · t)²), s the members' standard deviation
//! horizon = 0.6                        # s: tried so far from the beginning of a roll-out
//! windows = 31                         # that share no sample
//! [band.q]                             # m or rad; growth in these a second. Those of velocities are in [band.v].
//! slider = { spread = 2.8, floor = 1.6e-3, growth = 4.0e-3 }
//! ```
//!
//! An `added_mass` sits on a link of a URDF, `link = "pole"`, and is a point mass at the centre of mass of all that is welded to it; a `payload` is one on
//! the line there from its joint, `place` times as far. A `centre_of_mass` says that the body's own mass is `place` times as far, a `link_inertia` that the body has more
//! inertia about the axes normal to that line, kg·m².
//!
//! `joint`, `[sensor.…]`, `zero` and the columns of a log name coordinates: a joint with one coordinate gives it its name, a planar
//! joint has three (`foot.x`, `foot.y`, `foot.theta`; in TOML `[sensor."foot.x"]`). The pose of a floating body cannot be named there:
//! it is no single number. With `pose = "angles"` it is six: `base.x`, `base.y`, `base.z`, `base.yaw`, `base.pitch` and `base.roll`, about z, y and x, one
//! after the other, or about another `roll_axis` of the body than x, which must stay away from the vertical ([`Angles`](lagrange::mechanism::Angles)).
//! A log of such a model may have these, or position and quaternion (`q.base.x` to `q.base.qz`). What reads a log of a model with poses writes them so.

mod band;
mod blank;
mod constraints;
mod document;
mod effects;
mod file;
mod inputs;
pub(crate) mod log_columns;
mod massless;
mod mechanism;
mod networks;
mod sensor;
mod tolerance;
mod write;

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lagrange::mechanism::{Axis, PoseForm, Tree};
use lagrange::{Mechanics, Problem, Problems};

pub use constraints::ConstraintEntry;
pub use inputs::{Input, OnLink, Pushes};
pub use networks::NetworkEntry;
pub use sensor::{Sensor, Velocity};
pub use tolerance::Tolerance;
pub use write::{NewNetwork, Revision};

use crate::Error;
use crate::band::Band;
use crate::effect::Kind;
use crate::log::ColumnMap;

/// A model: M(q) v̇ + C(q, v) v + G(q) = Σ gain · u + Σ effects, and what is known of sensors and tolerances.
#[derive(Clone)]
pub struct Model {
    /// Its name; the URDF's, else the file's, where the file gives none.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// The equations of motion without inputs and effects.
    pub mechanics: Arc<dyn Mechanics>,
    /// The equations φ = 0 that `mechanics` obeys, the redundant ones too.
    pub constraints: Vec<ConstraintEntry>,
    /// The bodies and joints behind `mechanics`, where they come from a URDF (before `[mass_scale]`).
    pub tree: Option<Tree>,
    /// The constants of [`Mechanics::parameters`], `[mass_scale]` applied.
    pub parameter_values: Vec<f64>,
    /// The actuators.
    pub inputs: Vec<Input>,
    /// Everything that makes Q beside the inputs; the URDF's friction first.
    pub effects: Vec<EffectEntry>,
    /// What was learnt of Q.
    pub networks: Vec<NetworkEntry>,
    /// How far what is measured may be from roll-outs of its ensemble.
    pub band: Option<Band>,
    /// One per coordinate; that of a pose says nothing.
    pub sensors: Vec<Sensor>,
    /// How well the rest is known.
    pub tolerance: Tolerance,
    /// Which columns of a log hold which signals.
    pub columns: ColumnMap,
    /// What reads oddly, by source: the model file, the URDF.
    pub warnings: Vec<Problems>,
    pub(crate) pose: PoseForm,
    urdf: Option<mechanism::UrdfFile>,
    text: String,
}

/// One effect with its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectEntry {
    /// What it is.
    pub kind: &'static Kind,
    /// What it acts on.
    pub target: Target,
    /// As many as [`Kind::parameters`], in that order.
    pub values: Vec<f64>,
    /// Velocity over which a sign change of friction is spread, m/s or rad/s; `None`: the default.
    pub smoothing: Option<f64>,
    /// Whether a fit leaves it alone.
    pub fixed: bool,
}

/// What an effect acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Target {
    /// The coordinate with this index, a single number and no pose.
    Coordinate(usize),
    /// The input with this index.
    Input(usize),
    /// The link with this index in [`Tree::links`].
    Link(usize),
}

impl Model {
    /// SHA-256 of the model file, its URDF and the weights of its networks, hexadecimal.
    pub fn sha256(&self) -> String {
        let urdf = self.urdf.as_ref().map_or("", |urdf| urdf.text.as_str());
        // The length tells where the one ends and the other begins.
        let mut all = format!("{}\n{}{urdf}", self.text.len(), self.text);
        for network in &self.networks {
            all.push_str(&network.sha256);
        }
        crate::disk::sha256(all.as_bytes())
    }

    /// Reads the model at `path` and the URDF it names.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read, or [`Error::Problems`] with every fault in it or in the URDF, by line and
    /// column.
    pub fn load(path: &Path) -> Result<Model, Error> {
        file::parse(path, file::text(path)?, false)
    }

    /// As [`load`](Self::load), and refuses inertias that no real body can have, which `load` only warns of.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_strict(path: &Path) -> Result<Model, Error> {
        file::parse(path, file::text(path)?, true)
    }

    /// Reads a model from `text`; `path` is its name in messages, and a URDF is looked for in its folder.
    ///
    /// ```
    /// use std::path::Path;
    /// use pinode_nn::model::Model;
    ///
    /// let model = Model::parse(Path::new("cart.toml"), r#"
    ///     [lagrangian]
    ///     coordinates = ["x"]
    ///     kinetic = "0.5*m*x_dot^2"
    ///     potential = "0"
    ///     parameters = { m = 2.0 }
    ///
    ///     [[effect]]
    ///     kind = "viscous_friction"
    ///     joint = "x"
    ///     coefficient = 0.5
    /// "#)?;
    /// assert_eq!(model.effects[0].values, [0.5]);
    ///
    /// let error = Model::parse(Path::new("cart.toml"), "urfd = 'cart.urdf'").err().map(|e| e.to_string());
    /// assert!(error.is_some_and(|e| e.contains("cart.toml:1:1: unknown key `urfd`") && e.contains("nearest: `urdf`")));
    /// # Ok::<(), pinode_nn::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn parse(path: &Path, text: impl Into<String>) -> Result<Model, Error> {
        file::parse(path, text.into(), false)
    }

    /// The same model with the poses of its floating bodies by angles, as if its file said `pose = "angles"` and this `roll_axis`.
    ///
    /// # Errors
    /// As [`load`](Self::load): the URDF is read again.
    pub fn by_angles(&self, roll_axis: Axis) -> Result<Model, Error> {
        let mut document = self.document()?;
        document.insert("pose", toml_edit::value("angles"));
        document.insert("roll_axis", toml_edit::value(roll_axis.name()));
        Model::parse(&self.path, document.to_string())
    }

    /// Whether a coordinate is the pose of a floating body.
    pub(crate) fn has_poses(&self) -> bool {
        self.mechanics.coordinates().iter().any(|c| c.floating)
    }

    /// The text of its file as a document.
    fn document(&self) -> Result<toml_edit::DocumentMut, Error> {
        self.text.parse().map_err(|e: toml_edit::TomlError| {
            Error::Problems(Problems {
                source: self.path.display().to_string(),
                list: vec![Problem::general(e.message().to_owned())],
            })
        })
    }

    /// The name of what an effect acts on.
    pub fn target_name(&self, target: Target) -> &str {
        match target {
            Target::Coordinate(i) => self.mechanics.coordinates().get(i).map(|c| c.name.as_str()),
            Target::Input(i) => self.inputs.get(i).map(|input| input.name.as_str()),
            Target::Link(i) => {
                let link = self.tree.as_ref().and_then(|tree| tree.links().get(i));
                link.map(|link| link.name.as_str())
            }
        }
        .unwrap_or("")
    }

    /// Whether the coordinate that `target` acts on is an angle.
    pub fn target_is_angular(&self, target: Target) -> bool {
        let coordinate = match target {
            Target::Coordinate(i) => Some(i),
            Target::Input(i) => self.inputs.get(i).and_then(Input::coordinate),
            Target::Link(_) => None,
        };
        coordinate
            .and_then(|i| self.mechanics.coordinates().get(i))
            .is_some_and(|c| c.angular)
    }
}

impl fmt::Debug for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Model")
            .field("name", &self.name)
            .field("path", &self.path)
            .field("coordinates", &self.mechanics.coordinates())
            .field("parameter_values", &self.parameter_values)
            .field("inputs", &self.inputs)
            .field("effects", &self.effects)
            .field("networks", &self.networks)
            .field("band", &self.band)
            .field("sensors", &self.sensors)
            .field("tolerance", &self.tolerance)
            .field("columns", &self.columns)
            .field("warnings", &self.warnings)
            .finish_non_exhaustive()
    }
}
