//! How often the diagnosis names what is hidden: a bench on logs of which the truth is known.
//!
//! ```text
//! cargo run --release -p cartpole --example naming_score -- --set one --noise each --logs 60 --lines one.jsonl
//! cargo run --release -p cartpole --example naming_score -- --table one.jsonl nothing.jsonl
//! ```
//!
//! The first command makes logs of the virtual rig, has each diagnosed by a model that lacks what is hidden, and appends a line of JSON a
//! log; logs that are in the file already are left out, so that it goes on where it was interrupted. The second makes the tables.
//! Seeds count up from `--first-seed`; each takes the next kind of effect in turn, with sizes drawn by the seed.

use std::collections::BTreeSet;
use std::error::Error;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

use cartpole::config::NoiseLevel;
use cartpole::score::{Case, Kinds, Line, NOISES, Rig, Set, run, tables};
use clap::{Parser, ValueEnum};

/// Rows of the rig's log a second, Hz.
const USUAL_RATE: u32 = 50;

/// Scores the diagnosis on logs of the virtual rig
#[derive(Debug, Parser)]
struct Cli {
    /// The mechanism
    #[arg(long, value_enum, default_value = "cartpole")]
    rig: Rig,
    /// What is hidden in it
    #[arg(long, value_enum, default_value = "one")]
    set: Set,
    /// Number of logs at each noise level
    #[arg(long, value_name = "N", default_value_t = 20)]
    logs: u64,
    /// Seed of the first log; the others follow
    #[arg(long, value_name = "N", default_value_t = 1000)]
    first_seed: u64,
    /// Noise of the rig
    #[arg(long, value_enum, default_value = "medium")]
    noise: Noise,
    /// Kinds of effects to hide in turn
    #[arg(long, value_enum, default_value = "all")]
    kinds: Kinds,
    /// Length of each log, s [default: that of the rig, 60]
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    duration: Option<u32>,
    /// Rows of the log a second, Hz [default: that of the rig, 50]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(5..=10_000))]
    rate: Option<u32>,
    /// Logs at once, each diagnosed on one thread [default: one per processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: Option<u16>,
    /// Threads of each diagnosis; changes times, not results
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// File of lines: new ones are appended, logs that are in it are left out [default: only the tables are written]
    #[arg(long, value_name = "FILE")]
    lines: Option<PathBuf>,
    /// Keep each log, its model and its diagnosis in a folder of this one, named by its id [default: they are thrown away]
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Folder of the mechanisms [default: models]
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// Make the tables of these files of lines, and nothing else
    #[arg(long, value_name = "FILE", num_args = 1..)]
    table: Vec<PathBuf>,
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
    /// Each of the three
    Each,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let done = match cli.table.as_slice() {
        [] => score(&cli),
        files => read_all(files).map(|lines| say(&tables(&lines))),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(1)
        }
    }
}

fn score(cli: &Cli) -> Result<(), Box<dyn Error>> {
    let noises: &[NoiseLevel] = match cli.noise {
        Noise::Low => &[NoiseLevel::Low],
        Noise::Medium => &[NoiseLevel::Realistic],
        Noise::High => &[NoiseLevel::High],
        Noise::Each => &NOISES,
    };
    let all: Vec<Case> = (0..cli.logs)
        .flat_map(|k| {
            noises.iter().map(move |&noise| Case {
                rig: cli.rig,
                set: cli.set,
                kinds: cli.kinds,
                noise,
                seed: cli.first_seed.wrapping_add(k),
                duration: cli.duration,
                rate: cli.rate.filter(|&rate| rate != USUAL_RATE),
            })
        })
        .collect();
    let mut lines = Lines::open(cli.lines.as_deref())?;
    let cases: Vec<Case> = all
        .iter()
        .filter(|case| !lines.has(&case.id()))
        .copied()
        .collect();
    let jobs = match cli.jobs {
        Some(jobs) => usize::from(jobs),
        None => std::thread::available_parallelism().map_or(1, usize::from),
    };
    let jobs = jobs.min(cases.len());
    let models = cli.models.clone().unwrap_or_else(models);
    let (next, (sender, done)) = (AtomicUsize::new(0), mpsc::channel());
    let failed = std::thread::scope(|scope| {
        for _ in 0..jobs {
            let (sender, cases, next, models) = (sender.clone(), &cases, &next, &models);
            scope.spawn(move || {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let line = one(case, models, cli, jobs == 1);
                    // Nobody listens where the file of lines cannot be written: then there is nothing more to do.
                    if sender
                        .send(line.map_err(|e| format!("{}: {e}", case.id())))
                        .is_err()
                    {
                        return;
                    }
                }
            });
        }
        drop(sender);
        let mut failed = 0;
        for (count, line) in (1..).zip(done) {
            match line {
                Ok(line) => {
                    say(&format!("{count}/{} {}", cases.len(), in_words(&line)));
                    lines.add(line)?;
                }
                // A rig that cannot run leaves no line; the other logs do not depend on it.
                Err(error) => {
                    eprintln!("error: {error}");
                    failed += 1;
                }
            }
        }
        Ok::<usize, Box<dyn Error>>(failed)
    })?;
    let ids: BTreeSet<String> = all.iter().map(Case::id).collect();
    let scored: Vec<Line> = lines
        .lines
        .into_iter()
        .filter(|line| ids.contains(&line.id))
        .collect();
    say(&format!("\n{}", tables(&scored)));
    match failed {
        0 => Ok(()),
        n => Err(format!("{n} of {} logs could not be made", cases.len()).into()),
    }
}

