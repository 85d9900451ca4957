//! Levenberg–Marquardt over θ with every window's initial state eliminated.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::problem::{HiddenPrior, Problem, Rolled, late};
use super::{Channel, Observations, Reduced, Window};
use crate::hybrid::Hybrid;

/// How a fit ends and how finely it integrates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// Integration steps per log sample.
    pub substeps: usize,
    /// At most so many accepted steps.
    pub iterations: usize,
    /// Steps of the initial states alone before θ moves.
    pub state_iterations: usize,
}

/// The result of a fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// θ, all entries.
    pub theta: Vec<f64>,
    /// The entries that were free.
    pub free: Vec<usize>,
    /// Initial state of every window.
    pub states: Vec<Vec<f64>>,
    /// Standard deviation of the residuals of each channel, at least the sensor's noise.
    pub sigma: Vec<f64>,
    /// Sum of squared residuals and their number, per window and channel; infinite where the roll-out diverges.
    pub squares: Vec<Vec<(f64, usize)>>,
    /// Σ over windows of S, and the priors: the information on θ_free, in units of the residuals' variance.
    pub information: DMatrix<f64>,
    /// What each window by itself pulls θ_free by, times the information: I (I − S_w)⁻¹ g_w, as if the others had been fitted without it
    /// (none where its equations failed); then what each tolerance does, for the sandwich error.
    pub gradients: Vec<Option<DVector<f64>>>,
    /// The loss, with priors.
    pub loss: f64,
    /// The priors' part of it, Σ ½ ((θ − θ₀)/tolerance)²: how far the fit stretches the tolerances, nats.
    pub stretch: f64,
    /// How many of the hidden states at its start each window determines by itself: what they gain it is no merit of θ.
    pub determined: Vec<f64>,
    /// Whether the loss had stopped falling.
    pub converged: bool,
    /// What the better of the last two iterations gained, nats: one more gains hardly more. Infinite where fewer were made and nobody knows.
    pub gained: f64,
}

impl Fit {
    /// Standard errors of θ_free that hold for residuals correlated within a window: the sandwich I⁻¹ (Σ g̃ g̃ᵀ) I⁻¹, g̃ a window's
    /// gradient as if the others had been fitted without it (the jackknife over windows; few windows fit themselves), and the tolerances
    /// among them; at least the nominal I⁻¹. A constant that the data do not move has an infinite one, or its prior's.
    pub fn standard_errors(&self) -> Vec<f64> {
        let Some((moving, inverse)) = self.inverse() else {
            return vec![f64::INFINITY; self.free.len()];
        };
        let n = moving.len();
        let mut meat = DMatrix::zeros(n, n);
        for g in self.gradients.iter().flatten() {
            let g = DVector::from_fn(n, |i, _| g[moving[i]]);
            meat += &g * g.transpose();
        }
        let sandwich = &inverse * meat * &inverse;
        let variances = sandwich.diagonal().sup(&inverse.diagonal());
        self.errors(&moving, variances.map(f64::sqrt).as_slice())
    }

    /// Errors of θ_free, given those of the entries that move something; the others have infinite ones.
    fn errors(&self, moving: &[usize], of_moving: &[f64]) -> Vec<f64> {
        let mut errors = vec![f64::INFINITY; self.free.len()];
        for (&k, &error) in moving.iter().zip(of_moving) {
            errors[k] = error;
        }
        errors
    }

    /// Standard errors of θ_free by the information alone, the diagonal of I⁻¹: as if no residuals hung together. Infinite where nothing moves a constant.
    pub fn nominal_errors(&self) -> Vec<f64> {
        self.nominal_errors_knowing(|_| false)
    }

    /// The same where the entries of θ for which `is_known` holds are known: what is left of an error when the others cannot make up for it. Theirs are infinite.
    pub(crate) fn nominal_errors_knowing(&self, is_known: impl Fn(usize) -> bool) -> Vec<f64> {
        let Some((moving, inverse)) = self.inverse_knowing(is_known) else {
            return vec![f64::INFINITY; self.free.len()];
        };
        self.errors(&moving, inverse.diagonal().map(f64::sqrt).as_slice())
    }

