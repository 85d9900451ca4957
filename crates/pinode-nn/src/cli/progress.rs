//! Progress on stderr.

use std::cell::RefCell;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::Output;

/// What is being done and about how long it will take: on a terminal a spinner with the elapsed time, elsewhere one plain line a stage,
/// nothing when quiet. Gone from the terminal when dropped.
pub(super) struct Progress {
    output: Output,
    bar: ProgressBar,
    clock: RefCell<StageClock>,
}

impl Progress {
    pub fn new(output: &Output) -> Self {
        // Draws on stderr, and is hidden where that is no terminal.
        let bar = match output.quiet {
            true => ProgressBar::hidden(),
            false => ProgressBar::new_spinner(),
        };
        if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed:>4} {wide_msg}") {
            bar.set_style(style);
        }
        if !bar.is_hidden() {
            bar.enable_steady_tick(Duration::from_millis(100));
        }
        Progress {
            output: *output,
            bar,
            clock: RefCell::new(StageClock::new()),
        }
    }

    /// A new stage has begun.
    pub fn stage(&self, text: &str) {
        let left = self.clock.borrow_mut().left(text, Instant::now());
        let line = match left {
            Some(left) => format!("{text} (about {} left)", rounded(left)),
            None => text.to_owned(),
        };
        match self.bar.is_hidden() {
            true => self.output.note(&line),
            false => self.bar.set_message(line),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// A step of the search refines so many candidates, if all goes well.
const REFINED: usize = 5;
/// A step that goes on for longer than steps have so far will for this share of that again.
const LONGER: f64 = 0.5;
/// A search that finds several effects is made from so many other beginnings.
const RIVALS: usize = 2;

/// How long the stages of this run took, and what that says of those to come.
///
/// Nobody knows how many effects there are: what is left is reckoned as if the step under way were to find nothing more. Each step that
/// does find something adds one of the same cost; two effects add the search from other beginnings.
struct StageClock {
    /// When the stage, the step and the search from this beginning began.
    began: Instant,
    step_began: Instant,
    path_began: Instant,
    /// So many candidates are refined in the stage under way.
    refining: usize,
    refined: Mean,
    /// Candidates refined in this step.
    in_step: usize,
    /// The steps that found something.
    steps: Mean,
    /// … of the search from this beginning.
    found: usize,
    /// How long the search from the first beginning took, and the number of those that followed.
    first_path: Option<f64>,
    rivals: usize,
}

/// A number of durations and their sum, s.
#[derive(Clone, Copy, Default)]
struct Mean {
    count: usize,
    sum: f64,
}

impl Mean {
    fn add(&mut self, count: usize, took: Duration) {
        self.count += count;
        self.sum += took.as_secs_f64();
    }

    fn get(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

impl StageClock {
    fn new() -> Self {
        let now = Instant::now();
        StageClock {
            began: now,
            step_began: now,
            path_began: now,
            refining: 0,
            refined: Mean::default(),
            in_step: 0,
            steps: Mean::default(),
            found: 0,
            first_path: None,
            rivals: 0,
        }
    }

    /// A stage begins; the time that is probably left, once a candidate has been refined in this run.
    fn left(&mut self, stage: &str, now: Instant) -> Option<Duration> {
        let since = |then: Instant| now.saturating_duration_since(then);
        if self.refining > 0 {
            self.refined.add(self.refining, since(self.began));
        }
        self.began = now;
        let names = stage.strip_prefix("refining ");
        self.refining = names.map_or(0, |names| names.split(", ").count());
        self.in_step += self.refining;
        if stage.starts_with("accepted") {
            // What another search begins with took no time of its own.
            if self.in_step > 0 {
                self.steps.add(1, since(self.step_began));
            }
            self.found += 1;
            (self.step_began, self.in_step) = (now, 0);
        } else if stage.starts_with("locating") || stage.starts_with("fitting") {
            (self.step_began, self.path_began, self.in_step) = (now, now, 0);
            (self.first_path, self.rivals, self.found) = (None, 0, 0);
        } else if stage.starts_with("following") {
            self.first_path
                .get_or_insert(since(self.path_began).as_secs_f64());
            self.rivals += 1;
            self.found = 0;
            (self.step_began, self.path_began, self.in_step) = (now, now, 0);
        }
        let each = self.refined.get().filter(|_| self.refining > 0)?;
        let typical = self.steps.get().unwrap_or(each * REFINED as f64);
        let in_step = since(self.step_began).as_secs_f64();
        let step = (typical - in_step).max(LONGER * in_step).max(each);
        let in_path = since(self.path_began).as_secs_f64();
        let searches = match self.first_path {
            Some(first) => {
                step.max(first - in_path) + (RIVALS.saturating_sub(self.rivals)) as f64 * first
            }
            None if self.found > 1 => step + RIVALS as f64 * (in_path + step),
            None => step,
        };
        // Free runs of the old and the new model at the end cost about one refinement.
        Some(Duration::from_secs_f64(searches + each))
    }
}

/// Seconds below two minutes, else minutes.
fn rounded(left: Duration) -> String {
    match left.as_secs_f64() {
        s if s < 1.0 => "1 s".to_owned(),
        s if s < 120.0 => format!("{s:.0} s"),
        s => format!("{:.0} min", s / 60.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said at each stage of a run, s.
    fn said(stages: &[(f64, &str)]) -> Vec<Option<f64>> {
        let mut clock = StageClock::new();
        let start = clock.began;
        let mut at = |s: f64, stage: &str| clock.left(stage, start + Duration::from_secs_f64(s));
        let left = |&(s, stage): &(f64, &str)| at(s, stage).map(|left| left.as_secs_f64());
        stages.iter().map(left).collect()
    }

    #[test]
    fn what_is_left_follows_from_what_a_refinement_took() {
        let left = said(&[
            (0.0, "fitting the model as given"),
            (4.0, "locating the disagreement"),
            (4.0, "refining viscous_friction, quadratic_drag"),
            (10.0, "refining coulomb_friction"),
            (13.0, "accepted: coulomb_friction (z 9.0, held out 5.0)"),
            (13.0, "refining quadratic_drag"),
        ]);
        // None is timed yet; three more of five, and the end; a step as long as the first, and the end.
        assert_eq!(left, [None, None, None, Some(12.0), None, Some(12.0)]);
    }

    #[test]
    fn a_step_that_goes_on_and_on_is_not_about_to_end() {
        let names = (0..21).map(|k| (f64::from(k), "refining one more"));
        let left = said(&names.collect::<Vec<_>>());
        assert_eq!(left[20], Some(11.0), "half of 20 s, and the end");
    }

    #[test]
    fn several_effects_are_looked_for_from_other_beginnings_too() {
        let step = |from: f64| [(from, "refining drag"), (from + 10.0, "accepted: drag")];
        let mut stages = [step(0.0), step(10.0)].concat();
        stages.extend([
            (20.0, "refining play"),
            (30.0, "following stops instead"),
            (30.0, "accepted: stops"),
            (30.0, "refining lag"),
        ]);
        let left = said(&stages);
        assert_eq!(left[4], Some(10.0 + 2.0 * 30.0 + 10.0));
        assert_eq!(left[7], Some(30.0 + 30.0 + 10.0));
    }

    #[test]
    fn long_waits_are_told_in_minutes() {
        let said = [0.2, 30.0, 300.0].map(|s| rounded(Duration::from_secs_f64(s)));
        assert_eq!(said, ["1 s", "30 s", "5 min"]);
    }
}
