//! The truth of these tests is a sledge, stepped by its own law in short steps: nothing of the simulators of the crate.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::menu::{Setup, Shape};
use super::*;
use crate::diagnose::comparison::Comparison;
use crate::diagnose::setup::{Prepared, prepare};
use crate::diagnose::{Means, audit};
use crate::log::Log;
use crate::model::Model;

const MASS: f64 = 2.0;
const NOISE: f64 = 2e-4;
/// Interval of the log, s.
const DT: f64 = 0.02;

/// m v̇ = f(v, u, t), and v = 0 where `holds` says that friction holds it; positions at the samples.
fn sledge(u: &[f64], force: &dyn Fn(f64, f64) -> f64, holds: &dyn Fn(f64) -> bool) -> Vec<f64> {
    let (mut x, mut v) = (0.0, 0.0);
    let mut out = Vec::new();
    let steps = 400;
    let h = DT / f64::from(steps);
    for &u in u {
        out.push(x);
        for _ in 0..steps {
            if v == 0.0 && holds(u) {
                continue;
            }
            // At rest it starts the way the rest of the forces push.
            let next = v + h * force(v, u) / MASS;
            let stops = v * next < 0.0 && holds(u);
            x += 0.5 * h * (v + if stops { 0.0 } else { next });
            v = if stops { 0.0 } else { next };
        }
    }
    out
}

/// Friction of these sizes for either direction, and a force.
fn with_friction([positive, negative]: [f64; 2], constant: f64, u: &[f64]) -> Vec<f64> {
    let drive = |u: f64| u + constant;
    let force = move |v: f64, u: f64| match v {
        v if v > 0.0 => drive(u) - positive,
        v if v < 0.0 => drive(u) + negative,
        _ if drive(u) > positive => drive(u) - positive,
        _ => drive(u) + negative,
    };
    let holds = move |u: f64| (-negative..=positive).contains(&drive(u));
    sledge(u, &force, &holds)
}

/// Viscous friction, behind a lag or a delay of the input of `late` s.
fn with_late_input(lags: bool, late: f64, coefficient: f64, u: &[f64]) -> Vec<f64> {
    let steps = 400;
    let h = DT / f64::from(steps);
    let (mut x, mut v, mut f) = (0.0, 0.0, u[0]);
    let mut out = Vec::new();
    for k in 0..u.len() {
        out.push(x);
        for i in 0..steps {
            let t = DT * k as f64 + h * f64::from(i) - late;
            let old = u[(t / DT).floor().max(0.0) as usize];
            f = if lags { f + h / late * (u[k] - f) } else { old };
            let next = v + h * (f - coefficient * v) / MASS;
            x += 0.5 * h * (v + next);
            v = next;
        }
    }
    out
}

fn write_log(path: &Path, u: &[f64], x: &[f64]) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut text = "t,q.x,u.push\n".to_owned();
    for (k, (u, x)) in u.iter().zip(x).enumerate() {
        let noise: f64 = rng.sample(StandardNormal);
        text += &format!("{},{},{u}\n", DT * k as f64, x + NOISE * noise);
    }
    std::fs::write(path, text).unwrap();
}

/// The sledge as a URDF with a rail, or as energies without one.
fn model(dir: &Path, rail: bool, rest: &str) -> Model {
    let urdf = r#"<robot name="sledge"><link name="rail"/><link name="cart"><inertial><mass value="2"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
      <joint name="x" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
      <limit lower="-9" upper="9" effort="100" velocity="100"/></joint></robot>"#;
    std::fs::write(dir.join("sledge.urdf"), urdf).unwrap();
    let mechanism = match rail {
        true => "urdf = \"sledge.urdf\"\n",
        false => {
            "[lagrangian]\ncoordinates = [\"x\"]\nkinetic = \"0.5*m*x_dot^2\"\npotential = \"0\"\nparameters = { m = 2.0 }\n"
        }
    };
    let mass = match rail {
        true => "mass = 1e-3",
        false => "parameters = { m = 1e-3 }",
    };
    let text = format!(
        "name = \"sledge\"\n{mechanism}[[input]]\nname = \"push\"\njoint = \"x\"\n\
         [sensor.x]\nposition_noise = {NOISE}\nvelocity = \"none\"\n[tolerance]\ngain = 0.0\n{mass}\n{rest}"
    );
    let path = dir.join("sledge.toml");
    std::fs::write(&path, text).unwrap();
    Model::load(&path).unwrap()
}

