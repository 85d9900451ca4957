//! Stretches of time that take no part in anything.

use crate::shooting::{Observations, Window};

/// For each recording the stretches of time, s, that no window may touch: what moved the mechanism there is not in the log.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Masked(Vec<Vec<[f64; 2]>>);

impl Masked {
    /// None in so many recordings.
    pub fn none(runs: usize) -> Self {
        Masked(vec![Vec::new(); runs])
    }

    /// Masks `[from, to]` of recording `run`.
    pub fn add(&mut self, run: usize, stretch: [f64; 2]) {
        if self.0.len() <= run {
            self.0.resize(run + 1, Vec::new());
        }
        self.0[run].push(stretch);
    }

    /// Whether anything between `from` and `to` of a recording is masked.
    pub fn touches(&self, run: usize, from: f64, to: f64) -> bool {
        let own = self.0.get(run).map_or(&[][..], Vec::as_slice);
        own.iter().any(|&[a, b]| from < b && to > a)
    }

    /// The windows that touch nothing masked.
    pub fn leave(&self, windows: Vec<Window>, observations: &Observations) -> Vec<Window> {
        windows
            .into_iter()
            .filter(|w| {
                let t = &observations.runs[w.run].t;
                !self.touches(w.run, t[w.first], t[w.first + w.count - 1])
            })
            .collect()
    }
}
