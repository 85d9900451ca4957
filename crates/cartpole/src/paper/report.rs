//! The experiment as a page: what came out in a sentence, the tables, roll-outs of 2 s and histograms of the errors (Roehrl et al. 2020, figures 4
//! and 5), of the first seed.

use std::path::{Path, PathBuf};

use pinode_nn::evaluate::{Options, RollOut, errors, roll_outs};
use pinode_nn::free_run::Initial;
use pinode_nn::log::Log;
use pinode_nn::model::Model;
use pinode_nn::report::sheet::{Curve, Grid, GridRow, Section, Sheet, Style, curves, histograms};

use super::experiment::{HORIZON, LONGEST_STEP, TEST, folder_of};
use super::{Contestant, Error, Experiment, Lesson, Outcome, Row, Table};

/// Its file.
const FILE: &str = "report.html";
/// The roll-outs that are shown, s, and their number; the first, at the beginning of the recording, is not.
const SHOWN: f64 = 2.0;
const ROLL_OUTS: usize = 3;

/// Who is drawn, how, and from where: the others as published, ours from what is known at the start.
const DRAWN: [(Contestant, Style, Initial); 3] = [
    (Contestant::Ode, Style::Before, Initial::Measured),
    (Contestant::Pinode, Style::Other(0), Initial::Measured),
    (Contestant::Ours, Style::After, Initial::Past),
];

/// Writes `report.html` to `out`, where the experiment has left its models; returns its path.
///
/// # Errors
/// Those of reading them, of rolling them out and of writing.
pub fn report(experiment: &Experiment, outcome: &Outcome, out: &Path) -> Result<PathBuf, Error> {
    let mut sections = vec![tables(outcome)];
    let seed = experiment.seeds.first().copied().unwrap_or_default();
    for table in &outcome.tables {
        if table.learnt_from == Lesson::All {
            let folder = Experiment::folder(out, table.rig, seed);
            sections.push(figures(outcome, table, &folder)?);
        }
    }
    let sheet = Sheet {
        title: "The paper's experiment (Roehrl et al. 2020, arXiv 2005.14617) on a virtual rig"
            .to_owned(),
        heading: heading(outcome),
        sections,
    };
    let path = out.join(FILE);
    sheet.write(&path)?;
    Ok(path)
}

fn row<'a>(table: &'a Table, model: &str, starts: &str) -> Option<&'a Row> {
    let mut rows = table.rows.iter();
    rows.find(|row| row.model == model && row.starts == starts)
}

/// What came out, in a sentence.
fn heading(outcome: &Outcome) -> String {
    let all = outcome
        .tables
        .iter()
        .filter(|t| t.learnt_from == Lesson::All);
    let of = |table: &Table| {
        let published = row(table, Contestant::Pinode.folder(), "measured")?;
        let ours = row(table, Contestant::Ours.folder(), "past")?;
        let share = |signal: usize| 100.0 * ours.mean[signal] / published.mean[signal];
        Some(format!(
            "{:.0}, {:.0}, {:.0} and {:.0} % ({})",
            share(0),
            share(1),
            share(2),
            share(3),
            table.title
        ))
    };
    let shares: Vec<String> = all.filter_map(of).collect();
    format!(
        "Delay, frictions and a network beside them, started from the state that the model finds in the past: the errors of both coordinates and their rates over {} s are {} of those of PINODE as published",
        outcome.horizon_s,
        shares.join(", ")
    )
}