    /// By how much each of the first `windows` windows moves θ_free, I⁻¹ g̃ of [`standard_errors`](Self::standard_errors): 0 where its equations
    /// failed, and of a constant that moves nothing. Empty where the information cannot be inverted.
    pub fn influences(&self, windows: usize) -> Vec<DVector<f64>> {
        let Some((moving, inverse)) = self.inverse() else {
            return Vec::new();
        };
        let of_window = |g: &Option<DVector<f64>>| {
            let mut moved = DVector::zeros(self.free.len());
            if let Some(g) = g {
                let g = DVector::from_fn(moving.len(), |i, _| g[moving[i]]);
                let by = &inverse * g;
                for (&k, by) in moving.iter().zip(by.iter()) {
                    moved[k] = *by;
                }
            }
            moved
        };
        self.gradients.iter().take(windows).map(of_window).collect()
    }

    /// The entries of θ_free that move something, and the inverse of the information on them.
    fn inverse(&self) -> Option<(Vec<usize>, DMatrix<f64>)> {
        self.inverse_knowing(|_| false)
    }

    /// The same without the entries of θ that are known.
    fn inverse_knowing(
        &self,
        is_known: impl Fn(usize) -> bool,
    ) -> Option<(Vec<usize>, DMatrix<f64>)> {
        let moving: Vec<usize> = (0..self.free.len())
            .filter(|&k| self.information[(k, k)] > 1e-300 && !is_known(self.free[k]))
            .collect();
        let n = moving.len();
        let entry = |i: usize, j: usize| self.information[(moving[i], moving[j])];
        let inverse = Cholesky::new(DMatrix::from_fn(n, n, entry))?.inverse();
        Some((moving, inverse))
    }
}

/// The damped step of θ_free within its bounds; a constant at its bound that would leave it, or that moves nothing, stays.
fn damped_step(
    problem: &Problem,
    theta: &[f64],
    s: &DMatrix<f64>,
    g: &DVector<f64>,
    damping: f64,
) -> DVector<f64> {
    let n = problem.free.len();
    let bound = |k: usize| {
        let constant = &problem.hybrid.constants()[problem.free[k]];
        let x = theta[problem.free[k]];
        (constant.lower - x, constant.upper - x)
    };
    let mut active: Vec<usize> = (0..n)
        .filter(|&k| {
            let (down, up) = bound(k);
            s[(k, k)] > 1e-300 && !(down >= 0.0 && g[k] < 0.0) && !(up <= 0.0 && g[k] > 0.0)
        })
        .collect();
    let mut step = DVector::zeros(n);
    // Constants that the step would carry over a bound are put on it and the rest solved again.
    while !active.is_empty() {
        let m = active.len();
        // Scaled to a unit diagonal: the constants' units differ by many orders of magnitude.
        let scale: Vec<f64> = active.iter().map(|&k| s[(k, k)].sqrt()).collect();
        let fixed_part = s * &step;
        let matrix = DMatrix::from_fn(m, m, |i, j| {
            let entry = s[(active[i], active[j])] / (scale[i] * scale[j]);
            if i == j { entry + damping } else { entry }
        });
        let rhs = DVector::from_fn(m, |i, _| (g[active[i]] - fixed_part[active[i]]) / scale[i]);
        let Some(factor) = Cholesky::new(matrix) else {
            break;
        };
        let solved = factor.solve(&rhs);
        let over: Vec<usize> = (0..m)
            .filter(|&i| {
                let (down, up) = bound(active[i]);
                let d = solved[i] / scale[i];
                d < down || d > up
            })
            .collect();
        if over.is_empty() {
            for i in 0..m {
                step[active[i]] = solved[i] / scale[i];
            }
            break;
        }
        for &i in over.iter().rev() {
            let (down, up) = bound(active[i]);
            step[active[i]] = (solved[i] / scale[i]).clamp(down, up);
            active.remove(i);
        }
    }
    step
}

/// The damping to start with, relative to the diagonal. What data hardly determine is left to the priors: it must not hold that back.
const FIRST_DAMPING: f64 = 1e-6;
/// The least damping there is.
const LEAST: f64 = 1e-9;
/// The least damping after a step that raised the loss, how fast it grows from there, and how often one step is tried.
const LEAST_AFTER: f64 = 1e-3;
const HARDER: f64 = 30.0;
const TRIALS: usize = 5;
/// A step that lowers the loss by less than this, nats, gains nothing; short ones end the fit where so many in a row gain less than that part of it.
const NOTHING: f64 = 0.3;
const SHORT_ONES: (usize, f64) = (3, 0.1);
/// A fit that has stopped goes on where windows that were stuck gained so many nats.
pub(super) const WORTH_GOING_ON: f64 = 3.0;

