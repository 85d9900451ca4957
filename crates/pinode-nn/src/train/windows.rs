//! Recordings of one rate are cut into windows; what has none is named.

use std::collections::BTreeSet;
use std::path::Path;

use super::Options;
use super::data::Recordings;
use crate::Error;
use crate::log::{Log, typical};
use crate::shooting::Window;

/// The last of so many parts of a recording is held out.
const HELD_OUT: usize = 8;
/// It hardly moves where the squares of its velocities are less than this part of all: it has an eighth of the time.
const AT_REST: f64 = 0.02;
/// No window spans an interval of more than so many usual ones.
const LONG_GAP: f64 = 3.0;
/// Recordings whose sample intervals are apart by more than this factor are not rolled out together.
const ONE_RATE: f64 = 1.1;
/// Batches whose roll-outs take more memory are refused.
const MOST_BYTES: f64 = 16e9;

impl Recordings {
    /// Windows of `horizon` sample intervals, each `stride` after the one before: those that are learnt from, and those held out.
    pub(super) fn cut(&self, horizon: usize, stride: usize) -> [Vec<Window>; 2] {
        self.cut_from(horizon, stride, |_| 0)
    }

    /// The same from a sample of each recording on, told by the number of its samples.
    pub(super) fn cut_from(
        &self,
        horizon: usize,
        stride: usize,
        begin: impl Fn(usize) -> usize,
    ) -> [Vec<Window>; 2] {
        let given = self.fit_runs < self.observations.runs.len();
        let mut sides = [Vec::new(), Vec::new()];
        for (run, observed) in self.observations.runs.iter().enumerate() {
            let t = &observed.t;
            let border = border(t.len());
            let mut first = begin(t.len());
            while first + horizon < t.len() {
                let last = first + horizon;
                let gap = (first..last).find(|&k| self.is_gap(run, k));
                if let Some(k) = gap {
                    first = k + 1;
                    continue;
                }
                let window = Window {
                    run,
                    first,
                    count: horizon + 1,
                };
                // A window that straddles the border belongs to neither side.
                let side = match given {
                    true => Some(usize::from(run >= self.fit_runs)),
                    false if first >= border => Some(1),
                    false => (last < border).then_some(0),
                };
                if let Some(side) = side {
                    sides[side].push(window);
                }
                first += stride;
            }
        }
        sides.map(|windows| self.masked.leave(windows, &self.observations))
    }

    /// Whether the roll-outs of a batch fit into the memory that a training may take.
    pub(super) fn check_room(&self, options: &Options) -> Result<(), Error> {
        let windows = self.seen.windows.len().max(self.held_out.windows.len());
        let windows = windows.min(options.batch);
        let steps = self.horizon * self.substeps;
        // Values and slopes of all units, and the linearised mechanics, at four stages a step.
        let units: usize = options.units.iter().sum();
        let n = self.hybrid.nx();
        let wide = if options.single { 4 } else { 8 };
        let of_stage = (4 * units * wide + 2 * n * n * 8) as f64;
        let bytes = 4.0 * of_stage * steps as f64 * windows as f64;
        if bytes <= MOST_BYTES {
            return Ok(());
        }
        Err(Error::Training(format!(
            "a batch of {windows} windows of {steps} steps takes some {:.0} GB of memory, and {:.0} at most are taken: give a smaller \
             --batch, a shorter --horizon, a longer --step or fewer --units",
            bytes / 1e9,
            MOST_BYTES / 1e9
        )))
    }

