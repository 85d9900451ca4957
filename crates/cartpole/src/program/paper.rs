//! `cartpole paper`: the paper's experiment.

use std::fmt::Write;
use std::path::Path;

use pinode_nn::cli::Output;

use super::Error;
use crate::paper::{Experiment, Lesson, Outcome, report, table};

/// Of each seed s the recordings have the seeds 2 s and 2 s + 1.
const LAST_SEED: u64 = u64::MAX / 2;

/// What to compare, and how long.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(super) struct Arguments {
    /// Seeds: from --seed on, or from 1
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Samples to learn from
    #[arg(long, value_name = "N", default_value_t = table::SAMPLES)]
    samples: usize,
    /// At most so many epochs [default: each model's own]
    #[arg(long, value_name = "N")]
    epochs: Option<usize>,
    /// Leave out what is learnt from less and from other data, and the second mechanism
    #[arg(long)]
    no_outlook: bool,
}

pub(super) fn run(
    arguments: Arguments,
    models: &Path,
    out: &Path,
    first_seed: Option<u64>,
    output: &Output,
) -> Result<(), Error> {
    let seeds = seeds(first_seed.unwrap_or(1), arguments.seeds)?;
    let experiment = Experiment {
        samples: [arguments.samples, table::TEST_SAMPLES],
        seeds,
        epochs: arguments.epochs,
        outlook: match arguments.no_outlook {
            true => Vec::new(),
            false => Lesson::OTHERS.to_vec(),
        },
        second: !arguments.no_outlook,
        windows: 1000,
    };
    let outcome = experiment.run(models, out, &mut |what| output.note(what))?;
    let page = report(&experiment, &outcome, out)?;
    output.note(&format!("written: {}", page.display()));
    output.result(&outcome, &text(&outcome))?;
    Ok(())
}

/// So many from `first` on.
fn seeds(first: u64, count: u64) -> Result<Vec<u64>, Error> {
    let last = first.checked_add(count.saturating_sub(1));
    match last.filter(|last| *last <= LAST_SEED) {
        Some(last) => Ok((first..=last).collect()),
        None => Err(Error::Paper(crate::paper::Error::Setting {
            key: "--seed".to_owned(),
            message: format!(
                "{first} has no {count} seeds from it on: the last one is {LAST_SEED}, take a smaller --seed or fewer --seeds"
            ),
        })),
    }
}

fn text(outcome: &Outcome) -> String {
    let mut out = format!(
        "mean absolute errors over {} windows of {} s that no model has seen; {} samples learnt from, {} seeds (least to largest)\n",
        outcome.windows,
        outcome.horizon_s,
        outcome.samples[0],
        outcome.seeds.len()
    );
    for table in &outcome.tables {
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "\n{}, learnt from {}",
            table.title,
            table.learnt_from.title()
        );
        let _ = write!(out, "{:44}{:10}", "model", "starts");
        for signal in table.signals {
            let _ = write!(out, "{signal:>24}");
        }
        out.push('\n');
        for row in &table.rows {
            let _ = write!(out, "{:44}{:10}", row.title, row.starts);
            for signal in 0..4 {
                let number = format!(
                    "{:.4} ({:.4}-{:.4})",
                    row.mean[signal], row.range[0][signal], row.range[1][signal]
                );
                let _ = write!(out, "{number:>24}");
            }
            out.push('\n');
        }
    }
    out
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn seeds_end_where_numbers_do() {
        assert_eq!(seeds(1, 3).unwrap(), [1, 2, 3]);
        assert_eq!(seeds(LAST_SEED, 1).unwrap(), [LAST_SEED]);
        for first in [LAST_SEED, u64::MAX] {
            let words = seeds(first, 2).unwrap_err().to_string();
            assert!(words.contains("has no 2 seeds from it on"), "{words}");
        }
    }
}
