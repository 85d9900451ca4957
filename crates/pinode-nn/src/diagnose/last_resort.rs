//! The last resort: what no effect of the library explains is taught to a small network on that coordinate, or on all that are off.
//!
//! Where others are off beside one on the worst coordinate, or it explains nothing, one network with a force on each of them is asked for. It is added where it explains the
//! windows better, pair by pair, both those that the fit saw and those held out, and shrinks the gap of free runs: pushes from outside can be learnt, but say nothing of later
//! ones. Where nobody believes in what was found, it is taught without that, for stand-ins distort what is left, and that is taken back where free runs come far nearer so; and what is hidden by the law that it has learnt is
//! asked for [beside it](super::beside).

use std::mem::take;

use super::beside::{found_beside, names_beside, weighed, with_name};
use super::candidate::Candidate;
use super::comparison::Comparison;
use super::found::{Found, in_order_of_contribution};
use super::leftover::{Leftover, Off};
use super::proof::{Proof, Proved, shrinks};
use super::refine::Contender;
use super::search::Search;
use super::sight::Sight;
use super::step::Report;
use super::study::{Fitted, Study};
use super::taught::Taught;
use super::verdict::{Gap, Learnt, Provenance, Unexplained};
use super::write_up;
use super::{HORIZON_S, gap};
use crate::Error;
use crate::disk::Together;
use crate::learnt::weights;

/// The name of its weights beside the new model.
const WEIGHTS: &str = "network.safetensors";
/// A network on all coordinates that are off is the one where free runs err by less than this part of what they err by with one on the worst: how much the windows held out gain by
/// it a few decide that leave what it was taught.
const FAR_NEARER: f64 = 0.5;
/// At most so many names are found beside a network.
const BESIDE: usize = 2;

/// What it needs to know of the logs and of the diagnosis.
#[derive(Clone, Copy)]
pub struct Sitting<'a> {
    /// Typical time between two samples of the logs, s.
    pub interval: f64,
    /// The inputs by name.
    pub inputs: &'a [String],
    /// Of the first parameters.
    pub seed: u64,
    /// From what all was found.
    pub provenance: &'a Provenance,
}

/// What a network was taught beside what a search has found.
struct Lesson {
    study: Study,
    search: Search,
    /// What is left without it, in words.
    words: Unexplained,
    /// Whether what was found before is taken back.
    is_withdrawn: bool,
    /// The network, and how far free runs are off without it and with it; or why there is none.
    outcome: Result<(Taught, Gap), String>,
}

impl Lesson {
    /// By how many noises free runs are off with the network.
    fn after(&self) -> f64 {
        let gap = self.outcome.as_ref().map(|(_, gap)| gap.after);
        gap.unwrap_or(f64::INFINITY)
    }

    /// Whether free runs are less far off, over no fewer windows.
    fn is_nearer(&self, other: &Lesson) -> bool {
        let windows = |lesson: &Lesson| lesson.outcome.as_ref().map_or(0, |(_, gap)| gap.windows);
        self.after() < other.after() && windows(self) >= windows(other)
    }
}

/// The one of two networks that explains the windows better and is nearer in free runs, or far nearer in these.
fn better(one: (Taught, Gap), more: (Taught, Gap)) -> (Taught, Gap) {
    let explains = Comparison::of(&more.0.fitted, &one.0.fitted).explains();
    let is_nearer = |part: f64| more.1.after < part * one.1.after;
    match (explains && is_nearer(1.0)) || is_nearer(FAR_NEARER) {
        true => more,
        false => one,
    }
}

