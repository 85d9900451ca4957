//! `pinode train`: learns a part of Q that no effect explains, through the integrator.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::Output;
use super::band::{calibrated, calibrated_words};
use super::folder::Made;
use super::interrupt::Interruptible;
use super::refused;
use crate::Error;
use crate::band::Band;
use crate::diagnose::counts_otherwise;
use crate::disk::{refuse_overwriting, write_atomically};
use crate::learnt::Quantity;
use crate::learnt::law::Law;
use crate::model::Model;
use crate::naming::{hint, quoted};
use crate::network::Activation;
use crate::train::{
    Checkpoint, Epoch, Known, MODEL, Options, Trained, Training, band_of, fit_physics, train,
    weights_name, write_ensemble,
};

/// What was done so far, in the folder of a training.
const CHECKPOINT: &str = "checkpoint.safetensors";
/// One JSON document an epoch.
const METRICS: &str = "metrics.jsonl";
/// This part of the epochs may bring nothing.
const PATIENCE: usize = 5;
/// A constant that a fit has moved by more than this part of its tolerance is told.
const TOLD: f64 = 0.1;
/// Where no bar can be drawn, a line is written so often.
const EVERY: Duration = Duration::from_secs(10);

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// Logs: CSV, Parquet or MCAP files; without --holdout, the last eighth of each recording tells when to stop
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Joints that the network acts on; a baseline needs none
    #[arg(long = "joint", value_name = "JOINT", required_unless_present = "baseline", num_args = 1..)]
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
    /// Networks to train, from so many seeds from --seed on: their mean is the force, and how far they are apart says how far it is known
    /// [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=100))]
    members: Option<u16>,
    /// Train instead what a network is compared with
    #[arg(long, value_enum, conflicts_with = "resume")]
    baseline: Option<Baseline>,
    /// As in the paper: one step from the measured state, the network alone on its joints, Adam with 1e-3; other options still count
    #[arg(long)]
    paper: bool,
    /// What the network sees: q.JOINT, 'cos(q.JOINT)', 'sin(q.JOINT)', v.JOINT, u.INPUT, 'u.INPUT[-2]' (two samples ago)
    /// [default: all angles, those that wrap as cosine and sine, displacements that an energy, a known spring, stop or periodic force depends on, all velocities and inputs]
    #[arg(long, value_name = "NAME", num_args = 1..)]
    sees: Vec<String>,
    /// Units of the hidden layers [default: 50,50,50]
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..))]
    units: Vec<u32>,
    /// Activation of the hidden layers [default: relu]
    #[arg(long, value_enum)]
    activation: Option<Hidden>,
    /// The inputs act on the network's joints through it alone; effects of the model stay beside it
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
    /// Adam stops when so many epochs bring nothing on what is held out [default: 60, with --paper 20, or a fifth of --epochs where that is more]
    #[arg(long, value_name = "N")]
    patience: Option<usize>,
    /// At most so many rounds of twenty steps of L-BFGS on all windows at once after that; they stop when one brings nothing on what is held out
    #[arg(long, value_name = "N", default_value_t = 0)]
    polish: usize,
    /// Precision of the network; the mechanics are always f64 [default: f32]
    #[arg(long, value_enum)]
    precision: Option<Precision>,
    /// Leave the constants of the model and its effects as they are, instead of fitting them first
    #[arg(long)]
    keep_physics: bool,
    /// Longest integration step, s
    #[arg(long, value_name = "S", default_value_t = 0.02)]
    step: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Baseline {
    /// The model alone: its constants and the parameters of its effects by least squares, no network
    Ode,
    /// The network alone: no mechanics, no effects, and it acts on all joints
    BlackBox,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Hidden {
    /// max(z, 0), as in the paper
    Relu,
    /// Smooth
    Tanh,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Precision {
    /// 32 bits: twice as fast
    F32,
    /// 64 bits
    F64,
}

impl Arguments {
    /// What is given for a network where there is none.
    pub fn contradiction(&self) -> Option<String> {
        let of_network = [
            ("--members", self.members.is_some()),
            ("--sees", !self.sees.is_empty()),
            ("--units", !self.units.is_empty()),
            ("--activation", self.activation.is_some()),
            ("--alone", self.alone),
            ("--epochs", self.epochs.is_some()),
            ("--batch", self.batch.is_some()),
            ("--rate", self.rate.is_some()),
            ("--patience", self.patience.is_some()),
            ("--polish", self.polish > 0),
            ("--precision", self.precision.is_some()),
            ("--keep-physics", self.keep_physics),
        ];
        let given = of_network.iter().filter(|(_, given)| *given);
        let names: Vec<&str> = given.map(|(name, _)| *name).collect();
        (self.baseline == Some(Baseline::Ode) && !names.is_empty()).then(|| {
            format!(
                "--baseline ode fits the model alone, without a network: leave out {}",
                names.join(", ")
            )
        })
    }
}

/// What `--json` prints: of the first network, and of all in `members` where there are several.
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
    constants: &'a [Known],
    network: &'a crate::learnt::Card,
    #[serde(skip)]
    laws: &'a [Law],
    warnings: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    members: Vec<Member>,
    #[serde(skip_serializing_if = "Option::is_none")]
    band: Option<serde_json::Value>,
}

/// One network of an ensemble.
#[derive(Serialize)]
struct Member {
    weights: String,
    metrics: String,
    epochs: usize,
    best_epoch: usize,
    loss: Option<f64>,
    held_out: Option<f64>,
}

pub(super) fn run(arguments: &Arguments, seed: u64, output: &Output) -> Result<(), Error> {
    let given = output.load_model(&arguments.model)?;
    let paths = (&arguments.logs[..], &arguments.holdout[..]);
    let (given, logs, held_out) = output.read_logs(paths, given)?;
    let model = match arguments.baseline {
        Some(Baseline::BlackBox) => given.without_mechanics(true)?,
        _ => given.clone(),
    };
    let mut options = options(arguments, seed, &model)?;
    if arguments.baseline == Some(Baseline::BlackBox) {
        options.joints = (0..model.mechanics.coordinates().len()).collect();
        options.alone = true;
        // Nothing of the model is left to be fitted.
        options.physics = false;
    }
    let out = arguments.out.as_path();
    let count = usize::from(arguments.members.unwrap_or(1));
    let outputs = match arguments.baseline {
        Some(Baseline::Ode) => vec![out.join(MODEL)],
        _ => outputs(out, count),
    };
    let read = logs.iter().chain(&held_out).map(|log| log.path.as_path());
    let inputs: Vec<&Path> = given.files().into_iter().chain(read).collect();
    refuse_overwriting(&outputs, &inputs)?;
    // Without mechanics nothing says how a log counts.
    if arguments.baseline != Some(Baseline::BlackBox) {
        output.warnings(&counts_otherwise(&given, &logs)?);
        output.warnings(&counts_otherwise(&given, &held_out)?);
    }
    let made = Made::folder(out)?;
    let training = Training {
        model: &model,
        logs: &logs,
        held_out: &held_out,
    };
    if arguments.baseline == Some(Baseline::Ode) {
        return fit_alone(&training, options, out, output);
    }
    let metrics: Vec<PathBuf> = (0..count)
        .map(|k| out.join(numbered(METRICS, k, count)))
        .collect();
    let checkpoints: Vec<PathBuf> = (0..count)
        .map(|k| out.join(numbered(CHECKPOINT, k, count)))
        .collect();
    if arguments.resume {
        refuse_finished(out, &checkpoints)?;
    }
    let mut members = Vec::new();
    // One for all members: between two of them an interruption would find nothing running, and say nothing.
    let interruptible = Interruptible::training(Vec::new(), &made, output.quiet);
    for (k, metrics) in metrics.iter().enumerate() {
        interruptible.goes_on_from(&checkpoints[..=k]);
        let options = Options {
            seed: seed.wrapping_add(k as u64),
            ..options.clone()
        };
        if count > 1 {
            output.note(&format!("member {} of {count}", k + 1));
        }
        let checkpoint = Checkpoint {
            path: checkpoints[k].clone(),
            resume: arguments.resume,
        };
        members.push(train_one(
            &training,
            &options,
            &checkpoint,
            metrics,
            output,
        )?);
    }
    let (band, no_band) = match count {
        1 => (None, None),
        _ => band(&members, &training, &options, output),
    };
    let whole = interruptible.wait();
    let path = write_ensemble(&members, &model, band.clone(), out)?;
    // Finished: there is nothing to go on with.
    for checkpoint in &checkpoints {
        let _ = std::fs::remove_file(checkpoint);
    }
    drop(whole);
    let Some(first) = members.first() else {
        return Ok(()); // at least one is trained
    };
    let mut report = report(&members, first, &path, out, &metrics);
    report.warnings.extend(no_band);
    report.band = band.as_ref().map(|band| calibrated(band, &model));
    let words = band.map_or(String::new(), |band| calibrated_words(&band, &model));
    output.warnings(&report.warnings);
    let text = text(&report, &words);
    output.result(&report, &text)
}

/// A training that has come to its end left its model and no checkpoint: to go on with it would be to begin again, over what it left.
fn refuse_finished(out: &Path, checkpoints: &[PathBuf]) -> Result<(), Error> {
    let path = out.join(MODEL);
    match path.exists() && !checkpoints.iter().any(|checkpoint| checkpoint.exists()) {
        true => Err(Error::Checkpoint {
            path,
            what: "is that of a finished training: there is nothing to resume".into(),
        }),
        false => Ok(()),
    }
}

/// The band of an ensemble, or why it has none.
fn band(
    members: &[Trained],
    training: &Training<'_>,
    options: &Options,
    output: &Output,
) -> (Option<Band>, Option<String>) {
    output
        .note("finding how far measurements are from what the ensemble says, on what is held out");
    match band_of(members, training, options) {
        Ok(band) => (Some(band), None),
        Err(error) => (
            None,
            Some(format!("the ensemble has no calibrated band: {error}")),
        ),
    }
}

/// Fits the model without a network.
fn fit_alone(
    training: &Training<'_>,
    options: Options,
    out: &Path,
    output: &Output,
) -> Result<(), Error> {
    let options = Options {
        physics: true,
        ..options
    };
    let fitted = fit_physics(training, &options)?;
    let path = training
        .model
        .write_revision(out, MODEL, &fitted.revision)?;
    output.warnings(&fitted.warnings);
    let model = path.display().to_string();
    let ([windows, diverged], [others, lost]) = (fitted.windows, fitted.windows_held_out);
    let text = format!(
        "the model alone, fitted: loss {:.4} ({diverged} of {windows} windows diverge), held out {:.4} ({lost} of {others})\nwritten:\n  {model}\n",
        fitted.loss, fitted.held_out
    );
    let document = serde_json::json!({
        "model": model,
        "windows": windows,
        "diverged": diverged,
        "loss": fitted.loss,
        "windows_held_out": others,
        "held_out_diverged": lost,
        "held_out": fitted.held_out,
        "warnings": fitted.warnings,
    });
    output.result(&document, &text)
}

/// Trains one network. Its checkpoint stays until all members of an ensemble are there.
fn train_one(
    training: &Training<'_>,
    options: &Options,
    checkpoint: &Checkpoint,
    metrics: &Path,
    output: &Output,
) -> Result<Trained, Error> {
    let mut watch = Watch::new(output, options, metrics.to_owned());
    train(training, options, Some(checkpoint), &mut |epoch| {
        watch.epoch(epoch)
    })
}

/// `metrics.jsonl`; of member k of an ensemble `metrics-2.jsonl`.
fn numbered(name: &str, k: usize, count: usize) -> String {
    match name.split_once('.') {
        Some((stem, ending)) if count > 1 => format!("{stem}-{}.{ending}", k + 1),
        _ => name.to_owned(),
    }
}

fn options(arguments: &Arguments, seed: u64, model: &Model) -> Result<Options, Error> {
    let coordinates = model.mechanics.coordinates();
    let names: Vec<&str> = coordinates.iter().map(|c| c.name.as_str()).collect();
    let (mut joints, mut wrong) = (Vec::new(), Vec::new());
    for joint in &arguments.joints {
        match names.iter().position(|name| name == joint) {
            None => wrong.push(format!(
                "unknown joint {}{}",
                quoted(joint),
                hint(joint, "joints", &names)
            )),
            Some(index) if joints.contains(&index) => {
                wrong.push(format!("the joint {} is given twice", quoted(joint)));
            }
            Some(index) => joints.push(index),
        }
    }
    refused("--joint", wrong)?;
    let inputs: Vec<&str> = model.inputs.iter().map(|i| i.name.as_str()).collect();
    let (mut quantities, mut wrong) = (Vec::new(), Vec::new());
    for name in &arguments.sees {
        match Quantity::from_name(name, coordinates, &inputs) {
            Some(quantity) => quantities.push(quantity),
            None => wrong.push(format!(
                "the network cannot see {}: this model has q., v., cos(q.…) and sin(q.…) of {}, and u. of {}",
                quoted(name),
                names.join(", "),
                if inputs.is_empty() {
                    "no input".to_owned()
                } else {
                    inputs.join(", ")
                }
            )),
        }
    }
    refused("--sees", wrong)?;
    let base = match arguments.paper {
        true => Options::paper(joints),
        false => Options::new(joints),
    };
    let epochs = arguments.epochs.unwrap_or(base.epochs);
    // The rate falls along all epochs: before it has, nothing may be gained for long.
    let patience = epochs.div_ceil(PATIENCE).max(base.patience);
    Ok(Options {
        quantities,
        units: match arguments.units.is_empty() {
            true => base.units,
            false => arguments.units.iter().map(|&n| n as usize).collect(),
        },
        hidden: match arguments.activation {
            Some(Hidden::Relu) => Activation::Relu,
            Some(Hidden::Tanh) => Activation::Tanh,
            None => base.hidden,
        },
        alone: base.alone || arguments.alone,
        horizon: arguments.horizon.unwrap_or(base.horizon),
        epochs,
        batch: arguments.batch.unwrap_or(base.batch),
        rate: arguments.rate.unwrap_or(base.rate),
        patience: arguments.patience.unwrap_or(patience),
        polish: arguments.polish,
        single: match arguments.precision {
            Some(precision) => precision == Precision::F32,
            None => base.single,
        },
        physics: base.physics && !arguments.keep_physics,
        longest_step: arguments.step,
        seed,
        ..base
    })
}

/// All files of a training of `count` networks.
fn outputs(out: &Path, count: usize) -> Vec<PathBuf> {
    let of_member = |k: usize| {
        [
            weights_name(k, count),
            numbered(METRICS, k, count),
            numbered(CHECKPOINT, k, count),
        ]
    };
    let names = (0..count).flat_map(of_member);
    names
        .chain([MODEL.to_owned()])
        .map(|name| out.join(name))
        .collect()
}

/// Tells how the epochs go.
struct Watch<'a> {
    output: &'a Output,
    epochs: usize,
    /// Rounds of the polish, at most, and how many are over.
    rounds: [usize; 2],
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
        if let Ok(style) = ProgressStyle::with_template(
            "{pos}/{len} {elapsed} {msg} (at most {eta} of these left)",
        ) {
            bar.set_style(style);
        }
        Watch {
            output,
            epochs: options.epochs,
            rounds: [options.polish, 0],
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
        let mut message = format!(
            "loss {:.4}, held out {:.4} (best {:.4})",
            epoch.loss, epoch.held_out, self.best
        );
        if epoch.held_out_diverged > 0 {
            message += &format!(", {} windows held out diverge", epoch.held_out_diverged);
        }
        let (name, done, of) = self.stage(epoch);
        self.bar.set_position(done as u64);
        self.bar.set_message(message.clone());
        let due = self.told.is_none_or(|told| told.elapsed() > EVERY);
        if self.bar.is_hidden() && due {
            let left =
                self.began.elapsed().as_secs_f64() / done as f64 * of.saturating_sub(done) as f64;
            self.output.note(&format!(
                "{name} {done} of {of}: {message}, at most {left:.0} s of these left"
            ));
            self.told = Some(Instant::now());
        }
        Ok(())
    }
}