    /// Said where the last parts of the recordings, which are held out, hardly move: they do not tell when to stop.
    pub(super) fn rests_in_the_end(&self) -> Option<String> {
        if self.fit_runs < self.observations.runs.len() {
            return None;
        }
        let (mut whole, mut last) = (0.0, 0.0);
        for c in 0..self.hybrid.nv() {
            let squares = |from: fn(usize) -> usize| -> f64 {
                let runs = self.smoothed.iter().map(|run| &run.v[c]);
                let moved = runs.flat_map(|v| v[from(v.len())..].iter());
                moved.map(|v| v * v).sum()
            };
            let all = squares(|_| 0);
            let samples: usize = self.smoothed.iter().map(|run| run.v[c].len()).sum();
            let channels = self.observations.channels.iter();
            let noises = channels.filter(|own| own.coordinate == c && !own.velocity);
            let noise = noises.map(|own| own.noise).fold(0.0, f64::max);
            // One that never leaves its noise says nothing either way.
            if (all / samples.max(1) as f64).sqrt() * self.interval > noise {
                whole += 1.0;
                last += squares(border) / all;
            }
        }
        (last < AT_REST * whole).then(|| {
            format!(
                "the last eighth of each recording, which is held out, hardly moves ({:.1} % of the squares of velocities): it says little of when to stop, and of whether \
                 the network helps; give a log that moves to --holdout",
                100.0 * last / whole
            )
        })
    }

    /// Whether no window spans the interval after a sample.
    fn is_gap(&self, run: usize, sample: usize) -> bool {
        let t = &self.observations.runs[run].t;
        t[sample + 1] - t[sample] > LONG_GAP * self.intervals[run]
    }

    /// The recordings that have no window, and why.
    pub(super) fn without_window(&self, names: &[RunName]) -> Vec<String> {
        let windows = self.seen.windows.iter().chain(&self.held_out.windows);
        let used: BTreeSet<usize> = windows.map(|window| window.run).collect();
        let unused = names.iter().enumerate().filter(|(k, _)| !used.contains(k));
        let needed = self.horizon + 1;
        let why = |run: usize| {
            let samples = self.observations.runs[run].t.len();
            if samples < needed {
                return format!("it has {samples} samples that count, and a window {needed}");
            }
            let gaps = (0..samples - 1).filter(|&k| self.is_gap(run, k)).count();
            format!(
                "{needed} samples of a window are not together in it: it has {gaps} gaps of more than {LONG_GAP} sample intervals, \
                 and what is held out and what the audit calls faulty is taken apart"
            )
        };
        unused
            .map(|(run, name)| format!("{name} is not used: {}", why(run)))
            .collect()
    }
}

/// The first sample that is held out of a recording with so many.
pub(super) fn border(samples: usize) -> usize {
    samples - samples / HELD_OUT
}

/// A recording, as messages call it.
pub(super) struct RunName<'a> {
    log: &'a Path,
    run: &'a str,
}

impl std::fmt::Display for RunName<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "run `{}` of {}", self.run, self.log.display())
    }
}

/// The recordings in the order of the observations.
pub(super) fn run_names<'a>(
    logs: &'a [Log],
    held_out: &'a [Log],
) -> impl Iterator<Item = RunName<'a>> {
    let of = |log: &'a Log| {
        let runs = log.runs.iter();
        runs.map(|run| RunName {
            log: &log.path,
            run: &run.id,
        })
    };
    logs.iter().chain(held_out).flat_map(of)
}

/// The time between samples, s, that all recordings share: windows are rolled out together, sample by sample.
///
/// # Errors
/// [`Error::Training`] where they have different ones.
pub(super) fn one_interval(names: &[RunName], intervals: &[f64]) -> Result<f64, Error> {
    let of_runs = || intervals.iter().copied().filter(|x| x.is_finite());
    let (least, most) = (
        of_runs().fold(f64::INFINITY, f64::min),
        of_runs().fold(0.0, f64::max),
    );
    if most > ONE_RATE * least {
        let mut told: Vec<f64> = Vec::new();
        let mut list = Vec::new();
        for (name, &interval) in names.iter().zip(intervals) {
            let near = |x: &f64| *x <= ONE_RATE * interval && interval <= ONE_RATE * x;
            if interval.is_finite() && !told.iter().any(near) {
                told.push(interval);
                list.push(format!("{interval:.6} s in {name}"));
            }
        }
        return Err(Error::Training(format!(
            "the time between samples is {}; a window has as many samples in one log as in another: train on logs of one rate",
            list.join(", ")
        )));
    }
    Ok(typical(of_runs().collect()).unwrap_or(1.0))
}
