//! Networks that were trained for the same from different beginnings: their files, and how far what is measured may be from their mean.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::windows::border;
use super::{MODEL, Options, Trained, Training, WEIGHTS};
use crate::Error;
use crate::band::{Band, calibrate_from};
use crate::disk::{Together, refuse_overwriting};
use crate::evaluate;
use crate::free_run::Initial;
use crate::learnt::weights;
use crate::log::Run;
use crate::model::{Model, NetworkEntry, NewNetwork};
use crate::past::known_from;

/// The name of the weights of member `k` of `members`, from 0.
pub fn weights_name(k: usize, members: usize) -> String {
    match members {
        1 => WEIGHTS.to_owned(),
        _ => format!("network-{}.safetensors", k + 1),
    }
}

/// Writes the weights of networks that were trained for the same from different beginnings, and `model.toml`, the model with their mean in it and their
/// `band`, to `dir`, all or none; returns the path of the model. The constants are as fitted beside the first.
///
/// # Errors
/// As [`Model::write_revision`]; [`Error::Training`] without a member.
pub fn write_ensemble(
    members: &[Trained],
    model: &Model,
    band: Option<Band>,
    dir: &Path,
) -> Result<PathBuf, Error> {
    let first = first(members)?;
    let names: Vec<String> = (0..members.len())
        .map(|k| weights_name(k, members.len()))
        .collect();
    let outputs = names.iter().map(String::as_str).chain([MODEL]);
    let outputs: Vec<PathBuf> = outputs.map(|name| dir.join(name)).collect();
    refuse_overwriting(&outputs, &model.files())?;
    let mut files = Together::new(dir);
    for (member, name) in members.iter().zip(&names) {
        let path = dir.join(name);
        let bytes = weights::to_bytes(&path, &member.force, &member.card, member.single)?;
        files.put(name, &bytes)?;
    }
    let what = match members.len() {
        1 => "learnt".to_owned(),
        n => format!("{n} networks, whose mean is the force, learnt"),
    };
    let joints = first.card.joints.iter().map(|joint| joint.name.clone());
    let windows = first.card.training.get("windows").cloned();
    let mut revision = first.revision.clone();
    revision.network = Some(NewNetwork {
        weights: names,
        joints: joints.collect(),
        comment: format!(
            "{what} by `pinode train` from {} windows; what it saw, and how well it does, is in the file's metadata",
            windows.unwrap_or_default()
        ),
    });
    revision.band = band;
    let path = model.stage_revision(&mut files, MODEL, &revision)?;
    files.commit()?;
    Ok(path)
}

fn first(members: &[Trained]) -> Result<&Trained, Error> {
    let none = || Error::Training("an ensemble has no member: train at least one".to_owned());
    members.first().ok_or_else(none)
}

/// The [band](crate::band) of networks trained with `options`, from free runs over what was held out, which told when to stop but was not learnt from: of 0.6 s,
/// or as long as the windows of the training where none is so long, from states by the past ([`Initial::Past`]).
///
/// # Errors
/// As [`calibrate`](crate::band::calibrate); [`Error::Training`] without a member.
pub fn band_of(
    members: &[Trained],
    training: &Training<'_>,
    options: &Options,
) -> Result<Band, Error> {
    let model = with_mean(members, training.model)?;
    let (unseen, part) = match training.held_out {
        [] => (training.logs, true),
        given => (given, false),
    };
    // The last part of what was learnt from: what is before it tells of the states there.
    let earliest = |run: &Run| match part {
        true => border(run.len()).max(known_from(run)),
        false => known_from(run),
    };
    let usual = evaluate::Options {
        initial: Initial::Past,
        longest_step: options.longest_step,
        ..evaluate::Options::default()
    };
    let shorter = evaluate::Options {
        horizon: options.horizon,
        ..usual
    };
    match calibrate_from(&model, unseen, &usual, earliest) {
        Err(Error::NoWindow { .. }) if shorter.horizon < usual.horizon => {
            calibrate_from(&model, unseen, &shorter, earliest)
        }
        found => found,
    }
}

/// The model with the mean of the members in it, as their files will have it.
fn with_mean(members: &[Trained], model: &Model) -> Result<Model, Error> {
    let first = first(members)?;
    let mut mean = model.revised(&first.revision);
    let last = mean.networks.last();
    let table = last.map_or(0, |entry| entry.table + 1);
    let entries = members.iter().enumerate().map(|(k, member)| NetworkEntry {
        table,
        share: 1.0 / members.len() as f64,
        weights: weights_name(k, members.len()),
        path: PathBuf::from(weights_name(k, members.len())),
        sha256: String::new(),
        single: member.single,
        force: Arc::new(member.force.clone()),
        card: member.card.clone(),
    });
    mean.networks.extend(entries);
    Ok(mean)
}
