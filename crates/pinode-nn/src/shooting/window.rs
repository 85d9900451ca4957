//! How recordings are cut into windows, and which of them no fit may see.

use super::Observations;

/// Of fewer recordings than this none is held out as a whole.
const FEW_RECORDINGS: usize = 4;

/// Consecutive samples of one recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Index of the recording.
    pub run: usize,
    /// Its first sample.
    pub first: usize,
    /// Number of samples.
    pub count: usize,
}

/// The windows that are fitted and those that are held out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Windows {
    /// Seen by the fits.
    pub fit: Vec<Window>,
    /// Seen by no fit of θ: the last quarter of the recordings, or the recordings given for it.
    pub held_out: Vec<Window>,
}

impl Windows {
    /// Cuts windows of `duration` s, one after the other. Recordings from `first_held_out` on are held out; when there are none,
    /// the last quarter of the recordings is (of the time, when there are fewer than four).
    pub fn cut(observations: &Observations, first_held_out: usize, duration: f64) -> Self {
        let runs = &observations.runs;
        let given = first_held_out < runs.len();
        let split_time = Self::are_split_in_time(runs.len(), first_held_out);
        let split_runs = if given {
            first_held_out
        } else if split_time {
            runs.len()
        } else {
            runs.len() - runs.len().div_ceil(4)
        };
        let mut windows = Windows {
            fit: Vec::new(),
            held_out: Vec::new(),
        };
        for (run, observed) in runs.iter().enumerate() {
            let t = &observed.t;
            let (Some(&start), Some(&end)) = (t.first(), t.last()) else {
                continue;
            };
            let border = start + 0.75 * (end - start);
            for window in consecutive(run, t, duration) {
                // A window that straddles the border belongs to neither side.
                let last = t[window.first + window.count - 1];
                if run >= split_runs || (split_time && t[window.first] >= border) {
                    windows.held_out.push(window);
                } else if !split_time || last < border {
                    windows.fit.push(window);
                }
            }
        }
        windows
    }

    /// Whether each of so many recordings has a part that is held out.
    pub fn are_split_in_time(runs: usize, first_held_out: usize) -> bool {
        first_held_out >= runs && runs < FEW_RECORDINGS
    }

    /// The same windows, the last quarter of each recording's held out, by their number.
    pub fn split_by_number(self) -> Self {
        let mut all = [self.fit, self.held_out].concat();
        all.sort_by_key(|window| (window.run, window.first));
        let (mut fit, mut held_out) = (Vec::new(), Vec::new());
        for of_run in all.chunk_by(|one, next| one.run == next.run) {
            let (early, late) = of_run.split_at(of_run.len() - of_run.len().div_ceil(4));
            fit.extend_from_slice(early);
            held_out.extend_from_slice(late);
        }
        Windows { fit, held_out }
    }
}

/// Windows of `duration` s over the sample times `t`, one after the other, without a rest that is shorter. A gap in time of more
/// than ten typical sample intervals ends a window.
pub fn consecutive(run: usize, t: &[f64], duration: f64) -> Vec<Window> {
    let mut intervals: Vec<f64> = t.windows(2).map(|p| p[1] - p[0]).collect();
    intervals.sort_by(f64::total_cmp);
    let Some(&typical) = intervals.get(intervals.len() / 2) else {
        return Vec::new();
    };
    let count = ((duration / typical).round() as usize).max(4);
    let mut windows = Vec::new();
    let mut first = 0;
    while first + count <= t.len() {
        let gap = t[first..first + count]
            .windows(2)
            .position(|p| p[1] - p[0] > 10.0 * typical);
        match gap {
            Some(k) => first += k + 1,
            None => {
                windows.push(Window { run, first, count });
                first += count;
            }
        }
    }
    windows
}

#[cfg(test)]
mod tests {
    use super::super::observation::{Finer, ObservedRun};
    use super::*;

    fn recording(seconds: f64) -> ObservedRun {
        let t: Vec<f64> = (0..(seconds / 0.02) as usize)
            .map(|k| k as f64 * 0.02)
            .collect();
        ObservedRun {
            finer: Finer::default(),
            y: vec![],
            u: vec![],
            valid: vec![],
            t,
        }
    }

    #[test]
    fn the_last_quarter_is_held_out_and_no_window_straddles_the_border() {
        let observations = Observations {
            channels: vec![],
            runs: vec![recording(60.0)],
        };
        let windows = Windows::cut(&observations, 1, 0.6);
        assert_eq!(windows.fit.len(), 75);
        assert_eq!(windows.held_out.len(), 25);
        let border = 0.75 * (60.0 - 0.02);
        let t = &observations.runs[0].t;
        assert!(
            windows
                .fit
                .iter()
                .all(|w| t[w.first + w.count - 1] < border)
        );
        assert!(windows.held_out.iter().all(|w| t[w.first] >= border));
    }

    #[test]
    fn whole_recordings_are_held_out_when_there_are_four_or_some_are_given() {
        let runs: Vec<_> = (0..8).map(|_| recording(6.0)).collect();
        let observations = Observations {
            channels: vec![],
            runs,
        };
        let windows = Windows::cut(&observations, 8, 0.6);
        assert!(windows.held_out.iter().all(|w| w.run >= 6));
        let windows = Windows::cut(&observations, 7, 0.6);
        assert!(windows.held_out.iter().all(|w| w.run == 7));
        assert_eq!(windows.fit.len(), 70);
    }

    #[test]
    fn the_last_quarter_of_each_recordings_windows_is_held_out_wherever_they_are() {
        let window = |run: usize, k: usize| Window {
            run,
            first: 30 * k,
            count: 30,
        };
        // Nothing happens in the first recording before its last quarter, and in the second one behind its first.
        let late = (80..92).map(|k| window(0, k));
        let early = (0..5).map(|k| window(1, k));
        let split = Windows {
            fit: early.collect(),
            held_out: late.collect(),
        };
        let split = split.split_by_number();
        let of = |all: &[Window], run: usize| -> Vec<usize> {
            let own = all.iter().filter(|w| w.run == run);
            own.map(|w| w.first / 30).collect()
        };
        assert_eq!(of(&split.fit, 0), (80..89).collect::<Vec<_>>());
        assert_eq!(of(&split.held_out, 0), [89, 90, 91]);
        assert_eq!(of(&split.fit, 1), [0, 1, 2]);
        assert_eq!(of(&split.held_out, 1), [3, 4]);
    }

    #[test]
    fn a_gap_in_time_ends_a_window() {
        let mut t: Vec<f64> = (0..100).map(|k| k as f64 * 0.02).collect();
        t[50..].iter_mut().for_each(|t| *t += 5.0);
        let windows = consecutive(0, &t, 0.6);
        assert_eq!(windows.len(), 2);
        assert_eq!(windows[1].first, 50);
    }
}