impl Watch<'_> {
    /// What is going on, how much of it is over, and of how much at most.
    fn stage(&mut self, epoch: &Epoch) -> (&'static str, usize, usize) {
        if !epoch.polish {
            return ("epoch", epoch.epoch, self.epochs);
        }
        let [most, over] = &mut self.rounds;
        if *over == 0 {
            self.bar.set_length(*most as u64);
            self.bar.reset();
            (self.began, self.told) = (Instant::now(), None);
        }
        *over += 1;
        ("round of the polish", *over, *most)
    }
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

fn report<'a>(
    members: &'a [Trained],
    first: &'a Trained,
    model: &Path,
    out: &Path,
    metrics: &[PathBuf],
) -> Report<'a> {
    let count = members.len();
    let best = |trained: &Trained| -> (Option<f64>, Option<f64>) {
        let mut epochs = trained.history.iter();
        let best = epochs.find(|epoch| epoch.epoch == trained.best_epoch);
        (
            best.map(|epoch| epoch.loss),
            best.map(|epoch| epoch.held_out),
        )
    };
    let file = |k: usize| out.join(weights_name(k, count)).display().to_string();
    let all: Vec<Member> = members
        .iter()
        .zip(metrics)
        .enumerate()
        .map(|(k, (trained, metrics))| Member {
            weights: file(k),
            metrics: metrics.display().to_string(),
            epochs: trained.history.len(),
            best_epoch: trained.best_epoch,
            loss: best(trained).0,
            held_out: best(trained).1,
        })
        .collect();
    let windows = first.card.training.get("windows");
    Report {
        model: model.display().to_string(),
        weights: file(0),
        metrics: out.join(numbered(METRICS, 0, count)).display().to_string(),
        parameters: first.force.network().parameters().len(),
        windows: windows.and_then(|n| n.as_u64()),
        epochs: first.history.len(),
        best_epoch: first.best_epoch,
        loss: best(first).0,
        held_out: best(first).1,
        held_out_without_network: first.without_network,
        constants: &first.constants,
        network: &first.card,
        laws: &first.laws,
        warnings: warnings(members),
        members: if count > 1 { all } else { Vec::new() },
        band: None,
    }
}

