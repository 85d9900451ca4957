//! One case from its rig to its line.

use std::path::{Path, PathBuf};
use std::time::Instant;

use pinode_nn::diagnose::diagnose_without;
use pinode_nn::diagnose::verdict::{Diagnosis, NamedEffect, Residual};
use pinode_nn::effect::{ActsOn, Kind, registry};
use pinode_nn::evaluate::{Options, evaluate};
use pinode_nn::free_run::Initial;
use pinode_nn::log::Log;
use pinode_nn::model::{EffectEntry, Model, Revision, Target};

use super::case::{Case, Prepared, Set};
use super::line::{FreeRun, Line, Name, Named, Truth};
use crate::config::ConfigError;
use crate::rig;

/// The diagnosis has its own seed, that of `pinode diagnose` without `--seed`.
const SEED_OF_THE_DIAGNOSIS: u64 = 0;
/// Free runs over the fresh recording.
const WINDOWS: usize = 60;

/// What keeps the bench from making a line. A diagnosis that fails makes one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The settings of the rig.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The rig.
    #[error(transparent)]
    Rig(#[from] rig::Error),
    /// The user's model or the log, or the folder for them.
    #[error(transparent)]
    Workflow(#[from] pinode_nn::Error),
    /// A set that a rig has not.
    #[error(
        "the rig `{rig}` has no set `{set}`: it has `one`, `nothing` and `removed`; `cartpole` has them all"
    )]
    NoSuchSet {
        /// The set.
        set: &'static str,
        /// The rig.
        rig: &'static str,
    },
    /// A rate for a rig that has one.
    #[error("the rig `{rig}` logs at 50 Hz only: leave `--rate` out; `cartpole` has it")]
    OneRate {
        /// The rig.
        rig: &'static str,
    },
    /// A file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Error {
    /// An I/O error at `path`.
    pub fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Error::Io { path, source }
    }
}

/// Makes the log of `case` in `dir`, has it diagnosed by the threads that this is called from, and writes down what was said. `models`
/// is the folder of the mechanisms. With `alone`, no other log runs in this process: its memory is measured.
///
/// # Errors
/// Where the rig or the user's model fails. A diagnosis that fails is a line with an `error`.
pub fn run(case: &Case, models: &Path, dir: &Path, alone: bool) -> Result<Line, Error> {
    let prepared = case.prepare(models, dir)?;
    let model = Model::load(&prepared.model)?;
    let log = Log::read(&prepared.log, &model)?;
    let without = match case.set {
        Set::Removed => prepared.hidden.iter().flat_map(removed).collect(),
        _ => Vec::new(),
    };
    if alone {
        memory::forget_peak();
    }
    let start = Instant::now();
    let found = diagnose_without(
        &model,
        std::slice::from_ref(&log),
        &[],
        &dir.join("out"),
        SEED_OF_THE_DIAGNOSIS,
        &without,
        &|_| {},
    );
    let seconds = start.elapsed().as_secs_f64();
    let peak_mb = if alone { memory::peak_mb() } else { None };
    let mut line = Line {
        id: case.id(),
        rig: case.rig,
        set: case.set,
        noise: case.noise,
        seed: case.seed,
        duration: prepared.duration,
        rate: case.rate,
        hidden: prepared.hidden.clone(),
        size: prepared.size,
        verdict: "error".into(),
        unexplained: false,
        named: Vec::new(),
        data_faults: Vec::new(),
        gap: None,
        residual: None,
        free_run: None,
        seconds,
        threads: rayon::current_num_threads(),
        peak_mb,
        error: None,
    };
    match found {
        Err(error) => line.error = Some(error.to_string()),
        Ok(outcome) => {
            let said = outcome.diagnosis;
            line.verdict = serde_json::to_value(said.verdict)
                .ok()
                .and_then(|v| v.as_str().map(str::to_owned))
                .unwrap_or_default();
            line.unexplained = said.unexplained.is_some();
            line.named = said.effects.iter().map(named).collect();
            line.data_faults = said.data_faults.iter().map(|f| f.kind.clone()).collect();
            line.gap = Some([said.gap.before, said.gap.after]);
            let largest =
                |f: fn(&Residual) -> f64| said.residuals.iter().map(f).fold(0.0, f64::max);
            line.residual = Some([largest(|r| r.before), largest(|r| r.after)]);
            let revised = Model::load(&outcome.model)?;
            line.free_run = free_run(&model, &revised, &prepared, &said, dir);
        }
    }
    Ok(line)
}

/// Kinds of one equation: of an offset of the motor, of a force on what it drives and, while that slides, of a difference of friction between the
/// directions.
const OFFSETS: [&str; 3] = [
    "input_offset",
    "constant_force",
    "asymmetric_coulomb_friction",
];
/// And of what slides along the level rail of the cart-pole.
const SLIDING: [&str; 2] = ["added_mass", "reflected_inertia"];

