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

/// A step of the search refines so many candidates.
const REFINED: usize = 5;

/// How long the stages of this run took, and what that says of those to come.
///
/// Nobody knows how many effects there are: what is left is reckoned as if the step under way were to find nothing more. Each step that
/// does find something adds one of the same cost.
struct StageClock {
    began: Instant,
    /// The stage under way is the refinement of a candidate.
    refining: bool,
    refined: usize,
    time_refining: Duration,
    /// Steps of the search begun.
    steps: usize,
}

impl StageClock {
    fn new() -> Self {
        StageClock {
            began: Instant::now(),
            refining: false,
            refined: 0,
            time_refining: Duration::ZERO,
            steps: 1,
        }
    }

    /// A stage begins; the time that is probably left, once a candidate has been refined in this run.
    fn left(&mut self, stage: &str, now: Instant) -> Option<Duration> {
        let took = now.saturating_duration_since(self.began);
        if self.refining {
            self.refined += 1;
            self.time_refining += took;
        }
        self.began = now;
        self.refining = stage.starts_with("refining");
        self.steps += usize::from(stage.starts_with("accepted"));
        if self.refined == 0 || !self.refining {
            return None;
        }
        let each = self.time_refining.as_secs_f64() / self.refined as f64;
        // The refinement that begins counts; steps that refine more than usual have at least it to go.
        let to_come = (REFINED * self.steps).saturating_sub(self.refined).max(1);
        // Free runs of the old and the new model at the end cost about one refinement.
        Some(Duration::from_secs_f64(each * (to_come + 1) as f64))
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

    #[test]
    fn what_is_left_follows_from_what_a_refinement_took() {
        let mut clock = StageClock::new();
        let start = clock.began;
        let mut at = |s: f64, stage: &str| clock.left(stage, start + Duration::from_secs_f64(s));
        assert_eq!(at(0.0, "fitting the model as given"), None);
        assert_eq!(
            at(4.0, "refining viscous_friction"),
            None,
            "none is timed yet"
        );
        let left = at(7.0, "refining coulomb_friction");
        assert_eq!(
            left,
            Some(Duration::from_secs(15)),
            "four more, and the end"
        );
        assert_eq!(
            at(10.0, "accepted: coulomb_friction (z 9.0, held out 5.0)"),
            None
        );
        // Two of ten are done.
        assert_eq!(
            at(12.0, "refining quadratic_drag"),
            Some(Duration::from_secs(27))
        );
    }

    #[test]
    fn long_waits_are_told_in_minutes() {
        let said = [0.2, 30.0, 300.0].map(|s| rounded(Duration::from_secs_f64(s)));
        assert_eq!(said, ["1 s", "30 s", "5 min"]);
    }
}
