//! The diagnosis on real recordings, against what their publishers found. Skipped, loudly, where the recordings are not.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use pinode_nn::diagnose::diagnose;
use pinode_nn::diagnose::verdict::{Diagnosis, Verdict};
use pinode_nn::log::Log;
use pinode_nn::model::Model;

/// The recording called `name`: in the folder that PINODE_DATA names, or beside the repository.
fn recording(name: &str) -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let folder = std::env::var("PINODE_DATA").unwrap_or_else(|_| beside.into());
    let path = Path::new(&folder).join(name).join("data.csv");
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: no recording at {}", path.display());
    None
}

fn diagnosed(name: &str) -> Option<(Model, Diagnosis)> {
    let log = recording(name)?;
    let model = format!(
        "{}/../../models/{name}/{name}.toml",
        env!("CARGO_MANIFEST_DIR")
    );
    let model = Model::load(Path::new(&model)).unwrap();
    let log = Log::read(&log, &model).unwrap();
    let out = tempfile::tempdir().unwrap();
    let outcome = diagnose(&model, &[log], &[], out.path(), 0, &|_| {}).unwrap();
    let written = Model::load(&outcome.model).unwrap();
    // What moves these mechanisms is all in their logs, and their sensors see everywhere.
    for fault in &outcome.diagnosis.data_faults {
        let healthy = ["outliers", "quantum", "noise"];
        assert!(healthy.contains(&fault.kind.as_str()), "{fault:?}");
    }
    Some((written, outcome.diagnosis))
}

/// Janot, Gautier, Brunot 2019: M = 95.11 kg, F_v = 203.5 N·s/m, F_c = 20.39 N, offset −3.16 N.
#[test]
fn a_positioning_table_shows_its_viscous_and_coulomb_friction_and_its_offset() {
    let Some((model, diagnosis)) = diagnosed("emps") else {
        return;
    };
    assert_eq!(diagnosis.verdict, Verdict::EffectsFound);
    let value = |kind: &str, name: &str| {
        let effect = diagnosis.effects.iter().find(|e| e.kind == kind)?;
        Some(effect.parameters[name].value)
    };
    // What is asymmetric about either friction and what is an offset cannot be told apart at one speed: the table slides at 0.084 m/s on average.
    let uneven = value("asymmetric_viscous_friction", "coefficient_positive").map(|plus| {
        let minus = value("asymmetric_viscous_friction", "coefficient_negative").unwrap();
        (0.5 * (plus + minus), 0.5 * (minus - plus) * 0.084)
    });
    let viscous = match uneven {
        Some((mean, _)) => mean,
        None => value("viscous_friction", "coefficient").unwrap(),
    };
    assert!((viscous / 203.5 - 1.0).abs() < 0.1, "{viscous}");
    let (coulomb, offset) = match (value("coulomb_friction", "force"), uneven) {
        (Some(force), Some((_, offset))) => (force, offset),
        (Some(force), None) => (force, value("constant_force", "force").unwrap()),
        (None, _) => {
            let side = |name| value("asymmetric_coulomb_friction", name).unwrap();
            let (plus, minus) = (side("force_positive"), side("force_negative"));
            (0.5 * (plus + minus), 0.5 * (minus - plus))
        }
    };
    assert!((coulomb / 20.39 - 1.0).abs() < 0.1, "{coulomb}");
    assert!((offset - 3.16).abs() < 1.0, "{offset}");
    let mass = 100.0 * model.parameter_values[0];
    assert!((mass / 95.11 - 1.0).abs() < 0.05, "{mass}");
    assert!(diagnosis.gap.after < diagnosis.gap.before / 5.0);
}

/// Kaheman et al. 2022 fit viscous friction alone; the decay shows Coulomb friction and quadratic drag.
#[test]
fn a_free_pendulum_shows_coulomb_friction_and_drag_rather_than_viscous_friction() {
    let Some((_, diagnosis)) = diagnosed("map_single_pendulum") else {
        return;
    };
    let mut kinds: Vec<&str> = diagnosis.effects.iter().map(|e| e.kind.as_str()).collect();
    kinds.sort_unstable();
    assert_eq!(kinds, ["coulomb_friction", "quadratic_drag"]);
    assert!(diagnosis.gap.after < diagnosis.gap.before / 4.0);
}
