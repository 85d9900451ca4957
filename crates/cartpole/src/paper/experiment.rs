//! The paper's experiment: every model learns from one recording, and runs free over 1000 windows of 0.6 s of another.

use std::path::{Path, PathBuf};

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
    /// Whether the models learn from less and from other data, too, with mild friction.
    pub outlook: bool,
    /// Seeds of rig and networks.
    pub seeds: Vec<u64>,
    /// At most so many epochs; `None`: as many as each model's options say.
    pub epochs: Option<usize>,
    /// Windows of 0.6 s.
    pub windows: usize,
}

/// Mean absolute errors of x, φ, ẋ and φ̇ in m, rad, m/s and rad/s: one seed's.
pub type Errors = [f64; 4];

/// What the models learn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Lesson {
    /// The whole recording.
    All,
    /// Its first tenth.
    Tenth,
    /// Its first hundredth.
    Hundredth,
    /// One as long in which the pole is let alone: what is run over, with the pole swung up and about, is outside of it.
    Calm,
}

impl Lesson {
    /// What it is, for people.
    pub fn title(self) -> &'static str {
        match self {
            Lesson::All => "the whole recording",
            Lesson::Tenth => "a tenth of it",
            Lesson::Hundredth => "a hundredth of it",
            Lesson::Calm => "a recording in which the pole only hangs",
        }
    }

    /// Part of the names of its files.
    fn name(self) -> &'static str {
        match self {
            Lesson::All => "all",
            Lesson::Tenth => "tenth",
            Lesson::Hundredth => "hundredth",
            Lesson::Calm => "calm",
        }
    }

    fn samples(self, of: usize) -> usize {
        match self {
            Lesson::All | Lesson::Calm => of,
            Lesson::Tenth => of / 10,
            Lesson::Hundredth => of / 100,
        }
    }

    /// Who learns from it.
    fn contestants(self) -> &'static [Contestant] {
        match self {
            Lesson::All => &Contestant::ALL,
            _ => &[Contestant::Ode, Contestant::Pinode, Contestant::Ours],
        }
    }
}

/// One model on one rig.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the model: a [`Contestant`]'s, `constant_velocity` or `true`.
    pub model: String,
    /// What it is.
    pub title: String,
    /// Where its windows start: `measured`, `past` (fitted by the model itself to the positions before), `estimated` (from positions on both sides) or
    /// `true`.
    pub starts: &'static str,
    /// Mean over the seeds.
    pub mean: Errors,
    /// Least and largest over the seeds.
    pub range: [Errors; 2],
}

/// All models on one rig that have learnt from one thing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Table {
    /// `mild` or `strong`.
    pub friction: &'static str,
    /// What was learnt from.
    pub learnt_from: Lesson,
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

pub(super) const HORIZON: f64 = 0.6;
/// What the models run over, in the folder of a rig and a seed.
pub(super) const TEST: &str = "test.csv";
/// Integration steps are not longer, s: the errors are those of steps of 1 ms to four digits.
pub(super) const LONGEST_STEP: f64 = 5e-3;

