//! Robots and the states in which they are timed.

use std::path::{Path, PathBuf};

use lagrange::mechanism::Tree;
use lagrange::urdf::{self, Options};
use lagrange::{Coordinate, Dynamics, Mechanics};

use super::random::Random;

/// How many states a call goes through; as many as the peers' programs use.
pub const STATES: usize = 64;

/// A robot of a URDF.
pub struct Robot {
    /// File name without its ending, `/`, and `fixed` or `floating`.
    pub name: String,
    pub mechanics: Dynamics<Tree>,
    pub states: Vec<State>,
}

/// A configuration with a velocity and an acceleration (or a force of that size).
pub struct State {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub a: Vec<f64>,
}

impl Robot {
    /// The robot of `text`. Mimic joints are coordinates of their own, as they are to the peers.
    pub fn new(name: String, text: &str, floating_base: bool) -> Result<Robot, String> {
        let options = Options {
            floating_base,
            ignore_mimic: true,
            ..Options::default()
        };
        let tree = urdf::read(text, &options)
            .map_err(|problems| problems.to_string())?
            .tree;
        let coordinates = tree.coordinates().to_vec();
        let mechanics = Dynamics::new(tree, coordinates).map_err(|error| error.to_string())?;
        let states = states(&mechanics);
        Ok(Robot {
            name,
            mechanics,
            states,
        })
    }
}

/// Random states: tangent vectors in [−1, 1] from the neutral configuration, velocities and accelerations in [−1, 1].
pub fn states(mechanics: &impl Mechanics) -> Vec<State> {
    let mut random = Random(20);
    (0..STATES)
        .map(|_| State {
            q: mechanics
                .coordinates()
                .iter()
                .flat_map(|c| position(c, &mut random))
                .collect(),
            v: random.vector(mechanics.nv()),
            a: random.vector(mechanics.nv()),
        })
        .collect()
}

/// A number in [−1, 1], or a pose whose position and rotation vector have entries in [−1, 1].
fn position(coordinate: &Coordinate, random: &mut Random) -> Vec<f64> {
    if !coordinate.floating {
        return random.vector(1);
    }
    let mut pose = random.vector(3);
    let turn = nalgebra::Vector3::from_vec(random.vector(3));
    let q = nalgebra::UnitQuaternion::from_scaled_axis(turn);
    pose.extend([q.w, q.i, q.j, q.k]);
    pose
}

/// The robots that the peers are compared on, from the folder that PINODE_ORACLES names, and our own. What cannot be read is named on stderr and left out.
pub fn all() -> Vec<Robot> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let foreign = std::env::var_os("PINODE_ORACLES")
        .map_or_else(|| root.join("../../../shared/oracles"), PathBuf::from);
    let models = root.join("../../models");
    let listed = [
        (foreign.join("cartpole_roehrl2020.urdf"), false),
        (foreign.join("kuka_iiwa.urdf"), false),
        (foreign.join("solo12.urdf"), false),
        (foreign.join("solo12.urdf"), true),
        (foreign.join("talos_reduced.urdf"), false),
        (foreign.join("talos_reduced.urdf"), true),
        (models.join("double_pendulum/double_pendulum.urdf"), false),
        (models.join("arm7/arm7.urdf"), false),
        (models.join("quadruped/quadruped.urdf"), false),
        (models.join("quadruped/quadruped.urdf"), true),
    ];
    listed
        .iter()
        .filter_map(|(path, floating)| match load(path, *floating) {
            Ok(robot) => Some(robot),
            Err(why) => {
                let base = base(*floating);
                eprintln!("SKIPPED {} with a {base} base: {why}", path.display());
                None
            }
        })
        .collect()
}

fn load(path: &Path, floating: bool) -> Result<Robot, String> {
    let text = std::fs::read_to_string(path).map_err(|error| {
        format!("{error}; PINODE_ORACLES names the folder of the peers' robots")
    })?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Robot::new(format!("{stem}/{}", base(floating)), &text, floating)
}

fn base(floating: bool) -> &'static str {
    if floating { "floating" } else { "fixed" }
}
