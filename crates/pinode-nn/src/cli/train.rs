//! `pinode train`: learns a part of Q that no effect explains, through the integrator.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::Output;
use super::interrupt::Interruptible;
use crate::Error;
use crate::disk::write_atomically;
use crate::learnt::Quantity;
use crate::log::Log;
use crate::model::Model;
use crate::naming::{hint, quoted};
use crate::network::Activation;
use crate::train::{Checkpoint, Epoch, Options, Trained, Training, WEIGHTS, train};

/// What was done so far, in the folder of a training.
const CHECKPOINT: &str = "checkpoint.safetensors";
/// One JSON document an epoch.
const METRICS: &str = "metrics.jsonl";
/// Where no bar can be drawn, a line is written so often.
const EVERY: Duration = Duration::from_secs(10);

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// Logs, CSV files; without --holdout, the last eighth of each recording tells when to stop
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Joints that the network acts on
    #[arg(long = "joint", value_name = "JOINT", required = true, num_args = 1..)]
    joints: Vec<String>,
    /// Folder for model.toml, its weights, metrics and checkpoint
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Logs that the network does not learn from: they tell when to stop
    #[arg(long, value_name = "LOG", num_args = 1..)]
    holdout: Vec<PathBuf>,
    /// Go on from the checkpoint in the folder, to the same bits as without the interruption
    #[arg(long)]
    resume: bool,
    /// As in the paper: one step from the measured state, the network alone on its joints, Adam with 1e-3; other options still count
    #[arg(long)]
    paper: bool,
    /// What the network sees: q.JOINT, 'cos(q.JOINT)', 'sin(q.JOINT)', v.JOINT, u.INPUT, 'u.INPUT[-2]' (two samples ago)
    /// [default: all angles, those that wrap as cosine and sine, all velocities and inputs]
    #[arg(long, value_name = "NAME", num_args = 1..)]
    sees: Vec<String>,
    /// Units of the hidden layers
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', default_values_t = [50, 50, 50])]
    units: Vec<usize>,
    /// Activation of the hidden layers
    #[arg(long, value_enum, default_value_t = Hidden::Relu)]
    activation: Hidden,
    /// The network stands for all of Q on its joints, the inputs' forces included
    #[arg(long)]
    alone: bool,
    /// Length of a window, s, at least one sample interval [default: 0.4; with --paper one sample interval]
    #[arg(long, value_name = "S")]
    horizon: Option<f64>,
    /// Windows are seen at most so often [default: 300; with --paper 100]
    #[arg(long, value_name = "N")]
    epochs: Option<usize>,
    /// Windows a step [default: 32; with --paper 128]
    #[arg(long, value_name = "N")]
    batch: Option<usize>,
    /// Adam's first step [default: 2e-3, falling; with --paper 1e-3, constant]
    #[arg(long, value_name = "X")]
    rate: Option<f64>,
    /// Stop when so many epochs bring nothing on what is held out [default: 60; with --paper 20]
    #[arg(long, value_name = "N")]
    patience: Option<usize>,
    /// Precision of the network; the mechanics are always f64
    #[arg(long, value_enum, default_value_t = Precision::F32)]
    precision: Precision,
    /// Leave the constants of the model and its effects as they are, instead of fitting them first
    #[arg(long)]
    keep_physics: bool,
    /// Longest integration step, s
    #[arg(long, value_name = "S", default_value_t = 0.02)]
    step: f64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Hidden {
    /// max(z, 0), as in the paper
    Relu,
    /// Smooth
    Tanh,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Precision {
    /// 32 bits: twice as fast
    F32,
    /// 64 bits
    F64,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    model: String,
    weights: String,
    metrics: String,
    parameters: usize,
    windows: Option<u64>,
    epochs: usize,
    best_epoch: usize,
    loss: Option<f64>,
    held_out: Option<f64>,
    held_out_without_network: Option<f64>,
    network: &'a crate::learnt::Card,
}

pub(super) fn run(arguments: &Arguments, seed: u64, output: &Output) -> Result<(), Error> {
    let model = output.load_model(&arguments.model)?;
    let read = |paths: &[PathBuf]| {
        let logs = paths.iter().map(|path| output.read_log(path, &model));
        logs.collect::<Result<Vec<Log>, _>>()
    };
    let (logs, held_out) = (read(&arguments.logs)?, read(&arguments.holdout)?);
    let options = options(arguments, seed, &model)?;
    let out = arguments.out.as_path();
    refuse_overwriting(&model, out)?;
    std::fs::create_dir_all(out).map_err(|e| Error::io(out, e))?;
    let checkpoint = Checkpoint {
        path: out.join(CHECKPOINT),
        resume: arguments.resume,
    };
    let interruptible = Interruptible::training(checkpoint.path.clone(), output.quiet);
    let training = Training {
        model: &model,
        logs: &logs,
        held_out: &held_out,
    };
    let mut watch = Watch::new(output, &options, out.join(METRICS));
    let trained = train(&training, &options, Some(&checkpoint), &mut |epoch| {
        watch.epoch(epoch)
    })?;
    drop(watch);
    let whole = interruptible.wait();
    let path = trained.write(&model, out)?;
    // Finished: there is nothing to go on with.
    let _ = std::fs::remove_file(&checkpoint.path);
    drop(whole);
    let report = report(&trained, &path, out);
    output.result(&report, &text(&report, &trained))
}

fn options(arguments: &Arguments, seed: u64, model: &Model) -> Result<Options, Error> {
    let coordinates = model.mechanics.coordinates();
    let names: Vec<&str> = coordinates.iter().map(|c| c.name.as_str()).collect();
    let mut joints = Vec::new();
    for joint in &arguments.joints {
        let Some(index) = names.iter().position(|name| name == joint) else {
            return Err(Error::Training(format!(
                "unknown joint {}{}",
                quoted(joint),
                hint(joint, "joints", &names)
            )));
        };
        joints.push(index);
    }
    let inputs: Vec<&str> = model.inputs.iter().map(|i| i.name.as_str()).collect();
    let mut quantities = Vec::new();
    for name in &arguments.sees {
        let Some(quantity) = Quantity::from_name(name, coordinates, &inputs) else {
            return Err(Error::Training(format!(
                "the network cannot see {}: this model has q., v., cos(q.…) and sin(q.…) of {}, and u. of {}",
                quoted(name),
                names.join(", "),
                if inputs.is_empty() {
                    "no input".to_owned()
                } else {
                    inputs.join(", ")
                }
            )));
        };
        quantities.push(quantity);
    }
    let base = match arguments.paper {
        true => Options::paper(joints),
        false => Options::new(joints),
    };
    Ok(Options {
        quantities,
        units: arguments.units.clone(),
        hidden: match arguments.activation {
            Hidden::Relu => Activation::Relu,
            Hidden::Tanh => Activation::Tanh,
        },
        alone: base.alone || arguments.alone,
        horizon: arguments.horizon.unwrap_or(base.horizon),
        epochs: arguments.epochs.unwrap_or(base.epochs),
        batch: arguments.batch.unwrap_or(base.batch),
        rate: arguments.rate.unwrap_or(base.rate),
        patience: arguments.patience.unwrap_or(base.patience),
        single: matches!(arguments.precision, Precision::F32),
        physics: base.physics && !arguments.keep_physics,
        longest_step: arguments.step,
        seed,
        ..base
    })
}

/// Said before the work, not after it.
fn refuse_overwriting(model: &Model, out: &Path) -> Result<(), Error> {
    let path = out.join("model.toml");
    match (path.canonicalize(), model.path.canonicalize()) {
        (Ok(new), Ok(old)) if new == old => Err(Error::OverwritesInput { path }),
        _ => Ok(()),
    }
}

/// Tells how the epochs go.
struct Watch<'a> {
    output: &'a Output,
    epochs: usize,
    bar: ProgressBar,
    metrics: PathBuf,
    lines: Vec<u8>,
    began: Instant,
    told: Option<Instant>,
    best: f64,
}

