//! The program `cartpole`: the whole story on a freshly drawn hidden effect, or the rig alone. Exit codes: 0 done, whether or not
//! the effect was named; 1 the work failed; 2 wrong usage.

mod error;
pub mod judge;
mod paper;
mod setting;
mod story;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{SystemTime, UNIX_EPOCH};

use clap::error::ErrorKind;
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use pinode_nn::cli::{Output, use_threads};

use crate::config::NoiseLevel;
pub use error::Error;
use setting::Setting;

/// A cart-pole with a secret: a virtual rig hides an effect from the model, and the diagnosis has to find it.
///
/// Without a command: draws an effect, records a log of the rig, diagnoses it with a model that lacks the effect, and compares the
/// diagnosis with the truth.
#[derive(Debug, Parser)]
#[command(name = "cartpole", version)]
struct Cli {
    #[command(flatten)]
    options: Options,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The paper's experiment: pure ODE, PINODE as published and this library's models learn from one recording and run free over another
    Paper(paper::Arguments),
    /// Only write the log, the model that lacks the hidden effect, and the key that names it
    Rig,
}

#[derive(Debug, Args)]
struct Options {
    /// Folder for everything that is written
    #[arg(
        long,
        global = true,
        value_name = "DIR",
        default_value = "out/cartpole"
    )]
    out: PathBuf,
    /// Folder with cartpole.urdf, cartpole.toml and rig.toml [default: models/cartpole]
    #[arg(long, global = true, value_name = "DIR")]
    models: Option<PathBuf>,
    /// Seed of the effect, the motion and the noise [default: from the clock]
    #[arg(long, global = true, value_name = "N")]
    seed: Option<u64>,
    /// Draw like --seed, and tell nobody: neither seed nor effect is printed, and the key goes to a file outside of the folder of the
    /// log, which stays closed
    #[arg(long, global = true, value_name = "SEED", conflicts_with_all = ["seed", "effect", "nothing"])]
    secret: Option<u64>,
    /// File that tells what is hidden [default: key.json in the folder; with --secret, FOLDER.key.json beside it]
    #[arg(long, global = true, value_name = "FILE")]
    key: Option<PathBuf>,
    /// Noise of the rig [default: as in rig.toml]
    #[arg(long, global = true, value_enum)]
    noise: Option<Noise>,
    /// Hide nothing: the model is complete
    #[arg(long, global = true, conflicts_with = "effect")]
    nothing: bool,
    /// Hide this effect, with a drawn size: viscous_friction@pole, for one; without @TARGET the target is drawn
    #[arg(long, global = true, value_name = "KIND[@TARGET]")]
    effect: Option<String>,
    /// What is drawn from where no effect is chosen
    #[arg(long, global = true, value_enum, default_value = "basic", conflicts_with_all = ["effect", "nothing"])]
    from: Choice,
    /// Length of the recording, s [default: as in rig.toml]
    #[arg(long, global = true, value_name = "S", value_parser = duration)]
    duration: Option<f64>,
    /// One JSON document on stdout; people's text goes to stderr
    #[arg(long, global = true)]
    json: bool,
    /// Number of threads [default: one per processor]; does not change results
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
    /// No text for people but errors
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Noise {
    /// A good laboratory
    Low,
    /// The paper's rig; `realistic` says the same
    #[value(alias = "realistic")]
    Medium,
    /// A poor sensor and a coarse encoder
    High,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Choice {
    /// Friction, drag, springs, a constant force, gain and delay of the input
    Basic,
    /// These, and frictions with a memory, sensors, the rest of the drive: everything that a log can show
    All,
}

impl From<Noise> for NoiseLevel {
    fn from(noise: Noise) -> Self {
        match noise {
            Noise::Low => NoiseLevel::Low,
            Noise::Medium => NoiseLevel::Realistic,
            Noise::High => NoiseLevel::High,
        }
    }
}

/// A length of a recording, s, within what [`crate::config::Config`] takes.
fn duration(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (1e-3..=1e5).contains(&x) => Ok(x),
        Ok(x) => Err(format!("{x} is not between 0.001 and 100000")),
        Err(e) => Err(e.to_string()),
    }
}

/// Runs the program with the arguments of the process.
pub fn run() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => return usage(&e),
    };
    let output = Output {
        json: cli.options.json,
        quiet: cli.options.quiet,
    };
    if let Some(threads) = cli.options.threads {
        use_threads(threads);
    }
    match execute(&cli, &output) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Error::NoSuchEffect(message)) => {
            usage(&Cli::command().error(ErrorKind::InvalidValue, message))
        }
        Err(error) => {
            error.tell(&output);
            ExitCode::from(1)
        }
    }
}

/// Help and version go to stdout with code 0, wrong usage to stderr with code 2.
fn usage(error: &clap::Error) -> ExitCode {
    let _ = error.print(); // nobody is left to tell when stderr is gone
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
}

fn execute(cli: &Cli, output: &Output) -> Result<(), Error> {
    if let Some(Command::Paper(arguments)) = cli.command {
        let models = cli.options.models.clone().unwrap_or_else(setting::models);
        let out = cli.options.out.join("paper");
        return paper::run(arguments, &models, &out, cli.options.seed, output);
    }
    let given = cli.options.secret.or(cli.options.seed);
    let seed = given.unwrap_or_else(seed_of_the_clock);
    let setting = Setting::read(&cli.options, seed)?;
    match cli.command {
        Some(Command::Rig) => story::rig(&setting, output),
        _ => story::whole(&setting, output),
    }
}

/// Six digits: short enough to be typed again.
fn seed_of_the_clock() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    now.map_or(0, |t| (t.as_nanos() / 1000 % 1_000_000) as u64)
}
