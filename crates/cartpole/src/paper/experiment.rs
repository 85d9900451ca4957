//! The paper's experiment: every model learns from one recording, and runs free over 1000 windows of 0.6 s of another.

use std::path::Path;

use pinode_nn::evaluate::{Options as Windows, evaluate};
use pinode_nn::free_run::Initial;
use pinode_nn::log::Log;
use pinode_nn::model::Model;
use serde::Serialize;

use super::{Contestant, Error, Friction, PaperRig, StartsAt, true_errors};

/// What to run.
#[derive(Debug, Clone)]
pub struct Experiment {
    /// Samples to learn from, and to run over.
    pub samples: [usize; 2],
    /// Seeds of rig and networks.
    pub seeds: Vec<u64>,
    /// At most so many epochs; `None`: as many as each model's options say.
    pub epochs: Option<usize>,
    /// Windows of 0.6 s.
    pub windows: usize,
}

/// Mean absolute errors of x, φ, ẋ and φ̇ in m, rad, m/s and rad/s: one seed's.
pub type Errors = [f64; 4];

/// One model on one rig.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the model: a [`Contestant`]'s, `constant_velocity` or `true`.
    pub model: String,
    /// What it is.
    pub title: String,
    /// Where its windows start: `measured`, `estimated` (from positions about the start) or `true`.
    pub starts: &'static str,
    /// Mean over the seeds.
    pub mean: Errors,
    /// Least and largest over the seeds.
    pub range: [Errors; 2],
}

/// All models on one rig.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Table {
    /// `mild` or `strong`.
    pub friction: &'static str,
    /// One model a row.
    pub rows: Vec<Row>,
}

/// What `cartpole paper --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Length of the windows, s.
    pub horizon_s: f64,
    /// Their number.
    pub windows: usize,
    /// Samples that were learnt from, and run over.
    pub samples: [usize; 2],
    /// The seeds.
    pub seeds: Vec<u64>,
    /// The names and units of the errors.
    pub signals: [&'static str; 4],
    /// One rig a table.
    pub tables: Vec<Table>,
}

const HORIZON: f64 = 0.6;

impl Experiment {
    /// Runs it and writes logs and models to `out`; `known` is what is known of the rig, `tell` hears what is being done.
    ///
    /// # Errors
    /// Those of the rig, of training and of evaluation.
    pub fn run(
        &self,
        rig: &PaperRig,
        known: &Path,
        out: &Path,
        tell: &mut dyn FnMut(&str),
    ) -> Result<Outcome, Error> {
        let mut tables = Vec::new();
        for (friction, name) in [(Friction::Mild, "mild"), (Friction::Strong, "strong")] {
            let rig = rig.clone().with_friction(friction);
            let mut collected: Vec<(String, String, &'static str, Vec<Errors>)> = Vec::new();
            for &seed in &self.seeds {
                let folder = out.join(format!("{name}-{seed}"));
                let rows = self.one(&rig, known, &folder, seed, &mut |what| {
                    tell(&format!("{name} friction, seed {seed}: {what}"));
                })?;
                for (model, title, starts, errors) in rows {
                    match collected
                        .iter_mut()
                        .find(|row| row.0 == model && row.2 == starts)
                    {
                        Some(row) => row.3.push(errors),
                        None => collected.push((model, title, starts, vec![errors])),
                    }
                }
            }
            let rows = collected
                .into_iter()
                .map(|(model, title, starts, all)| Row {
                    model,
                    title,
                    starts,
                    mean: over(&all, 0.0, |sum, x| sum + x / all.len() as f64),
                    range: [
                        over(&all, f64::INFINITY, f64::min),
                        over(&all, f64::NEG_INFINITY, f64::max),
                    ],
                });
            tables.push(Table {
                friction: name,
                rows: rows.collect(),
            });
        }
        Ok(Outcome {
            horizon_s: HORIZON,
            windows: self.windows,
            samples: self.samples,
            seeds: self.seeds.clone(),
            signals: ["x, m", "phi, rad", "x_dot, m/s", "phi_dot, rad/s"],
            tables,
        })
    }

    /// All models on one rig with one seed.
    fn one(
        &self,
        rig: &PaperRig,
        known: &Path,
        folder: &Path,
        seed: u64,
        tell: &mut dyn FnMut(&str),
    ) -> Result<Vec<(String, String, &'static str, Errors)>, Error> {
        std::fs::create_dir_all(folder).map_err(|e| pinode_nn::Error::io(folder, e))?;
        tell("recording");
        let [learnt_from, run_over] = self.samples;
        let paths = [folder.join("learn.csv"), folder.join("test.csv")];
        rig.record(learnt_from, 2 * seed)?
            .log
            .write_csv(&paths[0])?;
        let test = rig.record(run_over, 2 * seed + 1)?;
        test.log.write_csv(&paths[1])?;
        let base = Model::load(known)?;
        let [learn, unseen] = [Log::read(&paths[0], &base)?, Log::read(&paths[1], &base)?];
        let mut rows = Vec::new();
        for contestant in Contestant::ALL {
            tell(contestant.title());
            let own = folder.join(contestant.folder());
            let path = contestant.learn(known, &learn, &own, seed, self.epochs)?;
            let model = Model::load(&path)?;
            for (starts, initial) in [
                ("measured", Initial::Measured),
                ("estimated", Initial::Estimated),
            ] {
                let options = Windows {
                    horizon: HORIZON,
                    windows: self.windows,
                    initial,
                    ..Windows::default()
                };
                let found = evaluate(&model, std::slice::from_ref(&unseen), &options)?;
                let mut errors = [f64::NAN; 4];
                for (to, from) in errors.iter_mut().zip(&found.coordinates) {
                    *to = from.mae;
                }
                rows.push((
                    contestant.folder().to_owned(),
                    contestant.title().to_owned(),
                    starts,
                    errors,
                ));
            }
        }
        tell("the true model");
        let steps = (HORIZON / rig.interval()).round() as usize;
        for (starts, from) in [("measured", StartsAt::Measured), ("true", StartsAt::True)] {
            let errors = true_errors(rig, &test, (self.windows, steps), from)?;
            rows.push((
                "true".to_owned(),
                "the true model".to_owned(),
                starts,
                errors,
            ));
        }
        Ok(rows)
    }
}

/// A number of every signal over the seeds.
fn over(all: &[Errors], first: f64, join: impl Fn(f64, f64) -> f64) -> Errors {
    std::array::from_fn(|signal| {
        all.iter()
            .fold(first, |sum, errors| join(sum, errors[signal]))
    })
}
