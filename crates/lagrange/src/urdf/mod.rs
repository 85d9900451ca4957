//! URDF, the robot description format of ROS: a text becomes a [`Tree`], or a list of all that is wrong with it; and is written again.
//!
//! Read are links with their inertia and joints of the types fixed, revolute, continuous, prismatic, planar and floating, with
//! mimic, limits and `<dynamics>`. Shapes are not needed and meshes are never opened. No file is read and no program is run: xacro files have to be
//! expanded first.

mod masses;
mod mimics;
mod motion;
mod names;
mod read;
mod report;
mod schema;
mod shape;
mod source;
mod validate;
mod write;
mod xml;

use crate::mechanism::{PoseForm, Tree};
use crate::{Problem, Problems};

/// How to read a URDF.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// What the text is called in messages: the file's name.
    pub source: String,
    /// Acceleration of free fall in the frame of the root link, m/s².
    pub gravity: [f64; 3],
    /// Whether the root link is free to move: its pose is then the first coordinate, `base`, and its mass counts.
    pub floating_base: bool,
    /// How the poses of floating bodies are written.
    pub pose: PoseForm,
    /// Whether mimic joints are independent instead of following their leader.
    pub ignore_mimic: bool,
    /// Whether an inertia that no real body can have (A + B < C) is an error instead of a warning.
    pub strict: bool,
}

impl Default for Options {
    /// Standard gravity along −z, a fixed base, mimic joints followed.
    fn default() -> Self {
        Options {
            source: "URDF".to_owned(),
            gravity: [0.0, 0.0, -9.81],
            floating_base: false,
            pose: PoseForm::Quaternion,
            ignore_mimic: false,
            strict: false,
        }
    }
}

/// What a URDF says.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Urdf {
    /// Name of the robot.
    pub name: String,
    /// Its bodies and joints.
    pub tree: Tree,
    /// What was lost or looks wrong, in the order of the text.
    pub warnings: Vec<Problem>,
    /// `<dynamics>` of the moving joints that have it; it is no part of the tree's energies.
    pub joint_dynamics: Vec<JointDynamics>,
}

/// Friction of a joint of one coordinate: Q = −damping · v − friction · sign v, along the joint.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct JointDynamics {
    /// The joint.
    pub joint: String,
    /// Index, among the tree's coordinates, of the one that moves it.
    pub coordinate: usize,
    /// d(joint position)/d(coordinate): 1 unless the joint follows another. Along the coordinate, the damping counts ratio² times
    /// and the friction |ratio| times.
    pub ratio: f64,
    /// Viscous damping, N·m·s/rad or N·s/m.
    pub damping: f64,
    /// Coulomb friction, N·m or N.
    pub friction: f64,
}

/// Reads a URDF.
///
/// ```
/// use lagrange::urdf;
///
/// let text = r#"<robot name="r">
///   <link name="base"/>
///   <link name="arm"/>
///   <joint name="hinge" type="continuous"><parent link="bsae"/><child link="arm"/></joint>
/// </robot>"#;
/// let problems = urdf::read(text, &urdf::Options { source: "r.urdf".into(), ..Default::default() }).unwrap_err();
/// assert!(problems.to_string().starts_with("r.urdf:4:49: joint `hinge`: there is no link `bsae`; did you mean `base`?"));
/// ```
///
/// # Errors
/// All problems of the text at once, each with its line and column; beside them what is not read, which may be their cause.
pub fn read(text: &str, options: &Options) -> Result<Urdf, Problems> {
    read::read(text, options).map_err(|list| Problems {
        source: options.source.clone(),
        list,
    })
}

/// Writes what was read as URDF again: the same links with their frames and inertias, the same joints with their axes, limits,
/// `<dynamics>` and mimic, in the same order, every number such that it is read as itself. Read with the same [`Options`], it has the
/// same equations.
///
/// What concerns no motion is left out: shapes, materials, calibration, safety controllers, and all that reading warned of.
///
/// ```
/// use lagrange::urdf;
///
/// let text = r#"<robot name="r">
///   <link name="base"/>
///   <link name="arm"><inertial><mass value="0.1"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
///   <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
/// </robot>"#;
/// let urdf = urdf::read(text, &urdf::Options::default())?;
/// let written = urdf::write(&urdf);
/// assert!(written.contains(r#"<mass value="0.1"/>"#));
/// let again = urdf::read(&written, &urdf::Options::default())?;
/// assert_eq!(again.tree.joints(), urdf.tree.joints());
/// # Ok::<(), lagrange::Problems>(())
/// ```
pub fn write(urdf: &Urdf) -> String {
    write::write(urdf)
}
