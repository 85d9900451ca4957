//! The paper's experiment: every model learns from one recording, and runs free over 1000 windows of 0.6 s of another.

use std::path::{Path, PathBuf};

use pinode_nn::evaluate::{Options as Windows, evaluate};
use pinode_nn::free_run::Initial;
use pinode_nn::log::Log;
use pinode_nn::model::Model;
use serde::Serialize;

use super::rotary::Rotary;
use super::stand::{CartPole, Stand};
use super::{Contestant, Error, Friction, PaperRig};

/// What to run.
#[derive(Debug, Clone)]
pub struct Experiment {
    /// Samples to learn from, and to run over.
    pub samples: [usize; 2],
    /// What the models learn from, too, with mild friction.
    pub outlook: Vec<Lesson>,
    /// Whether they run on a second mechanism.
    pub second: bool,
    /// Seeds of rig and networks.
    pub seeds: Vec<u64>,
    /// At most so many epochs; `None`: as many as each model's options say.
    pub epochs: Option<usize>,
    /// Windows of 0.6 s.
    pub windows: usize,
}

/// Mean absolute errors of the coordinates and their rates, x, φ, ẋ and φ̇ in m, rad, m/s and rad/s: one seed's.
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
    /// All but the whole recording.
    pub const OTHERS: [Lesson; 3] = [Lesson::Tenth, Lesson::Hundredth, Lesson::Calm];

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
    /// The rig: `mild` or `strong`, the cart-pole with this friction, or `furuta`.
    pub rig: &'static str,
    /// What it is.
    pub title: &'static str,
    /// Names and units of the errors.
    pub signals: [&'static str; 4],
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
    pub(super) fn folder(out: &Path, rig: &str, seed: u64) -> PathBuf {
        out.join(format!("{rig}-{seed}"))
    }

    /// Runs it and writes logs and models to `out`. `folder` has the models of the cart-pole; beside it is, for the second mechanism,
    /// `furuta_pendulum`. `tell` hears what is being done.
    ///
    /// # Errors
    /// Those of the rigs, of training and of evaluation.
    pub fn run(
        &self,
        folder: &Path,
        out: &Path,
        tell: &mut dyn FnMut(&str),
    ) -> Result<Outcome, Error> {
        let mild = PaperRig::read(&folder.join("paper.toml"))?;
        let strong = mild.clone().with_friction(Friction::Strong);
        let known = folder.join("paper_known.toml");
        let cart_pole = |rig| CartPole { rig, known: &known };
        let (mild, strong) = (cart_pole(&mild), cart_pole(&strong));
        let second = match self.second {
            true => Some(Rotary::read(&folder.join(".."))?),
            false => None,
        };
        let all = [Lesson::All];
        let lessons = [&all, self.outlook.as_slice()].concat();
        let mut plan: Vec<(&dyn Stand, &[Lesson])> = vec![(&mild, &lessons), (&strong, &all)];
        plan.extend(second.iter().map(|s| (s as &dyn Stand, &all[..])));
        let mut tables = Vec::new();
        for (stand, lessons) in plan {
            for &lesson in lessons {
                let mut all = Vec::new();
                for &seed in &self.seeds {
                    let exam = Exam {
                        experiment: self,
                        stand,
                        folder: &Self::folder(out, stand.name(), seed),
                        seed,
                    };
                    all.push(exam.rows(lesson, &mut |what| {
                        tell(&format!("{}, seed {seed}: {what}", stand.title()));
                    })?);
                }
                tables.push(Table {
                    rig: stand.name(),
                    title: stand.title(),
                    signals: stand.signals(),
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
            tables,
        })
    }
}

/// A model, what it is, where its windows start, and its errors.
type OneRow = (String, String, &'static str, Errors);

/// One rig with one seed.
struct Exam<'a> {
    experiment: &'a Experiment,
    stand: &'a dyn Stand,
    folder: &'a Path,
    seed: u64,
}

impl Exam<'_> {
    /// The errors of all models that learn from `lesson`.
    fn rows(&self, lesson: Lesson, tell: &mut dyn FnMut(&str)) -> Result<Vec<OneRow>, Error> {
        let Exam {
            experiment,
            stand,
            folder,
            seed,
        } = *self;
        std::fs::create_dir_all(folder).map_err(|e| pinode_nn::Error::io(folder, e))?;
        let [learnt_from, run_over] = experiment.samples;
        let paths = [
            folder.join(format!("learn-{}.csv", lesson.name())),
            folder.join(TEST),
        ];
        stand.learn(lesson, lesson.samples(learnt_from), 2 * seed, &paths[0])?;
        let steps = (HORIZON / stand.interval()).round() as usize;
        let windows = (experiment.windows, steps);
        let of_truth = stand.test(run_over, 2 * seed + 1, windows, &paths[1])?;
        let known = stand.known()?;
        let learn = Log::read(&paths[0], &Model::parse(&known.path, known.text.clone())?)?;
        let mut rows = Vec::new();
        for contestant in lesson.contestants() {
            tell(&format!("{}, from {}", contestant.title(), lesson.title()));
            let own = folder.join(folder_of(*contestant, lesson));
            let path = contestant.learn(&known, &learn, &own, seed, experiment.epochs)?;
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
        for (starts, errors) in ["measured", "true"].into_iter().zip(of_truth) {
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
