//! Input signals, and what a drive does to them.

use std::ops::Range;

/// The times between which the input of one recording is constant: the bounds of the integration steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Bounds of the steps, s, increasing; one more than there are steps.
    pub bounds: Vec<f64>,
    /// Where in `bounds` each log sample is.
    samples: Vec<usize>,
    /// Steps from each sample to the next; none where these differ.
    each: Option<usize>,
}

impl Grid {
    /// Every interval between two samples of `t` is cut into `substeps` equal steps.
    pub fn new(t: &[f64], substeps: usize) -> Self {
        Self::finer(t, substeps, &[])
    }

    /// The same, where interval `k` is cut into `times[k]` times as many; those that are not in `times` into `substeps`.
    pub fn finer(t: &[f64], substeps: usize, times: &[usize]) -> Self {
        let most = t.len().saturating_sub(1 + times.len()) + times.iter().sum::<usize>();
        let mut bounds = Vec::with_capacity(most * substeps + 1);
        let mut samples = Vec::with_capacity(t.len());
        for (k, pair) in t.windows(2).enumerate() {
            samples.push(bounds.len());
            let steps = substeps * times.get(k).copied().unwrap_or(1);
            for i in 0..steps {
                bounds.push(pair[0] + (pair[1] - pair[0]) * i as f64 / steps as f64);
            }
        }
        samples.extend(t.last().map(|_| bounds.len()));
        bounds.extend(t.last());
        let each = times.is_empty().then_some(substeps);
        Grid {
            bounds,
            samples,
            each,
        }
    }

    /// One step between every two of these times, each of which is a sample.
    pub fn of_steps(bounds: Vec<f64>) -> Self {
        let samples = (0..bounds.len()).collect();
        Grid {
            bounds,
            samples,
            each: Some(1),
        }
    }

    /// Number of log samples.
    pub fn samples(&self) -> usize {
        self.samples.len()
    }

    /// The steps from a sample to the next; none from the last one, or beyond.
    pub fn steps_from(&self, sample: usize) -> Range<usize> {
        match self.samples.get(sample..).unwrap_or_default() {
            &[first, end, ..] => first..end,
            _ => self.steps()..self.steps(),
        }
    }

    /// The steps over `count` samples, the `first` one included.
    pub fn steps_over(&self, (first, count): (usize, usize)) -> Range<usize> {
        let last = (first + count).saturating_sub(1);
        self.steps_from(first).start..self.steps_from(last).start
    }

    /// Whether a step ends at a sample.
    pub fn ends_at_sample(&self, step: usize) -> bool {
        match self.each {
            Some(each) => (step + 1).is_multiple_of(each),
            None => self.samples.binary_search(&(step + 1)).is_ok(),
        }
    }

    /// The sample that a step comes from.
    pub fn sample_of(&self, step: usize) -> usize {
        self.samples
            .partition_point(|first| *first <= step)
            .saturating_sub(1)
    }

    /// The step of the same part of the interval `back` samples before that of a step; the first one where that was before it.
    pub fn step_back(&self, step: usize, back: usize) -> usize {
        if let Some(each) = self.each {
            return step.saturating_sub(back * each);
        }
        let now = self.sample_of(step);
        let (here, there) = (
            self.steps_from(now),
            self.steps_from(now.saturating_sub(back)),
        );
        match now < back || here.is_empty() {
            true => 0,
            false => there.start + (step - here.start) * there.len() / here.len(),
        }
    }

    /// Steps from each sample to the next; those from the first where they differ.
    pub fn substeps(&self) -> usize {
        self.each.unwrap_or_else(|| self.steps_from(0).len())
    }

    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.bounds.len().saturating_sub(1)
    }
}

/// An input on a [`Grid`], constant over each step, with its derivatives in the parameters of the laws it went through.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// Value over each step.
    pub value: Vec<f64>,
    /// For each parameter: its index in the fit, and ∂value/∂parameter over each step.
    pub by_parameter: Vec<(usize, Vec<f64>)>,
}

/// A law that changes an input before it acts.
pub trait DriveLaw: Send + Sync {
    /// Passes the signal through: the value, the derivatives it already carries (chain rule), and new ones in `p`, whose
    /// indices in the fit are `first`, `first + 1`, …; `None`: no new ones are wanted.
    fn pass(&self, grid: &Grid, p: &[f64], first: Option<usize>, signal: &mut Signal);

    /// The time T ≥ 0, s, of a law that does nothing but u(t) → u(t − T): steps that adapt then end where the late input jumps, and no
    /// mean is taken. `None` (the default): the law changes values, at the instants at which they change anyway.
    fn delay(&self, _p: &[f64]) -> Option<f64> {
        None
    }

    /// Whether what passes depends on the input of before, other than by a delay: between jumps of the input it is then not constant.
    fn remembers(&self) -> bool {
        false
    }

    /// How long ago, s, an input may have been that still matters: a delay's T, 0 of a law that changes each instant by itself, and of a law
    /// that remembers the time in which all but 10⁻¹⁶ is lost of what was. `None` (the default of laws that remember): it is not known.
    fn past(&self, p: &[f64]) -> Option<f64> {
        match self.remembers() {
            true => None,
            false => Some(self.delay(p).unwrap_or(0.0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_cut_into_as_many_steps_as_they_are_to_have() {
        let grid = Grid::finer(&[0.0, 1.0, 2.0, 4.0], 2, &[1, 2]);
        assert_eq!(grid.bounds, [0.0, 0.5, 1.0, 1.25, 1.5, 1.75, 2.0, 3.0, 4.0]);
        assert_eq!((grid.samples(), grid.steps()), (4, 8));
        let from: Vec<_> = (0..5).map(|sample| grid.steps_from(sample)).collect();
        assert_eq!(from, [0..2, 2..6, 6..8, 8..8, 8..8]);
        assert_eq!(grid.steps_over((1, 3)), 2..8);
        assert_eq!(grid.steps_over((2, 1)), 6..6);
        let ends = (0..8).filter(|&step| grid.ends_at_sample(step));
        assert_eq!(ends.collect::<Vec<_>>(), [1, 5, 7]);
        let of: Vec<usize> = (0..8).map(|step| grid.sample_of(step)).collect();
        assert_eq!(of, [0, 0, 1, 1, 1, 1, 2, 2]);
        // The second half of one interval is the second half of another.
        let back = [
            (7, 1, 4),
            (6, 1, 2),
            (5, 1, 1),
            (2, 1, 0),
            (1, 1, 0),
            (7, 2, 1),
        ];
        for (step, samples, there) in back {
            assert_eq!(grid.step_back(step, samples), there, "{step} {samples}");
        }
    }

    #[test]
    fn a_grid_of_equal_intervals_is_the_same_either_way() {
        let t = [0.0, 0.1, 0.2, 0.3];
        let (each, listed) = (Grid::new(&t, 3), Grid::finer(&t, 3, &[1, 1, 1]));
        assert_eq!(each.bounds, listed.bounds);
        for step in 0..9 {
            assert_eq!(each.sample_of(step), listed.sample_of(step));
            assert_eq!(each.ends_at_sample(step), listed.ends_at_sample(step));
            for back in 0..4 {
                assert_eq!(each.step_back(step, back), listed.step_back(step, back));
            }
        }
        assert_eq!((each.substeps(), listed.substeps()), (3, 3));
        assert_eq!(
            (Grid::new(&[], 3).samples(), Grid::new(&[1.0], 3).steps()),
            (0, 0)
        );
    }
}
