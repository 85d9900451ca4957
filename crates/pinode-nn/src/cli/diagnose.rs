//! `pinode diagnose`: names the physics that a model is missing, adds it, and shows the gap shrink.

use std::path::PathBuf;

use super::workflow::{self, Task, command_line};
use super::{Output, summary};
use crate::Error;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// Logs: CSV, Parquet or MCAP files; without --holdout, the last quarter of them is not fitted
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Logs that no fit may see: the gap is measured on them
    #[arg(long, value_name = "LOG", num_args = 1..)]
    holdout: Vec<PathBuf>,
    /// Folder for report.html, diagnosis.json and model.toml
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn run(arguments: &Arguments, seed: u64, output: &Output) -> Result<(), Error> {
    let model = output.load_model(&arguments.model)?;
    let paths = (&arguments.logs[..], &arguments.holdout[..]);
    let (model, logs, held_out) = output.read_logs(paths, model)?;
    let task = Task {
        model: &model,
        logs: &logs,
        held_out: &held_out,
        out: &arguments.out,
        seed,
        command: &command_line(),
    };
    let finished = workflow::run(&task, output)?;
    output.say(&format!(
        "{}\nwritten:\n  {}\n  {}\n  {}\n",
        summary(&finished.diagnosis),
        finished.report.display(),
        finished.json.display(),
        finished.model.display()
    ))?;
    match output.json {
        true => output.document(&finished.diagnosis),
        false => Ok(()),
    }
}