/// The damping after a step that gained `share` of what its equations promised (Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05):
/// a tenth where that was all, more than before where it was less than half.
fn eased(damping: f64, share: f64) -> f64 {
    let factor = 1.0 - (2.0 * share.clamp(0.0, 1.0) - 1.0).powi(3);
    (damping * factor.max(0.1)).max(LEAST)
}

/// A fit on its way.
pub(super) struct Going {
    pub theta: Vec<f64>,
    pub now: Vec<Rolled>,
    pub sigma: Vec<f64>,
    /// With priors.
    pub loss: f64,
}

/// How a fit ended.
pub(super) struct Ended {
    /// Whether the loss had stopped falling.
    pub converged: bool,
    /// What the better of the last two iterations gained, nats.
    pub gained: f64,
    /// Whether windows that are stuck had their second look.
    pub looked: bool,
}

impl Going {
    fn total(&self, problem: &Problem) -> f64 {
        problem.total(&self.theta, &self.now, &self.sigma)
    }

    /// Takes the residuals' spread for σ, which changes the loss; by how much σ changes, relative to it.
    pub fn take_spread(&mut self, problem: &Problem) -> f64 {
        let new = spread(&problem.observations.channels, &self.now);
        let changes = self.sigma.iter().zip(&new);
        let change = changes
            .map(|(old, new)| (new / old - 1.0).abs())
            .fold(0.0, f64::max);
        self.sigma = new;
        self.loss = self.total(problem);
        change
    }

    /// Gives windows that are stuck a second look; by how many nats they gain.
    pub fn look(&mut self, problem: &Problem) -> f64 {
        problem.unstick(&self.theta, &mut self.now, &self.sigma)
    }

    /// Steps of θ and all initial states.
    fn descend(&mut self, problem: &Problem, iterations: usize) -> Ended {
        let (mut converged, mut was_idle, mut looked) = (false, false, false);
        let mut stalls = 0;
        let mut gains = [f64::INFINITY; 2];
        let mut damping = FIRST_DAMPING;
        for _ in 0..iterations {
            let before = self.loss;
            let (accepted, held_back) = self.step(problem, &mut damping);
            let decrease = before - self.loss;
            gains = [gains[1], decrease];
            let change = self.take_spread(problem);
            let idle = decrease < NOTHING + 1e-4 * before;
            let (most, part) = SHORT_ONES;
            stalls = match held_back && decrease < part * NOTHING {
                true => stalls + 1,
                false => 0,
            };
            // A median that goes to and fro between two residuals moves nothing: a second step that gains nothing ends the fit as well. A short one says
            // nothing; several do, as where friction that sticks makes an edge of the loss.
            let has_stopped = idle && !held_back && (change < 3e-3 || was_idle);
            if has_stopped || stalls >= most {
                let gained = match looked {
                    false => self.look(problem),
                    true => 0.0,
                };
                looked = true;
                self.take_spread(problem);
                if gained < WORTH_GOING_ON {
                    converged = true;
                    break;
                }
                (was_idle, stalls) = (false, 0);
                continue;
            }
            was_idle = idle;
            if !accepted {
                damping = FIRST_DAMPING;
            }
        }
        Ended {
            converged,
            gained: gains[0].max(gains[1]),
            looked,
        }
    }