impl Proof<'_> {
    /// Teaches a network what is left and adds it where it shrinks the gap; what came of it is said in what is unexplained. With the study that the model was fitted in.
    ///
    /// # Errors
    /// As [`Model::write_revision`](crate::model::Model::write_revision) and [`Model::load`](crate::model::Model::load); [`Error::Io`].
    pub fn teach(
        &self,
        study: Study,
        search: &mut Search,
        sitting: Sitting<'_>,
        proved: &mut Proved,
        report: Report,
    ) -> Result<(Study, Option<Unexplained>), Error> {
        // They are the most of it.
        let mut steps = take(&mut search.steps);
        let lesson = self.best_lesson(&study, search, (proved.gap.after, sitting), report);
        let mut is_withdrawn = false;
        let (study, words) = match lesson {
            None => (study, None),
            Some(lesson) => {
                is_withdrawn = lesson.is_withdrawn;
                *search = lesson.search;
                in_order_of_contribution(&mut search.found);
                let mut words = lesson.words;
                match lesson.outcome {
                    Err(why) => words.sentences.push(why),
                    Ok((taught, gap)) => {
                        let kept = (&lesson.study, &mut *search);
                        let learnt = self.keep(taught, &gap, kept, sitting, proved)?;
                        words.sentences.extend(learnt.sentences());
                        words.learnt = Some(learnt);
                    }
                }
                (lesson.study, Some(words))
            }
        };
        if is_withdrawn {
            for step in &mut steps {
                step.accepted = None;
            }
        }
        search.steps = steps;
        Ok((study, words))
    }

    /// The lesson beside what was found, with which free runs are off by `found`; where nobody believes in that, the one without it if these are far nearer then.
    fn best_lesson(
        &self,
        study: &Study,
        search: &Search,
        (found, sitting): (f64, Sitting<'_>),
        report: Report,
    ) -> Option<Lesson> {
        if !search.found.is_empty() && !search.found.iter().any(Found::is_believed) {
            let study = &self.prepared.study;
            let mut bare = search.clone();
            bare.withdraw(study);
            let bare = self.lesson(study, bare, sitting);
            let bare = bare.map(|bare| self.with_what_it_hid(bare, sitting, report));
            if let Some(bare) = bare.filter(|bare| bare.after() < FAR_NEARER * found) {
                report(
                    "what nobody believes in is taken back: the network does far better without it",
                );
                return Some(Lesson {
                    is_withdrawn: true,
                    ..bare
                });
            }
        }
        let usual = self.lesson(study, search.clone(), sitting)?;
        Some(self.with_what_it_hid(usual, sitting, report))
    }

    /// The lesson with what is found beside its network, taught anew.
    fn with_what_it_hid(&self, mut best: Lesson, sitting: Sitting<'_>, report: Report) -> Lesson {
        for _ in 0..BESIDE {
            let more = self.with_a_name(&best, sitting, report);
            let Some(more) = more.filter(|more| more.is_nearer(&best)) else {
                break;
            };
            if let Some(found) = more.search.found.last() {
                let (name, compared) = (found.candidate.kind.name, &found.comparison);
                report(&format!(
                    "accepted beside the network: {name} (z {:.1}, held out {:.1})",
                    compared.inside.z, compared.outside.z
                ));
            }
            best = more;
        }
        best
    }

    /// The lesson with the best of the names that explain what its network leaves.
    fn with_a_name(&self, lesson: &Lesson, sitting: Sitting<'_>, report: Report) -> Option<Lesson> {
        let (before, _) = lesson.outcome.as_ref().ok()?;
        let (study, search, seed) = (&lesson.study, &lesson.search, sitting.seed);
        let again = |name: &Contender| {
            let named = with_name(study, search, name)?;
            Some((*name.added.first()?, self.lesson(study, named, sitting)?))
        };
        let names = names_beside(study, &before.fitted, seed, report);
        let mut lessons: Vec<(Candidate, Lesson)> = names.iter().filter_map(again).collect();
        let taught = lessons.iter().filter_map(|(name, lesson)| {
            let (taught, _) = lesson.outcome.as_ref().ok()?;
            Some((*name, &taught.fitted))
        });
        let contenders = weighed(study, &taught.collect::<Vec<_>>(), &before.fitted, seed);
        let found = found_beside(study, &contenders, &search.base, &before.fitted)?;
        let own = lessons
            .iter()
            .position(|(name, _)| *name == found.candidate)?;
        let (_, mut lesson) = lessons.swap_remove(own);
        lesson.search.found.push(found);
        Some(lesson)
    }

    /// Teaches a network what a search leaves on the coordinate that is worst off; where there is none on that alone, or others are off beside it, one on all of these is asked for.
    fn lesson(&self, study: &Study, search: Search, sitting: Sitting<'_>) -> Option<Lesson> {
        let gap = self.gap(study, &search.model);
        let (words, leftover) = Leftover::of(
            self.model,
            (study, &search),
            self.prepared,
            (self.masked, &gap),
            sitting,
        )?;
        let taught = |off: &[&Off], sight| self.taught(&leftover, off, sight, &search);
        let mut outcome = taught(&[&leftover.own], Sight::Followed);
        // Others are off beside it, or it follows what nobody saw it follow.
        for sight in [Sight::Followed, Sight::All, Sight::All] {
            let (fitted, gap): (&Fitted, &Gap) = match &outcome {
                Ok((taught, gap)) => (&taught.fitted, gap),
                Err(_) => (&search.model, &gap),
            };
            let off = leftover.all_off(fitted, gap);
            let acts_on = outcome.as_ref().map_or(0, |(taught, _)| taught.laws.len());
            let is_worth = match sight {
                Sight::Followed => off.len() > 1,
                Sight::All => off.len() > acts_on && leftover.is_more(&off, &search.model.hybrid),
            };
            if !is_worth {
                continue;
            }
            let before = outcome.as_ref().map_or(f64::NAN, |(_, gap)| gap.after);
            if let Ok(more) = taught(&off, sight) {
                outcome = Ok(match outcome {
                    Ok(before) => better(before, more),
                    Err(_) => more,
                });
            }
            let after = outcome.as_ref().map_or(f64::NAN, |(_, gap)| gap.after);
            // The same would come of the same.
            if sight == Sight::All && before.to_bits() == after.to_bits() {
                break;
            }
        }
        Some(Lesson {
            study: study.clone(),
            search,
            words,
            is_withdrawn: false,
            outcome,
        })
    }

    /// A network that is taught what is left on some coordinates, and the free-run errors of the model without it and with it.
    ///
    /// # Errors
    /// In words, where it explains too little or does not shrink them.
    fn taught(
        &self,
        leftover: &Leftover<'_>,
        off: &[&Off],
        sight: Sight,
        search: &Search,
    ) -> Result<(Taught, Gap), String> {
        let study = leftover.study;
        let taught = leftover.teach(off, sight, search)?;
        let [without, with] = [&search.model, &taught.fitted].map(Fitted::as_fitted);
        let compared = self.runs(study, (&without, &with), HORIZON_S, true);
        let gap = gap::gap(study, &without, &compared, study.pace.long(HORIZON_S));
        match shrinks(&gap) {
            true => Ok((taught, gap)),
            false => Err(
                "A small network that was taught it does not shrink the free-run errors on unseen data: it is not added."
                    .to_owned(),
            ),
        }
    }

    /// Writes the weights, and the model with them.
    fn keep(
        &self,
        taught: Taught,
        gap: &Gap,
        (study, search): (&Study, &mut Search),
        sitting: Sitting<'_>,
        proved: &mut Proved,
    ) -> Result<Learnt, Error> {
        let bytes = weights::to_bytes(&proved.path, &taught.force, &taught.card, false)?;
        let mut files = Together::new(self.file.0);
        let name = files.put_beside(WEIGHTS.as_ref(), &bytes)?;
        files.commit()?;
        let network = Some(taught.entry(&name, sitting.seed));
        let coordinates = taught.card.joints.iter().map(|j| j.name.clone());
        let mut laws = taught.laws.into_iter();
        let shares_with =
            write_up::with_entries(&taught.fitted.hybrid, &taught.shared, sitting.inputs);
        let learnt = Learnt {
            weights: name,
            coordinates: coordinates.collect(),
            shares_with,
            without: gap.before,
            with: gap.after,
            law: laws.next().flatten(),
            more_laws: laws.flatten().collect(),
        };
        search.taught = Some(taught.fitted);
        *proved = self.write((study, search), sitting.provenance, network)?;
        Ok(learnt)
    }
}
