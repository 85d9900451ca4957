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
        self.intervals() * self.substeps
    }

    /// Step number `step` of the whole roll-out, with the numbers that [`roll_out`](crate::roll_out) has for it.
    pub(crate) fn step(&self, step: usize) -> Step<'a, U> {
        let interval = step / self.substeps;
        let (from, to) = (self.times[interval], self.times[interval + 1]);
        let h = (to - from) / self.substeps as f64;
        Step {
            interval,
            t: from + (step % self.substeps) as f64 * h,
            h,
            u: &self.inputs[interval],
        }
    }
}