fn tables(outcome: &Outcome) -> Section {
    let mut section = Section::new("All models");
    section.paragraphs = vec![
        format!(
            "Mean absolute errors over all samples of {} windows of {} s that no model has seen; {} samples learnt from; means over {} seeds, least to largest.",
            outcome.windows,
            outcome.horizon_s,
            outcome.samples[0],
            outcome.seeds.len()
        ),
        "Windows start from the measured state, as in the paper; from the state that the model itself finds in the 0.3 s before; from cubics through the positions on both sides; or from the true state. Velocities are compared as differences of positions, as they are measured.".to_owned(),
    ];
    for table in &outcome.tables {
        let number = |row: &Row, k: usize| {
            let [least, most] = [row.range[0][k], row.range[1][k]];
            match least == most {
                true => format!("{least:.4}"),
                false => format!("{:.4} ({least:.4}–{most:.4})", row.mean[k]),
            }
        };
        let of = |row: &Row| GridRow {
            cells: [row.title.clone(), row.starts.to_owned()]
                .into_iter()
                .chain((0..4).map(|k| number(row, k)))
                .collect(),
            chosen: row.model == Contestant::Ours.folder() && row.starts == "past",
        };
        let heads = ["model", "starts"].into_iter().chain(table.signals);
        section.tables.push(Grid {
            heading: format!("{}, learnt from {}", table.title, table.learnt_from.title()),
            texts: 2,
            columns: heads.map(str::to_owned).collect(),
            rows: table.rows.iter().map(of).collect(),
        });
    }
    section
}

/// Roll-outs and histograms of a rig.
fn figures(outcome: &Outcome, table: &Table, folder: &Path) -> Result<Section, Error> {
    let mut section = Section::new(&format!("Roll-outs and errors: {}", table.title));
    let mut rolled: Vec<(&'static str, Style, Vec<RollOut>)> = Vec::new();
    let mut missed: Vec<(&'static str, Style, Vec<Vec<f64>>)> = Vec::new();
    for (contestant, style, initial) in DRAWN {
        let path = folder
            .join(folder_of(contestant, Lesson::All))
            .join("model.toml");
        let model = Model::load(&path)?;
        let log = [Log::read(&folder.join(TEST), &model)?];
        let options = |horizon, windows| Options {
            horizon,
            windows,
            initial,
            longest_step: LONGEST_STEP,
        };
        let title = contestant.title();
        rolled.push((
            title,
            style,
            roll_outs(&model, &log, &options(SHOWN, ROLL_OUTS))?,
        ));
        missed.push((
            title,
            style,
            errors(&model, &log, &options(HORIZON, outcome.windows))?,
        ));
    }
    section.paragraphs.push(format!(
        "Roll-outs of {SHOWN} s: grey as measured. Then the errors of all samples of the windows of {} s, simulated less measured; in brackets mean and deviation of the normal distribution that fits them. What is beyond the last bar is in it.",
        outcome.horizon_s
    ));
    for window in 1..ROLL_OUTS {
        for (signal, name) in table.signals.iter().enumerate() {
            let of = |(_, _, all): &(&str, Style, Vec<RollOut>)| all.get(window).cloned();
            let Some(measured) = rolled.first().and_then(of) else {
                continue;
            };
            let mut drawn = Vec::new();
            if let Some(own) = measured.signals.get(signal) {
                drawn.push(Curve {
                    name: "measured",
                    style: Style::Measured,
                    x: &measured.t,
                    y: &own.measured,
                });
            }
            for (title, style, all) in &rolled {
                if let Some(roll_out) = all.get(window)
                    && let Some(own) = roll_out.signals.get(signal)
                {
                    drawn.push(Curve {
                        name: title,
                        style: *style,
                        x: &roll_out.t,
                        y: &own.simulated,
                    });
                }
            }
            let id = format!("{}-run-{window}-{signal}", table.rig);
            let title = format!("{name}, roll-out {window}");
            section
                .figures
                .push(curves(&title, ["t, s", name], &drawn, &id));
        }
    }
    for (signal, name) in table.signals.iter().enumerate() {
        let named: Vec<(String, Style, &[f64])> = missed
            .iter()
            .filter_map(|(title, style, lists)| {
                let list = lists.get(signal)?;
                let n = list.len() as f64;
                let mean = list.iter().sum::<f64>() / n;
                let square = list.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
                let name = format!("{title} ({mean:.3} ± {:.3})", square.sqrt());
                Some((name, *style, list.as_slice()))
            })
            .collect();
        let lists: Vec<(&str, Style, &[f64])> = named
            .iter()
            .map(|(name, style, list)| (name.as_str(), *style, *list))
            .collect();
        let id = format!("{}-errors-{signal}", table.rig);
        let title = format!("errors of {name}");
        section.figures.push(histograms(&title, name, &lists, &id));
    }
    Ok(section)
}