fn on_x(kind: &str) -> Candidate {
    Candidate::named(kind, 0)
}

/// The log, and a search that found `own` and cannot tell it from `other`.
fn found(
    model: &Model,
    log: &Path,
    (own, values): (Candidate, &[f64]),
    rivals: &[(Candidate, &[f64])],
    other: Candidate,
) -> (Prepared, Search) {
    let log = Log::read(log, model).unwrap();
    let audited = audit::audit(model, &[log], &[]);
    let means = Means::default();
    let prepared = prepare(model, audited.observations, 1, &audited.masked, &means).unwrap();
    let (study, null) = (&prepared.study, &prepared.null);
    let with = |(candidate, values): (Candidate, &[f64])| {
        let (hybrid, theta) = candidate.place(&null.hybrid, &null.inside.theta, values);
        study.fit(hybrid, null.start(theta), 1, 12)
    };
    let fitted = with((own, values));
    let found = Found {
        candidate: own,
        confidence: 0.6,
        alternatives: Vec::new(),
        indistinguishable: vec![other],
        rivals: rivals.iter().map(|r| (r.0, with(*r))).collect(),
        comparison: Comparison::of(&fitted, null),
        unseen_spring: None,
        instead: None,
    };
    let search = Search {
        null: null.clone(),
        base: null.clone(),
        steps: Vec::new(),
        gain: found.comparison.total(),
        found: vec![found],
        model: fitted,
        taught: None,
        study: study.clone(),
        smooth: None,
        left: None,
        pushed: false,
    };
    (prepared, search)
}

fn names() -> Vec<String> {
    vec!["push".to_owned()]
}

const FRICTION: f64 = 1.0;
const FORCE: f64 = 0.4;

/// A sledge that a constant force pulls against its friction, logged while it slides to and fro.
fn pulled(dir: &Path, rail: bool) -> (Prepared, Search) {
    let known = "[[effect]]\nkind = \"coulomb_friction\"\njoint = \"x\"\nforce = 1.0\n";
    let model = model(dir, rail, known);
    let u: Vec<f64> = (0..900)
        .map(|k| {
            let t = DT * f64::from(k);
            6.0 * (4.0 * t).sin() + 3.0 * (7.1 * t).cos() - FORCE
        })
        .collect();
    let x = with_friction([FRICTION; 2], FORCE, &u);
    write_log(&dir.join("log.csv"), &u, &x);
    let own = on_x("constant_force");
    let other = on_x("asymmetric_coulomb_friction");
    found(&model, &dir.join("log.csv"), (own, &[0.3]), &[], other)
}

#[test]
fn a_constant_force_is_told_from_friction_with_a_direction_by_turning_the_rail() {
    let dir = tempfile::tempdir().unwrap();
    let (prepared, search) = pulled(dir.path(), true);
    let splits = splits(&prepared.study, &search, &names(), &|_| {});
    assert_eq!(splits.len(), 1);
    let Outcome::Splits(experiments) = &splits[0].outcome else {
        panic!("the rail can be turned");
    };
    // At rest as well the two are one law: friction of F± = F ∓ F₀ holds what friction F beside a force F₀ holds.
    for experiment in experiments {
        eprintln!("{} {:?}", experiment.sentence, experiment.differences);
        assert!(experiment.turned, "{}", experiment.sentence);
    }
    assert!(experiments[0].largest().1 > 10.0);
}

#[test]
fn without_a_rail_to_turn_they_are_one_effect() {
    let dir = tempfile::tempdir().unwrap();
    let (prepared, search) = pulled(dir.path(), false);
    let splits = splits(&prepared.study, &search, &names(), &|_| {});
    assert!(matches!(splits[0].outcome, Outcome::OneEffect));
}