/// The kinds without which the library knows nothing of `truth`: its own, those that that is a special case of, and those of its equation.
fn removed(truth: &Truth) -> Vec<&'static Kind> {
    let kind = truth.kind.as_str();
    let slides = ["cart", "slider"].contains(&truth.target.as_str());
    let alike: &[&str] = match kind {
        _ if OFFSETS.contains(&kind) => &OFFSETS,
        _ if slides && SLIDING.contains(&kind) => &SLIDING,
        _ => &[kind],
    };
    let is_removed =
        |k: &&Kind| alike.contains(&k.name) || alike.iter().any(|own| k.contains.contains(own));
    registry::ALL.iter().copied().filter(is_removed).collect()
}

fn named(effect: &NamedEffect) -> Named {
    let name = |kind: &str, target: &str| Name {
        kind: kind.to_owned(),
        target: target.to_owned(),
    };
    Named {
        kind: effect.kind.clone(),
        target: effect.target.clone(),
        confidence: effect.confidence,
        parameters: effect
            .parameters
            .iter()
            .map(|(name, p)| (name.clone(), (p.value, p.std)))
            .collect(),
        alternatives: effect
            .alternatives
            .iter()
            .map(|a| (name(&a.kind, &a.target), a.confidence))
            .collect(),
        indistinguishable_from: effect
            .indistinguishable_from
            .iter()
            .map(|n| name(&n.kind, &n.target))
            .collect(),
    }
}

/// Free runs over the fresh recording; none where a model cannot be run over it.
fn free_run(
    model: &Model,
    revised: &Model,
    prepared: &Prepared,
    said: &Diagnosis,
    dir: &Path,
) -> Option<FreeRun> {
    let fresh = Log::read(&prepared.fresh, model).ok()?;
    let logs = [fresh];
    let options = Options {
        windows: WINDOWS,
        initial: Initial::Estimated,
        ..Options::default()
    };
    let error = |model: &Model| -> Option<f64> {
        let evaluation = evaluate(model, &logs, &options).ok()?;
        if evaluation.diverged > 0 {
            return None;
        }
        let mut sum = 0.0;
        for coordinate in &said.gap.coordinates {
            let signal = evaluation
                .coordinates
                .iter()
                .find(|c| c.name == coordinate.name)?;
            sum += (signal.rmse / coordinate.noise).powi(2);
        }
        Some((sum / said.gap.coordinates.len() as f64).sqrt()).filter(|x| x.is_finite())
    };
    Some(FreeRun {
        before: error(model)?,
        after: error(revised)?,
        truth: true_model(model, prepared, dir).as_ref().and_then(error),
    })
}

/// The user's model with the hidden effects at their true values, where the library has their forms.
fn true_model(model: &Model, prepared: &Prepared, dir: &Path) -> Option<Model> {
    if !prepared.in_library {
        return None;
    }
    let mut revision = Revision::of(model);
    if let Some(masses) = &prepared.masses {
        if masses.len() != revision.parameter_values.len() {
            return None;
        }
        revision.parameter_values.clone_from(masses);
    }
    for (entry, _) in &mut revision.effects {
        let target = model.target_name(entry.target);
        for (kind, on, factor) in &prepared.known {
            if entry.kind.name == *kind && target == *on {
                entry.values.iter_mut().for_each(|x| *x *= factor);
            }
        }
    }
    for truth in &prepared.hidden {
        let entry = entry(model, truth)?;
        revision.effects.retain(|(other, _)| {
            other.target != entry.target || !entry.kind.contains.contains(&other.kind.name)
        });
        revision.effects.push((entry, String::new()));
    }
    let path = model
        .write_revision(&dir.join("true"), "model.toml", &revision)
        .ok()?;
    Model::load(&path).ok()
}

/// The effect of the library, where it has all parameters of the hidden one.
fn entry(model: &Model, truth: &Truth) -> Option<EffectEntry> {
    let kind = registry::find(&truth.kind)?;
    let values: Option<Vec<f64>> = kind
        .parameters
        .iter()
        .map(|p| truth.parameters.get(p.name).copied())
        .collect();
    let coordinates = (0..model.mechanics.coordinates().len()).map(Target::Coordinate);
    let inputs = (0..model.inputs.len()).map(Target::Input);
    let links = (0..model.tree.as_ref().map_or(0, |t| t.links().len())).map(Target::Link);
    let target = coordinates.chain(inputs).chain(links).find(|target| {
        let fits = matches!(
            (kind.acts_on(), target),
            (ActsOn::Joint | ActsOn::Sensor, Target::Coordinate(_))
                | (ActsOn::Input, Target::Input(_))
                | (ActsOn::Link, Target::Link(_))
        );
        fits && model.target_name(*target) == truth.target
    })?;
    Some(EffectEntry {
        kind,
        target,
        values: values?,
        smoothing: None,
        fixed: true,
    })
}

/// The most memory that the process has had; Linux tells.
mod memory {
    /// Begins anew with what the process has now.
    pub fn forget_peak() {
        let _ = std::fs::write("/proc/self/clear_refs", "5"); // elsewhere the peak is that of the whole process
    }

    /// MB; none where the system does not tell.
    pub fn peak_mb() -> Option<f64> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
        let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
        Some(kilobytes / 1024.0)
    }
}