    /// One step of θ and all initial states, damped until it lowers the loss: whether it did, and whether much damping held it back.
    fn step(&mut self, problem: &Problem, damping: &mut f64) -> (bool, bool) {
        let constants = problem.hybrid.constants();
        let reduced = problem.reduced(&self.theta, &mut self.now, &self.sigma);
        let (s, g) = problem.assemble(&self.theta, &reduced);
        let by_states: f64 = reduced.iter().flatten().map(|r| r.state_gain).sum();
        for _ in 0..TRIALS {
            let d = damped_step(problem, &self.theta, &s, &g, *damping);
            let mut trial = self.theta.clone();
            for (k, &i) in problem.free.iter().enumerate() {
                trial[i] = (trial[i] + d[k]).clamp(constants[i].lower, constants[i].upper);
            }
            let steps: Vec<_> = reduced
                .iter()
                .map(|r| r.as_ref().map(|r| &r.state_step - &r.state_by_theta * &d))
                .collect();
            let relief = problem.prior_loss(&self.theta) - problem.prior_loss(&trial);
            let stepped = problem.stepped(&trial, &self.now, &steps, &self.sigma, Some(relief));
            let loss = problem.total(&trial, &stepped, &self.sigma);
            if loss < self.loss {
                let held_back = *damping > LEAST_AFTER;
                let promised = by_states + g.dot(&d) - 0.5 * d.dot(&(&s * &d));
                *damping = eased(*damping, (self.loss - loss) / promised);
                self.theta = trial;
                self.now = stepped;
                self.loss = loss;
                return (true, held_back);
            }
            // Without a step of θ there is nothing to damp.
            if d.iter().all(|d| *d == 0.0) {
                break;
            }
            *damping = (*damping * HARDER).max(LEAST_AFTER);
        }
        (false, false)
    }
}

/// Fits θ_free and the initial states to the windows, from the model's θ and the states given.
///
/// `sigma` are the standard deviations to start with, one a channel; they are estimated anew with every step. `hidden` is what is known of
/// the hidden part of the states.
#[allow(clippy::too_many_arguments)]
pub fn fit(
    hybrid: &Hybrid,
    observations: &Observations,
    windows: &[Window],
    free: &[usize],
    theta: Vec<f64>,
    states: Vec<Vec<f64>>,
    mut sigma: Vec<f64>,
    hidden: &HiddenPrior,
    options: &FitOptions,
) -> Fit {
    let late = late(hybrid, &theta);
    let surroundings = |free| {
        Problem::new(
            hybrid,
            observations,
            windows,
            free,
            hidden,
            options.substeps,
        )
        .read_late(&late)
    };
    let problem = surroundings(free);
    let states_only = surroundings(&[]);

    let channels = &observations.channels;
    // Where the states move alone they need no derivatives in θ, which may leave all bounds where those in the states do not, until the last step.
    let alone = options.state_iterations;
    let mut now = match alone {
        0 => problem.rolled(&theta, states),
        _ => states_only.rolled(&theta, states),
    };
    for step in 1..=alone {
        let reduced = states_only.reduced(&theta, &mut now, &sigma);
        let next = if step == alone {
            &problem
        } else {
            &states_only
        };
        now = next.stepped_alone(&theta, &now, reduced, &sigma);
        sigma = spread(channels, &now);
    }

    let mut going = Going {
        theta,
        now,
        sigma,
        loss: 0.0,
    };
    going.loss = going.total(&problem);
    let Ended {
        converged,
        gained,
        looked,
    } = match free.is_empty() {
        true => going.settle(&problem, options.iterations),
        false => going.descend(&problem, options.iterations),
    };
    let moved = options.iterations + options.state_iterations > 0;
    if moved && !looked && going.look(&problem) > 0.0 {
        going.take_spread(&problem);
    }
    let Going {
        theta,
        mut now,
        sigma,
        loss,
    } = going;
    // What the delay has become says which samples count.
    let ended = self::late(hybrid, &theta);
    let problem = match ended == late {
        true => problem,
        false => {
            let problem = problem.read_late(&ended);
            now = problem.rolled(&theta, now.into_iter().map(|w| w.state).collect());
            problem
        }
    };
    let reduced = problem.reduced(&theta, &mut now, &sigma);
    let (information, _) = problem.assemble(&theta, &reduced);
    let of_windows = reduced
        .iter()
        .map(|r| r.as_ref().map(|r| by_itself(&information, r)));
    let tolerances = free.iter().enumerate().map(|(k, &i)| {
        let mut pull = DVector::zeros(free.len());
        pull[k] = hybrid.constants()[i].tolerance.recip();
        Some(pull)
    });
    let gradients = of_windows.chain(tolerances).collect();
    Fit {
        stretch: problem.prior_loss(&theta),
        theta,
        free: free.to_vec(),
        squares: windows
            .iter()
            .zip(&now)
            .map(|(window, w)| problem.of_all(window, w.squares(channels.len())))
            .collect(),
        states: now.into_iter().map(|w| w.state).collect(),
        sigma,
        information,
        determined: reduced
            .iter()
            .map(|r| r.as_ref().map_or(0.0, |r| r.determined))
            .collect(),
        gradients,
        loss,
        converged,
        gained,
    }
}

