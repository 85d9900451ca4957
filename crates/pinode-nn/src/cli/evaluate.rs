//! `pinode evaluate`: free-run errors over windows of logs.

use std::fmt::Write;
use std::path::PathBuf;

use clap::ValueEnum;

use super::output::Output;
use super::simulate::positive;
use crate::Error;
use crate::band::COVERAGE;
use crate::diagnose::counts_otherwise;
use crate::evaluate::{Evaluation, Options, evaluate};
use crate::free_run::{Initial, LONGEST_STEP};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// Logs: CSV, Parquet or MCAP files
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Length of a window, s
    #[arg(long, value_name = "S", default_value_t = 0.6, value_parser = positive, allow_negative_numbers = true)]
    horizon: f64,
    /// Number of windows, spread evenly over the logs
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    windows: u32,
    /// Initial state of each window
    #[arg(long, value_enum, default_value_t = Start::Measured)]
    initial: Start,
    /// Longest integration step, s
    #[arg(long, value_name = "S", default_value_t = LONGEST_STEP, value_parser = positive, allow_negative_numbers = true)]
    step: f64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Start {
    /// The measured one, as in the paper
    Measured,
    /// From cubics fitted to the positions around it, those after it among them
    Estimated,
    /// Fitted by the model to the positions of the 0.3 s before it: what a prediction can know
    Past,
}

pub(super) fn run(arguments: &Arguments, output: &Output) -> Result<(), Error> {
    let model = output.load_model(&arguments.model)?;
    let (model, logs, _) = output.read_logs((&arguments.logs, &[]), model)?;
    let options = Options {
        horizon: arguments.horizon,
        windows: arguments.windows as usize,
        initial: match arguments.initial {
            Start::Measured => Initial::Measured,
            Start::Estimated => Initial::Estimated,
            Start::Past => Initial::Past,
        },
        longest_step: arguments.step,
    };
    let mut evaluation = evaluate(&model, &logs, &options)?;
    evaluation.warnings.extend(counts_otherwise(&model, &logs)?);
    let learnt = model.has_learnt_from(logs.iter());
    evaluation.warnings.extend(learnt);
    if evaluation.diverged > 0 {
        output.note(&format!(
            "warning: {} of {} windows diverged and are left out of the errors",
            evaluation.diverged, evaluation.windows
        ));
    }
    if evaluation.fallen_back > 0 {
        output.note(&format!(
            "warning: {} of {} windows start from the measured state, not from that of the past: too little is measured before them, or the \
             model does not get there",
            evaluation.fallen_back, evaluation.windows
        ));
    }
    output.warnings(&evaluation.warnings);
    output.departures(&evaluation.left_training);
    output.result(&evaluation, &text(&evaluation))
}

fn text(evaluation: &Evaluation) -> String {
    let mut out = format!(
        "free run over {} windows of {} s\n\n",
        evaluation.windows, evaluation.horizon_s
    );
    let width = evaluation
        .coordinates
        .iter()
        .map(|c| c.name.chars().count())
        .fold(10, usize::max);
    // Writing to a String cannot fail.
    let spread = evaluation.coordinates.iter().any(|c| c.spread.is_some());
    let banded = evaluation
        .coordinates
        .iter()
        .any(|c| c.within_band.is_some());
    let column = |text: String, is_there: bool| match is_there {
        true => format!("  {text:>12}"),
        false => String::new(),
    };
    let _ = writeln!(
        out,
        "{:width$}  {:>12}  {:>12}  {:>12}{}{}  unit",
        "coordinate",
        "MAE",
        "RMSE",
        "std",
        column("spread".to_owned(), spread),
        column("within band".to_owned(), banded)
    );
    for c in &evaluation.coordinates {
        let apart = c.spread.map_or("-".to_owned(), |x| format!("{x:.6}"));
        let share = c.within_band;
        let within = share.map_or("-".to_owned(), |x| format!("{:.1} %", 100.0 * x));
        let _ = writeln!(
            out,
            "{:width$}  {:>12.6}  {:>12.6}  {:>12.6}{}{}  {}",
            c.name,
            c.mae,
            c.rmse,
            c.std,
            column(apart, spread),
            column(within, banded),
            c.unit
        );
    }
    if spread {
        let _ = writeln!(
            out,
            "\nspread: how far the members of the ensemble are apart, root mean square"
        );
    }
    if banded {
        let _ = writeln!(
            out,
            "within band: share of the samples within the model's band, which is to hold {:.0} % where windows begin at states by the past (--initial past)",
            100.0 * COVERAGE
        );
    }
    out
}