/// Those of all members: what they share once, the others with their member.
fn warnings(members: &[Trained]) -> Vec<String> {
    let mut all = Vec::new();
    for (k, member) in members.iter().enumerate() {
        for warning in &member.warnings {
            let shared = members.iter().all(|m| m.warnings.contains(warning));
            match shared {
                true if k > 0 => {}
                true => all.push(warning.clone()),
                false => all.push(format!("member {}: {warning}", k + 1)),
            }
        }
    }
    all
}

fn text(report: &Report<'_>, band: &str) -> String {
    let number = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.4}"));
    let without = report.held_out_without_network;
    let before = without.map_or(String::new(), |x| format!(" (without the network {x:.4})"));
    let unit = match report
        .network
        .training
        .get("loss_in")
        .and_then(|v| v.as_str())
    {
        Some(unit) => format!(", in {unit}"),
        None => String::new(),
    };
    let mut out = format!(
        "a network of {} parameters, epoch {} of {}: loss {}, held out {}{before}{unit}\n",
        report.parameters,
        report.best_epoch,
        report.epochs,
        number(report.loss),
        number(report.held_out),
    );
    for (k, member) in report.members.iter().enumerate().skip(1) {
        out += &format!(
            "member {}: epoch {} of {}: loss {}, held out {}\n",
            k + 1,
            member.best_epoch,
            member.epochs,
            number(member.loss),
            number(member.held_out),
        );
    }
    for sentence in report.laws.iter().flat_map(Law::sentences) {
        out += &format!("{sentence}\n");
    }
    for known in report
        .constants
        .iter()
        .filter(|known| known.tolerances() > TOLD)
    {
        out += &format!("moved beside it: {}\n", known.moved());
    }
    out += band;
    out += &format!("written:\n  {}\n", report.model);
    if report.members.is_empty() {
        out += &format!("  {}\n  {}\n", report.weights, report.metrics);
    }
    for member in &report.members {
        out += &format!("  {}\n  {}\n", member.weights, member.metrics);
    }
    out
}
