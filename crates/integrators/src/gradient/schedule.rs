//! When a roll-out is sampled and what acts on it.

/// The times of the samples, the inputs held between them, and the steps in every interval: what [`roll_out`](crate::roll_out) takes
/// beside the system, the method and the initial state.
#[derive(Debug)]
pub struct Schedule<'a, U> {
    /// Times of the samples, s, finite and increasing.
    pub times: &'a [f64],
    /// `inputs[k]` is held over [`times[k]`, `times[k + 1]`); an input for the last sample may be there and is not used.
    pub inputs: &'a [U],
    /// Equal steps in every interval, at least 1.
    pub substeps: usize,
}

impl<U> Clone for Schedule<'_, U> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<U> Copy for Schedule<'_, U> {}

/// One step of a roll-out.
pub(crate) struct Step<'a, U: ?Sized> {
    /// The number of its interval.
    pub interval: usize,
    /// Where it begins, s.
    pub t: f64,
    /// Its length, s.
    pub h: f64,
    /// What is held over it.
    pub u: &'a U,
}

impl<'a, U> Schedule<'a, U> {
    /// Intervals between samples.
    pub fn intervals(&self) -> usize {
        self.times.len().saturating_sub(1)
    }

    /// Steps of the whole roll-out.
    pub fn steps(&self) -> usize {
        self.intervals().saturating_mul(self.substeps)
    }

    /// Some steps of the whole roll-out, by their numbers, interval after interval, with the numbers that
    /// [`roll_out`](crate::roll_out) has for them.
    pub(crate) fn held(
        self,
        steps: std::ops::Range<usize>,
    ) -> impl DoubleEndedIterator<Item = Held<'a, U>> {
        let intervals = if steps.is_empty() {
            0..0
        } else {
            steps.start / self.substeps..(steps.end - 1) / self.substeps + 1
        };
        intervals.map(move |interval| {
            let (from, to) = (self.times[interval], self.times[interval + 1]);
            let first = interval * self.substeps;
            Held {
                interval,
                from,
                h: (to - from) / self.substeps as f64,
                u: &self.inputs[interval],
                steps: steps.start.max(first) - first
                    ..steps.end.min(first.saturating_add(self.substeps)) - first,
            }
        })
    }
}

/// Steps over which one input is held.
pub(crate) struct Held<'a, U> {
    pub interval: usize,
    from: f64,
    h: f64,
    u: &'a U,
    /// Their numbers in the interval.
    pub steps: std::ops::Range<usize>,
}

impl<'a, U> Held<'a, U> {
    /// Step number i of the interval.
    pub fn step(&self, i: usize) -> Step<'a, U> {
        Step {
            interval: self.interval,
            t: self.from + i as f64 * self.h,
            h: self.h,
            u: self.u,
        }
    }
}