/// A line on stdout; a long run does not end because nobody reads it any more.
fn say(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}

/// A log on its own threads, with a folder that is gone afterwards unless it is to be kept.
fn one(
    case: &Case,
    models: &Path,
    cli: &Cli,
    alone: bool,
) -> Result<Line, Box<dyn Error + Send + Sync>> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(usize::from(cli.threads))
        .build()?;
    let within = |dir: &Path| pool.install(|| run(case, models, dir, alone));
    Ok(match &cli.keep {
        Some(folder) => {
            let own = folder.join(case.id());
            std::fs::create_dir_all(&own)?;
            within(&own)?
        }
        None => within(tempfile::tempdir()?.path())?,
    })
}

/// The lines there are, and the file for more.
struct Lines {
    lines: Vec<Line>,
    file: Option<File>,
}

impl Lines {
    fn open(path: Option<&Path>) -> Result<Self, Box<dyn Error>> {
        let Some(path) = path else {
            return Ok(Lines {
                lines: Vec::new(),
                file: None,
            });
        };
        let lines = if path.exists() {
            drop_unfinished(path)?;
            read(path)?
        } else {
            Vec::new()
        };
        let file = File::options().create(true).append(true).open(path)?;
        Ok(Lines {
            lines,
            file: Some(file),
        })
    }

    fn has(&self, id: &str) -> bool {
        self.lines.iter().any(|line| line.id == id)
    }

    fn add(&mut self, line: Line) -> Result<(), Box<dyn Error>> {
        if let Some(file) = &mut self.file {
            let text = serde_json::to_string(&line)? + "\n";
            file.write_all(text.as_bytes())?;
        }
        self.lines.push(line);
        Ok(())
    }
}

/// Cuts off what an interrupted run left of its last line.
fn drop_unfinished(path: &Path) -> Result<(), Box<dyn Error>> {
    let text = std::fs::read(path)?;
    let whole = text.iter().rposition(|b| *b == b'\n').map_or(0, |k| k + 1);
    if whole < text.len() {
        File::options()
            .write(true)
            .open(path)?
            .set_len(whole as u64)?;
    }
    Ok(())
}

fn read(path: &Path) -> Result<Vec<Line>, Box<dyn Error>> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    text.lines()
        .enumerate()
        .map(|(k, line)| {
            let place = |e| format!("{}:{}: {e}", path.display(), k + 1);
            Ok(serde_json::from_str(line).map_err(place)?)
        })
        .collect()
}

fn read_all(files: &[PathBuf]) -> Result<Vec<Line>, Box<dyn Error>> {
    let mut lines = Vec::new();
    for file in files {
        lines.extend(read(file)?);
    }
    Ok(lines)
}

/// `models` of the working folder, or else of the sources that this program was built from.
fn models() -> PathBuf {
    let here = Path::new("models");
    match here.join("cartpole/rig.toml").exists() {
        true => here.to_owned(),
        false => Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models"),
    }
}

/// `cartpole/one/low/7 viscous_friction on slider -> viscous_friction on slider (0.99); gap 3.1 -> 1.0; 2.1 s`.
fn in_words(line: &Line) -> String {
    let hidden: Vec<String> = line
        .hidden
        .iter()
        .map(|t| format!("{} on {} {:?}", t.kind, t.target, t.parameters))
        .collect();
    let named: Vec<String> = line
        .named
        .iter()
        .map(|e| {
            let others = e.indistinguishable_from.iter();
            let tie: String = others.map(|o| format!(" ≡ {}", o.kind)).collect();
            format!("{} on {} ({:.2}){tie}", e.kind, e.target, e.confidence)
        })
        .collect();
    let right = match line.hidden.is_empty() {
        true => line.named.is_empty(),
        false => line.first_is_right(),
    };
    let said = match (&line.error, named.is_empty()) {
        (Some(error), _) => error.clone(),
        (None, true) => line.verdict.clone(),
        (None, false) => named.join(", "),
    };
    let gap = line.gap.map_or(String::new(), |[before, after]| {
        format!("; gap {before:.1} -> {after:.1}")
    });
    format!(
        "{}{} {} -> {said}{gap}; {:.1} s",
        if right { "" } else { "x " },
        line.id,
        hidden.join(", "),
        line.seconds
    )
}
