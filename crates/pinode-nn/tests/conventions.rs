//! A log that counts otherwise than the model.

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;

use pinode_nn::Error;
use pinode_nn::diagnose::diagnose;
use pinode_nn::diagnose::verdict::{Diagnosis, Verdict};
use pinode_nn::log::{Log, Mapping};
use pinode_nn::model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

#[cfg(feature = "cli")]
use crate::program::{pinode, stderr};

const INERTIA: f64 = 0.012;
const WEIGHT: f64 = 0.5;
const NOISE: f64 = 1e-3;

/// 40 s at 50 Hz of a pendulum thrown about, φ = 0 where it hangs, with friction, as an encoder says it that counts degrees from the top, down to the left.
fn from_the_top_in_degrees(friction: f64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut q, mut v, mut torque) = (0.4_f64, 0.0, 0.0);
    let mut text = "t,angle,u.motor\n".to_owned();
    for k in 0..2000 {
        if k % 8 == 0 {
            torque = rng.random_range(-0.6..0.6);
        }
        let noise: f64 = rng.sample(StandardNormal);
        let angle = (PI - (q + NOISE * noise)).to_degrees();
        writeln!(text, "{:.2},{angle},{torque}", f64::from(k) * 0.02).unwrap();
        // The friction is exact in v, the rest by the steps of Störmer and Verlet.
        for _ in 0..200 {
            let h = 1e-4;
            let pull = |q: f64| (torque - WEIGHT * q.sin()) / INERTIA;
            v = (v + 0.5 * h * pull(q)) * (-0.5 * h * friction / INERTIA).exp();
            q += h * v;
            v = v * (-0.5 * h * friction / INERTIA).exp() + 0.5 * h * pull(q);
        }
    }
    text
}

/// The model, whose log names its column as the encoder's maker does.
fn model() -> String {
    format!(
        "name = \"pendulum\"\n\
         lagrangian = {{ coordinates = [\"phi\"], angles = [\"phi\"], kinetic = \"0.5*{INERTIA}*phi_dot^2\", potential = \"-{WEIGHT}*cos(phi)\" }}\n\
         [[input]]\nname = \"motor\"\njoint = \"phi\"\n\
         [sensor.phi]\nposition_noise = {NOISE}\nvelocity = \"none\"\n\
         [log.columns] # as the encoder's maker calls it\n\"q.phi\" = \"angle\"\n"
    )
}

/// The diagnosis in a folder, with the new model.
fn diagnosed(friction: f64, dir: &Path) -> (Diagnosis, Model) {
    let model = Model::parse(Path::new("pendulum.toml"), model()).unwrap();
    let path = dir.join("log.csv");
    std::fs::write(&path, from_the_top_in_degrees(friction)).unwrap();
    let log = Log::read(&path, &model).unwrap();
    let outcome = diagnose(&model, &[log], &[], dir, 0, &|_| ()).unwrap();
    let new = Model::load(&outcome.model).unwrap();
    (outcome.diagnosis, new)
}

#[test]
fn degrees_from_the_top_are_read_so_and_by_the_new_model_too() {
    let dir = tempfile::tempdir().unwrap();
    let (found, new) = diagnosed(0.0, dir.path());
    assert_eq!(found.verdict, Verdict::DataFault, "{:?}", found.effects);
    let faults: Vec<(&str, &str)> = found
        .data_faults
        .iter()
        .map(|f| (f.kind.as_str(), f.column.as_str()))
        .collect();
    assert_eq!(faults, [("convention", "q.phi")]);
    let said = &found.data_faults[0].detail;
    for part in ["is in degrees", "the other way round", "half a turn away"] {
        assert!(said.contains(part), "{said}");
    }
    let mapping = Mapping {
        scale: -PI / 180.0,
        offset: PI,
        ..Mapping::new("q.phi", "angle")
    };
    assert_eq!(new.columns.mappings, [mapping]);
    assert!(found.gap.after < 5.0, "{:?}", found.gap);
}

#[test]
fn what_is_missing_is_found_behind_another_way_to_count() {
    const FRICTION: f64 = 0.015;
    let dir = tempfile::tempdir().unwrap();
    let (found, _) = diagnosed(FRICTION, dir.path());
    let why = (&found.effects, &found.unexplained, &found.gap);
    assert_eq!(found.verdict, Verdict::EffectsFound, "{why:?}");
    let [effect] = &found.effects[..] else {
        panic!("{:?}", found.effects)
    };
    assert_eq!(effect.kind, "viscous_friction");
    let coefficient = &effect.parameters["coefficient"];
    let off = (coefficient.value - FRICTION).abs();
    assert!(
        off < 4.0 * coefficient.std.unwrap().max(0.002 * FRICTION),
        "{coefficient:?}"
    );
    assert_eq!(found.data_faults[0].kind, "convention");
}

/// They read the log as it is, and say that it counts otherwise.
#[cfg(feature = "cli")]
#[test]
fn evaluations_and_trainings_warn_of_a_log_that_counts_otherwise_and_of_no_other() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    std::fs::write(folder.join("log.csv"), from_the_top_in_degrees(0.002)).unwrap();
    let given = model();
    let as_meant = given.replace(
        "\"angle\"",
        &format!(
            "{{ column = \"angle\", scale = {}, offset = {PI} }}",
            -PI / 180.0
        ),
    );
    for (name, text) in [("given.toml", &given), ("meant.toml", &as_meant)] {
        std::fs::write(folder.join(name), text).unwrap();
        let evaluate: &[&str] = &["evaluate", name, "log.csv", "--initial", "estimated"];
        let train: &[&str] = &[
            "train",
            name,
            "log.csv",
            "--baseline",
            "ode",
            "--out",
            "fitted",
        ];
        for arguments in [evaluate, train] {
            let words = stderr(&pinode(arguments, folder));
            let told = words.contains("counts the other way round")
                && words.contains("[log.columns] of the model");
            assert_eq!(told, name == "given.toml", "{arguments:?}: {words}");
        }
    }
}

#[test]
fn a_log_that_was_read_for_another_model_is_refused_by_its_columns() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.csv");
    std::fs::write(&path, from_the_top_in_degrees(0.0)).unwrap();
    let parse = |more: &str| {
        let text = format!(
            "lagrangian = {{ coordinates = [\"phi\"], angles = [\"phi\"], kinetic = \"0.5*phi_dot^2\", potential = \"0\" }}\n\
             {more}\n[log.columns]\n\"q.phi\" = \"angle\"\n"
        );
        Model::parse(Path::new("model.toml"), text).unwrap()
    };
    let without_input = parse("");
    let log = Log::read(&path, &without_input).unwrap();
    let with_input = parse("[[input]]\nname = \"motor\"\njoint = \"phi\"");
    let refused = diagnose(&with_input, &[log], &[], dir.path(), 0, &|_| ());
    let Err(Error::OtherModel {
        what,
        found,
        expected,
        ..
    }) = refused
    else {
        panic!("it was taken")
    };
    assert_eq!((what, found, expected), ("inputs", 0, 1));
}