impl Experiment {
    /// The folder of a rig and a seed in `out`.
    pub(super) fn folder(out: &Path, friction: &str, seed: u64) -> PathBuf {
        out.join(format!("{friction}-{seed}"))
    }

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
        let outlook: &[Lesson] = match self.outlook {
            true => &[Lesson::Tenth, Lesson::Hundredth, Lesson::Calm],
            false => &[],
        };
        for (friction, name, further) in [
            (Friction::Mild, "mild", outlook),
            (Friction::Strong, "strong", &[]),
        ] {
            let rig = rig.clone().with_friction(friction);
            for &lesson in [Lesson::All].iter().chain(further) {
                let mut all = Vec::new();
                for &seed in &self.seeds {
                    let exam = Exam {
                        experiment: self,
                        rig: &rig,
                        known,
                        folder: &Self::folder(out, name, seed),
                        seed,
                    };
                    all.push(exam.rows(lesson, &mut |what| {
                        tell(&format!("{name} friction, seed {seed}: {what}"));
                    })?);
                }
                tables.push(Table {
                    friction: name,
                    learnt_from: lesson,
                    rows: over_seeds(&all),
                });
            }
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
}

/// A model, what it is, where its windows start, and its errors.
type OneRow = (String, String, &'static str, Errors);

/// One rig with one seed.
struct Exam<'a> {
    experiment: &'a Experiment,
    rig: &'a PaperRig,
    known: &'a Path,
    folder: &'a Path,
    seed: u64,
}

impl Exam<'_> {
    /// The errors of all models that learn from `lesson`.
    fn rows(&self, lesson: Lesson, tell: &mut dyn FnMut(&str)) -> Result<Vec<OneRow>, Error> {
        let Exam {
            experiment,
            rig,
            known,
            folder,
            seed,
        } = *self;
        std::fs::create_dir_all(folder).map_err(|e| pinode_nn::Error::io(folder, e))?;
        let [learnt_from, run_over] = experiment.samples;
        let learner = match lesson {
            Lesson::Calm => with_the_pole_let_alone(rig),
            _ => rig.clone(),
        };
        let learn = learner.record(lesson.samples(learnt_from), 2 * seed)?;
        let test = rig.record(run_over, 2 * seed + 1)?;
        let name =
            serde_json::to_value(lesson).map_err(|e| pinode_nn::Error::io(folder, e.into()))?;
        let name = name.as_str().unwrap_or_default().to_owned();
        let paths = [
            folder.join(format!("learn-{name}.csv")),
            folder.join("test.csv"),
        ];
        learn.log.write_csv(&paths[0])?;
        test.log.write_csv(&paths[1])?;
        let learn = Log::read(&paths[0], &Model::load(known)?)?;
        let mut rows = Vec::new();
        for contestant in lesson.contestants() {
            tell(&format!("{}, from {}", contestant.title(), lesson.title()));
            let own = folder.join(folder_of(*contestant, lesson));
            let path = contestant.learn(known, &learn, &own, seed, experiment.epochs)?;
            let model = Model::load(&path)?;
            let unseen = Log::read(&paths[1], &model)?;
            for (starts, initial) in [
                ("measured", Initial::Measured),
                ("past", Initial::Past),
                ("estimated", Initial::Estimated),
            ] {
                let options = Windows {
                    horizon: HORIZON,
                    windows: experiment.windows,
                    initial,
                    longest_step: LONGEST_STEP,
                };
                let found = evaluate(&model, std::slice::from_ref(&unseen), &options)?;
                let mut errors = [f64::NAN; 4];
                for (to, from) in errors.iter_mut().zip(&found.coordinates) {
                    *to = from.mae;
                }
                let (name, title) = (contestant.folder(), contestant.title());
                rows.push((name.to_owned(), title.to_owned(), starts, errors));
            }
        }
        let steps = (HORIZON / rig.interval()).round() as usize;
        for (starts, from) in [("measured", StartsAt::Measured), ("true", StartsAt::True)] {
            let errors = true_errors(rig, &test, (experiment.windows, steps), from)?;
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

/// Where a model is, in the folder of a rig and a seed.
pub(super) fn folder_of(contestant: Contestant, lesson: Lesson) -> String {
    format!("{}-{}", contestant.folder(), lesson.name())
}

/// The rig with a hand that does not swing the pole.
fn with_the_pole_let_alone(rig: &PaperRig) -> PaperRig {
    let mut rig = rig.clone();
    rig.settings.swing.calm_share = 1.0;
    rig.settings.swing.wild_share = 0.0;
    rig
}

/// Means and ranges of the rows, which are the same for each seed but for their errors.
fn over_seeds(all: &[Vec<OneRow>]) -> Vec<Row> {
    let Some(first) = all.first() else {
        return Vec::new();
    };
    let of = |(k, (model, title, starts, _)): (usize, &OneRow)| {
        let errors: Vec<Errors> = all
            .iter()
            .filter_map(|rows| rows.get(k))
            .map(|row| row.3)
            .collect();
        Row {
            model: model.clone(),
            title: title.clone(),
            starts,
            mean: over(&errors, 0.0, |sum, x| sum + x / errors.len() as f64),
            range: [
                over(&errors, f64::INFINITY, f64::min),
                over(&errors, f64::NEG_INFINITY, f64::max),
            ],
        }
    };
    first.iter().enumerate().map(of).collect()
}

/// A number of every signal over the seeds.
fn over(all: &[Errors], first: f64, join: impl Fn(f64, f64) -> f64) -> Errors {
    std::array::from_fn(|signal| {
        all.iter()
            .fold(first, |sum, errors| join(sum, errors[signal]))
    })
}
