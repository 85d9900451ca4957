//! Faulty models and logs: each gives an error that names the culprit and its place; none panics or takes long.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use lagrange::{Coordinate, Problems};
use pinode_nn::Error;
use pinode_nn::log::{Channels, ColumnMap, Log, Mapping};
use pinode_nn::model::Model;
use proptest::prelude::*;

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

/// The model in `text` as if it stood beside the cart-pole's URDF.
fn parse_model(text: &str) -> Result<Model, Error> {
    Model::parse(&models().join("cartpole/bad.toml"), text)
}

fn problems_of<T>(result: Result<T, Error>, case: &str) -> Problems {
    match result {
        Ok(_) => panic!("accepted: {case}"),
        Err(Error::Problems(problems)) => problems,
        Err(other) => panic!("{case}: {other}"),
    }
}

/// A pendulum to which cases append tables.
const PENDULUM: &str = "[lagrangian]
coordinates = ['phi']
angles = ['phi']
kinetic = '0.5*m*phi_dot^2'
potential = '-g*cos(phi)'
parameters = { m = 1.0, g = 9.81 }
[[input]]
name = 'motor'
joint = 'phi'
";

/// Faulty models: text, line and column of the first problem, words of the message.
#[rustfmt::skip]
const BAD_MODELS: &[(&str, (usize, usize), &[&str])] = &[
    // Syntax and top level.
    ("", (1, 1), &["no mechanism", "urdf"]),
    ("name = ", (1, 8), &[]),
    ("urdf = 'cartpole.urdf'\n[effect]\nkind = 'viscous_friction'\njoint = 'pole'\ncoefficient = 1", (2, 1), &["`effect` is a single table", "`[[effect]]`"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'viscous'\njoint = 'pole'", (3, 8), &["unknown kind of effect `viscous`", "nearest: `viscous_friction`"]),
    ("urdf = 'cartpole.urdf'\nurdf = 'b'", (2, 1), &["duplicate"]),
    ("urdf = 'cartpole.urdf'\n[[input]\n", (2, 9), &["unclosed"]),
    ("urfd = 'cartpole.urdf'", (1, 1), &["unknown key `urfd`", "nearest: `urdf`"]),
    ("urdf = 'cartpole.urdf'\nname = 5", (2, 8), &["`name` is a number", "a string"]),
    ("urdf = 5", (1, 8), &["`urdf` is a number"]),
    ("urdf = ''", (1, 8), &["`urdf` is empty"]),
    ("urdf = 'cartpool.urdf'", (1, 8), &["cannot read", "cartpole.urdf"]),
    ("urdf = 'package://robot/cartpole.urdf'", (1, 8), &["package path", "relative to this file"]),
    ("urdf = 'robot.urdf.xacro'", (1, 8), &["xacro robot.xacro > robot.urdf"]),
    ("urdf = '.'", (1, 8), &["cannot read"]),
    ("urdf = 'cartpole.urdf'\n[lagrangian]", (1, 8), &["both `urdf` and [lagrangian]"]),
    ("urdf = 'cartpole.urdf'\ngravity = [0, 0]", (2, 11), &["`gravity` has 2 entries"]),
    ("urdf = 'cartpole.urdf'\ngravity = [0, 0, nan]", (2, 18), &["`gravity` is NaN", "finite"]),
    ("urdf = 'cartpole.urdf'\ngravity = 9.81", (2, 11), &["`gravity` is a number", "an array"]),
    ("urdf = 'cartpole.urdf'\nbase = 'free'", (2, 8), &["`free`", "fixed", "floating"]),
    ("urdf = 'cartpole.urdf'\nbase = 'floating'\n[[input]]\nname = 'u'\njoint = 'base'", (5, 9), &["`base`", "three forces and three moments", "slider, pole"]),
    ("urdf = 'cartpole.urdf'\nbase = 'floating'\n[[effect]]\nkind = 'viscous_friction'\njoint = 'base'\ncoefficient = 1", (5, 9), &["pose", "one number"]),
    ("urdf = 'cartpole.urdf'\nbase = 'floating'\n[sensor.base]\nzero = 0.1", (3, 9), &["pose", "sensors"]),
    ("urdf = 'cartpole.urdf'\nbase = 'floating'\n[tolerance.zero]\nbase = 0.1", (4, 1), &["pose", "tolerances"]),
    ("[lagrangian]\ncoordinates = ['x', 'y']\nkinetic = 'm*x_dot^2 + n*y_dot^2'\npotential = '0'\nparameters = { m = 1.0, n = 0.0 }", (2, 21), &["coordinate `y` moves no mass", "`n` = 0", "positive"]),
    ("[lagrangian]\ncoordinates = ['x', 'y']\nkinetic = 'm*(x_dot + y_dot)^2'\npotential = '0'\nparameters = { m = 1.0 }", (2, 16), &["moves no mass", "together with others"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'm*x_dot^2'\npotential = '0'\nparameters = { m = -2.0 }", (2, 16), &["coordinate `x` has a negative mass", "`m` = -2"]),
    ("urdf = '../gripper/gripper.urdf'\n[[input]]\nname = 'u'\njoint = 'left_fingertip'", (4, 9), &["`left_fingertip` follows `grip`", "put it on `grip`", "-1.2 x", "mimic = \"ignore\""]),
    ("urdf = '../gripper/gripper.urdf'\n[[effect]]\nkind = 'viscous_friction'\njoint = 'left_knuckle'\ncoefficient = 1", (4, 9), &["`left_knuckle` follows `grip`", "no coordinate of its own"]),
    ("urdf = '../gripper/gripper.urdf'\n[sensor.right_fingertip]\nzero = 0.1", (2, 9), &["`right_fingertip` follows `grip`"]),
    ("urdf = 'cartpole.urdf'\n[tolerance.zero]\ntip = 0.1", (3, 1), &["joint `tip` is fixed", "no coordinate"]),
    ("urdf = 'cartpole.urdf'\nmimic = 'yes'", (2, 9), &["`mimic`", "follow", "ignore"]),
    ("urdf = 'cartpole.urdf'\nurdf_dynamics = 'no'", (2, 17), &["`urdf_dynamics` is a string", "true or false"]),
    ("urdf = 'cartpole.urdf'\n[[loop]]\na = 1", (3, 5), &["`a` is a number", "a table"]),
    ("urdf = 'cartpole.urdf'\n[[loop]]\na = { link = 'pole' }", (2, 1), &["[[loop]] has no `b`", "link"]),
    ("urdf = 'cartpole.urdf'\n[[loop]]\na = { link = 'poel' }\nb = { link = 'cart' }", (3, 5), &["unknown link `poel`", "did you mean `pole`?"]),
    ("urdf = 'cartpole.urdf'\n[[loop]]\na = { link = 'pole', point = [1, 2] }\nb = { link = 'cart' }", (3, 30), &["`point` has 2 entries", "[x, y, z] in m"]),
    ("urdf = 'cartpole.urdf'\n[[loop]]\na = { link = 'pole' }\nb = { link = 'pole' }", (4, 5), &["cannot move against each other"]),
    ("urdf = 'cartpole.urdf'\n[[loop]]\na = { link = 'pole' }\nb = { link = 'cart' }\ncomponents = ['w']", (5, 15), &["unknown component `w`"]),
    ("urdf = 'cartpole.urdf'\n[[loop]]\na = { link = 'pole', point = [0, 0, 1] }\nb = { link = 'cart', point = [0, 0, 5] }", (2, 1), &["constraints are not satisfied", "pole-cart.z"]),
    // Energies.
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = '0.5*x_dot^2'", (1, 1), &["no `potential`"]),
    ("[lagrangian]\nkinetic = '1'\npotential = '0'", (1, 1), &["no `coordinates`"]),
    ("[lagrangian]\ncoordinates = 'x'\nkinetic = 'x_dot^2'\npotential = '0'", (2, 15), &["`coordinates` is a string", "an array"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = '0.5*x_dto^2'\npotential = '0'", (3, 16), &["x_dto"]),
    ("[lagrangian]\ncoordinates = ['x']\nangles = ['y']\nkinetic = 'x_dot^2'\npotential = '0'", (3, 11), &["`y`"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'x_dot^2'\npotential = 'x_dot'", (4, 14), &["x_dot", "velocity"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = '0.5*(x_dot^2'\npotential = '0'", (3, 16), &["not closed"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'x_dot^2'\npotential = '0'\nconstraints = ['x + x_dot']", (5, 21), &["`x_dot` is a velocity", "holonomic"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'x_dot^2'\npotential = '0'\nconstraints = ['x = y']", (5, 21), &["unknown name `y`"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'x_dot^2'\npotential = '0'\nconstraints = ['x', 'x - 1']", (5, 16), &["constraints are not satisfied", "constraints["]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'x_dot^2'\npotential = '0'\n[[loop]]\na = 1", (5, 1), &["[[loop]] goes with `urdf`"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'm*x_dot^2'\npotential = '0'\nparameters = { m = 'heavy' }", (5, 20), &["`m` is a string", "a number"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'm*x_dot^2'\npotential = '0'\nparameters = { m = inf }", (5, 20), &["`m` is inf", "finite"]),
    ("gravity = [0, 0, -1]\n[lagrangian]\ncoordinates = ['x']\nkinetic = 'x_dot^2'\npotential = '0'", (1, 11), &["`gravity` goes with `urdf`"]),
    // Inputs.
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'motor'\njoint = 'silder'", (4, 9), &["unknown joint `silder`", "nearest: `slider`"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'motor'\njoint = 'tip'", (4, 9), &["joint `tip` is fixed"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\njoint = 'slider'", (2, 1), &["[[input]] has no `name`"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a,b'\njoint = 'slider'", (3, 8), &["`a,b`", "no comma"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\njoint = 'slider'\ngain = 0", (5, 8), &["`gain` is 0", "different from 0"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\njoint = 'slider'\ngian = 1", (5, 1), &["unknown key `gian`", "nearest: `gain`"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\njoint = 'slider'\n[[input]]\nname = 'a'\njoint = 'pole'", (6, 8), &["two inputs", "`a`"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'", (2, 1), &["neither `joint` nor `link`"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\njoint = 'slider'\nlink = 'pole'\nforce = [0, 0, 1]", (4, 9), &["a `joint` or a `link`", "leave one"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\nlink = 'poel'\nforce = [0, 0, 1]", (4, 8), &["unknown link `poel`", "`pole`"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\nlink = 'pole'\ngain = 2", (4, 8), &["`force = [x, y, z]`", "`torque"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\njoint = 'pole'\nforce = [0, 0, 1]", (5, 9), &["`force` goes with a `link"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\nlink = 'pole'\nforce = [0, 0, 1e200]\npoint = [1e200, 0, 0]", (4, 8), &["too large for a number"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\nlink = 'pole'\nforce = [0, 0, 1]\n[[effect]]\nkind = 'load_dependent_friction'\njoint = 'pole'\ncoefficient = 0.1", (8, 9), &["follows the forces of the inputs on its joint", "do not count"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\nlink = 'pole'\nforce = [1, 2]", (5, 9), &["`force` has 2 entries", "N in the link's axes"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\nlink = 'pole'\nforce = [0, 0, 1]\npont = [0, 0, 0]", (6, 1), &["unknown key `pont`", "nearest: `point`"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\nlink = 'rail'\nforce = [0, 0, 1]", (4, 8), &["`rail` does not move"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\nlink = 'pole'\nforce = [0, 0, 1]\n[[effect]]\nkind = 'elastic_transmission'\ninput = 'a'\nstiffness = 1\ndamping = 1\nmotor_inertia = 1", (8, 9), &["between a motor and a joint", "`a` pushes a link"]),
    ("[lagrangian]\ncoordinates = ['x']\nkinetic = 'x_dot^2'\npotential = '0'\n[[input]]\nname = 'a'\nlink = 'pole'\nforce = [0, 0, 1]", (7, 8), &["needs a URDF", "`joint"]),
    ("urdf = 'cartpole.urdf'\ninput = 'motor'", (2, 9), &["`input` is a string", "an array"]),
    ("urdf = 'cartpole.urdf'\ninput = ['motor']", (2, 10), &["a table"]),
    // Effects.
    ("urdf = 'cartpole.urdf'\n[[effect]]\njoint = 'pole'", (2, 1), &["[[effect]] has no `kind`"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'viscous_fricton'\njoint = 'pole'", (3, 8), &["unknown kind of effect `viscous_fricton`", "nearest: `viscous_friction`"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'neural_network'\njoints = ['pole']", (2, 1), &["neural_network has no `weights`"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'neural_network'\nweights = 'none.safetensors'\njoints = ['pole']", (4, 11), &["none.safetensors", "No such file"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'neural_network'\nweights = 'cartpole.urdf'\njoints = ['pole']", (4, 11), &["cartpole.urdf", "no file of weights"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'neural_network'\nweights = 'cartpole.urdf'\njoint = 'pole'", (5, 1), &["unknown key `joint` in neural_network", "nearest: `joints`"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'viscous_friction'\njoint = 'pole'", (2, 1), &["viscous_friction takes coefficient (N·m·s/rad)", "`coefficient` is missing"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'viscous_friction'\njoint = 'pole'\ncoefficient = -1", (5, 15), &["`coefficient` is -1", "at least 0"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'viscous_friction'\njoint = 'pole'\ncoefficient = 1\nforce = 2", (6, 1), &["unknown key `force` in viscous_friction"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'viscous_friction'\njoint = 'poel'\ncoefficient = 1", (4, 9), &["unknown joint `poel`", "nearest: `pole`"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'coulomb_friction'\njoint = 'pole'\nforce = 1\nsmoothing = 0", (6, 13), &["`smoothing` is 0", "positive"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'coulomb_friction'\njoint = 'pole'\nforce = 1\nfixed = 1", (6, 9), &["`fixed` is a number", "true or false"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'coulomb_friction'\njoint = 'pole'\nforce = 1\n[[effect]]\nkind = 'coulomb_friction'\njoint = 'pole'\nforce = 2", (6, 1), &["coulomb_friction acts on this target already"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'coulomb_friction'\ninput = 'pole'\nforce = 1", (2, 1), &["no `joint`"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'input_delay'\njoint = 'pole'\ndelay = 0.1", (2, 1), &["no `input`"]),
    ("urdf = 'cartpole.urdf'\n[[effect]]\nkind = 'input_delay'\ninput = 'motor'\ndelay = 0.1", (4, 9), &["unknown input `motor`", "there are no inputs"]),
    ("urdf = 'cartpole.urdf'\neffect = 1", (2, 10), &["`effect` is a number"]),
    // Sensors, tolerances, scales.
    ("urdf = 'cartpole.urdf'\n[sensor.slidr]\nposition_noise = 1", (2, 9), &["unknown joint `slidr`", "nearest: `slider`"]),
    ("urdf = 'cartpole.urdf'\n[sensor.slider]\nnoise = 1", (3, 1), &["unknown key `noise` in [sensor.slider]"]),
    ("urdf = 'cartpole.urdf'\n[sensor.slider]\nresolution = -1e-3", (3, 14), &["`resolution` is -0.001", "positive"]),
    ("urdf = 'cartpole.urdf'\n[sensor.slider]\nvelocity = 'central'", (3, 12), &["`central`", "backward_difference"]),
    ("urdf = 'cartpole.urdf'\nsensor = { slider = 1 }", (2, 21), &["`slider` is a number", "a table"]),
    ("urdf = 'cartpole.urdf'\n[tolerance]\nmas = 0.1", (3, 1), &["unknown key `mas`", "nearest: `mass`"]),
    ("urdf = 'cartpole.urdf'\n[tolerance]\nmass = -0.1", (3, 8), &["`mass` is -0.1", "0 or positive"]),
    ("urdf = 'cartpole.urdf'\n[tolerance]\nzero = { cart = 0.1 }", (3, 10), &["unknown joint `cart`"]),
    ("urdf = 'cartpole.urdf'\n[tolerance]\nparameters = { k = 0.1 }", (3, 16), &["unknown parameter `k`", "there are no"]),
    ("urdf = 'cartpole.urdf'\n[mass_scale]\ncrat = 1.1", (3, 1), &["unknown moving link `crat`", "nearest: `cart`"]),
    ("urdf = 'cartpole.urdf'\n[mass_scale]\ncart = 0", (3, 8), &["`cart` is 0", "positive"]),
    // Columns.
    ("urdf = 'cartpole.urdf'\n[log]\ncolumn = 1", (3, 1), &["unknown key `column` in [log]"]),
    ("urdf = 'cartpole.urdf'\n[log.columns]\n'q.slidr' = 'x'", (3, 1), &["unknown signal `q.slidr`", "nearest: `q.slider`"]),
    ("urdf = 'cartpole.urdf'\n[log.columns]\nq.slider = 'x'", (3, 1), &["unknown signal `q`", "quote the whole signal"]),
    ("urdf = 'cartpole.urdf'\n[log.columns]\n'q.slider' = 5", (3, 14), &["`q.slider` is a number", "name of a column"]),
    ("urdf = 'cartpole.urdf'\n[log.columns]\n'q.slider' = { column = 'x', scale = 0 }", (3, 38), &["`scale` is 0"]),
    ("urdf = 'cartpole.urdf'\n[log.columns]\n'run' = { column = 'x', scale = 2 }", (3, 9), &["`run` is an id"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\njoint = 'slider'\n[log.columns]\n'u.a' = { rows_late = 1.5 }", (6, 23), &["`rows_late` is 1.5", "whole number"]),
    ("urdf = 'cartpole.urdf'\n[[input]]\nname = 'a'\njoint = 'slider'\n[log.columns]\n'u.a' = { rows_late = -1 }", (6, 23), &["`rows_late` is -1"]),
    ("urdf = 'cartpole.urdf'\n[log.columns]\n'q.slider' = { rows_late = 1 }", (3, 28), &["of inputs alone", "sensor_delay"]),
];

#[test]
fn every_faulty_model_is_refused_with_culprit_and_place() {
    assert!(BAD_MODELS.len() >= 40);
    let mut failures = String::new();
    for (text, (line, column), words) in BAD_MODELS {
        let start = Instant::now();
        let message = problems_of(parse_model(text), text).to_string();
        assert!(start.elapsed() < Duration::from_secs(2), "slow: {text}");
        let place = format!("bad.toml:{line}:{column}: ");
        for word in words.iter().copied().chain([place.as_str()]) {
            if !message.contains(word) {
                failures += &format!("no {word:?} in\n{message}\nfor\n{text}\n\n");
            }
        }
    }
    assert!(failures.is_empty(), "{failures}");
}

#[test]
fn all_faults_of_a_model_are_reported_at_once_in_the_order_of_the_text() {
    let text = "urdf = 'cartpole.urdf'
colour = 'red'
[[input]]
name = 'motor'
joint = 'silder'
[[effect]]
kind = 'viscous_friction'
joint = 'pool'
coefficient = -1.0
[tolerance]
mass = 'low'
[log.columns]
'q.pol' = 'phi'
";
    let problems = problems_of(parse_model(text), text);
    let lines: Vec<usize> = problems
        .list
        .iter()
        .filter_map(|p| p.position.map(|p| p.line))
        .collect();
    assert_eq!(lines, [2, 5, 8, 9, 11, 13], "{problems}");
}

#[test]
fn faults_of_the_urdf_and_of_the_model_come_together() {
    let dir = tempfile::tempdir().unwrap();
    let urdf = "<robot name='r'>\n<link name='a'/>\n<joint name='j' type='continuous'><parent link='a'/><child link='b'/></joint>\n</robot>";
    std::fs::write(dir.path().join("r.urdf"), urdf).unwrap();
    let path = dir.path().join("m.toml");

    let alone = problems_of(Model::parse(&path, "urdf = 'r.urdf'"), "URDF alone");
    assert!(alone.source.ends_with("r.urdf"));
    assert!(alone.list[0].position.is_some());

    let both = problems_of(Model::parse(&path, "urdf = 'r.urdf'\nx = 1"), "both").to_string();
    assert!(both.contains("m.toml:2:1: unknown key `x`"), "{both}");
    assert!(both.contains("r.urdf:3:"), "{both}");
}

#[test]
fn a_urdf_in_place_of_a_model_is_told_with_the_model_that_it_needs() {
    let dir = tempfile::tempdir().unwrap();
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let urdf = std::fs::read_to_string(models.join("cartpole/cartpole.urdf")).unwrap();
    let path = dir.path().join("cart.urdf");
    std::fs::write(&path, urdf).unwrap();
    let problems = problems_of(Model::load(&path), "URDF");
    assert_eq!(problems.list.len(), 1, "{problems}");
    let told = problems.to_string();
    assert!(told.contains("write a file `cart.toml`"), "{told}");
    // What the message shows is a model.
    let line = told.lines().find(|line| line.starts_with("    ")).unwrap();
    let model = Model::parse(&dir.path().join("cart.toml"), line).unwrap();
    assert_eq!(model.mechanics.coordinates().len(), 2);

    let xacro = Model::parse(Path::new("arm.xacro"), "\u{feff}<robot/>");
    let told = problems_of(xacro, "xacro").to_string();
    assert!(
        told.contains("expand it by `xacro`") && told.contains("urdf = \"arm.urdf\""),
        "{told}"
    );
}

#[test]
fn a_model_file_that_is_no_text_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.toml");
    std::fs::write(&path, b"name = 'a'\nurdf = '\xff'\n").unwrap();
    let problems = problems_of(Model::load(&path), "not UTF-8").to_string();
    assert!(
        problems.contains("m.toml:2:9: this byte is not UTF-8"),
        "{problems}"
    );
    assert!(matches!(Model::load(dir.path()), Err(Error::Io { .. })));
    assert!(matches!(
        Model::load(&dir.path().join("none.toml")),
        Err(Error::Io { .. })
    ));
}

#[test]
fn thousands_of_faults_are_counted_not_listed() {
    let mut text = String::from("urdf = 'cartpole.urdf'\n");
    for i in 0..20_000 {
        text.push_str(&format!("key{i} = 1\n"));
    }
    let start = Instant::now();
    let problems = problems_of(parse_model(&text), "many");
    assert!(start.elapsed() < Duration::from_secs(5));
    assert!(problems.list.len() < 100);
    assert!(problems.to_string().contains("and 19950 more"));
}

#[test]
fn a_valid_model_is_accepted() {
    let text =
        format!("{PENDULUM}\n[[effect]]\nkind = 'input_delay'\ninput = 'motor'\ndelay = 0.02\n");
    let model = parse_model(&text).unwrap();
    assert_eq!(model.effects.len(), 1);
    assert_eq!(model.target_name(model.effects[0].target), "motor");
}

const HEADER: &str = "t,q.slider,q.pole,v.slider,u.motor\n";

/// Log of `n` good rows at 10 ms.
fn good_rows(n: usize) -> String {
    let mut text = String::from(HEADER);
    for i in 0..n {
        text.push_str(&row(i));
    }
    text
}

fn row(i: usize) -> String {
    let t = i as f64 * 0.01;
    format!("{t},{},{},{},{}\n", t.sin(), t.cos(), t.cos(), 1.0)
}

fn coordinate(name: &str) -> Coordinate {
    Coordinate {
        name: name.into(),
        joint: name.into(),
        angular: false,
        wraps: false,
        floating: false,
    }
}

fn parse_log(bytes: &[u8]) -> Result<Log, Error> {
    parse_mapped_log(bytes, &ColumnMap::default())
}

fn parse_mapped_log(bytes: &[u8], columns: &ColumnMap) -> Result<Log, Error> {
    Log::parse(
        Path::new("log.csv"),
        bytes,
        &Channels {
            coordinates: &[coordinate("slider"), coordinate("pole")],
            velocities: &[true, true],
            inputs: &["motor"],
            columns,
        },
    )
}

#[test]
fn every_faulty_log_is_refused_with_culprit_and_place() {
    let good = good_rows(10);
    let swapped = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        good.replacen(from, to, 1).into_bytes()
    };
    let with_row = |row: &str| format!("{good}{row}\n").into_bytes();
    let with_header = |header: &str| {
        let body: String = (0..10).map(row).collect();
        format!("{header}\n{body}").into_bytes()
    };
    #[rustfmt::skip]
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("empty", b"".to_vec(), &["log.csv: the file is empty", "t,q.<joint>"]),
        ("only a byte-order mark", b"\xef\xbb\xbf".to_vec(), &["the file is empty"]),
        ("blank lines", b"\n\n\n".to_vec(), &["the file is empty"]),
        ("only a header", HEADER.into(), &["too short: 0 samples"]),
        ("seven samples", good_rows(7).into(), &["too short: 7 samples", "at least 8"]),
        ("no time", with_header("time,q.slider,q.pole,v.slider,u.motor"), &["log.csv:1:1: column `t` is missing", "`time`"]),
        ("misspelt column", with_header("t,q.silder,q.pole,v.slider,u.motor"), &["column `q.slider` is missing", "`q.silder`", "[log.columns]"]),
        ("missing input", with_header("t,q.slider,q.pole,v.slider,f"), &["column `u.motor` is missing", "`f`"]),
        ("two missing", with_header("t,a,b,v.slider,u.motor"), &["`q.slider` is missing", "`q.pole` is missing"]),
        ("no header", (0..10).map(row).collect::<String>().into(), &["the first line holds numbers"]),
        ("double column", with_header("t,q.slider,q.pole,q.pole,u.motor"), &["log.csv:1:1: the header has column `q.pole` twice"]),
        ("semicolons", good.replace(',', ";").into(), &["log.csv:1:1", "separate columns by commas"]),
        ("tabs", good.replace(',', "\t").into(), &["separate columns by commas"]),
        ("a line of units", good.replacen('\n', "\ns,m,rad,m/s,N\n", 1).into(), &["log.csv:2:1: this line holds words, units it may be", "take it out", "[log.columns]"]),
        ("a date", with_row("2026-12-01T10:00:00,0,0,0,0"), &["log.csv:12:1: `t` is `2026-12-01T10:00:00`", "numbers of seconds"]),
        ("a word", with_row("0.1,abc,0,0,0"), &["log.csv:12:5: `q.slider` is `abc`, not a number"]),
        ("an empty entry", with_row("0.1,,0,0,0"), &["log.csv:12:5: `q.slider` is empty"]),
        ("NaN", with_row("0.1,0,nan,0,0"), &["log.csv:12:7: `q.pole` is NaN", "finite"]),
        ("infinity", with_row("0.1,0,0,inf,0"), &["log.csv:12:9: `v.slider` is inf"]),
        ("overflow", with_row("0.1,0,0,0,1e999"), &["log.csv:12:11: `u.motor` is inf"]),
        ("NaN time", with_row("nan,0,0,0,0"), &["log.csv:12:1: `t` is NaN"]),
        ("word as time", with_row("noon,0,0,0,0"), &["log.csv:12:1: `t` is `noon`"]),
        ("hexadecimal", with_row("0.1,0x10,0,0,0"), &["`0x10`, not a number"]),
        ("unit", with_row("0.1,1 m,0,0,0"), &["`1 m`, not a number"]),
        ("missing field", with_row("0.1,0,0,0"), &["log.csv:12:1: 4 fields, the header has 5"]),
        ("extra field", with_row("0.1,0,0,0,0,0"), &["log.csv:12:1: 6 fields, the header has 5"]),
        ("decimal comma", with_row("0,1,0,0,0,0"), &["6 fields, the header has 5"]),
        ("time repeats", with_row("0.09,0,0,0,0"), &["log.csv:12:1: time repeats", "0.09"]),
        ("time goes backwards", with_row("0.05,0,0,0,0"), &["log.csv:12:1: time goes backwards: 0.05 s after 0.09 s", "`run`"]),
        ("restart without run", format!("{good}{}", (0..10).map(row).collect::<String>()).into(), &["log.csv:12:1: time goes backwards"]),
        ("nothing moves", format!("{HEADER}{}", (0..10).map(|i| format!("{i},1,2,3,4\n")).collect::<String>()).into(), &["nothing moves", "slider, pole"]),
        ("UTF-16", b"\xff\xfet\0,\0q\0".to_vec(), &["UTF-16", "UTF-8"]),
        ("not UTF-8", [good.as_bytes(), b"0.1,\xff,0,0,0\n"].concat(), &["log.csv:12:5: this byte is not UTF-8"]),
        ("binary", vec![0x50, 0x41, 0x52, 0x31, 0x15, 0x80, 0x92, 0x00], &["UTF-8"]),
        ("zero bytes", vec![0; 1000], &["column `t` is missing"]),
        ("open quote", swapped("\n0.01,", "\n\"0.01,"), &["log.csv:3:1:", "fields, the header has 5"]),
        ("JSON", b"{\"t\": [0, 1, 2]}".to_vec(), &["column `t` is missing"]),
    ];
    assert!(cases.len() >= 30);
    for (case, bytes, words) in cases {
        let start = Instant::now();
        let message = problems_of(parse_log(&bytes), case).to_string();
        assert!(start.elapsed() < Duration::from_secs(1), "slow: {case}");
        for word in words {
            assert!(message.contains(word), "{case}: no {word:?} in\n{message}");
        }
    }
}

#[test]
fn a_run_that_returns_is_refused() {
    let rows = |id: &str, from: usize| -> String {
        (from..from + 10)
            .map(|i| format!("{},{}\n", row(i).trim(), id))
            .collect()
    };
    let header = "t,q.slider,q.pole,v.slider,u.motor,run\n";
    let text = format!("{header}{}{}{}", rows("a", 0), rows("b", 0), rows("a", 20));
    let message = problems_of(parse_log(text.as_bytes()), "returning run").to_string();
    assert!(message.contains("log.csv:22:"), "{message}");
    assert!(
        message.contains("run `a` returns after another run"),
        "{message}"
    );

    let two = format!("{header}{}{}", rows("a", 0), rows("b", 0));
    let log = parse_log(two.as_bytes()).unwrap();
    let ids: Vec<&str> = log.runs.iter().map(|run| run.id.as_str()).collect();
    assert_eq!(ids, ["a", "b"]);
    assert_eq!(log.samples(), 20);
}

/// Loggers write a row twice. One that has another value at the same time contradicts the row before, and is refused.
#[test]
fn rows_that_repeat_the_one_before_are_left_out_and_told_in_one_line() {
    let text: String = good_rows(10)
        .lines()
        .enumerate()
        .map(|(i, line)| format!("{line}\n").repeat(if [3, 7].contains(&i) { 2 } else { 1 }))
        .collect();
    let log = parse_log(text.as_bytes()).unwrap();
    let plain = parse_log(good_rows(10).as_bytes()).unwrap();
    assert_eq!(log.runs, plain.runs);
    let warnings: Vec<String> = log.warnings.iter().map(|w| w.to_string()).collect();
    assert_eq!(
        warnings,
        ["5:1: repeats the row before: left out (1 more like it)"]
    );
    let other = format!("{}{}", good_rows(10), row(9).replace(",1", ",2"));
    let message = problems_of(parse_log(other.as_bytes()), "two values").to_string();
    assert!(message.contains("time repeats"), "{message}");
}

#[test]
fn problems_beyond_the_first_twenty_are_counted() {
    let rows: String = (0..1000).map(|i| format!("{i},x,0,0,0\n")).collect();
    let problems = problems_of(parse_log(format!("{HEADER}{rows}").as_bytes()), "many");
    assert_eq!(problems.list.len(), 21);
    assert!(problems.to_string().ends_with("and 980 more"));
}

#[test]
fn byte_order_marks_carriage_returns_blank_lines_and_blanks_are_tolerated() {
    let text = good_rows(10).replace('\n', "\r\n").replace(',', " , ");
    let log = parse_log(format!("\u{feff}{text}\r\n\r\n").as_bytes()).unwrap();
    assert_eq!(log.runs[0].len(), 10);
    assert_eq!(log.runs[0].q[1][0], 1.0);
    assert!(log.runs[0].v[0].is_some());
    assert!(log.runs[0].v[1].is_none());
    assert!(log.warnings.is_empty(), "{:?}", log.warnings);
}

#[test]
fn the_place_of_a_fault_is_right_after_blank_lines_and_carriage_returns() {
    let text = format!(
        "{}\r\n\r\n0.1,0,x,0,0\r\n",
        good_rows(10).replace('\n', "\r\n")
    );
    let message = problems_of(parse_log(text.as_bytes()), "blank lines").to_string();
    assert!(message.starts_with("log.csv:14:7: "), "{message}");
}

#[test]
fn what_is_not_used_is_told() {
    let text = good_rows(10)
        .lines()
        .enumerate()
        .map(|(i, line)| {
            if i == 0 {
                format!("{line},temp,run")
            } else {
                format!("{line},20,{}", i / 9)
            }
        })
        .collect::<Vec<_>>()
        .join("\n");
    let log = parse_log(text.as_bytes()).unwrap();
    let warnings: Vec<String> = log.warnings.iter().map(|w| w.to_string()).collect();
    assert!(
        warnings[0].contains("columns not used: `temp`"),
        "{warnings:?}"
    );
    assert!(warnings[1].contains("1 runs left out"), "{warnings:?}");
    assert_eq!(log.runs.len(), 1);
}

/// Columns named by numbers are mapped as others are; two coordinates from one of them are told.
#[test]
fn columns_may_be_named_by_numbers_and_one_that_is_read_twice_is_told() {
    let mapped = |pole: &str| {
        let of = |(signal, column): (&str, &str)| Mapping::new(signal, column);
        let columns = ColumnMap {
            mappings: [
                ("t", "0"),
                ("q.slider", "1"),
                ("q.pole", pole),
                ("v.slider", "3"),
                ("u.motor", "4"),
            ]
            .map(of)
            .to_vec(),
        };
        let body: String = (0..10).map(row).collect();
        let log = parse_mapped_log(format!("0,1,2,3,4\n{body}").as_bytes(), &columns).unwrap();
        log.warnings
            .iter()
            .map(|w| w.to_string())
            .collect::<Vec<_>>()
    };
    assert_eq!(mapped("2"), [""; 0]);
    let told = mapped("1");
    assert!(
        told[0].contains("`q.slider` and `q.pole` are both read from the column `1`"),
        "{told:?}"
    );
}

#[test]
fn columns_are_mapped_scaled_and_offset() {
    let columns = ColumnMap {
        mappings: vec![Mapping {
            scale: 0.5,
            offset: 1.0,
            ..Mapping::new("q.pole", "deg")
        }],
    };
    let text = good_rows(10).replacen("q.pole", "deg", 1);
    let log = parse_mapped_log(text.as_bytes(), &columns).unwrap();
    assert_eq!(log.runs[0].q[1][0], 1.5);

    let message = problems_of(
        parse_mapped_log(good_rows(10).as_bytes(), &columns),
        "mapped away",
    );
    assert!(
        message
            .to_string()
            .contains("`deg` (for q.pole, by [log.columns])"),
        "{message}"
    );
}

#[test]
fn an_input_that_stands_some_rows_down_is_read_from_there_and_held_at_the_end() {
    let columns = ColumnMap {
        mappings: vec![Mapping {
            rows_late: 2,
            scale: 10.0,
            ..Mapping::new("u.motor", "u.motor")
        }],
    };
    let rows = (0..10).map(|k| format!("{},{k},1,0,{k}\n", 0.1 * f64::from(k)));
    let text = "t,q.slider,q.pole,v.slider,u.motor\n".to_owned() + &rows.collect::<String>();
    let log = parse_mapped_log(text.as_bytes(), &columns).unwrap();
    let read = [20., 30., 40., 50., 60., 70., 80., 90., 90., 90.];
    assert_eq!(log.runs[0].u[0], read);
}

#[test]
fn a_hundred_thousand_rows_are_read_quickly() {
    let text = good_rows(100_000);
    let start = Instant::now();
    let log = parse_log(text.as_bytes()).unwrap();
    let took = start.elapsed();
    assert_eq!(log.samples(), 100_000);
    // 0.2 s in a release build on an idle machine.
    assert!(took < Duration::from_secs(2), "{took:?}");
}

/// A model that uses every table.
const EVERYTHING: &str = "name = 'all'
urdf = 'cartpole.urdf'
gravity = [0.0, 0.0, -9.81]
base = 'fixed'
mimic = 'follow'
urdf_dynamics = true
[[input]]
name = 'motor'
joint = 'slider'
gain = 2.0
[[effect]]
kind = 'coulomb_friction'
joint = 'slider'
force = 0.2
smoothing = 1e-3
fixed = true
[[effect]]
kind = 'input_delay'
input = 'motor'
delay = 0.01
[sensor.pole]
resolution = 0.001
velocity = 'none'
zero = 0.1
[tolerance]
mass = 0.02
zero = { pole = 0.1 }
[mass_scale]
cart = 1.1
[log.columns]
'q.pole' = { column = 'a', scale = 0.1, offset = 2 }
";

#[test]
fn the_model_that_the_mutations_start_from_is_good() {
    let model = parse_model(EVERYTHING).unwrap();
    assert_eq!(model.effects.len(), 2);
    assert_eq!(model.sensors[1].zero, 0.1);
    assert!(model.parameter_values.contains(&1.1));
}

fn mutated(text: &str, edits: &[(usize, u8)]) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for &(at, byte) in edits {
        let index = at % bytes.len();
        bytes[index] = byte;
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn no_truncated_or_mutated_model_panics(
        length in 0..EVERYTHING.len(),
        edits in prop::collection::vec((any::<usize>(), any::<u8>()), 0..4),
    ) {
        let bytes = mutated(EVERYTHING, &edits);
        let text = String::from_utf8_lossy(&bytes);
        let _ = parse_model(&text);
        let cut: String = text.chars().take(length).collect();
        let _ = parse_model(&cut);
    }

    #[test]
    fn no_truncated_or_mutated_log_panics(
        length in 0..400_usize,
        edits in prop::collection::vec((any::<usize>(), any::<u8>()), 0..6),
    ) {
        let bytes = mutated(&good_rows(10), &edits);
        let _ = parse_log(&bytes);
        let _ = parse_log(&bytes[..length.min(bytes.len())]);
    }
}
