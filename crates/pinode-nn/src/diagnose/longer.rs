//! Standard errors of constants beside hidden states.
//!
//! Where the hidden states of a law begin is fitted window by window. A law that is a little wrong, as teeth that give where real ones are
//! hard, puts part of its error there, and the rest into its constants, the same part in every window: the scatter of the windows does not
//! show it. Windows twice as long have half as many such starts: with s the standard error by the windows and d what a constant differs by
//! in a fit to those, its error is √(s² + d²). (What two estimates differ by that a right model would both bring to the truth tells of a
//! wrong one: Hausman, "Specification tests in econometrics", Econometrica 46, 1978.)

use super::pushes::is_push;
use super::stops::unresolved;
use super::study::{Fitted, Study};
use super::{valley, width};
use crate::hybrid::Placed;
use crate::shooting::{FitOptions, Window, fit};

/// Iterations of the fit to longer windows, which starts where the other one ended.
const ITERATIONS: usize = 20;
/// Those of the initial states before.
const STATES_ALONE: usize = 3;

impl Fitted {
    /// Standard errors of the constants that were free, in the order of `inside.free`, with what samples do not resolve of [stops](unresolved), what they [owe](width::owed)
    /// to how sharply dry friction changes its sign, and [to motors](valley::owed) that are not known better; computed once.
    pub fn standard_errors(&self, study: &Study) -> &[f64] {
        self.errors.get_or_init(|| {
            let mut errors = self.inside.standard_errors();
            // The motor of a drive was free: what constants owe to it is there already, as far as a parabola knows.
            let owed = errors.iter_mut().zip(valley::owed(study, self));
            owed.for_each(|(e, owed)| *e = e.max(owed));
            for off in [unresolved(study, self), width::owed(study, self)] {
                errors
                    .iter_mut()
                    .zip(off)
                    .for_each(|(e, off)| *e = e.hypot(off));
            }
            if let Some(theta) = fit_to_longer(study, self) {
                for (error, &i) in errors.iter_mut().zip(&self.inside.free) {
                    *error = error.hypot(theta[i] - self.inside.theta[i]);
                }
            }
            errors
        })
    }

    /// That of the constant with this index in θ, where it was free.
    pub fn standard_error(&self, study: &Study, index: usize) -> Option<f64> {
        let place = self.inside.free.iter().position(|&i| i == index)?;
        self.standard_errors(study).get(place).copied()
    }
}

/// θ of a fit to windows twice as long, for a model with hidden states.
fn fit_to_longer(study: &Study, fitted: &Fitted) -> Option<Vec<f64>> {
    let hybrid = &fitted.hybrid;
    let hides = |e: &Placed| e.kind.states() > 0 && !is_push(e);
    if !hybrid.effects().iter().any(hides) {
        return None;
    }
    let (windows, starts) = joined(&study.windows.fit);
    if windows.len() == study.windows.fit.len() {
        return None;
    }
    let theta = &fitted.inside.theta;
    let paths = study.hidden_paths(hybrid, theta, fitted.substeps);
    let known = study.hidden_prior(hybrid, (theta, true), &windows, &paths);
    let states = starts.iter().map(|&k| fitted.inside.states[k].clone());
    let longer = fit(
        hybrid,
        &study.observations,
        &windows,
        &fitted.inside.free,
        theta.clone(),
        states.collect(),
        fitted.inside.sigma.clone(),
        &known,
        &FitOptions {
            substeps: fitted.substeps,
            iterations: ITERATIONS,
            state_iterations: STATES_ALONE,
        },
    );
    Some(longer.theta)
}

/// Every two windows that follow each other as one, the others as they are; with the index of the first of each.
fn joined(windows: &[Window]) -> (Vec<Window>, Vec<usize>) {
    let mut longer = Vec::new();
    let mut firsts = Vec::new();
    let mut k = 0;
    while let Some(&window) = windows.get(k) {
        let next = windows
            .get(k + 1)
            .filter(|next| next.run == window.run && next.first == window.first + window.count);
        longer.push(Window {
            count: window.count + next.map_or(0, |next| next.count),
            ..window
        });
        firsts.push(k);
        k += if next.is_some() { 2 } else { 1 };
    }
    (longer, firsts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_that_follow_each_other_are_joined_in_pairs_within_a_recording() {
        let window = |run, first| Window {
            run,
            first,
            count: 10,
        };
        let windows = [
            window(0, 0),
            window(0, 10),
            window(0, 20),
            window(0, 35),
            window(1, 45),
            window(1, 55),
        ];
        let (longer, firsts) = joined(&windows);
        let spans: Vec<_> = longer.iter().map(|w| (w.run, w.first, w.count)).collect();
        assert_eq!(spans, [(0, 0, 20), (0, 20, 10), (0, 35, 10), (1, 45, 20)]);
        assert_eq!(firsts, [0, 2, 3, 4]);
    }
}
