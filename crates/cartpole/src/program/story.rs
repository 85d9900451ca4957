//! What the program does, in order.

use std::path::{Path, PathBuf};

use pinode_nn::cli::workflow::{self, Finished, Task, command_line};
use pinode_nn::cli::{Output, summary};
use pinode_nn::effect::registry;
use serde_json::json;

use super::Error;
use super::judge::Judgement;
use super::setting::Setting;
use crate::rig::{self, Hidden, Key, Target, known_model};

/// The diagnosis has its own seed, that of `pinode diagnose` without `--seed`: it knows nothing of the rig's.
const SEED_OF_THE_DIAGNOSIS: u64 = 0;

/// What the rig leaves.
struct Recorded {
    log: PathBuf,
    model: PathBuf,
    key: PathBuf,
}

/// `cartpole rig`.
pub(super) fn rig(setting: &Setting, output: &Output) -> Result<(), Error> {
    let recorded = record(setting, output)?;
    if output.json {
        output.document(&json!({
            "seed": (!setting.secret).then_some(setting.seed),
            "log": recorded.log,
            "model": recorded.model,
            "key": recorded.key,
        }))?;
    }
    Ok(())
}

/// `cartpole`: record, diagnose, open the key.
pub(super) fn whole(setting: &Setting, output: &Output) -> Result<(), Error> {
    let recorded = record(setting, output)?;
    let finished = diagnose(setting, &recorded, output)?;
    let diagnosis = &finished.diagnosis;
    output.say(&format!("\n{}", summary(diagnosis)))?;
    if setting.secret {
        return sealed(&recorded, &finished, output);
    }

    let key = Key::read_json(&recorded.key)?;
    let judgement = Judgement::of(&key.hidden, diagnosis.verdict, &diagnosis.effects);
    output.say(&format!(
        "\nthe key is opened\n  hidden: {}\n  {}\n",
        in_words(&key.hidden),
        judgement.in_words()
    ))?;
    let files = [
        ("report", &finished.report),
        ("diagnosis", &finished.json),
        ("model with what was found", &finished.model),
        ("model without", &recorded.model),
        ("log", &recorded.log),
        ("key", &recorded.key),
    ];
    let lines: String = files
        .iter()
        .map(|(what, path)| format!("  {:27}{}\n", format!("{what}:"), path.display()))
        .collect();
    output.say(&format!("\nwritten\n{lines}"))?;
    if output.json {
        output.document(&json!({
            "seed": setting.seed,
            "hidden": key.hidden,
            "judgement": judgement,
            "diagnosis": diagnosis,
            "files": places(&recorded, &finished),
        }))?;
    }
    Ok(())
}

/// Where everything is.
fn places(recorded: &Recorded, finished: &Finished) -> serde_json::Value {
    json!({
        "report": finished.report,
        "diagnosis": finished.json,
        "revised_model": finished.model,
        "model": recorded.model,
        "log": recorded.log,
        "key": recorded.key,
    })
}

/// The end where the key stays closed.
fn sealed(recorded: &Recorded, finished: &Finished, output: &Output) -> Result<(), Error> {
    output.say(&format!(
        "\nwhat was hidden stays sealed in {}\nthe report is {}\n",
        recorded.key.display(),
        finished.report.display()
    ))?;
    if output.json {
        output.document(&json!({
            "diagnosis": finished.diagnosis,
            "files": places(recorded, finished),
        }))?;
    }
    Ok(())
}