/// I (I − S_w)⁻¹ g_w of a window; g_w where the others do not determine θ_free.
fn by_itself(information: &DMatrix<f64>, window: &Reduced) -> DVector<f64> {
    match Cholesky::new(information - &window.s) {
        Some(others) if !window.g.is_empty() => information * others.solve(&window.g),
        _ => window.g.clone(),
    }
}

/// Robust standard deviation of the residuals of each channel, at least the sensor's noise.
fn spread(channels: &[Channel], now: &[Rolled]) -> Vec<f64> {
    let mut sizes = vec![Vec::new(); channels.len()];
    for &(c, r) in now.iter().flat_map(|w| w.residuals.iter().flatten()) {
        sizes[c].push(r.abs());
    }
    channels
        .iter()
        .zip(&mut sizes)
        .map(|(channel, sizes)| {
            sizes.sort_unstable_by(f64::total_cmp);
            let median = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
            (1.4826 * median).max(channel.noise)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damping_falls_after_steps_that_keep_their_promise_and_grows_after_others() {
        assert_eq!(eased(1.0, 1.0), 0.1);
        assert_eq!(eased(1.0, 0.5), 1.0);
        assert_eq!(eased(1.0, 0.0), 2.0);
        assert_eq!(eased(1e-9, 1.0), LEAST);
        // What promised nothing and gained something kept its promise.
        assert_eq!(eased(1.0, f64::INFINITY), 0.1);
        assert_eq!(eased(1.0, f64::NAN), 0.1);
    }

    /// Two constants with the correlation r: each is known √(1 − r²) times as far where the other is.
    #[test]
    fn an_error_is_smaller_where_what_does_the_same_is_known() {
        let r: f64 = 0.8;
        let fit = Fit {
            theta: vec![0.0; 3],
            free: vec![0, 2],
            states: Vec::new(),
            sigma: Vec::new(),
            squares: Vec::new(),
            gradients: Vec::new(),
            information: DMatrix::from_row_slice(2, 2, &[1.0, r, r, 1.0]),
            loss: 0.0,
            stretch: 0.0,
            determined: Vec::new(),
            converged: true,
            gained: 0.0,
        };
        let both = fit.nominal_errors();
        let first = fit.nominal_errors_knowing(|i| i == 2);
        assert!((first[0] - 1.0).abs() < 1e-12, "{first:?}");
        assert!(
            (both[0] * (1.0 - r * r).sqrt() - 1.0).abs() < 1e-12,
            "{both:?}"
        );
        assert_eq!(first[1], f64::INFINITY);
    }

    /// A mean of n numbers x: S_w = 1, g_w = x_w − mean. Without x_w it is the mean less g_w / (n − 1), and the spread of these about it is the
    /// error: Σ g² / (n − 1)².
    #[test]
    fn the_error_of_a_mean_is_that_of_the_means_that_leave_one_number_out() {
        let x = [0.3, -1.2, 2.5, 0.1, 0.9, -0.4, 1.7];
        let n = x.len() as f64;
        let mean = x.iter().sum::<f64>() / n;
        let information = DMatrix::from_element(1, 1, n);
        let of_window = |x: &f64| Reduced {
            s: DMatrix::from_element(1, 1, 1.0),
            g: DVector::from_element(1, x - mean),
            state_step: DVector::zeros(0),
            state_by_theta: DMatrix::zeros(0, 1),
            state_gain: 0.0,
            determined: 0.0,
        };
        let pulls = x
            .iter()
            .map(|x| Some(by_itself(&information, &of_window(x))));
        let fit = Fit {
            theta: vec![mean],
            free: vec![0],
            states: Vec::new(),
            sigma: Vec::new(),
            squares: Vec::new(),
            gradients: pulls.collect(),
            information,
            loss: 0.0,
            stretch: 0.0,
            determined: Vec::new(),
            converged: true,
            gained: 0.0,
        };
        let squares: f64 = x.iter().map(|x| (x - mean).powi(2)).sum();
        let expected = squares.sqrt() / (n - 1.0);
        assert!((fit.standard_errors()[0] / expected - 1.0).abs() < 1e-12);
        // One window that is all there is determines nothing without itself.
        let only = by_itself(&DMatrix::from_element(1, 1, 1.0), &of_window(&x[0]));
        assert_eq!(only[0], x[0] - mean);
    }
}