impl<'a> Watch<'a> {
    fn new(output: &'a Output, options: &Options, metrics: PathBuf) -> Self {
        let bar = match output.quiet {
            true => ProgressBar::hidden(),
            false => ProgressBar::new(options.epochs as u64),
        };
        if let Ok(style) =
            ProgressStyle::with_template("{pos}/{len} {elapsed} {msg} (at most {eta} left)")
        {
            bar.set_style(style);
        }
        Watch {
            output,
            epochs: options.epochs,
            bar,
            metrics,
            lines: Vec::new(),
            began: Instant::now(),
            told: None,
            best: f64::INFINITY,
        }
    }

    fn epoch(&mut self, epoch: &Epoch) -> Result<(), Error> {
        self.best = self.best.min(epoch.held_out);
        let line = serde_json::to_string(epoch).map_err(|e| Error::io(&self.metrics, e.into()))?;
        // A Vec takes all.
        let _ = writeln!(self.lines, "{line}");
        write_atomically(&self.metrics, &self.lines)?;
        let message = format!(
            "loss {:.4}, held out {:.4} (best {:.4})",
            epoch.loss, epoch.held_out, self.best
        );
        self.bar.set_position(epoch.epoch as u64);
        self.bar.set_message(message.clone());
        let due = self.told.is_none_or(|told| told.elapsed() > EVERY);
        if self.bar.is_hidden() && due {
            let left = self.began.elapsed().as_secs_f64() / epoch.epoch as f64
                * (self.epochs - epoch.epoch) as f64;
            self.output.note(&format!(
                "epoch {} of {}: {message}, at most {left:.0} s left",
                epoch.epoch, self.epochs
            ));
            self.told = Some(Instant::now());
        }
        Ok(())
    }
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

fn report<'a>(trained: &'a Trained, model: &Path, out: &Path) -> Report<'a> {
    let best = trained
        .history
        .iter()
        .find(|epoch| epoch.epoch == trained.best_epoch);
    Report {
        model: model.display().to_string(),
        weights: out.join(WEIGHTS).display().to_string(),
        metrics: out.join(METRICS).display().to_string(),
        parameters: trained.force.network().parameters().len(),
        windows: trained
            .card
            .training
            .get("windows")
            .and_then(|n| n.as_u64()),
        epochs: trained.history.len(),
        best_epoch: trained.best_epoch,
        loss: best.map(|epoch| epoch.loss),
        held_out: best.map(|epoch| epoch.held_out),
        held_out_without_network: trained.without_network,
        network: &trained.card,
    }
}

fn text(report: &Report<'_>, trained: &Trained) -> String {
    let number = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.4}"));
    let without = report.held_out_without_network;
    let before = without.map_or(String::new(), |x| format!(" (without the network {x:.4})"));
    let unit = match trained
        .card
        .training
        .get("loss_in")
        .and_then(|v| v.as_str())
    {
        Some(unit) => format!(", in {unit}"),
        None => String::new(),
    };
    format!(
        "a network of {} parameters, epoch {} of {}: loss {}, held out {}{before}{unit}\nwritten:\n  {}\n  {}\n  {}\n",
        report.parameters,
        report.best_epoch,
        report.epochs,
        number(report.loss),
        number(report.held_out),
        report.model,
        report.weights,
        report.metrics,
    )
}