/// Runs the rig and writes log, model and key.
fn record(setting: &Setting, output: &Output) -> Result<Recorded, Error> {
    let (config, hidden, out) = (&setting.config, &setting.hidden, &setting.out);
    let recording = rig::run(config, hidden, setting.seed)?;
    // The key first: a log of which nobody knows what is hidden in it is worth nothing.
    std::fs::create_dir_all(out).map_err(rig::Error::io(out))?;
    let key = setting.key.clone();
    Key::new(config, hidden, setting.seed).write_json(&key)?;
    let model = known_model(hidden, &setting.models, out)?;
    let log = out.join("log.csv");
    recording.write_csv(&log)?;
    output.say(&format!(
        "{}{}\nthe rig ran for {} s at {} Hz: {}\nthe model that it is compared with: {}\n",
        if setting.secret {
            String::new()
        } else {
            format!("seed {}: --seed {0} repeats this run\n", setting.seed)
        },
        match (setting.drawn, hidden) {
            (true, _) => format!(
                "a hidden effect is drawn; what it is, is sealed in {}",
                key.display()
            ),
            (false, Hidden::Nothing) => "nothing is hidden, as you asked".to_owned(),
            (false, chosen) => format!("hidden, as you asked: {}", in_words(chosen)),
        },
        config.duration,
        config.rate,
        log.display(),
        model.display()
    ))?;
    if let Some(first) = recording.blows.first() {
        output.say(&format!(
            "the cart struck an end of its rail {} times, first at t = {first:.2} s: the model knows of no stops\n",
            recording.blows.len()
        ))?;
    }
    Ok(Recorded { log, model, key })
}

/// The diagnosis sees the model and the log, and nothing else.
fn diagnose(setting: &Setting, recorded: &Recorded, output: &Output) -> Result<Finished, Error> {
    let model = output.load_model(&recorded.model)?;
    let log = output.read_log(&recorded.log, &model)?;
    let out: &Path = &setting.out.join("diagnosis");
    // The seed may have come from the clock: with it the command repeats the run. A secret one is in no file that a report is made of.
    let mut command = match setting.secret {
        true => "cartpole --secret …".to_owned(),
        false => command_line(),
    };
    if !setting.secret && !command.contains("--seed") {
        command += &format!(" --seed {}", setting.seed);
    }
    Ok(workflow::run(
        &Task {
            model: &model,
            logs: &[log],
            held_out: &[],
            out,
            seed: SEED_OF_THE_DIAGNOSIS,
            command: &command,
        },
        output,
    )?)
}

/// `coulomb_friction on slider, force = 0.312 N`.
fn in_words(hidden: &Hidden) -> String {
    let Some(target) = hidden.target() else {
        return "nothing".to_owned();
    };
    let angular = target == Target::Pole;
    let specs = registry::find(hidden.kind()).map_or(&[][..], |kind| kind.parameters);
    let mut words = format!("{} on {}", hidden.kind(), target.name());
    for (name, value) in hidden.parameters() {
        let spec = specs.iter().find(|spec| spec.name == name);
        let unit = match (spec, name) {
            (Some(spec), _) => spec.quantity.unit(angular),
            (None, name) => unit(hidden, name, angular),
        };
        let unit = if unit == "1" { "" } else { unit };
        let value = three_digits(value);
        words += format!(", {name} = {value} {unit}").trim_end();
    }
    words
}

/// The unit of a parameter that the library of the diagnosis does not have.
fn unit(hidden: &Hidden, name: &str, angular: bool) -> &'static str {
    let either = |linear, angle| if angular { angle } else { linear };
    match (hidden, name) {
        (Hidden::Hysteresis { .. }, "width") | (_, "gap") => "m",
        (Hidden::SensorOffset { .. }, "offset") => either("m", "rad"),
        (Hidden::LoadDependentFriction { .. }, _) => "",
        (Hidden::PeriodicForce { .. }, "period") => either("m", "rad"),
        (_, "force" | "coulomb_force" | "static_force" | "amplitude") => either("N", "N·m"),
        (_, "offset" | "width" | "limit") => "N",
        (_, "coefficient" | "coefficient_positive" | "coefficient_negative" | "damping") => {
            either("N·s/m", "N·m·s/rad")
        }
        (_, "stiffness" | "slope") => either("N/m", "N·m/rad"),
        (_, "stribeck_velocity") => either("m/s", "rad/s"),
        (_, "delay" | "time_constant") => "s",
        (_, "motor_inertia") => "kg",
        (_, "phase") => "rad",
        _ => "",
    }
}

fn three_digits(x: f64) -> String {
    let decimals = (2.0 - x.abs().log10().floor()).clamp(0.0, 12.0); // 0 has an infinite logarithm
    format!("{x:.*}", decimals as usize)
}