#[test]
fn predicted_differences_are_those_of_an_independent_simulation() {
    let dir = tempfile::tempdir().unwrap();
    let (prepared, search) = pulled(dir.path(), true);
    let study = &prepared.study;
    let other = on_x("asymmetric_coulomb_friction");
    let rival = rival::fitted(study, &search, &search.found[0], other).unwrap();
    let trials = menu::menu(
        study,
        &search.model,
        (search.found[0].candidate, other),
        &rival,
    );
    let mut compared = 0;
    for trial in trials.iter().flatten().filter(|t| t.setup == Setup::Turned) {
        if matches!(trial.shape, Shape::Decay(_)) {
            continue;
        }
        let Some(tried) = Tried::new(study, [&search.model, &rival], trial.clone(), 1) else {
            continue;
        };
        // The truth, and what it would be if the log had been one of friction with a direction.
        let u = &trial.u[0];
        let pulled = with_friction([FRICTION; 2], -FORCE, u);
        let rubbed = with_friction([FRICTION - FORCE, FRICTION + FORCE], 0.0, u);
        let pairs = pulled.iter().zip(&rubbed).take(tried.count);
        let squares: f64 = pairs.map(|(a, b)| ((a - b) / NOISE).powi(2)).sum();
        let expected = (squares / tried.count as f64).sqrt();
        eprintln!(
            "{}: {} and {expected}",
            trial.words(&search.model.hybrid, &names(), trial.duration),
            tried.largest()
        );
        // The fitted constants are off by their errors, and the noise by that of its estimate.
        let close = (tried.largest() - expected).abs() < 0.1 * expected + 1.0;
        assert!(close, "{} and {expected}", tried.largest());
        compared += 1;
    }
    assert!(compared >= 3, "{compared} experiments stay in the reach");
}

#[test]
fn a_lag_is_told_from_a_delay_by_sharp_inputs() {
    let dir = tempfile::tempdir().unwrap();
    let known =
        "[[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 4.0\nfixed = true\n";
    let model = model(dir.path(), true, known);
    // Slow inputs, by which a lag is a delay.
    let u: Vec<f64> = (0..900)
        .map(|k| 8.0 * (2.0 * DT * f64::from(k)).sin())
        .collect();
    let late = 0.06;
    let x = with_late_input(true, late, 4.0, &u);
    write_log(&dir.path().join("log.csv"), &u, &x);
    let (own, other) = (on_x("actuator_lag"), on_x("input_delay"));
    let (prepared, search) = found(
        &model,
        &dir.path().join("log.csv"),
        (own, &[0.05]),
        &[(other, &[0.05])],
        other,
    );
    let splits = splits(&prepared.study, &search, &names(), &|_| {});
    let Outcome::Splits(experiments) = &splits[0].outcome else {
        panic!("sharp inputs tell a lag from a delay");
    };
    for experiment in experiments {
        eprintln!("{} {:?}", experiment.sentence, experiment.differences);
    }
    let best = &experiments[0];
    let sharp = ["steps", "square_wave", "chirp", "push_and_coast"];
    assert!(
        sharp.contains(&best.experiment.as_str()),
        "{}",
        best.sentence
    );
}

#[test]
fn a_model_is_not_told_from_itself() {
    let dir = tempfile::tempdir().unwrap();
    let (prepared, search) = pulled(dir.path(), true);
    let own = on_x("constant_force");
    let trials = menu::menu(&prepared.study, &search.model, (own, own), &search.model);
    let against = Name {
        kind: "constant_force".into(),
        target: "x".into(),
    };
    let outcome = best(
        &prepared.study,
        &search.model,
        &search.model,
        trials,
        &against,
        &names(),
    );
    assert!(matches!(outcome, Outcome::OneEffect));
}

#[test]
fn two_models_of_one_mechanism_with_other_masses_are_brought_together() {
    // What a slightly other mass explains tells no names apart: the mass of the second is two standard errors off.
    let dir = tempfile::tempdir().unwrap();
    let (prepared, search) = pulled(dir.path(), true);
    let mut other = search.model.clone();
    let errors = other.inside.standard_errors();
    let place = other.inside.free.iter().position(|&i| i == 0).unwrap();
    other.inside.theta[0] += 2.0 * errors[place];
    let own = on_x("constant_force");
    let study = &prepared.study;
    let trials = menu::menu(study, &search.model, (own, own), &other);
    let models = [&search.model, &other];
    let tried = trials
        .into_iter()
        .flatten()
        .filter_map(|trial| Tried::new(study, models, trial, 1))
        .max_by(|a, b| a.largest().total_cmp(&b.largest()))
        .unwrap();
    let left = apart::least(
        study,
        models,
        &tried.trial,
        1,
        &tried.simulated,
        tried.count,
    );
    eprintln!("{:?} of {:?}", left, tried.differences);
    assert!(left[0] < 0.2 * tried.largest() + 0.1);
}
