//! The program `pinode`: arguments, people's text, exit codes. One file per command.
//!
//! With `--json` there is one JSON document on stdout and nothing else; people's text goes to stderr. Exit codes: 0 done, 1 the
//! work failed, 2 wrong usage, 130 interrupted: what a diagnosis had finished is kept, and the same command goes on from there.

mod band;
mod check;
mod csv_line;
mod diagnose;
mod dynamics;
mod equations;
mod evaluate;
mod export;
mod folder;
mod interrupt;
mod output;
mod progress;
mod simulate;
mod stepping;
mod summary;
mod train;
pub mod workflow;

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Args, CommandFactory, Parser, Subcommand};
use lagrange::{Problem, Problems};

use crate::Error;

pub use output::Output;
pub use summary::summary;

/// Equations of motion from energies; find the physics that a model is missing.
#[derive(Debug, Parser)]
#[command(name = "pinode", version)]
struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

/// What every command takes.
#[derive(Debug, Clone, Args)]
struct Common {
    /// One JSON document on stdout; people's text goes to stderr
    #[arg(long, global = true)]
    json: bool,
    /// Seed of everything random: the same seed gives the same result, bit for bit
    #[arg(long, global = true, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Number of threads [default: one per processor]; does not change results
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
    /// No text for people but errors
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Validate a model and print its mechanism, inputs, effects and every warning
    Check(check::Arguments),
    /// Evaluate the equations of motion M(q) v̇ + C(q, v) v + G(q) = Q at given states
    Dynamics(dynamics::Arguments),
    /// Print M, C and G as formulas, or write them as a function in Rust or C
    Equations(equations::Arguments),
    /// Roll the model out; with a log, under its inputs and from its initial state
    Simulate(simulate::Arguments),
    /// Free-run errors over many windows of logs, per coordinate
    Evaluate(evaluate::Arguments),
    /// Learn a part of Q that no effect explains: a network, trained through the integrator
    Train(Box<train::Arguments>),
    /// Write what was learnt as ONNX files, for other programs
    Export(export::Arguments),
    /// Name the physics that the model is missing, add it, and show the gap shrink on data that no fit has seen
    Diagnose(diagnose::Arguments),
}

/// Runs the program with the arguments of the process.
pub fn run() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => {
            // Help and version go to stdout with code 0, wrong usage to stderr with code 2.
            let _ = e.print();
            return ExitCode::from(u8::try_from(e.exit_code()).unwrap_or(2));
        }
    };
    if let Command::Train(arguments) = &cli.command
        && let Some(what) = arguments.contradiction()
    {
        let _ = Cli::command()
            .error(ErrorKind::ArgumentConflict, what)
            .print();
        return ExitCode::from(2);
    }
    let output = Output {
        json: cli.common.json,
        quiet: cli.common.quiet,
    };
    if let Some(threads) = cli.common.threads {
        use_threads(threads);
    }
    match execute(cli.command, cli.common.seed, &output) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            output.error(&error);
            // Wrong usage is said by clap where it shows without a model, and ends the same way where it does not.
            ExitCode::from(if is_usage(&error) { 2 } else { 1 })
        }
    }
}

/// Whether it is an option that is wrong.
fn is_usage(error: &Error) -> bool {
    matches!(error, Error::Problems(problems) if problems.source.starts_with("--"))
}

/// What is wrong with an option that clap could not tell without the model.
fn refused(option: &str, wrong: Vec<String>) -> Result<(), Error> {
    if wrong.is_empty() {
        return Ok(());
    }
    Err(Error::Problems(Problems {
        source: option.into(),
        list: wrong.into_iter().map(Problem::general).collect(),
    }))
}

/// Sets the number of threads of everything that runs in parallel, once a process and before it starts. Results do not depend on
/// it.
pub fn use_threads(threads: u16) {
    // Fails only when the pool exists already: then it keeps its size.
    let _ = rayon::ThreadPoolBuilder::new()
        .num_threads(usize::from(threads))
        .build_global();
}

fn execute(command: Command, seed: u64, output: &Output) -> Result<(), Error> {
    match command {
        Command::Check(arguments) => check::run(&arguments, output),
        Command::Dynamics(arguments) => dynamics::run(&arguments, output),
        Command::Equations(arguments) => equations::run(&arguments, output),
        Command::Simulate(arguments) => simulate::run(&arguments, output),
        Command::Evaluate(arguments) => evaluate::run(&arguments, output),
        Command::Train(arguments) => train::run(&arguments, seed, output),
        Command::Export(arguments) => export::run(&arguments, output),
        Command::Diagnose(arguments) => diagnose::run(&arguments, seed, output),
    }
}
